// Whom a request may be addressed to, and which pages may ask: names, addresses, ports, and what is no host at all.
#include "server/http/access.h"

#include <gtest/gtest.h>

#include <optional>
#include <set>
#include <string>
#include <vector>

namespace selenograph::server {
namespace {

// Loopback's names, --host and the connection's own address, and those of --allowed-host.
struct AllowedHosts {
  std::string listens_on;
  std::vector<std::string> allowed;
};

std::optional<api::Response> refused(const AllowedHosts& hosts, const Headers& headers, const std::string& local) {
  return refusal_by_host(headers, {"localhost", "127.0.0.1", "::1", hosts.listens_on, local}, hosts.allowed);
}

std::string refusal(const AllowedHosts& hosts, const Headers& headers, const std::string& local = "127.0.0.1") {
  const auto problem = refused(hosts, headers, local);
  return problem ? problem->error_code : "";
}

std::string of_host(const AllowedHosts& hosts, const std::string& host, const std::string& local = "127.0.0.1") {
  return refusal(hosts, {{"host", host}}, local);
}

std::string of_origin(const AllowedHosts& hosts, const std::string& host, const std::string& origin) {
  return refusal(hosts, {{"host", host}, {"origin", origin}});
}

TEST(AllowedHosts, LoopbackHasItsNames) {
  const AllowedHosts hosts{"127.0.0.1", {}};
  for (const char* host : {"localhost", "localhost:8080", "LocalHost", "localhost.", "localhost.:8080", "127.0.0.1",
                           "127.0.0.1:1", "127.0.0.1:", "[::1]", "[::1]:8080"})
    EXPECT_EQ(of_host(hosts, host), "") << host;
  for (const char* host : {"evil.example", "evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example",
                           "xlocalhost", "127.0.0.2", "0.0.0.0", "[::]", "[::2]", "2130706433", "127.1", "0x7f.0.0.1",
                           "127.0.0.1..", "localhost..", "local_host"})
    EXPECT_EQ(of_host(hosts, host), "misdirected_request") << host;
}

TEST(AllowedHosts, InvalidAuthoritiesAreNobodysName) {
  const AllowedHosts hosts{"127.0.0.1", {}};
  for (const char* host : {"", ":8080", "localhost:80:80", "localhost/", "user@localhost", "localhost, evil.example",
                           "[::1", "[::1]x", "[]", "local host", "localhost%00", "localh\xc3\xb6st", "\"localhost\"",
                           "<localhost>", "evil.example:localhost", "[evil.example]:80"})
    EXPECT_EQ(of_host(hosts, host), "misdirected_request") << host;
}

TEST(AllowedHosts, LocalAddressOfTheConnectionIsAllowed) {
  const AllowedHosts everywhere{"0.0.0.0", {}};
  EXPECT_EQ(of_host(everywhere, "10.1.2.3:8080", "10.1.2.3"), "");
  EXPECT_EQ(of_host(everywhere, "[FD00::1]:80", "fd00::1"), "");
  EXPECT_EQ(of_host(everywhere, "10.1.2.4", "10.1.2.3"), "misdirected_request");
  EXPECT_EQ(of_host(everywhere, "evil.example", "10.1.2.3"), "misdirected_request") << "a name may mean any address";
  EXPECT_EQ(of_host(everywhere, "0.0.0.0:8080", "127.0.0.1"), "") << "as the service prints it";
  EXPECT_EQ(of_host(everywhere, "localhost", ""), "");
}

TEST(AllowedHosts, ConfiguredNamesAreAllowed) {
  const AllowedHosts hosts{"moon.example", {"Team.Example.", "10.0.0.7", "[fd00::1]", "fd00::2"}};
  for (const char* host : {"moon.example", "moon.example:80", "MOON.EXAMPLE.", "team.example", "10.0.0.7",
                           "[fd00::1]:1", "[fd00::2]", "localhost"})
    EXPECT_EQ(of_host(hosts, host), "") << host;
  for (const char* host : {"example", "a.team.example", "team.example.org"})
    EXPECT_EQ(of_host(hosts, host), "misdirected_request") << host;
}

TEST(AllowedHosts, ARequestWithoutHostPasses) {
  const AllowedHosts hosts{"127.0.0.1", {}};
  EXPECT_EQ(refusal(hosts, {}), "");
  EXPECT_EQ(refusal(hosts, {{"origin", "http://localhost"}}), "foreign_origin") << "the own origin is not known";
}

TEST(AllowedHosts, OwnOriginIsAllowed) {
  const AllowedHosts hosts{"127.0.0.1", {}};
  for (const auto& [host, origin] : {std::pair("localhost:8080", "http://localhost:8080"),
                                     {"127.0.0.1:8080", "http://127.0.0.1:8080"},
                                     {"[::1]:8080", "http://[::1]:8080"},
                                     {"localhost", "http://localhost"},
                                     {"localhost", "https://localhost"},
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
  const AllowedHosts hosts{"moon.example", {"viewer.example"}};
  EXPECT_EQ(of_origin(hosts, "127.0.0.1:8080", "https://viewer.example"), "") << "a proxy that rewrites Host";
  EXPECT_EQ(of_origin(hosts, "127.0.0.1:8080", "http://viewer.example:3000"), "");
  EXPECT_EQ(of_origin(hosts, "127.0.0.1:8080", "http://a.viewer.example"), "foreign_origin");
  EXPECT_EQ(of_origin(hosts, "127.0.0.1:8080", "http://moon.example"), "foreign_origin") << "not by --host alone";
}

TEST(AllowedHosts, RefusalsNameTheHostAndTheOption) {
  const AllowedHosts hosts{"127.0.0.1", {}};
  const auto host = refused(hosts, {{"host", "Evil.example:1"}}, "");
  const auto page = refused(hosts, {{"host", "localhost"}, {"origin", "null"}}, "");
  ASSERT_TRUE(host && page);
  EXPECT_NE(host->body.find("evil.example"), std::string::npos) << host->body;
  EXPECT_NE(host->body.find("--allowed-host"), std::string::npos) << host->body;
  EXPECT_NE(page->body.find("null"), std::string::npos) << page->body;
  EXPECT_NE(page->body.find("--allowed-host"), std::string::npos) << page->body;
}

TEST(Client, ANameIsTakenIfItIsSafeEverywhere) {
  for (const std::string& good : {std::string("a"), std::string("frame-17.b_C"), std::string(64, 'x')})
    EXPECT_EQ(plain_name({{"x-request-id", good}}, "x-request-id"), good);
  EXPECT_EQ(plain_name({}, "x-request-id"), "");
  EXPECT_EQ(plain_name({{"x-request-id", "one"}, {"x-request-id", "two"}}, "x-request-id"), "");
  for (const std::string& bad :
       std::vector<std::string>{"", "two words", "a\"b", "a/b", "a\nb", "\xc3\xa9", "a,b", std::string(65, 'x')})
    EXPECT_EQ(plain_name({{"x-request-id", bad}}, "x-request-id"), "") << bad;
  const std::string made = new_request_id();
  EXPECT_NE(made, new_request_id());
  EXPECT_EQ(plain_name({{"x-request-id", made}}, "x-request-id"), made);
}

TEST(Client, LoopbackIsThisMachineAlone) {
  for (const char* here : {"127.0.0.1", "127.8.9.1", "::1"}) EXPECT_TRUE(is_loopback(here)) << here;
  for (const char* other : {"10.0.0.1", "fd00::1", "", "::", "128.0.0.1"}) EXPECT_FALSE(is_loopback(other)) << other;
}

}  // namespace
}  // namespace selenograph::server
