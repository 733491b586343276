#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/light/cube_map.h"

namespace ars {

/// One level to filter; pictures N wide and 6 N high of one device, sizes checked.
struct FilterArguments {
    ImageView<const float> source;
    ImageView<float> target;
    float alphaSquared = 0.0f; ///< roughness^4; not used by the diffuse filter
    float cutoffCosine = 0.0f;
    TexelArea area = TexelArea::Exact;
    const float* areas = nullptr; ///< (N, N) of `area` for the source's side, on the device; the host makes its own
};

namespace cpu {
void averagePool(ImageView<const float> source, ImageView<float> target);
void filterSpecular(const FilterArguments& arguments);
void filterDiffuse(const FilterArguments& arguments);
/// The adjoints: source is dL/d of the filtered level, target receives dL/d of what was filtered; both of one side.
void filterSpecularAdjoint(const FilterArguments& arguments);
void filterDiffuseAdjoint(const FilterArguments& arguments);

/// Which instructions the filters use; tests compare them. Best is what this machine has.
enum class FilterInstructions { Portable, Avx2, Avx512, Best };
/// False (and no change) when this machine or build has not got them.
bool useFilterInstructions(FilterInstructions instructions);
} // namespace cpu

namespace cuda {
/// (size, size) solid angles on a CUDA device, copied there once.
Result<const float*> texelAreas(const Device& device, int size, TexelArea area);
/// Queued on the default stream of device `index`; none of them waits.
Status averagePool(ImageView<const float> source, ImageView<float> target, int index);
Status filterSpecular(const FilterArguments& arguments, int index);
Status filterDiffuse(const FilterArguments& arguments, int index);
} // namespace cuda

} // namespace ars
