#include "engine/surfel/gbuffer.h"
#include "model/loss/depth_normal_math.h"
#include "model/loss/known_gradient.h"
#include "model/loss/losses.h"

#include <ATen/Dispatch.h>

#include <cmath>

namespace ars {
namespace {

using detail::signOf;

/// A depth picture with its opacity, by pixel.
template <typename T>
struct DepthPicture {
    const T* depth;
    const T* opacity;
    PinholeCamera<T> camera;
    std::int64_t height, width;

    bool covered(std::int64_t pixel) const { return opacity[pixel] >= static_cast<T>(kMinOpacity); }
    /// The normal of a pixel, or none at the border and where the pixel or a neighbour is empty.
    bool cross(std::int64_t row, std::int64_t column, detail::DepthCross<T>& result) const {
        if (row < 1 || column < 1 || row + 1 >= height || column + 1 >= width) return false;
        const std::int64_t p = row * width + column;
        if (!covered(p) || !covered(p - width) || !covered(p + width) || !covered(p - 1) || !covered(p + 1))
            return false;
        result =
            detail::depthCross(camera, row, column, depth[p - width], depth[p + width], depth[p - 1], depth[p + 1]);
        return result.length > T(0);
    }
    void scatter(T* gradient, std::int64_t row, std::int64_t column, const glm::vec<4, T>& values) const {
        const std::int64_t p = row * width + column;
        gradient[p - width] += values[0];
        gradient[p + width] += values[1];
        gradient[p - 1] += values[2];
        gradient[p + 1] += values[3];
    }
};

template <typename T>
DepthPicture<T> depthPicture(const at::Tensor& depth, const at::Tensor& opacity, const Camera& camera) {
    return {depth.const_data_ptr<T>(), opacity.const_data_ptr<T>(), camera.as<T>(), depth.size(0), depth.size(1)};
}

void checkDepth(const char* what, const at::Tensor& depth, const at::Tensor& opacity, const Camera& camera) {
    TORCH_CHECK(depth.dim() >= 2 && depth.numel() == depth.size(0) * depth.size(1), what,
                ": expected a depth picture (height, width, 1), found ", depth.sizes());
    TORCH_CHECK(opacity.numel() == depth.numel(), what, ": expected an opacity of the depth's size ", depth.sizes(),
                ", found ", opacity.sizes());
    TORCH_CHECK(camera.height == depth.size(0) && camera.width == depth.size(1), what, ": expected a camera of ",
                depth.size(1), " x ", depth.size(0), " pixels, found ", camera.width, " x ", camera.height);
}

at::Tensor plain(const at::Tensor& tensor, c10::ScalarType type) { return detail::onHost(tensor).to(type); }

class DepthNormalsFunction : public torch::autograd::Function<DepthNormalsFunction> {
public:
    static at::Tensor forward(torch::autograd::AutogradContext* context, const at::Tensor& depth,
                              const at::Tensor& opacity, const Camera& camera) {
        const at::Tensor z = depth.contiguous(), o = plain(opacity, depth.scalar_type());
        const at::Tensor normals = at::zeros({depth.size(0), depth.size(1), 3}, depth.options());
        AT_DISPATCH_FLOATING_TYPES(z.scalar_type(), "depthNormals", [&] {
            const auto picture = depthPicture<scalar_t>(z, o, camera);
            auto* out = normals.data_ptr<scalar_t>();
            parallelFor(
                static_cast<std::size_t>(picture.height),
                [&](std::size_t row) {
                    detail::DepthCross<scalar_t> cross;
                    for (std::int64_t x = 0; x < picture.width; ++x) {
                        if (!picture.cross(static_cast<std::int64_t>(row), x, cross)) continue;
                        for (int c = 0; c < 3; ++c)
                            out[3 * (static_cast<std::int64_t>(row) * picture.width + x) + c] = cross.normal[c];
                    }
                },
                detail::kRowGrain);
        });
        context->save_for_backward({z, o});
        context->saved_data["camera"] = std::vector<double>{camera.fx, camera.fy, camera.cx, camera.cy};
        return normals;
    }

