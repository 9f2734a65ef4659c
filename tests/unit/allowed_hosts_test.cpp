// Whom a request may be addressed to, and which pages may ask: names, addresses, ports, and what is no host at all.
#include "server/http/allowed_hosts.h"

#include <gtest/gtest.h>

namespace selenograph::server {
namespace {

std::string refusal(const AllowedHosts& hosts, const Headers& headers, const std::string& local = "127.0.0.1") {
  const auto refused = hosts.refusal(headers, local);
  return refused ? refused->error_code : "";
}

std::string of_host(const AllowedHosts& hosts, const std::string& host, const std::string& local = "127.0.0.1") {
  return refusal(hosts, {{"host", host}}, local);
}

std::string of_origin(const AllowedHosts& hosts, const std::string& host, const std::string& origin) {
  return refusal(hosts, {{"host", host}, {"origin", origin}});
}

TEST(AllowedHosts, LoopbackHasItsNames) {
  const AllowedHosts hosts("127.0.0.1", {});
  for (const char* host : {"localhost", "localhost:8080", "LocalHost", "localhost.", "localhost.:8080", "127.0.0.1",
                           "127.0.0.1:1", "127.0.0.1:", "[::1]", "[::1]:8080", "[0:0:0:0:0:0:0:1]"})
    EXPECT_EQ(of_host(hosts, host), "") << host;
  for (const char* host : {"evil.example", "evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example",
                           "xlocalhost", "127.0.0.2", "0.0.0.0", "[::]", "[::2]", "2130706433", "127.1", "0x7f.0.0.1",
                           "127.0.0.1..", "localhost..", "local_host"})
    EXPECT_EQ(of_host(hosts, host), "misdirected_request") << host;
}

TEST(AllowedHosts, RejectsInvalidAuthorities) {
  const AllowedHosts hosts("127.0.0.1", {});
  for (const char* host : {"",
                           ":8080",
                           "localhost:x",
                           "localhost:-1",
                           "localhost:+1",
                           "localhost:65536",
                           "localhost:80:80",
                           "localhost/",
                           "user@localhost",
                           "localhost, evil.example",
                           "[::1",
                           "::1",
                           "[::1]x",
                           "[localhost]",
                           "[]",
                           "local host",
                           "localhost%00",
                           "localh\xc3\xb6st",
                           "\"localhost\"",
                           "<localhost>"})
    EXPECT_EQ(of_host(hosts, host), "malformed_request") << host;
}

TEST(AllowedHosts, LocalAddressOfTheConnectionIsAllowed) {
  const AllowedHosts everywhere("0.0.0.0", {});
  EXPECT_EQ(of_host(everywhere, "10.1.2.3:8080", "10.1.2.3"), "");
  EXPECT_EQ(of_host(everywhere, "[FD00:0::1]", "fd00::1"), "");
  EXPECT_EQ(of_host(everywhere, "10.1.2.4", "10.1.2.3"), "misdirected_request");
  EXPECT_EQ(of_host(everywhere, "evil.example", "10.1.2.3"), "misdirected_request") << "a name may mean any address";
  EXPECT_EQ(of_host(everywhere, "0.0.0.0:8080", "127.0.0.1"), "") << "as the service prints it";
  EXPECT_EQ(of_host(everywhere, "localhost", ""), "");
}

TEST(AllowedHosts, ConfiguredNamesAreAllowed) {
  const AllowedHosts hosts("moon.example", {"Team.Example.", "10.0.0.7", "[fd00::1]", "fd00::2"});
  for (const char* host : {"moon.example", "moon.example:80", "MOON.EXAMPLE.", "team.example", "10.0.0.7",
                           "[fd00::1]:1", "[fd00:0::2]", "localhost"})
    EXPECT_EQ(of_host(hosts, host), "") << host;
  for (const char* host : {"example", "a.team.example", "team.example.org"})
    EXPECT_EQ(of_host(hosts, host), "misdirected_request") << host;
}

TEST(AllowedHosts, ParsesTheOption) {
  for (const char* host : {"a", "a.example", "10.0.0.1", "::1", "[::1]", "a_b"}) EXPECT_TRUE(is_host(host)) << host;
  for (const char* host : {"", "http://a", "a:80", "a/b", "[a]", "a b", "[::1]:80", "a@b"})
    EXPECT_FALSE(is_host(host)) << host;
}

TEST(AllowedHosts, ARequestWithoutHostPasses) {
  const AllowedHosts hosts("127.0.0.1", {});
  EXPECT_EQ(refusal(hosts, {}), "");
  EXPECT_EQ(refusal(hosts, {{"origin", "http://localhost"}}), "foreign_origin") << "the own origin is not known";
}

TEST(AllowedHosts, OwnOriginIsAllowed) {
  const AllowedHosts hosts("127.0.0.1", {});
  for (const auto& [host, origin] : {std::pair("localhost:8080", "http://localhost:8080"),
                                     {"127.0.0.1:8080", "http://127.0.0.1:8080"},
                                     {"[::1]:8080", "http://[::1]:8080"},
                                     {"localhost", "http://localhost"},
                                     {"localhost", "https://localhost"},
                                     {"localhost:80", "http://localhost"},
                                     {"localhost:443", "https://localhost"},
                                     {"LOCALHOST:9000", "https://localhost:9000"}})
    EXPECT_EQ(of_origin(hosts, host, origin), "") << origin;
  for (const auto& [host, origin] : {std::pair("localhost:8080", "http://evil.example"),
                                     {"localhost:8080", "http://evil.example:8080"},
                                     {"localhost:8080", "http://localhost:3000"},
                                     {"localhost:8080", "http://localhost"},
                                     {"localhost:8080", "http://127.0.0.1:8080"},
                                     {"localhost:80", "https://localhost"},
                                     {"localhost:8080", "null"},
                                     {"localhost:8080", ""},
                                     {"localhost:8080", "localhost:8080"},
                                     {"localhost:8080", "http://localhost:8080/"},
                                     {"localhost:8080", "http://localhost:8080 http://evil.example"},
                                     {"localhost:8080", "ftp://localhost:8080"},
                                     {"localhost:8080", "file://"}})
    EXPECT_EQ(of_origin(hosts, host, origin), "foreign_origin") << origin;
  EXPECT_EQ(refusal(hosts, {{"host", "localhost"}, {"origin", "http://localhost"}, {"origin", "http://evil.example"}}),
            "foreign_origin")
      << "each of several";
}

TEST(AllowedHosts, ConfiguredOriginsAreAllowed) {
  const AllowedHosts hosts("moon.example", {"viewer.example"});
  EXPECT_EQ(of_origin(hosts, "127.0.0.1:8080", "https://viewer.example"), "") << "a proxy that rewrites Host";
  EXPECT_EQ(of_origin(hosts, "127.0.0.1:8080", "http://viewer.example:3000"), "");
  EXPECT_EQ(of_origin(hosts, "127.0.0.1:8080", "http://a.viewer.example"), "foreign_origin");
  EXPECT_EQ(of_origin(hosts, "127.0.0.1:8080", "http://moon.example"), "foreign_origin") << "not by --host alone";
}

TEST(AllowedHosts, RefusalsNameTheHostAndTheOption) {
  const AllowedHosts hosts("127.0.0.1", {});
  const auto host = hosts.refusal({{"host", "Evil.example:1"}}, ""),
             page = hosts.refusal({{"host", "localhost"}, {"origin", "null"}}, "");
  ASSERT_TRUE(host && page);
  EXPECT_NE(host->detail.find("\"evil.example\""), std::string::npos) << host->detail;
  EXPECT_NE(host->detail.find("--allowed-host"), std::string::npos) << host->detail;
  EXPECT_NE(page->detail.find("\"null\""), std::string::npos) << page->detail;
  EXPECT_NE(page->detail.find("--allowed-host"), std::string::npos) << page->detail;
}

}  // namespace
}  // namespace selenograph::server
