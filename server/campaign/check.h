// Whether a folder holds what a manifest asks for: every frame once and whole, and nothing else.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "server/campaign/manifest.h"

namespace selenograph::server {

enum class Fault {
  missing,  // no journal knows it, or its file is gone
  damaged,  // other bytes than the journal says, or another request's
  doubled,  // in more than one place
  bad,      // a line that can never be a frame
  extra,    // what no line asks for
};
std::string_view fault_name(Fault fault);

struct FoundFault {
  Fault fault = Fault::missing;
  const ManifestLine* line = nullptr;  // null: of none
  std::string file;                    // in the folder; empty: there is none
  std::string why;
};

struct CheckResult {
  std::size_t good = 0;
  bool tars = false;
  std::vector<FoundFault> faults;  // in the manifest's order; what is of no line last
  std::size_t count(Fault fault) const;
};

// Reads every frame. Throws std::runtime_error naming the folder.
CheckResult check_campaign(const Manifest& manifest, const std::string& folder);

}  // namespace selenograph::server
