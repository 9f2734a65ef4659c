// Request-Timeout-Ms shortens the service's deadline and nothing else.
#include <gtest/gtest.h>

#include "api/message/message.h"

namespace selenograph::api {
namespace {

using std::chrono::milliseconds;

std::optional<milliseconds> allowed(std::initializer_list<const char*> headers) {
  Limits limits;
  limits.default_deadline = milliseconds(1000);
  Request request;
  for (const char* text : headers) request.headers.emplace("request-timeout-ms", text);
  return time_limit(request, limits);
}

TEST(TimeAllowed, IsAtMostTheServicesDeadline) {
  EXPECT_EQ(allowed({}), milliseconds(1000));
  EXPECT_EQ(allowed({"1"}), milliseconds(1));
  EXPECT_EQ(allowed({"250"}), milliseconds(250));
  EXPECT_EQ(allowed({"1001"}), milliseconds(1000));
  EXPECT_EQ(allowed({"9223372036854775807"}), milliseconds(1000));
}

TEST(TimeAllowed, RejectsInvalidTimes) {
  for (const char* text : {"0", "-1", "1.5", "1e3", "1s", " 1", "soon", "9223372036854775808"})
    EXPECT_EQ(allowed({text}), std::nullopt) << text;
  EXPECT_EQ(allowed({"1", "2"}), std::nullopt);
}

}  // namespace
}  // namespace selenograph::api
