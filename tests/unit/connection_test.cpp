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
  Connection served() { return Connection(ends_[0]); }

 private:
  std::array<int, 2> ends_{};
};

TEST_F(ConnectionTest, AnAnswerHasOneTimeHoweverMuchIsRead) {
  Connection connection = served();
  connection.limit_time(milliseconds(300));
  std::thread slow([this] {
    std::array<char, 20000> piece;
    while (::recv(client(), piece.data(), piece.size(), 0) > 0) std::this_thread::sleep_for(milliseconds(20));
  });
  const std::string answer(64 << 20, 'x');
  EXPECT_EQ(connection.write(answer.data(), answer.size()), -1);
  EXPECT_TRUE(connection.is_late());
  EXPECT_GT(connection.sent_bytes(), 0U);
  EXPECT_LT(connection.sent_bytes(), answer.size());
  connection.cut();
  slow.join();
}

TEST_F(ConnectionTest, AReaderInTimeGetsAll) {
  Connection connection = served();
  connection.limit_time(std::chrono::minutes(1));
  std::size_t received = 0;
  std::thread reader([&] {
    std::array<char, 1 << 16> got;
    for (ssize_t n; (n = ::recv(client(), got.data(), got.size(), 0)) > 0;) received += static_cast<std::size_t>(n);
  });
  const std::string answer(3 << 20, 'x');
  EXPECT_EQ(connection.write(answer.data(), answer.size()), static_cast<ssize_t>(answer.size()));
  EXPECT_EQ(connection.sent_bytes(), answer.size());
  connection.cut();
  reader.join();
  EXPECT_EQ(received, answer.size());
}

TEST_F(ConnectionTest, ARequestHasOneDeadlineAndALimit) {
  Connection connection = served();
  ASSERT_EQ(::send(client(), "GET /", 5, 0), 5);
  ASSERT_TRUE(connection.wait_for_request(Clock::now() + std::chrono::minutes(1)));
  connection.limit_time(milliseconds(50));
  connection.limit_bytes(4);
  std::array<char, 16> got{};
  EXPECT_EQ(connection.read(got.data(), got.size()), 4);
  EXPECT_EQ(connection.read(got.data(), got.size()), -1) << "more than it may send";
  connection.limit_bytes(100);
  EXPECT_EQ(connection.read(got.data(), got.size()), 1);
  EXPECT_FALSE(connection.is_late());
  EXPECT_EQ(connection.read(got.data(), got.size()), -1);
  EXPECT_TRUE(connection.is_late());
}

TEST_F(ConnectionTest, OnlyAnIdleConnectionIsEnded) {
  Connection connection = served();
  EXPECT_FALSE(connection.end_idle());
  std::thread waiting([&] { EXPECT_FALSE(connection.wait_for_request(Clock::now() + std::chrono::minutes(1))); });
  while (!connection.end_idle()) std::this_thread::sleep_for(milliseconds(1));
  waiting.join();
  EXPECT_FALSE(connection.end_idle());
}

TEST_F(ConnectionTest, TheEndOfTheStreamMeansDepartureDuringWork) {
  Connection connection = served();
  connection.begin_work();
  connection.detect_disconnect();
  EXPECT_FALSE(connection.abandoned());
  ::shutdown(client(), SHUT_WR);
  connection.detect_disconnect();
  EXPECT_TRUE(connection.abandoned());
  connection.begin_work();
  EXPECT_FALSE(connection.abandoned());
  connection.end_work();
  connection.detect_disconnect();
  EXPECT_FALSE(connection.abandoned()) << "its answer is being sent";
}

}  // namespace
}  // namespace selenograph::server
