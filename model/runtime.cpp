#include "model/runtime.h"

#include "engine/core/parallel.h"

#include <torch/torch.h>
#include <torch/version.h>

#include <algorithm>
#include <chrono>
#include <system_error>

namespace ars {
namespace {

template <typename Function>
double bestSeconds(int repetitions, Function&& function) {
    double best = 1e30;
    for (int i = 0; i < repetitions; ++i) {
        const auto start = std::chrono::steady_clock::now();
        function();
        best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    return best;
}

} // namespace

TorchInfo initializeTorch() {
    static const bool once = [] {
        if (!threadsAvailable(threadCount() - 1)) {
            throw std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again));
        }
        at::set_num_threads(threadCount());
        // Autograd and JIT may start tasks of their own; one thread is enough and keeps within the budget.
        at::set_num_interop_threads(1);
        return true;
    }();
    (void)once;
    TorchInfo info;
    info.version = fmt::format("{}.{}.{}", TORCH_VERSION_MAJOR, TORCH_VERSION_MINOR, TORCH_VERSION_PATCH);
    info.cpuCapability = at::get_cpu_capability();
    info.threads = at::get_num_threads();
    info.mkl = at::hasMKL();
    info.onednn = at::globalContext().hasMKLDNN();
    info.cuda = torch::cuda::is_available();
    return info;
}

TorchSpeed measureTorchSpeed(int repetitions) {
    initializeTorch();
    const ThreadLease lease;
    at::set_num_threads(lease.count());
    const torch::InferenceMode guard;
    // Channels last is the layout of every network here: oneDNN reorders the plain one at each call (130 against 220).
    const torch::Tensor image = torch::randn({1, 64, 128, 128}).contiguous(at::MemoryFormat::ChannelsLast);
    const torch::Tensor kernel = torch::randn({64, 64, 3, 3}).contiguous(at::MemoryFormat::ChannelsLast);
    const torch::Tensor a = torch::randn({1024, 1024});
    const torch::Tensor b = torch::randn({1024, 1024});
    TorchSpeed speed;
    const double convolutionFlop = 2.0 * 64 * 64 * 9 * 128 * 128;
    speed.convolution =
        convolutionFlop * 1e-9 / bestSeconds(repetitions, [&] { torch::conv2d(image, kernel, {}, 1, 1); });
    speed.matrixProduct = 2.0 * 1024 * 1024 * 1024 * 1e-9 / bestSeconds(repetitions, [&] { torch::mm(a, b); });
    return speed;
}

} // namespace ars
