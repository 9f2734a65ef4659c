// The journal of a campaign, as lines of JSON: one append-only file per shard.
//
//   {"run": {"software": "0.1.0", "terrain": "...", "format": "npz", "shard": 0, "of": 4, "manifest_sha256": "...",
//    "started": "2026-11-20T00:00:00.000Z"}}
//   {"name": "000001", "line": 1, "request_sha256": "...", "content_hash": "...", "sha256": "...", "bytes": 4194860,
//    "ms": 21.3}                                          a frame; of a tar also "tar" and "offset"
//   {"name": "000002", "line": 2, "request_sha256": "...", "problem": {"status": 422, ...}}      a line without a frame
//   {"tar": "frames-000000.tar", "plan": "...", "sha256": "...", "bytes": 1073807360, "frames": 256}
//
// A frame's line is on disk before its file gets its name: a file without a journal line does not belong to the
// campaign.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "server/campaign/durable_files.h"
#include "server/campaign/manifest.h"

namespace selenograph::server {

// Parameters, other than the request, that determine a frame's bytes and its location.
struct Run {
  std::string software, terrain, format;
  std::size_t shard = 0, of = 1;
  std::string manifest_sha256;
  std::string started;  // UTC
  bool same_bytes(const Run& other) const { return software == other.software && terrain == other.terrain; }
};

struct DoneFrame {
  std::string name;
  std::size_t line = 0;
  std::string request_sha256, content_hash, sha256;  // content_hash is empty for a frame without an ETag
  std::uint64_t bytes = 0;
  double ms = 0;
  std::optional<double> missing_fraction;
  std::string tar;           // empty: its own file
  std::uint64_t offset = 0;  // offset of its header in the tar
};

struct LineWithoutFrame {
  std::string name;
  std::size_t line = 0;
  std::string request_sha256;
  Problem problem;
};

struct DoneTar {
  std::string tar, plan, sha256;  // plan: TarPlan::sha256()
  std::uint64_t bytes = 0;
  std::size_t frames = 0;
};

std::string journal_name(std::size_t shard, std::size_t of);

// All journals of a folder; the latest run's entry counts. Incomplete last lines are ignored; other unreadable lines
// are, too, with a message in the log.
class Record {
 public:
  // `current`: frames from other software or other terrain do not count as done.
  explicit Record(const std::string& folder, const Run* current = nullptr);

  // Null if unknown.
  const DoneFrame* frame(const std::string& name) const;
  // Found by the request: the line's number may differ between manifests.
  const LineWithoutFrame* without_frame(const ManifestLine& line) const;
  const DoneTar* tar(const std::string& name) const;

  // Format of the last run; empty: no run.
  const std::string& format() const { return format_; }

 private:
  struct Lines;
  static void split_into_runs(const std::string& path, const std::string& text, std::vector<Lines>& runs);
  void take(const nlohmann::ordered_json& line, bool counts);
  std::string format_;
  std::unordered_map<std::string, DoneFrame> frames_;
  std::unordered_map<std::string, LineWithoutFrame> without_;  // by name and request
  std::unordered_map<std::string, DoneTar> tars_;
};

// The journal of one shard, for writing. Thread-safe.
class Journal {
 public:
  // Truncates an incomplete last line. Throws as GrowingFile does.
  Journal(const std::string& folder, const Run& run);
  void add(const DoneFrame& frame);
  void add(const LineWithoutFrame& line);
  void add(const DoneTar& tar);

 private:
  void add_line(const nlohmann::ordered_json& line);
  std::mutex mutex_;
  GrowingFile file_;
  std::optional<Run> run_;  // not yet written: a run that does nothing leaves no line
};

}  // namespace selenograph::server
