#include "server/service/async_log.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <spdlog/formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <iterator>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string_view>
#include <thread>
#include <utility>

#include "server/commands/start.h"

namespace selenograph::server {
namespace {

constexpr auto kLastWait = std::chrono::milliseconds(500);
constexpr const char* kMembers = "members";  // stands for a line's place in the source: its text is JSON

std::string quoted(std::string_view text) {
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

class JsonLine : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& line) override {
    const std::string_view text(message.payload.data(), message.payload.size());
    const auto level = spdlog::level::to_string_view(message.level);
    const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(message.time.time_since_epoch()).count();
    fmt::format_to(std::back_inserter(line), "{{\"time\":\"{:%Y-%m-%dT%H:%M:%S}.{:03}Z\",\"level\":\"{}\",{}{}}}\n",
                   fmt::gmtime(std::chrono::system_clock::to_time_t(message.time)), ms % 1000,
                   std::string_view(level.data(), level.size()),
                   message.source.funcname == kMembers ? "" : "\"message\":",
                   message.source.funcname == kMembers ? std::string(text) : quoted(text));
  }
  std::unique_ptr<spdlog::formatter> clone() const override { return std::make_unique<JsonLine>(); }
};

void write_all(int fd, std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(fd, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return;  // stderr is closed: there is nobody to tell
    text.remove_prefix(static_cast<std::size_t>(n));
  }
}

}  // namespace

// Both strings are as large as they may become: nothing here needs memory later.
struct AsyncLog::Queue {
  std::mutex mutex;
  std::condition_variable changed;
  std::string lines, being_written;
  std::uint64_t dropped = 0;
  bool closing = false;

  Queue() {
    lines.reserve(kMostBytes);
    being_written.reserve(kMostBytes);
  }

  void add(std::string_view line) {
    {
      const std::lock_guard lock(mutex);
      if (line.size() > kMostBytes - lines.size()) {
        ++dropped;
        return;
      }
      lines.append(line);
    }
    changed.notify_all();
  }

  void write_to(int fd) {
    std::unique_lock lock(mutex);
    for (;;) {
      changed.wait(lock, [&] { return closing || !lines.empty(); });
      if (lines.empty()) return;
      std::swap(lines, being_written);
      lock.unlock();
      write_all(fd, being_written);
      lock.lock();
      being_written.clear();
      changed.notify_all();
    }
  }

  void close() {
    std::unique_lock lock(mutex);
    closing = true;
    changed.notify_all();
    changed.wait_for(lock, kLastWait, [&] { return lines.empty() && being_written.empty(); });
  }
};

class AsyncLog::Sink : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit Sink(std::shared_ptr<Queue> queue) : queue_(std::move(queue)) {}

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t line;
    base_sink::formatter_->format(message, line);
    queue_->add({line.data(), line.size()});
  }
  void flush_() override {}

  const std::shared_ptr<Queue> queue_;
};

AsyncLog::AsyncLog(const std::string& level, int fd, LogFormat format) : queue_(std::make_shared<Queue>()) {
  std::thread([queue = queue_, fd] { queue->write_to(fd); }).detach();
  use_as_log(std::make_shared<Sink>(queue_), level);
  if (format == LogFormat::json) spdlog::default_logger()->set_formatter(std::make_unique<JsonLine>());
  // Its own one writes to stderr, and waits for the reader there.
  spdlog::default_logger()->set_error_handler([queue = queue_](const std::string&) {
    const std::lock_guard lock(queue->mutex);
    ++queue->dropped;
  });
}

AsyncLog::~AsyncLog() { queue_->close(); }

void AsyncLog::log_members(spdlog::level::level_enum level, std::string_view members) {
  spdlog::default_logger()->log(spdlog::source_loc{"", 1, kMembers}, level,
                                spdlog::string_view_t(members.data(), members.size()));
}

std::uint64_t AsyncLog::dropped() const {
  const std::lock_guard lock(queue_->mutex);
  return queue_->dropped;
}

}  // namespace selenograph::server
