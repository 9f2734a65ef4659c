#include "engine/lidar/lidar_scan.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/detail/detail.h"
#include "dem/detail/features.h"
#include "dem/terrain/pyramid_terrain.h"
#include "engine/cache/render_context.h"
#include "engine/camera/pose_track.h"
#include "engine/lidar/beam.h"
#include "engine/lidar/detection.h"
#include "engine/lidar/echo.h"
#include "engine/lidar/lidar_craters.h"
#include "engine/lidar/pattern.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/mapped_surface.h"
#include "engine/rays/ground_along_rays.h"
#include "engine/rays/ray_queries.h"
#include "engine/scene/ray_selection.h"
#include "engine/scene/selection.h"
#include "engine/visibility/objects/enclosed.h"
#include "engine/visibility/points/trace.h"

namespace selenograph::engine {
namespace {

// Beams are cast in groups of sixteen neighbours. A packet holds one sub-ray of each:
//
//   beam      0    1    2  ...  15
//   sub-ray 0 |----packet 0-------|   on the axes
//   sub-ray 1 |----packet 1-------|
//   ...
constexpr std::size_t kBeamGroup = kPacket;
constexpr std::size_t kBundle = 16;  // groups per cone of terrain selection
constexpr std::size_t kMaxSubRays = 61;
constexpr double kFarthest_m = 1e5;  // range at which the footprint stops to decide the level of ground
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Read and write the vector with index i in an array of components x, y, z, x, y, z ...
Vec3 at3(const std::vector<double>& v, std::size_t i) { return {v[3 * i], v[3 * i + 1], v[3 * i + 2]}; }
void put3(std::vector<double>& v, std::size_t i, const Vec3& x) {
  v[3 * i] = x.x();
  v[3 * i + 1] = x.y();
  v[3 * i + 2] = x.z();
}

// Allocates all arrays of a scan of n beams.
void resize(LidarReturns& r, std::size_t n) {
  for (auto* column : {&r.time_s, &r.range_m, &r.first_m, &r.last_m, &r.true_range_m, &r.axis_range_m})
    column->resize(n);
  for (auto* column : {&r.origin_m, &r.direction}) column->resize(3 * n);
  for (auto* column : {&r.intensity, &r.first_intensity, &r.last_intensity, &r.velocity_m_s, &r.true_width_m,
                       &r.true_intensity, &r.true_velocity_m_s})
    column->resize(n);
  for (auto* column : {&r.count, &r.true_count, &r.false_alarm}) column->resize(n);
  r.object.resize(n);
  r.rock.resize(n);
}

// The ground's reflection back to the instrument, mu0 f_r at zero phase: a BRDF, times maps of albedo if there are any,
// times the brightness of made ground.
class GroundReflectance {
 public:
  explicit GroundReflectance(const FrameRequest& request)
      : hapke_(request.reflectance.model == ReflectanceModel::hapke),
        constant_(hapke_ ? request.reflectance.hapke.w : 1),
        brdf_(evaluated(request), band_of(request)) {
    if (!request.albedo_maps.empty()) maps_.emplace(request);
  }
  // Returns new samplers of the maps; none without maps.
  std::vector<ScaledMap> sampled(const StopToken& stop) const {
    return maps_ ? maps_->sampled(stop) : std::vector<ScaledMap>();
  }
  // Sets mu0 f_r toward the instrument per lane. `mu`: cosines of emission, which equal those of incidence. `side_m`:
  // side of the square that each lane's sub-ray illuminates.
  void reflected_back(const Mesh& mesh, const SurfacePoints& points, const double* mu, const double* side_m,
                      std::vector<ScaledMap>& maps, double* out) const {
    alignas(64) double albedo[kPacket];
    alignas(64) double ones[kPacket];
    std::fill_n(ones, kPacket, 1.0);
    std::fill_n(albedo, kPacket, constant_);
    if (maps_)
      for (int i = 0; i < kPacket; ++i) albedo[i] = points.hit[i] ? albedo_at(points.position(i), side_m[i], maps) : 0;
    if (mesh.varies_in_brightness()) brighten(mesh, points, albedo);
    const bool varies = maps_ || mesh.varies_in_brightness();
    brdf_.times_mu0(mu, mu, ones, varies && hapke_ ? albedo : nullptr, out);
    if (!hapke_)
      for (int i = 0; i < kPacket; ++i) out[i] *= albedo[i];
  }

