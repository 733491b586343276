#include "engine/core/file.h"
#include "engine/scene/project.h"
#include "tests/support/test_data.h"
#include "tests/unit/scene/changed_document.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <fstream>
#include <thread>

namespace ars {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Json = nlohmann::ordered_json;

std::vector<fs::path> filesIn(const fs::path& folder) {
    std::vector<fs::path> files;
    std::error_code ignored;
    for (const auto& entry : fs::directory_iterator(folder, ignored)) files.push_back(entry.path());
    return files;
}

/// A document that says which edit it is.
Document edit(int number) {
    Document document = newDocument();
    document.timeline.timeS = number;
    return document;
}

/// Runs `work` in a process of its own that is killed as hard as can be, `life` after the first byte that it writes to
/// the descriptor it gets. Returns everything that it had written.
std::string killedAfter(std::chrono::milliseconds life, const std::function<void(int)>& work) {
    int ends[2];
    if (::pipe(ends) != 0) return {};
    const pid_t child = ::fork();
    if (child == 0) {
        ::close(ends[0]);
        work(ends[1]);
        ::_exit(0);
    }
    ::close(ends[1]);
    char buffer[4096];
    std::string said;
    ssize_t got = ::read(ends[0], buffer, sizeof(buffer));
    std::this_thread::sleep_for(life);
    ::kill(child, SIGKILL);
    for (; got > 0; got = ::read(ends[0], buffer, sizeof(buffer))) said.append(buffer, static_cast<std::size_t>(got));
    ::close(ends[0]);
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status));
    return said;
}

/// What a crashed program would have left: a file of a process that has ended.
fs::path leaveBehind(const fs::path& folder, const Document& document, const fs::path& project) {
    const std::vector<fs::path> before = filesIn(folder);
    killedAfter(0ms, [&](int pipe) {
        Autosave autosave(folder, 1h);
        autosave.update(document, 1, project);
        autosave.flush();
        if (::write(pipe, ".", 1) == 1) std::this_thread::sleep_for(1h);
    });
    for (const fs::path& file : filesIn(folder)) {
        if (std::find(before.begin(), before.end(), file) == before.end()) return file;
    }
    return {};
}

TEST(Autosave, WritesOneFileAndRemovesItAtTheEnd) {
    const test::TemporaryFolder folder;
    {
        Autosave autosave(folder / "state", 1h);
        EXPECT_TRUE(filesIn(folder / "state").empty()) << "nothing to save yet";
        for (int i = 1; i <= 3; ++i) {
            autosave.update(edit(i), static_cast<std::uint64_t>(i), "/data/a.ars");
            autosave.flush();
        }
        ASSERT_EQ(filesIn(folder / "state").size(), 1u);
        const Result<Document> saved = readProject(filesIn(folder / "state").front());
        ASSERT_TRUE(saved.ok()) << saved.error().describe();
        EXPECT_TRUE(*saved == edit(3));
        EXPECT_TRUE(findRecoveries(folder / "state").empty()) << "its program still runs";
        EXPECT_FALSE(autosave.takeError());
    }
    EXPECT_TRUE(filesIn(folder / "state").empty());
}

TEST(Autosave, ASeenVersionIsNotCopiedAgain) {
    const test::TemporaryFolder folder;
    Autosave autosave(folder.path(), 1h);
    autosave.update(edit(1), 5, {});
    autosave.update(edit(2), 5, {});
    autosave.flush();
    EXPECT_TRUE(*readProject(filesIn(folder.path()).front()) == edit(1));
}

TEST(Autosave, TheLastOfManyQuickEditsIsSaved) {
    const test::TemporaryFolder folder;
    Autosave autosave(folder.path(), 20ms);
    for (int i = 1; i <= 500; ++i) autosave.update(edit(i), static_cast<std::uint64_t>(i), {});
    for (int waited = 0; waited < 500; ++waited) {
        const std::vector<fs::path> files = filesIn(folder.path());
        if (!files.empty()) {
            const Result<Document> saved = readProject(files.front());
            if (saved && *saved == edit(500)) return;
        }
        std::this_thread::sleep_for(20ms);
    }
    FAIL() << "not saved within ten seconds";
}

TEST(Autosave, AFullOrMissingDiskIsToldOnceAndNothingElseHappens) {
    const test::TemporaryFolder folder;
    std::ofstream(folder / "file") << "x";
    Autosave autosave(folder / "file" / "state", 1ms);
    autosave.update(edit(1), 1, {});
    autosave.flush();
    const std::optional<Error> error = autosave.takeError();
    ASSERT_TRUE(error);
    EXPECT_NE(error->describe().find("autosave-"), std::string::npos) << error->describe();
    autosave.update(edit(2), 2, {});
    autosave.flush();
    EXPECT_FALSE(autosave.takeError()) << "the same failure again";
}

