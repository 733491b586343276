#include "engine/scene/export.h"

#include "engine/core/parallel.h"
#include "engine/io/exr.h"
#include "engine/io/png.h"
#include "engine/io/video.h"
#include "engine/scene/evaluate.h"
#include "engine/scene/frame_renderer.h"
#include "engine/scene/project.h"

#include <algorithm>
#include <cmath>

namespace ars {
namespace fs = std::filesystem;

namespace {

constexpr int kMaxSide = 16384;
/// Larger pictures are refined in slices, so that progress is told and stopping works.
constexpr std::size_t kPixelsAtOnce = 1u << 20;
constexpr std::size_t kMaxFilmFrames = 1'000'000;

/// Display-linear grey of the checkerboard's squares, and their side in pixels: those of shaders/present.frag.
constexpr float kLightSquare = 0.030f, kDarkSquare = 0.016f;
constexpr int kSquarePixels = 12;

bool isShaded(BufferId id) { return bufferInfo(id).kind == BufferKind::LinearColor; }

Error wrongArgument(std::string place, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(place), std::move(message));
}

Status checkSize(int width, int height) {
    if (width >= 1 && height >= 1 && width <= kMaxSide && height <= kMaxSide) return {};
    return wrongArgument("size", fmt::format("sides of 1 to {} pixels expected, found {}x{}", kMaxSide, width, height));
}

std::string endingOf(const fs::path& path) {
    std::string ending = path.extension().string();
    std::transform(ending.begin(), ending.end(), ending.begin(), [](unsigned char c) { return std::tolower(c); });
    return ending;
}

DisplaySettings displayOf(const ViewSection& view, BufferId buffer, bool transparent) {
    const BufferDisplay& own = view.buffers[static_cast<std::size_t>(buffer)];
    DisplaySettings settings{view.tone, own.range, own.colorMap};
    settings.tone.transparent = transparent;
    return settings;
}

/// Light of any form as premultiplied RGBA.
Image premultipliedLight(const Image& picture, const Image& opacity) {
    if (picture.channels == 4) return picture;
    Image light = picture;
    light.channels = 4;
    light.premultiplied = true;
    light.pixels.resize(4 * opacity.pixels.size());
    parallelFor(opacity.pixels.size(), [&](std::size_t p) {
        const float covered = opacity.pixels[p];
        for (std::size_t c = 0; c < 3; ++c) light.pixels[4 * p + c] = picture.pixels[3 * p + c] * covered;
        light.pixels[4 * p + 3] = covered;
    });
    return light;
}

/// What stands behind the avatar, as it is shown: sRGB-encoded RGB.
class Background {
public:
    explicit Background(Image picture) : picture_(std::move(picture)) {}
    explicit Background(int width) : width_(width) {}
    glm::vec3 operator()(std::size_t p) const {
        if (!picture_.pixels.empty())
            return {picture_.pixels[3 * p], picture_.pixels[3 * p + 1], picture_.pixels[3 * p + 2]};
        const auto column = p % static_cast<std::size_t>(width_), row = p / static_cast<std::size_t>(width_);
        return glm::vec3(((column / kSquarePixels + row / kSquarePixels) & 1u) == 0 ? light_ : dark_);
    }

private:
    Image picture_; ///< empty: a checkerboard
    int width_ = 1;
    float light_ = linearToSrgb(kLightSquare), dark_ = linearToSrgb(kDarkSquare);
};

/// A picture with straight alpha over a background. Light is mixed as light, data as they are shown.
Image over(const Image& shown, const Background& background, bool light) {
    Image result = shown;
    result.channels = 3;
    result.pixels.resize(shown.pixels.size() / 4 * 3);
    parallelFor(shown.pixels.size() / 4, [&](std::size_t p) {
        const glm::vec3 behind = background(p);
        const float alpha = shown.pixels[4 * p + 3];
        for (int c = 0; c < 3; ++c) {
            const float front = shown.pixels[4 * p + static_cast<std::size_t>(c)];
            float& mixed = result.pixels[3 * p + static_cast<std::size_t>(c)];
            if (alpha <= 0.0f)
                mixed = behind[c];
            else if (alpha >= 1.0f)
                mixed = front;
            else if (light)
                mixed = linearToSrgb(glm::mix(srgbToLinear(behind[c]), srgbToLinear(front), alpha));
            else
                mixed = glm::mix(behind[c], front, alpha);
        }
    });
    return result;
}

/// The buffers that a light is there for, without doubles.
std::vector<BufferId> renderable(const std::vector<BufferId>& buffers, bool light) {
    std::vector<BufferId> result{BufferId::Opacity};
    for (const BufferId id : buffers) {
        if ((light || !isShaded(id)) && std::find(result.begin(), result.end(), id) == result.end())
            result.push_back(id);
    }
    return result;
}

Status checkShown(const Document& document, const SceneAssets& assets) {
    const BufferId buffer = document.view.buffer;
    if (!isShaded(buffer) || (assets.light && assets.light->source)) return {};
    return makeError(
        ErrorCode::NotFound, "light",
        fmt::format("the document shows {}, which needs a light, and none is loaded", bufferInfo(buffer).label));
}

} // namespace