 private:
  // With maps, evaluate the BRDF for albedo 1: the maps supply it.
  static Reflectance evaluated(const FrameRequest& request) {
    Reflectance reflectance = request.reflectance;
    if (!request.albedo_maps.empty()) reflectance.rho = 1;
    return reflectance;
  }
  void brighten(const Mesh& mesh, const SurfacePoints& points, double* albedo) const {
    float brightness[kPacket];
    interpolate_brightness(mesh, points, brightness);
    for (int i = 0; i < kPacket; ++i) {
      albedo[i] *= static_cast<double>(brightness[i]);
      if (hapke_) albedo[i] = std::min(albedo[i], 1.0);
    }
  }
  double albedo_at(const Vec3& point_m, double side_m, std::vector<ScaledMap>& maps) const {
    const Geographic g = to_geographic(point_m);
    double sum = 0;
    visit_coverage(maps, {g.lat_deg, g.lon_deg, {side_m, 0}, {0, side_m}}, maps_->fallback(),
                   [&](double value, double share) { sum += value * share; });
    return sum;
  }

  bool hapke_;
  double constant_;  // w of Hapke, otherwise 1: rho is in the BRDF
  Brdf brdf_;
  std::optional<AlbedoMaps> maps_;
};

// Returns the Morton code of two 16-bit numbers: their bits, alternating.
std::uint32_t morton_code(std::uint32_t x, std::uint32_t y) {
  const auto spread = [](std::uint32_t v) {
    v = (v | v << 8) & 0x00ff00ffU;
    v = (v | v << 4) & 0x0f0f0f0fU;
    v = (v | v << 2) & 0x33333333U;
    v = (v | v << 1) & 0x55555555U;
    return v;
  };
  return spread(x) | spread(y) << 1;
}

// Returns the indices that sort the keys: a stable radix sort in three passes of 11 bits.
std::vector<std::uint32_t> sorted_order(const std::vector<std::uint32_t>& keys) {
  std::vector<std::uint32_t> order(keys.size()), next(keys.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<std::uint32_t>(i);
  for (const unsigned shift : {0U, 11U, 22U}) {
    std::array<std::size_t, 2049> start{};
    for (const std::uint32_t key : keys) ++start[(key >> shift & 2047) + 1];
    for (std::size_t k = 1; k < start.size(); ++k) start[k] += start[k - 1];
    for (const std::uint32_t i : order) next[start[keys[i] >> shift & 2047]++] = i;
    std::swap(order, next);
  }
  return order;
}

class LidarScanner {
 public:
  LidarScanner(const LidarRequest& request, const RenderContext& context)
      : request_(request),
        context_(context),
        ground_("a beam", scenery_of(request), context),
        reflectance_(request.scenery),
        sub_rays_(request.instrument.sub_rays),
        receiver_(request.instrument),
        theta_(request.instrument.divergence_mrad * 1e-3 / 4),
        pulse_m_(pulse_deviation_m(request.instrument.pulse_length_ns)) {}

  LidarReturns scan() {
    aim_beams();
    order_by_ground();
    cast_beams();
    if (request_.craters) find_craters();
    return std::move(out_);
  }

 private:
  static FrameRequest scenery_of(const LidarRequest& request) {
    FrameRequest scenery = request.scenery;
    scenery.products = kRange;  // objects need no sunlight
    return scenery;
  }

  // Sets each beam's time, origin, direction and true Doppler velocity, and refuses invalid apertures.
  void aim_beams() {
    const LidarBeams beams(request_.pulses, request_.pattern);
    const PoseTrack track(request_.pose, request_.rates, request_.poses);
    resize(out_, beams.size());
    in_parallel_pieces(beams.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      context_.stop.check();
      double time_s = kNaN;
      Mat3 moon_from_camera = Mat3::identity();
      Vec3 from = Vec3::zero(), velocity = Vec3::zero();
      for (std::size_t i = first; i < past_last; ++i) {
        const LidarPulse pulse = beams.at(i);
        if (pulse.time_s != time_s) {
          time_s = pulse.time_s;
          const Pose pose = track.at(time_s);
          const Rates rates = track.rates_at(time_s);
          const Vec3& offset = request_.instrument.offset_m;
          moon_from_camera = pose.camera_from_moon.conjugate().matrix();
          from = pose.position_m + moon_from_camera * offset;
          velocity =
              rates.velocity_m_s + moon_from_camera * (kRadiansPerDegree * rates.angular_rate_deg_s).cross(offset);
        }
        const Vec3 direction = (moon_from_camera * pulse.direction).normalized();
        out_.time_s[i] = time_s;
        put3(out_.origin_m, i, from);
        put3(out_.direction, i, direction);
        out_.true_velocity_m_s[i] = static_cast<float>(velocity.dot(direction));
      }
    });
    if (request_.scenery.terrain) refuse_buried_apertures();
    refuse_enclosed_apertures();
  }

  // Returns the subject of an error about the aperture at a time.
  std::string aperture_at(double time_s) const {
    const bool moving = !request_.poses.empty() || !request_.rates.none();
    return moving ? fmt::format("after {:.6g} s the instrument", time_s) : "the instrument";
  }

  // Tests up to kMaxCameraPlaces apertures, evenly spaced over the scan, each once.
  void refuse_enclosed_apertures() const {
    const std::size_t tested = std::min(out_.size(), kMaxCameraPlaces);
    Vec3 tested_m = Vec3::constant(kNaN);
    for (std::size_t k = 0; k < tested; ++k) {
      const std::size_t i = tested == 1 ? 0 : k * (out_.size() - 1) / (tested - 1);
      if (at3(out_.origin_m, i) == tested_m) continue;
      tested_m = at3(out_.origin_m, i);
      refuse_enclosed(request_.scenery.terrain ? &context_.terrain : nullptr, request_.scenery.objects, tested_m,
                      aperture_at(out_.time_s[i]), context_.stop);
    }
  }

  // Tests the lowest aperture of each of up to 4096 intervals of the scan, as many as a tall frame has rows.
  void refuse_buried_apertures() const {
    constexpr std::size_t kMaxIntervals = 4096;
    const std::size_t length = (out_.size() + kMaxIntervals - 1) / kMaxIntervals;
    Vec3 tested_m = Vec3::constant(kNaN);
    for (std::size_t first = 0; first < out_.size(); first += length) {
      context_.stop.check();
      std::size_t lowest = first;
      for (std::size_t i = first + 1; i < std::min(first + length, out_.size()); ++i)
        if (at3(out_.origin_m, i).squared_norm() < at3(out_.origin_m, lowest).squared_norm()) lowest = i;
      if (at3(out_.origin_m, lowest) == tested_m) continue;  // a flash has one origin
      tested_m = at3(out_.origin_m, lowest);
      refuse_buried(context_.terrain, tested_m, aperture_at(out_.time_s[lowest]),
                    request_.poses.empty() ? "pose" : "poses", context_.stop);
    }
  }

  // Orders the beams along a space-filling curve (Morton 1966) over their approximate hits on a sphere, so that beams
  // cast together hit neighbouring ground.
  void order_by_ground() {
    const Vec3 middle = at3(out_.origin_m, out_.size() / 2);
    const EastNorthUp local = local_axes(middle);
    const Geographic below = to_geographic(middle);
    const double height_m = context_.terrain.height(below.lat_deg, below.lon_deg, context_.stop).height_m;
    const double radius = kMoonRadius_m + (std::isnan(height_m) ? 0 : height_m);
    std::vector<float> east(out_.size()), north(out_.size());
    in_parallel_pieces(out_.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) {
        const Vec3 from = at3(out_.origin_m, i), direction = at3(out_.direction, i);
        // The beam meets the sphere at t^2 - 2 closest t + outside = 0; one that misses it counts where it is closest.
        const double closest = -from.dot(direction), outside = from.squared_norm() - radius * radius,
                     discriminant = closest * closest - outside;
        const double range_m = closest > 0 && discriminant > 0
                                   ? std::max(0.0, outside / (closest + std::sqrt(discriminant)))
                                   : std::max(0.0, closest);
        const Vec3 hit = from + range_m * direction - middle;
        east[i] = static_cast<float>(hit.dot(local.east));
        north[i] = static_cast<float>(hit.dot(local.north));
      }
    });
    const auto [west, east_end] = std::minmax_element(east.begin(), east.end());
    const auto [south, north_end] = std::minmax_element(north.begin(), north.end());
    const float side = std::max({*east_end - *west, *north_end - *south, 1e-3F}), scale = 65535 / side, x0 = *west,
                y0 = *south;
    std::vector<std::uint32_t> keys(out_.size());
    for (std::size_t i = 0; i < keys.size(); ++i)
      keys[i] = morton_code(static_cast<std::uint32_t>((east[i] - x0) * scale),
                            static_cast<std::uint32_t>((north[i] - y0) * scale));
    order_ = sorted_order(keys);
  }

