// The lines of a manifest that one process renders, their order, and their tars.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "server/campaign/manifest.h"
#include "server/campaign/order.h"

namespace selenograph::server {

// One process of a campaign.
struct Shard {
  std::size_t index = 0, of = 1;
};

struct TarPlan {
  std::string name;  // frames-000000.tar
  std::vector<const ManifestLine*> lines;
  // Hash of names and requests, which determine the tar's bytes together with software and terrain.
  std::string sha256() const;
};

// A shard's part of all lines in the order of the terrain; lines of one place keep the manifest's order, and unreadable
// lines come last. The shards are a partition, contiguous along the order, with about equal work.
std::vector<const ManifestLine*> lines_of(const Manifest& manifest, const Shard& shard);

// A shard's tars, of lines_per_tar lines each. A tar belongs to one shard, and the tars do not depend on the number of
// shards.
std::vector<TarPlan> tars_of(const Manifest& manifest, const Shard& shard, std::size_t lines_per_tar);

}  // namespace selenograph::server
