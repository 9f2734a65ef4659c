// The labels of a shard's frames as one document in the COCO data format.
#pragma once

#include <atomic>
#include <cstddef>
#include <string>
#include <vector>

#include "server/campaign/journal.h"
#include "server/campaign/manifest.h"
#include "server/campaign/plan.h"

namespace selenograph::server {

struct CocoTally {
  std::string path;
  std::size_t images = 0, annotations = 0;
  std::size_t without = 0;  // frames without a coco.json
};

// Writes FOLDER/coco-00000-of-00001.json from the frames' own files, .npz or in tars, of which only the labels are
// read. An image's id is its line's number in the manifest; an annotation's is 65536 times that and its number in the
// frame's masks, which is its `mask_id`. So shards have no id in common, and an id is the same in any of them. `lines`
// in the order of the document; those without a frame are passed over. Annotations are not in memory all at once.
// Throws std::runtime_error naming the file that can't be read or written, or "interrupted" when `stop` says so.
CocoTally write_coco(const std::vector<const ManifestLine*>& lines, const Record& record, const Shard& shard,
                     const std::string& folder, const std::atomic<bool>& stop);

}  // namespace selenograph::server
