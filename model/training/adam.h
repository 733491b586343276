#pragma once

#include "engine/core/error.h"
#include "model/tensors.h"

#include <string>
#include <vector>

namespace ars {

struct SafetensorsFile;

/// Adam (Kingma and Ba 2015) without weight decay: m = b1 m + (1 - b1) g, v = b2 v + (1 - b2) g^2,
/// x -= rate m_hat / (sqrt(v_hat) + 1e-8). Groups have rates and step counts of their own: one that joins later starts
/// its bias correction then, and a step in which nothing of a group has a gradient is none of its own. The result does
/// not depend on the number of threads.
class Adam {
public:
    Adam(double beta1, double beta2) : beta1_(beta1), beta2_(beta2) {}

    /// Leaves of autograd, float, contiguous in any memory format. Names are those under which moments are stored.
    void addGroup(std::string name, std::vector<NetworkTensor> tensors);
    /// Sets the rate of a group; groups start with 0, which leaves them alone.
    void setRate(std::string_view group, double rate);

    /// Drops all gradients.
    void clearGradients();
    /// One step along the gradients that there are; tensors without one are left alone.
    /// @return Internal naming the tensor whose gradient is not finite; nothing was changed then
    Status step();

    /// Moments and counts, and back. A group that the file knows nothing of (it was frozen, or not there) begins anew.
    /// BadFile naming what is missing of a group or has another shape.
    void store(SafetensorsFile& file) const;
    Status load(const SafetensorsFile& file);

private:
    struct Slot {
        NetworkTensor leaf;
        at::Tensor first, second; ///< moments
    };
    struct Group {
        std::string name;
        double rate = 0;
        std::int64_t steps = 0;
        std::vector<Slot> slots;
    };
    static Status loadGroup(const SafetensorsFile& file, Group& group);

    double beta1_, beta2_;
    std::vector<Group> groups_;
};

} // namespace ars
