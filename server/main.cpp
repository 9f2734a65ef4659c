// The executable: `selenograph serve | ask | batch | ingest | sample | info | verify`.
#include "server/commands/command_line.h"

int main(int argc, char** argv) { return selenograph::server::run_command_line(argc, argv); }
