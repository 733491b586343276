#include "tests/support/test_data.h"

namespace ars::test {

// The one file that knows an absolute path, so that the compiler cache serves every clone with all the others.
std::filesystem::path sourceFolder() { return ARS_SOURCE_DIR; }

} // namespace ars::test
