// The journal of a campaign, as lines of JSON: one append-only file per shard.
//
//   {"time": "2026-11-20T00:00:00.000Z", "made_by": "1.0.0 4f3c...", "name": "000001", "line": 1,
//    "request_sha256": "...", "content_hash": "...", "sha256": "...", "bytes": 4194860, "ms": 21.3,
//    "file": "000001.npz"}                                      a frame; of a tar also "offset"
//   {"time": ..., "made_by": ..., "name": "000002", "line": 2, "request_sha256": "...",
//    "problem": {"status": 422, ...}}                           a line without a frame
//   {"time": ..., "made_by": ..., "tar": "frames-000000.tar", "plan": "...", "sha256": "...", "bytes": 1073807360,
//    "frames": 256}                                             a finished tar
//
// Each line stands alone, and the latest one about a name counts. A frame's line is on disk before its file gets its
// name: a file without a journal line does not belong to the campaign.
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>

#include "server/campaign/durable_files.h"
#include "server/campaign/manifest.h"
#include "server/campaign/plan.h"

namespace selenograph::server {

struct DoneFrame {
  std::string name;
  std::size_t line = 0;
  std::string request_sha256, content_hash, sha256;  // content_hash is empty for a frame without an ETag
  std::uint64_t bytes = 0;
  double ms = 0;              // duration of rendering
  std::string file;           // of the folder: the frame's own, or a tar
  std::uint64_t offset = 0;   // of the member's header in the tar
  std::string time, made_by;  // set by Journal

  bool is_in_tar() const { return file.ends_with(".tar"); }
};

struct LineWithoutFrame {
  std::string name;
  std::size_t line = 0;
  std::string request_sha256;
  Problem problem;
  std::string time, made_by;  // set by Journal
};

struct DoneTar {
  std::string tar, plan, sha256;  // plan: TarPlan::sha256()
  std::uint64_t bytes = 0;
  std::size_t frames = 0;
  std::string time, made_by;  // set by Journal
};

// All journals of a folder. Incomplete last lines are ignored; other unreadable lines are, too, with a message in the
// log.
class Record {
 public:
  // `made_by`: the software and terrain of which frames count as done; empty: any.
  explicit Record(const std::string& folder, std::string made_by = {});

  // The next three functions return null if no journal has the entry.
  const DoneFrame* frame(const std::string& name) const;
  // Returns the entry of the line's name and request: its number may differ between manifests.
  const LineWithoutFrame* without_frame(const ManifestLine& line) const;
  const DoneTar* tar(const std::string& name) const;

  // Returns the file of any frame, whose extension is the campaign's format; empty if there is no frame.
  const std::string& any_file() const { return any_file_; }

 private:
  void add(const nlohmann::ordered_json& line);
  bool counts(const std::string& made_by) const { return made_by_.empty() || made_by == made_by_; }

  const std::string made_by_;
  std::string any_file_;
  std::unordered_map<std::string, DoneFrame> frames_;
  std::unordered_map<std::string, LineWithoutFrame> without_;  // by name and request
  std::unordered_map<std::string, DoneTar> tars_;
};

// The journal of one shard, for writing. Thread-safe.
class Journal {
 public:
  // `made_by`: software and terrain, which determine a frame's bytes together with its request. Truncates an incomplete
  // last line. Throws as GrowingFile does.
  Journal(const std::string& folder, const Shard& shard, std::string made_by);
  void add(const DoneFrame& frame);
  void add(const LineWithoutFrame& line);
  void add(const DoneTar& tar);

 private:
  void add_line(const nlohmann::ordered_json& members);
  const std::string made_by_;
  std::mutex mutex_;
  GrowingFile file_;
};

}  // namespace selenograph::server