std::string pictureText(const Document& document, const SceneAssets& assets, const Device& device) {
    nlohmann::ordered_json json = documentToJson(document);
    nlohmann::ordered_json facts{{"program", fmt::format("ars {}", ARS_VERSION)}, {"device", deviceName(device)}};
    if (assets.avatar && assets.avatar->evaluator)
        facts["surfels"] = assets.avatar->evaluator->rig().weights.pointCount();
    json["picture"] = std::move(facts);
    return json.dump();
}

std::vector<BufferId> allViewedBuffers() {
    std::vector<BufferId> buffers;
    for (const BufferInfo& info : bufferCatalogue()) {
        if (info.id != BufferId::RadiusPlus && info.id != BufferId::RadiusMinus) buffers.push_back(info.id);
    }
    return buffers;
}

Result<Image> shownPicture(const Document& document, BufferId buffer, const Image& picture, const Image& opacity,
                           const Camera& camera, const EnvironmentPlacement& placement, const Environment* environment,
                           bool transparent) {
    const BackdropKind backdrop = document.light.backdrop == BackdropKind::Environment && !environment
                                      ? BackdropKind::Color
                                      : document.light.backdrop;
    if (transparent || backdrop == BackdropKind::Color || buffer == BufferId::Opacity)
        return displayPicture(buffer, picture, opacity, displayOf(document.view, buffer, transparent));
    if (backdrop == BackdropKind::Checkerboard) {
        ARS_TRY(const Image shown, displayPicture(buffer, picture, opacity, displayOf(document.view, buffer, true)));
        return over(shown, Background(picture.width), isShaded(buffer));
    }
    // The environment is light and goes through the curve with the avatar; behind data it goes through it alone.
    const float blur = document.light.backdropBlur;
    const DisplaySettings asLight = displayOf(document.view, BufferId::Beauty, false);
    Image light;
    if (isShaded(buffer)) {
        light = premultipliedLight(picture, opacity);
    } else {
        light.width = picture.width;
        light.height = picture.height;
        light.channels = 4;
        light.premultiplied = true;
        light.pixels.assign(4 * opacity.pixels.size(), 0.0f);
    }
    ARS_TRY_STATUS(addBackdrop(light, camera, *environment, placement, blur));
    ARS_TRY(Image behind, displayPicture(BufferId::Beauty, light, opacity, asLight));
    if (isShaded(buffer)) return behind;
    ARS_TRY(const Image shown, displayPicture(buffer, picture, opacity, displayOf(document.view, buffer, true)));
    return over(shown, Background(std::move(behind)), false);
}

DocumentRenderer::DocumentRenderer(const SceneAssets& assets, std::unique_ptr<FramePipeline> pipeline)
    : assets_(assets), pipeline_(std::move(pipeline)) {}

