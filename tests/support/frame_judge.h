// Whole frames before the judge: every point on its ray and on the terrain, every shadow where it belongs.
//
// For frames of the finest posts (max_error_px 0), whose mesh is meant to be the judge's triangles exactly. They need
// depth, position, normal and lit, of a camera without distortion.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "dem/terrain/pyramid_terrain.h"
#include "engine/renderer.h"
#include "tests/support/judge.h"

namespace selenograph::test {

// How far a point may be from its ray, from the terrain and from where the judge's ray ends.
inline constexpr double kJudgeTolerance_m = 0.01;
// Shadow flags whose Sun ray passes this near to changing its verdict are counted apart.
inline constexpr double kGrazing_m = 1.0;

// A folder of Kaguya tiles: what is rendered, and its judge. `cache_dir` as in dem::TerrainOptions.
struct Scenery {
  std::unique_ptr<Judge> judge;
  std::shared_ptr<dem::PyramidTerrain> terrain;
  std::unique_ptr<engine::Renderer> renderer;
  explicit Scenery(const std::string& folder, const std::string& cache_dir = {});
};

struct Findings {
  std::uint64_t pixels = 0, hits = 0, unknown = 0;
  std::uint64_t off_ray = 0, off_terrain = 0;   // more than the tolerance
  std::uint64_t outlines = 0, unexplained = 0;  // another first hit: beyond an outline that float blurs; or not
  std::uint64_t lit = 0, flags = 0, grazing = 0, wrong = 0, wrong_grazing = 0;
  std::uint64_t edges = 0;  // lit or not, depending on which of the faces that meet there one asks
  double off_ray_m = 0, off_terrain_m = 0, depth_m = 0;  // the largest
  void add(const Findings& o);
};

Findings judged(const Judge& judge, const engine::FrameRequest& request, const engine::Frame& frame);

// Whether a judge and an engine (NaN: nothing) that disagree on a distance see two sides of an outline: of the rays
// that pass the nearer point 2 cm above and below, one meets the surface (about) where the engine did, and the other
// one far from there.
bool at_outline(const Judge& judge, const Vec3& eye, const Vec3& direction, double truth_m, double engine_m);

// Two lines on standard output.
void report(const std::string& name, const Findings& found);

}  // namespace selenograph::test
