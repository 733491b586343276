#include "app/info.h"

#include "app/inspect.h"
#include "app/interrupt.h"
#include "app/progress_bar.h"

#include <fmt/format.h>

#include <unistd.h>

#include <cstdio>
#include <new>

namespace ars::app {
namespace {

/// The report of a path, whatever happens on the way to it.
FileReport inspectSafely(const std::string& path, const InspectOptions& options) {
    try {
        return inspectPath(path, options);
    } catch (const std::bad_alloc&) {
        FileReport report;
        report.path = path;
        report.title = "not examined";
        report.fail(makeError(ErrorCode::OutOfMemory, "", "not enough memory to examine it"));
        return report;
    }
}

/// The report on standard output and a failure on standard error as well: whoever sends the reports into a file still
/// sees it. On a terminal once is enough.
void showReport(const FileReport& report) {
    const bool absent = report.kind == "missing" || report.kind == "unreadable";
    if (!absent) {
        fmt::print("{}", formatReport(report));
        std::fflush(stdout);
    }
    if (report.ok() || (!absent && ::isatty(STDOUT_FILENO) == 1)) return;
    reportError(atPlace(*report.error, report.path), {});
}

} // namespace

int runInfo(const InfoOptions& options) {
    Json reports = Json::array();
    bool allGood = true;
    for (const std::string& path : options.files) {
        FileReport report;
        {
            ProgressBar bar(options.output.quiet);
            report = inspectSafely(path, {.fast = options.fast, .progress = bar.function()});
        }
        if (interruptRequested()) {
            return reportError(makeError(ErrorCode::Cancelled, path, "the examination was stopped on request"),
                               options.output);
        }
        allGood = allGood && report.ok();
        if (options.output.json) {
            reports.push_back(reportJson(report));
        } else {
            showReport(report);
        }
    }
    if (options.output.json) printJson(options.files.size() == 1 ? reports.front() : reports);
    return allGood ? kSuccess : kFailure;
}

} // namespace ars::app
