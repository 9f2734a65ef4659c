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

// A client that sends without pause and is consumed piece by piece.
TEST_F(ConnectionTest, WhatIsConsumedIsNotKept) {
  Connection connection = served();
  std::thread sender([this] {
    const std::string data(1 << 20, 'x');
    for (int i = 0; i < 16; ++i) ASSERT_EQ(::send(client(), data.data(), data.size(), 0), 1 << 20);
    ::shutdown(client(), SHUT_WR);
  });
  std::size_t consumed = 0, most_kept = 0;
  for (;;) {
    if (connection.unread().size() < 100 &&
        connection.fill(Clock::now() + std::chrono::seconds(20)) != Connection::Read::data)
      break;
    const std::size_t bytes = std::min<std::size_t>(100, connection.unread().size());
    connection.consume(bytes);
    consumed += bytes;
    most_kept = std::max(most_kept, connection.kept_bytes());
  }
  sender.join();
  EXPECT_GE(consumed + connection.unread().size(), std::size_t{16} << 20);
  EXPECT_LE(most_kept, 3 * 65536);
}

TEST_F(ConnectionTest, OnlyWhoWaitsIsGivenUp) {
  Connection connection = served();
  EXPECT_TRUE(connection.begin_work());
  EXPECT_FALSE(connection.give_up());
  connection.begin_answer();
  EXPECT_FALSE(connection.give_up());
  EXPECT_FALSE(connection.give_up_if_slow(Clock::now())) << "it has only begun";
  EXPECT_TRUE(connection.give_up_if_slow(Clock::now() + Connection::kSlowAfter));
  EXPECT_TRUE(connection.given_up());
  connection.end_work();
  EXPECT_FALSE(connection.begin_work());
}

}  // namespace
}  // namespace selenograph::server
