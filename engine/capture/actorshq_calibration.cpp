#include "engine/capture/actorshq_calibration.h"

#include "engine/core/file.h"
#include "engine/io/text_scanner.h"

#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

namespace ars {
namespace {

enum Column { Name, W, H, Rx, Ry, Rz, Tx, Ty, Tz, Fx, Fy, Px, Py, K1, K2, K3, ColumnCount };
constexpr int kRequiredColumns = K1;
constexpr std::array<std::string_view, ColumnCount> kColumnNames = {"name", "w",  "h",  "rx", "ry", "rz", "tx", "ty",
                                                                    "tz",   "fx", "fy", "px", "py", "k1", "k2", "k3"};
constexpr std::size_t kMaxCameras = 4096;
constexpr std::uint64_t kMaxFileBytes = 16ull << 20;
constexpr double kMaxSide = 32768; ///< pixels, as validateCamera has it

std::string_view trimmed(std::string_view text) {
    constexpr std::string_view kSpace = " \t\r\"";
    const std::size_t begin = text.find_first_not_of(kSpace);
    if (begin == std::string_view::npos) return {};
    return text.substr(begin, text.find_last_not_of(kSpace) - begin + 1);
}

std::vector<std::string_view> fieldsOf(std::string_view line) {
    std::vector<std::string_view> fields;
    while (true) {
        const std::size_t comma = line.find(',');
        fields.push_back(trimmed(line.substr(0, comma)));
        if (comma == std::string_view::npos) return fields;
        line.remove_prefix(comma + 1);
    }
}

/// Where each column stands in a line; -1: not in the file.
using ColumnOrder = std::array<int, ColumnCount>;

Result<ColumnOrder> columnOrder(std::string_view header) {
    const std::vector<std::string_view> fields = fieldsOf(header);
    ColumnOrder order;
    for (int column = 0; column < ColumnCount; ++column) {
        const auto found = std::find(fields.begin(), fields.end(), kColumnNames[static_cast<std::size_t>(column)]);
        order[static_cast<std::size_t>(column)] =
            found == fields.end() ? -1 : static_cast<int>(std::distance(fields.begin(), found));
        if (found == fields.end() && column < kRequiredColumns) {
            return makeError(ErrorCode::BadFile, "line 1",
                             fmt::format("the column {} is missing; expected {}",
                                         kColumnNames[static_cast<std::size_t>(column)],
                                         "name,w,h,rx,ry,rz,tx,ty,tz,fx,fy,px,py"));
        }
    }
    return order;
}

Result<CalibratedCamera> cameraOf(const ColumnOrder& order, const std::vector<std::string_view>& fields) {
    CalibratedCamera result;
    const auto field = [&](int column) -> std::string_view {
        const int index = order[static_cast<std::size_t>(column)];
        return index >= 0 && index < static_cast<int>(fields.size()) ? fields[static_cast<std::size_t>(index)]
                                                                     : std::string_view();
    };
    result.name = field(Name);
    if (const Status fit = checkCameraName(result.name); !fit) {
        return makeError(ErrorCode::BadFile, "", fit.error().message);
    }
    std::array<double, ColumnCount> values{};
    for (int column = W; column < ColumnCount; ++column) {
        if (order[static_cast<std::size_t>(column)] < 0) continue;
        const auto value = parseDouble(field(column));
        if (!value || !std::isfinite(*value)) {
            return makeError(ErrorCode::BadFile, "",
                             fmt::format("{} is no number: {}", kColumnNames[static_cast<std::size_t>(column)],
                                         quotedFound(field(column))));
        }
        values[static_cast<std::size_t>(column)] = *value;
    }
    for (const double side : {values[W], values[H]}) {
        if (side >= 1.0 && side <= kMaxSide && side == std::floor(side)) continue;
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("w and h must be positive whole numbers up to {:.0f}, found {:g} x {:g}", kMaxSide,
                                     values[W], values[H]));
    }
    if (!(values[Fx] > 0.0) || !(values[Fy] > 0.0)) {
        return makeError(
            ErrorCode::BadFile, "",
            fmt::format("focal lengths must be positive, found fx {:g} and fy {:g}", values[Fx], values[Fy]));
    }
    Camera& camera = result.camera;
    camera.width = static_cast<int>(values[W]);
    camera.height = static_cast<int>(values[H]);
    camera.fx = values[Fx] * values[W];
    camera.fy = values[Fy] * values[H];
    camera.cx = values[Px] * values[W];
    camera.cy = values[Py] * values[H];
    const glm::dvec3 axisAngle(values[Rx], values[Ry], values[Rz]);
    const double angle = glm::length(axisAngle);
    if (!(angle < 1e3)) {
        return makeError(ErrorCode::BadFile, "", fmt::format("an angle of {:g} radians is no rotation", angle));
    }
    const glm::dmat3 cameraToWorld =
        angle > 0.0 ? glm::mat3_cast(glm::angleAxis(angle, axisAngle / angle)) : glm::dmat3(1.0);
    camera.rotation = glm::transpose(cameraToWorld);
    camera.translation = -(camera.rotation * glm::dvec3(values[Tx], values[Ty], values[Tz]));
    if (order[K1] >= 0 || order[K2] >= 0 || order[K3] >= 0) {
        result.distortion = {values[K1], values[K2], 0.0, 0.0, values[K3]};
    }
    return result;
}

} // namespace

Result<std::vector<CalibratedCamera>> parseActorsHqCalibration(std::string_view text) {
    constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
    if (text.substr(0, kByteOrderMark.size()) == kByteOrderMark) text.remove_prefix(kByteOrderMark.size());
    std::vector<CalibratedCamera> cameras;
    std::set<std::string> names;
    ColumnOrder order{};
    for (std::size_t line = 1; !text.empty(); ++line) {
        const std::size_t end = text.find('\n');
        const std::string_view row = trimmed(text.substr(0, end));
        text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
        if (line == 1) {
            ARS_TRY(order, columnOrder(row));
            continue;
        }
        if (row.empty()) continue;
        auto camera = cameraOf(order, fieldsOf(row));
        if (!camera) return atPlace(std::move(camera).error(), fmt::format("line {}", line));
        if (!names.insert(camera->name).second) {
            return makeError(ErrorCode::BadFile, fmt::format("line {}", line),
                             fmt::format("the camera {} comes twice", quotedFound(camera->name)));
        }
        if (cameras.size() == kMaxCameras) {
            return makeError(ErrorCode::LimitExceeded, fmt::format("line {}", line),
                             fmt::format("more than {} cameras", kMaxCameras));
        }
        cameras.push_back(*std::move(camera));
    }
    if (cameras.empty()) return makeError(ErrorCode::BadFile, "", "the calibration has no camera");
    return cameras;
}

Result<std::vector<CalibratedCamera>> readActorsHqCalibration(const std::filesystem::path& path,
                                                              const ReadLimits& limits) {
    ReadLimits own = limits;
    own.maxFileBytes = std::min(own.maxFileBytes, kMaxFileBytes);
    ARS_TRY(const std::string text, readTextFile(path, own));
    auto cameras = parseActorsHqCalibration(text);
    if (!cameras) return atPlace(std::move(cameras).error(), path.string());
    return cameras;
}

} // namespace ars
