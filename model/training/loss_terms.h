#pragma once

#include "engine/core/error.h"
#include "model/tensors.h"

#include <chrono>
#include <map>
#include <string>

namespace ars {

/// Splits a step's wall time among its parts.
class StepClock {
public:
    /// What passed since the last mark belongs to `part`.
    void mark(const std::string& part);
    double totalMs() const;
    /// Milliseconds by "time.PART_ms".
    const std::map<std::string, double>& parts() const { return parts_; }

private:
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now(), last_ = start_;
    std::map<std::string, double> parts_;
};

/// Weighted terms of a step; their sum is differentiated.
class LossTerms {
public:
    /// Terms of one name are summed; one of weight 0 or without a value is left out.
    void add(const std::string& name, double weight, const at::Tensor& value);
    /// The sum; `values` gets every term as "loss.NAME". Internal naming a term that is not a number.
    Result<at::Tensor> total(std::map<std::string, double>& values) const;

private:
    std::map<std::string, at::Tensor> terms_;
};

} // namespace ars
