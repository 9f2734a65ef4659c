#include "api/message/problem.h"

#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <cerrno>
#include <new>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include "api/endpoints/endpoint.h"
#include "api/endpoints/routes.h"
#include "dem/base/error.h"

namespace selenograph::api {
namespace {

TEST(ErrorTable, CodesAreUniqueAndStatusesAreErrors) {
  std::set<std::string_view> codes;
  for (const ErrorRow& row : error_table()) {
    EXPECT_TRUE(codes.insert(row.code).second) << row.code;
    EXPECT_GE(row.status, 400) << row.code;
    EXPECT_LT(row.status, 600) << row.code;
    EXPECT_FALSE(row.title.empty() || row.meaning.empty()) << row.code;
  }
}

TEST(ErrorTable, HoldsTheContractsStatuses) {
  std::set<int> statuses;
  for (const ErrorRow& row : error_table()) statuses.insert(row.status);
  for (const int status : {400, 403, 404, 405, 406, 413, 415, 421, 422, 500, 503, 504})
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

TEST(Problem, UnknownCodesAreInternalErrors) { EXPECT_EQ(problem("no_such_code", "x").status, 500); }

TEST(Problem, EscapesInvalidUtf8) {
  const Response response = problem("malformed_json", "unexpected '\xff\xc3('", {{"/\xff", "\x80"}});
  EXPECT_EQ(nlohmann::json::parse(response.body).at("status"), 400);
}

TEST(Findings, DetailNamesOneFindingOrCountsMany) {
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
    EXPECT_EQ(e.findings().size(), Findings::kMaxEntries);
    EXPECT_STREQ(e.what(), "20 or more invalid members; see errors");
  }
}

// Of each kind of exception what a client is told: by its type, whatever its text says.
struct Thrown {
  const char* what;
  std::function<Response()> work;
  int status;
  const char* code;
};

template <typename Error, typename... Arguments>
std::function<Response()> throwing(Arguments... arguments) {
  return [=]() -> Response { throw Error(arguments...); };
}

std::function<Response()> failing(int error) {
  return [=]() -> Response { throw std::system_error(error, std::generic_category()); };
}

TEST(AnswerOrProblem, TypesDecideTheStatus) {
  const std::string text = "ask for a larger max_error_px";
  for (const Thrown& t : {Thrown{"RequestError", throwing<RequestError>("too_large", text), 413, "too_large"},
                          {"ImpossibleRequest", throwing<ImpossibleRequest>(text), 422, "invalid_request"},
                          {"TooMuchTerrain", throwing<TooMuchTerrain>(text), 422, "invalid_request"},
                          {"DataError", throwing<DataError>("tile.img", text), 500, "terrain_data_error"},
                          {"Cancelled", throwing<Cancelled>(), 504, "deadline_exceeded"},
                          {"std::bad_alloc", throwing<std::bad_alloc>(), 503, "out_of_memory"},
                          {"std::length_error", throwing<std::length_error>(text), 503, "out_of_memory"},
                          {"no thread", failing(EAGAIN), 503, "out_of_memory"},
                          {"std::system_error", failing(EIO), 500, "internal"},
                          {"std::invalid_argument", throwing<std::invalid_argument>(text), 500, "internal"},
                          {"std::out_of_range", throwing<std::out_of_range>(text), 500, "internal"},
                          {"int", [](auto...) -> Response { throw 1; }, 500, "internal"}}) {
    const Response response = answer_or_problem(Request{}, t.work);
    EXPECT_EQ(response.status, t.status) << t.what;
    EXPECT_EQ(response.error_code, t.code) << t.what;
    EXPECT_EQ(response.body.find("max_error_px") == std::string::npos,
              response.error_code == "internal" || t.status >= 503)
        << t.what;
  }
}

TEST(AnswerOrProblem, OutOfMemoryHasRetryAfter) {
  const Response response = answer_or_problem(Request{}, throwing<std::bad_alloc>());
  ASSERT_EQ(response.headers.size(), 1u);
  EXPECT_EQ(response.headers[0].first, "Retry-After");
}

TEST(AnswerOrProblem, InternalErrorsAreLogged) {
  std::ostringstream log;
  const auto before = spdlog::default_logger();
  spdlog::set_default_logger(
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(log)));
  Request request;
  request.method = "POST", request.path = "/v1/frames";
  answer_or_problem(request, throwing<std::invalid_argument>("stoi"));
  spdlog::set_default_logger(before);
  EXPECT_NE(log.str().find("POST /v1/frames: stoi"), std::string::npos) << log.str();
}

TEST(AnswerOrProblem, DepartedClientIsNotADeadline) {
  const std::atomic<bool> left{true};
  Request request;
  request.abandoned = &left;
  EXPECT_EQ(answer_or_problem(request, throwing<Cancelled>()).status, 499);
}

TEST(Routes, AllowedMethodsAreThoseOfThePath) {
  EXPECT_EQ(allowed_methods("/v1/height"), "GET, HEAD");
  EXPECT_EQ(allowed_methods("/v1/frames"), "POST");
  EXPECT_EQ(allowed_methods("/v1/frames/x/meta"), "GET, HEAD");
  EXPECT_EQ(allowed_methods("/v1/frames/x/y/meta"), "");
}

constexpr MemberPointer kRefusable[] = {{"max_error_px", "/accuracy/max_error_px"}};

std::string pointer_of(const std::function<int()>& work) {
  try {
    with_refusals_at(kRefusable, "/pose", work);
  } catch (const RequestError& e) {
    return e.findings().at(0).pointer;
  }
  return "none";
}

TEST(WithRefusalsAt, PointsAtTheMemberThatTheEngineNames) {
  EXPECT_EQ(pointer_of([]() -> int { throw TooMuchTerrain("too much", "max_error_px"); }), "/accuracy/max_error_px");
  EXPECT_EQ(pointer_of([]() -> int { throw ImpossibleRequest("max_error_px is not what this is about"); }), "/pose");
  EXPECT_EQ(pointer_of([]() -> int { throw ImpossibleRequest("elsewhere", "height_m"); }), "/pose");
  EXPECT_EQ(pointer_of([] { return 1; }), "none");
  EXPECT_THROW(pointer_of([]() -> int { throw std::invalid_argument("max_error_px"); }), std::invalid_argument);
}

}  // namespace
}  // namespace selenograph::api
