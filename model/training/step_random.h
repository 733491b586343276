#pragma once

#include <array>
#include <cmath>
#include <cstdint>

namespace ars {

/// The random numbers of one step, a function of seed and step alone: an interrupted run draws what an uninterrupted
/// one would have drawn. SplitMix64 (Steele, Lea, Flood 2014).
class StepRandom {
public:
    StepRandom(std::uint64_t seed, std::int64_t step)
        : state_(mixed(seed * 0x9e3779b97f4a7c15ull) ^
                 mixed(static_cast<std::uint64_t>(step) + 0x632be59bd9b4e019ull)) {}

    std::uint64_t next() {
        state_ += 0x9e3779b97f4a7c15ull;
        return mixed(state_);
    }
    /// [0, 1)
    double uniform() { return static_cast<double>(next() >> 11) * 0x1.0p-53; }
    /// N(0, 1), Box and Muller.
    double normal() {
        const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
        return radius * std::cos(6.283185307179586 * uniform());
    }

private:
    static std::uint64_t mixed(std::uint64_t z) {
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
        return z ^ (z >> 31);
    }
    std::uint64_t state_;
};

} // namespace ars
