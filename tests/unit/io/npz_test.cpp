#include "engine/io/npz.h"

#include "tests/support/test_data.h"
#include "tests/unit/io/array_matching.h"

#include <zlib.h>

#include <cstring>
#include <functional>
#include <numeric>

namespace ars {
namespace {

using test::bytesOf;
using test::expectError;
using test::expectIdentical;
using test::expectMatches;
using test::fixture;
using Bytes = std::vector<std::byte>;

Bytes bytesOfText(std::string_view text) {
    const auto bytes = std::as_bytes(std::span(text));
    return {bytes.begin(), bytes.end()};
}

Bytes npyWithHeader(const std::string& dictionary, std::size_t dataBytes) {
    std::string text("\x93NUMPY\x01\x00", 8);
    text += static_cast<char>(dictionary.size() & 0xFF);
    text += static_cast<char>(dictionary.size() >> 8);
    return bytesOfText(text + dictionary + std::string(dataBytes, '\x01'));
}

template <typename T>
void patch(Bytes& bytes, std::size_t offset, T value) {
    ASSERT_LE(offset + sizeof value, bytes.size());
    std::memcpy(bytes.data() + offset, &value, sizeof value);
}

/// The place of the n-th record that starts with "PK" and these two bytes.
std::size_t findRecord(const Bytes& bytes, char third, char fourth, int n = 0) {
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    std::size_t at = text.find(std::string{'P', 'K', third, fourth});
    for (; n > 0; --n) at = text.find(std::string{'P', 'K', third, fourth}, at + 1);
    return at;
}
std::size_t directoryRecord(const Bytes& bytes, int n = 0) { return findRecord(bytes, '\x01', '\x02', n); }
std::size_t endRecord(const Bytes& bytes) { return findRecord(bytes, '\x05', '\x06'); }

/// One array of every type, with values that a wrong width or order would change.
NamedArrays everyType() {
    NamedArrays arrays;
    for (int type = 0; type < static_cast<int>(DType::Text); ++type) {
        Array array;
        array.dtype = static_cast<DType>(type);
        if (array.dtype == DType::BF16) continue; // numpy has not this type
        array.shape = {2, 3, 2};
        array.bytes.resize(12 * dtypeBytes(array.dtype));
        for (std::size_t i = 0; i < array.bytes.size(); ++i) {
            array.bytes[i] = array.dtype == DType::Bool ? std::byte(i % 2) : std::byte(i * 37 + 11);
        }
        arrays.emplace_back(std::string(dtypeName(array.dtype)), array);
    }
    arrays.emplace_back("texts", Array::fromTexts({2, 2}, {"pelvis", "", "Hüfte", "膝 🦴"}));
    arrays.emplace_back("scalar", Array::fromDoubles({}, std::vector<double>{2.5}));
    arrays.emplace_back("none", Array::fromFloats({0, 3}, {}));
    arrays.emplace_back("no texts", Array::fromTexts({0}, {}));
    return arrays;
}

Array ramp(std::size_t count) {
    std::vector<float> values(count);
    std::iota(values.begin(), values.end(), 0.0f);
    return Array::fromFloats({count}, values);
}

TEST(Npy, ReadsWhatNumpyWrote) {
    const auto expected = test::jsonOf(fixture("npy/expected.json"));
    int files = 0;
    for (const auto& [name, value] : expected.items()) {
        if (!name.ends_with(".npy")) continue;
        SCOPED_TRACE(name);
        const auto array = readNpy(fixture("npy/" + name));
        ASSERT_TRUE(array.ok()) << array.error().describe();
        expectMatches(*array, value);
        ++files;
    }
    EXPECT_EQ(files, 14 * 2 + 10); // every type in both orders, and the special ones
}

TEST(Npy, FortranOrderAndBigEndianBecomeRowMajorNative) {
    // numpy: np.arange(24).reshape(2, 3, 4), the first two values replaced by the extremes of int32.
    const auto array = readNpy(fixture("npy/i4_fortran_big.npy"));
    ASSERT_TRUE(array.ok()) << array.error().describe();
    EXPECT_EQ(array->describe(), "int32 (2, 3, 4)");
    const auto values = array->as<std::int32_t>();
    EXPECT_EQ(values[0], -2147483647 - 1);
    EXPECT_EQ(values[1], 2147483647);
    for (std::int32_t i = 2; i < 24; ++i) EXPECT_EQ(values[i], i);
}

TEST(Npy, ObjectsAreRefusedWithTheWayToConvert) {
    for (const char* name : {"npy/object.npy", "npy/body.pkl"}) {
        const auto array = readNpy(fixture(name));
        ASSERT_FALSE(array.ok());
        expectError(array.error(), ErrorCode::Unsupported, "numpy.load(FILE, allow_pickle=True)");
        expectError(array.error(), ErrorCode::Unsupported, name);
    }
}

TEST(Npy, OtherTypesAreNamed) {
    const std::pair<const char*, const char*> cases[] = {{"npy/structured.npy", "structured array"},
                                                         {"npy/date.npy", "date or time"},
                                                         {"npy/long_double.npy", "long double"},
                                                         {"npy/void.npy", "|V3"}};
    for (const auto& [name, words] : cases) {
        const auto array = readNpy(fixture(name));
        ASSERT_FALSE(array.ok()) << name;
        expectError(array.error(), ErrorCode::Unsupported, words);
    }
}

TEST(Npy, HeaderMayHaveAnyKeyOrderAndSpacing) {
    for (const char* text : {"{'shape':(2,),'descr':'<i2','fortran_order':False}",
                             "{ \"fortran_order\" : False , \"shape\" : ( 2L , ) , \"descr\" : \"<i2\" , } \n",
                             "{'descr': '=i2', 'fortran_order': True, 'shape': (2, 1), }",
                             "{'descr': 'i2', 'fortran_order': False, 'shape': (1, 2), }"}) {
        const auto array = parseNpy(npyWithHeader(text, 4));
        ASSERT_TRUE(array.ok()) << text << ": " << array.error().describe();
        EXPECT_EQ(array->as<std::int16_t>()[1], 0x0101);
    }
}

struct BadNpy {
    const char* name;
    Bytes bytes;
    ErrorCode code;
    const char* words;
};

std::vector<BadNpy> badNpyFiles() {
    const auto header = [](const std::string& descr, const std::string& shape, std::size_t data) {
        return npyWithHeader("{'descr': '" + descr + "', 'fortran_order': False, 'shape': " + shape + ", }", data);
    };
    std::string manyOnes = "(";
    for (int i = 0; i < 65; ++i) manyOnes += "1, ";
    manyOnes += ")";
    Bytes version = header("<f4", "(1,)", 4);
    version[6] = std::byte{9};
    Bytes longHeader = header("<f4", "(1,)", 4);
    longHeader[8] = longHeader[9] = std::byte{0xFF};
    Bytes hugeHeader = bytesOfText(std::string("\x93NUMPY\x02\x00\xFF\xFF\xFF\xFF{}", 14));
    return {
        {"empty", {}, ErrorCode::BadFile, "expected a .npy file, found an empty file"},
        {"magic", bytesOfText("\x93NUMPX------"), ErrorCode::BadFile, "expected a .npy file, found something else"},
        {"zip", bytesOfText("PK\x03\x04----"), ErrorCode::BadFile, "found a zip file"},
        {"version", version, ErrorCode::Unsupported, "expected .npy version 1.0, 2.0 or 3.0, found 9.0"},
        {"header beyond the file", longHeader, ErrorCode::BadFile, "expected 65535 bytes of the .npy header"},
        {"header of 4 GB", hugeHeader, ErrorCode::LimitExceeded, "4294967295 bytes, the limit is 65536"},
        {"negative shape", header("<f4", "(-3, 2)", 24), ErrorCode::BadFile, "an extent of 0 or more"},
        {"2^63", header("<f4", "(9223372036854775808,)", 4), ErrorCode::LimitExceeded, "does not fit in 63 bits"},
        {"2^62 bytes", header("|u1", "(4611686018427387904,)", 4), ErrorCode::BadFile,
         "expected 4611686018427387904 bytes of data"},
        {"beyond 2^64", header("<f4", "(99999999999999999999,)", 4), ErrorCode::BadFile, "an extent below 2^64"},
        {"product overflows", header("<f4", "(4294967296, 4294967296)", 4), ErrorCode::LimitExceeded, "63 bits"},
        {"product overflows behind 0", header("<f4", "(0, 4294967296, 4294967296)", 0), ErrorCode::LimitExceeded,
         "63 bits"},
        {"2^62 empty texts", header("<U0", "(4611686018427387904,)", 0), ErrorCode::LimitExceeded, "the limit is"},
        {"shape too large", header("<f4", "(7,)", 24), ErrorCode::BadFile,
         "expected 28 bytes of data for \"<f4\" (7,)"},
        {"shape too small", header("<f4", "(5,)", 24), ErrorCode::BadFile, "expected 20 bytes of data"},
        {"no tuple", header("<f4", "(6)", 24), ErrorCode::BadFile, "in a shape of one extent"},
        {"65 dimensions", header("|u1", manyOnes, 1), ErrorCode::BadFile, "at most 64 extents"},
        {"float shape", header("<f4", "(6.0,)", 24), ErrorCode::BadFile, "\",\" or \")\""},
        {"type", header("<q4", "(6,)", 24), ErrorCode::BadFile, "expected an element type"},
        {"type width", header("<f3", "(8,)", 24), ErrorCode::BadFile, "expected an element type"},
        {"type of 10^20 bytes", header("<U100000000000000000000", "(8,)", 24), ErrorCode::BadFile, "element type"},
        {"character beyond unicode", header("<U1", "(6,)", 24), ErrorCode::BadFile, "element 0: expected a unicode"},
        {"missing key", npyWithHeader("{'descr': '<f4', 'shape': (1,)}", 4), ErrorCode::BadFile, "key fortran_order"},
        {"repeated key", npyWithHeader("{'descr': '<f4', 'descr': '<f4', 'shape': (1,)}", 4), ErrorCode::BadFile,
         "once each"},
        {"unknown key", npyWithHeader("{'descr': '<f4', 'x': 1}", 4), ErrorCode::BadFile, "once each"},
        {"code", npyWithHeader("{'descr': __import__('os'), }", 4), ErrorCode::BadFile, "a type string"},
        {"behind the brace", npyWithHeader("{'descr': '<f4', 'fortran_order': False, 'shape': (1,)} + {}", 4),
         ErrorCode::BadFile, "nothing but spaces"},
    };
}

TEST(Npy, BrokenFilesGetOneClearSentence) {
    for (const BadNpy& bad : badNpyFiles()) {
        SCOPED_TRACE(bad.name);
        const auto array = parseNpy(bad.bytes);
        ASSERT_FALSE(array.ok());
        expectError(array.error(), bad.code, bad.words);
    }
}

TEST(Npy, TruncatedAnywhereIsRefused) {
    for (const char* name : {"npy/f4_c.npy", "npy/unicode.npy", "npy/version2.npy"}) {
        const Bytes whole = bytesOf(fixture(name));
        for (std::size_t size = 0; size < whole.size(); ++size) {
            const auto array = parseNpy(std::span(whole).first(size));
            ASSERT_FALSE(array.ok()) << name << " cut to " << size;
            expectError(array.error(), ErrorCode::BadFile, "expected");
        }
    }
}

TEST(Npy, LimitCountsWhatDecodingTakes) {
    const Bytes file = *encodeNpy(ramp(1000));
    ReadLimits limits;
    limits.maxBytes = 4000;
    EXPECT_TRUE(parseNpy(file, limits).ok());
    limits.maxBytes = 3999;
    const auto refused = parseNpy(file, limits);
    ASSERT_FALSE(refused.ok());
    expectError(refused.error(), ErrorCode::LimitExceeded, "needs 4000 bytes of memory, the limit is 3999");
    // 100,000 texts of one character are 400 kB in the file, but a string object each in memory.
    const Bytes texts = *encodeNpy(Array::fromTexts({100000}, std::vector<std::string>(100000, "a")));
    limits.maxBytes = 100000 * (sizeof(std::string) + 4);
    EXPECT_FALSE(parseNpy(texts, limits).ok());
}

TEST(Npy, MissingFilesAndFoldersAreNamed) {
    const auto missing = readNpy("/nowhere/a.npy");
    ASSERT_FALSE(missing.ok());
    expectError(missing.error(), ErrorCode::NotFound, "/nowhere/a.npy: cannot open the file");
    const auto folder = readNpy(fixture("npy"));
    ASSERT_FALSE(folder.ok());
    expectError(folder.error(), ErrorCode::Io, "is a folder");
}

TEST(Npy, InconsistentArraysAreNotWritten) {
    Array array = ramp(4);
    array.shape = {5};
    const auto file = encodeNpy(array);
    ASSERT_FALSE(file.ok());
    expectError(file.error(), ErrorCode::InvalidArgument, "float32 (5,) has 16 bytes, expected 20");
    const auto text = encodeNpy(Array::fromTexts({1}, {"\xFF"}));
    ASSERT_FALSE(text.ok());
    expectError(text.error(), ErrorCode::InvalidArgument, "expected UTF-8");
}

TEST(Npy, BrainFloatsAreWidened) {
    Array array;
    array.dtype = DType::BF16;
    array.shape = {2};
    array.bytes = {std::byte{0x80}, std::byte{0x3F}, std::byte{0x20}, std::byte{0xC0}}; // 1.0 and -2.5
    const auto back = parseNpy(*encodeNpy(array));
    ASSERT_TRUE(back.ok());
    ASSERT_EQ(back->describe(), "float32 (2,)");
    EXPECT_EQ(back->as<float>()[0], 1.0f);
    EXPECT_EQ(back->as<float>()[1], -2.5f);
}

TEST(Npz, ReadsWhatNumpyWrote) {
    const auto expected = test::jsonOf(fixture("npy/expected.json"));
    int files = 0;
    for (const auto& [name, keys] : expected.items()) {
        if (!name.ends_with(".npz")) continue;
        SCOPED_TRACE(name);
        const auto file = readNpz(fixture("npy/" + name));
        ASSERT_TRUE(file.ok()) << file.error().describe();
        EXPECT_EQ(file->arrays.size(), keys.size());
        for (const auto& [key, value] : keys.items()) {
            ASSERT_TRUE(file->find(key).ok());
            expectMatches(**file->find(key), value);
        }
        ++files;
    }
    EXPECT_EQ(files, 4); // stored, deflated, 64-bit records, without arrays
}

TEST(Npz, ReadsArchivesOfOtherPrograms) {
    const auto streamed = readNpz(fixture("npy/streamed.npz"));
    ASSERT_TRUE(streamed.ok()) << streamed.error().describe();
    const Array plain = *readNpy(fixture("npy/f4_c.npy"));
    expectIdentical(**streamed->find("f4_c"), plain);

    const auto folders = readNpz(fixture("npy/folders.npz"));
    ASSERT_TRUE(folders.ok()) << folders.error().describe();
    EXPECT_EQ(folders->arrays.size(), 2u);
    expectIdentical(**folders->find("body/left/knee"), plain);
    expectIdentical(**folders->find("Hüfte"), plain);
}

TEST(Npz, UnreadableMembersDoNotSpoilTheOthers) {
    const auto objects = readNpz(fixture("npy/with_objects.npz"));
    ASSERT_TRUE(objects.ok()) << objects.error().describe();
    EXPECT_EQ((*objects->find("betas"))->describe(), "float32 (10,)");
    ASSERT_TRUE(objects->has("part2num"));
    expectError(objects->find("part2num").error(), ErrorCode::Unsupported,
                "part2num.npy: is an array of Python objects");

    const auto methods = readNpz(fixture("npy/methods.npz"));
    ASSERT_TRUE(methods.ok()) << methods.error().describe();
    EXPECT_TRUE(methods->find("plain").ok());
    expectError(methods->find("bzip2").error(), ErrorCode::Unsupported, "zip method 12");
    expectError(methods->find("lzma").error(), ErrorCode::Unsupported, "zip method 14");

    const auto encrypted = readNpz(fixture("npy/encrypted.npz"));
    ASSERT_TRUE(encrypted.ok()) << encrypted.error().describe();
    expectError(encrypted->find("f4_c").error(), ErrorCode::Unsupported, "is encrypted");
}

TEST(Npz, FindListsTheKeysThatThereAre) {
    const auto file = readNpz(fixture("npy/stored.npz"));
    ASSERT_TRUE(file.ok());
    EXPECT_FALSE(file->has("pose"));
    expectError(file->find("pose").error(), ErrorCode::NotFound,
                "expected the array \"pose\", found names, poses, tree");
}

TEST(Npz, ListReadsHeadersOnly) {
    const auto entries = listNpz(fixture("npy/with_objects.npz"));
    ASSERT_TRUE(entries.ok()) << entries.error().describe();
    ASSERT_EQ(entries->size(), 2u);
    EXPECT_EQ((*entries)[0].key, "betas");
    EXPECT_EQ((*entries)[0].dtype, DType::F32);
    EXPECT_EQ((*entries)[0].shape, std::vector<std::size_t>{10});
    EXPECT_EQ((*entries)[0].storedBytes, 128u + 40u);
    EXPECT_TRUE((*entries)[0].problem.empty());
    EXPECT_NE((*entries)[1].problem.find("Python objects"), std::string::npos);
}

TEST(Npz, EveryTypeComesBackToTheBit) {
    const NamedArrays arrays = everyType();
    for (const NpzOptions options :
         {NpzOptions{true, false}, NpzOptions{false, false}, NpzOptions{true, true}, NpzOptions{false, true}}) {
        SCOPED_TRACE(options.compress);
        const auto bytes = encodeNpz(arrays, options);
        ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
        const auto file = parseNpz(*bytes);
        ASSERT_TRUE(file.ok()) << file.error().describe();
        EXPECT_EQ(file->arrays.size(), arrays.size());
        for (const auto& [key, array] : arrays) expectIdentical(**file->find(key), array);
    }
}

TEST(Npz, TheSameArraysGiveTheSameBytes) {
    test::TemporaryFolder folder;
    ASSERT_TRUE(writeNpz(folder / "a.npz", everyType()).ok());
    ASSERT_TRUE(writeNpz(folder / "b.npz", everyType()).ok());
    EXPECT_EQ(bytesOf(folder / "a.npz"), bytesOf(folder / "b.npz"));
    EXPECT_EQ(bytesOf(folder / "a.npz"), *encodeNpz(everyType()));
}

TEST(Npz, SixtyFourBitRecordsAreWrittenOnlyWhereNeeded) {
    const NamedArrays arrays = {{"a", ramp(3)}};
    EXPECT_EQ(findRecord(*encodeNpz(arrays, {false, false}), '\x06', '\x06'), std::string::npos);
    EXPECT_NE(findRecord(*encodeNpz(arrays, {false, true}), '\x06', '\x06'), std::string::npos);
}

TEST(Npz, RepeatedKeysAreNotWritten) {
    const auto file = encodeNpz({{"a", ramp(1)}, {"a", ramp(2)}});
    ASSERT_FALSE(file.ok());
    expectError(file.error(), ErrorCode::InvalidArgument, "a: expected distinct");
}

TEST(Npz, TruncatedAtEverySixteenthIsRefused) {
    for (const NpzOptions options : {NpzOptions{true, false}, NpzOptions{false, true}}) {
        const Bytes whole = *encodeNpz(everyType(), options);
        for (std::size_t part = 0; part < 16; ++part) {
            const auto file = parseNpz(std::span(whole).first(whole.size() * part / 16));
            ASSERT_FALSE(file.ok()) << part;
            expectError(file.error(), ErrorCode::BadFile, "expected");
        }
    }
}

struct BadNpz {
    const char* name;
    bool compress;
    std::function<void(Bytes&)> damage;
    ErrorCode code;
    const char* words;
};

/// Damage done to a sound file of the arrays "first" and "second", 300 floats each.
std::vector<BadNpz> badNpzFiles() {
    const auto size32 = [](std::size_t field, std::uint32_t value) {
        return [=](Bytes& b) { patch(b, directoryRecord(b) + field, value); };
    };
    const auto end = [](std::size_t field, auto value) {
        return [=](Bytes& b) { patch(b, endRecord(b) + field, value); };
    };
    return {
        {"magic", true, [](Bytes& b) { b[0] = std::byte{'Q'}; }, ErrorCode::BadFile, "expected a .npz file"},
        {"one array", true, [](Bytes& b) { b = *encodeNpy(ramp(3)); }, ErrorCode::BadFile, "found a single .npy array"},
        {"pickle", true, [](Bytes& b) { b = bytesOf(fixture("npy/body.pkl")); }, ErrorCode::Unsupported,
         "a Python pickle"},
        {"HDF5", true, [](Bytes& b) { b = bytesOfText("\x89HDF\r\n\x1a\n"); }, ErrorCode::BadFile,
         "found an HDF5 file"},
        {"other zip", true, [](Bytes& b) { b = bytesOf(fixture("npy/documents.npz")); }, ErrorCode::BadFile,
         "a zip of 1 members, expected at least one .npy"},
        {"bytes behind the end", true, [](Bytes& b) { b.resize(b.size() + 5); }, ErrorCode::BadFile, "end record"},
        {"checksum, stored", false, [](Bytes& b) { b[400] ^= std::byte{1}; }, ErrorCode::BadFile,
         "first.npy: is damaged: expected checksum"},
        {"checksum, deflated", true, [](Bytes& b) { patch(b, directoryRecord(b) + 16, 0x12345678u); },
         ErrorCode::BadFile, "is damaged: expected checksum 12345678"},
        {"deflate code", true, [](Bytes& b) { b[39] = std::byte{0xFF}; }, ErrorCode::BadFile, "the deflated data"},
        {"less than declared", true, size32(24, 1329), ErrorCode::BadFile, "expected 1200 bytes of data"},
        {"declared 4 GB, stored", false, size32(24, 0xFFFFFFFEu), ErrorCode::BadFile,
         "a stored member has 1328 bytes, but declares 4294967294"},
        {"declared 4 GB, deflated", true, size32(24, 0xFFFFFFFEu), ErrorCode::BadFile, "cannot hold the 4294967294"},
        {"64-bit size without its field", true, size32(24, 0xFFFFFFFFu), ErrorCode::BadFile, "expected a zip64 field"},
        {"packed beyond the file", true, size32(20, 0x7FFFFFFFu), ErrorCode::BadFile, "expected 2147483647 bytes"},
        {"member behind the file", true, size32(42, 0x7FFFFFFFu), ErrorCode::BadFile, "before the zip's directory"},
        {"no member there", true, size32(42, 5), ErrorCode::BadFile, "expected a zip member"},
        {"directory behind the file", true, end(16, 0x7FFFFFFFu), ErrorCode::BadFile, "does not lie before its end"},
        {"directory too long", true, end(12, 0x7FFFFFFFu), ErrorCode::BadFile, "does not lie before its end"},
        {"too many members", true, end(10, std::uint16_t{60000}), ErrorCode::BadFile, "cannot name 60000 members"},
        {"too few members", true, end(10, std::uint16_t{1}), ErrorCode::BadFile, "follow the 1 members"},
        {"several volumes", true, end(4, std::uint16_t{1}), ErrorCode::Unsupported, "several volumes"},
        {"zip64 without locator", true, end(10, std::uint16_t{0xFFFF}), ErrorCode::BadFile, "zip64 locator"},
        {"local name differs", true, [](Bytes& b) { b[30] = std::byte{'g'}; }, ErrorCode::BadFile, "contradicts"},
        {"overlap", true,
         [](Bytes& b) {
             // The second entry becomes a copy of the first under another spelling of the place: same data twice.
             const std::size_t first = directoryRecord(b), second = directoryRecord(b, 1);
             patch(b, second + 20, 0u);
             patch(b, second + 24, 0u);
             std::uint32_t packed = 0;
             std::memcpy(&packed, &b[first + 20], 4);
             patch(b, first + 20, packed + 40);
         },
         ErrorCode::BadFile, "overlap: a zip bomb"},
    };
}

TEST(Npz, BrokenFilesGetOneClearSentence) {
    for (const BadNpz& bad : badNpzFiles()) {
        SCOPED_TRACE(bad.name);
        Bytes bytes = *encodeNpz({{"first", ramp(300)}, {"second", ramp(300)}}, {bad.compress, false});
        ASSERT_TRUE(parseNpz(bytes).ok());
        bad.damage(bytes);
        const auto file = parseNpz(bytes);
        ASSERT_FALSE(file.ok());
        expectError(file.error(), bad.code, bad.words);
    }
}

TEST(Npz, TwoMembersOfOneNameAreRefused) {
    Bytes bytes = *encodeNpz({{"aa", ramp(3)}, {"ab", ramp(3)}}, {false, false});
    for (std::size_t i = 0; i + 6 <= bytes.size(); ++i) {
        if (std::memcmp(&bytes[i], "ab.npy", 6) == 0) bytes[i + 1] = std::byte{'a'};
    }
    const auto file = parseNpz(bytes);
    ASSERT_FALSE(file.ok());
    expectError(file.error(), ErrorCode::BadFile, "aa.npy: the zip holds two members of this name");
}

TEST(Npz, NoSingleDamagedByteCrashesOrChangesNumbersUnseen) {
    const NamedArrays arrays = {{"first", ramp(20)}, {"texts", Array::fromTexts({2}, {"ab", "c"})}};
    for (const bool compress : {false, true}) {
        const Bytes whole = *encodeNpz(arrays, {compress, false});
        for (std::size_t i = 0; i < whole.size(); ++i) {
            Bytes bytes = whole;
            bytes[i] ^= std::byte{0x21};
            const auto file = parseNpz(bytes);
            if (!file.ok()) continue;
            for (const auto& [key, array] : arrays) {
                if (const auto found = file->find(key); found.ok()) expectIdentical(**found, array);
            }
        }
    }
}

/// A zip with one deflated member of `plainMebibytes` MiB behind `header`, all zeros, made without unpacking it.
Bytes zeroBomb(const std::string& header, std::uint32_t plainMebibytes, std::uint32_t declaredBytes) {
    const auto deflated = [](std::string_view text, int flush) {
        z_stream zlib{};
        deflateInit2(&zlib, 9, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY);
        std::string out(deflateBound(&zlib, text.size()) + 64, '\0');
        zlib.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
        zlib.avail_in = static_cast<uInt>(text.size());
        zlib.next_out = reinterpret_cast<Bytef*>(out.data());
        zlib.avail_out = static_cast<uInt>(out.size());
        deflate(&zlib, flush);
        out.resize(zlib.total_out);
        deflateEnd(&zlib);
        return out;
    };
    // A full flush ends at a byte and forgets the past, so the piece may be repeated.
    const std::string piece = deflated(std::string(1 << 20, '\0'), Z_FULL_FLUSH);
    std::string packed = deflated(header, Z_FULL_FLUSH);
    for (std::uint32_t i = 0; i < plainMebibytes; ++i) packed += piece;
    packed += deflated("", Z_FINISH);
    Bytes bytes = *encodeNpz({{"a", ramp(1)}}, {true, false});
    const std::size_t directory = directoryRecord(bytes), end = endRecord(bytes);
    const Bytes content = bytesOfText(packed);
    const std::size_t dataStart = 30 + 5;
    const auto growth = static_cast<std::uint32_t>(content.size() - (directory - dataStart));
    patch(bytes, directory + 10, std::uint16_t{8});
    patch(bytes, directory + 20, static_cast<std::uint32_t>(content.size()));
    patch(bytes, directory + 24, declaredBytes);
    patch(bytes, end + 16, static_cast<std::uint32_t>(directory) + growth);
    bytes.erase(bytes.begin() + dataStart, bytes.begin() + directory);
    bytes.insert(bytes.begin() + dataStart, content.begin(), content.end());
    return bytes;
}

std::string floatHeader(std::size_t count) {
    const Bytes npy =
        npyWithHeader("{'descr': '<f4', 'fortran_order': False, 'shape': (" + std::to_string(count) + ",)}", 0);
    return {reinterpret_cast<const char*>(npy.data()), npy.size()};
}

TEST(Npz, BombOfOneGigabyteIsRefusedWithoutUnpackingIt) {
    const std::string header = floatHeader(1u << 28);
    const Bytes bomb = zeroBomb(header, 1024, (1u << 30) + static_cast<std::uint32_t>(header.size()));
    EXPECT_LT(bomb.size(), 2u << 20);
    ReadLimits limits;
    limits.maxBytes = 8 << 20;
    const std::uint64_t growth = test::peakGrowth([&] {
        const auto file = parseNpz(bomb, limits);
        ASSERT_FALSE(file.ok());
        expectError(file.error(), ErrorCode::LimitExceeded, "needs 1073741824 bytes of memory, the limit is 8388608");
    });
    EXPECT_LT(growth, limits.maxBytes + (4 << 20));
}

TEST(Npz, MemberThatHoldsMoreThanItDeclaresIsRefused) {
    const std::string header = floatHeader(1000);
    const Bytes bomb = zeroBomb(header, 1024, 4000 + static_cast<std::uint32_t>(header.size()));
    const std::uint64_t growth = test::peakGrowth([&] {
        const auto file = parseNpz(bomb);
        ASSERT_FALSE(file.ok());
        expectError(file.error(), ErrorCode::BadFile, "unpacks to more than the");
    });
    EXPECT_LT(growth, 4u << 20);
}

TEST(Npz, LimitHoldsForAllMembersTogether) {
    const Bytes bytes = *encodeNpz({{"a", ramp(1000)}, {"b", ramp(1000)}});
    ReadLimits limits;
    limits.maxBytes = 7999;
    const auto file = parseNpz(bytes, limits);
    ASSERT_FALSE(file.ok());
    expectError(file.error(), ErrorCode::LimitExceeded, "the file's arrays together needs 8000 bytes");
    limits.maxBytes = 8000;
    EXPECT_TRUE(parseNpz(bytes, limits).ok());
}

TEST(Npz, FailedWriteLeavesTheOldFile) {
    test::TemporaryFolder folder;
    ASSERT_TRUE(writeNpz(folder / "a.npz", {{"a", ramp(3)}}).ok());
    Array broken = ramp(3);
    broken.shape = {4};
    const Status status = writeNpz(folder / "a.npz", {{"a", ramp(9)}, {"b", broken}});
    ASSERT_FALSE(status.ok());
    expectError(status.error(), ErrorCode::InvalidArgument, "a.npz: b: float32 (4,) has 12 bytes");
    EXPECT_EQ((*readNpz(folder / "a.npz")->find("a"))->count(), 3u);
}

double sumOf(const NpzFile& file, const char* key) {
    const auto values = (*file.find(key))->toDouble();
    return std::accumulate(values->begin(), values->end(), 0.0);
}

// The sums below were printed by numpy: file[key].astype(float).sum().
TEST(Npz, ReadsTheOpenBody) {
    ARS_TEST_DATA_FILE(path, "open_body.npz");
    const auto file = readNpz(path);
    ASSERT_TRUE(file.ok()) << file.error().describe();
    EXPECT_TRUE(file->unreadable.empty());
    EXPECT_EQ((*file->find("v_template"))->describe(), "float32 (13380, 3)");
    EXPECT_EQ((*file->find("posedirs"))->describe(), "float32 (13380, 3, 486)");
    EXPECT_EQ((*file->find("kintree_table"))->describe(), "int64 (2, 55)");
    EXPECT_EQ((*file->find("joint_names"))->texts.at(1), "left_hip");
    EXPECT_EQ((*file->find("shape_names"))->texts.at(9), "uniform scale +2 %");
    EXPECT_EQ(sumOf(*file, "f"), 536960909.0);
    EXPECT_NEAR(sumOf(*file, "v_template"), 5613.2403789036, 1e-6);
    EXPECT_NEAR(sumOf(*file, "shapedirs"), 363.15617654902564, 1e-6);
    const auto entries = listNpz(path);
    ASSERT_TRUE(entries.ok());
    EXPECT_EQ(entries->size(), file->arrays.size());
    for (const NpzEntry& entry : *entries) EXPECT_EQ(entry.shape, (*file->find(entry.key))->shape) << entry.key;
}

TEST(Npz, ReadsTheCapture) {
    ARS_TEST_DATA_FILE(poses, "capture/casual/smpl_params.npz");
    const auto file = readNpz(poses);
    ASSERT_TRUE(file.ok()) << file.error().describe();
    EXPECT_EQ((*file->find("left_hand_pose"))->describe(), "float32 (26, 45)");
    EXPECT_NEAR(sumOf(*file, "left_hand_pose"), -103.06867036835982, 1e-9);
    ARS_TEST_DATA_FILE(path, "capture/casual/template.npz");
    const auto body = readNpz(path);
    ASSERT_TRUE(body.ok()) << body.error().describe();
    EXPECT_EQ(sumOf(*body, "f"), 4869463681.0);
    EXPECT_EQ(sumOf(*body, "body_vertex"), 50396567.0);
    EXPECT_EQ((*body->find("material_names"))->texts,
              (std::vector<std::string>{"skin", "shirt", "trousers", "shoes", "hair", "eyes"}));
}

TEST(Npz, ReadsSmplxMotions) {
    ARS_TEST_DATA_FILE(path, "motion/smplx/apose_to_handsFront_smplx.npz");
    const auto file = readNpz(path);
    ASSERT_TRUE(file.ok()) << file.error().describe();
    EXPECT_NEAR(sumOf(*file, "poses"), 38.075119397151866, 1e-12);
    EXPECT_EQ((*file->find("pose_foot"))->describe(), "float64 (34, 0)");
    ARS_TEST_DATA_FILE(posesPath, "motion/smplx/example_smplx_poses.npy");
    const auto poses = readNpy(posesPath);
    ASSERT_TRUE(poses.ok()) << poses.error().describe();
    EXPECT_EQ(poses->describe(), "float32 (8, 165)");
    const auto values = *poses->toDouble();
    EXPECT_NEAR(std::accumulate(values.begin(), values.end(), 0.0), 2.6115531273389934, 1e-12);
}

TEST(Array, IntegersThatDoNotFitAreNamed) {
    const auto real = Array::fromDoubles({3}, std::vector<double>{1.0, -2.0, 2.5}).toInt64();
    ASSERT_FALSE(real.ok());
    expectError(real.error(), ErrorCode::InvalidArgument, "element 2: expected a 64-bit integer, found 2.5");
    EXPECT_FALSE(Array::fromDoubles({1}, std::vector<double>{9223372036854775808.0}).toInt64().ok());
    EXPECT_FALSE(Array::fromDoubles({1}, std::vector<double>{std::nan("")}).toInt64().ok());
    EXPECT_EQ(Array::fromDoubles({1}, std::vector<double>{-9223372036854775808.0}).toInt64()->at(0), INT64_MIN);
    Array unsignedArray = Array::fromInts({1}, std::vector<std::int64_t>{-1});
    unsignedArray.dtype = DType::U64;
    EXPECT_FALSE(unsignedArray.toInt64().ok());
    expectError(Array::fromTexts({1}, {"a"}).toFloat().error(), ErrorCode::InvalidArgument, "found text (1,)");
}

TEST(Array, ShapesAreComparedAndPrinted) {
    const Array array = Array::fromFloats({2, 3}, std::vector<float>(6));
    const std::size_t good[] = {kAnySize, 3}, bad[] = {2, kAnySize, 3};
    EXPECT_TRUE(requireShape(array, "poses", good).ok());
    expectError(requireShape(array, "poses", bad).error(), ErrorCode::InvalidArgument,
                "poses: expected shape (2, *, 3), found (2, 3)");
    EXPECT_EQ(formatShape(std::vector<std::size_t>{}), "()");
    EXPECT_EQ(formatShape(std::vector<std::size_t>{7}), "(7,)");
}

} // namespace
} // namespace ars
