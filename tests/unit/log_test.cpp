#include "server/service/log.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "server/http/http_server.h"

namespace selenograph::server {
namespace {

class AsyncLogTest : public ::testing::Test {
 protected:
  AsyncLogTest() { EXPECT_EQ(::pipe2(pipe_.data(), O_CLOEXEC), 0); }
  ~AsyncLogTest() override {
    spdlog::set_default_logger(before_);
    ::close(pipe_[0]);
    ::close(pipe_[1]);
  }
  std::string read_some() const {
    std::string text(1 << 16, '\0');
    text.resize(static_cast<std::size_t>(std::max<ssize_t>(::read(pipe_[0], text.data(), text.size()), 0)));
    return text;
  }

  std::array<int, 2> pipe_{};
  const std::shared_ptr<spdlog::logger> before_ = spdlog::default_logger();
};

TEST_F(AsyncLogTest, LinesComeInOrderAndWholeBeforeItEnds) {
  {
    const AsyncLog log("info", pipe_[1]);
    for (int i = 0; i < 100; ++i) spdlog::info("line {}", i);
    spdlog::debug("not asked for");
    EXPECT_EQ(log.dropped(), 0u);
  }
  std::string text = read_some();
  std::size_t at = 0;
  for (int i = 0; i < 100; ++i) {
    at = text.find("info line " + std::to_string(i) + "\n", at);
    ASSERT_NE(at, std::string::npos) << i;
  }
  EXPECT_EQ(text.find("not asked for"), std::string::npos);
}

TEST_F(AsyncLogTest, JsonLinesHoldWhatever) {
  {
    const AsyncLog log("info", pipe_[1], LogFormat::json);
    spdlog::warn("a \"quoted\"\nline, and \xff");
    AccessRecord request;
    request.status = 200;
    request.stages = {{"render", 1.23456}};
    log.log_request(spdlog::level::info, request);
    log.log_request(spdlog::level::debug, request);
  }
  std::istringstream text(read_some());
  std::vector<nlohmann::json> lines;
  for (std::string line; std::getline(text, line);) lines.push_back(nlohmann::json::parse(line));
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0]["level"], "warning");
  EXPECT_EQ(lines[0]["message"], "a \"quoted\"\nline, and \xef\xbf\xbd");
  EXPECT_EQ(lines[1]["status"], 200);
  EXPECT_EQ(lines[1]["token"], nullptr);
  EXPECT_EQ(lines[1]["stages_ms"], (nlohmann::json{{"render", 1.235}}));
  EXPECT_FALSE(lines[1].contains("message"));
  EXPECT_TRUE(
      std::regex_match(lines[1]["time"].get<std::string>(), std::regex(R"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z)")));
}

TEST_F(AsyncLogTest, ARequestIsOneLineOfText) {
  {
    const AsyncLog log("info", pipe_[1]);
    AccessRecord request;
    request.method = "GET";
    request.target = "/metrics?x";
    request.status = 200;
    request.bytes = 17;
    request.seconds = 0.0123;
    request.request_id = "id";
    log.log_request(spdlog::level::info, request);
  }
  EXPECT_TRUE(read_some().ends_with(" info GET /metrics?x 200 12.3 ms 17 B id \n"));
}

TEST_F(AsyncLogTest, AReaderThatDoesNotReadDelaysNobody) {
  const auto start = std::chrono::steady_clock::now();
  constexpr std::size_t kLines = 2 * AsyncLog::kMaxLines;
  const std::string line(1000, 'x');
  {
    const AsyncLog log("info", pipe_[1]);
    for (std::size_t i = 0; i < kLines; ++i) spdlog::info("line {} {}", i, line);
    // The pipe holds 64 KiB, and one line is being written.
    EXPECT_GE(log.dropped(), kLines - AsyncLog::kMaxLines - (1 << 16) / line.size() - 1);
    EXPECT_LE(log.dropped(), kLines - AsyncLog::kMaxLines);
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  EXPECT_LT(took.count(), 5);
  // Its thread is still there, and goes on when there is a reader; nobody is harmed by it.
  // All is read, so that it writes nothing when the pipe is closed.
  ::fcntl(pipe_[0], F_SETFL, O_NONBLOCK);  // NOLINT(cppcoreguidelines-pro-type-vararg)
  std::string received;
  for (int quiet_ms = 0; quiet_ms < 300;) {
    const std::string more = read_some();
    received += more;
    if (!more.empty()) quiet_ms = 0;
    if (more.empty()) std::this_thread::sleep_for(std::chrono::milliseconds(1)), ++quiet_ms;
  }
  EXPECT_GT(received.size(), AsyncLog::kMaxLines * line.size());
  EXPECT_NE(received.find(fmt::format(" line {} ", kLines - 1)), std::string::npos);  // the oldest were dropped
}

}  // namespace
}  // namespace selenograph::server
