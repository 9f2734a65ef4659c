#include "dem/sample/sample_terrain.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <stdexcept>

#include "dem/base/error.h"
#include "dem/files/whole_file.h"
#include "dem/sample/tile_label.h"

namespace selenograph::dem {
namespace {

using namespace sample;

// Returns the steepest of 24 random posts, where a void will be: stereo matching fails on steep and shadowed ground.
std::pair<int, int> draw_steep_post(const std::vector<std::int16_t>& posts, int size, SplitMix& random) {
  std::pair<int, int> best{0, 0};
  int steepest = -1;
  const auto at = [&](int r, int c) { return posts[static_cast<std::size_t>(r * size + c)]; };
  for (int i = 0; i < 24; ++i) {
    const int row = static_cast<int>(random.uniform(1, size - 1)),
              column = static_cast<int>(random.uniform(1, size - 1));
    const int rise =
        std::abs(at(row + 1, column) - at(row - 1, column)) + std::abs(at(row, column + 1) - at(row, column - 1));
    if (rise > steepest) {
      steepest = rise;
      best = {row, column};
    }
  }
  return best;
}

// Sets four voids of a few posts and one of a few dozen, as ellipses.
void punch_voids(const Tile& tile, std::uint64_t seed, std::vector<std::int16_t>& posts) {
  const int size = tile.posts_per_degree;
  SplitMix random(
      mix(seed, mix(static_cast<std::uint64_t>(tile.south_deg + 90), static_cast<std::uint64_t>(tile.west_deg))));
  for (int i = 0; i < 5; ++i) {
    const bool large = i == 0 && size >= 64;
    const double half_width = large ? 3.6 : random.uniform(0.8, 1.6),
                 half_height = large ? 3.0 : random.uniform(0.8, 1.2);
    const auto [row, column] = draw_steep_post(posts, size, random);
    for (int r = std::max(row - 4, 0); r <= std::min(row + 4, size - 1); ++r) {
      for (int c = std::max(column - 4, 0); c <= std::min(column + 4, size - 1); ++c) {
        const double y = (r - row) / half_height, x = (c - column) / half_width;
        if (x * x + y * y <= 1) posts[static_cast<std::size_t>(r * size + c)] = kDummy;
      }
    }
  }
}

std::string big_endian_bytes(const std::vector<std::int16_t>& posts) {
  std::string bytes;
  bytes.reserve(posts.size() * 2);
  for (const std::int16_t h : posts) {
    const auto u = static_cast<std::uint16_t>(h);
    bytes.push_back(static_cast<char>(u >> 8));
    bytes.push_back(static_cast<char>(u & 0xFF));
  }
  return bytes;
}

// Throws std::invalid_argument for options out of range.
void check(const SampleOptions& o) {
  if (o.posts_per_degree < 16 || o.posts_per_degree > 16384 ||
      !std::has_single_bit(static_cast<unsigned>(o.posts_per_degree))) {
    throw std::invalid_argument("posts_per_degree must be a power of two from 16 to 16384");
  }
  if (o.rows < 1 || o.south_deg < -90 || o.rows > 90 - o.south_deg) {
    throw std::invalid_argument("the sample's rows must lie between 90 degrees south and north");
  }
  if (o.columns < 1 || o.columns > 360) throw std::invalid_argument("the sample's columns must be from 1 to 360");
}

// Returns the tiles of the sample, from north to south; each once, even if columns run around the globe.
std::vector<Tile> tiles_of(const SampleOptions& o) {
  std::vector<Tile> tiles;
  const auto add = [&](int south, int west) {
    const Tile tile{south, ((west % 360) + 360) % 360, o.posts_per_degree};
    const auto same = [&](const Tile& t) { return t.south_deg == tile.south_deg && t.west_deg == tile.west_deg; };
    if (std::none_of(tiles.begin(), tiles.end(), same)) tiles.push_back(tile);
  };
  for (int row = o.rows - 1; row >= 0; --row) {
    for (int column = 0; column < o.columns; ++column) add(o.south_deg + row, o.west_deg + column);
  }
  if (o.date_line) {
    add(o.south_deg, 179);
    add(o.south_deg, 180);
  }
  return tiles;
}

}  // namespace

std::vector<std::string> write_sample_terrain(const std::string& folder, const SampleOptions& options,
                                              const std::function<void(double)>& progress) {
  check(options);
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw DataError(folder, "cannot be created: " + error.message());
  const std::vector<Tile> tiles = tiles_of(options);
  std::vector<std::string> labels;
  for (const Tile& tile : tiles) {
    const TileTerrain terrain(tile, options.seed);
    const auto size = static_cast<std::size_t>(tile.posts_per_degree);
    std::vector<std::int16_t> posts(size * size);
    for (int strip = 0; strip < terrain.strips(); ++strip) {
      terrain.evaluate_strip(strip, posts);
      const double done = static_cast<double>(labels.size()) + (strip + 1.0) / terrain.strips();
      if (progress) progress(done / static_cast<double>(tiles.size()));
    }
    punch_voids(tile, options.seed, posts);
    // Write the label last: a catalogue opens labels, and must then find the image.
    const std::filesystem::path base = std::filesystem::path(folder) / name_of(tile);
    write_whole_file(base.string() + ".img", big_endian_bytes(posts));
    write_whole_file(base.string() + ".lbl", label_of(tile, posts));
    labels.push_back(base.string() + ".lbl");
  }
  return labels;
}

}  // namespace selenograph::dem
