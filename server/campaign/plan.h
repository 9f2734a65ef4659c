// Which lines of a manifest one process renders, in which order, and into which tars.
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
  // Of names and requests: what the tar's bytes follow from, with software and terrain.
  std::string sha256() const;
};

// A shard's part of all lines in the order of the terrain, in which those of one place keep the manifest's order and
// those that can't be read come last. The shards are a partition, contiguous along the order and of about the same
// work.
std::vector<const ManifestLine*> lines_of(const Manifest& manifest, const Shard& shard);

// The same as tars of so many lines. A tar is of one shard, and the tars are the same however many shards there are.
std::vector<TarPlan> tars_of(const Manifest& manifest, const Shard& shard, std::size_t lines_per_tar);

}  // namespace selenograph::server
