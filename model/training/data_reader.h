#pragma once

#include "engine/capture/capture.h"

#include <cstdint>
#include <memory>
#include <vector>

namespace ars {

/// What one training step looks at: one pose, seen by some cameras.
struct TrainingSample {
    std::int64_t step = 0;
    int frame = 0; ///< index into Capture::frames
    std::vector<std::shared_ptr<const CapturedView>> views;
};

struct DataOptions {
    ViewOptions view;
    int viewsPerStep = 4;
    std::uint64_t seed = 1;
    std::size_t cacheBytes = std::size_t(1) << 30; ///< decoded crops kept in memory
    std::filesystem::path cacheFolder;             ///< decoded crops kept on disk, empty: none; safe to delete
    std::size_t cacheFolderBytes = std::size_t(8) << 30;
    int prefetch = 4;                                   ///< samples that are read ahead
    std::size_t prefetchBytes = std::size_t(256) << 20; ///< and their decoded pictures; one sample may exceed it
};

/// The sample of a step is a function of seed and step alone, so an interrupted run continues with the same pictures:
/// frames in a fresh permutation each epoch, cameras of a frame in a permutation of their own, missing views left out.
std::vector<ViewId> viewsOfStep(const Capture& capture, const CaptureSplit& split, const DataOptions& options,
                                std::int64_t step);

/// Bytes of a sample's decoded pictures.
std::size_t sampleBytes(const TrainingSample& sample);

/// Reads samples ahead on a thread of its own, bounded by `prefetch` and `prefetchBytes`. One consumer.
class DataReader {
public:
    static Result<std::unique_ptr<DataReader>> start(std::shared_ptr<const Capture> capture, CaptureSplit split,
                                                     DataOptions options, std::int64_t firstStep);
    ~DataReader();
    /// Samples in the order of steps; waits. The error of a picture that cannot be read comes at its step and names it.
    Result<TrainingSample> next();
    /// Milliseconds that the last next() waited.
    double waitedMs() const;
    std::size_t cachedBytes() const;

private:
    DataReader();
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace ars
