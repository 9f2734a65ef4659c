#include "dem/files/pds_grid.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <vector>

#include "dem/files/map_sphere.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

namespace {

// Returns metres per pixel on the Moon's sphere, for a map on a sphere of radius `sphere_m`. The PDS data dictionary's
// default unit is km/pixel.
std::optional<double> map_scale_m(const PdsReader& map, double sphere_m) {
  const PdsValue* v = map.value("MAP_SCALE");
  if (!v || !v->number()) return std::nullopt;
  const std::string unit = upper_case(v->unit);
  if (unit.starts_with("DEG")) return *v->number() * kMetresPerDegree;
  return *v->number() * (unit.starts_with("M") ? 1 : 1000) * (kMoonRadius_m / sphere_m);
}

// Returns posts per degree: MAP_RESOLUTION if possible, because MAP_SCALE is printed rounded. A scale alone is
// converted back to the whole number that it came from.
double posts_per_degree(const PdsReader& map, double sphere_m) {
  double ppd = map.number_or("MAP_RESOLUTION", 0);
  if (ppd <= 0) {
    const auto scale = map_scale_m(map, sphere_m);
    if (!scale || *scale <= 0) map.fail("MAP_RESOLUTION and MAP_SCALE are both missing");
    ppd = kMetresPerDegree / *scale;
    if (std::abs(ppd / std::round(ppd) - 1) < 5e-5) ppd = std::round(ppd);  // a scale of five digits
  }
  if (!(ppd > 1e-3 && ppd < 1e9)) map.fail("MAP_RESOLUTION is impossible");
  return ppd;
}

// Axis of a cylindrical map, in posts from the projection's centre, growing with the row or column number.
struct Axis {
  int count = 0;
  std::optional<double> offset;       // LINE_ or SAMPLE_PROJECTION_OFFSET
  std::optional<double> first, last;  // positions of the first and last corner that the label prints
  double period = 0;                  // posts per turn for longitudes, else 0
};

// Returns the position of the first post. The printed corners tell which convention the offset, the more exact number,
// follows:
// - Corners at the outermost posts (Kaguya) span count - 1 posts, at the outer pixel edges (LOLA) count posts.
// - Offsets count from the first post's position (Kaguya, LOLA), or from one post before it (1-based, older products).
// - Early Kaguya products have the opposite sign.
//
// A Kaguya label with printed edges is still recognised, as its offset then equals the edge.
//
//     corners at posts:   |o . . . . o|   span = count - 1     corners at edges:  |.o . . . . o.|   span = count
std::optional<double> first_post(const Axis& a) {
  const auto near = [&](double x, double y, double tolerance) {
    const double d = a.period > 0 ? std::remainder(x - y, a.period) : x - y;
    return std::abs(d) < tolerance;
  };
  std::vector<double> candidates;
  if (a.offset) candidates = {-*a.offset, 1 - *a.offset, *a.offset, *a.offset - 1};
  if (!a.first || !a.last) return a.offset ? std::optional(-*a.offset) : std::nullopt;

  // Match candidates and corners: the conventions differ by at least half a post, while printed decimals are off by
  // much less than the tolerances.
  const double span = *a.last - *a.first;
  std::vector<double> targets;
  if (std::abs(span - (a.count - 1)) < 0.3) targets = {*a.first};
  if (std::abs(span - a.count) < 0.3) targets = {*a.first + 0.5, *a.first};
  for (const double candidate : candidates)
    for (const double target : targets)
      if (near(candidate, target, 0.1)) return candidate;
  if (targets.empty()) return std::nullopt;
  // Use the corners if no convention fits, and undo the rounding of their six decimals.
  const double half = std::round(targets.front() * 2) / 2;
  return std::abs(half - targets.front()) < 0.02 ? half : targets.front();
}

// Returns the number of the first keyword that has one.
std::optional<double> first_of(const PdsReader& a, std::initializer_list<const char*> keywords) {
  for (const char* keyword : keywords)
    if (const auto x = a.maybe(keyword)) return x;
  return std::nullopt;
}

// Returns true if a printed position is that of a post, up to conventions and rounding. A larger difference is a
// mistake in this number or in the others; the label does not tell which.
bool agrees(const Axis& axis, double printed, double post) {
  const double tolerance = std::max(2.0, 0.01 * axis.count), d = printed - post;
  return std::abs(axis.period > 0 ? std::remainder(d, axis.period) : d) <= tolerance;
}

// Throws DataError if printed positions or the offset contradict the first post's position. `low` and `high`: keywords
// that print the first and the last post's position; `sign`: +1 if it grows with the post number, else -1.
void check_axis(const PdsReader& label, const Axis& axis, double post, double sign, double centre_deg, double ppd,
                std::initializer_list<const char*> low, std::initializer_list<const char*> high) {
  int agreeing = 0;
  const auto check = [&](const char* keyword, double expected) {
    const auto printed = label.maybe(keyword);
    if (!printed) return;
    if (!agrees(axis, sign * (*printed - centre_deg) * ppd, expected))
      label.fail(std::string(keyword) + " contradicts the rest of the label");
    ++agreeing;
  };
  for (const char* keyword : low) check(keyword, post);
  for (const char* keyword : high) check(keyword, post + axis.count - 1);
  // Ignore an offset of zero, which means no offset, and one that two pairs of corners contradict.
  if (!axis.offset || *axis.offset == 0 || agreeing > 2) return;
  for (const double candidate : {-*axis.offset, *axis.offset})
    if (agrees(axis, candidate, post)) return;
  label.fail("its corners and its projection offset contradict each other");
}

// Returns the grid of a cylindrical map, from its offsets and printed corners. Row numbers grow southward: positions
// along the rows' axis are negative latitudes.
GeographicGrid cylindrical_grid(const PdsReader& label, const PdsReader& map, double sphere_m, int width, int height) {
  const double ppd = posts_per_degree(map, sphere_m);
  const double centre_lon = map.number_or("CENTER_LONGITUDE", 0);
  if (std::abs(map.number_or("CENTER_LATITUDE", 0)) > 1e-9)
    map.fail("a cylindrical map with a CENTER_LATITUDE other than 0 is not supported");

  Axis rows{height, map.maybe("LINE_PROJECTION_OFFSET"), {}, {}, 0};
  if (const auto north = first_of(label, {"MAXIMUM_LATITUDE", "UPPER_LEFT_LATITUDE"})) rows.first = -*north * ppd;
  if (const auto south = first_of(label, {"MINIMUM_LATITUDE", "LOWER_LEFT_LATITUDE"})) rows.last = -*south * ppd;
  Axis columns{width, map.maybe("SAMPLE_PROJECTION_OFFSET"), {}, {}, 360 * ppd};
  const auto west = first_of(label, {"WESTERNMOST_LONGITUDE", "UPPER_LEFT_LONGITUDE"});
  auto east = first_of(label, {"EASTERNMOST_LONGITUDE", "UPPER_RIGHT_LONGITUDE"});
  if (west && east) {
    if (*east < *west || (*east == *west && width > 1))
      *east += 360;  // crosses longitude 0, e.g. a tile from E359 to E000
    columns.first = (*west - centre_lon) * ppd;
    columns.last = (*east - centre_lon) * ppd;
  }
  const auto row = first_post(rows);
  const auto column = first_post(columns);
  if (!row) map.fail("its latitudes, LINES, MAP_RESOLUTION and LINE_PROJECTION_OFFSET contradict each other");
  if (!column)
    map.fail("its longitudes, LINE_SAMPLES, MAP_RESOLUTION and SAMPLE_PROJECTION_OFFSET contradict each other");
  check_axis(label, rows, *row, -1, 0, ppd, {"MAXIMUM_LATITUDE", "UPPER_LEFT_LATITUDE", "UPPER_RIGHT_LATITUDE"},
             {"MINIMUM_LATITUDE", "LOWER_LEFT_LATITUDE", "LOWER_RIGHT_LATITUDE"});
  check_axis(label, columns, *column, 1, centre_lon, ppd,
             {"WESTERNMOST_LONGITUDE", "UPPER_LEFT_LONGITUDE", "LOWER_LEFT_LONGITUDE"},
             {"EASTERNMOST_LONGITUDE", "UPPER_RIGHT_LONGITUDE", "LOWER_RIGHT_LONGITUDE"});
  return {-*row / ppd, centre_lon + *column / ppd, ppd, ppd};
}

// Returns the offset from the pole. LOLA's polar products are symmetric about it, but their labels round half a pixel
// in different directions: a map that is symmetric to within half a pixel is taken as symmetric.
double polar_offset(const PdsReader& map, const char* keyword, int count) {
  const double offset = map.number(keyword);
  return std::abs(offset - count / 2.0) < 0.51 ? (count - 1) / 2.0 : offset;
}

// Returns the grid of a polar map. In the plane the metres per pixel are exact and the pixels per degree rounded
// (LOLA's DSMAP_POLAR.CAT).
PlaneGrid polar_grid(const PdsReader& map, double sphere_m, int width, int height) {
  PlaneGrid g;
  const double pole = map.number("CENTER_LATITUDE");
  if (std::abs(std::abs(pole) - 90) > 1e-9) map.fail("CENTER_LATITUDE of a polar map must be 90 or -90");
  g.plane = {MapProjection::stereographic, pole > 0 ? 90.0 : -90.0, map.number_or("CENTER_LONGITUDE", 0)};
  const auto scale = map_scale_m(map, sphere_m);
  g.spacing_m = scale ? *scale : kMetresPerDegree / posts_per_degree(map, sphere_m);
  if (!(g.spacing_m > 1e-3 && g.spacing_m < 1e6)) map.fail("MAP_SCALE is impossible");
  g.first_x_m = -polar_offset(map, "SAMPLE_PROJECTION_OFFSET", width) * g.spacing_m;
  g.first_y_m = polar_offset(map, "LINE_PROJECTION_OFFSET", height) * g.spacing_m;
  return g;
}

}  // namespace