  // Returns the cone around the beams order_[first, past_last), sub-rays included. Its slope is infinite if their
  // directions differ too much for a cone.
  RayCone cone_around(std::size_t first, std::size_t past_last) const {
    RayCone cone{Vec3::zero(), Vec3::zero()};
    const auto count = static_cast<double>(past_last - first);
    for (std::size_t k = first; k < past_last; ++k) {
      cone.origin_m += at3(out_.origin_m, order_[k]) / count;
      cone.direction += at3(out_.direction, order_[k]);
    }
    cone.direction.normalize();
    double min_cosine = 1;
    for (std::size_t k = first; k < past_last; ++k) {
      cone.radius_m = std::max(cone.radius_m, (at3(out_.origin_m, order_[k]) - cone.origin_m).norm());
      min_cosine = std::min(min_cosine, at3(out_.direction, order_[k]).dot(cone.direction));
    }
    constexpr double kRounding_rad = 1e-7;
    const double angle =
        std::acos(std::clamp(min_cosine, -1.0, 1.0)) + std::atan(theta_ * sub_rays_.farthest) + kRounding_rad;
    constexpr double kWidest_rad = 0.5;
    cone.slope = angle < kWidest_rad ? std::tan(angle) : std::numeric_limits<double>::infinity();
    cone.radius_m += 1e-6;
    // Follow the cone to below all terrain or, once beams have a reach, as far as the longest of them.
    cone.to_m = range_below_terrain_m(cone);
    double farthest_m = reach_m_.empty() ? cone.to_m : 0;
    for (std::size_t k = first; k < past_last && !reach_m_.empty(); ++k)
      farthest_m = std::max(farthest_m, reach_m_[order_[k]]);
    cone.to_m = std::min(cone.to_m, farthest_m + cone.radius_m);
    return cone;
  }

