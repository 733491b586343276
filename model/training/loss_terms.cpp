#include "model/training/loss_terms.h"

#include <ATen/ATen.h>

#include <cmath>

namespace ars {

void StepClock::mark(const std::string& part) {
    const auto now = std::chrono::steady_clock::now();
    parts_["time." + part + "_ms"] += std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
}

double StepClock::totalMs() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_).count();
}

void LossTerms::add(const std::string& name, double weight, const at::Tensor& value) {
    if (weight == 0.0 || !value.defined()) return;
    const at::Tensor weighted = weight * value;
    const auto found = terms_.find(name);
    if (found == terms_.end())
        terms_[name] = weighted;
    else
        found->second = found->second + weighted;
}

Result<at::Tensor> LossTerms::total(std::map<std::string, double>& values) const {
    at::Tensor sum;
    double number = 0.0;
    for (const auto& [name, term] : terms_) {
        const double value = term.item<double>();
        if (!std::isfinite(value)) {
            return makeError(ErrorCode::Internal, "loss." + name, fmt::format("is {}, expected a number", value));
        }
        values["loss." + name] = value;
        number += value;
        sum = sum.defined() ? sum + term : term;
    }
    values["loss.total"] = number;
    if (!sum.defined()) return makeError(ErrorCode::InvalidArgument, "loss", "every weight is 0");
    return sum;
}

} // namespace ars
