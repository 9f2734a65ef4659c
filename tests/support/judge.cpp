#include "tests/support/judge.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <numbers>
#include <stdexcept>

namespace selenograph::test {
namespace {

namespace fs = std::filesystem;

constexpr std::int16_t kAbsent = -32768;  // no tile holds this post
constexpr std::int16_t kVoid = -32767;    // a tile holds this post as DUMMY
constexpr double kDegree = std::numbers::pi / 180;
// Tolerance of barycentric coordinates, so that rays along edges and through vertices hit at least one triangle: 30 nm
// at posts 30 m apart.
constexpr double kSlack = 1e-9;

// A tile by its label.
struct Tile {
  std::string image;
  int ppd = 0, lines = 0, samples = 0;
  int top = 0, west = 0;  // first post, in posts from the equator and the prime meridian
  double dummy = 0;
};

// Returns the label's "KEY = value" lines, without quotation marks.
std::map<std::string, std::string> members_of(const fs::path& label) {
  std::map<std::string, std::string> members;
  std::ifstream file(label);
  for (std::string line; std::getline(file, line);) {
    const std::size_t equals = line.find('=');
    if (equals == std::string::npos) continue;
    const auto trimmed = [](std::string s) {
      s.erase(0, s.find_first_not_of(" \""));
      const std::size_t end = s.find_last_not_of(" \"\r");
      return end == std::string::npos ? std::string() : s.substr(0, end + 1);
    };
    members.emplace(trimmed(line.substr(0, equals)), trimmed(line.substr(equals + 1)));
  }
  return members;
}

// Returns a whole number of posts. Throws std::runtime_error for another one.
int whole(double x, const fs::path& label) {
  if (std::abs(x - std::round(x)) > 1e-3) throw std::runtime_error(label.string() + ": posts are off the lattice");
  return static_cast<int>(std::lround(x));
}

Tile tile_of(const fs::path& label) {
  const auto members = members_of(label);
  const auto text = [&](const char* key) {
    const auto found = members.find(key);
    if (found == members.end()) throw std::runtime_error(label.string() + ": no " + key);
    return found->second;
  };
  const auto number = [&](const char* key) { return std::stod(text(key)); };
  if (text("SAMPLE_TYPE") != "MSB_INTEGER" || number("SAMPLE_BITS") != 16 || number("OFFSET") != 0 ||
      number("SCALING_FACTOR") != 1)
    throw std::runtime_error(label.string() + ": not whole metres in big-endian int16");
  Tile tile;
  tile.ppd = whole(number("MAP_RESOLUTION"), label);
  tile.lines = whole(number("LINES"), label);
  tile.samples = whole(number("LINE_SAMPLES"), label);
  tile.top = whole(number("UPPER_LEFT_LATITUDE") * tile.ppd, label);
  tile.west = whole(number("UPPER_LEFT_LONGITUDE") * tile.ppd, label);
  tile.dummy = number("DUMMY");
  const std::string pointer = text("^IMAGE");
  const std::size_t open = pointer.find('"'), close = pointer.find('"', open + 1);
  tile.image = (label.parent_path() / pointer.substr(open + 1, close - open - 1)).string();
  return tile;
}

std::vector<std::int16_t> read_posts(const Tile& tile) {
  std::ifstream file(tile.image, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(file), {}};
  const std::size_t count = static_cast<std::size_t>(tile.lines) * static_cast<std::size_t>(tile.samples);
  if (bytes.size() != 2 * count) throw std::runtime_error(tile.image + ": has another size than its label says");
  std::vector<std::int16_t> posts(count);
  for (std::size_t i = 0; i < count; ++i) {
    const int high = static_cast<unsigned char>(bytes[2 * i]), low = static_cast<unsigned char>(bytes[2 * i + 1]);
    const auto value = static_cast<std::int16_t>(high << 8 | low);
    posts[i] = value == tile.dummy ? kVoid : value;
  }
  return posts;
}

bool valid(std::int16_t post) { return post > kVoid; }

// Returns the distances along a unit direction at which a ray enters and leaves a sphere about the Moon's centre.
std::optional<std::pair<double, double>> through_sphere(const Vec3& origin, const Vec3& direction, double radius_m) {
  const double to_nearest_m = -origin.dot(direction);  // distance to the ray's point nearest to the centre
  const double squared_offset_m2 = origin.squared_norm() - to_nearest_m * to_nearest_m;
  if (squared_offset_m2 > radius_m * radius_m) return std::nullopt;
  const double half_chord_m = std::sqrt(radius_m * radius_m - squared_offset_m2);
  return std::pair(to_nearest_m - half_chord_m, to_nearest_m + half_chord_m);
}

}  // namespace

Judge::Judge(const std::string& folder, double raised_m) : raised_m_(raised_m) {
  place_tiles(folder);
  bound_voids();
  const auto trigonometry = [&](int first, int count, std::vector<double>& sines, std::vector<double>& cosines) {
    for (int i = 0; i < count; ++i) {
      const double angle = static_cast<double>(first + i) / ppd_ * kDegree;
      sines.push_back(std::sin(angle));
      cosines.push_back(std::cos(angle));
    }
  };
  trigonometry(south_, rows_, sin_lat_, cos_lat_);
  trigonometry(west_, columns_, sin_lon_, cos_lon_);
  if (std::abs(south_) > 75 * ppd_ || std::abs(south_ + rows_) > 75 * ppd_)
    throw std::runtime_error(folder + ": beyond 75 degrees of latitude");
  std::int16_t low = 32767, high = kVoid;
  for (const std::int16_t h : posts_) {
    if (!valid(h)) continue;
    low = std::min(low, h);
    high = std::max(high, h);
  }
  lowest_m_ = low + raised_m_;
  highest_m_ = high + raised_m_;
  for (std::size_t i = 0; i < maxima_.size(); ++i) maxima_[i] = maxima(std::array{1, 16, 256}[i]);
}

void Judge::place_tiles(const std::string& folder) {
  std::vector<Tile> tiles;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".lbl") tiles.push_back(tile_of(entry.path()));
  if (tiles.empty()) throw std::runtime_error(folder + ": no labels");
  ppd_ = tiles[0].ppd;
  int north = -90 * ppd_, south = 90 * ppd_, east = -1000 * ppd_, west = 1000 * ppd_;
  for (Tile& t : tiles) {
    if (t.ppd != ppd_) throw std::runtime_error(folder + ": more than one resolution");
    // Bring the tile to the same side of the date line, and of 0/360, as the first one.
    while (t.west - tiles[0].west > 180 * ppd_) t.west -= 360 * ppd_;
    while (t.west - tiles[0].west < -180 * ppd_) t.west += 360 * ppd_;
    north = std::max(north, t.top);
    south = std::min(south, t.top - t.lines + 1);
    west = std::min(west, t.west);
    east = std::max(east, t.west + t.samples - 1);
  }
  south_ = south;
  west_ = west;
  rows_ = north - south + 1;
  columns_ = east - west + 1;
  posts_.assign(static_cast<std::size_t>(rows_) * static_cast<std::size_t>(columns_), kAbsent);
  for (const Tile& t : tiles) {
    const std::vector<std::int16_t> posts = read_posts(t);
    for (int line = 0; line < t.lines; ++line)
      std::copy_n(posts.begin() + static_cast<std::ptrdiff_t>(line) * t.samples, t.samples,
                  posts_.begin() + static_cast<std::ptrdiff_t>(t.top - line - south_) * columns_ + (t.west - west_));
  }
}

