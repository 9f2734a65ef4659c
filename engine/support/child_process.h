// A program run as a child process: a file in, bytes out, within limits of time and size.
#pragma once

#include <chrono>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "dem/support/stop_token.h"

namespace selenograph::engine {

// AddressSanitizer and ThreadSanitizer reserve terabytes of addresses, open files and look at other processes: what
// they are built into can't be confined.
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
  std::chrono::milliseconds time;  // by the clock
  std::size_t output_bytes;
};

// The child did not do its work. The text says how it ended, in words that follow "the child".
class ChildFailed : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// What `program` writes to its standard output, which begins with the number of bytes that follow (8 bytes, little-
// endian): these are the answer. `input`: an open file, the child's standard input. It gets no other file, and its
// error output goes nowhere. Throws ChildFailed, also where it can't be started, or Cancelled when `stop` says so.
// Whatever happens, the child has ended by then.
std::string run_child(const std::string& program, const std::vector<std::string>& arguments, int input,
                      const ChildLimits& limits, const StopToken& stop);

// The child's part. False when nobody reads.
bool write_to_parent(const std::string& answer);

}  // namespace selenograph::engine