  // Returns whether a cone is narrow enough to select terrain for its beams: at most 4 % of the range or ten beams
  // wide, and over ground with detail no wider than a block. A wider cone would select ground between the beams that
  // none of them hits.
  bool is_narrow(const RayCone& cone, int finest_detail) const {
    if (!(cone.slope <= std::max(0.02, 20 * theta_) && cone.radius_m < 10)) return false;
    if (!context_.terrain.detailed()) return true;
    const int finest = ground_.finest_ground(finest_detail);
    const double half_block_m = dem::quads_per_side(finest) / 2 * dem::post_spacing_m(finest);
    return cone.radius_m + cone.slope * std::min(cone.to_m, kFarthest_m) <= half_block_m;
  }

  // Adds the cone around the beams, or, if it is too wide, those of their halves.
  void add_cones(std::size_t first, std::size_t past_last, int finest_detail, std::vector<RayCone>& cones) const {
    const RayCone cone = cone_around(first, past_last);
    if (past_last - first == 1 || is_narrow(cone, finest_detail)) return cones.push_back(cone);
    const std::size_t middle = (first + past_last) / 2;
    add_cones(first, middle, finest_detail, cones);
    add_cones(middle, past_last, finest_detail, cones);
  }

  // Returns cones around the beams order_[first, past_last), narrow enough for ground of this level.
  std::vector<RayCone> cones_around(std::size_t first, std::size_t past_last, int finest_detail) const {
    std::vector<RayCone> cones;
    for (std::size_t k = first; k < past_last; k += kBundle * kBeamGroup)
      add_cones(k, std::min(past_last, k + kBundle * kBeamGroup), finest_detail, cones);
    return cones;
  }