// Finds each void by flood fill. Whatever fills it by interpolation stays below the highest valid post around it.
void Judge::bound_voids() {
  void_highest_.assign(posts_.size(), kVoid);
  std::vector<char> done(posts_.size(), 0);
  for (std::size_t first = 0; first < posts_.size(); ++first) {
    if (posts_[first] != kVoid || done[first]) continue;
    std::vector<std::size_t> region{first};
    done[first] = 1;
    std::int16_t highest = kVoid;
    for (std::size_t k = 0; k < region.size(); ++k) {
      const int r = static_cast<int>(region[k] / static_cast<std::size_t>(columns_)),
                c = static_cast<int>(region[k] % static_cast<std::size_t>(columns_));
      for (int y = std::max(0, r - 1); y <= std::min(rows_ - 1, r + 1); ++y)
        for (int x = std::max(0, c - 1); x <= std::min(columns_ - 1, c + 1); ++x) {
          const std::size_t neighbour =
              static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(x);
          if (valid(posts_[neighbour])) highest = std::max(highest, posts_[neighbour]);
          if (posts_[neighbour] != kVoid || done[neighbour]) continue;
          done[neighbour] = 1;
          region.push_back(neighbour);
        }
    }
    for (const std::size_t void_post : region) void_highest_[void_post] = highest;
  }
}

std::int16_t Judge::highest_of_quad(int row, int column) const {
  std::int16_t highest = kVoid;
  for (const int r : {row, row + 1})
    for (const int c : {column, column + 1}) {
      const std::int16_t h = post(r, c);
      highest = std::max(highest, h == kVoid
                                      ? void_highest_[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) +
                                                      static_cast<std::size_t>(c)]
                                      : h);
    }
  return highest;
}

