#include "api/json/json_reader.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <string>

#include "engine/support/heap.h"

namespace selenograph::api {
namespace {

// What parse_json throws: its code, and the pointer of its first finding ("-" without one).
std::pair<std::string, std::string> refusal(const std::string& text, int max_depth = 16) {
  try {
    parse_json(text, max_depth);
  } catch (const RequestError& e) {
    return {e.code(), e.findings().empty() ? "-" : e.findings()[0].pointer};
  }
  return {"accepted", ""};
}

using Pair = std::pair<std::string, std::string>;

TEST(ParseJson, RefusesWhatIsNotJson) {
  for (const char* text : {"", "{", "{\"a\":NaN}", "{\"a\":Infinity}", "{\"a\":-inf}", "{'a':1}", "[1,]", "{} x", "nul",
                           "\xff\xfe", "{\"a\":\"\xc3\x28\"}", "// c\n{}", "01"}) {
    EXPECT_EQ(refusal(text).first, "malformed_json") << text;
  }
  EXPECT_EQ(refusal("{\"a\": [1, 2.5e3, true, null, \"x\"]}").first, "accepted");
}

TEST(ParseJson, RefusesDepthBeforeBuildingIt) {
  EXPECT_EQ(refusal("[[[1]]]", 3).first, "accepted");
  EXPECT_EQ(refusal("[[[[1]]]]", 3), (Pair{"malformed_json", "/0/0/0"}));
  EXPECT_EQ(refusal("{\"a\":{\"b\":{\"c\":{}}}}", 3), (Pair{"malformed_json", "/a/b/c"}));
  EXPECT_EQ(refusal(std::string(4 << 20, '[')).first, "malformed_json");
}

TEST(ParseJson, RefusesDuplicatesAndNumbersBeyondDouble) {
  EXPECT_EQ(refusal("{\"a\": [0, {\"b\": 1, \"c\": 2, \"b\": 3}]}"), (Pair{"invalid_request", "/a/1/b"}));
  EXPECT_EQ(refusal("{\"a\": {\"b\": 1}, \"b\": 1}").first, "accepted");
  EXPECT_EQ(refusal("{\"a\": [1, {\"b\": 1e999}]}"), (Pair{"invalid_request", "/a/1/b"}));
  EXPECT_EQ(refusal("{\"a/b~\": 1, \"a/b~\": 1}"), (Pair{"invalid_request", "/a~1b~0"}));
}

// A body of the largest size must not take more than its size to read, whatever it consists of.
TEST(ParseJson, TakesLinearTime) {
  for (const std::string element : {"{},", "[],", "0,", "{\"a\":0},"}) {
    std::string text = "[";
    while (text.size() < (4u << 20)) text += element;
    const auto start = std::chrono::steady_clock::now();
    EXPECT_EQ(refusal(text + "0]").first, "accepted");
    // A fraction of a second; a quadratic reader needs hours.
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(30)) << element;
  }
}

// Reads `text` with `read` and answers "pointer: detail" of each finding, one per line.
template <typename Read>
std::string findings_of(const std::string& text, Read&& read) {
  const Json json = parse_json(text, 16);
  Findings findings;
  read(JsonReader(json, findings));
  std::string out;
  for (const Finding& f : findings.entries()) out += f.pointer + ": " + f.detail + "\n";
  return out;
}

TEST(JsonReader, UnknownMembersGetASuggestion) {
  const auto read = [](const JsonReader& in) { in.object({"width", "height"}); };
  EXPECT_EQ(findings_of(R"({"width": 1})", read), "");
  EXPECT_EQ(findings_of(R"({"widht": 1})", read), "/widht: unknown member; did you mean \"width\"?\n");
  EXPECT_EQ(findings_of(R"({"exposure": 1})", read), "/exposure: unknown member; known here: \"width\", \"height\"\n");
  EXPECT_EQ(findings_of("[]", read), ": must be an object\n");
}

TEST(JsonReader, LongNamesAreNotRepeated) {
  const auto read = [](const JsonReader& in) { in.object({"width"}); };
  EXPECT_LT(findings_of("{\"" + std::string(100000, 'w') + "\": 1}", read).size(), 100u);
}

TEST(JsonReader, ChecksTypesAndRanges) {
  const auto number = [](const JsonReader& in) { in.number("a", above(0).below(180)); };
  EXPECT_EQ(findings_of(R"({"a": 179.999})", number), "");
  EXPECT_EQ(findings_of(R"({"a": 180})", number), "/a: must be greater than 0 and less than 180\n");
  EXPECT_EQ(findings_of(R"({"a": 0})", number), "/a: must be greater than 0 and less than 180\n");
  EXPECT_EQ(findings_of(R"({"a": "5"})", number), "/a: must be a number\n");
  EXPECT_EQ(findings_of(R"({"a": true})", number), "/a: must be a number\n");
  EXPECT_EQ(findings_of(R"({})", number), "/a: is required\n");
  const auto integer = [](const JsonReader& in) { in.at("a").integer(1, 10); };
  EXPECT_EQ(findings_of(R"({"a": 10.0})", integer), "");
  EXPECT_EQ(findings_of(R"({"a": 1.5})", integer), "/a: must be an integer\n");
  EXPECT_EQ(findings_of(R"({"a": 1e300})", integer), "/a: must be at least 1 and at most 10\n");
  const auto vector = [](const JsonReader& in) { in.at("a").vector({-1, 1}); };
  EXPECT_EQ(findings_of(R"({"a": [0, 0.5, -1]})", vector), "");
  EXPECT_EQ(findings_of(R"({"a": [0, 0]})", vector), "/a: must be an array of three numbers\n");
  EXPECT_EQ(findings_of(R"({"a": [0, null, 2]})", vector),
            "/a/1: must be a number\n/a/2: must be at least -1 and at most 1\n");
}

TEST(JsonReader, NonFiniteNumbersOfABuiltDocumentAreRefused) {
  const Json json{{"a", std::numeric_limits<double>::quiet_NaN()}, {"b", std::numeric_limits<double>::infinity()}};
  Findings findings;
  const JsonReader in(json, findings);
  in.number("a", {});
  in.number("b", {});
  ASSERT_EQ(findings.entries().size(), 2u);
  EXPECT_EQ(findings.entries()[0].detail, "must be finite");
  EXPECT_EQ(findings.entries()[1].pointer, "/b");
}

TEST(JsonReader, WordsGetASuggestion) {
  static constexpr std::pair<std::string_view, int> kWords[] = {{"opencv", 1}, {"opengl", 2}};
  int meaning = 0;
  const auto read = [&](const JsonReader& in) { meaning = in.at("axes").word(Words<int>(kWords)).value_or(1); };
  EXPECT_EQ(findings_of(R"({"axes": "opengl"})", read), "");
  EXPECT_EQ(meaning, 2);
  EXPECT_EQ(findings_of(R"({"axes": "blender"})", read), "/axes: must be \"opencv\" or \"opengl\"\n");
  EXPECT_EQ(findings_of(R"({"axes": "OpenGL"})", read),
            "/axes: must be \"opencv\" or \"opengl\"; did you mean \"opengl\"?\n");
  EXPECT_EQ(findings_of(R"({"axes": 3})", read), "/axes: must be a string\n");
}

TEST(JsonReader, NumberOfFindingsIsLimited) {
  std::string text = "[0";
  for (int i = 0; i < 1000; ++i) text += ",0";
  const auto read = [](const JsonReader& in) {
    in.elements(1, 2000, [](const JsonReader& element) { element.fail("wrong"); });
  };
  const std::string findings = findings_of(text + "]", read);
  EXPECT_EQ(std::count(findings.begin(), findings.end(), '\n'), static_cast<long>(Findings::kMaxEntries));
  EXPECT_EQ(findings_of("[1,2,3]", [](const JsonReader& in) { in.elements(1, 2, [](const JsonReader&) {}); }),
            ": must have at most 2 elements, has 3\n");
}

TEST(DirectionOf, NormalisesAnyLength) {
  for (const double scale : {5e-324, 1e-300, 1.0, 1e300}) {
    const auto direction = direction_of(Vec3(0, -scale, scale));
    ASSERT_TRUE(direction) << scale;
    EXPECT_NEAR((*direction - Vec3(0, -1, 1).normalized()).norm(), 0, 1e-15) << scale;
  }
  EXPECT_FALSE(direction_of(Vec3::zero()));
  for (const double bad : {std::nan(""), HUGE_VAL})
    for (int i = 0; i < 3; ++i) {
      Vec3 v(1, 2, 3);
      v[i] = bad;
      EXPECT_FALSE(direction_of(v)) << bad << " in " << i;
    }
}

}  // namespace
}  // namespace selenograph::api
