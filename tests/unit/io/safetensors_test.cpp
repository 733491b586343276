#include "engine/io/safetensors.h"

#include "tests/support/test_data.h"
#include "tests/unit/io/array_matching.h"

#include <cstring>
#include <numeric>

namespace ars {
namespace {

using test::bytesOf;
using test::expectError;
using test::expectIdentical;
using test::expectMatches;
using test::fixture;
using Bytes = std::vector<std::byte>;

/// A file with this header, its true length, and `dataBytes` bytes of data.
Bytes fileWithHeader(const std::string& header, std::size_t dataBytes) {
    const std::uint64_t length = header.size();
    const std::string text =
        std::string(reinterpret_cast<const char*>(&length), 8) + header + std::string(dataBytes, 1);
    const auto bytes = std::as_bytes(std::span(text));
    return {bytes.begin(), bytes.end()};
}

std::string tensor(const std::string& name, const std::string& type, const std::string& shape,
                   const std::string& range) {
    return '"' + name + "\":{\"dtype\":\"" + type + "\",\"shape\":" + shape + ",\"data_offsets\":" + range + "}";
}

/// Every type that the format has, with bytes that a wrong width or order would change.
SafetensorsFile everyType() {
    SafetensorsFile file;
    for (int type = 0; type < static_cast<int>(DType::C128); ++type) {
        Array array;
        array.dtype = static_cast<DType>(type);
        array.shape = {3, 1, 2};
        array.bytes.resize(6 * dtypeBytes(array.dtype));
        for (std::size_t i = 0; i < array.bytes.size(); ++i) {
            array.bytes[i] = array.dtype == DType::Bool ? std::byte(i % 2) : std::byte(i * 37 + 11);
        }
        file.tensors.emplace("layer." + std::string(dtypeName(array.dtype)), array);
    }
    file.tensors.emplace("scalar", Array::fromFloats({}, std::vector<float>{2.5f}));
    file.tensors.emplace("größe", Array::fromFloats({0, 4}, {}));
    file.metadata = {{"format", "ars"}, {"note", "quotes \" and \n lines"}};
    return file;
}

TEST(Safetensors, ReadsWhatTheReferencePackageWrote) {
    const auto expected = test::jsonOf(fixture("safetensors/expected.json"));
    for (const auto& [name, tensors] : expected.items()) {
        SCOPED_TRACE(name);
        const auto file = readSafetensors(fixture("safetensors/" + name));
        ASSERT_TRUE(file.ok()) << file.error().describe();
        EXPECT_EQ(file->tensors.size(), tensors.size());
        for (const auto& [key, value] : tensors.items()) {
            SCOPED_TRACE(key);
            ASSERT_TRUE(file->find(key).ok());
            expectMatches(**file->find(key), value);
        }
    }
    const auto metadata = readSafetensors(fixture("safetensors/types.safetensors"))->metadata;
    EXPECT_EQ(metadata, (std::map<std::string, std::string>{{"format", "pt"}, {"größe", "klein"}}));
}

TEST(Safetensors, WritesTheBytesOfTheReferencePackage) {
    // bfloat16.safetensors holds one tensor, so there is but one way to lay it out.
    const auto file = readSafetensors(fixture("safetensors/bfloat16.safetensors"));
    ASSERT_TRUE(file.ok());
    const nlohmann::json expected = {{"w", {{"dtype", "BF16"}, {"shape", {3}}, {"data_offsets", {0, 6}}}}};
    const Bytes ours = *encodeSafetensors(*file), theirs = bytesOf(fixture("safetensors/bfloat16.safetensors"));
    ASSERT_EQ(ours.size(), theirs.size());
    const auto header = [](const Bytes& bytes) {
        return nlohmann::json::parse(reinterpret_cast<const char*>(bytes.data()) + 8,
                                     reinterpret_cast<const char*>(bytes.data()) + bytes.size() - 6);
    };
    EXPECT_EQ(header(ours), expected);
    EXPECT_EQ(header(theirs), expected);
    EXPECT_TRUE(std::equal(ours.end() - 6, ours.end(), theirs.end() - 6));
}

TEST(Safetensors, EveryTypeComesBackToTheBit) {
    test::TemporaryFolder folder;
    const SafetensorsFile file = everyType();
    ASSERT_TRUE(writeSafetensors(folder / "a.safetensors", file).ok());
    const auto back = readSafetensors(folder / "a.safetensors");
    ASSERT_TRUE(back.ok()) << back.error().describe();
    EXPECT_EQ(back->metadata, file.metadata);
    EXPECT_EQ(back->tensors.size(), file.tensors.size());
    for (const auto& [name, array] : file.tensors) expectIdentical(**back->find(name), array);
    EXPECT_EQ(bytesOf(folder / "a.safetensors"), *encodeSafetensors(file));
    EXPECT_TRUE(parseSafetensors(*encodeSafetensors({}))->tensors.empty());
}

TEST(Safetensors, TensorsAreAligned) {
    test::TemporaryFolder folder;
    ASSERT_TRUE(writeSafetensors(folder / "a.safetensors", everyType()).ok());
    const auto index = listSafetensors(folder / "a.safetensors");
    ASSERT_TRUE(index.ok()) << index.error().describe();
    EXPECT_EQ(index->dataOffset % 8, 0u);
    EXPECT_EQ(index->entries.size(), everyType().tensors.size());
    for (const SafetensorsEntry& entry : index->entries) {
        EXPECT_EQ(entry.begin % dtypeBytes(entry.dtype), 0u) << entry.name;
    }
}

TEST(Safetensors, SmallFloatsAreListedButNotRead) {
    const auto path = fixture("safetensors/float8.safetensors");
    const auto index = listSafetensors(path);
    ASSERT_TRUE(index.ok()) << index.error().describe();
    ASSERT_EQ(index->entries.size(), 1u);
    EXPECT_EQ(index->entries[0].storedType, "F8_E4M3");
    EXPECT_FALSE(index->entries[0].problem.empty());
    const auto file = readSafetensors(path);
    ASSERT_FALSE(file.ok());
    expectError(file.error(), ErrorCode::Unsupported, "w: the element type \"F8_E4M3\"");
}

struct BadFile {
    const char* name;
    Bytes bytes;
    ErrorCode code;
    const char* words;
};

Bytes withLength(std::uint64_t length) {
    Bytes bytes = fileWithHeader("{}      ", 0);
    std::memcpy(bytes.data(), &length, 8);
    return bytes;
}

std::vector<BadFile> badHeaders() {
    const auto header = [](const std::string& text, std::size_t dataBytes = 8) {
        return fileWithHeader("{" + text + "}", dataBytes);
    };
    return {
        {"empty", {}, ErrorCode::BadFile, "expected 8 bytes of the header's length"},
        {"length of 2^63", withLength(1ull << 63), ErrorCode::BadFile, "a safetensors header of 9223372036854775808"},
        {"length one too long", withLength(9), ErrorCode::BadFile, "header of 9 bytes, the file ends after 8"},
        {"length too short", withLength(1), ErrorCode::BadFile, "no valid JSON"},
        {"length 0", withLength(0), ErrorCode::BadFile, "no valid JSON"},
        {"no JSON", fileWithHeader("PK-magic", 0), ErrorCode::BadFile, "byte 8: the header is no valid JSON"},
        {"two values", fileWithHeader("{}{}", 0), ErrorCode::BadFile, "no valid JSON"},
        {"list", fileWithHeader("[]", 0), ErrorCode::BadFile, "expected an object in the header, found a list"},
        {"number", fileWithHeader("17", 0), ErrorCode::BadFile, "expected an object in the header"},
        {"deep", fileWithHeader(std::string(1 << 20, '['), 0), ErrorCode::BadFile, "expected an object"},
        {"deep inside", header("\"a\":{\"shape\":" + std::string(1 << 20, '[')), ErrorCode::BadFile, "a: expected"},
        {"tensor is a number", header("\"a\":3"), ErrorCode::BadFile, "a: expected an object for each name"},
        {"metadata number", header("\"__metadata__\":{\"a\":3}"), ErrorCode::BadFile, "__metadata__: expected texts"},
        {"metadata twice", header("\"__metadata__\":{},\"__metadata__\":{}"), ErrorCode::BadFile, "named twice"},
        {"metadata key twice", header("\"__metadata__\":{\"a\":\"\",\"a\":\"\"}"), ErrorCode::BadFile, "given twice"},
        {"no offsets", header("\"a\":{\"dtype\":\"F32\",\"shape\":[2]}"), ErrorCode::BadFile, "found no data_offsets"},
        {"other key", header("\"a\":{\"strides\":[2]}"), ErrorCode::BadFile, "found the key \"strides\""},
        {"key twice", header("\"a\":{\"shape\":[2],\"shape\":[2]}"), ErrorCode::BadFile, "\"shape\" is given twice"},
        {"negative shape", header(tensor("a", "F32", "[-2]", "[0,8]")), ErrorCode::BadFile, "found -2"},
        {"real shape", header(tensor("a", "F32", "[2.0]", "[0,8]")), ErrorCode::BadFile, "found 2.0"},
        {"shape beyond 2^64", header(tensor("a", "F32", "[99999999999999999999]", "[0,8]")), ErrorCode::BadFile,
         "extents of 0 or more below 2^64"},
        {"three offsets", header(tensor("a", "F32", "[2]", "[0,4,8]")), ErrorCode::BadFile, "two byte offsets"},
        {"one offset", header(tensor("a", "F32", "[2]", "[0]")), ErrorCode::BadFile, "two byte offsets"},
        {"dtype number", header("\"a\":{\"dtype\":7}"), ErrorCode::BadFile, "found the number 7"},
        {"shape 2^63", header(tensor("a", "U8", "[9223372036854775808]", "[0,8]")), ErrorCode::LimitExceeded,
         "a: shape (9223372036854775808,)"},
        {"shape product", header(tensor("a", "U8", "[4294967296,4294967296]", "[0,8]")), ErrorCode::LimitExceeded,
         "does not fit in 63 bits"},
        {"shape and range differ", header(tensor("a", "F32", "[3]", "[0,8]")), ErrorCode::BadFile,
         "a: expected 12 bytes for F32 (3,), data_offsets give 8"},
        {"range backwards", header(tensor("a", "F32", "[2]", "[8,0]")), ErrorCode::BadFile, "end at 0 before they"},
        {"range beyond the file", header(tensor("a", "F32", "[4]", "[0,16]")), ErrorCode::BadFile,
         "expected 16 bytes of tensors behind the header, the file has 8"},
        {"uncovered bytes", header(tensor("a", "F32", "[1]", "[0,4]")), ErrorCode::BadFile,
         "expected 4 bytes of tensors behind the header, the file has 8"},
        {"overlap", header(tensor("a", "F32", "[1]", "[0,4]") + "," + tensor("b", "U8", "[6]", "[2,8]")),
         ErrorCode::BadFile, "b: expected its data at byte 4 behind the header, data_offsets say 2 (an overlap)"},
        {"gap", header(tensor("a", "U8", "[1]", "[0,1]") + "," + tensor("b", "F32", "[1]", "[4,8]")),
         ErrorCode::BadFile, "b: expected its data at byte 1 behind the header, data_offsets say 4 (a gap)"},
        {"name twice", header(tensor("a", "F32", "[1]", "[0,4]") + "," + tensor("a", "F32", "[1]", "[4,8]")),
         ErrorCode::BadFile, "a: is named twice"},
    };
}

TEST(Safetensors, BrokenFilesGetOneClearSentence) {
    for (const BadFile& bad : badHeaders()) {
        SCOPED_TRACE(bad.name);
        const auto file = parseSafetensors(bad.bytes);
        ASSERT_FALSE(file.ok());
        expectError(file.error(), bad.code, bad.words);
    }
}

TEST(Safetensors, HeadersBeyondTheFormatsLimitAreRefused) {
    // Spaces are valid JSON, so only the limit can refuse them.
    const Bytes bytes = fileWithHeader("{}" + std::string(100'000'000, ' '), 0);
    const auto file = parseSafetensors(bytes);
    ASSERT_FALSE(file.ok());
    expectError(file.error(), ErrorCode::LimitExceeded, "the header has 100000002 bytes, the limit is 100000000");
}

TEST(Safetensors, TruncatedAnywhereIsRefused) {
    const Bytes whole = *encodeSafetensors(everyType());
    for (std::size_t size = 0; size < whole.size(); ++size) {
        const auto file = parseSafetensors(std::span(whole).first(size));
        ASSERT_FALSE(file.ok()) << "cut to " << size;
        expectError(file.error(), ErrorCode::BadFile, "expected");
    }
}

TEST(Safetensors, LimitHoldsForAllTensors) {
    SafetensorsFile file;
    file.tensors.emplace("a", Array::fromFloats({64, 1024}, std::vector<float>(65536)));
    const Bytes bytes = *encodeSafetensors(file);
    ReadLimits limits;
    limits.maxBytes = 262143;
    const std::uint64_t growth = test::peakGrowth([&] {
        const auto refused = parseSafetensors(bytes, limits);
        ASSERT_FALSE(refused.ok());
        expectError(refused.error(), ErrorCode::LimitExceeded, "need 262144 bytes of memory, the limit is 262143");
    });
    EXPECT_LT(growth, 262144u);
    limits.maxBytes = 262144;
    EXPECT_TRUE(parseSafetensors(bytes, limits).ok());
}

TEST(Safetensors, WhatTheFormatHasNotIsNotWritten) {
    const auto refused = [](const std::string& name, Array array) {
        SafetensorsFile file;
        file.tensors.emplace(name, std::move(array));
        const auto bytes = encodeSafetensors(file);
        return bytes.ok() ? Error{} : bytes.error();
    };
    const Array sound = Array::fromFloats({1}, std::vector<float>{1.0f});
    Array wrong = sound;
    wrong.shape = {2};
    expectError(refused("t", Array::fromTexts({1}, {"a"})), ErrorCode::InvalidArgument, "t: expected a type that");
    expectError(refused("__metadata__", sound), ErrorCode::InvalidArgument, "other than \"__metadata__\"");
    expectError(refused("\xFF", sound), ErrorCode::InvalidArgument, "UTF-8");
    expectError(refused("w", wrong), ErrorCode::InvalidArgument, "w: float32 (2,) has 4 bytes, expected 8");
    SafetensorsFile file;
    file.metadata["a"] = "\xFF";
    expectError(encodeSafetensors(file).error(), ErrorCode::InvalidArgument, "__metadata__: expected UTF-8");
}

TEST(Safetensors, FindListsTheTensorsThatThereAre) {
    const auto file = readSafetensors(fixture("safetensors/bfloat16.safetensors"));
    ASSERT_TRUE(file.ok());
    expectError(file->find("weight").error(), ErrorCode::NotFound, "expected the tensor \"weight\", found w");
}

} // namespace
} // namespace ars
