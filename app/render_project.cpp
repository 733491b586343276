#include "app/picture_writer.h"
#include "app/render.h"
#include "app/rig_source.h"
#include "app/text.h"
#include "engine/scene/export.h"
#include "engine/scene/project.h"

#include <fmt/format.h>

#include <chrono>
#include <optional>

namespace ars::app {
namespace fs = std::filesystem;

namespace {

constexpr PictureSize kUsualSize{960, 720};

Error wrongUsage(std::string option, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(option), std::move(message));
}

/// What is rendered, and where it goes.
struct ProjectPlan {
    Device device;
    Document document;
    std::vector<std::string> notes;
    PictureSize size = kUsualSize;
    std::vector<BufferId> buffers;
    VideoOptions film;         ///< where a film is asked for: its times and rate
    std::string ending;        ///< of --out where it names a file: .png .exr .mp4
    PictureFormats formats;    ///< where it names a folder
    std::vector<double> times; ///< of the frames
};

Result<Document> readDocument(const std::string& path, std::vector<std::string>& notes) {
    const fs::path file(path);
    std::string ending = file.extension().string();
    if (ending == ".png" || ending == ".exr" || ending == ".mp4") return documentFromPicture(file, &notes);
    return readProject(file, &notes);
}

/// "1:2.5" in seconds.
Status parseFilmTimes(const std::string& text, VideoOptions& film) {
    const std::size_t colon = text.find(':');
    const auto wrong = [&] {
        return wrongUsage("--range", fmt::format("expected START:END in seconds, found \"{}\"", printable(text)));
    };
    if (colon == std::string::npos) return wrong();
    const auto start = parseNumbers(text.substr(0, colon), "--range"),
               end = parseNumbers(text.substr(colon + 1), "--range");
    if (!start || !end || start->size() != 1 || end->size() != 1 || !(start->front() < end->front())) return wrong();
    film.startS = start->front();
    film.endS = end->front();
    return {};
}

Status planOutput(const RenderOptions& options, ProjectPlan& plan) {
    if (!options.size.empty()) {
        ARS_TRY(plan.size, parseSize(options.size, "--size"));
    }
    if (!options.buffers.empty()) {
        auto buffers = parseBuffers(options.buffers);
        if (!buffers) return atPlace(buffers.error(), "--aov");
        plan.buffers = std::move(*buffers);
    }
    const std::string ending = fs::path(options.out).extension().string();
    if (ending == ".png" || ending == ".exr" || ending == ".mp4") plan.ending = ending;
    if (!plan.ending.empty() && !options.formats.empty())
        return wrongUsage("--write", fmt::format("the name {} says it already", printable(options.out)));
    if (!options.film && (ending == ".mp4" || !options.filmTimes.empty() || options.framesPerSecond > 0.0))
        return wrongUsage("--film", "an MP4, --range and --fps are for films; add --film");
    if (options.film && (ending == ".png" || ending == ".exr"))
        return wrongUsage("--out", "a film goes into a folder or a file that ends in .mp4");
    if (!options.formats.empty()) {
        ARS_TRY(plan.formats, parseFormats(options.formats));
        if (plan.formats.mp4 && !options.film) return wrongUsage("--film", "an MP4 is a film; add --film");
        if ((plan.formats.exr || plan.formats.buffers) && plan.buffers.empty()) plan.buffers = {BufferId::Beauty};
    } else {
        plan.formats.png = true;
        plan.formats.exr = !plan.buffers.empty();
        plan.formats.mp4 = options.film;
    }
    const bool mp4 = ending == ".mp4" || (plan.ending.empty() && plan.formats.mp4);
    if (options.film && mp4 && (plan.size.width % 2 != 0 || plan.size.height % 2 != 0))
        return wrongUsage("--size", "a film has even sides");
    return {};
}

Result<ProjectPlan> makePlan(const RenderOptions& options) {
    ProjectPlan plan;
    ARS_TRY(plan.device, chooseDevice(options.frame.device));
    ARS_TRY(plan.document, readDocument(options.project, plan.notes));
    ARS_TRY_STATUS(planOutput(options, plan));
    plan.times = {plan.document.timeline.timeS};
    if (!options.film) return plan;
    plan.film.width = plan.size.width;
    plan.film.height = plan.size.height;
    plan.film.file = options.out;
    plan.film.framesPerSecond = options.framesPerSecond;
    if (!options.filmTimes.empty()) ARS_TRY_STATUS(parseFilmTimes(options.filmTimes, plan.film));
    plan.times = filmTimes(plan.document, plan.film);
    if (plan.times.empty()) return wrongUsage("--range", "the film would have more than a million frames");
    return plan;
}

Status writeFolder(const RenderOptions& options, const ProjectPlan& plan, const SceneAssets& assets,
                   const ProgressFunction& progress, RenderSummary& summary) {
    ARS_TRY(DocumentRenderer renderer, DocumentRenderer::create(assets, plan.device));
    PictureWriter writer(options.out, plan.formats, plan.buffers);
    writer.framesPerSecond =
        plan.film.framesPerSecond > 0.0 ? plan.film.framesPerSecond : plan.document.timeline.framesPerSecond;
    writer.filmDocument = pictureText(plan.document, assets, plan.device);
    std::vector<BufferId> wanted = plan.buffers;
    wanted.push_back(plan.document.view.buffer);
    WrittenFrame frame;
    frame.main = plan.document.view.buffer;
    frame.picture = [&](BufferId id) { return renderer.picture(id); };
    frame.shown = [&](BufferId id, bool) { return renderer.shown(plan.document, id, options.display.transparent); };
    for (std::size_t i = 0; i < plan.times.size(); ++i) {
        ARS_TRY_STATUS(reportProgress(progress, static_cast<double>(i) / static_cast<double>(plan.times.size()),
                                      fmt::format("frame {} of {}", i + 1, plan.times.size())));
        ARS_TRY_STATUS(renderer.render(plan.document, plan.times[i], plan.size.width, plan.size.height, wanted, {}));
        Document at = plan.document;
        at.timeline.timeS = plan.times[i];
        frame.number = i;
        frame.document = pictureText(at, assets, plan.device);
        ARS_TRY_STATUS(writer.add(frame));
        for (const StageReport& stage : renderer.pipeline().stages()) {
            if (stage.ran) summary.stageMs[static_cast<std::size_t>(stage.stage)] += stage.milliseconds;
        }
    }
    ARS_TRY_STATUS(writer.finish());
    summary.files = writer.files();
    return {};
}

Status write(const RenderOptions& options, const ProjectPlan& plan, const SceneAssets& assets,
             const ProgressFunction& progress, RenderSummary& summary) {
    if (plan.ending.empty()) return writeFolder(options, plan, assets, progress, summary);
    summary.files = {options.out};
    if (options.film) return writeVideo(plan.document, assets, plan.device, plan.film, progress);
    ScreenshotOptions screenshot;
    screenshot.file = options.out;
    screenshot.width = plan.size.width;
    screenshot.height = plan.size.height;
    screenshot.transparent = options.display.transparent;
    screenshot.buffers = plan.buffers;
    return writeScreenshot(plan.document, assets, plan.device, screenshot, progress);
}

} // namespace

Result<RenderSummary> renderProject(const RenderOptions& options, const ProgressFunction& progress) {
    ARS_TRY(const ProjectPlan plan, makePlan(options));
    const auto part = [&progress](double from, double to) -> ProgressFunction {
        if (!progress) return {};
        return [=](double share, std::string_view what) { return progress(from + (to - from) * share, what); };
    };
    ARS_TRY(const SceneAssets assets, loadAssets(plan.document, plan.device, LightQuality::Exact, part(0.0, 0.15)));
    RenderSummary summary;
    summary.device = plan.device;
    summary.notes = plan.notes;
    if (assets.avatar) {
        summary.avatar = assets.avatar->evaluator->description();
        summary.notes.insert(summary.notes.end(), assets.avatar->notes.begin(), assets.avatar->notes.end());
    }
    const auto begin = std::chrono::steady_clock::now();
    ARS_TRY_STATUS(write(options, plan, assets, part(0.15, 1.0), summary));
    summary.frames = plan.times.size();
    summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    summary.memory = memoryUse();
    return summary;
}

} // namespace ars::app