  // Returns the coarsest level whose post spacing is at most half the diameter of what a sub-ray lights up at a range,
  // at 1/e^2 of the intensity: frames see ground by half a pixel alike. Single rays would sample finer ground at
  // random.
  int level_for(double range_m) const {
    constexpr double kRadius = 2;  // standard deviations
    const double finest_m = kRadius * theta_ * sub_rays_.deviation * range_m;
    int level = dem::kMaxLevel;
    while (level > dem::kRootLevel && dem::post_spacing_m(level - 1) <= finest_m) --level;
    return level;
  }

  // Casts all beams. Over ground with detail each is cast in steps of next_reach_m(), until all its sub-rays hit
  // something nearer than the followed length. In each step a beam gets ground as fine as it needs at the nearest
  // possible hit. Beams that need different levels are cast separately: no beam's ground depends on the other beams.
  //
  //   order_:  first ... resolved | level 11 | level 12 ...        | past_last
  //            (final)              cast()     cast()                then partition again
  void cast_beams() {
    if (!context_.terrain.detailed()) return cast(0, order_.size(), dem::kMaxLevel);
    reach_m_.assign(out_.size(), 0);
    resolved_.assign(out_.size(), 0);
    std::vector<double> posts_m(out_.size());
    std::vector<int> level(out_.size());
    constexpr std::size_t kBeamsAtOnce = 65536;
    for (std::size_t first = 0; first < order_.size(); first += kBeamsAtOnce) {
      const std::size_t past_last = std::min(first + kBeamsAtOnce, order_.size());
      std::vector<Ray> axes;
      for (std::size_t k = first; k < past_last; k += kBeamGroup)  // one beam stands for its group of neighbours
        axes.push_back({at3(out_.origin_m, order_[k]), at3(out_.direction, order_[k])});
      const std::vector<RayHit> on_posts = cast_rays(axes, {}, std::nullopt, without_detail(context_));
      for (std::size_t k = first; k < past_last; ++k) posts_m[order_[k]] = on_posts[(k - first) / kBeamGroup].range_m;
      const auto at = [&](std::size_t k) { return order_.begin() + static_cast<std::ptrdiff_t>(k); };
      for (std::size_t unresolved = first; unresolved < past_last;) {
        for (std::size_t k = unresolved; k < past_last; ++k) {
          const std::uint32_t beam = order_[k];
          const double reached_m = reach_m_[beam];
          reach_m_[beam] = next_reach_m(reached_m, posts_m[beam]);
          level[beam] = level_for(reach_m_[beam] >= posts_m[beam] ? posts_m[beam] : std::min(reached_m, kFarthest_m));
        }
        std::stable_sort(at(unresolved), at(past_last),
                         [&](std::uint32_t a, std::uint32_t b) { return level[a] < level[b]; });
        for (std::size_t k = unresolved; k < past_last;) {
          const int same_level = level[order_[k]];
          const auto next =
              std::find_if(at(k), at(past_last), [&](std::uint32_t beam) { return level[beam] != same_level; });
          const auto past_same = static_cast<std::size_t>(next - order_.begin());
          cast(k, past_same, same_level);
          k = past_same;
        }
        const auto next_unresolved = std::stable_partition(at(unresolved), at(past_last), [&](std::uint32_t beam) {
          return resolved_[beam] != 0 || !std::isfinite(reach_m_[beam]);
        });
        unresolved = static_cast<std::size_t>(next_unresolved - order_.begin());
      }
    }
  }

