// Checks that a folder holds the frames of a manifest, each once and whole.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "server/campaign/manifest.h"

namespace selenograph::server {

struct LineNotDone {
  const ManifestLine* line = nullptr;
  std::string why;
  bool is_bad = false;  // can never become a frame
};

struct CheckResult {
  std::size_t done = 0;
  std::vector<LineNotDone> not_done;           // in the manifest's order
  std::map<std::string, std::string> damaged;  // files of the folder with frames, and what is wrong
};

// Reads each file with a frame of the manifest, and all tars. Throws std::runtime_error naming the folder.
CheckResult check_campaign(const Manifest& manifest, const std::string& folder);

}  // namespace selenograph::server