Judge::Maxima Judge::maxima(int factor) const {
  Maxima m;
  m.factor = factor;
  // Cells of the quads, one less than posts, and the rim on both sides.
  m.rows = (rows_ - 2) / factor + 3;
  m.columns = (columns_ - 2) / factor + 3;
  m.highest.assign(static_cast<std::size_t>(m.rows) * static_cast<std::size_t>(m.columns), kVoid);
  for (int r = 0; r + 1 < rows_; ++r)
    for (int c = 0; c + 1 < columns_; ++c) {
      const std::int16_t h = highest_of_quad(r, c);
      for (int y = r / factor; y <= r / factor + 2; ++y)
        for (int x = c / factor; x <= c / factor + 2; ++x) {
          std::int16_t& cell = m.highest[static_cast<std::size_t>(y) * static_cast<std::size_t>(m.columns) +
                                         static_cast<std::size_t>(x)];
          cell = std::max(cell, h);
        }
    }
  return m;
}

double Judge::Maxima::at(int quad_row, int quad_column) const {
  const auto cell = [&](int quad) { return (quad >= 0 ? quad / factor : -((-quad + factor - 1) / factor)) + 1; };
  const int y = cell(quad_row), x = cell(quad_column);
  if (y < 0 || x < 0 || y >= rows || x >= columns) return kVoid;
  return highest[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(x)];
}

bool Judge::has_void(int row, int column) const {
  return post(row, column) == kVoid || post(row, column + 1) == kVoid || post(row + 1, column) == kVoid ||
         post(row + 1, column + 1) == kVoid;
}

Vec3 Judge::position(int row, int column) const {
  const auto r = static_cast<std::size_t>(row), c = static_cast<std::size_t>(column);
  const double radius = kMoonRadius_m + post(row, column) + raised_m_;
  return {radius * cos_lat_[r] * cos_lon_[c], radius * cos_lat_[r] * sin_lon_[c], radius * sin_lat_[r]};
}

std::optional<FaceVertices> Judge::vertices(const Face& f) const {
  if (f.row < 0 || f.column < 0 || f.row + 1 >= rows_ || f.column + 1 >= columns_) return std::nullopt;
  const int r = f.row, c = f.column, corner = f.north_east ? 1 : 0;
  if (!valid(post(r, c + 1)) || !valid(post(r + 1, c)) || !valid(post(r + corner, c + corner))) return std::nullopt;
  if (f.north_east) return FaceVertices{position(r + 1, c + 1), position(r + 1, c), position(r, c + 1)};
  return FaceVertices{position(r, c), position(r, c + 1), position(r + 1, c)};
}

// Intersects a ray with a triangle (Möller and Trumbore 1997): v and w are the barycentric coordinates of b and c.
std::optional<Judge::Crossing> Judge::cross(const Face& face, const Vec3& origin, const Vec3& direction) const {
  const auto t = vertices(face);
  if (!t) return std::nullopt;
  const Vec3 ab = t->b - t->a, ac = t->c - t->a, p = direction.cross(ac);
  const double determinant = ab.dot(p);
  if (determinant == 0) return std::nullopt;
  const Vec3 from_a = origin - t->a, q = from_a.cross(ab);
  const double v = from_a.dot(p) / determinant, w = direction.dot(q) / determinant;
  if (v < -kSlack || w < -kSlack || v + w > 1 + kSlack) return std::nullopt;
  return Crossing{ac.dot(q) / determinant, determinant > 0};
}

Judge::Place Judge::place_of(const Vec3& p) const {
  const double lat = std::atan2(p.z(), std::hypot(p.x(), p.y())) / kDegree;
  // Measure the longitude from the mosaic's middle, so that its jump of 360 degrees lies opposite.
  const double middle = west_deg() + 0.5 * (columns_ - 1) / ppd_;
  const double lon = middle + std::remainder(std::atan2(p.y(), p.x()) / kDegree - middle, 360.0);
  return {lat * ppd_ - south_, lon * ppd_ - west_};
}

// Calls visit(quad row, quad column, from_m, to_m) for the stretches of the ray, in order, that may hit a triangle of
// the 3 x 3 quads around the given one. A stretch is half a post long, so that it never reaches beyond these. Stretches
// above all ground are skipped, longer ones by the maxima of larger cells. Ends when visit returns true.
template <typename Visit>
void Judge::march(const Vec3& origin, const Vec3& direction, double from_m, Visit&& visit) const {
  const auto shell = through_sphere(origin, direction, kMoonRadius_m + highest_m_ + 0.01);
  if (!shell) return;
  // No ground lies deeper than the chords between the lowest posts.
  const double post_m = kMoonRadius_m * kDegree / ppd_, sag_m = post_m * post_m / kMoonRadius_m;
  const auto core = through_sphere(origin, direction, kMoonRadius_m + lowest_m_ - sag_m - 0.01);
  double t = std::max(from_m, shell->first);
  const double closest = -origin.dot(direction);
  while (t < shell->second) {
    if (core && t >= core->first && t < core->second) t = core->second;  // there is no surface inside the core
    const Vec3 p = origin + t * direction;
    const Place place = place_of(p);
    const int row = static_cast<int>(std::floor(place.row)), column = static_cast<int>(std::floor(place.column));
    const double half_post = 0.49 * (kMoonRadius_m + lowest_m_) * kDegree / ppd_ * std::hypot(p.x(), p.y()) / p.norm();
    double step = half_post;
    bool clear = false;
    for (std::size_t i = maxima_.size(); i-- > 0 && !clear;) {
      step = half_post * maxima_[i].factor;
      const double lowest = (origin + std::clamp(closest, t, t + step) * direction).norm() - kMoonRadius_m;
      clear = lowest > maxima_[i].at(row, column) + raised_m_ + 1e-3;
    }
    if (!clear && visit(row, column, t, t + step)) return;
    t += step;
  }
}

