// Renders a shard of a campaign. A frame is a function of its request, so a file that exists whole is done:
//
//   line --ETag--> is DIR/NAME.npz there? --no--> render -> NAME.npz.tmp-.. -> flush -> rename to NAME.npz
//                   | yes
//                   has it this ETag as its content hash? --yes--> done;  no: refused, or rendered again with `replace`
//
// Tars hold the frames of consecutive lines, and are there whole or not at all, too.
#pragma once

#include <atomic>
#include <cstddef>
#include <map>
#include <string>

#include "api/service.h"
#include "server/campaign/manifest.h"
#include "server/campaign/plan.h"

namespace selenograph::server {

// Format of tars of .npz files. The other formats are extensions of api::representations().
inline constexpr const char* kWebDataset = "webdataset";

struct CampaignOptions {
  std::string folder;
  std::string format = "npz";
  Shard shard;
  std::size_t frames_per_tar = 1000;  // for kWebDataset
  bool replace = false;               // replace other files under the manifest's names
  int in_work = 2;                    // frames rendered at once
};

// Numbers of a shard's lines by outcome.
struct CampaignTally {
  std::size_t rendered = 0;
  std::size_t existing = 0;                     // finished by an earlier run
  std::size_t bad = 0;                          // can never become a frame
  std::size_t failed = 0;                       // temporary failure: an unreadable file, no memory
  std::size_t left_out = 0;                     // of tars that are not written, because another line has failed
  std::size_t incomplete = 0;                   // rendered frames with pixels on the Moon outside the data
  std::map<std::string, std::size_t> warnings;  // number of rendered frames with each
  bool interrupted = false;
};

// Renders missing frames. `stop` cancels active frames; files being written are finished. Throws std::runtime_error
// naming the file when the folder holds other files under the manifest's names, or cannot be written.
CampaignTally run_campaign(const Manifest& manifest, const api::Service& service, const CampaignOptions& options,
                           std::atomic<bool>& stop);

}  // namespace selenograph::server
