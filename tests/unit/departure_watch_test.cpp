#include "server/http/departure_watch.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <string>
#include <thread>

namespace selenograph::server {
namespace {

// A client's socket and the one that serves it, over loopback: what a reset does, only TCP shows.
class DepartureTest : public ::testing::Test {
 protected:
  DepartureTest() {
    const int listener = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    EXPECT_EQ(::bind(listener, reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(::listen(listener, 1), 0);
    ::getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
    client_ = ::socket(AF_INET, SOCK_STREAM, 0);
    EXPECT_EQ(::connect(client_, reinterpret_cast<sockaddr*>(&address), size), 0);
    served_ = ::accept(listener, nullptr, nullptr);
    ::close(listener);
  }
  ~DepartureTest() override {
    if (client_ >= 0) ::close(client_);
    ::close(served_);
  }

  void close_client() {
    ::close(client_);
    client_ = -1;
  }
  // What the client has received by the time that something comes, or that nothing more is expected.
  std::string received(int patience_ms) const {
    pollfd p{client_, POLLIN, 0};
    std::array<char, 200> text;
    if (::poll(&p, 1, patience_ms) <= 0) return {};
    const ssize_t n = ::recv(client_, text.data(), text.size(), 0);
    return {text.data(), static_cast<std::size_t>(std::max<ssize_t>(n, 0))};
  }
  bool becomes_true(const std::atomic<bool>& flag, std::chrono::milliseconds patience) const {
    const auto end = std::chrono::steady_clock::now() + patience;
    while (!flag && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return flag;
  }

  DepartureWatch watch_;
  std::atomic<bool> left_{false};
  int client_ = -1, served_ = -1;
};

constexpr auto kSoon = std::chrono::seconds(20);
constexpr auto kMoment = std::chrono::milliseconds(200);

TEST_F(DepartureTest, AClosedConnectionIsADeparture) {
  const DepartureWatch::Guard guard(watch_, served_, true, &left_);
  EXPECT_FALSE(becomes_true(left_, kMoment));
  close_client();
  EXPECT_TRUE(becomes_true(left_, kSoon));
}

TEST_F(DepartureTest, OneThatWasClosedBeforeIsNoticed) {
  close_client();
  const DepartureWatch::Guard guard(watch_, served_, true, &left_);
  EXPECT_TRUE(becomes_true(left_, kSoon));
}

TEST_F(DepartureTest, AHalfClosedOneIsAskedAndStays) {
  const DepartureWatch::Guard guard(watch_, served_, true, &left_);
  ::shutdown(client_, SHUT_WR);
  EXPECT_EQ(received(20000), "HTTP/1.1 100 Continue\r\n\r\n");
  EXPECT_FALSE(becomes_true(left_, kMoment));
  close_client();  // having read all: nothing tells but the next question
  EXPECT_TRUE(becomes_true(left_, kSoon));
}

TEST_F(DepartureTest, Http10IsNotAsked) {
  const DepartureWatch::Guard guard(watch_, served_, false, &left_);
  ::shutdown(client_, SHUT_WR);
  EXPECT_EQ(received(300), "");
  EXPECT_FALSE(left_);
  const linger reset{1, 0};
  ::setsockopt(client_, SOL_SOCKET, SO_LINGER, &reset, sizeof(reset));
  close_client();
  EXPECT_TRUE(becomes_true(left_, kSoon));
}

TEST_F(DepartureTest, ACutConnectionIsADeparture) {
  const DepartureWatch::Guard guard(watch_, served_, true, &left_);
  ::shutdown(served_, SHUT_RDWR);
  EXPECT_TRUE(becomes_true(left_, kSoon));
}

TEST_F(DepartureTest, NothingIsSaidAfterwards) {
  { const DepartureWatch::Guard guard(watch_, served_, true, &left_); }
  ::shutdown(client_, SHUT_WR);
  EXPECT_EQ(received(300), "");
  EXPECT_FALSE(left_);
}

}  // namespace
}  // namespace selenograph::server