// Edits every millisecond; the pipe tells how far they had got when the process was killed in the middle of them.
TEST(Recovery, KillLosesAtMostTheInterval) {
    const test::TemporaryFolder folder;
    constexpr auto kInterval = 500ms;
    const std::string said = killedAfter(1600ms, [&](int pipe) {
        Autosave autosave(folder.path(), kInterval);
        for (int i = 1; i < 100000; ++i) {
            autosave.update(edit(i), static_cast<std::uint64_t>(i), "/data/project.ars");
            if (::write(pipe, ".", 1) != 1) break;
            std::this_thread::sleep_for(1ms);
        }
    });
    const int edits = static_cast<int>(said.size());
    ASSERT_GT(edits, 50);
    const std::vector<Recovery> found = findRecoveries(folder.path());
    ASSERT_EQ(found.size(), 1u);
    const int recovered = static_cast<int>(found[0].document.timeline.timeS);
    EXPECT_TRUE(found[0].document == edit(recovered));
    EXPECT_LE(recovered, edits);
    // An edit takes a millisecond or more, so the interval has at most so many; as many again for the time that writing
    // and a busy machine take.
    EXPECT_LE(edits - recovered, 2 * kInterval.count()) << "of " << edits;
    EXPECT_GT(recovered, 1) << "not only the first edit is saved";
    EXPECT_EQ(found[0].project, "/data/project.ars");
    EXPECT_LT(std::chrono::abs(std::chrono::system_clock::now() - found[0].saved), 1min);
    EXPECT_EQ(filesIn(folder.path()).size(), 1u) << "what was being written is tidied up";
    discardRecovery(found[0]);
    EXPECT_TRUE(findRecoveries(folder.path()).empty());
    EXPECT_TRUE(filesIn(folder.path()).empty());
}

TEST(Recovery, EveryFieldAndPathComesBackNewestFirst) {
    const test::TemporaryFolder folder;
    leaveBehind(folder.path(), edit(1), "");
    std::this_thread::sleep_for(5ms);
    leaveBehind(folder.path(), test::changedDocument(), folder / "caf\xe9.ars");
    const std::vector<Recovery> found = findRecoveries(folder.path());
    ASSERT_EQ(found.size(), 2u);
    EXPECT_TRUE(found[0].document == test::changedDocument());
    EXPECT_EQ(found[0].project, folder / "caf\xe9.ars");
    EXPECT_TRUE(found[1].document == edit(1));
    EXPECT_TRUE(found[1].project.empty());
    EXPECT_GT(found[0].saved, found[1].saved);
    EXPECT_EQ(findRecoveries(folder.path()).size(), 2u) << "looking takes nothing away";
}

TEST(Recovery, AnUntouchedNewDocumentIsNotOffered) {
    const test::TemporaryFolder folder;
    leaveBehind(folder.path(), newDocument(), "");
    EXPECT_TRUE(findRecoveries(folder.path()).empty());
    EXPECT_TRUE(filesIn(folder.path()).empty());
}

TEST(Recovery, WhatStandsInTheProjectIsNotOffered) {
    const test::TemporaryFolder folder;
    ASSERT_TRUE(saveProject(folder / "a.ars", edit(4)).ok());
    leaveBehind(folder / "state", edit(4), folder / "a.ars");
    EXPECT_TRUE(findRecoveries(folder / "state").empty());
    EXPECT_TRUE(filesIn(folder / "state").empty());
    leaveBehind(folder / "state", edit(5), folder / "a.ars");
    EXPECT_EQ(findRecoveries(folder / "state").size(), 1u);
}

// A process number is used again sooner or later; its start tells both apart.
TEST(Recovery, AnotherProcessOfTheSameNumberIsNotTheOneThatCrashed) {
    const test::TemporaryFolder folder;
    Autosave autosave(folder.path(), 1h);
    autosave.update(edit(1), 1, {});
    autosave.flush();
    const fs::path file = filesIn(folder.path()).front();
    const Json json = Json::parse(*readTextFile(file));
    ASSERT_EQ(json["recovery"]["process"], ::getpid());
    const auto offered = [&](const char* key, const Json& value) {
        Json changed = json;
        changed["recovery"][key] = value;
        std::ofstream(file) << changed.dump();
        return findRecoveries(folder.path()).size();
    };
    EXPECT_EQ(offered("saved_ms", 1), 0u) << "this process runs";
    EXPECT_EQ(offered("process_start", "12"), 1u);
    EXPECT_EQ(offered("boot", "another"), 1u);
    EXPECT_EQ(offered("process", 999'999'999), 1u);
}

TEST(Recovery, BrokenFilesAreMovedAside) {
    const test::TemporaryFolder folder;
    const fs::path sound = leaveBehind(folder.path(), edit(1), "");
    const std::string text = *readTextFile(sound);
    const auto broken = [&](const std::string& content) {
        const fs::path file = folder / "autosave-12-0000abcd.ars";
        std::ofstream(file, std::ios::binary) << content;
        EXPECT_EQ(findRecoveries(folder.path()).size(), 1u) << content.substr(0, 40);
        EXPECT_FALSE(fs::exists(file));
        EXPECT_TRUE(fs::exists(file.string() + ".broken"));
        fs::remove(file.string() + ".broken");
    };
    broken("");
    broken(text.substr(0, text.size() / 2));
    broken(documentToJson(edit(2)).dump());
    Json json = Json::parse(text);
    json["recovery"]["saved_ms"] = 1e18;
    broken(json.dump());
    json = Json::parse(text);
    json["recovery"]["saved_ms"] = std::numeric_limits<std::int64_t>::max();
    broken(json.dump());
    json = Json::parse(text);
    json["view"] = "none";
    broken(json.dump());
    std::ofstream(folder / "autosave-999999999-0000abcd.ars.tmp-999999999-0") << "half";
    std::ofstream(folder / "settings.json") << "{}";
    EXPECT_EQ(findRecoveries(folder.path()).size(), 1u);
    EXPECT_EQ(filesIn(folder.path()).size(), 2u) << "other files stay";
    EXPECT_TRUE(findRecoveries(folder / "none").empty());
}

} // namespace
} // namespace ars
