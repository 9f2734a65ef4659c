#include "engine/sky/star_catalogue.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <numbers>
#include <numeric>

#include "dem/base/error.h"
#include "dem/base/hash.h"
#include "dem/files/files.h"
#include "engine/support/csv.h"
#include "engine/support/utf8.h"

namespace selenograph::engine {
namespace {

constexpr std::string_view kStarColumns =
    "id,ra_deg,dec_deg,epoch_yr,pm_ra_mas_yr,pm_dec_mas_yr,parallax_mas,v_mag,b_v";
constexpr double kRadiansPerMas = kRadiansPerDegree / 3.6e6, kJ2000_yr = 2000;

// A column of numbers and the range of its values.
struct StarColumn {
  const char* name;
  double low, high;
};
constexpr StarColumn kStarRanges[] = {
    {"ra_deg", 0, 360},           {"dec_deg", -90, 90},      {"epoch_yr", 1850, 2150}, {"pm_ra_mas_yr", -2e4, 2e4},
    {"pm_dec_mas_yr", -2e4, 2e4}, {"parallax_mas", 0, 1000}, {"v_mag", -5, 30},        {"b_v", -1, 10}};

// Reads a line of the file; throws BadLine with the reason.
StarRow star_row(std::string_view line) {
  const std::size_t comma = line.find(',');
  if (comma == 0 || comma == std::string_view::npos) throw BadLine("an identifier is expected, then numbers");
  if (!is_utf8(line.substr(0, comma))) throw BadLine("the identifier is not UTF-8");
  const std::vector<double> v = csv_numbers(line.substr(comma + 1));
  if (v.size() != std::size(kStarRanges))
    throw BadLine(
        fmt::format("has {} numbers behind the identifier; {} are expected", v.size(), std::size(kStarRanges)));
  for (std::size_t i = 0; i < v.size(); ++i)
    if (!(v[i] >= kStarRanges[i].low && v[i] <= kStarRanges[i].high))
      throw BadLine(
          fmt::format("{} must be {:g} to {:g}", kStarRanges[i].name, kStarRanges[i].low, kStarRanges[i].high));
  return {std::string(line.substr(0, comma)), v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7]};
}

// Moves a star from the catalogue's epoch to J2000.0, along the tangent of the sphere: the catalogue has no radial
// velocities.
Star star_of(const StarRow& row) {
  const double ra = row.ra_deg * kRadiansPerDegree, dec = row.dec_deg * kRadiansPerDegree;
  const Vec3 position(std::cos(dec) * std::cos(ra), std::cos(dec) * std::sin(ra), std::sin(dec)),
      east(-std::sin(ra), std::cos(ra), 0),
      north(-std::sin(dec) * std::cos(ra), -std::sin(dec) * std::sin(ra), std::cos(dec));
  const Vec3 motion = kRadiansPerMas * (row.pm_ra_mas_yr * east + row.pm_dec_mas_yr * north);
  return {position + (kJ2000_yr - row.epoch_yr) * motion, motion.cast<float>(),
          static_cast<float>(row.parallax_mas * kRadiansPerMas), static_cast<float>(row.v_mag),
          static_cast<float>(row.b_v)};
}

// Bands of declination, each divided in right ascension into cells that are about square.
class CellGrid {
 public:
  static constexpr int kBands = 90;
  CellGrid() {
    first_.push_back(0);
    for (int band = 0; band < kBands; ++band) {
      const double middle = (band + 0.5) * std::numbers::pi / kBands - std::numbers::pi / 2;
      first_.push_back(first_.back() + std::max(1, static_cast<int>(std::lround(2 * kBands * std::cos(middle)))));
    }
  }
  // Returns the number of the cell that contains a unit position, ICRF: cells are numbered band by band.
  std::size_t cell(const Vec3& position) const {
    const double dec = std::atan2(position.z(), std::hypot(position.x(), position.y())),
                 ra = std::atan2(position.y(), position.x());
    const int band = std::clamp(static_cast<int>((dec / std::numbers::pi + 0.5) * kBands), 0, kBands - 1);
    const int first = first_[static_cast<std::size_t>(band)],
              count = first_[static_cast<std::size_t>(band) + 1] - first;
    return static_cast<std::size_t>(
        first + std::clamp(static_cast<int>((ra / (2 * std::numbers::pi) + 0.5) * count), 0, count - 1));
  }

 private:
  std::vector<int> first_;  // number of each band's first cell, and of all cells
};

}  // namespace