  // Casts the beams order_[first, past_last) against one scene and reports them. If one scene cannot hold their
  // terrain, casts each half. Cut between groups, so that groups stay the same, unless a half is smaller than a group.
  void cast(std::size_t first, std::size_t past_last, int finest_detail) {
    const auto is_final = [&](std::uint32_t beam) { return reach_m_.empty() || !std::isfinite(reach_m_[beam]); };
    const bool ends_here = std::any_of(&order_[first], &order_[first] + (past_last - first), is_final);
    // Steps above all ground need no cones as narrow as the finest blocks: wide ones show that they meet none.
    std::vector<RayCone> cones = cones_around(first, past_last, dem::kRootLevel);
    const bool meets_ground = ends_here || ground_.may_meet_ground(cones);
    if (!meets_ground && ground_.objects().empty()) return;
    if (meets_ground) cones = cones_around(first, past_last, finest_detail);
    const auto ground = ground_.build_scene(cones, past_last - first == 1, finest_detail);
    if (!ground) {
      const std::size_t half = (past_last - first) / 2,
                        middle = first + (half > kBeamGroup ? half / kBeamGroup * kBeamGroup : half);
      cast(first, middle, finest_detail);
      cast(middle, past_last, finest_detail);
      return;
    }
    if (ground->empty && !ends_here) return;  // all its beams will be followed farther
    const std::size_t groups = (past_last - first + kBeamGroup - 1) / kBeamGroup;
    in_parallel_pieces(groups, 16, [&](std::size_t g, std::size_t past_last_group) {
      context_.stop.check();
      Work work{reflectance_.sampled(context_.stop), {}, {}, {}};
      for (; g < past_last_group; ++g) {
        const std::size_t k = first + g * kBeamGroup;
        cast_group(*ground, k, std::min(past_last - k, kBeamGroup), work);
      }
    });
  }

  // Sets the crater that encloses each beam's strongest true return.
  void find_craters() {
    if (!context_.terrain.detailed()) {
      out_.crater.assign(out_.size(), 0);
      return;
    }
    std::vector<Vec3> points_m(out_.size());
    for (std::size_t i = 0; i < points_m.size(); ++i)
      points_m[i] = at3(out_.origin_m, i) + out_.true_range_m[i] * at3(out_.direction, i);
    const dem::CraterSurvey survey(context_.terrain, context_.cache.roughness(context_.terrain, context_.stop));
    out_.crater = find_enclosing_craters(points_m, *request_.craters, survey, context_.stop);
  }

  // Scratch memory of one thread: the echo parts of a group's beams.
  struct Work {
    std::vector<ScaledMap> maps;
    std::array<std::array<EchoPart, kMaxSubRays>, kBeamGroup> parts;
    std::array<std::size_t, kBeamGroup> part_count;  // per beam
    Echo echo;
  };

