#include "server/http/connection.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <string>
#include <thread>

namespace selenograph::server {
namespace {

using Clock = Connection::Clock;
using std::chrono::milliseconds;

// A connection, and the socket of its client.
class ConnectionTest : public ::testing::Test {
 protected:
  ConnectionTest() { EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends_.data()), 0); }
  ~ConnectionTest() override { ::close(ends_[1]); }

  int client() const { return ends_[1]; }
  Connection served(const SendPace& pace = {}) { return {ends_[0], {}, pace}; }

 private:
  std::array<int, 2> ends_{};
};

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

TEST_F(ConnectionTest, AnAnswerHasAGraceAndThenItsSizeOverTheRate) {
  Connection connection = served({.bytes_per_s = 4e6, .grace = milliseconds(200)});
  std::thread slow([this] {  // 1 MB/s
    std::array<char, 20000> piece;
    while (::recv(client(), piece.data(), piece.size(), 0) > 0) std::this_thread::sleep_for(milliseconds(20));
  });
  const std::string answer(8 << 20, 'x');
  const auto start = Clock::now();
  EXPECT_FALSE(connection.write(answer) && connection.flush());
  EXPECT_GE(seconds_since(start), 0.2);
  EXPECT_LE(seconds_since(start), 0.2 + 8.4 / 4);  // however much it has taken by then
  connection.cut();
  slow.join();
}

TEST_F(ConnectionTest, SeveralWritesAreOneAnswer) {
  Connection connection = served({.bytes_per_s = 1e9, .grace = milliseconds(300)});
  const std::string piece(1 << 20, 'x');
  const auto start = Clock::now();
  std::thread reader([this] {  // each piece within the grace, all of them not
    std::array<char, 1 << 16> got;
    for (int i = 0; i < 64; ++i) {
      if (::recv(client(), got.data(), got.size(), 0) <= 0) return;
      std::this_thread::sleep_for(milliseconds(10));
    }
  });
  int written = 0;
  while (written < 20 && connection.write(piece)) ++written;
  EXPECT_LT(written, 20);
  EXPECT_LT(seconds_since(start), 0.6);
  connection.cut();
  reader.join();
}

TEST_F(ConnectionTest, AReaderAtTheRateGetsAll) {
  Connection connection = served({.bytes_per_s = 1e5, .grace = milliseconds(100)});
  std::size_t received = 0;
  std::thread reader([&] {
    std::array<char, 1 << 16> got;
    for (ssize_t n; (n = ::recv(client(), got.data(), got.size(), 0)) > 0;) received += static_cast<std::size_t>(n);
  });
  EXPECT_TRUE(connection.write(std::string(3 << 20, 'x')) && connection.flush());
  EXPECT_FALSE(connection.answer_begun());
  connection.cut();
  reader.join();
  EXPECT_EQ(received, std::size_t{3} << 20);
}

std::string problem_of(Connection& connection, bool in_head = true) {
  EXPECT_TRUE(connection.begin_request(milliseconds(1000), milliseconds(50)));
  if (!in_head) connection.end_head();
  char byte = 0;
  while (connection.read(&byte, 1) > 0) continue;
  return connection.problem() ? connection.problem()->error_code : "";
}

TEST_F(ConnectionTest, ARequestHasOneDeadline) {
  Connection connection = served();
  ASSERT_EQ(::send(client(), "GET", 3, 0), 3);
  EXPECT_EQ(problem_of(connection), "request_timeout");
}

TEST_F(ConnectionTest, ASilentClientHasNoProblem) {
  Connection connection = served();
  EXPECT_FALSE(connection.begin_request(milliseconds(10), milliseconds(10)));
  EXPECT_FALSE(connection.problem());
}

struct LongText {
  const char* text;  // repeated
  int times;
  bool in_head;
  const char* code;
};
class LongTexts : public ConnectionTest, public ::testing::WithParamInterface<LongText> {};
INSTANTIATE_TEST_SUITE_P(Connection, LongTexts,
                         ::testing::Values(LongText{"a", 8001, true, "uri_too_long"},
                                           LongText{"a: b\r\n", 101, true, "request_timeout"},  // 100 fields
                                           LongText{"a: b\r\n", 102, true, "headers_too_large"},
                                           LongText{"a: b\r\n", 3000, true, "headers_too_large"},
                                           LongText{"0", 8001, false, "malformed_request"}));

TEST_P(LongTexts, AreRefusedWhileTheyAreReceived) {
  std::string text;
  for (int i = 0; i < GetParam().times; ++i) text += GetParam().text;
  Connection connection = served();
  ASSERT_EQ(::send(client(), text.data(), text.size(), 0), static_cast<ssize_t>(text.size()));
  EXPECT_EQ(problem_of(connection, GetParam().in_head), GetParam().code);
}

TEST_F(ConnectionTest, WhatWasWrittenIsSentBeforeItWaits) {
  Connection connection = served();
  ASSERT_EQ(::send(client(), "x", 1, 0), 1);
  ASSERT_TRUE(connection.begin_request(milliseconds(1000), milliseconds(10)));
  EXPECT_TRUE(connection.write("continue"));
  std::array<char, 16> got{};
  EXPECT_EQ(::recv(client(), got.data(), got.size(), MSG_DONTWAIT), -1) << "gathered";
  EXPECT_EQ(connection.read(got.data(), got.size()), 1);
  EXPECT_EQ(connection.read(got.data(), got.size()), -1);
  EXPECT_EQ(::recv(client(), got.data(), got.size(), MSG_DONTWAIT), 8);
}

TEST_F(ConnectionTest, OnlyAWaitingConnectionIsGivenUp) {
  Connection connection = served();
  EXPECT_TRUE(connection.begin_work());
  EXPECT_FALSE(connection.give_up());
  connection.end_work();
  EXPECT_TRUE(connection.give_up());
  EXPECT_TRUE(connection.given_up());
  EXPECT_FALSE(connection.begin_work());
}

TEST_F(ConnectionTest, TheEndOfTheStreamMeansDepartureDuringWork) {
  Connection connection = served();
  ASSERT_TRUE(connection.begin_work());
  connection.detect_disconnect();
  EXPECT_FALSE(connection.abandoned());
  ::shutdown(client(), SHUT_WR);
  connection.detect_disconnect();
  EXPECT_TRUE(connection.abandoned());
}

}  // namespace
}  // namespace selenograph::server
