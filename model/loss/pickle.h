#pragma once

#include "engine/core/error.h"

#include <cstddef>
#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <utility>
#include <vector>

/// The few kinds of pickled things of which state dicts are made. Everything lives in an arena and refers to others by
/// number, so that no file can nest or tie things in a way that hurts.
namespace ars::detail {

enum class PickleKind { None, Bool, Integer, Real, Text, Sequence, Dictionary, Global, Storage, Tensor, Opaque };

struct PickleValue {
    PickleKind kind = PickleKind::None;
    std::int64_t integer = 0; ///< also of Bool
    double real = 0;
    std::uint32_t node = 0; ///< of the kinds below
};

/// What a value refers to; which fields count follows from its kind.
struct PickleNode {
    std::string text;                                         ///< Text; Global: "module name"; Storage: key
    std::vector<PickleValue> items;                           ///< Sequence
    std::vector<std::pair<PickleValue, PickleValue>> entries; ///< Dictionary
    std::string storageType;                                  ///< Storage: "FloatStorage"
    std::int64_t storageCount = 0;                            ///< Storage: elements
    std::uint32_t storage = 0;                                ///< Tensor: node of its storage
    std::int64_t offset = 0;                                  ///< Tensor: first element
    std::vector<std::int64_t> shape, strides;                 ///< Tensor
};

/// One pickle.
struct Pickle {
    PickleValue top;
    std::deque<PickleNode> nodes;
    std::size_t length = 0; ///< bytes up to and with its STOP
    const PickleNode& node(const PickleValue& value) const { return nodes[value.node]; }
};

/// Reads the pickle at the beginning of `bytes`. BadFile ("byte 12: ..."); Unsupported naming an opcode or a global
/// that state dicts do not use.
Result<Pickle> parsePickle(std::span<const std::byte> bytes);

} // namespace ars::detail