  // Casts all sub-rays of a group of beams, packet by packet, and reports the beams.
  void cast_group(const GroundAlongRays::GroundScene& ground, std::size_t first, std::size_t count, Work& work) {
    Vec3 from[kBeamGroup], axis[kBeamGroup], x[kBeamGroup], y[kBeamGroup];
    for (std::size_t i = 0; i < kBeamGroup; ++i) {
      const std::size_t beam = order_[first + std::min(i, count - 1)];
      from[i] = at3(out_.origin_m, beam);
      axis[i] = at3(out_.direction, beam);
      const TransverseAxes across(axis[i]);
      x[i] = theta_ * across.x;
      y[i] = theta_ * across.y;
      work.part_count[i] = 0;
    }
    for (const SubRay& sub : sub_rays_.rays) {
      Rays rays;
      for (std::size_t i = 0; i < kBeamGroup; ++i) {
        rays.set(static_cast<int>(i), from[i], (axis[i] + sub.x * x[i] + sub.y * y[i]).normalized());
        rays.valid[i] = i < count;
      }
      add_hits(ground, rays, sub.weight, work);
      if (&sub != sub_rays_.rays.data()) continue;
      // The first sub-ray is the axis.
      for (std::size_t i = 0; i < count; ++i)
        out_.axis_range_m[order_[first + i]] = work.part_count[i] > 0 ? work.parts[i][0].range_m : kNaN;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t beam = order_[first + i];
      const std::span parts(work.parts[i].data(), work.part_count[i]);
      if (!reach_m_.empty())
        resolved_[beam] = parts.size() == sub_rays_.rays.size() &&
                          std::ranges::all_of(parts, [&](const EchoPart& p) { return p.range_m <= reach_m_[beam]; });
      report(ground, beam, work.echo.resolve_returns(parts));
    }
  }

  // Casts a packet of sub-rays and adds its hits to the echoes of their beams.
  void add_hits(const GroundAlongRays::GroundScene& ground, Rays& rays, double weight, Work& work) const {
    SurfacePoints points;
    Facets facets;
    trace(*ground.scene, rays, points, facets);
    const Rays all_rays = rays;  // intersect() invalidates lanes that hit an object
    ObjectLanes on_objects;
    const ObjectsInFrame& objects = ground.scenery.objects();
    const std::uint32_t lanes = objects.empty() ? 0 : ground.scenery.intersect(rays, points, on_objects);
    alignas(64) double mu[kPacket];
    alignas(64) double steepness[kPacket];
    alignas(64) double side_m[kPacket];
    alignas(64) double reflected_back[kPacket];
    if (hit_bits(points) != 0) {
      cosines(points, facets, all_rays, mu, steepness);
      for (int i = 0; i < kPacket; ++i) side_m[i] = 4 * theta_ * sub_rays_.deviation * points.distance[i];
      reflectance_.reflected_back(ground.scene->mesh, points, mu, side_m, work.maps, reflected_back);
      for (int i = 0; i < kPacket; ++i)
        if (points.hit[i]) add(work, i, points.distance[i], steepness[i], weight * reflected_back[i], kNoObject);
    }
    if (lanes == 0) return;
    objects.reflected_back(on_objects, reflected_back);
    for (int i = 0; i < kPacket; ++i)
      if (lanes >> i & 1)
        add(work, i, on_objects.points.distance[i], -on_objects.points.facet_normal(i).dot(all_rays.direction(i)),
            weight * reflected_back[i], on_objects.on_soil[i] ? kNoObject : on_objects.object[i]);
  }

