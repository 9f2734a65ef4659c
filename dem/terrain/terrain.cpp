#include "dem/terrain/terrain.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "dem/grid/geodesy.h"
#include "dem/grid/surface.h"
#include "dem/posts/level_borders.h"
#include "dem/terrain/finest_edges.h"

namespace selenograph::dem {
namespace {

// Chords of this level stay within 2 mm of the sphere: coarser layers are subdivided to it where finest posts are asked
// for.
constexpr int kSmoothLevel = 8;

// A direction from the Moon's centre that is looked along.
struct Look {
  const Terrain& terrain;
  Vec3 direction;
  const StopToken& stop;
  double slack;  // how far beside a triangle, as a share of it
};

// Whether the direction meets a quad of the finest surface; then the answer has its height and sources.
bool meets_quad(const Look& look, const Block& block, const FinestEdges& edges, int r, int c, HeightAnswer& answer) {
  for (const bool upper : {false, true}) {
    const QuadVertices q = vertices_of(r, c, upper);
    const auto vertex = [&](int i) { return edges.vertex(q.r[i], q.c[i]); };
    const auto distance = radial_distance({vertex(0), vertex(1), vertex(2)}, look.direction, look.slack);
    if (!distance) continue;
    answer.height_m = *distance - kMoonRadius_m;
    const SourceIndex from = source_of(block.source(q.r[0], q.c[0]));
    for (int i = 0; i < 3; ++i) {
      answer.filled |= is_filled(block.source(q.r[i], q.c[i]));
      answer.blended |= is_blended(block.source(q.r[i], q.c[i]));
    }
    answer.source = from == kNoSource ? -1 : static_cast<int>(from);
    if (answer.source >= 0)
      answer.post_spacing_m =
          look.terrain.catalogue().rasters()[static_cast<std::size_t>(answer.source)].post_spacing_m;
    return true;
  }
  return false;
}

// The same of the quad with a south-west corner at some ticks, or of those that share what is left of an edge with it.
bool meets_quad_at(const Look& look, int level, std::int32_t lat, std::int32_t lon, HeightAnswer& answer) {
  const auto block = look.terrain.block(block_at(level, lat, lon), look.stop);
  if (!block) return false;
  const BlockExtent& e = block->extent;
  const int r = (lat - e.lat0) / e.lat_step, c = (lon - e.lon0) / e.lon_step;
  const FinestEdges edges(look.terrain, *block, {r, r, c, c}, look.stop);
  const auto [first_r, past_r] = edges.rows(r, c);
  const auto [first_c, past_c] = edges.columns(r, c);
  for (int at_r = first_r; at_r < past_r; ++at_r)
    for (int at_c = first_c; at_c < past_c; ++at_c)
      if (meets_quad(look, *block, edges, at_r, at_c, answer)) return true;
  return false;
}

}  // namespace

int Terrain::finest_level(const BlockId& id) const { return std::max(kSmoothLevel, posts_level(id)); }

HeightAnswer Terrain::height(double lat_deg, double lon_deg, const StopToken& stop) const {
  stop.check();
  HeightAnswer answer{lat_deg, wrap_lon_deg(lon_deg), std::nan(""), 0, -1, false};
  const double lat = (lat_deg + 90) * kTicksPerDegree, lon = (answer.lon_deg + 180) * kTicksPerDegree;
  const BlockId probe = block_at(kMaxLevel, static_cast<std::int32_t>(std::clamp(lat, 0.0, kLatTicks - 1.0)),
                                 wrap_lon(static_cast<std::int64_t>(lon)));
  // More than a block of kSmoothLevel (0.25 degrees), the largest that is looked into below.
  constexpr double kFarFromAnyFile_deg = 0.3;
  if (!has_data(probe) && files_touching(catalogue(), probe, kFarFromAnyFile_deg).empty()) return answer;
  const int level = finest_level(probe);
  const double step = std::ldexp(1.0, kTickLevel - level);
  const double y = lat / step, x = lon / step;
  // The quad that the place is in; beside an edge the neighbours too, because the mesh's edges are great circles, not
  // parallels.
  const auto meets = [&](double slack) {
    const Look look{*this, to_cartesian({lat_deg, lon_deg, 0}).normalized(), stop, slack};
    for (const int dy : {0, -1, 1})
      for (const int dx : {0, -1, 1}) {
        const double row = std::floor(y) + dy, col = std::floor(x) + dx;
        if (row < 0 || row * step >= kLatTicks) continue;
        if (meets_quad_at(look, level, static_cast<std::int32_t>(row * step),
                          wrap_lon(static_cast<std::int64_t>(col * step)), answer))
          return true;
      }
    return false;
  };
  // The triangles at a pole are slivers a tenth of a millimetre wide, which rounding misses.
  if (!meets(1e-9)) meets(1e-3);
  return answer;
}

std::vector<std::string> Terrain::warnings_about(std::span<const SourceIndex> replaced) const {
  const auto name = [](const std::string& path) { return std::filesystem::path(path).filename().string(); };
  std::vector<std::string> texts;
  for (const CatalogueProblem& problem : catalogue().problems())
    if (!problem.located && !problem.unrelated)
      texts.push_back(name(problem.path) + ": can't be used; where it lies is unknown");
  for (const SourceIndex i : replaced)
    texts.push_back(name(catalogue().rasters()[i].path) + ": can't be used; the layer below stands in for it");
  return texts;
}

}  // namespace selenograph::dem
