#include "server/http/chunked_body.h"

#include <gtest/gtest.h>

#include <string>

namespace selenograph::server {
namespace {

constexpr std::size_t kMostContent = 1000;
using State = ChunkedBody::State;

struct Decoded {
  State state;
  std::string body, rest;
};

// In pieces of so many bytes.
Decoded decoded(const std::string& raw, std::size_t piece) {
  ChunkedBody chunks(kMostContent);
  Decoded out{State::more, {}, {}};
  for (std::size_t at = 0; at < raw.size(); at += piece) {
    std::string_view part = std::string_view(raw).substr(at, piece);
    out.state = chunks.take(part, out.body);
    out.rest += part;
  }
  return out;
}

Decoded decoded(const std::string& raw) {
  const Decoded whole = decoded(raw, raw.size() + 1), single = decoded(raw, 1);
  EXPECT_EQ(whole.state, single.state) << raw;
  EXPECT_EQ(whole.body, single.body) << raw;
  if (whole.state == State::complete) {
    EXPECT_EQ(whole.rest, single.rest) << raw;
  }
  return whole;
}

TEST(ChunkedBody, IsDecodedAndLeavesWhatFollows) {
  const Decoded d = decoded("5\r\nhello\r\n00c\r\n, wide world\r\n0\r\n\r\nGET / HTTP/1.1\r\n");
  EXPECT_EQ(d.state, State::complete);
  EXPECT_EQ(d.body, "hello, wide world");
  EXPECT_EQ(d.rest, "GET / HTTP/1.1\r\n");
  EXPECT_EQ(decoded("0\r\n\r\n").state, State::complete);
}

TEST(ChunkedBody, ContentIsNotLookedInto) {
  EXPECT_EQ(decoded("7\r\n\r\n0\r\n\r\n\r\n0\r\n\r\n").body, "\r\n0\r\n\r\n");
  EXPECT_EQ(decoded(std::string("A\r\n\0\n\r;=\"\xff 0\r\r\n0\r\n\r\n", 19)).body,
            std::string("\0\n\r;=\"\xff 0\r", 10));
}

TEST(ChunkedBody, ExtensionsAndTrailersAreDropped) {
  for (const char* extension :
       {";a", ";a=b", " ; a = b", ";a=\"q;\\\"\\\\ x\";b", ";a\t=\tb ;c", ";!#$%&'*+-.^_`|~=1"}) {
    const Decoded d = decoded(std::string("3") + extension + "\r\nabc\r\n0" + extension + "\r\n\r\n");
    EXPECT_EQ(d.state, State::complete) << extension;
    EXPECT_EQ(d.body, "abc");
  }
  const Decoded d = decoded("3\r\nabc\r\n0\r\nA: b\r\nContent-Length: 7\r\nEmpty:\r\n\r\nnext");
  EXPECT_EQ(d.state, State::complete);
  EXPECT_EQ(d.body, "abc");
  EXPECT_EQ(d.rest, "next");
}

TEST(ChunkedBody, WhatOthersMayReadOtherwiseIsRefused) {
  for (const char* raw : {"0x5\r\nhello\r\n0\r\n\r\n",
                          "+5\r\nhello\r\n0\r\n\r\n",
                          "-5\r\nhello\r\n0\r\n\r\n",
                          " 5\r\nhello\r\n0\r\n\r\n",
                          "5 \r\nhello\r\n0\r\n\r\n",
                          "\r\nhello\r\n0\r\n\r\n",
                          "g\r\nhello\r\n0\r\n\r\n",
                          "5,5\r\nhello\r\n0\r\n\r\n",
                          "5\nhello\r\n0\r\n\r\n",
                          "5\r\nhello\n0\r\n\r\n",
                          "5\r\nhelloX\r\n0\r\n\r\n",
                          "5\r\nhello0\r\n\r\n",
                          "5\r\nhello\rX0\r\n\r\n",
                          "5\rX\nhello\r\n0\r\n\r\n",
                          "5;\r\nhello\r\n0\r\n\r\n",
                          "5;=b\r\nhello\r\n0\r\n\r\n",
                          "5;a=\r\nhello\r\n0\r\n\r\n",
                          "5;a=\"b\r\nhello\r\n0\r\n\r\n",
                          "5;a=\"b\"c\r\nhello\r\n0\r\n\r\n",
                          "5;a b\r\nhello\r\n0\r\n\r\n",
                          "5;a\x01\r\nhello\r\n0\r\n\r\n",
                          "00000000000000005\r\nhello\r\n0\r\n\r\n",
                          "10000000000000005\r\nhello\r\n0\r\n\r\n",
                          "0\r\nno colon\r\n\r\n",
                          "0\r\n: x\r\n\r\n",
                          "0\r\n a: x\r\n\r\n",
                          "0\r\na : x\r\n\r\n",
                          "0\r\na: x\n\r\n",
                          "0\r\na: \x01\r\n\r\n",
                          "0\r\na: b\r\n folded\r\n\r\n"}) {
    EXPECT_EQ(decoded(raw).state, State::malformed) << raw;
  }
}

TEST(ChunkedBody, SizesAreBounded) {
  const std::string most(kMostContent, 'x');
  EXPECT_EQ(decoded("3e8\r\n" + most + "\r\n0\r\n\r\n").body, most);
  EXPECT_EQ(decoded("3e9\r\n" + most + "x\r\n0\r\n\r\n").state, State::too_large);
  EXPECT_EQ(decoded("3e8\r\n" + most + "\r\n1\r\nx\r\n0\r\n\r\n").state, State::too_large);
  for (const char* size : {"ffffffffffffffff", "fffffffffffffffe", "8000000000000000"})
    EXPECT_EQ(decoded(std::string("1\r\nx\r\n") + size + "\r\nx\r\n0\r\n\r\n").state, State::too_large) << size;
}

TEST(ChunkedBody, EndlessFramingIsRefused) {
  EXPECT_EQ(decoded(std::string(5000, '0')).state, State::malformed);
  EXPECT_EQ(decoded("1;" + std::string(5000, 'a')).state, State::malformed);
  std::string extensions, trailers = "0\r\n";
  for (int i = 0; i < 40; ++i) extensions += "1;" + std::string(800, 'a') + "\r\nx\r\n";
  EXPECT_EQ(decoded(extensions).state, State::malformed);
  for (int i = 0; i < 20; ++i) trailers += "a: " + std::string(800, 'b') + "\r\n";
  EXPECT_EQ(decoded(trailers).state, State::malformed);
}

TEST(ChunkedBody, WhatIsNotAtItsEndIsWaitedFor) {
  const std::string raw = "5;a=b\r\nhello\r\n0\r\nA: b\r\n\r\n";
  for (std::size_t size = 0; size < raw.size(); ++size)
    EXPECT_EQ(decoded(raw.substr(0, size)).state, State::more) << size;
}

}  // namespace
}  // namespace selenograph::server
