// Checks that a folder holds the frames of a manifest: every frame once and intact. Names frames that no line asks for.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "server/campaign/manifest.h"

namespace selenograph::server {

enum class Fault {
  missing,  // never rendered, or its file is missing
  damaged,  // in no journal, with other bytes than in the journal, or of another request
  doubled,  // in more than one place
  bad,      // a line that can never become a frame
  extra,    // not requested by any line, or left unfinished by a process that was killed: no frame of the manifest
};
std::string_view fault_name(Fault fault);

struct FoundFault {
  Fault fault = Fault::missing;
  const ManifestLine* line = nullptr;  // null: no line
  std::string file;                    // file in the folder; empty: none
  std::string why;
};

struct CheckResult {
  std::size_t good = 0;
  bool tars = false;
  std::vector<FoundFault> faults;  // in the manifest's order; those without a line last
  std::size_t count(Fault fault) const;
};

// Reads every frame. Throws std::runtime_error naming the folder or the unreadable file.
CheckResult check_campaign(const Manifest& manifest, const std::string& folder);

}  // namespace selenograph::server
