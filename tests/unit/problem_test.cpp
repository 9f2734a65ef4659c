#include "api/problem.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>

namespace selenograph::api {
namespace {

TEST(ErrorTable, CodesAndMetricsAreUniqueAndStatusesAreErrors) {
  std::set<std::string_view> codes, metrics;
  for (const ErrorRow& row : error_table()) {
    EXPECT_TRUE(codes.insert(row.code).second) << row.code;
    EXPECT_TRUE(metrics.insert(row.metric).second) << row.metric;
    EXPECT_GE(row.status, 400) << row.code;
    EXPECT_LT(row.status, 600) << row.code;
    EXPECT_FALSE(row.title.empty() || row.meaning.empty()) << row.code;
  }
}

TEST(ErrorTable, HoldsTheContractsStatuses) {
  std::set<int> statuses;
  for (const ErrorRow& row : error_table()) statuses.insert(row.status);
  for (const int status : {400, 404, 405, 406, 413, 415, 422, 500, 503, 504})
    EXPECT_TRUE(statuses.contains(status)) << status;
}

TEST(Problem, IsRfc9457) {
  const Response response = problem("invalid_request", "two faults", {{"/a", "is wrong"}, {"/b/0", "is missing"}});
  EXPECT_EQ(response.status, 422);
  EXPECT_EQ(response.content_type, "application/problem+json");
  EXPECT_EQ(response.error_code, "invalid_request");
  const auto body = nlohmann::json::parse(response.body);
  EXPECT_EQ(body.at("type"), "urn:selenograph:problem:invalid_request");
  EXPECT_EQ(body.at("title"), "Invalid request");
  EXPECT_EQ(body.at("status"), 422);
  EXPECT_EQ(body.at("detail"), "two faults");
  ASSERT_EQ(body.at("errors").size(), 2u);
  EXPECT_EQ(body.at("errors")[1].at("pointer"), "/b/0");
  EXPECT_EQ(body.at("errors")[1].at("detail"), "is missing");
}

TEST(Problem, WithoutFindingsHasNoErrors) {
  const auto body = nlohmann::json::parse(problem("busy", "8 requests are waiting").body);
  EXPECT_EQ(body.at("status"), 503);
  EXPECT_FALSE(body.contains("errors"));
}

TEST(Problem, AnUnknownCodeIsOurFault) { EXPECT_EQ(problem("no_such_code", "x").status, 500); }

TEST(Problem, QuotesBytesThatAreNoUtf8) {
  const Response response = problem("malformed_json", "unexpected '\xff\xc3('", {{"/\xff", "\x80"}});
  EXPECT_EQ(nlohmann::json::parse(response.body).at("status"), 400);
}

TEST(Findings, OneIsNamedInTheDetailAndManyAreCounted) {
  Findings findings;
  EXPECT_NO_THROW(findings.throw_if_any());
  findings.add("/camera/width", "must be an integer");
  try {
    findings.throw_if_any();
    FAIL();
  } catch (const RequestError& e) {
    EXPECT_EQ(e.code(), "invalid_request");
    EXPECT_STREQ(e.what(), "/camera/width: must be an integer");
  }
  for (int i = 0; i < 100; ++i) findings.add("/x", "y");
  try {
    findings.throw_if_any();
    FAIL();
  } catch (const RequestError& e) {
    EXPECT_EQ(e.findings().size(), Findings::kMost);
    EXPECT_STREQ(e.what(), "20 or more members are at fault; see errors");
  }
}

}  // namespace
}  // namespace selenograph::api
