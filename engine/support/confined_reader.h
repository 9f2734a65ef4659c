// Reads an operator's files, which a foreign library decodes, in a child process: a damaged file may crash the library,
// or make it allocate gigabytes.
//
//   ConfinedReader::read(command, path)  ------>  the same executable, limited: main(), read_in_child(), parse(path)
//                                        <------  bytes through a pipe; the exit status says what they are
#pragma once

#include <cstddef>
#include <functional>
#include <mutex>
#include <string>

#include "dem/base/stop_token.h"

namespace selenograph::engine {

struct ReaderOptions {
  // Program whose main() calls read_in_child(); the server uses "/proc/self/exe". Empty: no file can be read.
  std::string program{};
  // Memory limit for reading one file, and for what is made of it. Measured: 1 GiB reads 2 million triangles as a .ply
  // and half a million as an OBJ, not a million of the latter.
  std::size_t max_bytes = std::size_t{1} << 30;
};

// Thread-safe: one file is read at a time, so that the memory for reading is used once.
class ConfinedReader {
 public:
  explicit ConfinedReader(ReaderOptions options) : options_(std::move(options)) {}

  // Returns what `command` makes of a file. Throws DataError naming the file if the child refuses it, crashes or
  // exceeds a limit; Cancelled once `stop` is requested; SystemFault if no child can be started. The child has ended on
  // return.
  std::string read(const char* command, const std::string& path, const StopToken& stop = {}) const;
  const ReaderOptions& options() const { return options_; }

 private:
  const ReaderOptions options_;
  mutable std::timed_mutex mutex_;
};

using ParseFile = std::function<std::string(const std::string& path, std::size_t max_bytes)>;
// Called by main() in the child: limits memory and processor time, and answers with the parsed file or the text of an
// exception. Under AddressSanitizer and ThreadSanitizer, which reserve terabytes of addresses, memory is not limited.
int read_in_child(int argc, char** argv, const ParseFile& parse);

}  // namespace selenograph::engine