StarCatalogue StarCatalogue::read(const std::string& path, std::size_t max_bytes, const StopToken& stop) {
  std::size_t lines = 0;
  each_csv_line(
      path, [&](std::string_view) { ++lines; }, stop);
  // Per star: its row, the star, its cell, its rank in the sorted order, the end of its identifier. Identifiers exist
  // twice, in the rows and in ids_.
  constexpr std::size_t kBytesPerStar = sizeof(StarRow) + sizeof(Star) + 3 * sizeof(std::uint32_t) + 4;
  static_assert(kBytesPerStar == 160);
  const auto state = dem::file_state(path);
  const std::size_t bytes = kBytesPerStar * lines + 2 * (state ? state->bytes : 0);
  if (bytes > max_bytes)
    throw DataError(path, fmt::format("has {} lines, which take {} MiB to read; {} MiB are allowed (--mesh-mb)", lines,
                                      bytes >> 20, max_bytes >> 20));
  std::vector<StarRow> rows;
  rows.reserve(lines);
  bool headed = false;
  const auto add = [&](std::string_view line) {
    if (headed)
      rows.push_back(star_row(line));
    else if (line != kStarColumns)
      throw BadLine(fmt::format("the columns must be {}", kStarColumns));
    headed = true;
  };
  each_csv_line(path, add, stop);
  if (rows.empty()) throw DataError(path, "has no stars");
  return StarCatalogue(std::filesystem::path(path).stem().string(), rows);
}

StarCatalogue::StarCatalogue(std::string name, const std::vector<StarRow>& rows) : name_(std::move(name)) {
  const CellGrid grid;
  std::vector<std::uint32_t> cell;
  cell.reserve(rows.size());
  for (const StarRow& row : rows) cell.push_back(static_cast<std::uint32_t>(grid.cell(star_of(row).position)));
  std::vector<std::uint32_t> order(rows.size());
  std::iota(order.begin(), order.end(), 0U);
  const auto magnitude = [&](std::uint32_t i) { return static_cast<float>(rows[i].v_mag); };
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return cell[a] != cell[b] ? cell[a] < cell[b] : magnitude(a) < magnitude(b);
  });
  // Store the stars by cell and magnitude; each cell with its first and past-last star and the sum of their positions.
  std::uint64_t hash = 0;
  stars_.reserve(rows.size());
  id_ends_.reserve(rows.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (i == 0 || cell[order[i]] != cell[order[i - 1]])
      cells_.push_back({Vec3::zero(), 0, static_cast<std::uint32_t>(i), 0});
    const Star& star = stars_.emplace_back(star_of(rows[order[i]]));
    fastest_rad_yr_ = std::max(fastest_rad_yr_, static_cast<double>(star.motion_rad_yr.norm()));
    ids_ += rows[order[i]].id;
    id_ends_.push_back(static_cast<std::uint32_t>(ids_.size()));
    cells_.back().past_last = static_cast<std::uint32_t>(i + 1);
    cells_.back().centre += star.position;
    const double numbers[] = {star.position.x(),
                              star.position.y(),
                              star.position.z(),
                              rows[order[i]].pm_ra_mas_yr,
                              rows[order[i]].pm_dec_mas_yr,
                              rows[order[i]].parallax_mas,
                              rows[order[i]].v_mag,
                              rows[order[i]].b_v};
    hash = dem::hash_of(numbers, sizeof numbers, hash);
  }
  fingerprint_ = dem::hash_of(ids_.data(), ids_.size(), hash);
  // The sum's direction is the cell's centre; its radius is that of the circle around its stars.
  for (Cell& c : cells_) {
    c.centre.normalize();
    for (std::uint32_t i = c.first; i < c.past_last; ++i)
      c.radius_rad = std::max(c.radius_rad, angle_between(c.centre, stars_[i].position));
  }
}

std::size_t StarCatalogue::bytes() const {
  return sizeof *this + stars_.capacity() * sizeof(Star) + ids_.capacity() +
         id_ends_.capacity() * sizeof(std::uint32_t) + cells_.capacity() * sizeof(Cell);
}

std::string_view StarCatalogue::id(std::uint32_t index) const {
  const std::uint32_t first = index == 0 ? 0 : id_ends_[index - 1];
  return std::string_view(ids_).substr(first, id_ends_[index] - first);
}

double StarCatalogue::largest_motion_rad(double years) const { return fastest_rad_yr_ * std::abs(years); }

std::vector<std::uint32_t> StarCatalogue::within(const Vec3& direction, double radius_rad,
                                                 double magnitude_limit) const {
  std::vector<std::uint32_t> found;
  const double min_cosine = radius_rad < std::numbers::pi ? std::cos(radius_rad) : -2;
  for (const Cell& cell : cells_) {
    const double apart_rad = angle_between(cell.centre, direction);
    if (apart_rad > radius_rad + cell.radius_rad) continue;
    const bool is_inside = apart_rad + cell.radius_rad <= radius_rad;
    for (std::uint32_t i = cell.first; i < cell.past_last && static_cast<double>(stars_[i].v_mag) <= magnitude_limit;
         ++i)
      if (is_inside || stars_[i].position.dot(direction) >= min_cosine) found.push_back(i);
  }
  return found;
}

}  // namespace selenograph::engine
