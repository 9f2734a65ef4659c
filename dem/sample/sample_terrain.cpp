#include "dem/sample/sample_terrain.h"

#include <fmt/format.h>

#include <GeographicLib/Math.hpp>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <optional>
#include <stdexcept>

#include "dem/sample/crater_profile.h"
#include "dem/support/error.h"
#include "dem/support/parallel.h"

namespace selenograph::dem {
namespace {

using namespace sample;

constexpr std::int16_t kDummy = -9999;
constexpr int kBlock = 64;  // posts; one block's layers fit into a core's second-level cache

// ---- ground before the craters --------------------------------------------------------------------------------------

// Height at one post, split by the size of the relief it belongs to: layer 0 is what no crater erases, layer o + 1 goes
// with craters of octave o. A new crater erases older relief of its own size and smaller, and merely lies on the
// larger. That makes superposition a matter of each post alone: no crater needs the height anywhere else, so tiles
// can't disagree.
struct Layers {
  std::array<float, 16> m{};
  double sum() const {
    double total = 0;
    for (const float layer : m) total += static_cast<double>(layer);
    return total;
  }
};

int layer_of_octave(int octave) { return std::min(octave + 1, 15); }

class Landscape {
 public:
  explicit Landscape(std::uint64_t seed) : seed_(mix(seed, 77)) {}

  // Highlands that sink into a basin where the lowest frequencies say so.
  void lay_highlands(const Vec3& p_m, Layers& layers) const;
  // Lava fills the basin up to its level and buries what lies below, small relief and all.
  void flood_maria(const Vec3& p_m, Layers& layers) const;

 private:
  double noise(const Vec3& p_m, double cell_m, std::uint64_t salt) const {
    return gradient_noise(p_m.x() / cell_m, p_m.y() / cell_m, p_m.z() / cell_m, seed_ + salt);
  }
  double basin_field(const Vec3& p_m) const {
    return noise(p_m, 700e3, 1) + 0.4 * noise(p_m, 230e3, 2) + 0.15 * noise(p_m, 70e3, 3);
  }
  double wrinkle_ridges_m(const Vec3& p_m) const;

  std::uint64_t seed_;
};

void Landscape::lay_highlands(const Vec3& p_m, Layers& layers) const {
  constexpr double kHighland_m = 1000, kBasinDepth_m = 3300;
  const double basin = smoothstep(0.0, 0.3, basin_field(p_m));
  layers.m[0] = static_cast<float>(kHighland_m - kBasinDepth_m * basin);
  // Slopes fall slowly with scale: Hurst exponent 0.95 in the highlands (Rosenburg et al. 2011). Nothing below 250 m:
  // there the regolith is smooth but for craters.
  constexpr double kHurst = 0.8, kAmplitude_m = 750;
  static const double kGain = std::exp2(-kHurst);
  double cell_m = 128e3, amplitude_m = kAmplitude_m;
  for (int i = 0; i < 10; ++i, cell_m /= 2, amplitude_m *= kGain) {
    const int layer = i < 2 ? 0 : layer_of_octave(i - 2);
    layers.m[static_cast<std::size_t>(layer)] +=
        static_cast<float>(amplitude_m * noise(p_m, cell_m, 10 + static_cast<std::uint64_t>(i)));
  }
}

// Broad low arches with a narrow wandering crest (Plescia & Golombek 1986), along the zero lines of a noise.
double Landscape::wrinkle_ridges_m(const Vec3& p_m) const {
  const double where = smoothstep(0.0, 0.35, noise(p_m, 40e3, 41) + 0.15);
  if (where <= 0) return 0;
  const double line = noise(p_m, 38e3, 42) + 0.05 * noise(p_m, 6e3, 43);
  const double crest = line + 0.025 * noise(p_m, 3.5e3, 44);
  const double arch_m = 120 * std::exp(-std::pow(line / 0.05, 2));
  const double crest_m = 45 * std::exp(-std::pow(crest / 0.012, 2)) * (1 + 0.5 * noise(p_m, 2e3, 45));
  return where * (arch_m + crest_m);
}

void Landscape::flood_maria(const Vec3& p_m, Layers& layers) const {
  constexpr double kMare_m = -1500, kShore_m = 10;
  const double field = basin_field(p_m);
  if (field < 0) return;
  double level_m = kMare_m - 4000 * (1 - smoothstep(0.0, 0.12, field));
  const double before_m = layers.sum();
  if (before_m > level_m + 400) return;  // dry, and far above what the ridges could change
  level_m +=
      80 * noise(p_m, 90e3, 30) + 35 * noise(p_m, 25e3, 31) + 16 * noise(p_m, 7e3, 32) + 6 * noise(p_m, 2.2e3, 33);
  level_m += wrinkle_ridges_m(p_m);
  // Smooth maximum of ground and lava.
  const double above = (before_m - level_m) / kShore_m;
  const double after_m = level_m + kShore_m * (above > 30 ? above : std::log1p(std::exp(above)));
  // What is buried can't be erased by later craters. Gradually with depth: an edge at the shore would become a cliff
  // wherever a later crater erases one side and not the other.
  const double dry = smoothstep(-600, 0, before_m - level_m);
  for (float& layer : layers.m) layer *= static_cast<float>(dry);
  layers.m[0] += static_cast<float>(after_m - layers.sum());
}

// ---- one tile -------------------------------------------------------------------------------------------------------

struct Tile {
  int south_deg, west_deg;  // west in 0..359
  int posts_per_degree;
  double top_deg() const { return south_deg + 1; }
  double step_deg() const { return 1.0 / posts_per_degree; }
};

struct CraterInBlock {
  const Crater* crater;
  const CraterShape* shape;
};

// Heights of a tile, block by block. The height of a post follows from its place and the seed alone.
class TileTerrain {
 public:
  TileTerrain(const Tile& tile, std::uint64_t seed);
  // Fills one row of blocks of posts[ppd][ppd].
  void evaluate_strip(int strip, std::vector<std::int16_t>& posts) const;
  int strips() const { return blocks_; }