Result<DocumentRenderer> DocumentRenderer::create(const SceneAssets& assets, const Device& device) {
    if (!assets.avatar || !assets.avatar->evaluator) return wrongArgument("document", "its avatar is not loaded");
    ARS_TRY(std::unique_ptr<FramePipeline> pipeline, FramePipeline::create(assets.avatar->evaluator, device));
    if (assets.light && assets.light->source) pipeline->setLight(assets.light->source->filtered);
    return DocumentRenderer(assets, std::move(pipeline));
}

Status DocumentRenderer::render(const Document& document, double timeS, int width, int height,
                                const std::vector<BufferId>& buffers, const ProgressFunction& progress) {
    ARS_TRY_STATUS(checkSize(width, height));
    const std::vector<BufferId> wanted = renderable(buffers, assets_.light && assets_.light->source);
    FrameInputs inputs = inputsForBuffers(frameInputs(document, assets_, timeS, width, height), wanted);
    const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    if (pixels <= kPixelsAtOnce) return pipeline_->render(inputs, wanted);
    inputs.occlusion.screenSpace.quality = OcclusionQuality::Interactive;
    std::vector<BufferId> geometry = wanted;
    std::erase_if(geometry, isShaded);
    const bool occluded = pipeline_->pending(inputs, wanted)[static_cast<std::size_t>(FrameStage::Occlude)];
    if (occluded) geometry.push_back(BufferId::AmbientOcclusion);
    do {
        ARS_TRY_STATUS(reportProgress(progress, occluded ? pipeline_->occlusionShare() : 0.0, "rendering"));
        ARS_TRY_STATUS(pipeline_->render(inputs, geometry));
    } while (occluded && !pipeline_->occlusionComplete());
    return pipeline_->render(inputs, wanted);
}

Result<Image> DocumentRenderer::shown(const Document& document, BufferId buffer, bool transparent) const {
    ARS_TRY(const Image picture, pipeline_->picture(buffer));
    ARS_TRY(const Image opacity, pipeline_->picture(BufferId::Opacity));
    const FrameInputs& inputs = pipeline_->inputs();
    const Environment* environment =
        assets_.light && assets_.light->source ? &assets_.light->source->environment : nullptr;
    return shownPicture(document, buffer, picture, opacity, inputs.camera, inputs.placement, environment, transparent);
}

Status writeScreenshot(const Document& document, const SceneAssets& assets, const Device& device,
                       const ScreenshotOptions& options, const ProgressFunction& progress) {
    ARS_TRY_STATUS(checkSize(options.width, options.height));
    const std::string ending = endingOf(options.file);
    if (ending != ".png" && ending != ".exr")
        return wrongArgument(options.file.string(), "expected a name that ends in .png or .exr");
    const bool png = ending == ".png";
    if (png) ARS_TRY_STATUS(checkShown(document, assets));
    std::vector<BufferId> buffers = options.buffers.empty() ? allViewedBuffers() : options.buffers;
    if (png) buffers = {document.view.buffer};
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "rendering"));
    ARS_TRY(DocumentRenderer renderer, DocumentRenderer::create(assets, device));
    const ProgressFunction within = [&progress](double share, std::string_view what) {
        return !progress || progress(0.9 * share, what);
    };
    ARS_TRY_STATUS(renderer.render(document, document.timeline.timeS, options.width, options.height, buffers, within));
    ARS_TRY_STATUS(reportProgress(progress, 0.9, "writing"));
    const std::string text = pictureText(document, assets, device);
    if (png) {
        PngWriteOptions write;
        write.text["ars"] = text;
        ARS_TRY(const Image shown, renderer.shown(document, document.view.buffer, options.transparent));
        ARS_TRY_STATUS(writePng(options.file, shown, write));
    } else {
        ExrImage exr;
        exr.textAttributes["ars"] = text;
        for (const BufferId id : buffers) {
            auto picture = renderer.picture(id);
            if (!picture && isShaded(id)) continue; // there is no light
            if (!picture) return std::move(picture).error();
            ARS_TRY_STATUS(addBufferLayer(exr, id, *picture));
        }
        ARS_TRY_STATUS(writeExr(options.file, exr));
    }
    return reportProgress(progress, 1.0, "written");
}

