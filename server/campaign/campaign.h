// Renders a shard of a campaign, from the manifest to the last frame.
#pragma once

#include <atomic>
#include <cstddef>
#include <map>
#include <string>

#include "api/service.h"
#include "server/campaign/journal.h"
#include "server/campaign/manifest.h"
#include "server/campaign/plan.h"

namespace selenograph::server {

// Format of tars of .npz files. The other formats are extensions of api::representations().
inline constexpr const char* kWebDataset = "webdataset";

struct CampaignOptions {
  std::string folder;
  std::string format = "npz";
  Shard shard;
  std::size_t frames_per_tar = 256;  // for kWebDataset
  bool replace = false;              // replace frames of other requests with the manifest's names
  int in_work = 2;                   // frames rendered at once
};

// Numbers of a shard's lines by outcome.
struct CampaignTally {
  std::size_t rendered = 0;
  std::size_t existing = 0;                     // finished by an earlier run
  std::size_t bad = 0;                          // can never become a frame
  std::size_t failed = 0;                       // temporary failure: an unreadable file, no memory
  std::size_t incomplete = 0;                   // frames with pixels on the Moon outside the data
  std::map<std::string, std::size_t> warnings;  // number of frames with each
  bool interrupted = false;
};

// Renders missing frames; `made_by`: see Journal. `stop` cancels active frames; files being written are finished.
// Throws std::runtime_error naming the file when the folder holds files that are not this campaign's, or cannot be
// written.
CampaignTally run_campaign(const Manifest& manifest, const api::Service& service, const std::string& made_by,
                           const CampaignOptions& options, std::atomic<bool>& stop);

}  // namespace selenograph::server
