#include "app/eval.h"

#include "app/model_loader.h"
#include "app/progress_bar.h"
#include "app/text.h"
#include "engine/core/file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>

namespace ars::app {
namespace fs = std::filesystem;
namespace {

Error wrongUsage(std::string option, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(option), std::move(message));
}

constexpr int kMostPictures = 10000;

Status checkOptions(const EvalOptions& options) {
    constexpr std::array<std::string_view, 3> kProtocols{"ag", "heldout", "masked"};
    if (std::find(kProtocols.begin(), kProtocols.end(), options.protocol) == kProtocols.end()) {
        return wrongUsage("--protocol",
                          fmt::format("expected ag, heldout or masked, found \"{}\"", printable(options.protocol)));
    }
    if (options.pictures < 0 || options.pictures > kMostPictures) {
        return wrongUsage("--pictures",
                          fmt::format("expected a number from 0 to {}, found {}", kMostPictures, options.pictures));
    }
    for (const auto& [option, value] :
         {std::pair{"--avatar", options.avatar}, {"--capture", options.capture}, {"--out", options.out}}) {
        if (value.empty()) return wrongUsage(option, "is missing");
    }
    if (options.lpipsBackbone.empty() != options.lpipsHeads.empty()) {
        return wrongUsage(options.lpipsBackbone.empty() ? "--lpips-backbone" : "--lpips-heads",
                          "is missing: LPIPS needs the backbone's weights and the heads'");
    }
    std::error_code ignored;
    for (const auto& [option, value] : {std::pair{"--avatar", options.avatar}, {"--capture", options.capture}}) {
        if (!value.starts_with("rest:") && !fs::exists(value, ignored)) {
            return makeError(ErrorCode::NotFound, option,
                             fmt::format("expected a folder, found nothing at \"{}\"", printable(value)));
        }
    }
    return {};
}

Status eval(const EvalOptions& options, ProgressBar& bar) {
    ARS_TRY_STATUS(checkOptions(options));
    EvalRequest request;
    request.avatar = options.avatar;
    request.capture = options.capture;
    request.out = options.out;
    request.split = options.split;
    request.protocol = options.protocol;
    request.cameras = options.cameras;
    request.frames = options.frames;
    request.light = options.light;
    request.lpipsBackbone = options.lpipsBackbone;
    request.lpipsHeads = options.lpipsHeads;
    request.pictures = options.pictures;
    request.project = options.project;
    ARS_TRY(ModelPlugin* const model, loadModel());
    ARS_TRY(const Json report, model->evaluate(request, bar.function()));
    bar.clear();
    if (options.output.json) {
        printJson(report);
        return {};
    }
    ARS_TRY(const std::string table, readTextFile(fs::path(options.out) / "report.txt"));
    fmt::print("{}{}\n", table, printable((fs::path(options.out) / "report.json").string()));
    return {};
}

} // namespace

int runEval(const EvalOptions& options) {
    ProgressBar bar(options.output.quiet);
    const Status status = eval(options, bar);
    bar.clear();
    return status.ok() ? kSuccess : reportError(status.error(), options.output);
}

} // namespace ars::app
