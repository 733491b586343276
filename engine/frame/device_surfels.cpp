#include "engine/frame/device_surfels.h"

namespace ars {

namespace {

Status reserve(Buffer& buffer, const Device& device, std::size_t bytes, std::string_view owner) {
    if (buffer.data() && buffer.device() == device && buffer.bytes() == bytes) return {};
    buffer = Buffer();
    if (bytes == 0) return {};
    ARS_TRY(buffer, Buffer::allocate(device, bytes, owner));
    return {};
}

template <typename T>
Status upload(Buffer& buffer, const Device& device, std::span<const T> values) {
    ARS_TRY_STATUS(reserve(buffer, device, values.size_bytes(), "surfels"));
    return values.empty() ? Status() : uploadBuffer(buffer, std::as_bytes(values));
}

template <typename T>
Status upload(Buffer& buffer, const Device& device, const std::vector<T>& values) {
    return upload(buffer, device, std::span<const T>(values));
}

/// Nothing where the attribute is absent.
template <typename T>
Status download(std::vector<T>& values, const Buffer& buffer) {
    values.resize(buffer.bytes() / sizeof(T));
    return values.empty() ? Status() : downloadBuffer(std::as_writable_bytes(std::span(values)), buffer);
}

template <typename T>
const T* pointer(const Buffer& buffer) {
    return static_cast<const T*>(buffer.data());
}

} // namespace

Status DeviceSurfels::setCanonical(const Device& device, const Surfels& canonical, const SkinWeights& weights) {
    device_ = device;
    count_ = canonical.count();
    ARS_TRY_STATUS(upload(joints_, device, weights.joints));
    ARS_TRY_STATUS(upload(weights_, device, weights.weights));
    ARS_TRY_STATUS(upload(means_, device, canonical.means));
    ARS_TRY_STATUS(upload(rotations_, device, canonical.rotations));
    ARS_TRY_STATUS(upload(scales_, device, canonical.scales));
    ARS_TRY_STATUS(upload(opacities_, device, canonical.opacities));
    ARS_TRY_STATUS(upload(colors_, device, canonical.colors));
    ARS_TRY_STATUS(upload(albedos_, device, canonical.albedos));
    return upload(roughnesses_, device, canonical.roughnesses);
}

Result<SurfelView> DeviceSurfels::setSurfels(const Device& device, const Surfels& surfels) {
    ARS_TRY_STATUS(setCanonical(device, surfels, {}));
    ARS_TRY_STATUS(upload(posedMeans_, device, surfels.means));
    ARS_TRY_STATUS(upload(posedRotations_, device, surfels.rotations));
    ARS_TRY_STATUS(upload(radii_, device, surfels.radii));
    ARS_TRY_STATUS(upload(radiiPlus_, device, surfels.radiiPlus));
    ARS_TRY_STATUS(upload(radiiMinus_, device, surfels.radiiMinus));
    ARS_TRY_STATUS(upload(importances_, device, surfels.importances));
    ARS_TRY_STATUS(upload(bones_, device, surfels.bones));
    return view();
}

Status DeviceSurfels::pose(const PoseSurfelsParams& params, std::span<const glm::mat4> matrices,
                           std::span<const glm::vec3> jointPositions, std::span<const BodyPart> parts,
                           const PartRadii& radii) {
    std::vector<float> jointRadii, jointInitialRadii;
    for (const BodyPart part : parts) {
        jointRadii.push_back(radii[static_cast<std::size_t>(part)]);
        jointInitialRadii.push_back(bodyPartInitialRadiusM(part));
    }
    ARS_TRY_STATUS(upload(matrices_, device_, matrices));
    ARS_TRY_STATUS(upload(jointPositions_, device_, jointPositions));
    ARS_TRY_STATUS(upload(jointRadii_, device_, jointRadii));
    ARS_TRY_STATUS(upload(jointInitialRadii_, device_, jointInitialRadii));
    struct {
        Buffer& buffer;
        std::size_t bytes;
    } const outputs[] = {{posedMeans_, 12}, {posedRotations_, 16}, {radii_, 4}, {importances_, 4}, {bones_, 12}};
    for (const auto& output : outputs)
        ARS_TRY_STATUS(reserve(output.buffer, device_, output.bytes * count_, "surfels"));
    for (Buffer* buffer : {&radiiPlus_, &radiiMinus_}) {
        ARS_TRY_STATUS(reserve(*buffer, device_, params.trainingRadii ? 4 * count_ : 0, "surfels"));
    }
    PoseSurfelsArrays arrays;
    arrays.count = count_;
    arrays.jointCount = matrices.size();
    arrays.matrices = pointer<glm::mat4>(matrices_);
    arrays.jointPositions = pointer<glm::vec3>(jointPositions_);
    arrays.jointRadii = pointer<float>(jointRadii_);
    arrays.jointInitialRadii = pointer<float>(jointInitialRadii_);
    arrays.joints = pointer<std::uint16_t>(joints_);
    arrays.weights = pointer<float>(weights_);
    arrays.means = pointer<glm::vec3>(means_);
    arrays.rotations = pointer<float>(rotations_);
    arrays.posedMeans = static_cast<glm::vec3*>(posedMeans_.data());
    arrays.posedRotations = static_cast<float*>(posedRotations_.data());
    arrays.radii = static_cast<float*>(radii_.data());
    arrays.radiiPlus = static_cast<float*>(radiiPlus_.data());
    arrays.radiiMinus = static_cast<float*>(radiiMinus_.data());
    arrays.importances = static_cast<float*>(importances_.data());
    arrays.bones = static_cast<glm::vec3*>(bones_.data());
    return poseSurfelsOnDevice(params, device_, arrays);
}

SurfelView DeviceSurfels::view() const {
    SurfelView view;
    view.device = device_;
    view.count = count_;
    view.means = pointer<glm::vec3>(posedMeans_);
    view.rotations = pointer<float>(posedRotations_);
    view.scales = pointer<glm::vec2>(scales_);
    view.opacities = pointer<float>(opacities_);
    view.colors = pointer<glm::vec3>(colors_);
    view.albedos = pointer<glm::vec3>(albedos_);
    view.roughnesses = pointer<float>(roughnesses_);
    view.radii = pointer<float>(radii_);
    view.radiiPlus = pointer<float>(radiiPlus_);
    view.radiiMinus = pointer<float>(radiiMinus_);
    view.importances = pointer<float>(importances_);
    view.bones = pointer<glm::vec3>(bones_);
    return view;
}

Result<std::vector<glm::vec3>> DeviceSurfels::downloadMeans() const {
    std::vector<glm::vec3> means;
    ARS_TRY_STATUS(ars::download(means, posedMeans_));
    return means;
}

Result<Surfels> DeviceSurfels::download() const {
    Surfels surfels;
    ARS_TRY(surfels.means, downloadMeans());
    ARS_TRY_STATUS(ars::download(surfels.rotations, posedRotations_));
    ARS_TRY_STATUS(ars::download(surfels.scales, scales_));
    ARS_TRY_STATUS(ars::download(surfels.opacities, opacities_));
    ARS_TRY_STATUS(ars::download(surfels.colors, colors_));
    ARS_TRY_STATUS(ars::download(surfels.albedos, albedos_));
    ARS_TRY_STATUS(ars::download(surfels.roughnesses, roughnesses_));
    ARS_TRY_STATUS(ars::download(surfels.radii, radii_));
    ARS_TRY_STATUS(ars::download(surfels.radiiPlus, radiiPlus_));
    ARS_TRY_STATUS(ars::download(surfels.radiiMinus, radiiMinus_));
    ARS_TRY_STATUS(ars::download(surfels.importances, importances_));
    ARS_TRY_STATUS(ars::download(surfels.bones, bones_));
    return surfels;
}

} // namespace ars
