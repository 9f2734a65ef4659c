#include "dem/terrain/terrain.h"

#include <algorithm>
#include <filesystem>

namespace selenograph::dem {

int Terrain::finest_level(const BlockId& id) const { return std::max(kSmoothLevel, posts_level(id)); }

std::vector<std::string> Terrain::warnings_about(std::span<const SourceIndex> replaced) const {
  const auto name = [](const std::string& path) { return std::filesystem::path(path).filename().string(); };
  std::vector<std::string> texts;
  for (const CatalogueProblem& problem : catalogue().problems())
    if (!problem.located && !problem.unrelated)
      texts.push_back(name(problem.path) + ": cannot be used; where it lies is unknown");
  for (const SourceIndex i : replaced)
    texts.push_back(name(catalogue().rasters()[i].path) + ": cannot be used; the layer below stands in for it");
  return texts;
}

}  // namespace selenograph::dem