    static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                   torch::autograd::variable_list above) {
        const auto saved = context->get_saved_variables();
        const std::vector<double> k = context->saved_data["camera"].toDoubleVector();
        Camera camera;
        camera.fx = k[0];
        camera.fy = k[1];
        camera.cx = k[2];
        camera.cy = k[3];
        if (!above[0].defined()) return {{}, {}, {}};
        const at::Tensor gradDepth = at::zeros_like(saved[0]), gradNormal = above[0].contiguous();
        AT_DISPATCH_FLOATING_TYPES(saved[0].scalar_type(), "depthNormals", [&] {
            const auto picture = depthPicture<scalar_t>(saved[0], saved[1], camera);
            const auto* g = gradNormal.const_data_ptr<scalar_t>();
            auto* out = gradDepth.data_ptr<scalar_t>();
            detail::scatterOverRows(static_cast<std::size_t>(picture.height), [&](std::size_t r) {
                detail::DepthCross<scalar_t> cross;
                const auto row = static_cast<std::int64_t>(r);
                for (std::int64_t x = 0; x < picture.width; ++x) {
                    if (!picture.cross(row, x, cross)) continue;
                    const scalar_t* n = g + 3 * (row * picture.width + x);
                    picture.scatter(out, row, x,
                                    detail::depthCrossBackward(cross, glm::vec<3, scalar_t>(n[0], n[1], n[2])));
                }
            });
        });
        return {gradDepth, {}, {}};
    }
};

/// Sum of 1 - N . N_D over a row's pixels that have both, with its gradients.
template <typename T>
double consistencyRow(const DepthPicture<T>& picture, const T* normal, std::int64_t row, T* gradNormal, T* gradDepth,
                      std::int64_t& pixels) {
    double sum = 0;
    detail::DepthCross<T> cross;
    for (std::int64_t x = 0; x < picture.width; ++x) {
        const std::int64_t p = row * picture.width + x;
        const glm::vec<3, T> n(normal[3 * p], normal[3 * p + 1], normal[3 * p + 2]);
        if (glm::dot(n, n) == T(0) || !picture.cross(row, x, cross)) continue;
        ++pixels;
        sum += T(1) - glm::dot(n, cross.normal);
        if (gradNormal) {
            for (int c = 0; c < 3; ++c) gradNormal[3 * p + c] = -cross.normal[c];
        }
        if (gradDepth) picture.scatter(gradDepth, row, x, detail::depthCrossBackward(cross, -n));
    }
    return sum;
}

/// |sum over foreground neighbours of (n_j - n_c)|_1 of one pixel, with its gradient.
template <typename T>
double curvatureOf(const T* normal, const bool* inside, std::int64_t row, std::int64_t column, std::int64_t height,
                   std::int64_t width, T* gradient) {
    const std::int64_t p = row * width + column;
    const std::int64_t candidates[4] = {p - width, p + width, p - 1, p + 1};
    const bool exists[4] = {row > 0, row + 1 < height, column > 0, column + 1 < width};
    std::int64_t neighbours[4];
    int count = 0;
    for (int k = 0; k < 4; ++k) {
        if (exists[k] && inside[candidates[k]]) neighbours[count++] = candidates[k];
    }
    double sum = 0;
    for (int c = 0; c < 3; ++c) {
        T laplacian = 0;
        for (int k = 0; k < count; ++k) laplacian += normal[3 * neighbours[k] + c] - normal[3 * p + c];
        sum += std::abs(laplacian);
        if (!gradient) continue;
        const T sign = signOf(laplacian);
        for (int k = 0; k < count; ++k) gradient[3 * neighbours[k] + c] += sign;
        gradient[3 * p + c] -= static_cast<T>(count) * sign;
    }
    return sum;
}

struct RowSums {
    double sum = 0;
    std::int64_t pixels = 0;
};
RowSums totalOf(const std::vector<RowSums>& rows) {
    RowSums total;
    for (const RowSums& row : rows) {
        total.sum += row.sum;
        total.pixels += row.pixels;
    }
    return total;
}

} // namespace

