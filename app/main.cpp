#include "app/command_line.h"

#include "app/command.h"
#include "app/interrupt.h"
#include "engine/core/standard_exception.h"

#include <algorithm>
#include <exception>
#include <string>
#include <vector>

namespace {

using namespace ars;

/// No exception should come this far; if one does, the user gets a sentence all the same.
int runGuarded(const std::vector<std::string>& arguments) {
    app::OutputOptions output;
    output.json = std::find(arguments.begin(), arguments.end(), "--json") != arguments.end();
    try {
        return app::runCommandLine(arguments);
    } catch (const std::exception& error) {
        return app::reportError(errorOfStandardException(error, ""), output);
    }
}

} // namespace

int main(int argc, char** argv) {
    app::installInterruptHandler();
    const int code = runGuarded({argv + (argc > 0 ? 1 : 0), argv + argc});
    if (code != app::kSuccess) app::endByInterrupt();
    return code;
}
