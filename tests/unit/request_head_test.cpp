#include "server/http/request_head.h"

#include <gtest/gtest.h>

namespace selenograph::server {
namespace {

constexpr std::size_t kMaxBody = 1000;

std::string refusal(const std::string& raw) {
  const auto checked = check_head(raw, kMaxBody);
  const auto* problem = std::get_if<HeadProblem>(&checked);
  return problem ? problem->error_code : "";
}

RequestHead accepted(const std::string& raw) {
  auto checked = check_head(raw, kMaxBody);
  const auto* problem = std::get_if<HeadProblem>(&checked);
  EXPECT_EQ(problem, nullptr) << (problem ? problem->detail : "");
  return problem ? RequestHead{} : std::get<RequestHead>(checked);
}

TEST(RequestHead, OrdinaryRequest) {
  const RequestHead head =
      accepted("POST /v1/frames?a=b HTTP/1.1\r\nHost: x\r\nContent-Length: 12\r\nAccept:  image/png \r\n\r\n");
  EXPECT_EQ(head.method, "POST");
  EXPECT_EQ(head.target, "/v1/frames?a=b");
  EXPECT_EQ(head.headers.find("accept")->second, "image/png");
  EXPECT_FALSE(head.close);
  EXPECT_EQ(head.text, "POST /v1/frames?a=b HTTP/1.1\r\nhost: x\r\naccept: image/png\r\ncontent-length: 12\r\n\r\n");
  EXPECT_EQ(head.body_bytes, 12u);
  EXPECT_FALSE(head.chunked);
}

TEST(RequestHead, RangesAndCodingsAreHiddenFromTheLibrary) {
  const RequestHead head =
      accepted("GET / HTTP/1.1\r\nHost: x\r\nRange: bytes=0-1\r\nIf-Range: \"a\"\r\nAccept-Encoding: gzip\r\n\r\n");
  EXPECT_EQ(head.text, "GET / HTTP/1.1\r\nhost: x\r\n\r\n");
  EXPECT_EQ(head.headers.count("range"), 1u);
}

TEST(RequestHead, TheLibrarySeesOneCanonicalLength) {
  const auto framing = [](const std::string& version, const std::string& headers) {
    const std::string start = "POST / HTTP/" + version + "\r\nhost: x\r\n";
    const std::string text = accepted("POST / HTTP/" + version + "\r\nHost: x\r\n" + headers + "\r\n").text;
    EXPECT_EQ(text.substr(0, start.size()), start);
    return text.substr(start.size());
  };
  EXPECT_EQ(framing("1.1", ""), "content-length: 0\r\n\r\n");
  EXPECT_EQ(framing("1.1", "Content-Length: 07\r\n"), "content-length: 7\r\n\r\n");
  EXPECT_EQ(framing("1.1", "Transfer-Encoding: Chunked\r\n"), "transfer-encoding: chunked\r\n\r\n");
  EXPECT_EQ(framing("1.1", "Content-Length: 7\r\nExpect: 100-Continue\r\n"),
            "content-length: 7\r\nexpect: 100-continue\r\n\r\n");
  EXPECT_EQ(framing("1.1", "Expect: 100-Continue\r\n"), "content-length: 0\r\n\r\n") << "there is nothing to wait for";
  EXPECT_EQ(framing("1.0", "Content-Length: 7\r\nExpect: 100-continue\r\n"), "content-length: 7\r\n\r\n");
  EXPECT_EQ(framing("1.1", "Content-Type: multipart/form-data; boundary=x\r\n"), "content-length: 0\r\n\r\n")
      << "no body is a form";
}

TEST(RequestHead, ConnectionsEnd) {
  EXPECT_TRUE(accepted("GET / HTTP/1.1\r\nHost: x\r\nConnection: Close\r\n\r\n").close);
  EXPECT_TRUE(accepted("GET / HTTP/1.1\r\nHost: x\r\nConnection: keep-alive\r\nConnection: x , close\r\n\r\n").close);
  EXPECT_FALSE(accepted("GET / HTTP/1.1\r\nHost: x\r\nConnection: keep-alive, closed\r\n\r\n").close);
  EXPECT_TRUE(accepted("GET / HTTP/1.0\r\n\r\n").close);
  EXPECT_TRUE(accepted("GET / HTTP/1.1\r\nHost: x\r\nContent-Length: 3\r\n\r\n").close) << "its body is never read";
}

TEST(RequestHead, AbsoluteFormMeansItsPath) {
  EXPECT_EQ(accepted("GET http://h:1/a?b HTTP/1.1\r\nHost: h\r\n\r\n").target, "/a?b");
  EXPECT_EQ(accepted("GET http://h HTTP/1.1\r\nHost: h\r\n\r\n").target, "/");
}

TEST(RequestHead, AmbiguousLengthsAreRefused) {
  for (const char* lengths :
       {"Content-Length: 1\r\nContent-Length: 1\r\n", "Content-Length: 1\r\nTransfer-Encoding: chunked\r\n",
        "Content-Length: +1\r\n", "Content-Length: 1, 1\r\n", "Content-Length: \r\n", "Content-Length: 0x1\r\n",
        "Transfer-Encoding: gzip, chunked\r\n", "Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n",
        "Transfer-Encoding: xchunked\r\n", "Transfer-Encoding: \"chunked\"\r\n", "Content-Length : 1\r\n",
        "X: a\r\n Content-Length: 1\r\n"}) {
    EXPECT_EQ(refusal(std::string("POST / HTTP/1.1\r\nHost: x\r\n") + lengths + "\r\n"), "malformed_request")
        << lengths;
  }
}

TEST(RequestHead, Http10HasNoTransferEncoding) {
  EXPECT_EQ(refusal("POST / HTTP/1.0\r\nTransfer-Encoding: chunked\r\n\r\n"), "malformed_request");
  EXPECT_EQ(refusal("POST / HTTP/1.0\r\nContent-Length: 1\r\n\r\n"), "");
}

TEST(RequestHead, MethodsThatHttpDoesNotHaveAreNotImplemented) {
  for (const char* method : {"BREW", "get", "PRI", "PROPFIND"})
    EXPECT_EQ(refusal(std::string(method) + " / HTTP/1.1\r\nHost: x\r\n\r\n"), "not_implemented") << method;
  for (const char* method : {"GET", "HEAD", "POST", "PUT", "DELETE", "CONNECT", "OPTIONS", "TRACE", "PATCH"})
    EXPECT_EQ(refusal(std::string(method) + " / HTTP/1.1\r\nHost: x\r\n\r\n"), "") << method;
}

TEST(RequestHead, TooMuchIsRefused) {
  EXPECT_EQ(refusal("GET / HTTP/1.1\r\nHost: x\r\nA: " + std::string(9000, 'a') + "\r\n\r\n"), "headers_too_large");
  EXPECT_EQ(refusal("GET / HTTP/1.1\r\nHost: x\r\nA: " + std::string(7000, 'a') + "\r\n\r\n"), "");

  EXPECT_EQ(refusal("POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 1001\r\n\r\n"), "too_large");
  EXPECT_EQ(refusal("POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 99999999999999999999999\r\n\r\n"), "too_large");
  EXPECT_EQ(refusal("POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\n\r\n"), "");
  EXPECT_EQ(refusal("GET /" + std::string(3000, 'a') + " HTTP/1.1\r\nHost: x\r\n\r\n"), "uri_too_long");
}

TEST(RequestHead, CodedBodiesAreRefused) {
  EXPECT_EQ(refusal("POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 1\r\nContent-Encoding: gzip\r\n\r\n"),
            "unsupported_media_type");
  EXPECT_EQ(refusal("POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 1\r\nContent-Encoding: identity\r\n\r\n"), "");
}

TEST(RequestHead, NoiseIsRefused) {
  for (const char* raw :
       {"\r\n", "garbage\r\n\r\n", "GET / HTTP/2.0\r\nHost: x\r\n\r\n", "GET  HTTP/1.1\r\nHost: x\r\n\r\n",
        "G@T / HTTP/1.1\r\nHost: x\r\n\r\n", "GET / HTTP/1.1\r\n\r\n", "GET / HTTP/1.1\r\nHost: x\r\nHost: y\r\n\r\n",
        "GET /a b HTTP/1.1\r\nHost: x\r\n\r\n", "GET /\x01 HTTP/1.1\r\nHost: x\r\n\r\n",
        "GET / HTTP/1.1\nHost: x\r\n\r\n", "GET / HTTP/1.1\r\nHost: x\r\nA: b\nC: d\r\n\r\n"}) {
    EXPECT_EQ(refusal(raw), "malformed_request") << raw;
  }
}

}  // namespace
}  // namespace selenograph::server
