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

constexpr std::size_t kGroup = kPacket;  // beams that are cast together: a packet holds one sub-ray of each
constexpr std::size_t kBundle = 16;      // groups that terrain is looked for together
constexpr std::size_t kMostSubRays = 61;
constexpr double kFarthest_m = 1e5;  // beyond it ground needs no more than what it needs there
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

Vec3 at3(const std::vector<double>& v, std::size_t i) { return {v[3 * i], v[3 * i + 1], v[3 * i + 2]}; }
void put3(std::vector<double>& v, std::size_t i, const Vec3& x) {
  v[3 * i] = x.x(), v[3 * i + 1] = x.y(), v[3 * i + 2] = x.z();
}

void resize(LidarReturns& r, std::size_t n) {
  for (auto* column : {&r.time_s, &r.range_m, &r.first_m, &r.last_m, &r.true_range_m, &r.axis_range_m})
    column->resize(n);
  for (auto* column : {&r.origin_m, &r.direction}) column->resize(3 * n);
  for (auto* column : {&r.intensity, &r.first_intensity, &r.last_intensity, &r.velocity_m_s, &r.true_width_m,
                       &r.true_intensity, &r.true_velocity_m_s})
    column->resize(n);
  for (auto* column : {&r.count, &r.true_count, &r.false_alarm}) column->resize(n);
  r.object.resize(n), r.rock.resize(n);
}

// What the ground reflects back, mu0 f_r at zero phase: a BRDF, with maps of its albedo if there are any.
class GroundReflectance {
 public:
  explicit GroundReflectance(const FrameRequest& request)
      : hapke_(request.reflectance.model == ReflectanceModel::hapke), brdf_(evaluated(request), band_of(request)) {
    if (!request.albedo_maps.empty()) maps_.emplace(request);
  }
  std::vector<ScaledMap> sampled(const StopToken& stop) const {
    return maps_ ? maps_->sampled(stop) : std::vector<ScaledMap>();
  }
  // `side_m`: of the square that each lane's part of its beam lights up.
  void back(const SurfacePoints& points, const double* mu, const double* side_m, std::vector<ScaledMap>& maps,
            double* out) const {
    alignas(64) double albedo[kPacket], ones[kPacket];
    std::fill_n(ones, kPacket, 1.0);
    if (maps_)
      for (int i = 0; i < kPacket; ++i) albedo[i] = points.hit[i] ? albedo_at(points.position(i), side_m[i], maps) : 0;
    brdf_.times_mu0(mu, mu, ones, maps_ && hapke_ ? albedo : nullptr, out);
    if (maps_ && !hapke_)
      for (int i = 0; i < kPacket; ++i) out[i] *= albedo[i];
  }

 private:
  static Reflectance evaluated(const FrameRequest& request) {
    Reflectance reflectance = request.reflectance;
    if (!request.albedo_maps.empty()) reflectance.rho = 1;
    return reflectance;
  }
  double albedo_at(const Vec3& place, double side_m, std::vector<ScaledMap>& maps) const {
    const Geographic g = to_geographic(place);
    double sum = 0;
    visit_coverage(maps, {g.lat_deg, g.lon_deg, {side_m, 0}, {0, side_m}}, maps_->fallback(),
                   [&](double value, double share) { sum += value * share; });
    return sum;
  }

  bool hapke_;
  Brdf brdf_;
  std::optional<AlbedoMaps> maps_;
};

// Bits of two numbers, alternating.
std::uint32_t interleaved(std::uint32_t x, std::uint32_t y) {
  const auto spread = [](std::uint32_t v) {
    v = (v | v << 8) & 0x00ff00ffU, v = (v | v << 4) & 0x0f0f0f0fU;
    v = (v | v << 2) & 0x33333333U, v = (v | v << 1) & 0x55555555U;
    return v;
  };
  return spread(x) | spread(y) << 1;
}

