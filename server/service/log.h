// The log on stderr: synchronous for commands, asynchronous for the service.
#pragma once

#include <spdlog/fwd.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

namespace spdlog::details {
class thread_pool;
}

namespace selenograph::server {

enum class LogFormat {
  text,  // 2026-11-20T12:00:00.000 info what is to say
  json,  // JSON lines: {"time": .., "level": .., "message": ..}, or with the members of log_members()
};

// spdlog's default logger writes to stderr, so that stdout stays for results.
void set_up_log(const std::string& level);

// While this object exists, spdlog's default logger is asynchronous: a separate thread writes the lines to stderr. When
// kMostLines are waiting (nobody reads stderr, or its disk is slow), each new line displaces the oldest, which is
// counted.
class AsyncLog {
 public:
  static constexpr std::size_t kMostLines = 2048;

  explicit AsyncLog(const std::string& level, int fd = 2, LogFormat format = LogFormat::text);
  ~AsyncLog();  // waits up to half a second for pending lines

  std::uint64_t dropped() const;

  // A line with these members instead of a message: `members` is JSON text without the braces.
  static void log_members(spdlog::level::level_enum level, std::string_view members);

 private:
  class Sink;
  const std::shared_ptr<Sink> sink_;
  std::shared_ptr<spdlog::details::thread_pool> thread_;  // a single thread
};

}  // namespace selenograph::server
