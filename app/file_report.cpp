#include "app/file_report.h"

#include "app/text.h"

#include <fmt/format.h>

#include <algorithm>

namespace ars::app {
namespace {

std::string label(const Fact& fact) {
    std::string text = fact.key;
    std::replace(text.begin(), text.end(), '_', ' ');
    return text;
}

std::string verdict(const FileReport& report) {
    if (report.error && report.error->code == ErrorCode::Unsupported) {
        return fmt::format("not read: {}", report.error->describe());
    }
    if (report.error) return fmt::format("NOT SOUND: {}", report.error->describe());
    return report.checked ? "sound" : "not checked (--fast)";
}

} // namespace

void FileReport::add(std::string key, std::string text, Json value) {
    facts.push_back({std::move(key), std::move(text), std::move(value)});
}

void FileReport::add(std::string key, std::string text) {
    Json value = text;
    add(std::move(key), std::move(text), std::move(value));
}

void FileReport::fail(const Error& reason) {
    error = reason;
    // Readers name the whole path; the head line has it already.
    if (error->place == path) {
        error->place.clear();
    } else if (error->place.starts_with(path + ": ")) {
        error->place.erase(0, path.size() + 2);
    }
}

std::string formatReport(const FileReport& report) {
    std::string text = fmt::format("{}: {}\n", printable(report.path), printable(report.title));
    std::size_t width = 0;
    for (const Fact& fact : report.facts) {
        if (!fact.text.empty()) width = std::max(width, fact.key.size());
    }
    for (const Fact& fact : report.facts) {
        if (fact.text.empty()) continue;
        text += fmt::format("  {:<{}}  {}\n", label(fact), width, printable(fact.text));
    }
    for (const std::string& warning : report.warnings) text += fmt::format("  note: {}\n", printable(warning));
    return text + fmt::format("  {}\n", printable(verdict(report)));
}

Json reportJson(const FileReport& report) {
    Json json{{"path", report.path}, {"kind", report.kind}, {"format", report.format}, {"title", report.title}};
    if (report.undecided()) {
        json["sound"] = nullptr;
    } else {
        json["sound"] = report.ok();
    }
    for (const Fact& fact : report.facts) json[fact.key] = fact.value;
    json["warnings"] = report.warnings;
    if (report.error) json["error"] = errorJson(atPlace(*report.error, report.path));
    return json;
}

} // namespace ars::app
