// The lines of a manifest that one process renders, their order, and their tars.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "server/campaign/manifest.h"
#include "server/campaign/order.h"

namespace selenograph::server {

// The part of a campaign that one process renders.
struct Shard {
  std::size_t index = 0, of = 1;
};
// Parses "3/16" of --shard. Throws std::runtime_error.
Shard shard_of(const std::string& text);

struct TarPlan {
  std::string name;  // frames-000000.tar
  std::vector<const ManifestLine*> lines;
  // Returns the hash of names and requests, which determine the tar's bytes together with software and terrain.
  std::string sha256() const;
};

// Returns a shard's lines in the order of the terrain (order.h). Lines of one place keep the manifest's order, and
// unreadable lines come last. The shards partition this order into contiguous spans of about equal work:
//
//   order of the terrain  | 7 2 9 | 4 1 | 3 8 6 5 |     line numbers; a span is shorter where frames are larger
//                         shard 0   1       2
std::vector<const ManifestLine*> lines_of(const Manifest& manifest, const Shard& shard);

// Returns a shard's tars, of lines_per_tar lines each. The tars are cut first and then distributed, so that they do not
// depend on the number of shards.
std::vector<TarPlan> tars_of(const Manifest& manifest, const Shard& shard, std::size_t lines_per_tar);

}  // namespace selenograph::server
