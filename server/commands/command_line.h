// The command line: from the arguments to the command that they name.
#pragma once

namespace selenograph::server {

// Returns the exit status of main(). Prints errors to standard error.
int run_command_line(int argc, char** argv);

}  // namespace selenograph::server
