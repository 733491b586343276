#pragma once

#include "engine/capture/capture.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "model/loss/losses.h"
#include "model/loss/perceptual.h"
#include "model/operators/skin_tensors.h"
#include "model/training/data_reader.h"
#include "model/training/learned_state.h"
#include "model/training/loss_terms.h"
#include "model/training/step_random.h"

#include <map>
#include <memory>

namespace ars {

/// The losses of a training step (docs/math/training.md): from the networks through splatting, occlusion and shading to
/// the pictures that are compared.
class StepTerms {
public:
    /// @param config, capture, state  looked at in every step; they outlive this
    StepTerms(const TrainingConfig& config, const Capture& capture, const LearnedState& state)
        : config_(config), capture_(capture), state_(state) {}

    /// Reads the perceptual loss's weights where there are any, pairs canonical neighbours. `state` lies by now where
    /// the training runs.
    Status prepare();

    /// Stage 0: attributes after activation against those that the template starts with, plain L1.
    Status addTemplate(const TrainingSample& sample, LossTerms& terms, StepClock& clock);
    /// Stages 1 and 2: the sample's pictures.
    /// @param step  of the whole training
    Status addPictures(TrainingStage stage, std::int64_t step, const TrainingSample& sample, StepRandom& random,
                       LossTerms& terms, StepClock& clock);

private:
    /// What a view is compared with.
    struct View;

    Result<AvatarNetworkInputs> inputsOf(int frame);
    Result<std::vector<at::Tensor>> viewMaps(const TrainingSample& sample, std::size_t count, StepRandom& random) const;
    void addPictureLosses(const at::Tensor& picture, const View& view, double weight, const std::string& prefix,
                          StepRandom& random, LossTerms& terms) const;
    at::Tensor perceptualTerm(const at::Tensor& seen, const at::Tensor& target, const at::Tensor& inside,
                              const View& view, StepRandom& random) const;
    void addGeometry(const GBufferTensors& gbuffer, const View& view, LossTerms& terms) const;
    void addShaded(const GBufferTensors& gbuffer, const View& view, const std::shared_ptr<LightTensors>& light,
                   StepRandom& random, LossTerms& terms, StepClock& clock);
    at::Tensor normalTerm(const SurfelTensors& surfels, StepRandom& random) const;
    /// Where steps run: beside what they change.
    c10::Device device() const;
    at::Tensor placed(const Image& image) const;
    std::int64_t totalSteps() const;

    const TrainingConfig& config_;
    const Capture& capture_;
    const LearnedState& state_;
    std::unique_ptr<PerceptualLoss> perceptual_;
    NeighbourPairs neighbours_;
    SkinTensors skin_;
    std::map<int, AvatarNetworkInputs> inputs_; ///< by frame
    SplatScratchPool scratch_;
    OcclusionWorkspace occlusionMemory_;
};

} // namespace ars
