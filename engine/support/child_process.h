// Runs a program as a child process: a file in, bytes out, within limits of time and size.
#pragma once

#include <chrono>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "dem/base/stop_token.h"

namespace selenograph::engine {

// AddressSanitizer and ThreadSanitizer reserve terabytes of address space, open files and inspect other processes:
// programs built with them cannot be confined.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif
#else
inline constexpr bool kSanitized = false;
#endif

struct ChildLimits {
  std::chrono::milliseconds time;  // wall-clock time
  std::size_t output_bytes;
};

// Failure of the child. The text tells how it ended, in words that follow "the child".
class ChildFailed : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Runs `program` and returns its standard output after a header of 8 bytes, the answer's length (little-endian).
// `input`: an open file, the child's standard input. The child inherits no other file, and its error output is
// discarded. Throws ChildFailed, also if it cannot be started, or Cancelled once `stop` is requested. The child has
// always ended on return.
std::string run_child(const std::string& program, const std::vector<std::string>& arguments, int input,
                      const ChildLimits& limits, const StopToken& stop);

// Writes the child's answer with its header. Returns false if the parent has closed the pipe.
bool write_to_parent(const std::string& answer);

}  // namespace selenograph::engine