double pds_sphere_m(const PdsReader& label, const PdsReader& map) {
  const std::string target = label.word("TARGET_NAME");
  if (!target.empty() && target != "MOON" && target != "N/A" && target != "UNK")
    label.fail("its TARGET_NAME is '" + target + "', not MOON");
  std::vector<double> axes_m;
  for (const char* axis : {"A_AXIS_RADIUS", "B_AXIS_RADIUS", "C_AXIS_RADIUS"}) {
    const PdsValue* value = map.value(axis);
    const bool is_metres = value && upper_case(value->unit).starts_with("M");
    const double unit_m = is_metres ? 1 : 1000;
    axes_m.push_back(map.number_or(axis, kMoonRadius_m / unit_m) * unit_m);
  }
  return map_sphere_m(axes_m, label.path());
}

PostGrid pds_grid(const PdsReader& label, const PdsReader& map, double sphere_m, int width, int height) {
  if (map.number_or("MAP_PROJECTION_ROTATION", 0) != 0) map.fail("rotated maps are not supported");
  if (map.word("POSITIVE_LONGITUDE_DIRECTION") == "WEST") map.fail("west-positive longitudes are not supported");
  std::string type = map.word("MAP_PROJECTION_TYPE");
  std::replace(type.begin(), type.end(), '_', ' ');
  if (type == "POLAR STEREOGRAPHIC") return polar_grid(map, sphere_m, width, height);
  for (const char* name :
       {"SIMPLE CYLINDRICAL", "EQUIRECTANGULAR", "EQUIDISTANT CYLINDRICAL", "EQUIDISTANT", "GEOGRAPHIC"})
    if (type == name) return cylindrical_grid(label, map, sphere_m, width, height);
  map.fail("the map projection '" + type + "' is not supported");
}

}  // namespace selenograph::dem
