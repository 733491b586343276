#pragma once

#include "engine/capture/calibration.h"
#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/core/progress.h"
#include "engine/io/image.h"
#include "engine/rig/motion.h"

#include <compare>
#include <cstddef>
#include <filesystem>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// How the folder of a capture is laid out.
enum class CaptureKind { AvatarRex, THuman4, ActorsHq };
/// "avatarrex", "thuman4", "actorshq".
std::string_view captureKindName(CaptureKind kind);

/// Names of numbered pictures: folder / prefix + number with at least `digits` digits + extension.
struct PictureNames {
    std::filesystem::path folder; ///< empty: there are none
    std::string prefix;           ///< "Cam001_rgb" for ActorsHQ, else empty
    int digits = 8;
    std::string extension = ".jpg";

    std::filesystem::path of(int number) const;
};

/// Where the pictures and masks of one camera lie.
struct CameraFiles {
    PictureNames pictures;
    PictureNames masks; ///< without a folder where the pictures' own alpha is the mask
};

/// A camera and a frame, as indices into Capture::cameras and Capture::frames.
struct ViewId {
    int camera = 0;
    int frame = 0;
    bool operator==(const ViewId&) const = default;
    auto operator<=>(const ViewId&) const = default;
};

/// A multi-view recording of one person as its publishers hand it out (avatar reference 5). Only small files are read
/// when it is opened; pictures are found, not decoded.
struct Capture {
    CaptureKind kind = CaptureKind::AvatarRex;
    std::filesystem::path folder;
    std::string subject;                   ///< of the known ones ("avatarrex_zzr"), or the folder's name
    std::vector<CalibratedCamera> cameras; ///< in the order of the calibration file, which is the cameras' numbering
    std::vector<CameraFiles> files;        ///< one for each camera
    std::vector<int> frames;               ///< numbers in the pictures' names, increasing
    Motion motion;                         ///< one pose for each number up to the last frame: motion.frames[frames[i]]
    std::vector<float> betas;              ///< (10)
    std::set<ViewId> missing;              ///< listed as missing, or not there
    std::size_t listedMissing = 0;         ///< pictures that the capture itself lists as missing
    std::set<ViewId> unlisted;             ///< of the missing, those that it does not list, of cameras with pictures
    std::vector<std::string> notes;        ///< what was guessed or left out, one sentence each

    std::filesystem::path imagePath(ViewId view) const;
    std::filesystem::path maskPath(ViewId view) const; ///< empty where pictures carry no mask of their own
    bool has(ViewId view) const { return !missing.contains(view); }
    /// The pose of a frame (index into `frames`).
    const Pose& pose(int frame) const;
};

/// Opens a folder; its kind is told by its files. Every error is one sentence that names file, expected and found: no
/// calibration, no cameras, wrong keys, absurd intrinsics, a camera without any picture, fewer poses than frames, masks
/// that are missing. Sizes of pictures are looked at (headers of the first picture and mask of every camera).
Result<Capture> openCapture(const std::filesystem::path& folder, const ProgressFunction& progress = {},
                            const ReadLimits& limits = defaultReadLimits());

/// Cameras and frames of a use, indices into the capture, increasing.
struct CaptureSplit {
    std::string name; ///< "train", "held_out_cameras"
    std::vector<int> cameras;
    std::vector<int> frames;
};
/// The published settings of the known subjects (published_settings.h), else every camera and frame as "train". Texts
/// as the command line gives them override: cameras by name, or index from 0 where no camera has that name, with commas
/// and ranges whose ends count ("0-6,8", "22010708", "cam00-cam05"); frames by the number in their names, a:b:step from
/// a to b - 1 ("0:2000:4", "48:", "7"), with commas. InvalidArgument says which word is wrong and what there is; so
/// does a split without any picture.
Result<CaptureSplit> trainingSplit(const Capture& capture, const std::string& cameras = "",
                                   const std::string& frames = "");
/// "train", "all" (every camera and frame), and what is published for the subject: "held_out_cameras", "novel_poses",
/// "ag", "humanrf_cameras". InvalidArgument for another name lists those that there are.
Result<CaptureSplit> namedSplit(const Capture& capture, const std::string& name, const std::string& cameras = "",
                                const std::string& frames = "");
/// The names that namedSplit takes for this capture.
std::vector<std::string> splitNames(const Capture& capture);

/// One photograph, ready to compare with. Colour and mask are rounded to multiples of 1/65535 (8-bit files keep their
/// values), so that a view is the same whether it was just read or kept somewhere. Where `band` is 0 the mask is 0
/// or 1.
struct CapturedView {
    ViewId id;
    Camera camera; ///< undistorted, of the picture's (cropped, scaled) size
    Image color;   ///< 3, sRGB-encoded, [0, 1]
    Image mask;    ///< 1, alpha of the person, [0, 1]
    Image band;    ///< 1, 1 in the boundary band where nothing is compared (avatar reference 4), else 0
    Image unknown; ///< 1, 1 where the photograph says nothing as its lens saw no such place, else 0; they lie in the
                   ///< band and their mask is 0 for want of better. Empty: every pixel is known
};

/// How views are prepared.
struct ViewOptions {
    int scale = 1;           ///< pictures are made this much smaller by area averaging, 1 to 8
    int cropMargin = 16;     ///< pixels around the mask's bounding box, after scaling; negative: the whole picture
    int maskThreshold = 128; ///< alpha above it is the person, [0, 254]
    int bandPixels = 2; ///< half-width of the boundary band: (2 b + 1) square dilated minus eroded; plus soft alpha

    bool operator==(const ViewOptions&) const = default;
};

/// InvalidArgument for an option outside its range.
Status validateViewOptions(const ViewOptions& options);

/// Reads, undistorts, scales and crops one view, in this order (view_preparation.h). BadFile/NotFound name the file;
/// InvalidArgument for a mask whose size differs from the picture's, and for a view that is missing.
Result<CapturedView> readView(const Capture& capture, ViewId view, const ViewOptions& options = {},
                              const ReadLimits& limits = defaultReadLimits());

} // namespace ars
