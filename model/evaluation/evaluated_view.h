#pragma once

#include "engine/capture/capture.h"
#include "engine/frame/frame_pipeline.h"
#include "model/evaluation/evaluation.h"
#include "model/loss/perceptual.h"

#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

/// What one picture of an evaluation is made of; parts of evaluation.cpp.
namespace ars::detail {

/// A capture, or one of several below a folder, with what is evaluated of it.
struct EvaluatedCapture {
    std::string name; ///< folder's
    Capture capture;
    CaptureSplit split;
    std::vector<ViewId> views;   ///< of the split, that there are, frame by frame
    std::filesystem::path light; ///< the true light, or empty
    double exposure = 1.0;       ///< of frames.json or metadata.json
    std::filesystem::path truthPath(ViewId view, const std::string& buffer) const;
};

/// The captures in a folder: itself, or those below it. Errors of openCapture and namedSplit.
Result<std::vector<EvaluatedCapture>> openEvaluatedCaptures(const std::filesystem::path& folder,
                                                            const EvaluationOptions& options);

/// A photograph of the whole picture with its person.
struct Photograph {
    CapturedView view;
    Image mask;                        ///< 1 where alpha > 128 / 255, else 0
    std::array<float, 3> background{}; ///< sRGB: median of what is no person at all; white where there is none
};
/// Nothing where the mask holds nobody: a camera need not see the person in every frame.
Result<std::optional<Photograph>> readPhotograph(const EvaluatedCapture& set, ViewId view);

/// Ground truth of a view, as far as it lies in CAMERA/gt. Divided by coverage; depth is metres along the camera's
/// axis.
struct TrueBuffers {
    std::optional<Image> albedo, roughness, occlusion, normal, depth; ///< normal: camera space
};
/// BadFile where a buffer has another size than the view's camera.
Result<TrueBuffers> readTrueBuffers(const EvaluatedCapture& set, ViewId view, const Camera& camera);

/// What the avatar gives for a view.
struct RenderedView {
    Image radiance; ///< sRGB, divided by opacity
    Image albedo;   ///< linear, and the rest, divided by opacity
    Image roughness;
    Image normal; ///< camera space
    Image depth;
    Image opacity;
    Image occlusion; ///< 0 where nothing is
};

/// Renders an avatar's buffers and shades them under any light.
class ViewRenderer {
public:
    static Result<ViewRenderer> create(const EvaluatedAvatar& avatar);
    Result<RenderedView> render(const Pose& pose, const Camera& camera);
    /// The albedo alone.
    Result<Image> renderAlbedo(const Pose& pose, const Camera& camera);
    /// (height, width, 4) linear, premultiplied, under a light times `scale`; albedo times `albedoScale` first.
    Result<Image> shade(const RenderedView& view, const Camera& camera, const PrefilteredLight& light, float scale,
                        const glm::vec3& albedoScale = glm::vec3(1.0f)) const;

private:
    ViewRenderer(const EvaluatedAvatar& avatar, std::unique_ptr<FramePipeline> pipeline)
        : avatar_(avatar), pipeline_(std::move(pipeline)) {}
    FrameInputs inputsFor(const Pose& pose, const Camera& camera) const;
    EvaluatedAvatar avatar_;
    std::unique_ptr<FramePipeline> pipeline_;
};

/// Of a cube whose side is a power of two; below 64 its texels are repeated.
Result<std::unique_ptr<PrefilteredLight>> filteredCube(const CubeMap& cube);

/// Linear premultiplied RGBA over a background (sRGB), in linear light, held to [0, 1], sRGB-encoded.
Image composedShading(const Image& shaded, const std::array<float, 3>& background);
/// The radiance colour over a background, both sRGB-encoded, as training composes it; held to [0, 1].
Image composedRadiance(const RenderedView& view, const std::array<float, 3>& background);

/// Figures of a view under their names, in the order of the report.
using Figures = std::vector<std::pair<std::string, double>>;

/// PSNR and SSIM of a picture in the mask (over the photograph's own background) and on the whole picture over white;
/// LPIPS of the latter, where there are weights for it: with the published protocols of publishedCrop at 512 x 512.
struct PictureJudge {
    EvaluationProtocol protocol;
    const Photograph& photograph;
    const PerceptualLoss* lpips = nullptr;
    /// @param masked  the picture over the photograph's background
    /// @param white   the picture over white
    Status judge(const std::string& name, const Image& masked, Image white, Figures& figures) const;
};
/// Depth, normals, roughness and occlusion beside the truth.
Status judgeGeometry(const RenderedView& ours, const TrueBuffers& truth, const Photograph& photograph,
                     Figures& figures);
/// Albedo times the scale beside the truth: PSNR of sRGB-encoded values, of linear ones, mean error; `name` begins
/// their names.
Status judgeAlbedo(const std::string& name, const Image& albedo, const glm::dvec3& scale, const Image& truth,
                   const Image& mask, Figures& figures);

/// Sums of a least-squares scale per channel, s = sum p t / sum p^2, over the pixels of many masks.
struct AlbedoScale {
    glm::dvec3 products{0.0}, squares{0.0};
    std::size_t pixels = 0;
    void add(const Image& picture, const Image& truth, const Image& mask);
    /// 1 where nothing was seen.
    glm::dvec3 value() const;
};

/// What Animatable Gaussians' protocol takes LPIPS of, before it is resized: the mask's bounding box and 50 pixels
/// around it as far as the picture goes, in the middle of a white square.
Image publishedCrop(const Image& picture, const Image& mask);

/// SSIM of Animatable Gaussians' protocol: windows of 7x7 equal weights, sample variances, mean over windows inside the
/// picture and over channels (scikit-image's default).
Result<double> uniformSsim(const Image& a, const Image& b);

/// A page for people: photograph, pictures, errors; with truth a second row. Cropped to the person.
Image comparisonPage(const Photograph& photograph, const RenderedView& ours, const TrueBuffers& truth,
                     const std::vector<Image>& pictures, const glm::dvec3& albedoScale);

} // namespace ars::detail
