// Counters and gauges for the operator, in the Prometheus text format 0.0.4.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>

#include "dem/terrain/terrain.h"
#include "engine/cache/preparation.h"
#include "engine/support/heap.h"

namespace selenograph::server {

// Values read at the time of scraping.
struct Gauges {
  bool ready = false;
  int frames_in_work = 0, frames_waiting = 0, max_in_work = 0, max_waiting = 0;
  int connections = 0;
  dem::CacheStatistics cache;
  std::size_t terrain_warnings = 0;
  std::string cache_trouble;  // shown by /health/ready; empty: none
  std::size_t scene_bytes = 0;
  engine::HeapStatistics heap;
  engine::PreparationStatistics preparation;
  std::size_t mesh_bytes = 0;
  std::size_t request_memory_bytes = 0, request_memory_capacity_bytes = 0;
  std::uint64_t log_lines_dropped = 0;
};

// Returns the start of the executable's build ID; empty if the linker wrote none. Nodes with different IDs have another
// compiler or another source, and may answer the same request with other bytes.
std::string build_id();

class Metrics {
 public:
  inline static constexpr std::array<double, 12> kBuckets_s{0.005, 0.01, 0.025, 0.05, 0.1, 0.25,
                                                            0.5,   1,    2.5,   5,    10,  60};

  explicit Metrics(std::string version);

  // `route` must come from route_label(): Prometheus keeps a series for each value, so it must never be client input.
  void count_answer(std::string_view route, std::string_view method, int status, double seconds, std::size_t bytes);
  // `code` is in the api's error table. All codes are exported from the start, because Prometheus sees no increase in a
  // counter that first appears as 1.
  void count_error(std::string_view code);

  // Returns the text for a scrape: HELP and TYPE before each family, each family's samples together.
  std::string exposition(const Gauges& gauges) const;

 private:
  struct Histogram {
    std::array<std::uint64_t, kBuckets_s.size()> buckets{};  // not cumulative
    std::uint64_t count = 0;
    double sum_s = 0;
  };
  std::string answers() const;
  std::string durations() const;
  std::string bytes_and_errors() const;

  const std::string version_;
  mutable std::mutex mutex_;
  std::map<std::tuple<std::string, std::string, int>, std::uint64_t> answers_;  // route, method, status
  std::map<std::string, Histogram, std::less<>> durations_;                     // by route
  std::map<std::string, std::uint64_t, std::less<>> bytes_, errors_;            // by route; by code
};

// Return the path or method itself if the service has it, else "other".
std::string_view route_label(std::string_view path);
std::string_view method_label(std::string_view method);

}  // namespace selenograph::server
