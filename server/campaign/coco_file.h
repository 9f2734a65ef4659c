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
  std::size_t without_labels = 0;  // frames without a coco.json
};

// Writes FOLDER/coco-00000-of-00001.json from the labels in the frames' own files, which are .npz or in tars. The
// document has the order of `lines`; lines without a frame are skipped. It is streamed, so that annotations are not in
// memory all at once. Throws std::runtime_error naming the file that can't be read or written, or "interrupted" when
// `stop` is set.
//
// Identifiers are the same in every shard, and shards have none in common: an image's id is its line's number in the
// manifest; an annotation's is 65536 times that plus its `mask_id`, its number in the frame's masks.
CocoTally write_coco(const std::vector<const ManifestLine*>& lines, const Record& record, const Shard& shard,
                     const std::string& folder, const std::atomic<bool>& stop);

}  // namespace selenograph::server
