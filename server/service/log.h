// The log on stderr: synchronous for commands, asynchronous for the service.
#pragma once

#include <spdlog/fwd.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <future>
#include <memory>
#include <string>

namespace selenograph::server {

struct AccessRecord;

enum class LogFormat {
  text,  // 2026-11-20T12:00:00.000 info message
  json,  // JSON lines: {"time": .., "level": .., "message": ..}; a request has the members of deploy/operation/log.md
};

// Returns a time as 2026-11-20T12:00:00.000Z: such texts sort as times do.
std::string utc_text(std::chrono::system_clock::time_point time);

// Makes spdlog's default logger write to stderr, so that stdout stays for results.
void set_up_log(const std::string& level);

// While this object exists, spdlog's default logger is asynchronous: it passes records through a bounded queue to a
// thread that formats and writes them. A full queue (nobody reads stderr, or its disk is slow) drops and counts its
// oldest record; no logging thread ever waits.
class AsyncLog {
 public:
  static constexpr std::size_t kMaxLines = 2048;

  explicit AsyncLog(const std::string& level, int fd = 2, LogFormat format = LogFormat::text);
  ~AsyncLog();  // waits up to half a second for pending lines
  AsyncLog(const AsyncLog&) = delete;
  AsyncLog& operator=(const AsyncLog&) = delete;

  std::uint64_t dropped() const;

  // Logs a finished request: in text as one message, in JSON with a member for each of its data.
  void log_request(spdlog::level::level_enum level, const AccessRecord& request) const;

 private:
  class Writer;
  std::shared_ptr<Writer> writer_;  // shared with its thread, which may outlive this object
  std::future<void> finished_;
};

}  // namespace selenograph::server
