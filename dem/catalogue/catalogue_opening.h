// Finds and inspects the files of a catalogue.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
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

struct CatalogueOptions {
  // Cache folder. Results are saved in its folder "catalogue/", so that unchanged files need not be read at the next
  // opening; empty: nothing is saved, and every file is read.
  std::string cache_dir{};
  // Receives messages for the operator, each once: the reason why a saved catalogue could not be used or written. May
  // be empty.
  std::function<void(const std::string&)> log{};
  // Shortest age of a change that is trusted. A file that changed more recently is read again at the next opening: a
  // second change within one clock step of the file system alters neither size nor time.
  std::chrono::nanoseconds settling = std::chrono::seconds(2);
};

struct FoundFiles {
  std::vector<RasterInfo> rasters;  // usable rasters, each file once
  std::vector<CatalogueProblem> problems;
  std::vector<SideLayer> side_layers;
  std::size_t inspected = 0;  // number of files that had to be read
};

// Finds and inspects the files of `paths`: see Catalogue's constructor. Works on all cores. Saves the results for the
// next opening.
FoundFiles find_files(const std::vector<std::string>& paths, const CatalogueOptions& options);

}  // namespace selenograph::dem
