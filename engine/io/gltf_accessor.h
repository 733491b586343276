#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/memory_budget.h"

#include <tiny_gltf.h>

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace ars {

/// Reads accessors of a model that tinygltf parsed, as arrays. Every range is checked against the buffer that it lies
/// in before memory is taken; `place` ("meshes[0].primitives[1].attributes.POSITION") stands in front of every error.
class GltfAccessors {
public:
    GltfAccessors(const tinygltf::Model& model, const ReadLimits& limits)
        : model_(model), limits_(limits), budget_(limits) {}

    /// Elements of an accessor; BadFile when there is none of this index.
    Result<std::size_t> count(int index, const std::string& place) const;

    /// (count, components) numbers; integers become floats, divided by their range where they are normalised. All
    /// finite. `type` is one of TINYGLTF_TYPE_*, `expectedCount` is what the accessor must have. An accessor without a
    /// buffer view (all zero, or sparse) needs an expected count.
    Result<std::vector<float>> floats(int index, int type, std::optional<std::size_t> expectedCount,
                                      const std::string& place);

    /// The same for vertex indices and joints: unsigned integers, not normalised.
    Result<std::vector<std::uint32_t>> integers(int index, int type, std::optional<std::size_t> expectedCount,
                                                const std::string& place);

    /// The type of an accessor (TINYGLTF_TYPE_*), or -1.
    int typeOf(int index) const;

    /// Bytes of a buffer view.
    Result<std::span<const unsigned char>> view(int index, const std::string& place) const;

    MemoryBudget& budget() { return budget_; }

private:
    /// Where the elements of an accessor lie; `data` is null for an accessor without a buffer view.
    struct Layout {
        const tinygltf::Accessor* accessor = nullptr;
        const unsigned char* data = nullptr;
        std::size_t stride = 0;
        std::size_t componentBytes = 0;
        std::size_t components = 0;
    };
    /// The substituted elements of a sparse accessor, tightly packed.
    struct Sparse {
        std::vector<std::uint32_t> indices;
        const unsigned char* values = nullptr;
    };

    Result<Layout> layout(int index, int type, std::optional<std::size_t> expectedCount,
                          const std::string& place) const;
    Result<Sparse> sparse(const Layout& layout, const std::string& place) const;
    template <typename T, typename Convert>
    Result<std::vector<T>> gather(const Layout& layout, const std::string& place, Convert&& convert);

    const tinygltf::Model& model_;
    const ReadLimits& limits_;
    MemoryBudget budget_;
};

} // namespace ars
