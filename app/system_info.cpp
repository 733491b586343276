#include "app/system_info.h"

#include "app/file_report.h"
#include "app/model_loader.h"
#include "engine/core/buffer.h"
#include "engine/core/file.h"
#include "engine/core/parallel.h"
#if ARS_HAVE_WINDOW
#include "engine/gl/context.h"
#endif

#include <fmt/format.h>

#include <fstream>

namespace ars::app {
namespace {

std::string processorName() {
    std::ifstream file("/proc/cpuinfo");
    for (std::string line; std::getline(file, line);) {
        if (!line.starts_with("model name")) continue;
        const std::size_t colon = line.find(':');
        if (colon != std::string::npos && colon + 2 < line.size()) return line.substr(colon + 2);
    }
    return "unknown";
}

void addDevices(FileReport& report) {
    const MemoryInfo host = deviceMemory({}).ok() ? *deviceMemory({}) : MemoryInfo{};
    report.add("processor", fmt::format("{}, {} threads in use", processorName(), threadCount()),
               {{"name", processorName()}, {"threads", threadCount()}});
    report.add("memory", fmt::format("{} of {} free", formatBytes(host.freeBytes), formatBytes(host.totalBytes)),
               {{"free_bytes", host.freeBytes}, {"total_bytes", host.totalBytes}});
    std::string text;
    Json list = Json::array();
    for (const Device& device : availableDevices()) {
        if (device.kind != DeviceKind::Cuda) continue;
        const Result<MemoryInfo> memory = deviceMemory(device);
        text += fmt::format("{}{} ({})", text.empty() ? "" : ", ", deviceName(device),
                            memory ? formatBytes(memory->totalBytes) : memory.error().describe());
        list.push_back({{"name", deviceName(device)}, {"total_bytes", memory ? memory->totalBytes : 0}});
    }
#if ARS_HAVE_CUDA
    if (text.empty()) text = "built in, no device answers";
#else
    text = "not in this build";
#endif
    report.add("cuda", text, list);
}

void addOpenGl(FileReport& report) {
#if ARS_HAVE_WINDOW
    const auto context = HeadlessContext::create();
    if (!context) {
        report.add("opengl", context.error().describe(), nullptr);
        return;
    }
    const GlContextInfo& info = (*context)->info();
    report.add(
        "opengl",
        fmt::format("{} on {} ({}{})", info.version, info.renderer, info.platform, info.software ? ", software" : ""),
        {{"version", info.version},
         {"renderer", info.renderer},
         {"platform", info.platform},
         {"software", info.software}});
#else
    report.add("opengl", "not in this build", nullptr);
#endif
}

void addTorch(FileReport& report, bool measure) {
    const Result<ModelPlugin*> plugin = loadModel();
    if (!plugin) {
        report.add("libtorch", plugin.error().describe(), nullptr);
        return;
    }
    const TorchInfo info = (*plugin)->initialize();
    report.add("libtorch",
               fmt::format("{}, {} kernels, {} threads, {}{}", info.version, info.cpuCapability, info.threads,
                           info.onednn ? "oneDNN " : "", info.mkl ? "MKL" : ""),
               {{"version", info.version},
                {"cpu_capability", info.cpuCapability},
                {"threads", info.threads},
                {"onednn", info.onednn},
                {"mkl", info.mkl},
                {"cuda", info.cuda}});
    if (!measure) return;
    const TorchSpeed speed = (*plugin)->measureSpeed(30);
    report.add("libtorch_speed",
               fmt::format("convolution {:.0f} GFLOP/s, matrix product {:.0f} GFLOP/s", speed.convolution,
                           speed.matrixProduct),
               {{"convolution_gflops", speed.convolution}, {"matrix_product_gflops", speed.matrixProduct}});
}

} // namespace

int runSystemInfo(bool measure, const OutputOptions& output) {
    FileReport report;
    report.add("version", ARS_VERSION);
    report.add("compiler", ARS_COMPILER);
    addDevices(report);
    addOpenGl(report);
    addTorch(report, measure);
    const auto resources = resourceFolder();
    report.add("resources", resources ? resources->string() : resources.error().describe());
    if (output.json) {
        Json object = Json::object();
        for (const Fact& fact : report.facts) object[fact.key] = fact.value;
        printJson(object);
        return kSuccess;
    }
    for (const Fact& fact : report.facts) fmt::print("{:<16}{}\n", fact.key, fact.text);
    return kSuccess;
}

} // namespace ars::app
