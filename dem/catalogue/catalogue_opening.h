// Finds and inspects the files of a catalogue.
#pragma once

#include <string>
#include <vector>

#include "dem/files/raster_info.h"

namespace selenograph::dem {

// File or folder that could not be used in full, and the reason. `info`, /v1/datasets and the log report it; it is
// never silent.
struct CatalogueProblem {
  std::string path;
  std::string what;
  bool located = false;    // the label is valid: the file is in the catalogue, and requests that need its posts fail
  bool unrelated = false;  // an image, or a file that may not be a height map: answers do not depend on it
};

// Raster of another quantity than heights, according to its label, its band's description or its name (quantity.h).
struct SideLayer {
  std::string path;
  std::string kind;  // the quantity, e.g. "error of heights"
};

struct FoundFiles {
  std::vector<RasterInfo> rasters;  // usable rasters, each file once
  std::vector<CatalogueProblem> problems;
  std::vector<SideLayer> side_layers;
};

// Finds and inspects the files of `paths`, on all cores: see Catalogue's constructor.
FoundFiles find_files(const std::vector<std::string>& paths);

}  // namespace selenograph::dem