FirstHit Judge::first_hit(const Vec3& origin, const Vec3& direction) const {
  FirstHit first;
  march(origin, direction, 0, [&](int row, int column, double from, double to) {
    constexpr double kOverlap = 1e-6;
    bool doubtful = false;
    for (int r = std::max(0, row - 1); r <= std::min(rows_ - 2, row + 1); ++r)
      for (int c = std::max(0, column - 1); c <= std::min(columns_ - 2, column + 1); ++c) {
        doubtful |= has_void(r, c);
        for (const bool north_east : {false, true}) {
          const Face face{r, c, north_east};
          const auto x = cross(face, origin, direction);
          if (!x || x->distance_m < from - kOverlap || x->distance_m > to + kOverlap ||
              x->distance_m >= first.distance_m)
            continue;
          first = {Verdict::yes, x->distance_m, face, x->from_above};
        }
      }
    if (doubtful) first.hit = Verdict::unknown;
    return first.hit != Verdict::no;
  });
  return first;
}

FirstHit Judge::first_hit_by_brute_force(const Vec3& origin, const Vec3& direction) const {
  FirstHit first;
  for (int r = 0; r + 1 < rows_; ++r)
    for (int c = 0; c + 1 < columns_; ++c)
      for (const bool north_east : {false, true}) {
        const Face face{r, c, north_east};
        const auto x = cross(face, origin, direction);
        if (x && x->distance_m >= 0 && x->distance_m < first.distance_m)
          first = {Verdict::yes, x->distance_m, face, x->from_above};
      }
  return first;
}

Verdict Judge::crosses_any(const Vec3& origin, const Vec3& direction, double from_m, const Face* except) const {
  // A point on an edge is on two triangles: ignore hits within the rounding of its position.
  constexpr double kStart_m = 1e-6;
  Verdict verdict = Verdict::no;
  march(origin, direction, from_m, [&](int row, int column, double, double) {
    for (int r = std::max(0, row - 1); r <= std::min(rows_ - 2, row + 1); ++r)
      for (int c = std::max(0, column - 1); c <= std::min(columns_ - 2, column + 1); ++c) {
        if (has_void(r, c)) verdict = Verdict::unknown;
        for (const bool north_east : {false, true}) {
          const Face face{r, c, north_east};
          if (except && face == *except) continue;
          const auto x = cross(face, origin, direction);
          if (!x || x->distance_m < from_m + kStart_m) continue;
          verdict = Verdict::yes;
          return true;
        }
      }
    return false;
  });
  return verdict;
}

Verdict Judge::sun_blocked(const Vec3& point, const Face& face, const Vec3& sun) const {
  return crosses_any(point, sun, 0, &face);
}

bool Judge::grazes(const Vec3& point, const Face& face, const Vec3& sun, double margin_m) const {
  const Vec3 up = point.normalized();
  if (sun_blocked(point, face, sun) == Verdict::yes)
    return crosses_any(point + margin_m * up, sun, 0, &face) == Verdict::no;
  const Vec3 normal = vertices(face)->normal();
  const double rises = normal.dot(sun);
  if (rises <= 0) return false;
  const double leaves_m = margin_m * normal.dot(up) / rises;
  return crosses_any(point - margin_m * up, sun, leaves_m, &face) == Verdict::yes;
}

std::optional<double> Judge::height_above_surface(const Vec3& point) const {
  const Vec3 up = point.normalized();
  const Place place = place_of(point);
  const int row = static_cast<int>(std::floor(place.row)), column = static_cast<int>(std::floor(place.column));
  for (const int r : {row, row - 1, row + 1})
    for (const int c : {column, column - 1, column + 1})
      for (const bool north_east : {false, true}) {
        const Face face{r, c, north_east};
        const auto x = cross(face, Vec3::zero(), up);
        if (x && x->distance_m > 0) return (point.norm() - x->distance_m) * vertices(face)->normal().dot(up);
      }
  return std::nullopt;
}

}  // namespace selenograph::test