 private:
  struct Angle {
    double sine, cosine;
  };
  struct Window {  // posts, half open
    int row0, row1, column0, column1;
  };
  Window window_of(const Crater& crater, double reach_m) const;
  void bin_craters();
  Vec3 direction(int row, int column) const {
    const Angle &lat = rows_[static_cast<std::size_t>(row)], &lon = columns_[static_cast<std::size_t>(column)];
    return {lat.cosine * lon.cosine, lat.cosine * lon.sine, lat.sine};
  }
  void stamp(const CraterInBlock& c, const Window& block, std::vector<Layers>& layers) const;
  void evaluate_block(const Window& block, const std::vector<int>& craters, std::vector<Layers>& layers) const;

  Tile tile_;
  Landscape landscape_;
  int size_, blocks_;
  std::vector<Angle> rows_, columns_;
  std::vector<Crater> craters_;  // oldest first
  std::vector<CraterShape> shapes_;
  std::vector<std::vector<int>> in_block_;
};

TileTerrain::TileTerrain(const Tile& tile, std::uint64_t seed)
    : tile_(tile), landscape_(seed), size_(tile.posts_per_degree), blocks_((size_ + kBlock - 1) / kBlock) {
  // GeographicLib's are exact at multiples of 90 degrees, so the first row of a polar tile is one point.
  for (int i = 0; i < size_; ++i) {
    Angle lat, lon;
    GeographicLib::Math::sincosd(tile.top_deg() - i * tile.step_deg(), lat.sine, lat.cosine);
    GeographicLib::Math::sincosd(tile.west_deg + i * tile.step_deg(), lon.sine, lon.cosine);
    rows_.push_back(lat);
    columns_.push_back(lon);
  }
  // Below three posts a crater is not a shape any more.
  const double smallest_m = 3 * tile.step_deg() * kRadiansPerDegree * kMoonRadius_m;
  const double west = tile.west_deg, south = tile.south_deg;
  craters_ = craters_reaching({south, south + 1, west, west + 1}, seed, smallest_m);
  shapes_.reserve(craters_.size());
  for (const Crater& c : craters_) shapes_.emplace_back(c);
  bin_craters();
}

TileTerrain::Window TileTerrain::window_of(const Crater& crater, double reach_m) const {
  const double reach_deg = reach_m / kMoonRadius_m / kRadiansPerDegree;
  const double ppd = size_;
  const auto post = [&](double x) { return static_cast<int>(std::clamp(x, -1.0, ppd + 1)); };
  Window w{post((tile_.top_deg() - crater.lat_deg - reach_deg) * ppd),
           post((tile_.top_deg() - crater.lat_deg + reach_deg) * ppd) + 2, 0, size_};
  if (std::abs(crater.lat_deg) + reach_deg < 90) {
    const double half_deg =
        std::asin(std::sin(reach_deg * kRadiansPerDegree) / std::cos(crater.lat_deg * kRadiansPerDegree)) /
        kRadiansPerDegree;
    // Relative to the tile's middle, so that the wrap is far from every crater that matters, the widest ones excepted.
    const double middle = wrap_lon_deg(crater.lon_deg - tile_.west_deg - 0.5) + 0.5;
    if (half_deg < 90) w.column0 = post((middle - half_deg) * ppd), w.column1 = post((middle + half_deg) * ppd) + 2;
  }
  w = {std::max(w.row0 - 1, 0), std::min(w.row1, size_), std::max(w.column0 - 1, 0), std::min(w.column1, size_)};
  return w;
}

void TileTerrain::bin_craters() {
  in_block_.resize(static_cast<std::size_t>(blocks_ * blocks_));
  for (int i = 0; i < static_cast<int>(craters_.size()); ++i) {
    const auto at = static_cast<std::size_t>(i);
    const Window w = window_of(craters_[at], shapes_[at].reach_m());
    for (int r = w.row0 / kBlock; r * kBlock < w.row1; ++r) {
      for (int c = w.column0 / kBlock; c * kBlock < w.column1; ++c) {
        in_block_[static_cast<std::size_t>(r * blocks_ + c)].push_back(i);
      }
    }
  }
}

void TileTerrain::stamp(const CraterInBlock& c, const Window& block, std::vector<Layers>& layers) const {
  const Window w = window_of(*c.crater, c.shape->reach_m());
  const EastNorthUp axes = local_axes(c.crater->center);
  const auto own = static_cast<std::size_t>(layer_of_octave(c.crater->octave));
  // Relief of up to twice its own size goes too: the rim of a somewhat larger crater doesn't survive in a cavity.
  const std::size_t oldest = std::max<std::size_t>(1, own - 1);
  for (int row = std::max(w.row0, block.row0); row < std::min(w.row1, block.row1); ++row) {
    for (int column = std::max(w.column0, block.column0); column < std::min(w.column1, block.column1); ++column) {
      const Vec3 away = (direction(row, column) - c.crater->center) * kMoonRadius_m;
      const double r2 = away.squaredNorm();
      if (r2 >= c.shape->reach_m() * c.shape->reach_m()) continue;
      // Azimuth from the tangent plane, distance along the chord (within 0.01 % of the great circle at 80 km).
      const double east = away.dot(axes.east), north = away.dot(axes.north);
      const double planar2 = east * east + north * north;
      const double stretch = planar2 > 0 ? std::sqrt(r2 / planar2) : 1;
      const CraterShape::Trace t = c.shape->trace(east * stretch, north * stretch);
      Layers& post = layers[static_cast<std::size_t>((row - block.row0) * kBlock + column - block.column0)];
      if (t.keep < 1) {
        for (std::size_t i = oldest; i < post.m.size(); ++i) post.m[i] *= static_cast<float>(t.keep);
      }
      post.m[own] += static_cast<float>(t.height_m);
    }
  }
}

// The history of the place in its order: highlands, old craters, lava, young craters.
void TileTerrain::evaluate_block(const Window& block, const std::vector<int>& craters,
                                 std::vector<Layers>& layers) const {
  const auto for_each_post = [&](auto&& visit) {
    for (int row = block.row0; row < block.row1; ++row) {
      for (int column = block.column0; column < block.column1; ++column) {
        visit(direction(row, column) * kMoonRadius_m,
              layers[static_cast<std::size_t>((row - block.row0) * kBlock + column - block.column0)]);
      }
    }
  };
  layers.assign(kBlock * kBlock, {});
  for_each_post([&](const Vec3& p_m, Layers& post) { landscape_.lay_highlands(p_m, post); });
  bool flooded = false;
  const auto flood = [&] {
    for_each_post([&](const Vec3& p_m, Layers& post) { landscape_.flood_maria(p_m, post); });
    flooded = true;
  };
  for (const int i : craters) {
    const auto at = static_cast<std::size_t>(i);
    if (!flooded && craters_[at].age < 1) flood();
    stamp({&craters_[at], &shapes_[at]}, block, layers);
  }
  if (!flooded) flood();
}

void TileTerrain::evaluate_strip(int strip, std::vector<std::int16_t>& posts) const {
  in_parallel(static_cast<std::size_t>(blocks_), [&](std::size_t index) {
    const int b = static_cast<int>(index);
    thread_local std::vector<Layers> layers;
    const Window block{strip * kBlock, std::min((strip + 1) * kBlock, size_), b * kBlock,
                       std::min((b + 1) * kBlock, size_)};
    evaluate_block(block, in_block_[static_cast<std::size_t>(strip * blocks_ + b)], layers);
    for (int row = block.row0; row < block.row1; ++row) {
      for (int column = block.column0; column < block.column1; ++column) {
        const Layers& post = layers[static_cast<std::size_t>((row - block.row0) * kBlock + column - block.column0)];
        posts[static_cast<std::size_t>(row) * static_cast<std::size_t>(size_) + static_cast<std::size_t>(column)] =
            static_cast<std::int16_t>(std::lround(post.sum()));
      }
    }
  });
}

// ---- voids ----------------------------------------------------------------------------------------------------------

// Stereo matching fails on steep and shadowed ground, so of several places drawn the steepest becomes a void.
std::pair<int, int> steepest_of_some(const std::vector<std::int16_t>& posts, int size, SplitMix& random) {
  std::pair<int, int> best{0, 0};
  int steepest = -1;
  const auto at = [&](int r, int c) { return posts[static_cast<std::size_t>(r * size + c)]; };
  for (int i = 0; i < 24; ++i) {
    const int row = static_cast<int>(random.uniform(1, size - 1)),
              column = static_cast<int>(random.uniform(1, size - 1));
    const int rise =
        std::abs(at(row + 1, column) - at(row - 1, column)) + std::abs(at(row, column + 1) - at(row, column - 1));
    if (rise > steepest) steepest = rise, best = {row, column};
  }
  return best;
}

// Four voids of a few posts and one of a few dozen.
void punch_voids(const Tile& tile, std::uint64_t seed, std::vector<std::int16_t>& posts) {
  const int size = tile.posts_per_degree;
  SplitMix random(
      mix(seed, mix(static_cast<std::uint64_t>(tile.south_deg + 90), static_cast<std::uint64_t>(tile.west_deg))));
  for (int i = 0; i < 5; ++i) {
    const bool large = i == 0 && size >= 64;
    const double across = large ? 3.6 : random.uniform(0.8, 1.6), along = large ? 3.0 : random.uniform(0.8, 1.2);
    const auto [row, column] = steepest_of_some(posts, size, random);
    for (int r = std::max(row - 4, 0); r <= std::min(row + 4, size - 1); ++r) {
      for (int c = std::max(column - 4, 0); c <= std::min(column + 4, size - 1); ++c) {
        const double y = (r - row) / along, x = (c - column) / across;
        if (x * x + y * y <= 1) posts[static_cast<std::size_t>(r * size + c)] = kDummy;
      }
    }
  }
}

// ---- label ----------------------------------------------------------------------------------------------------------

struct Statistics {
  int minimum = 0, maximum = 0, mode = 0;
  double average = 0, deviation = 0;
};

// Over the valid posts, as the archive's labels have it.
Statistics statistics_of(const std::vector<std::int16_t>& posts) {
  std::vector<std::int64_t> count(65536);
  std::int64_t valid = 0;
  for (const std::int16_t h : posts) {
    if (h == kDummy) continue;
    ++count[static_cast<std::size_t>(h + 32768)];
    ++valid;
  }
  Statistics s{32767, -32768, 0, 0, 0};
  double sum = 0, squares = 0;
  std::int64_t most = 0;
  for (int h = -32768; h <= 32767; ++h) {
    const std::int64_t n = count[static_cast<std::size_t>(h + 32768)];
    if (n == 0) continue;
    s.minimum = std::min(s.minimum, h), s.maximum = std::max(s.maximum, h);
    if (n > most) most = n, s.mode = h;
    sum += static_cast<double>(n) * h;
    squares += static_cast<double>(n) * h * h;
  }
  s.average = sum / static_cast<double>(valid);
  s.deviation = std::sqrt(std::max(0.0, squares / static_cast<double>(valid) - s.average * s.average));
  return s;
}

// SLDEM2013's names: top latitude, west longitude, bottom latitude, east longitude; E359 is followed by E000.
std::string name_of(const Tile& tile) {
  const auto latitude = [](int deg) { return fmt::format("{}{:02}", deg < 0 ? 'S' : 'N', std::abs(deg)); };
  return fmt::format("DTM_MAP_01_{}E{:03}{}E{:03}SC", latitude(tile.south_deg + 1), tile.west_deg,
                     latitude(tile.south_deg), (tile.west_deg + 1) % 360);
}

// A detached PDS3 label, member by member as on the real product (JAXA SELENE TC DTM_MAP).
class Label {
 public:
  void line(const std::string& text) { text_ += text + "\r\n"; }
  void member(const std::string& key, const std::string& value) {
    line(fmt::format("{:<37}= {}", std::string(indent_, ' ') + key, value));
  }
  void quoted(const std::string& key, const std::string& value) { member(key, '"' + value + '"'); }
  void real(const std::string& key, double value, const std::string& unit = "") {
    member(key, fmt::format("{:.6f}{}", value, unit));
  }
  void integer(const std::string& key, int value) { member(key, std::to_string(value)); }
  void begin(const std::string& object) {
    member("OBJECT", object);
    indent_ = 2;
  }
  void end(const std::string& object) {
    indent_ = 0;
    member("END_OBJECT", object);
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
  std::size_t indent_ = 0;
};

void write_identity(Label& label, const std::string& name) {
  label.quoted("PDS_VERSION_ID", "PDS3");
  label.line("");
  label.line("/*** FILE FORMAT ***/");
  label.quoted("RECORD_TYPE", "UNDEFINED");
  label.quoted("FILE_NAME", name + ".img");
  label.member("^IMAGE", fmt::format("(\"{}.img\", 1 <BYTES>)", name));
  label.quoted("MISSION_NAME", "SELENE");
  label.quoted("DATA_SET_ID", "SYNTHETIC-SELENOGRAPH-SAMPLE-TERRAIN-IN-SLN-L-TC-5-DTM-MAP-FORMAT");
  label.quoted("DATA_SET_NAME", "SYNTHETIC SELENOGRAPH SAMPLE TERRAIN IN THE FORMAT OF SELENE MOON TC 5 DTM MAP");
  label.quoted("PRODUCT_ID", name);
  label.quoted("INSTRUMENT_TYPE", "IMAGER");
  label.quoted("INSTRUMENT_ID", "TC");
  label.quoted("INSTRUMENT_NAME", "TERRAIN CAMERA");
  label.quoted("INSTRUMENT_HOST_NAME", "SELENE MAIN ORBITER");
  label.quoted("TARGET_TYPE", "SATELLITE");
  label.quoted("TARGET_NAME", "MOON");
  label.quoted("PRODUCER_ID", "SELENOGRAPH");
  label.quoted("PRODUCT_SET_ID", "DTM_MAP");
  label.quoted("PRODUCT_VERSION_ID", "01");
}

void write_corners(Label& label, const Tile& tile) {
  const double north = tile.top_deg(), south = tile.south_deg + tile.step_deg();
  const double west = tile.west_deg, east = tile.west_deg + 1 - tile.step_deg();
  const auto corner = [&](const std::string& which, double lat, double lon) {
    label.real(which + "_LATITUDE", lat, " <deg>");
    label.real(which + "_LONGITUDE", lon, " <deg>");
  };
  corner("UPPER_LEFT", north, west);
  corner("UPPER_RIGHT", north, east);
  corner("LOWER_LEFT", south, west);
  corner("LOWER_RIGHT", south, east);
}

void write_projection(Label& label, const Tile& tile) {
  const double ppd = tile.posts_per_degree;
  label.begin("IMAGE_MAP_PROJECTION");
  label.quoted("^DATA_SET_MAP_PROJECTION", "DSMAP.CAT");
  label.quoted("MAP_PROJECTION_TYPE", "SIMPLE CYLINDRICAL");
  label.quoted("COORDINATE_SYSTEM_TYPE", "BODY-FIXED ROTATING");
  label.quoted("COORDINATE_SYSTEM_NAME", "PLANETOCENTRIC");
  for (const char* axis : {"A", "B", "C"})
    label.real(fmt::format("{}_AXIS_RADIUS", axis), kMoonRadius_m * 1e-3, " <km>");
  label.quoted("FIRST_STANDARD_PARALLEL", "N/A");
  label.quoted("SECOND_STANDARD_PARALLEL", "N/A");
  label.quoted("POSITIVE_LONGITUDE_DIRECTION", "EAST");
  label.real("CENTER_LATITUDE", 0, " <deg>");
  label.real("CENTER_LONGITUDE", 0, " <deg>");
  label.quoted("REFERENCE_LATITUDE", "N/A");
  label.quoted("REFERENCE_LONGITUDE", "N/A");
  label.integer("LINE_FIRST_PIXEL", 1);
  label.integer("LINE_LAST_PIXEL", tile.posts_per_degree);
  label.integer("SAMPLE_FIRST_PIXEL", 1);
  label.integer("SAMPLE_LAST_PIXEL", tile.posts_per_degree);
  label.real("MAP_PROJECTION_ROTATION", 0, " <deg>");
  label.real("MAP_RESOLUTION", ppd, " <pixel/deg>");
  label.member("MAP_SCALE", fmt::format("{:.16f} <km/pixel>", kMoonRadius_m * 1e-3 * kRadiansPerDegree / ppd));
  label.real("MAXIMUM_LATITUDE", tile.top_deg(), " <deg>");
  label.real("MINIMUM_LATITUDE", tile.south_deg + tile.step_deg(), " <deg>");
  label.real("EASTERNMOST_LONGITUDE", tile.west_deg + 1 - tile.step_deg(), " <deg>");
  label.real("WESTERNMOST_LONGITUDE", tile.west_deg, " <deg>");
  label.real("LINE_PROJECTION_OFFSET", tile.top_deg() * ppd, " <pixel>");
  label.real("SAMPLE_PROJECTION_OFFSET", 0.0 - tile.west_deg * ppd, " <pixel>");  // 0 - 0: never minus zero
  label.quoted("RESAMPLING_METHOD", "N/A");
  label.end("IMAGE_MAP_PROJECTION");
}

void write_processing(Label& label) {
  label.begin("PROCESSING_PARAMETERS");
  for (const char* key : {"PARAMETER_SET_NAME", "HORIZONTAL_TRANSFORM_METHOD", "VERTICAL_TRANSFORM_METHOD",
                          "MOSAIC_PRIORITY", "SMOOTHING_WIDTH"}) {
    label.quoted(key, "N/A");
  }
  label.end("PROCESSING_PARAMETERS");
}

void write_image(Label& label, const Tile& tile, const Statistics& s) {
  label.begin("IMAGE");
  label.integer("BANDS", 1);
  label.member("BAND_STORAGE_TYPE", "BAND_SEQUENTIAL");
  label.integer("LINES", tile.posts_per_degree);
  label.integer("LINE_SAMPLES", tile.posts_per_degree);
  label.member("SAMPLE_TYPE", "MSB_INTEGER");
  label.integer("SAMPLE_BITS", 16);
  label.quoted("IMAGE_VALUE_TYPE", "ALTITUDE");
  label.real("OFFSET", 0);
  label.real("SCALING_FACTOR", 1);
  label.quoted("STRETCHED_FLAG", "FALSE");
  label.integer("VALID_MINIMUM", -32767);
  label.integer("VALID_MAXIMUM", 32767);
  label.integer("DUMMY", kDummy);
  label.integer("MINIMUM", s.minimum);
  label.integer("MAXIMUM", s.maximum);
  label.real("AVERAGE", s.average);
  label.real("STDEV", s.deviation);
  label.integer("MODE_PIXEL", s.mode);
  label.quoted("UNIT", "m");
  label.end("IMAGE");
}

std::string label_of(const Tile& tile, const std::vector<std::int16_t>& posts) {
  Label label;
  write_identity(label, name_of(tile));
  write_corners(label, tile);
  write_projection(label, tile);
  write_processing(label);
  write_image(label, tile, statistics_of(posts));
  label.line("END");
  return label.text();
}

// ---- files ----------------------------------------------------------------------------------------------------------

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

void write_whole(const std::filesystem::path& path, const std::string& bytes) {
  const std::filesystem::path temporary = path.string() + ".part";
  {
    std::ofstream file(temporary, std::ios::binary | std::ios::trunc);
    file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    file.close();
    if (!file) throw DataError(temporary.string(), "cannot be written");
  }
  std::error_code error;
  std::filesystem::rename(temporary, path, error);
  if (error) throw DataError(path.string(), "cannot be written: " + error.message());
}

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
  if (o.date_line) add(o.south_deg, 179), add(o.south_deg, 180);
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
    // The label last: a catalogue opens labels, and must then find the image.
    const std::filesystem::path base = std::filesystem::path(folder) / name_of(tile);
    write_whole(base.string() + ".img", big_endian_bytes(posts));
    write_whole(base.string() + ".lbl", label_of(tile, posts));
    labels.push_back(base.string() + ".lbl");
  }
  return labels;
}

}  // namespace selenograph::dem
