// Compares whole frames with the judge: each point must lie on its ray and on the terrain, and each shadow flag be
// right.
//
// The frames must be of the finest posts (max_error_px 0), whose mesh is meant to be exactly the judge's triangles,
// have depth, position, normal and lit, and a camera without distortion.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "dem/terrain/pyramid_terrain.h"
#include "engine/renderer.h"
#include "tests/support/judge.h"

namespace selenograph::test {

// Greatest allowed distance of a point from its ray, from the terrain, and from the judge's hit.
inline constexpr double kJudgeTolerance_m = 0.01;
// Vertical distance within which a ray to the Sun grazes the terrain: its shadow flag is counted apart.
inline constexpr double kGrazing_m = 1.0;

// A folder of Kaguya tiles, with a renderer and a judge. `cache_dir` is that of dem::TerrainOptions.
struct Scenery {
  std::unique_ptr<Judge> judge;
  std::shared_ptr<dem::PyramidTerrain> terrain;
  std::unique_ptr<engine::Renderer> renderer;
  explicit Scenery(const std::string& folder, const std::string& cache_dir = {});
};

// Numbers of pixels by finding, and the largest errors.
struct Findings {
  std::uint64_t pixels = 0, hits = 0, unknown = 0;
  std::uint64_t off_ray = 0, off_terrain = 0;   // farther than the tolerance
  std::uint64_t outlines = 0, unexplained = 0;  // with another first hit: at an outline (at_outline()), or elsewhere
  std::uint64_t flags = 0, grazing = 0;         // shadow flags compared, and those of grazing rays, which are apart
  std::uint64_t wrong = 0, wrong_grazing = 0;   // the wrong ones of both
  std::uint64_t lit = 0;
  std::uint64_t edges = 0;  // on an edge of two triangles, only one of which is lit: either flag is right
  // Largest distances of points from their rays, from the terrain, and from the judge's hits.
  double off_ray_m = 0, off_terrain_m = 0, depth_m = 0;
  void add(const Findings& findings);
};

// Returns the findings about all pixels of a frame.
Findings judged(const Judge& judge, const engine::FrameRequest& request, const engine::Frame& frame);

// Returns true if the judge and the engine (NaN: no hit), which disagree on a distance, see two sides of an outline: of
// the rays 2 cm above and below the nearer point, one hits the surface about where the engine did.
bool at_outline(const Judge& judge, const Vec3& eye, const Vec3& direction, double truth_m, double engine_m);

// Prints two lines.
void report(const std::string& name, const Findings& found);

}  // namespace selenograph::test
