#include "server/service/metrics.h"

#include <elf.h>
#include <fmt/format.h>
#include <link.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <fstream>
#include <iterator>
#include <span>

#include "api/endpoints/routes.h"
#include "api/message/problem.h"

namespace selenograph::server {
namespace {

// Text of metric families in the order in which they are added. Labels are this program's own names, which need no
// escapes.
class Exposition {
 public:
  void family(std::string_view name, std::string_view type, std::string_view help) {
    fmt::format_to(to(), "# HELP {} {}\n# TYPE {} {}\n", name, help, name, type);
  }
  template <typename Value>
  void sample(std::string_view name, std::string_view labels, Value value) {
    labels.empty() ? fmt::format_to(to(), "{} {}\n", name, value)
                   : fmt::format_to(to(), "{}{{{}}} {}\n", name, labels, value);
  }
  template <typename Value>
  void single(std::string_view name, std::string_view type, std::string_view help, Value value) {
    family(name, type, help);
    sample(name, "", value);
  }
  std::string text() && { return std::move(text_); }

 private:
  std::back_insert_iterator<std::string> to() { return std::back_inserter(text_); }
  std::string text_;
};

const auto process_start = std::chrono::system_clock::now();

// Reads the second number of statm, the resident pages (proc(5)).
std::size_t resident_bytes() {
  std::size_t all_pages = 0, resident_pages = 0;
  std::ifstream("/proc/self/statm") >> all_pages >> resident_pages;
  return resident_pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

void write_process(Exposition& out) {
  timespec cpu{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
  const std::chrono::duration<double> since_epoch = process_start.time_since_epoch();
  out.single("process_cpu_seconds_total", "counter", "User and system CPU time",
             static_cast<double>(cpu.tv_sec) + 1e-9 * static_cast<double>(cpu.tv_nsec));
  out.single("process_resident_memory_bytes", "gauge", "Resident memory", resident_bytes());
  out.single("process_start_time_seconds", "gauge", "Start time of the process since the Unix epoch",
             since_epoch.count());
}

void write_gauges(Exposition& out, const Gauges& g) {
  out.single("selenograph_ready", "gauge", "1 while the service accepts work, else 0", g.ready ? 1 : 0);
  out.single("selenograph_frames_in_work", "gauge", "Requests being computed", g.frames_in_work);
  out.single("selenograph_frames_waiting", "gauge", "Requests in the queue for a slot", g.frames_waiting);
  out.single("selenograph_frames_in_work_limit", "gauge", "Slots for requests being computed", g.max_in_work);
  out.single("selenograph_frames_waiting_limit", "gauge", "Places in the queue", g.max_waiting);
  out.single("selenograph_http_connections", "gauge", "Open client connections", g.connections);
  out.single("selenograph_log_dropped_total", "counter", "Log lines dropped because stderr was not read in time",
             g.log_lines_dropped);
  out.single("selenograph_scene_bytes", "gauge",
             "Bytes of acceleration structures, lenses and scratch memory kept between frames", g.scene_bytes);
  out.single("selenograph_heap_used_bytes", "gauge", "Heap bytes in use", g.heap.used_bytes);
  out.single("selenograph_heap_free_bytes", "gauge", "Free heap bytes not returned to the system", g.heap.free_bytes);
  out.single("selenograph_prefetched_scenes_total", "counter", "Scenes prefetched before a frame needed them",
             g.preparation.prepared);
  out.single("selenograph_prefetched_scenes_used_total", "counter", "Prefetched scenes used by a frame",
             g.preparation.used);
  out.single("selenograph_prefetched_scenes_wasted_total", "counter", "Prefetched scenes dropped unused",
             g.preparation.wasted);
  out.single("selenograph_request_memory_bytes", "gauge",
             "Bytes of requests being computed and of answers not yet sent", g.request_memory_bytes);
  out.single("selenograph_request_memory_capacity_bytes", "gauge", "Limit of selenograph_request_memory_bytes",
             g.request_memory_capacity_bytes);
  out.single("selenograph_mesh_bytes", "gauge",
             "Bytes of cached assets: meshes with their acceleration structures, star catalogues, others",
             g.mesh_bytes);
  out.single("selenograph_cache_trouble", "gauge",
             "1 while the cache folder is unusable, else 0; /health/ready shows the reason",
             g.cache_trouble.empty() ? 0 : 1);
  out.single("selenograph_terrain_warnings", "gauge", "Unusable DEM files replaced by a coarser layer",
             g.terrain_warnings);
}

void write_cache(Exposition& out, const dem::CacheStatistics& c) {
  out.single("selenograph_terrain_cache_bytes", "gauge", "Bytes of terrain blocks and pyramids in memory", c.bytes);
  out.single("selenograph_terrain_cache_capacity_bytes", "gauge", "Budget of the terrain cache", c.capacity_bytes);
  out.single("selenograph_terrain_cache_hits_total", "counter", "Terrain blocks found in memory", c.hits);
  out.single("selenograph_terrain_cache_misses_total", "counter", "Terrain blocks not found in memory", c.misses);
  out.single("selenograph_terrain_cache_evictions_total", "counter", "Terrain blocks dropped to stay within the budget",
             c.evictions);
  out.single("selenograph_terrain_chunks_built_total", "counter", "Pyramid chunks built from posts", c.chunks_built);
  out.single("selenograph_terrain_chunks_read_total", "counter", "Pyramid chunks read from disk", c.chunks_read);
  out.single("selenograph_terrain_chunks_rejected_total", "counter", "Damaged or outdated pyramid chunks on disk",
             c.chunks_rejected);
}

// Returns the GNU build ID from a segment of ELF notes, in hexadecimal; empty if it is not the first of them.
std::string build_id_in(std::string_view notes) {
  ElfW(Nhdr) note{};
  notes.copy(reinterpret_cast<char*>(&note), sizeof note);
  std::string id;
  if (note.n_type != NT_GNU_BUILD_ID || note.n_namesz != sizeof "GNU") return id;
  for (const char byte : notes.substr(sizeof note + note.n_namesz, note.n_descsz))
    id += fmt::format("{:02x}", static_cast<unsigned char>(byte));
  return id;
}

// Callback of dl_iterate_phdr, which visits the executable first. Returns 1 to end the iteration there.
int read_build_id(dl_phdr_info* object, std::size_t, void* id) {
  for (const ElfW(Phdr) & segment : std::span(object->dlpi_phdr, object->dlpi_phnum)) {
    const auto* const notes = reinterpret_cast<const char*>(object->dlpi_addr + segment.p_vaddr);
    const std::string found = segment.p_type == PT_NOTE ? build_id_in({notes, segment.p_memsz}) : std::string();
    if (!found.empty()) *static_cast<std::string*>(id) = found;
  }
  return 1;
}

}  // namespace

std::string build_id() {
  std::string id;
  ::dl_iterate_phdr(read_build_id, &id);
  return id.substr(0, 16);
}

Metrics::Metrics(std::string version) : version_(std::move(version)) {
  for (const api::ErrorRow& row : api::error_table()) errors_.emplace(row.code, 0);
}

void Metrics::count_answer(std::string_view route, std::string_view method, int status, double seconds,
                           std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  ++answers_[{std::string(route), std::string(method), status}];
  bytes_[std::string(route)] += bytes;
  Histogram& histogram = durations_[std::string(route)];
  ++histogram.count;
  histogram.sum_s += seconds;
  // The first bucket whose upper bound is not below the duration; longer ones are counted in `count` only.
  const auto bucket = std::lower_bound(kBuckets_s.begin(), kBuckets_s.end(), seconds);
  if (bucket != kBuckets_s.end()) ++histogram.buckets[static_cast<std::size_t>(bucket - kBuckets_s.begin())];
}

void Metrics::count_error(std::string_view code) {
  const std::lock_guard lock(mutex_);
  ++errors_[std::string(code)];
}

std::string Metrics::answers() const {
  constexpr std::string_view kName = "selenograph_http_requests_total";
  Exposition out;
  out.family(kName, "counter", "Answered requests");
  for (const auto& [key, count] : answers_) {
    const auto& [route, method, status] = key;
    out.sample(kName, fmt::format("route=\"{}\",method=\"{}\",status=\"{}\"", route, method, status), count);
  }
  return std::move(out).text();
}

std::string Metrics::durations() const {
  const std::string name = "selenograph_http_request_duration_seconds";
  Exposition out;
  out.family(name, "histogram", "Time from the complete request to the last byte of its answer");
  for (const auto& [route, histogram] : durations_) {
    const std::string label = fmt::format("route=\"{}\"", route);
    std::uint64_t cumulative = 0;  // Prometheus's buckets count all shorter durations, too
    for (std::size_t i = 0; i < kBuckets_s.size(); ++i) {
      cumulative += histogram.buckets[i];
      out.sample(name + "_bucket", fmt::format("{},le=\"{}\"", label, kBuckets_s[i]), cumulative);
    }
    out.sample(name + "_bucket", label + ",le=\"+Inf\"", histogram.count);
    out.sample(name + "_sum", label, histogram.sum_s);
    out.sample(name + "_count", label, histogram.count);
  }
  return std::move(out).text();
}

std::string Metrics::bytes_and_errors() const {
  Exposition out;
  out.family("selenograph_http_response_bytes_total", "counter", "Bytes of response bodies");
  for (const auto& [route, bytes] : bytes_) {
    out.sample("selenograph_http_response_bytes_total", fmt::format("route=\"{}\"", route), bytes);
  }
  out.family("selenograph_errors_total", "counter", "Error responses by code; busy and shutting_down are rejections");
  for (const auto& [code, count] : errors_)
    out.sample("selenograph_errors_total", fmt::format("code=\"{}\"", code), count);
  return std::move(out).text();
}

std::string Metrics::exposition(const Gauges& gauges) const {
  Exposition out;
  out.family("selenograph_build_info", "gauge", "Version of the software and build ID of the executable");
  out.sample("selenograph_build_info", fmt::format("version=\"{}\",build=\"{}\"", version_, build_id()), 1);
  write_gauges(out, gauges);
  write_cache(out, gauges.cache);
  write_process(out);
  const std::lock_guard lock(mutex_);
  return std::move(out).text() + answers() + durations() + bytes_and_errors();
}

std::string_view route_label(std::string_view path) {
  for (const api::Route& route : api::kRoutes) {
    if (api::segment_of(route, path)) return route.path;
  }
  for (const std::string_view own : {"/health/live", "/health/ready", "/metrics"}) {
    if (own == path) return own;
  }
  return "other";
}

std::string_view method_label(std::string_view method) {
  for (const std::string_view label : {"GET", "HEAD", "POST"}) {
    if (label == method) return label;
  }
  return "other";
}

}  // namespace selenograph::server
