// PDS3 label of a sample tile.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "dem/sample/tile_terrain.h"

namespace selenograph::dem::sample {

inline constexpr std::int16_t kDummy = -9999;  // sample of a post without data

std::string name_of(const Tile& tile);
std::string label_of(const Tile& tile, const std::vector<std::int16_t>& posts);
std::string_view label_text();  // label.txt, made by deploy/support/embed.cmake

}  // namespace selenograph::dem::sample
