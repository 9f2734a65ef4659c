#include "server/service/metrics.h"

#include <gtest/gtest.h>

#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>

namespace selenograph::server {
namespace {

// The rules of the text format 0.0.4 that promtool checks: HELP and TYPE once per family and before its samples,
// families in one piece, no sample twice, counters end in _total, well-formed lines.
void expect_valid(const std::string& text) {
  ASSERT_FALSE(text.empty());
  EXPECT_EQ(text.back(), '\n');
  static const std::regex sample(
      R"re(([a-zA-Z_:][a-zA-Z0-9_:]*)(\{([a-z]+="([^"\\]|\\.)*"(,[a-z]+="([^"\\]|\\.)*")*)\})? (\S+))re");
  std::map<std::string, std::string> types;
  std::set<std::string> seen, finished;
  std::string family;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string hash, keyword, name, type;
    if (line.rfind("# ", 0) == 0) {
      words >> hash >> keyword >> name >> type;
      if (keyword == "HELP") {
        EXPECT_TRUE(finished.insert(family).second || family.empty()) << family;
        EXPECT_FALSE(finished.count(name)) << "family in two pieces: " << name;
        family = name;
        continue;
      }
      ASSERT_EQ(keyword, "TYPE") << line;
      EXPECT_EQ(name, family);
      EXPECT_TRUE(types.emplace(name, type).second) << "two TYPE lines: " << name;
      EXPECT_EQ(type == "counter", name.size() > 6 && name.substr(name.size() - 6) == "_total") << name;
      continue;
    }
    std::smatch parts;
    ASSERT_TRUE(std::regex_match(line, parts, sample)) << line;
    EXPECT_EQ(parts[1].str().rfind(family, 0), 0u) << line;
    EXPECT_TRUE(seen.insert(parts[1].str() + parts[2].str()).second) << "twice: " << line;
    EXPECT_NO_THROW(static_cast<void>(std::stod(parts[7].str()))) << line;
  }
}

double value(const std::string& text, const std::string& sample) {
  const std::size_t at = text.find("\n" + sample + " ");
  EXPECT_NE(at, std::string::npos) << sample;
  return at == std::string::npos ? -1 : std::stod(text.substr(at + sample.size() + 2));
}

TEST(Metrics, EmptyExpositionIsValid) { expect_valid(Metrics("1.2.3").exposition({})); }

TEST(Metrics, FilledExpositionIsValid) {
  Metrics metrics("1.2.3");
  metrics.count_answer("/v1/frames", "POST", 200, 0.04, 1000);
  metrics.count_answer("/v1/frames", "POST", 503, 0.001, 10);
  metrics.count_answer("other", "other", 404, 100.0, 10);
  metrics.count_error("busy");
  metrics.count_error("not_found");
  const std::string text = metrics.exposition({});
  expect_valid(text);
  EXPECT_NE(text.find(R"(version="1.2.3")"), std::string::npos);
}

TEST(Metrics, CountsByRouteMethodAndStatus) {
  Metrics metrics("1");
  for (int i = 0; i < 3; ++i) metrics.count_answer("/v1/frames", "POST", 200, 0.04, 1000);
  metrics.count_error("busy");
  const std::string text = metrics.exposition({});
  EXPECT_EQ(value(text, R"(selenograph_http_requests_total{route="/v1/frames",method="POST",status="200"})"), 3);
  EXPECT_EQ(value(text, R"(selenograph_http_response_bytes_total{route="/v1/frames"})"), 3000);
  EXPECT_EQ(value(text, R"(selenograph_errors_total{code="busy"})"), 1);
  EXPECT_EQ(value(text, R"(selenograph_errors_total{code="internal"})"), 0);  // there before the first
}

TEST(Metrics, HistogramBucketsAreCumulative) {
  Metrics metrics("1");
  for (const double seconds : {0.005, 0.007, 0.2, 1000.0}) metrics.count_answer("/v1/rays", "POST", 200, seconds, 1);
  const std::string text = metrics.exposition({});
  const std::string name = "selenograph_http_request_duration_seconds";
  EXPECT_EQ(value(text, name + R"(_bucket{route="/v1/rays",le="0.005"})"), 1);  // le: at most, its border included
  EXPECT_EQ(value(text, name + R"(_bucket{route="/v1/rays",le="0.01"})"), 2);
  EXPECT_EQ(value(text, name + R"(_bucket{route="/v1/rays",le="0.25"})"), 3);
  EXPECT_EQ(value(text, name + R"(_bucket{route="/v1/rays",le="60"})"), 3);
  EXPECT_EQ(value(text, name + R"(_bucket{route="/v1/rays",le="+Inf"})"), 4);
  EXPECT_EQ(value(text, name + R"(_count{route="/v1/rays"})"), 4);
  EXPECT_NEAR(value(text, name + R"(_sum{route="/v1/rays"})"), 1000.212, 1e-9);
}

TEST(Metrics, GaugesAndCacheStatistics) {
  Gauges gauges;
  gauges.ready = true;
  gauges.frames_in_work = 2;
  gauges.frames_waiting = 3;
  gauges.scene_bytes = 12345;
  gauges.heap = {678, 90};
  gauges.cache.hits = 7;
  gauges.log_lines_dropped = 11;
  gauges.cache.chunks_rejected = 9;
  const std::string text = Metrics("1").exposition(gauges);
  EXPECT_EQ(value(text, "selenograph_ready"), 1);
  EXPECT_EQ(value(text, "selenograph_frames_in_work"), 2);
  EXPECT_EQ(value(text, "selenograph_frames_waiting"), 3);
  EXPECT_EQ(value(text, "selenograph_scene_bytes"), 12345);
  EXPECT_EQ(value(text, "selenograph_heap_used_bytes"), 678);
  EXPECT_EQ(value(text, "selenograph_heap_free_bytes"), 90);
  EXPECT_EQ(value(text, "selenograph_log_dropped_total"), 11);
  EXPECT_EQ(value(text, "selenograph_terrain_cache_hits_total"), 7);
  EXPECT_EQ(value(text, "selenograph_terrain_chunks_rejected_total"), 9);
}

TEST(Metrics, ProcessFiguresAreThisProcess) {
  const std::string text = Metrics("1").exposition({});
  EXPECT_GT(value(text, "process_resident_memory_bytes"), 1e5);
  EXPECT_LT(value(text, "process_resident_memory_bytes"), 1e12);
  EXPECT_GT(value(text, "process_start_time_seconds"), 1.5e9);
  EXPECT_GE(value(text, "process_cpu_seconds_total"), 0);
}

TEST(Metrics, LabelsHaveFewValues) {
  EXPECT_EQ(route_label("/v1/frames"), "/v1/frames");
  EXPECT_EQ(route_label("/metrics"), "/metrics");
  EXPECT_EQ(route_label("/v1/frames/../secret"), "other");
  EXPECT_EQ(route_label(""), "other");
  EXPECT_EQ(method_label("POST"), "POST");
  EXPECT_EQ(method_label("BREW"), "other");
}

}  // namespace
}  // namespace selenograph::server