  // Computes two cosines of emission per lane: `mu` with the shading normal, as in frames, and `steepness` with the
  // facet's normal.
  static void cosines(const SurfacePoints& p, const Facets& n, const Rays& rays, double* mu, double* steepness) {
    for (int i = 0; i < kPacket; ++i) {
      const double v = p.hit[i] ? p.v[i] : 0, w = p.hit[i] ? p.w[i] : 0, u = 1 - v - w;
      const auto smooth = [&](int k) {
        return u * static_cast<double>(n.normal_a[k][i]) + v * static_cast<double>(n.normal_b[k][i]) +
               w * static_cast<double>(n.normal_c[k][i]);
      };
      const double x = smooth(0), y = smooth(1), z = smooth(2);
      const double toward = -(x * rays.dx[i] + y * rays.dy[i] + z * rays.dz[i]) / std::sqrt(x * x + y * y + z * z);
      const double area = std::sqrt(p.nx[i] * p.nx[i] + p.ny[i] * p.ny[i] + p.nz[i] * p.nz[i]);
      const double facing = -(p.nx[i] * rays.dx[i] + p.ny[i] * rays.dy[i] + p.nz[i] * rays.dz[i]) / area;
      steepness[i] = p.hit[i] ? facing : 1;
      mu[i] = !p.hit[i] ? 1 : toward > 0 ? toward : facing;
    }
  }

  // Adds the hit of one sub-ray to the echo of a beam of the group.
  void add(Work& work, int beam, double range_m, double cos_incidence, double weighted_reflectance,
           std::uint32_t source) const {
    const auto i = static_cast<std::size_t>(beam);
    work.parts[i][work.part_count[i]++] = {
        range_m, part_deviation_m(pulse_m_, range_m, theta_ * sub_rays_.deviation, cos_incidence),
        receiver_.gain() * weighted_reflectance / (range_m * range_m), source};
  }

  // Writes the true values of a beam's strongest return, then its measurement with noise.
  void report(const GroundAlongRays::GroundScene& ground, std::size_t beam, std::span<const EchoReturn> returns) {
    LidarReturns& r = out_;
    const auto strongest = std::max_element(
        returns.begin(), returns.end(), [](const EchoReturn& a, const EchoReturn& b) { return a.signal < b.signal; });
    const bool has_return = strongest != returns.end();
    r.true_count[beam] = static_cast<std::uint8_t>(returns.size());
    r.true_range_m[beam] = has_return ? strongest->range_m : kNaN;
    r.true_width_m[beam] = static_cast<float>(has_return ? strongest->width_m : kNaN);
    r.true_intensity[beam] = static_cast<float>(has_return ? strongest->signal : 0);
    const auto index = static_cast<std::uint16_t>(has_return ? strongest->source : kNoObject);
    const auto rock = index == kNoObject ? std::nullopt : ground.scenery.rock(index);
    r.rock[beam] = rock.value_or(0);
    r.object[beam] = rock ? kNoObject : index;
    const LidarDetection detection =
        receiver_.detect(returns, request_.seed, request_.scan, static_cast<std::uint32_t>(beam));
    r.range_m[beam] = detection.strongest_m;
    r.first_m[beam] = detection.first_m;
    r.last_m[beam] = detection.last_m;
    r.intensity[beam] = detection.strongest;
    r.first_intensity[beam] = detection.first;
    r.last_intensity[beam] = detection.last;
    r.count[beam] = detection.count;
    r.false_alarm[beam] = detection.false_alarm;
    r.velocity_m_s[beam] = detection.count > 0 && !detection.false_alarm
                               ? r.true_velocity_m_s[beam] + detection.velocity_noise_m_s
                               : std::numeric_limits<float>::quiet_NaN();
  }

  const LidarRequest& request_;
  const RenderContext& context_;
  GroundAlongRays ground_;
  const GroundReflectance reflectance_;
  const SubRays sub_rays_;
  const LidarReceiverModel receiver_;
  const double theta_;                  // standard deviation of the beam's irradiance across its axis, rad
  const double pulse_m_;                // standard deviation of the pulse, as a range
  std::vector<std::uint32_t> order_;    // beams in the order in which they are cast
  std::vector<double> reach_m_;         // followed length of each beam; empty over ground without detail
  std::vector<std::uint8_t> resolved_;  // 1 for a beam whose sub-rays all hit something nearer than that
  LidarReturns out_;
};

}  // namespace

LidarReturns scan_lidar(const LidarRequest& request, const RenderContext& context) {
  return LidarScanner(request, context).scan();
}

}  // namespace selenograph::engine
