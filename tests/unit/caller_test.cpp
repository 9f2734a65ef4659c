#include "server/http/caller.h"

#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

namespace selenograph::server {
namespace {

TEST(Caller, RequestIdIsTakenIfItIsSafeEverywhere) {
  for (const std::string& good : {std::string("a"), std::string("frame-17.b_C"), std::string(64, 'x')})
    EXPECT_EQ(request_id_of({{"x-request-id", good}}), good);
  std::set<std::string> made{request_id_of({}), request_id_of({{"x-request-id", "one"}, {"x-request-id", "two"}})};
  const std::vector<std::string> bad{"", "two words", "a\"b", "a/b", "a\nb", "\xc3\xa9", "a,b", std::string(65, 'x')};
  for (const std::string& id : bad) made.insert(request_id_of({{"x-request-id", id}}));
  EXPECT_EQ(made.size(), 2 + bad.size()) << "each is new";
  for (const std::string& id : made) EXPECT_EQ(request_id_of({{"x-request-id", id}}), id);
}

TEST(Caller, ATokenHasOneName) {
  EXPECT_EQ(token_of({{"selenograph-token", "flight-team"}}), "flight-team");
  EXPECT_EQ(token_of({}), "");
  EXPECT_EQ(token_of({{"selenograph-token", ""}}), "");
  EXPECT_EQ(token_of({{"selenograph-token", "a"}, {"selenograph-token", "b"}}), "");
}

TEST(Caller, LoopbackIsThisMachineAlone) {
  for (const char* here : {"127.0.0.1", "127.8.9.1", "::1"}) EXPECT_TRUE(is_loopback(here)) << here;
  for (const char* other : {"10.0.0.1", "fd00::1", "", "::", "128.0.0.1"}) EXPECT_FALSE(is_loopback(other)) << other;
}

}  // namespace
}  // namespace selenograph::server