std::vector<double> filmTimes(const Document& document, const VideoOptions& options) {
    const TimelineSection& timeline = document.timeline;
    const bool own = options.startS != 0.0 || options.endS != 0.0;
    const double start = own ? options.startS : timeline.startS, end = own ? options.endS : timeline.endS;
    const double rate = options.framesPerSecond > 0.0 ? options.framesPerSecond : timeline.framesPerSecond;
    const double frames = std::round((end - start) * rate);
    if (!(frames <= static_cast<double>(kMaxFilmFrames))) return {};
    std::vector<double> times;
    for (int i = 0; i < std::max(1, static_cast<int>(frames)); ++i) times.push_back(start + i / rate);
    return times;
}

Status writeVideo(const Document& document, const SceneAssets& assets, const Device& device,
                  const VideoOptions& options, const ProgressFunction& progress) {
    ARS_TRY_STATUS(checkSize(options.width, options.height));
    ARS_TRY_STATUS(checkShown(document, assets));
    const std::string ending = endingOf(options.file);
    const bool film = ending == ".mp4";
    if (!film && !ending.empty() && !fs::is_directory(options.file))
        return wrongArgument(options.file.string(), "expected a name that ends in .mp4, or a folder");
    if (film && (options.width % 2 != 0 || options.height % 2 != 0)) {
        return wrongArgument("size",
                             fmt::format("an MP4 has even sides, found {}x{}; try {}x{}", options.width, options.height,
                                         options.width + options.width % 2, options.height + options.height % 2));
    }
    const std::vector<double> times = filmTimes(document, options);
    if (times.empty())
        return wrongArgument("range", fmt::format("more than {} frames; choose a shorter range", kMaxFilmFrames));
    ARS_TRY(DocumentRenderer renderer, DocumentRenderer::create(assets, device));
    std::optional<VideoWriter> writer;
    if (film) {
        VideoFormat format;
        format.width = options.width;
        format.height = options.height;
        format.framesPerSecond =
            options.framesPerSecond > 0.0 ? options.framesPerSecond : document.timeline.framesPerSecond;
        format.metadata["comment"] = pictureText(document, assets, device);
        ARS_TRY(VideoWriter opened, VideoWriter::open(options.file, format));
        writer = std::move(opened);
    }
    const bool known = film || fs::exists(options.file);
    std::vector<fs::path> frames;
    const auto writeFrames = [&]() -> Status {
        const auto count = static_cast<double>(times.size());
        for (std::size_t i = 0; i < times.size(); ++i) {
            const ProgressFunction within = [&, i](double share, std::string_view) {
                return !progress || progress((static_cast<double>(i) + share) / count,
                                             fmt::format("frame {} of {}", i + 1, times.size()));
            };
            ARS_TRY_STATUS(reportProgress(within, 0.0, "the film"));
            ARS_TRY_STATUS(
                renderer.render(document, times[i], options.width, options.height, {document.view.buffer}, within));
            ARS_TRY(const Image shown, renderer.shown(document, document.view.buffer));
            if (writer) {
                ARS_TRY_STATUS(writer->add(displayBytes(shown)));
                continue;
            }
            Document at = document;
            at.timeline.timeS = times[i];
            PngWriteOptions write;
            write.text["ars"] = pictureText(at, assets, device);
            frames.push_back(options.file / fmt::format("{:04}.png", i));
            ARS_TRY_STATUS(writePng(frames.back(), shown, write));
        }
        return {};
    };
    if (const Status done = writeFrames(); !done) {
        // Half a film is no film: what was written of it goes, and the folder where it was made for it.
        std::error_code ignored;
        for (const fs::path& frame : frames) fs::remove(frame, ignored);
        if (!known) fs::remove(options.file, ignored);
        return done;
    }
    if (writer) ARS_TRY_STATUS(writer->finish());
    return reportProgress(progress, 1.0, "written");
}

} // namespace ars
