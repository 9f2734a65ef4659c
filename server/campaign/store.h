// Storage of a campaign's frames: files in a folder, or tars. A finished file is intact at any moment, also after a
// crash, because each write is on disk before the next begins:
//
//   1. NAME.part-..: the bytes     after a crash: an unfinished file, which the shard's next run removes
//   2. the frame's journal line    after a crash: a line without a file, so that the frame is rendered again
//   3. rename to NAME              the frame is done
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/campaign/durable_files.h"
#include "server/campaign/journal.h"
#include "server/campaign/plan.h"
#include "server/campaign/sha256.h"

namespace selenograph::server {

// A frame as returned by the service.
struct RenderedFrame {
  std::string_view bytes;
  std::string content_hash;    // empty: none
  double ms = 0;               // duration of rendering
  bool is_incomplete = false;  // some pixels look at the Moon outside the data
};

// Frames as DIR/NAME.SUFFIX. Thread-safe.
class FrameFolder {
 public:
  // Removes unfinished files of an earlier process of this shard.
  FrameFolder(std::string folder, const std::string& suffix, const Shard& shard, const Record& record,
              Journal& journal);

  bool has(const ManifestLine& line) const;
  // Returns true if a file of another request has the line's name.
  bool is_taken(const ManifestLine& line) const;
  void put(const ManifestLine& line, const RenderedFrame& frame);
  std::string path_of(const ManifestLine& line) const;

 private:
  const std::string folder_, suffix_, temporary_suffix_;
  const Record& record_;
  Journal& journal_;
};

// The tar being written: DIR/TAR.part. Overwrites an unfinished tar of an earlier process.
class TarWriter {
 public:
  // Requires !has(): a finished tar is not written again.
  TarWriter(const std::string& folder, const std::string& suffix, const TarPlan& plan, Journal& journal);

  // Returns true if the tar is complete. Throws std::runtime_error naming a file of another manifest, software or
  // terrain.
  static bool has(const std::string& folder, const TarPlan& plan, const Record& record);

  // Appends a frame. Call it in the plan's order.
  void put(const ManifestLine& line, const RenderedFrame& frame);
  // Renames the tar after its last line, or leaves no file if it has no member.
  void finish();

 private:
  const std::string path_, suffix_;
  const TarPlan& plan_;
  Journal& journal_;
  GrowingFile file_;
  Sha256 digest_;
  std::size_t frames_ = 0;
};

}  // namespace selenograph::server
