// Finding the files of a catalogue, and what each of them holds.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "dem/catalogue/catalogue.h"

namespace selenograph::dem {

struct FoundFiles {
  std::vector<RasterInfo> rasters;  // each file once
  std::vector<CatalogueProblem> problems;
  std::vector<SideLayer> side_layers;
  std::size_t inspected = 0;  // that had to be read
};

// As Catalogue's constructor says; reads and checks on all cores, remote files on more threads than that. Keeps what it
// found for the next time.
FoundFiles find_files(const std::vector<std::string>& paths, const CatalogueOptions& options);

}  // namespace selenograph::dem
