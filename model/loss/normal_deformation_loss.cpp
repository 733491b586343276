#include "engine/surfel/knn.h"
#include "model/loss/known_gradient.h"
#include "model/loss/loss_chains.h"
#include "model/loss/losses.h"

#include <ATen/Dispatch.h>

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

/// Third column of R(q), q = (w, x, y, z).
class NormalsOfRotationsFunction : public torch::autograd::Function<NormalsOfRotationsFunction> {
public:
    static at::Tensor forward(torch::autograd::AutogradContext* context, const at::Tensor& rotations) {
        const at::Tensor q = rotations.contiguous();
        const at::Tensor normals = at::empty({q.size(0), 3}, q.options());
        AT_DISPATCH_FLOATING_TYPES(q.scalar_type(), "normalsOfRotations", [&] {
            const auto* in = q.const_data_ptr<scalar_t>();
            auto* out = normals.data_ptr<scalar_t>();
            parallelFor(
                static_cast<std::size_t>(q.size(0)),
                [&](std::size_t i) {
                    const scalar_t w = in[4 * i], x = in[4 * i + 1], y = in[4 * i + 2], z = in[4 * i + 3];
                    out[3 * i] = scalar_t(2) * (x * z + w * y);
                    out[3 * i + 1] = scalar_t(2) * (y * z - w * x);
                    out[3 * i + 2] = scalar_t(1) - scalar_t(2) * (x * x + y * y);
                },
                2048);
        });
        context->save_for_backward({q});
        return normals;
    }

    static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                   torch::autograd::variable_list above) {
        if (!above[0].defined()) return {{}};
        const at::Tensor q = context->get_saved_variables()[0], gradNormals = above[0].contiguous();
        const at::Tensor gradient = at::empty_like(q);
        AT_DISPATCH_FLOATING_TYPES(q.scalar_type(), "normalsOfRotations", [&] {
            const auto* in = q.const_data_ptr<scalar_t>();
            const auto* g = gradNormals.const_data_ptr<scalar_t>();
            auto* out = gradient.data_ptr<scalar_t>();
            parallelFor(
                static_cast<std::size_t>(q.size(0)),
                [&](std::size_t i) {
                    const scalar_t w = in[4 * i], x = in[4 * i + 1], y = in[4 * i + 2], z = in[4 * i + 3];
                    const scalar_t gx = scalar_t(2) * g[3 * i], gy = scalar_t(2) * g[3 * i + 1],
                                   gz = scalar_t(2) * g[3 * i + 2];
                    out[4 * i] = gx * y - gy * x;
                    out[4 * i + 1] = gx * z - gy * w - scalar_t(2) * gz * x;
                    out[4 * i + 2] = gx * w + gy * z - scalar_t(2) * gz * y;
                    out[4 * i + 3] = gx * x + gy * y;
                },
                2048);
        });
        return {gradient};
    }
};

constexpr std::size_t kPairBlock = 1024;

} // namespace

NeighbourPairs canonicalNeighbours(std::span<const glm::vec3> canonical, int neighbours, float maxSpacings) {
    NeighbourPairs pairs;
    std::vector<std::int64_t> first, second;
    std::vector<float> farthest;
    if (const auto nearest = nearestNeighbors(canonical, neighbours); nearest && canonical.size() > 1) {
        const auto k = static_cast<std::size_t>(neighbours);
        const auto distance = [&](std::size_t i, std::size_t rank) {
            return glm::distance(canonical[i], canonical[(*nearest)[i * k + rank]]);
        };
        std::vector<float> spacings(canonical.size());
        for (std::size_t i = 0; i < canonical.size(); ++i) spacings[i] = distance(i, 0);
        const auto middle = spacings.begin() + static_cast<std::ptrdiff_t>(spacings.size() / 2);
        std::nth_element(spacings.begin(), middle, spacings.end());
        const float limit = maxSpacings * *middle;
        for (std::size_t i = 0; i < canonical.size(); ++i) {
            float scale = 0.0f; // rows of few points end in the point itself
            for (std::size_t rank = 0; rank < k; ++rank) scale = std::max(scale, distance(i, rank));
            for (std::size_t rank = 0; rank < k; ++rank) {
                const std::size_t j = (*nearest)[i * k + rank];
                if (j == i || distance(i, rank) > limit || !(scale > 0.0f)) continue;
                first.push_back(static_cast<std::int64_t>(i));
                second.push_back(static_cast<std::int64_t>(j));
                farthest.push_back(scale);
            }
        }
    }
    pairs.first = at::tensor(first, at::kLong);
    pairs.second = at::tensor(second, at::kLong);
    pairs.farthest = at::tensor(farthest, at::kFloat);
    return pairs;
}

