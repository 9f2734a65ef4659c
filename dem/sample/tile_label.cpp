#include "dem/sample/tile_label.h"

#include <fmt/args.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "dem/grid/geodesy.h"

namespace selenograph::dem::sample {

namespace {

struct Statistics {
  int minimum = 0, maximum = 0, mode = 0;
  double average = 0, deviation = 0;
};

// Returns statistics of the valid posts, as in the archive's labels.
Statistics statistics_of(const std::vector<std::int16_t>& posts) {
  std::vector<std::int64_t> count(65536);
  std::int64_t valid = 0;
  for (const std::int16_t h : posts) {
    if (h == kDummy) continue;
    ++count[static_cast<std::size_t>(h + 32768)];
    ++valid;
  }
  Statistics s{32767, -32768, 0, 0, 0};
  double sum = 0, squares = 0;  // of heights, and of their squares
  std::int64_t mode_count = 0;
  for (int h = -32768; h <= 32767; ++h) {
    const std::int64_t n = count[static_cast<std::size_t>(h + 32768)];
    if (n == 0) continue;
    s.minimum = std::min(s.minimum, h);
    s.maximum = std::max(s.maximum, h);
    if (n > mode_count) {
      mode_count = n;
      s.mode = h;
    }
    sum += static_cast<double>(n) * h;
    squares += static_cast<double>(n) * h * h;
  }
  s.average = sum / static_cast<double>(valid);
  s.deviation = std::sqrt(std::max(0.0, squares / static_cast<double>(valid) - s.average * s.average));
  return s;
}

}  // namespace

// Returns a name like SLDEM2013's: top latitude, west longitude, bottom latitude, east longitude; E359 is followed by
// E000.
std::string name_of(const Tile& tile) {
  const auto latitude = [](int deg) { return fmt::format("{}{:02}", deg < 0 ? 'S' : 'N', std::abs(deg)); };
  return fmt::format("DTM_MAP_01_{}E{:03}{}E{:03}SC", latitude(tile.south_deg + 1), tile.west_deg,
                     latitude(tile.south_deg), (tile.west_deg + 1) % 360);
}

// Returns a detached PDS3 label, with the keywords of the real product (JAXA SELENE TC DTM_MAP): label.txt.
std::string label_of(const Tile& tile, const std::vector<std::int16_t>& posts) {
  using fmt::arg;
  const Statistics s = statistics_of(posts);
  const double ppd = tile.posts_per_degree;
  const std::string text = fmt::format(
      fmt::runtime(label_text()), arg("name", name_of(tile)), arg("north", tile.top_deg()),
      arg("south", tile.south_deg + tile.step_deg()), arg("west", static_cast<double>(tile.west_deg)),
      arg("east", tile.west_deg + 1 - tile.step_deg()), arg("posts", tile.posts_per_degree), arg("resolution", ppd),
      arg("scale", kMoonRadius_m * 1e-3 * kRadiansPerDegree / ppd), arg("line_offset", tile.top_deg() * ppd),
      arg("sample_offset", 0.0 - tile.west_deg * ppd),  // subtract from 0.0, so that 0 is not printed as minus zero
      arg("minimum", s.minimum), arg("maximum", s.maximum), arg("average", s.average), arg("deviation", s.deviation),
      arg("mode", s.mode));
  std::string with_crlf;  // PDS3 ends lines with CR LF
  for (const char c : text) {
    if (c == '\n') with_crlf += '\r';
    with_crlf += c;
  }
  return with_crlf;
}

}  // namespace selenograph::dem::sample
