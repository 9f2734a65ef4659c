#include "server/http/request_head.h"

#include <gtest/gtest.h>

namespace selenograph::server {
namespace {

constexpr std::size_t kMaxBodyBytes = 1000;

RequestHead head_with(Headers headers, const std::string& method = "POST", bool http_1_0 = false) {
  if (!http_1_0 && !headers.contains("host")) headers.emplace("host", "x");
  return {method, "/", http_1_0, std::move(headers)};
}

std::string code_of(const RequestHead& head) {
  const auto refusal = refusal_of(head, kMaxBodyBytes);
  return refusal ? refusal->error_code : "";
}

TEST(RequestHead, ContradictoryFramingIsRefused) {
  using Lines = Headers;
  for (const Headers& headers :
       {Lines{{"content-length", "1"}, {"content-length", "1"}},
        Lines{{"content-length", "1"}, {"transfer-encoding", "chunked"}},
        Lines{{"transfer-encoding", "chunked"}, {"transfer-encoding", "chunked"}},
        Lines{{"transfer-encoding", "gzip, chunked"}}, Lines{{"transfer-encoding", "xchunked"}},
        Lines{{"content-length", "+1"}}, Lines{{"content-length", "1, 1"}}, Lines{{"content-length", "0x1"}},
        Lines{{"content-length ", "1"}}, Lines{{" content-length", "1"}}, Lines{{"host", "x"}, {"host", "x"}}})
    EXPECT_EQ(code_of(head_with(headers)), "malformed_request") << headers.begin()->first << headers.begin()->second;
  EXPECT_EQ(code_of(head_with({{"transfer-encoding", "chunked"}}, "POST", true)), "malformed_request");
  EXPECT_EQ(code_of({"GET", "/", false, {}}), "malformed_request") << "no Host";
  EXPECT_EQ(code_of({"GET", "/", true, {}}), "");
  EXPECT_EQ(code_of(head_with({{"transfer-encoding", "Chunked"}})), "");
}

TEST(RequestHead, LengthsAreBounded) {
  EXPECT_EQ(code_of(head_with({{"content-length", "1000"}})), "");
  EXPECT_EQ(code_of(head_with({{"content-length", "1001"}})), "too_large");
  EXPECT_EQ(code_of(head_with({{"content-length", "99999999999999999999999"}})), "too_large");
  EXPECT_EQ(code_of({"GET", "/" + std::string(3000, 'a'), false, {{"host", "x"}}}), "uri_too_long");
  EXPECT_EQ(code_of({"GET", "/\x1b", false, {{"host", "x"}}}), "malformed_request");
}

TEST(RequestHead, MethodsThatHttpDoesNotHaveAreNotImplemented) {
  for (const char* method : {"PRI", "get"}) EXPECT_EQ(code_of(head_with({}, method)), "not_implemented") << method;
  for (const char* method : {"GET", "HEAD", "PUT", "TRACE"}) EXPECT_EQ(code_of(head_with({}, method)), "") << method;
}

TEST(RequestHead, CodedBodiesAreRefused) {
  EXPECT_EQ(code_of(head_with({{"content-encoding", "gzip"}})), "unsupported_media_type");
  EXPECT_EQ(code_of(head_with({{"content-encoding", "identity"}})), "");
}

TEST(RequestHead, ConnectionsEnd) {
  EXPECT_TRUE(ends_connection(head_with({{"connection", "Close"}})));
  EXPECT_TRUE(ends_connection(head_with({{"connection", "keep-alive"}, {"connection", "x , close"}})));
  EXPECT_FALSE(ends_connection(head_with({{"connection", "keep-alive"}})));
  EXPECT_TRUE(ends_connection(head_with({}, "GET", true)));
  EXPECT_TRUE(ends_connection(head_with({{"content-length", "3"}}, "GET"))) << "its body is never read";
  EXPECT_FALSE(ends_connection(head_with({{"content-length", "3"}})));
}

TEST(RequestHead, AbsoluteFormMeansItsPath) {
  RequestHead head{"GET", "http://h:1/a?b", false, {{"host", "x"}}};
  EXPECT_EQ(resolve_authority(head), "/a?b");
  EXPECT_EQ(head.authority, "h:1");
  head.target = "https://h";
  EXPECT_EQ(resolve_authority(head), "/");
  head.target = "/c";
  EXPECT_EQ(resolve_authority(head), "/c");
  EXPECT_EQ(head.authority, "x");
}

}  // namespace
}  // namespace selenograph::server
