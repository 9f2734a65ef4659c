#include "server/http/request_stream.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <string>

namespace selenograph::server {
namespace {

using std::chrono::milliseconds;

// A request that comes on a connection, and the socket of its client.
struct Client {
  static constexpr std::size_t kMaxBody = 1000;

  ~Client() { ::close(ends_[1]); }

  void send(const std::string& bytes) {
    EXPECT_EQ(::send(ends_[1], bytes.data(), bytes.size(), 0), static_cast<ssize_t>(bytes.size()));
  }
  void end() { ::shutdown(ends_[1], SHUT_WR); }
  std::string sent_back() {
    std::array<char, 1000> bytes{};
    const ssize_t size = ::recv(ends_[1], bytes.data(), bytes.size(), MSG_DONTWAIT);
    return size > 0 ? std::string(bytes.data(), static_cast<std::size_t>(size)) : "";
  }

  // All that the library may read, in pieces of its own choice.
  static std::string read_all(RequestStream& stream) {
    std::string all;
    std::array<char, 7> piece{};
    for (ssize_t size; (size = stream.read(piece.data(), piece.size())) > 0;)
      all.append(piece.data(), static_cast<std::size_t>(size));
    return all;
  }
  static std::string problem_of(const RequestStream& stream) {
    return stream.problem() ? stream.problem()->error_code : "";
  }

  static std::array<int, 2> socket_pair() {
    std::array<int, 2> ends{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()), 0);
    return ends;
  }

  const std::array<int, 2> ends_ = socket_pair();
  Connection connection_{ends_[0], {}, {}};
  RequestStream stream_{connection_, {kMaxBody, milliseconds(300), milliseconds(300)}};
};

class RequestStreamTest : public ::testing::Test, protected Client {};

const std::string kPost = "POST / HTTP/1.1\r\nHost: x\r\n", kNext = "GET /next HTTP/1.1\r\n";

TEST_F(RequestStreamTest, ReadsAsManyBytesAsWereAnnounced) {
  send(kPost + "Content-Length: 5\r\n\r\nabcde" + kNext);
  ASSERT_TRUE(stream_.open());
  EXPECT_EQ(read_all(stream_), "POST / HTTP/1.1\r\nhost: x\r\ncontent-length: 5\r\n\r\nabcde");
  EXPECT_EQ(problem_of(stream_), "");
  EXPECT_EQ(connection_.unread(), kNext) << "the next request's";
}

TEST_F(RequestStreamTest, ReadsChunksWithoutExtensionsAndTrailers) {
  send(kPost + "Transfer-Encoding: chunked\r\n\r\n2;a=b\r\nab\r\n0003\r\ncde\r\n0\r\nX: y\r\n\r\n" + kNext);
  ASSERT_TRUE(stream_.open());
  EXPECT_EQ(read_all(stream_),
            "POST / HTTP/1.1\r\nhost: x\r\ntransfer-encoding: chunked\r\n\r\n5\r\nabcde\r\n0\r\n\r\n");
  EXPECT_EQ(problem_of(stream_), "");
  EXPECT_EQ(connection_.unread(), kNext);
}

TEST_F(RequestStreamTest, WhatIsWrongWithABodyEndsIt) {
  for (const auto& [body, code] :
       {std::pair{"Transfer-Encoding: chunked\r\n\r\n2\r\nabc\r\n0\r\n\r\n", "malformed_request"},
        std::pair{"Transfer-Encoding: chunked\r\n\r\n3e9\r\n", "too_large"}}) {
    Client other;
    other.send(kPost + body);
    ASSERT_TRUE(other.stream_.open());
    const std::string read = read_all(other.stream_);
    EXPECT_EQ(read.substr(read.find("\r\n\r\n")), "\r\n\r\n") << "nothing behind the head";
    EXPECT_EQ(problem_of(other.stream_), code);
  }
}

TEST_F(RequestStreamTest, ABodyThatEndsEarlyIsNone) {
  send(kPost + "Content-Length: 5\r\n\r\nabc");
  end();
  ASSERT_TRUE(stream_.open());
  read_all(stream_);
  EXPECT_EQ(problem_of(stream_), "malformed_request");
}

TEST_F(RequestStreamTest, OneDeadlineForTheWholeRequest) {
  send(kPost + "Content-Length: 5\r\n\r\nabc");
  const auto start = Connection::Clock::now();
  ASSERT_TRUE(stream_.open());
  read_all(stream_);
  EXPECT_EQ(problem_of(stream_), "request_timeout");
  EXPECT_GE(Connection::Clock::now() - start, milliseconds(290));
}

TEST_F(RequestStreamTest, NobodyIsThereToAnswer) {
  EXPECT_FALSE(stream_.open()) << "silent";
  send("GET / HT");
  end();
  EXPECT_FALSE(stream_.open()) << "left";
}

TEST_F(RequestStreamTest, WhatIsRefusedReadsAsARequestWithoutBody) {
  send("HEAD / HTTP/1.1\r\nHost: x\r\nHost: y\r\n\r\n");
  ASSERT_TRUE(stream_.open());
  EXPECT_EQ(problem_of(stream_), "malformed_request");
  EXPECT_TRUE(stream_.head().close);
  EXPECT_EQ(read_all(stream_), "GET / HTTP/1.1\r\n\r\n") << "of a head that can't be trusted, no method is known";

  Client other;
  other.send("HEAD /a HTTP/1.1\r\nHost: evil\r\n\r\n");
  ASSERT_TRUE(other.stream_.open());
  other.stream_.refuse({"misdirected_request", ""});
  EXPECT_EQ(read_all(other.stream_), "HEAD / HTTP/1.1\r\n\r\n");
  EXPECT_EQ(other.stream_.head().target, "/a");
}

TEST_F(RequestStreamTest, SendsWhatWasWrittenBeforeItWaits) {
  send(kPost + "Content-Length: 1\r\nExpect: 100-continue\r\n\r\n");
  ASSERT_TRUE(stream_.open());
  EXPECT_TRUE(connection_.write("HTTP/1.1 100 Continue\r\n\r\n"));
  EXPECT_EQ(sent_back(), "");
  read_all(stream_);
  EXPECT_EQ(sent_back(), "HTTP/1.1 100 Continue\r\n\r\n");
}

}  // namespace
}  // namespace selenograph::server
