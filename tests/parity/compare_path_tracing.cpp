// Compares the renderer with the path-traced validation capture and writes the table and side-by-side pictures.
// usage: compare_path_tracing CAPTURE_FOLDER OUT_FOLDER [SURFELS [METHOD,... [NAME=VALUE...]]]
#include "tests/parity/path_tracing.h"

#include "engine/core/file.h"

#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <string>

int main(int argc, char** argv) {
    if (argc < 3) {
        std::fprintf(stderr,
                     "usage: compare_path_tracing CAPTURE_FOLDER OUT_FOLDER [SURFELS [METHOD,... [NAME=VALUE...]]]\n");
        return 2;
    }
    ars::test::ComparisonOptions options;
    options.methods = {"body", "reference", "mesh_rays", "rasterised", "baked"};
    if (argc > 3) options.surfels = std::atoi(argv[3]);
    if (argc > 4) {
        options.methods.clear();
        std::stringstream words(argv[4]);
        for (std::string word; std::getline(words, word, ',');) options.methods.push_back(word);
    }
    for (int i = 5; i < argc; ++i) {
        const std::string setting = argv[i];
        const std::size_t equal = setting.find('=');
        options.rest.emplace_back(setting.substr(0, equal),
                                  equal == std::string::npos ? "" : setting.substr(equal + 1));
    }
    const std::filesystem::path out = argv[2];
    std::filesystem::create_directories(out);
    const auto comparison = ars::test::compareWithPathTracing(argv[1], options, out);
    if (!comparison) {
        std::fprintf(stderr, "error: %s\n", comparison.error().describe().c_str());
        return 1;
    }
    const std::string table = ars::test::comparisonTable(*comparison);
    std::printf("%zu surfels, %zu pixels\n\n%s", comparison->surfels, comparison->pixels, table.c_str());
    const auto written = ars::writeFileAtomic(out / "table.md", table);
    if (!written) std::fprintf(stderr, "error: %s\n", written.error().describe().c_str());
    return written.ok() ? 0 : 1;
}
