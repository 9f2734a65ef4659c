#include "server/http/caller.h"

#include <gtest/gtest.h>

#include <set>

namespace selenograph::server {
namespace {

TEST(Caller, NamesAreSafeEverywhere) {
  for (const char* good : {"a", "frame-17.b_C", "0"}) EXPECT_TRUE(is_plain_name(good)) << good;
  EXPECT_TRUE(is_plain_name(std::string(64, 'x')));
  EXPECT_FALSE(is_plain_name(std::string(65, 'x')));
  for (const char* bad : {"", "two words", "a\"b", "a/b", "a\nb", "\xc3\xa9", "a,b"})
    EXPECT_FALSE(is_plain_name(bad)) << bad;
}

TEST(Caller, RequestIdIsTakenOrGenerated) {
  EXPECT_EQ(request_id_of({{"x-request-id", "mine"}}), "mine");
  std::set<std::string> made;
  for (const Headers& headers :
       {Headers{}, Headers{{"x-request-id", "two words"}}, Headers{{"x-request-id", "one"}, {"x-request-id", "two"}}}) {
    made.insert(request_id_of(headers));
  }
  EXPECT_EQ(made.size(), 3u);
  for (const std::string& id : made) EXPECT_TRUE(is_plain_name(id)) << id;
}

TEST(Caller, ATokenHasOneName) {
  EXPECT_EQ(token_of({{"selenograph-token", "flight-team"}}), "flight-team");
  EXPECT_EQ(token_of({}), "");
  EXPECT_EQ(token_of({{"selenograph-token", ""}}), "");
  EXPECT_EQ(token_of({{"selenograph-token", "a"}, {"selenograph-token", "b"}}), "");
}

TEST(Caller, TrustedProxiesAreLoopbackAndConfigured) {
  for (const char* here : {"127.0.0.1", "127.8.9.1", "::1", "::ffff:127.0.0.1"})
    EXPECT_TRUE(is_trusted_proxy(here, {}));
  for (const char* other : {"10.0.0.1", "::ffff:10.0.0.1", "fd00::1", "", "::"})
    EXPECT_FALSE(is_trusted_proxy(other, {}));
  EXPECT_TRUE(is_trusted_proxy("::ffff:10.0.0.1", {"10.0.0.1"}));
  EXPECT_TRUE(is_trusted_proxy("fd00::1", {"10.0.0.1", "fd00::1"}));
  EXPECT_FALSE(is_trusted_proxy("10.0.0.11", {"10.0.0.1"}));
}

}  // namespace
}  // namespace selenograph::server