// The indices of keys in ascending order, equal ones in their own.
std::vector<std::uint32_t> sorted_by(const std::vector<std::uint32_t>& keys) {
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
  LidarScanner(const LidarRequest& request, const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop)
      : request_(request),
        terrain_(terrain),
        kept_(kept),
        stop_(stop),
        ground_("a beam", scenery_of(request), terrain, kept, stop),
        reflectance_(request.scenery),
        sub_rays_(request.instrument.sub_rays),
        receiver_(request.instrument),
        theta_(request.instrument.divergence_mrad * 1e-3 / 4),
        pulse_m_(pulse_deviation_m(request.instrument.pulse_length_ns)) {}

  LidarReturns scan() {
    aim();
    sort();
    follow();
    if (request_.craters) find_craters();
    return std::move(out_);
  }

 private:
  static FrameRequest scenery_of(const LidarRequest& request) {
    FrameRequest scenery = request.scenery;
    scenery.products = kRange;  // no light of the Sun
    return scenery;
  }

  // Where each beam leaves from, and where to.
  void aim() {
    const LidarBeams beams(request_.pulses, request_.pattern);
    const PoseTrack track(request_.pose, request_.rates, request_.poses);
    resize(out_, beams.size());
    in_parallel_pieces(beams.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      stop_.check();
      double time_s = kNaN;
      Eigen::Matrix3d moon_from_camera = Eigen::Matrix3d::Identity();
      Vec3 from = Vec3::Zero(), velocity = Vec3::Zero();
      for (std::size_t i = first; i < past_last; ++i) {
        const LidarPulse pulse = beams.at(i);
        if (pulse.time_s != time_s) {
          time_s = pulse.time_s;
          const Pose pose = track.at(time_s);
          const Rates rates = track.rates_at(time_s);
          const Vec3& offset = request_.instrument.offset_m;
          moon_from_camera = pose.camera_from_moon.conjugate().toRotationMatrix();
          from = pose.position_m + moon_from_camera * offset;
          velocity =
              rates.velocity_m_s + moon_from_camera * (kRadiansPerDegree * rates.angular_rate_deg_s).cross(offset);
        }
        const Vec3 direction = (moon_from_camera * pulse.direction).normalized();
        out_.time_s[i] = time_s;
        put3(out_.origin_m, i, from), put3(out_.direction, i, direction);
        out_.true_velocity_m_s[i] = static_cast<float>(velocity.dot(direction));
      }
    });
    if (request_.scenery.terrain) refuse_buried_apertures();
    refuse_enclosed_apertures();
  }

  // Says which aperture an error is about.
  std::string aperture_at(double time_s) const {
    const bool moving = !request_.poses.empty() || !request_.rates.none();
    return moving ? fmt::format("after {:.6g} s the instrument", time_s) : "the instrument";
  }

  void refuse_enclosed_apertures() const {
    const std::size_t places = std::min(out_.size(), kMaxCameraPlaces);
    Vec3 tested_m = Vec3::Constant(kNaN);
    for (std::size_t k = 0; k < places; ++k) {
      const std::size_t i = places == 1 ? 0 : k * (out_.size() - 1) / (places - 1);
      if (at3(out_.origin_m, i) == tested_m) continue;
      tested_m = at3(out_.origin_m, i);
      refuse_enclosed(request_.scenery.terrain ? &terrain_ : nullptr, request_.scenery.objects, tested_m,
                      aperture_at(out_.time_s[i]), stop_);
    }
  }

  // By the lowest beam of each of many stretches of the scan, as many as a tall frame has rows.
  void refuse_buried_apertures() const {
    constexpr std::size_t kMostStretches = 4096;
    const std::size_t length = (out_.size() + kMostStretches - 1) / kMostStretches;
    Vec3 tested_m = Vec3::Constant(kNaN);
    for (std::size_t first = 0; first < out_.size(); first += length) {
      stop_.check();
      std::size_t lowest = first;
      for (std::size_t i = first + 1; i < std::min(first + length, out_.size()); ++i)
        if (at3(out_.origin_m, i).squaredNorm() < at3(out_.origin_m, lowest).squaredNorm()) lowest = i;
      if (at3(out_.origin_m, lowest) == tested_m) continue;  // a flash is from one place
      tested_m = at3(out_.origin_m, lowest);
      refuse_buried(terrain_, tested_m, aperture_at(out_.time_s[lowest]), request_.poses.empty() ? "pose" : "poses",
                    stop_);
    }
  }

  // Beams that meet the ground near each other are cast together: along a curve that fills the ground (Morton 1966).
  void sort() {
    const Vec3 middle = at3(out_.origin_m, out_.size() / 2);
    const EastNorthUp local = local_axes(middle);
    const Geographic below = to_geographic(middle);
    const double height_m = terrain_.height(below.lat_deg, below.lon_deg, stop_).height_m;
    const double radius = kMoonRadius_m + (std::isnan(height_m) ? 0 : height_m);
    std::vector<float> east(out_.size()), north(out_.size());
    in_parallel_pieces(out_.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) {
        const Vec3 from = at3(out_.origin_m, i), direction = at3(out_.direction, i);
        const double closest = -from.dot(direction), outside = from.squaredNorm() - radius * radius,
                     root2 = closest * closest - outside;
        const double along =
            closest > 0 && root2 > 0 ? std::max(0.0, outside / (closest + std::sqrt(root2))) : std::max(0.0, closest);
        const Vec3 at = from + along * direction - middle;
        east[i] = static_cast<float>(at.dot(local.east)), north[i] = static_cast<float>(at.dot(local.north));
      }
    });
    const auto [west, east_end] = std::minmax_element(east.begin(), east.end());
    const auto [south, north_end] = std::minmax_element(north.begin(), north.end());
    const float side = std::max({*east_end - *west, *north_end - *south, 1e-3F}), scale = 65535 / side, x0 = *west,
                y0 = *south;
    std::vector<std::uint32_t> keys(out_.size());
    for (std::size_t i = 0; i < keys.size(); ++i)
      keys[i] = interleaved(static_cast<std::uint32_t>((east[i] - x0) * scale),
                            static_cast<std::uint32_t>((north[i] - y0) * scale));
    order_ = sorted_by(keys);
  }

  // The cone around some beams; its slope is infinite where they look too far apart for one.
  RayCone cone_around(std::size_t first, std::size_t past_last) const {
    RayCone cone{Vec3::Zero(), Vec3::Zero()};
    const auto count = static_cast<double>(past_last - first);
    for (std::size_t k = first; k < past_last; ++k)
      cone.origin_m += at3(out_.origin_m, order_[k]) / count, cone.direction += at3(out_.direction, order_[k]);
    cone.direction.normalize();
    double least_cosine = 1;
    for (std::size_t k = first; k < past_last; ++k) {
      cone.radius_m = std::max(cone.radius_m, (at3(out_.origin_m, order_[k]) - cone.origin_m).norm());
      least_cosine = std::min(least_cosine, at3(out_.direction, order_[k]).dot(cone.direction));
    }
    constexpr double kRounding_rad = 1e-7;
    const double angle =
        std::acos(std::clamp(least_cosine, -1.0, 1.0)) + std::atan(theta_ * sub_rays_.farthest) + kRounding_rad;
    constexpr double kWidest_rad = 0.5;
    cone.slope = angle < kWidest_rad ? std::tan(angle) : std::numeric_limits<double>::infinity();
    cone.radius_m += 1e-6;
    cone.to_m = range_below_terrain_m(cone);
    double farthest_m = reach_m_.empty() ? cone.to_m : 0;
    for (std::size_t k = first; k < past_last && !reach_m_.empty(); ++k)
      farthest_m = std::max(farthest_m, reach_m_[order_[k]]);
    cone.to_m = std::min(cone.to_m, farthest_m + cone.radius_m);
    return cone;
  }

  // Returns whether one cone serves its beams: it is no wider than a hundredth of the range or ten beams, and over
  // ground with detail no wider than a block. Between beams that are farther apart there is ground that no beam meets.
  bool is_narrow(const RayCone& cone, int finest_detail) const {
    if (!(cone.slope <= std::max(0.02, 20 * theta_) && cone.radius_m < 10)) return false;
    if (!terrain_.detail()) return true;
    const double half_block_m = dem::quads_per_side(finest_detail) / 2 * dem::post_spacing_m(finest_detail);
    return cone.radius_m + cone.slope * std::min(cone.to_m, kFarthest_m) <= half_block_m;
  }

  void add_cones(std::size_t first, std::size_t past_last, int finest_detail, std::vector<RayCone>& cones) const {
    const RayCone cone = cone_around(first, past_last);
    if (past_last - first == 1 || is_narrow(cone, finest_detail)) return cones.push_back(cone);
    const std::size_t middle = (first + past_last) / 2;
    add_cones(first, middle, finest_detail, cones);
    add_cones(middle, past_last, finest_detail, cones);
  }

  // Returns the coarsest level whose posts are no farther apart than half of the deviation of what a sub-ray lights up
  // at a range. Ground finer than that can only be sampled by chance.
  int level_for(double range_m) const {
    const double finest_m = theta_ * sub_rays_.part * range_m / 2;
    int level = dem::kMaxLevel;
    while (level > dem::kRootLevel && dem::post_spacing_m(level - 1) <= finest_m) --level;
    return level;
  }

  // Over ground with detail in steps of next_reach_m(): until all sub-rays of a beam meet something nearer than it was
  // followed. Each step shows a beam ground as fine as it needs where it may meet it first; beams that need different
  // ground are cast separately, so that no beam's ground depends on the others.
  void follow() {
    if (!terrain_.detail()) return cast(0, order_.size(), dem::kMaxLevel);
    reach_m_.assign(out_.size(), 0), known_.assign(out_.size(), 0);
    std::vector<double> posts_m(out_.size());
    std::vector<int> level(out_.size());
    constexpr std::size_t kSome = 65536;
    for (std::size_t first = 0; first < order_.size(); first += kSome) {
      const std::size_t past_last = std::min(first + kSome, order_.size());
      std::vector<Ray> axes;
      for (std::size_t k = first; k < past_last; k += kGroup)  // its neighbours meet the ground beside it
        axes.push_back({at3(out_.origin_m, order_[k]), at3(out_.direction, order_[k])});
      const std::vector<RayHit> on_posts = cast_rays(axes, {}, std::nullopt, terrain_.plain(), kept_, stop_);
      for (std::size_t k = first; k < past_last; ++k) posts_m[order_[k]] = on_posts[(k - first) / kGroup].range_m;
      const auto at = [&](std::size_t k) { return order_.begin() + static_cast<std::ptrdiff_t>(k); };
      for (std::size_t left = first; left < past_last;) {
        for (std::size_t k = left; k < past_last; ++k) {
          const std::uint32_t beam = order_[k];
          const double reached_m = reach_m_[beam];
          reach_m_[beam] = next_reach_m(reached_m, posts_m[beam]);
          level[beam] = level_for(reach_m_[beam] >= posts_m[beam] ? posts_m[beam] : std::min(reached_m, kFarthest_m));
        }
        std::stable_sort(at(left), at(past_last),
                         [&](std::uint32_t a, std::uint32_t b) { return level[a] < level[b]; });
        for (std::size_t k = left; k < past_last;) {
          const int here = level[order_[k]];
          const auto next = std::find_if(at(k), at(past_last), [&](std::uint32_t beam) { return level[beam] != here; });
          const auto past_same = static_cast<std::size_t>(next - order_.begin());
          cast(k, past_same, here);
          k = past_same;
        }
        const auto unknown = std::stable_partition(at(left), at(past_last), [&](std::uint32_t beam) {
          return known_[beam] != 0 || !std::isfinite(reach_m_[beam]);
        });
        left = static_cast<std::size_t>(unknown - order_.begin());
      }
    }
  }

  void cast(std::size_t first, std::size_t past_last, int finest_detail) {
    std::vector<RayCone> cones;
    for (std::size_t k = first; k < past_last; k += kBundle * kGroup)
      add_cones(k, std::min(past_last, k + kBundle * kGroup), finest_detail, cones);
    const auto part = ground_.along(cones, past_last - first == 1, finest_detail);
    if (!part) {
      const std::size_t half = (past_last - first) / 2,
                        middle = first + (half > kGroup ? half / kGroup * kGroup : half);
      cast(first, middle, finest_detail);
      cast(middle, past_last, finest_detail);
      return;
    }
    const auto ends = [&](std::uint32_t beam) { return reach_m_.empty() || !std::isfinite(reach_m_[beam]); };
    if (part->empty && std::none_of(&order_[first], &order_[first] + (past_last - first), ends)) return;
    const std::size_t groups = (past_last - first + kGroup - 1) / kGroup;
    in_parallel_pieces(groups, 16, [&](std::size_t g, std::size_t past_last_group) {
      stop_.check();
      Work work{reflectance_.sampled(stop_), {}, {}, {}};
      for (; g < past_last_group; ++g) {
        const std::size_t k = first + g * kGroup;
        look(*part, k, std::min(past_last - k, kGroup), work);
      }
    });
  }

  // Those that the strongest returns are from.
  void find_craters() {
    if (!terrain_.detail()) {
      out_.crater.assign(out_.size(), 0);
      return;
    }
    std::vector<Vec3> places(out_.size());
    for (std::size_t i = 0; i < places.size(); ++i)
      places[i] = at3(out_.origin_m, i) + out_.true_range_m[i] * at3(out_.direction, i);
    const dem::CraterSurvey survey(terrain_, kept_.roughness(terrain_, stop_));
    out_.crater = craters_of(places, *request_.craters, survey, stop_);
  }

  struct Work {
    std::vector<ScaledMap> maps;
    std::array<std::array<EchoPart, kMostSubRays>, kGroup> parts;
    std::array<std::size_t, kGroup> met;
    Echo echo;
  };

  void look(const GroundAlongRays::Part& part, std::size_t first, std::size_t count, Work& work) {
    Vec3 from[kGroup], axis[kGroup], x[kGroup], y[kGroup];
    for (std::size_t i = 0; i < kGroup; ++i) {
      const std::size_t beam = order_[first + std::min(i, count - 1)];
      from[i] = at3(out_.origin_m, beam), axis[i] = at3(out_.direction, beam);
      const Across across(axis[i]);
      x[i] = theta_ * across.x, y[i] = theta_ * across.y, work.met[i] = 0;
    }
    for (const SubRay& sub : sub_rays_.rays) {
      Rays rays;
      for (std::size_t i = 0; i < kGroup; ++i) {
        rays.set(static_cast<int>(i), from[i], (axis[i] + sub.x * x[i] + sub.y * y[i]).normalized());
        rays.valid[i] = i < count;
      }
      meet(part, rays, sub.weight, work);
      if (&sub != sub_rays_.rays.data()) continue;
      for (std::size_t i = 0; i < count; ++i)  // the axis
        out_.axis_range_m[order_[first + i]] = work.met[i] > 0 ? work.parts[i][0].range_m : kNaN;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t beam = order_[first + i];
      const std::span parts(work.parts[i].data(), work.met[i]);
      if (!reach_m_.empty())
        known_[beam] = parts.size() == sub_rays_.rays.size() &&
                       std::ranges::all_of(parts, [&](const EchoPart& p) { return p.range_m <= reach_m_[beam]; });
      report(part, beam, work.echo.returns_of(parts));
    }
  }

  // What a packet of sub-rays meets becomes parts of their beams' echoes.
  void meet(const GroundAlongRays::Part& part, Rays& rays, double weight, Work& work) const {
    SurfacePoints points;
    Facets facets;
    trace(*part.scene, rays, points, facets);
    const Rays all = rays;
    ObjectLanes on_objects;
    const ObjectsInFrame& objects = part.scenery.objects();
    const std::uint32_t lanes = objects.empty() ? 0 : part.scenery.meet(rays, points, on_objects);
    alignas(64) double mu[kPacket], steepness[kPacket], side_m[kPacket], back[kPacket];
    if (const std::uint32_t ground = hit_bits(points); ground != 0) {
      cosines(points, facets, all, mu, steepness);
      for (int i = 0; i < kPacket; ++i) side_m[i] = 4 * theta_ * sub_rays_.part * points.distance[i];
      reflectance_.back(points, mu, side_m, work.maps, back);
      for (int i = 0; i < kPacket; ++i)
        if (points.hit[i]) add(work, i, points.distance[i], steepness[i], weight * back[i], kNoObject);
    }
    if (lanes == 0) return;
    objects.reflected_back(on_objects, back);
    for (int i = 0; i < kPacket; ++i)
      if (lanes >> i & 1)
        add(work, i, on_objects.points.distance[i], -on_objects.points.facet_normal(i).dot(all.direction(i)),
            weight * back[i], on_objects.on_soil[i] ? kNoObject : on_objects.object[i]);
  }

  // Cosines of emission by the normals that frames are shaded by, and by the facets themselves.
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

  void add(Work& work, int beam, double range_m, double cos_incidence, double weighted_back, std::uint32_t of) const {
    const auto i = static_cast<std::size_t>(beam);
    work.parts[i][work.met[i]++] = {range_m,
                                    part_deviation_m(pulse_m_, range_m, theta_ * sub_rays_.part, cos_incidence),
                                    receiver_.gain() * weighted_back / (range_m * range_m), of};
  }

  void report(const GroundAlongRays::Part& part, std::size_t beam, std::span<const EchoReturn> returns) {
    LidarReturns& r = out_;
    const auto strongest = std::max_element(
        returns.begin(), returns.end(), [](const EchoReturn& a, const EchoReturn& b) { return a.signal < b.signal; });
    const bool any = strongest != returns.end();
    r.true_count[beam] = static_cast<std::uint8_t>(returns.size());
    r.true_range_m[beam] = any ? strongest->range_m : kNaN;
    r.true_width_m[beam] = static_cast<float>(any ? strongest->width_m : kNaN);
    r.true_intensity[beam] = static_cast<float>(any ? strongest->signal : 0);
    const auto index = static_cast<std::uint16_t>(any ? strongest->of : kNoObject);
    const auto rock = index == kNoObject ? std::nullopt : part.scenery.rock(index);
    r.rock[beam] = rock.value_or(0), r.object[beam] = rock ? kNoObject : index;
    const LidarDetection found =
        receiver_.detect(returns, request_.seed, request_.scan, static_cast<std::uint32_t>(beam));
    r.range_m[beam] = found.strongest_m, r.first_m[beam] = found.first_m, r.last_m[beam] = found.last_m;
    r.intensity[beam] = found.strongest, r.first_intensity[beam] = found.first, r.last_intensity[beam] = found.last;
    r.count[beam] = found.count, r.false_alarm[beam] = found.false_alarm;
    r.velocity_m_s[beam] = found.count > 0 && !found.false_alarm ? r.true_velocity_m_s[beam] + found.velocity_noise_m_s
                                                                 : std::numeric_limits<float>::quiet_NaN();
  }

  const LidarRequest& request_;
  const dem::Terrain& terrain_;
  RenderCache& kept_;
  const StopToken& stop_;
  GroundAlongRays ground_;
  const GroundReflectance reflectance_;
  const SubRays sub_rays_;
  const LidarReceiverModel receiver_;
  const double theta_, pulse_m_;
  std::vector<std::uint32_t> order_;
  std::vector<double> reach_m_;      // of each beam, over ground with detail: how far it is followed
  std::vector<std::uint8_t> known_;  // whether all that it meets is nearer
  LidarReturns out_;
};

}  // namespace

LidarReturns scan_lidar(const LidarRequest& request, const dem::Terrain& terrain, RenderCache& kept,
                        const StopToken& stop) {
  return LidarScanner(request, terrain, kept, stop).scan();
}

}  // namespace selenograph::engine