at::Tensor depthNormals(const at::Tensor& depth, const at::Tensor& opacity, const Camera& camera) {
    checkDepth("depthNormals", depth, opacity, camera);
    TORCH_CHECK(depth.is_cpu(), "depthNormals: expected a depth picture in host memory, found one on ", depth.device());
    return DepthNormalsFunction::apply(depth, opacity.detach(), camera);
}

at::Tensor depthNormalLoss(const at::Tensor& normal, const at::Tensor& depth, const at::Tensor& opacity,
                           const Camera& camera) {
    checkDepth("depthNormalLoss", depth, opacity, camera);
    TORCH_CHECK(normal.numel() == 3 * depth.numel(), "depthNormalLoss: expected normals of the depth's size ",
                depth.sizes(), ", found ", normal.sizes());
    const at::Tensor z = detail::onHost(depth);
    const at::Tensor o = plain(opacity, z.scalar_type()), n = plain(normal, z.scalar_type());
    at::Tensor gradNormal, gradDepth;
    if (detail::wantsGradient(normal)) gradNormal = at::zeros_like(n);
    if (detail::wantsGradient(depth)) gradDepth = at::zeros_like(z);
    std::vector<RowSums> rows(static_cast<std::size_t>(z.size(0)));
    AT_DISPATCH_FLOATING_TYPES(z.scalar_type(), "depthNormalLoss", [&] {
        const auto picture = depthPicture<scalar_t>(z, o, camera);
        const auto* normals = n.const_data_ptr<scalar_t>();
        auto* gn = gradNormal.defined() ? gradNormal.data_ptr<scalar_t>() : nullptr;
        auto* gd = gradDepth.defined() ? gradDepth.data_ptr<scalar_t>() : nullptr;
        detail::scatterOverRows(rows.size(), [&](std::size_t row) {
            rows[row].sum = consistencyRow(picture, normals, static_cast<std::int64_t>(row), gn, gd, rows[row].pixels);
        });
    });
    const RowSums total = totalOf(rows);
    const double scale = total.pixels > 0 ? 1.0 / static_cast<double>(total.pixels) : 0.0;
    return detail::lossOf(total.sum * scale, scale, {normal, gradNormal}, {depth, gradDepth});
}

at::Tensor curvatureLoss(const at::Tensor& normal, const at::Tensor& opacity) {
    TORCH_CHECK(normal.dim() == 3 && normal.size(2) == 3, "curvatureLoss: expected (height, width, 3), found ",
                normal.sizes());
    const std::int64_t height = normal.size(0), width = normal.size(1);
    TORCH_CHECK(opacity.numel() == height * width, "curvatureLoss: expected an opacity of the normals' size, found ",
                opacity.sizes());
    const at::Tensor n = detail::onHost(normal);
    const at::Tensor foreground = detail::onHost(opacity).gt(detail::kForegroundOpacity);
    at::Tensor gradient;
    if (detail::wantsGradient(normal)) gradient = at::zeros_like(n);
    std::vector<RowSums> rows(static_cast<std::size_t>(height));
    AT_DISPATCH_FLOATING_TYPES(n.scalar_type(), "curvatureLoss", [&] {
        const auto* values = n.const_data_ptr<scalar_t>();
        const bool* inside = foreground.const_data_ptr<bool>();
        auto* g = gradient.defined() ? gradient.data_ptr<scalar_t>() : nullptr;
        detail::scatterOverRows(rows.size(), [&](std::size_t r) {
            const auto row = static_cast<std::int64_t>(r);
            for (std::int64_t x = 0; x < width; ++x) {
                if (!inside[row * width + x]) continue;
                rows[r].sum += curvatureOf(values, inside, row, x, height, width, g);
                ++rows[r].pixels;
            }
        });
    });
    const RowSums total = totalOf(rows);
    const double scale = total.pixels > 0 ? 1.0 / static_cast<double>(total.pixels) : 0.0;
    return detail::lossOf(total.sum * scale, scale, {normal, gradient});
}

} // namespace ars
