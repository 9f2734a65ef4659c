#include "server/service/log.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <spdlog/common.h>
#include <spdlog/details/mpmc_blocking_q.h>
#include <spdlog/details/null_mutex.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <utility>
#include <variant>

#include "api/message/json_text.h"
#include "dem/base/library_messages.h"
#include "dem/files/open_file.h"
#include "server/http/access.h"

namespace selenograph::server {
namespace {

using nlohmann::ordered_json;

constexpr const char* kLogName = "selenograph";
constexpr auto kMaxWaitAtEnd = std::chrono::milliseconds(500);

// A line of the log before it is formatted.
struct LogRecord {
  spdlog::log_clock::time_point time;
  spdlog::level::level_enum level = spdlog::level::off;
  std::variant<std::string, AccessRecord> content;  // a message or a finished request
};

ordered_json text_or_null(const std::string& text) { return text.empty() ? ordered_json() : ordered_json(text); }
// Returns milliseconds rounded to whole microseconds.
double rounded(double ms) { return std::round(ms * 1e3) / 1e3; }

// Adds the members of a request to its line; deploy/operation/log.md documents them.
void add_members(ordered_json& line, const AccessRecord& request) {
  line["request_id"] = request.request_id;
  line["token"] = text_or_null(request.token);
  line["client"] = text_or_null(request.host);
  line["method"] = text_or_null(request.method);
  line["target"] = text_or_null(request.target);
  line["status"] = request.status;
  line["error"] = text_or_null(request.error_code);
  line["request_bytes"] = request.request_bytes;
  line["bytes"] = request.bytes;
  line["duration_ms"] = rounded(1e3 * request.seconds);
  line["queued_ms"] = rounded(1e3 * request.queued_s);
  line["work_ms"] = rounded(1e3 * request.work_s);
  line["stages_ms"] = ordered_json::object();
  for (const auto& [stage, ms] : request.stages) line["stages_ms"][stage] = rounded(ms);  // as in Server-Timing
}

std::string json_line_of(const LogRecord& record) {
  const auto level = spdlog::level::to_string_view(record.level);
  ordered_json line;
  line["time"] = utc_text(record.time);
  line["level"] = std::string(level.data(), level.size());
  if (const auto* message = std::get_if<std::string>(&record.content))
    line["message"] = *message;
  else
    add_members(line, std::get<AccessRecord>(record.content));
  return api::json_line(line);
}

std::string message_of(const AccessRecord& request) {
  return fmt::format("{} {} {} {:.1f} ms {} B {} {}", request.method.empty() ? "-" : request.method,
                     request.target.empty() ? "-" : request.target.substr(0, 200), request.status,
                     request.seconds * 1000.0, request.bytes, request.request_id, request.error_code);
}

// Makes a logger spdlog's default, and the library `dem` log to it.
void use_as_log(std::shared_ptr<spdlog::logger> log, const std::string& level) {
  log->set_pattern("%Y-%m-%dT%H:%M:%S.%e %^%l%$ %v");
  log->set_level(spdlog::level::from_str(level));
  spdlog::set_default_logger(std::move(log));
  dem::library_log = [](const std::string& text) { spdlog::warn("{}", text); };
}

}  // namespace

std::string utc_text(std::chrono::system_clock::time_point time) {
  const auto seconds = std::chrono::floor<std::chrono::seconds>(time);
  const auto ms = std::chrono::floor<std::chrono::milliseconds>(time - seconds);
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z", fmt::gmtime(std::chrono::system_clock::to_time_t(seconds)),
                     ms.count());
}

void set_up_log(const std::string& level) {
  use_as_log(std::make_shared<spdlog::logger>(kLogName, std::make_shared<spdlog::sinks::stderr_color_sink_mt>()),
             level);
}

// The queue between the logging threads and the writing one:
//
//   spdlog::warn() ...  --sink_it_-->  +-------------------------------+
//   log_request()       --add------->  | queue of LogRecord, kMaxLines | --run, on its thread--> write(2)
//                                      +-------------------------------+
//                                        full: drops and counts the oldest
//
// The queue has its own lock, so that the sink needs none.
class AsyncLog::Writer : public spdlog::sinks::base_sink<spdlog::details::null_mutex> {
 public:
  Writer(int fd, LogFormat format) : fd_(fd), format_(format) {}

  void add(LogRecord&& record) { queue_.enqueue_nowait(std::move(record)); }
  void count_lost() { ++lost_; }
  std::uint64_t dropped() { return queue_.overrun_counter() + lost_; }

  // Writes all records up to the call of end().
  void run() {
    std::optional<LogRecord> record;
    for (;;) {
      if (!queue_.dequeue_for(record, std::chrono::seconds(10))) continue;
      if (!record) return;
      write(*record);
    }
  }
  void end() { queue_.enqueue_nowait(std::nullopt); }

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    add({message.time, message.level, std::string(message.payload.data(), message.payload.size())});
  }
  void flush_() override {}

  std::string text_line_of(const LogRecord& record) {
    const auto* request = std::get_if<AccessRecord>(&record.content);
    const std::string message = request ? message_of(*request) : std::get<std::string>(record.content);
    spdlog::memory_buf_t line;
    base_sink::formatter_->format({record.time, {}, kLogName, record.level, message}, line);
    return {line.data(), line.size()};
  }

  // Uses write(2) instead of stdio: a blocked writer would hold stdio's lock, and exit() would wait for it.
  void write(const LogRecord& record) {
    try {
      const std::string line = format_ == LogFormat::json ? json_line_of(record) : text_line_of(record);
      // Writing fails if the pipe behind stderr is closed, or its disk is full. It may have written a part of the line:
      // the next line then begins with a newline.
      is_torn_ = dem::write_all(fd_, is_torn_ ? '\n' + line : line) != 0;
      if (is_torn_) count_lost();
    } catch (const std::exception&) {  // no memory for the line
      count_lost();
    }
  }

  const int fd_;
  const LogFormat format_;
  spdlog::details::mpmc_blocking_queue<std::optional<LogRecord>> queue_{kMaxLines};
  std::atomic<std::uint64_t> lost_ = 0;  // records that could not be enqueued, formatted or written
  bool is_torn_ = false;                 // the last line has no end
};

AsyncLog::AsyncLog(const std::string& level, int fd, LogFormat format) : writer_(std::make_shared<Writer>(fd, format)) {
  use_as_log(std::make_shared<spdlog::logger>(kLogName, writer_), level);
  // spdlog's own handler would write to stderr, and wait for its reader.
  spdlog::default_logger()->set_error_handler([writer = writer_](const std::string&) { writer->count_lost(); });
  std::promise<void> finished;
  finished_ = finished.get_future();
  std::thread([writer = writer_, finished = std::move(finished)]() mutable {
    writer->run();
    finished.set_value();
  }).detach();
}

// Waits for a limited time: the thread never ends while stderr is full and has no reader.
AsyncLog::~AsyncLog() {
  writer_->end();
  finished_.wait_for(kMaxWaitAtEnd);
}

void AsyncLog::log_request(spdlog::level::level_enum level, const AccessRecord& request) const {
  if (!spdlog::should_log(level)) return;
  try {
    writer_->add({spdlog::log_clock::now(), level, request});
  } catch (const std::bad_alloc&) {
    writer_->count_lost();
  }
}

std::uint64_t AsyncLog::dropped() const { return writer_->dropped(); }

}  // namespace selenograph::server
