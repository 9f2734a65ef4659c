// A campaign's shard, from the manifest to the last frame.
#pragma once

#include <atomic>
#include <cstddef>
#include <string>

#include "api/service.h"
#include "server/campaign/journal.h"
#include "server/campaign/manifest.h"
#include "server/campaign/plan.h"

namespace selenograph::server {

// The format that is a tar of .npz files; the others are the extensions of api::representations().
inline constexpr const char* kWebDataset = "webdataset";

struct CampaignOptions {
  std::string folder;
  std::string format = "npz";
  Shard shard;
  std::size_t frames_per_tar = 256;  // of kWebDataset
  bool replace = false;              // frames of other requests under the manifest's names
  int in_work = 2;                   // frames at once
};

// What became of a shard's lines.
struct CampaignTally {
  std::size_t rendered = 0, kept = 0;  // kept: were there already
  std::size_t bad = 0;                 // can never be a frame
  std::size_t failed = 0;              // aren't one now: a file that can't be read, no memory
  std::size_t outside = 0;             // frames with pixels that look at the Moon outside the data
  bool interrupted = false;
};

// Renders what is missing. `stop` ends it: a frame in work is given up, what is written is finished. Throws
// std::runtime_error naming the file where the folder holds what isn't this campaign's, or can't be written.
CampaignTally run_campaign(const Manifest& manifest, const api::Service& service, const Run& run,
                           const CampaignOptions& options, std::atomic<bool>& stop);

}  // namespace selenograph::server
