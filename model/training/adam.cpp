#include "model/training/adam.h"

#include "engine/core/parallel.h"
#include "engine/io/safetensors.h"
#include "model/training/adam_chain.h"

#include <ATen/ATen.h>

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

void update(float* x, const float* g, float* m, float* v, std::size_t count, const AdamCoefficients& c) {
    parallelRanges(count, 1 << 14, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            m[i] = c.beta1 * m[i] + (1.0f - c.beta1) * g[i];
            v[i] = c.beta2 * v[i] + (1.0f - c.beta2) * g[i] * g[i];
            x[i] -= c.rate * m[i] / (std::sqrt(v[i] * c.secondScale) + static_cast<float>(kAdamEpsilon));
        }
    });
}

/// Whether the gradient lies in memory as its leaf does, so that both can be walked as one row of numbers.
at::Tensor gradientLike(const at::Tensor& leaf) {
    const at::Tensor& gradient = leaf.grad();
    if (gradient.strides() == leaf.strides()) return gradient;
    at::Tensor same = at::empty_like(leaf);
    same.copy_(gradient);
    return same;
}

} // namespace

void Adam::addGroup(std::string name, std::vector<NetworkTensor> tensors) {
    Group group;
    group.name = std::move(name);
    for (NetworkTensor& leaf : tensors) {
        const at::Tensor zeros = at::zeros_like(leaf.tensor.detach());
        group.slots.push_back({std::move(leaf), zeros, zeros.clone()});
    }
    groups_.push_back(std::move(group));
}

void Adam::setRate(std::string_view group, double rate) {
    for (Group& g : groups_) {
        if (g.name == group) g.rate = rate;
    }
}

void Adam::clearGradients() {
    for (Group& group : groups_) {
        for (Slot& slot : group.slots) slot.leaf.tensor.mutable_grad() = at::Tensor();
    }
}

Status Adam::step() {
    for (const Group& group : groups_) {
        for (const Slot& slot : group.slots) {
            const at::Tensor& gradient = slot.leaf.tensor.grad();
            // A sum is not finite if any of its terms is not; only then is looked closer.
            if (!gradient.defined() || std::isfinite(gradient.sum().item<double>())) continue;
            if (at::isfinite(gradient).all().item<bool>()) continue;
            return makeError(ErrorCode::Internal, slot.leaf.name, "its gradient is not a finite number");
        }
    }
    at::NoGradGuard noGradient;
    for (Group& group : groups_) {
        const bool moves = std::any_of(group.slots.begin(), group.slots.end(),
                                       [](const Slot& slot) { return slot.leaf.tensor.grad().defined(); });
        if (group.rate == 0.0 || !moves) continue;
        ++group.steps;
        const auto t = static_cast<double>(group.steps);
        const AdamCoefficients c{static_cast<float>(beta1_), static_cast<float>(beta2_),
                                 static_cast<float>(group.rate / (1.0 - std::pow(beta1_, t))),
                                 static_cast<float>(1.0 / (1.0 - std::pow(beta2_, t)))};
        for (Slot& slot : group.slots) {
            if (!slot.leaf.tensor.grad().defined()) continue;
            if (!slot.leaf.tensor.is_cpu()) {
                chains::adamStep(slot.leaf.tensor, slot.leaf.tensor.grad(), slot.first, slot.second, c);
                continue;
            }
            const at::Tensor gradient = gradientLike(slot.leaf.tensor);
            update(slot.leaf.tensor.data_ptr<float>(), gradient.const_data_ptr<float>(), slot.first.data_ptr<float>(),
                   slot.second.data_ptr<float>(), static_cast<std::size_t>(gradient.numel()), c);
        }
    }
    return {};
}

void Adam::store(SafetensorsFile& file) const {
    for (const Group& group : groups_) {
        file.metadata["adam." + group.name + ".steps"] = std::to_string(group.steps);
        for (const Slot& slot : group.slots) {
            file.tensors["adam." + slot.leaf.name + ".m"] = arrayFromTensor(slot.first);
            file.tensors["adam." + slot.leaf.name + ".v"] = arrayFromTensor(slot.second);
        }
    }
}

Status Adam::loadGroup(const SafetensorsFile& file, Group& group) {
    const std::string key = "adam." + group.name + ".steps";
    const auto found = file.metadata.find(key);
    const bool known =
        found != file.metadata.end() || std::any_of(group.slots.begin(), group.slots.end(), [&](const Slot& slot) {
            const std::string name = "adam." + slot.leaf.name;
            return file.tensors.contains(name + ".m") || file.tensors.contains(name + ".v");
        });
    if (!known) return {};
    if (found == file.metadata.end()) return makeError(ErrorCode::BadFile, key, "is missing");
    group.steps = std::atoll(found->second.c_str());
    for (Slot& slot : group.slots) {
        for (auto [ending, moment] : {std::pair{".m", &slot.first}, std::pair{".v", &slot.second}}) {
            const std::string name = "adam." + slot.leaf.name + ending;
            const auto entry = file.tensors.find(name);
            if (entry == file.tensors.end()) return makeError(ErrorCode::BadFile, name, "is missing");
            ARS_TRY(const at::Tensor values, tensorFromArray(entry->second));
            if (values.sizes() != moment->sizes()) {
                return makeError(ErrorCode::BadFile, name,
                                 fmt::format("has {} numbers, expected {}", values.numel(), moment->numel()));
            }
            moment->copy_(values);
        }
    }
    return {};
}

Status Adam::load(const SafetensorsFile& file) {
    for (Group& group : groups_) ARS_TRY_STATUS(loadGroup(file, group));
    return {};
}

} // namespace ars
