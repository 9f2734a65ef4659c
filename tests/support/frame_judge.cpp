#include "tests/support/frame_judge.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <vector>

#include "dem/base/parallel.h"

namespace selenograph::test {
namespace {

Vec3 toward(const Vec3& from, const Vec3& to) { return (to - from).normalized(); }

// Comparison of one frame with the judge, pixel by pixel.
class Trial {
 public:
  Trial(const Judge& judge, const engine::FrameRequest& request, const engine::Frame& frame)
      : judge_(judge),
        request_(request),
        products_(frame.products),
        moon_from_camera_(request.pose.camera_from_moon.conjugate().matrix()) {}

  Findings hear() const {
    Findings all;
    std::mutex mutex;
    const auto pixels =
        static_cast<std::size_t>(request_.camera.width) * static_cast<std::size_t>(request_.camera.height);
    in_parallel_pieces(pixels, 64, [&](std::size_t first, std::size_t past_last) {
      Findings found;
      for (std::size_t i = first; i < past_last; ++i) judge_pixel(static_cast<int>(i), found);
      const std::lock_guard lock(mutex);
      all.add(found);
    });
    return all;
  }

 private:
  // Returns the ray of a pixel with length 1 along the boresight, in MOON_ME: `depth` counts in this length.
  Vec3 ray(int pixel) const {
    const engine::Camera& c = request_.camera;
    return moon_from_camera_ *
           Vec3((pixel % request_.camera.width - c.cx) / c.fx, (pixel / request_.camera.width - c.cy) / c.fy, 1);
  }

  void judge_pixel(int pixel, Findings& found) const {
    ++found.pixels;
    const auto at = static_cast<std::size_t>(pixel);
    const Vec3 along = ray(pixel), direction = along.normalized(), &eye = request_.pose.position_m;
    FirstHit truth = judge_.first_hit(eye, direction);
    if (truth.hit == Verdict::unknown) {
      ++found.unknown;
      return;
    }
    if (truth.hit == Verdict::yes && !truth.from_above)
      truth = {};  // through the mosaic's rim: the engine has no surface there
    const double depth = products_.depth[at], distance = depth * along.norm();
    const bool hit = !std::isnan(depth);
    if (hit) judge_position(at, direction, distance, found);
    if (hit != (truth.hit == Verdict::yes) || (hit && std::abs(truth.distance_m - distance) > kJudgeTolerance_m)) {
      ++(at_outline(judge_, eye, direction, truth.distance_m, distance) ? found.outlines : found.unexplained);
      return;
    }
    if (!hit) return;
    found.depth_m = std::max(found.depth_m, std::abs(truth.distance_m - distance));
    judge_light(at, eye + truth.distance_m * direction, truth.face, found);
  }

  void judge_position(std::size_t at, const Vec3& direction, double distance, Findings& found) const {
    ++found.hits;
    const Vec3 position(products_.position[3 * at], products_.position[3 * at + 1], products_.position[3 * at + 2]);
    const double off_ray = (position - request_.pose.position_m - distance * direction).norm();
    found.off_ray_m = std::max(found.off_ray_m, off_ray);
    found.off_ray += off_ray > kJudgeTolerance_m;
    const auto height = judge_.height_above_surface(position);
    if (!height) {
      ++found.unknown;
      return;
    }
    found.off_terrain_m = std::max(found.off_terrain_m, std::abs(*height));
    found.off_terrain += std::abs(*height) > kJudgeTolerance_m;
  }

  // Tells if a face is lit at a point of it. `mu0` is the cosine of incidence of the engine's normal.
  Verdict lit_on(const Face& face, const Vec3& point, double mu0) const {
    const Vec3& sun = request_.sun.direction;
    if (mu0 <= 0 || judge_.vertices(face)->normal().dot(sun) <= 0) return Verdict::no;
    const Verdict blocked = judge_.sun_blocked(point, face, sun);
    return blocked == Verdict::unknown ? blocked : blocked == Verdict::yes ? Verdict::no : Verdict::yes;
  }

  // Returns true if the point also lies on another face, within a micrometre, for which `other_answer` is right: then
  // either answer is.
  bool on_edge_to(Verdict other_answer, const Face& face, const Vec3& point, double mu0) const {
    const EastNorthUp axes = local_axes(point);
    for (const double angle : {0.3, 1.9, 3.4, 5.0}) {
      const Vec3 beside = point + 1e-6 * (std::cos(angle) * axes.east + std::sin(angle) * axes.north);
      const FirstHit hit = judge_.first_hit(beside + axes.up, -axes.up);
      if (hit.hit == Verdict::yes && hit.face != face && lit_on(hit.face, point, mu0) == other_answer) return true;
    }
    return false;
  }

