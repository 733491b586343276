#include "engine/capture/published_settings.h"

#include "engine/io/text_scanner.h"

#include <system_error>

namespace ars {
namespace {

/// Seven of sixteen and eight others: 7 and 13 are kept for testing.
constexpr std::string_view kAvatarRexTraining = "0-6,8-12,14,15";
constexpr std::string_view kAvatarRexHeldOut = "7,13";
constexpr std::string_view kTHuman4Training = "0-6,8-23";
constexpr std::string_view kActors46 = "4-7,20-23,36-39,52-55,76-79,92-95,108-111,125,126,130,131,134,135,138,139,142,"
                                       "143,146,147,150,151,154,155,158,159";
constexpr std::string_view kActors47 = "4-7,20-23,36-39,52-55,76-79,92-95,108-111,125-127,130,131,134,135,138,139,142,"
                                       "143,146,147,150,151,154,155,158,159";
/// HumanRF's test cameras, and those of them that the 47 above leave out.
constexpr std::string_view kHumanRfTest = "0,13,24,30,43,57,63,64,70,84,97,103,114,126";
constexpr std::string_view kHumanRfUnseen = "0,13,24,30,43,57,63,64,70,84,97,103,114";

PublishedSubject avatarRex(std::string_view name, std::string_view alias, std::string_view note = "") {
    PublishedSubject subject{name, CaptureKind::AvatarRex, alias, 16, {}, note};
    subject.splits = {{"train", kAvatarRexTraining, ""}, {"held_out_cameras", kAvatarRexHeldOut, ""}};
    if (note.empty()) subject.splits.push_back({"ag", "1", "0:500"});
    return subject;
}

PublishedSubject actorsHq(std::string_view name, std::string_view alias, std::string_view frames,
                          std::string_view note = "") {
    PublishedSubject subject{name, CaptureKind::ActorsHq, alias, 160, {}, note};
    subject.splits = {{"train", kActors47, frames},
                      {"held_out_cameras", kHumanRfUnseen, frames},
                      {"humanrf_cameras", kHumanRfTest, frames}};
    return subject;
}

std::vector<PublishedSubject> makeSubjects() {
    std::vector<PublishedSubject> subjects = {
        avatarRex("avatarrex_zzr", "zzr"),
        avatarRex("avatarrex_zxc", "zxc",
                  "no setting of avatarrex_zxc was published; it has the cameras of its siblings"),
        avatarRex("avatarrex_lbn1", "lbn1"),
        avatarRex("avatarrex_lbn2", "lbn2"),
        {"subject00",
         CaptureKind::THuman4,
         "subject00",
         24,
         {{"train", kTHuman4Training, "0:2000"},
          {"held_out_cameras", "7", "0:2000"},
          {"novel_poses", "18", "2000:2500"},
          {"ag", "18", "2000:2500"}},
         ""},
        {"subject01",
         CaptureKind::THuman4,
         "subject01",
         24,
         {{"train", kTHuman4Training, "0:2500"}, {"held_out_cameras", "7", "0:2500"}, {"novel_poses", "", "2500:"}},
         ""},
        {"subject02",
         CaptureKind::THuman4,
         "subject02",
         24,
         {{"train", "", "385:2500"}, {"novel_poses", "", "2500:"}},
         ""},
        actorsHq("actor01", "Actor01", "48:2177"),
        actorsHq("actor02", "Actor02", "60:2157"),
        actorsHq("actor04", "Actor04", "77:1378"),
        actorsHq("actor05", "Actor05", "100:1086"),
        actorsHq("actor06", "Actor06", kFrameList),
        actorsHq("actor07", "Actor07", "205:2139"),
        actorsHq("actor08", "Actor08", "63:2374"),
    };
    for (PublishedSubject& subject : subjects) {
        if (subject.name != "actor01") continue;
        subject.splits = {{"train", kActors46, "48:2177"},
                          {"held_out_cameras", "127", "48:2177"},
                          {"humanrf_cameras", kHumanRfTest, "48:2177"},
                          {"ag", "126", "48:548"}};
    }
    return subjects;
}

} // namespace

std::span<const PublishedSubject> publishedSubjects() {
    static const std::vector<PublishedSubject> subjects = makeSubjects();
    return subjects;
}

const PublishedSubject* publishedSubject(std::string_view name) {
    for (const PublishedSubject& subject : publishedSubjects()) {
        if (subject.name == name) return &subject;
    }
    return nullptr;
}

const PublishedSubject* findPublishedSubject(CaptureKind kind, const std::filesystem::path& folder,
                                             std::size_t cameraCount) {
    std::error_code failure;
    const std::filesystem::path whole = std::filesystem::absolute(folder, failure).lexically_normal();
    for (const PublishedSubject& subject : publishedSubjects()) {
        if (subject.kind != kind || static_cast<std::size_t>(subject.cameraCount) != cameraCount) continue;
        for (const std::filesystem::path& part : whole) {
            const std::string name = part.string();
            if (equalIgnoringCase(name, subject.alias) || equalIgnoringCase(name, subject.name)) return &subject;
        }
    }
    return nullptr;
}

} // namespace ars
