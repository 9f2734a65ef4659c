// Checks that a folder holds the frames of a manifest, undamaged.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "server/campaign/manifest.h"

namespace selenograph::server {

struct LineNotDone {
  const ManifestLine* line = nullptr;
  std::string file;  // of the folder, in the frame's place but not the frame; empty: none
  std::string why;
  bool is_bad = false;  // can never become a frame
};

struct CheckResult {
  std::size_t done = 0;
  std::vector<LineNotDone> not_done;  // in the manifest's order
};

// Compares each frame's bytes with the journals. Throws std::runtime_error naming the folder or the unreadable file.
CheckResult check_campaign(const Manifest& manifest, const std::string& folder);

}  // namespace selenograph::server
