// Where a campaign's frames go: files of a folder, or tars. What is in there at any moment is whole, whatever becomes
// of the process.
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

// A frame as the service answers it.
struct RenderedFrame {
  std::string_view bytes;
  std::string content_hash;  // empty: has none
  double ms = 0;
  std::optional<double> missing_fraction;
};

DoneFrame done_frame(const ManifestLine& line, const RenderedFrame& frame);

// Frames as DIR/NAME.SUFFIX. Safe to use concurrently.
class FrameFolder {
 public:
  // What an earlier process of this shard left half-written is removed.
  FrameFolder(std::string folder, std::string suffix, const Shard& shard, const Record& record, Journal& journal);

  bool has(const ManifestLine& line) const;
  // Whether there is something else under the line's name.
  bool is_taken(const ManifestLine& line) const;
  void put(const ManifestLine& line, const RenderedFrame& frame);
  std::string path_of(const ManifestLine& line) const;

 private:
  const std::string folder_, suffix_, temporary_suffix_;
  const Record& record_;
  Journal& journal_;
};

// The tar that is being written: DIR/TAR.part. What an earlier process left of it is begun anew.
class TarWriter {
 public:
  // Of nothing that is finished: ask has() first.
  TarWriter(const std::string& folder, const std::string& suffix, const TarPlan& plan, Journal& journal);

  // Whether it is complete.
  static bool has(const std::string& folder, const TarPlan& plan, const Record& record);

  // In the plan's order.
  void put(const ManifestLine& line, const RenderedFrame& frame);
  // No line is left: gives the tar its name, or leaves none where it has no member.
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