at::Tensor normalsOfRotations(const at::Tensor& rotations) {
    TORCH_CHECK(rotations.dim() == 2 && rotations.size(1) == 4, "normalsOfRotations: expected (surfels, 4), found ",
                rotations.sizes());
    if (!rotations.is_cpu()) return chains::normalsOfRotations(rotations);
    return NormalsOfRotationsFunction::apply(rotations);
}

at::Tensor normalDeformationLoss(const NeighbourPairs& pairs, const at::Tensor& means, const at::Tensor& normals,
                                 const at::Tensor& chosen) {
    TORCH_CHECK(normals.dim() == 2 && normals.size(1) == 3 && means.sizes() == normals.sizes(),
                "normalDeformationLoss: expected means and normals (surfels, 3), found ", means.sizes(), " and ",
                normals.sizes());
    const at::Tensor n = detail::onHost(normals), mu = detail::onHost(means).to(n.scalar_type());
    const at::Tensor subset = chosen.defined() ? detail::onHost(chosen) : chosen;
    const auto count = static_cast<std::size_t>(chosen.defined() ? chosen.numel() : pairs.first.numel());
    const auto* first = pairs.first.const_data_ptr<std::int64_t>();
    const auto* second = pairs.second.const_data_ptr<std::int64_t>();
    const auto* farthest = pairs.farthest.const_data_ptr<float>();
    const auto* order = subset.defined() ? subset.const_data_ptr<std::int64_t>() : nullptr;
    at::Tensor gradient;
    if (detail::wantsGradient(normals)) gradient = at::zeros_like(n);
    double sum = 0;
    AT_DISPATCH_FLOATING_TYPES(n.scalar_type(), "normalDeformationLoss", [&] {
        const auto* vn = n.const_data_ptr<scalar_t>();
        const auto* vm = mu.const_data_ptr<scalar_t>();
        std::vector<scalar_t> slopes(gradient.defined() ? count : 0);
        const auto pairOf = [&](std::size_t m) { return order ? order[m] : static_cast<std::int64_t>(m); };
        sum = detail::sumOverRows((count + kPairBlock - 1) / kPairBlock, 4, [&](std::size_t block) {
            double blockSum = 0;
            for (std::size_t m = block * kPairBlock; m < std::min(count, (block + 1) * kPairBlock); ++m) {
                const std::int64_t pair = pairOf(m);
                const scalar_t *ni = vn + 3 * first[pair], *nj = vn + 3 * second[pair];
                const scalar_t *mi = vm + 3 * first[pair], *mj = vm + 3 * second[pair];
                const scalar_t sigma = farthest[pair];
                scalar_t square = 0, cosine = 0;
                for (int c = 0; c < 3; ++c) {
                    square += (mi[c] - mj[c]) * (mi[c] - mj[c]);
                    cosine += ni[c] * nj[c];
                }
                const scalar_t weight = std::exp(-square / (sigma * sigma));
                blockSum += weight * (scalar_t(1) - std::abs(cosine));
                if (gradient.defined()) slopes[m] = -weight * detail::signOf(cosine);
            }
            return blockSum;
        });
        if (!gradient.defined()) return;
        // One thread: pairs of different surfels write to the same neighbour.
        auto* g = gradient.data_ptr<scalar_t>();
        for (std::size_t m = 0; m < count; ++m) {
            const std::int64_t i = 3 * first[pairOf(m)], j = 3 * second[pairOf(m)];
            for (int c = 0; c < 3; ++c) {
                g[i + c] += slopes[m] * vn[j + c];
                g[j + c] += slopes[m] * vn[i + c];
            }
        }
    });
    const double scale = count > 0 ? 1.0 / static_cast<double>(count) : 0.0;
    return detail::lossOf(sum * scale, scale, {normals, gradient});
}

} // namespace ars
