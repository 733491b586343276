#include "app/command_line.h"

#include "app/command.h"
#include "app/interrupt.h"

#include <algorithm>
#include <exception>
#include <new>
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
    } catch (const std::bad_alloc&) {
        return app::reportError(makeError(ErrorCode::OutOfMemory, "", "not enough memory"), output);
    } catch (const std::exception& error) {
        return app::reportError(makeError(ErrorCode::Internal, "", error.what()), output);
    }
}

} // namespace

int main(int argc, char** argv) {
    app::installInterruptHandler();
    const int code = runGuarded({argv + (argc > 0 ? 1 : 0), argv + argc});
    if (code != app::kSuccess) app::endByInterrupt();
    return code;
}
