#pragma once

#include "app/file_report.h"
#include "engine/core/limits.h"
#include "engine/core/progress.h"
#include "engine/io/file_recognition.h"

#include <glm/glm.hpp>

#include <filesystem>
#include <span>

namespace ars::app {

struct InspectOptions {
    bool fast = false; ///< headers only: nothing is decoded, so nothing is called sound
    ProgressFunction progress;
    ReadLimits limits = defaultReadLimits();
};

/// Looks into a file or folder of any kind; never fails itself, the report carries the error.
FileReport inspectPath(const std::filesystem::path& path, const InspectOptions& options);

/// One family of formats each; `report` has path, format and size already. They set kind and title, add facts, and call
/// fail() where the content is not sound.
void inspectNpy(FileReport& report, const InspectOptions& options);
void inspectNpz(FileReport& report, const InspectOptions& options);
void inspectSafetensors(FileReport& report, const InspectOptions& options);
void inspectExr(FileReport& report, const InspectOptions& options);
void inspectHdr(FileReport& report, const InspectOptions& options);
void inspectPng(FileReport& report, const InspectOptions& options);
void inspectJpeg(FileReport& report, const InspectOptions& options);
void inspectPly(FileReport& report, const InspectOptions& options);
void inspectObj(FileReport& report, const InspectOptions& options);
void inspectGltf(FileReport& report, const InspectOptions& options);
void inspectBvh(FileReport& report, const InspectOptions& options);
void inspectJson(FileReport& report, const InspectOptions& options);
void inspectText(FileReport& report, const InspectOptions& options);
/// A training run, a checkpoint or an avatar; false where the folder is none of them.
bool inspectAvatarFolder(FileReport& report, const InspectOptions& options);
void inspectCaptureFolder(FileReport& report, const InspectOptions& options);
/// The list of images that a capture lacks, which has no content of its own to be recognised by.
void inspectMissingImages(FileReport& report, const InspectOptions& options);

/// A JSON file; BadFile saying where it ends to be one.
Result<Json> readJsonFile(const std::filesystem::path& path, ReadLimits limits);

/// "extent": size of the bounding box along x, y, z in the file's unit.
void addExtent(FileReport& report, std::span<const glm::vec3> positions);

} // namespace ars::app
