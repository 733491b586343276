#include "engine/scene/run_folder.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace ars {
namespace {

constexpr std::size_t kPieceBytes = 1u << 20;
constexpr std::size_t kMaxLineBytes = 1u << 20; // a row has a few hundred bytes; longer is no row of ours

struct Descriptor {
    int value = -1;
    ~Descriptor() {
        if (value >= 0) ::close(value);
    }
};

bool readAt(int descriptor, std::uint64_t offset, std::string& bytes) {
    std::size_t done = 0;
    while (done < bytes.size()) {
        const ssize_t got =
            ::pread(descriptor, bytes.data() + done, bytes.size() - done, static_cast<off_t>(offset + done));
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) break;
        done += static_cast<std::size_t>(got);
    }
    const bool complete = done == bytes.size();
    bytes.resize(done);
    return complete;
}

} // namespace

void MetricsFollower::startAgain() {
    offset_ = 0;
    lastLine_.clear();
    rows_.clear();
    broken_ = 0;
}

void MetricsFollower::takeLine(std::string_view line) {
    const auto json = nlohmann::json::parse(line, nullptr, false);
    auto row = json.is_discarded() ? Result<MetricsRow>(makeError(ErrorCode::BadFile, "", "no JSON"))
                                   : metricsRowFromJson(json);
    if (!row) {
        ++broken_;
        return;
    }
    const auto superseded =
        std::lower_bound(rows_.begin(), rows_.end(), row->step,
                         [](const MetricsRow& known, std::int64_t step) { return known.step < step; });
    rows_.erase(superseded, rows_.end());
    rows_.push_back(std::move(*row));
}

Result<bool> MetricsFollower::poll() {
    const std::filesystem::path path = folder_ / kRunMetricsFile;
    const Descriptor file{::open(path.c_str(), O_RDONLY | O_CLOEXEC)};
    struct stat info{};
    if (file.value < 0 || ::fstat(file.value, &info) != 0) {
        if (errno != ENOENT) {
            return makeError(ErrorCode::Io, path.string(), fmt::format("cannot be read: {}", std::strerror(errno)));
        }
        const bool had = !rows_.empty();
        startAgain(); // no row was written yet, or the file went with its run
        return had;
    }
    bool changed = false;
    std::string before(lastLine_.size(), '\0');
    if (offset_ > 0 && (!readAt(file.value, offset_ - before.size(), before) || before != lastLine_)) {
        startAgain();
        changed = true;
    }
    std::string piece;
    for (;;) {
        const std::size_t kept = piece.size();
        std::string more(kPieceBytes, '\0');
        readAt(file.value, offset_ + kept, more);
        if (more.empty()) break;
        piece += more;
        std::size_t begin = 0;
        for (std::size_t end = piece.find('\n'); end != std::string::npos; end = piece.find('\n', begin)) {
            takeLine(std::string_view(piece).substr(begin, end - begin));
            lastLine_ = piece.substr(begin, end + 1 - begin);
            begin = end + 1;
            changed = true;
        }
        offset_ += begin;
        piece.erase(0, begin);
        if (piece.size() > kMaxLineBytes) {
            return makeError(ErrorCode::LimitExceeded, path.string(),
                             fmt::format("a line has more than {} bytes", kMaxLineBytes));
        }
    }
    return changed;
}

} // namespace ars
