// A log that nobody has to wait for.
#pragma once

#include <spdlog/common.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

namespace selenograph::server {

// spdlog's default logger hands its lines to a thread that writes them to stderr, while this lives. A line that finds
// kMostBytes waiting (nobody reads stderr, or its disk is slow) is dropped and counted. Written with write(2), not with
// stdio, whose lock a writer that can't go on would keep through exit().
//
// (spdlog's own asynchronous logger joins its thread at exit, and waits for the reader there.)
enum class LogFormat {
  text,  // 2026-11-20T12:00:00.000 info what is to say
  json,  // JSON lines: {"time": .., "level": .., "message": ..}, or with the members of log_members()
};

class AsyncLog {
 public:
  static constexpr std::size_t kMostBytes = std::size_t{1} << 20;

  explicit AsyncLog(const std::string& level, int fd = 2, LogFormat format = LogFormat::text);
  ~AsyncLog();  // waits half a second for what is not written yet

  std::uint64_t dropped() const;

  // A line with these members instead of a message: `members` is JSON text without the braces.
  static void log_members(spdlog::level::level_enum level, std::string_view members);

 private:
  struct Queue;
  class Sink;
  const std::shared_ptr<Queue> queue_;  // the thread's, too: it may be stuck in write(2) until the process ends
};

}  // namespace selenograph::server
