#include "server/service/log.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <spdlog/async_logger.h>
#include <spdlog/details/null_mutex.h>
#include <spdlog/details/thread_pool.h>
#include <spdlog/formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <future>
#include <iterator>
#include <new>
#include <nlohmann/json.hpp>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>

#include "api/message/json_text.h"
#include "dem/base/library_messages.h"

namespace selenograph::server {
namespace {

constexpr const char* kLogName = "selenograph";
constexpr auto kLastWait = std::chrono::milliseconds(500);
constexpr const char* kMembers = "members";  // stands for a line's place in the source: its text is JSON

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
                   message.source.funcname == kMembers ? std::string(text) : api::json_text(nlohmann::json(text)));
  }
  std::unique_ptr<spdlog::formatter> clone() const override { return std::make_unique<JsonLine>(); }
};

// False: the rest was not written. What stands behind stderr is full, or closed.
bool write_all(int fd, std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(fd, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    text.remove_prefix(static_cast<std::size_t>(n));
  }
  return true;
}

void use_as_log(std::shared_ptr<spdlog::logger> log, const std::string& level) {
  log->set_pattern("%Y-%m-%dT%H:%M:%S.%e %^%l%$ %v");
  log->set_level(spdlog::level::from_str(level));
  spdlog::set_default_logger(std::move(log));
  dem::library_log = [](const std::string& text) { spdlog::warn("{}", text); };
}

}  // namespace

void set_up_log(const std::string& level) {
  use_as_log(std::make_shared<spdlog::logger>(kLogName, std::make_shared<spdlog::sinks::stderr_color_sink_mt>()),
             level);
}

// Written with write(2), not with stdio, whose lock a writer that can't go on would keep through exit().
class AsyncLog::Sink : public spdlog::sinks::base_sink<spdlog::details::null_mutex> {
 public:
  explicit Sink(int fd) : fd_(fd) {}

  std::atomic<std::uint64_t> unwritten = 0;  // for lack of memory, or of room

 private:
  // Nothing may leave it: spdlog would need memory to say what.
  void sink_it_(const spdlog::details::log_msg& message) override {
    try {
      line_.clear();
      if (torn_) line_.push_back('\n');
      base_sink::formatter_->format(message, line_);
      torn_ = !write_all(fd_, {line_.data(), line_.size()});
      if (torn_) ++unwritten;
    } catch (const std::bad_alloc&) {
      ++unwritten;
    }
  }
  void flush_() override {}

  const int fd_;
  spdlog::memory_buf_t line_;
  bool torn_ = false;
};

AsyncLog::AsyncLog(const std::string& level, int fd, LogFormat format)
    : sink_(std::make_shared<Sink>(fd)), thread_(std::make_shared<spdlog::details::thread_pool>(kMostLines, 1)) {
  use_as_log(
      std::make_shared<spdlog::async_logger>(kLogName, sink_, thread_, spdlog::async_overflow_policy::overrun_oldest),
      level);
  if (format == LogFormat::json) spdlog::default_logger()->set_formatter(std::make_unique<JsonLine>());
  // Its own one writes to stderr, and waits for the reader there.
  spdlog::default_logger()->set_error_handler([sink = sink_](const std::string&) { ++sink->unwritten; });
}

// spdlog's thread writes all that waits before it ends, and whoever ends it waits for that: for ever, where nobody
// reads.
AsyncLog::~AsyncLog() {
  // For ever, where its last user never ends.
  const auto kept = new auto(std::move(thread_));  // NOLINT(bugprone-unhandled-exception-at-new)
  try {
    std::promise<void> ended;
    const std::future<void> all_written = ended.get_future();
    std::thread([kept, ended = std::move(ended)]() mutable {
      delete kept;
      ended.set_value();
    }).detach();
    all_written.wait_for(kLastWait);
  } catch (const std::system_error&) {  // no thread can be had: spdlog's own has as long
    std::this_thread::sleep_for(kLastWait);
  }
}

void AsyncLog::log_members(spdlog::level::level_enum level, std::string_view members) {
  spdlog::default_logger()->log(spdlog::source_loc{"", 1, kMembers}, level,
                                spdlog::string_view_t(members.data(), members.size()));
}

std::uint64_t AsyncLog::dropped() const { return thread_->overrun_counter() + sink_->unwritten; }

}  // namespace selenograph::server