  void judge_light(std::size_t at, const Vec3& point, const Face& face, Findings& found) const {
    const Vec3& sun = request_.sun.direction;
    const Vec3 shading(products_.normal[3 * at], products_.normal[3 * at + 1], products_.normal[3 * at + 2]);
    const double mu0 = shading.dot(sun);
    if (std::abs(mu0) < 1e-6) return;  // the sign is beyond the float of `normal`
    const Verdict lit = lit_on(face, point, mu0), engine = products_.lit[at] != 0 ? Verdict::yes : Verdict::no;
    if (lit == Verdict::unknown) {
      ++found.unknown;
      return;
    }
    if (lit != engine && on_edge_to(engine, face, point, mu0)) {
      ++found.edges;
      return;
    }
    const bool faces_sun = mu0 > 0 && judge_.vertices(face)->normal().dot(sun) > 0;
    const bool grazing = faces_sun && judge_.grazes(point, face, sun, kGrazing_m);
    ++(grazing ? found.grazing : found.flags);
    found.lit += lit == Verdict::yes;
    if (lit != engine) ++(grazing ? found.wrong_grazing : found.wrong);
  }

  const Judge& judge_;
  const engine::FrameRequest& request_;
  const engine::FrameProducts& products_;
  Mat3 moon_from_camera_;
};

}  // namespace

bool at_outline(const Judge& judge, const Vec3& eye, const Vec3& direction, double truth_m, double engine_m) {
  const double engine = std::isnan(engine_m) ? std::numeric_limits<double>::infinity() : engine_m;
  constexpr double kSame_m = 10, kOther_m = 15;
  if (!(std::abs(truth_m - engine) > kOther_m)) return false;
  const Vec3 near = eye + std::min(truth_m, engine) * direction;
  for (const double offset_m : {0.02, -0.02}) {
    const FirstHit beside = judge.first_hit(eye, toward(eye, near + offset_m * near.normalized()));
    const double seen =
        beside.hit == Verdict::yes && beside.from_above ? beside.distance_m : std::numeric_limits<double>::infinity();
    if (seen == engine || std::abs(seen - engine) < kSame_m) return true;
  }
  return false;
}

Scenery::Scenery(const std::string& folder, const std::string& cache_dir)
    : judge(std::make_unique<Judge>(folder)),
      terrain(std::make_shared<dem::PyramidTerrain>(dem::Catalogue(std::vector<std::string>{folder}),
                                                    dem::TerrainOptions{cache_dir})),
      renderer(std::make_unique<engine::Renderer>(terrain, engine::RendererOptions{})) {}

void Findings::add(const Findings& findings) {
  for (const auto count :
       {&Findings::pixels, &Findings::hits, &Findings::unknown, &Findings::off_ray, &Findings::off_terrain,
        &Findings::outlines, &Findings::unexplained, &Findings::flags, &Findings::grazing, &Findings::wrong,
        &Findings::wrong_grazing, &Findings::lit, &Findings::edges})
    this->*count += findings.*count;
  for (const auto largest_m : {&Findings::off_ray_m, &Findings::off_terrain_m, &Findings::depth_m})
    this->*largest_m = std::max(this->*largest_m, findings.*largest_m);
}

Findings judged(const Judge& judge, const engine::FrameRequest& request, const engine::Frame& frame) {
  return Trial(judge, request, frame).hear();
}

void report(const std::string& name, const Findings& f) {
  fmt::print(
      "{:<33} hits {:5}  off ray {:.1e} m  off terrain {:.1e} m  depth {:.1e} m  outlines {} unexplained {} unknown "
      "{}\n",
      name, f.hits, f.off_ray_m, f.off_terrain_m, f.depth_m, f.outlines, f.unexplained, f.unknown);
  fmt::print("{:<33} lit {:5}  flags {:5} wrong {}  within 1 m of grazing {:4} wrong {}  on edges, either {}\n", "",
             f.lit, f.flags, f.wrong, f.grazing, f.wrong_grazing, f.edges);
}

}  // namespace selenograph::test
