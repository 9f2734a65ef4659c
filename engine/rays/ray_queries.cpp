#include "engine/rays/ray_queries.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/terrain/pyramid_terrain.h"
#include "dem/terrain/surface_place.h"
#include "engine/cache/render_context.h"
#include "engine/camera/row_views.h"
#include "engine/rays/ground_along_rays.h"
#include "engine/scene/anchor.h"
#include "engine/scene/ray_selection.h"
#include "engine/visibility/objects/enclosed.h"
#include "engine/visibility/points/disc_light.h"
#include "engine/visibility/points/refine.h"
#include "engine/visibility/points/trace.h"

namespace selenograph::engine {
namespace {

// Calls work(first, count) for each packet of sixteen items, in parallel; the last packet may be smaller.
template <typename Work>
void for_packets(std::size_t size, const StopToken& stop, Work&& work) {
  const std::size_t packets = (size + kPacket - 1) / kPacket;
  in_parallel_pieces(packets, 16, [&](std::size_t first, std::size_t past_last) {
    stop.check();
    for (std::size_t p = first; p < past_last; ++p)
      work(p * kPacket, static_cast<int>(std::min<std::size_t>(kPacket, size - p * kPacket)));
  });
}

// Casts rays against the finest terrain along them, in batches that share a scene.
class RayCaster {
 public:
  // `ray_description`: a ray in the words of the request, for errors. `min_spacing_m`: as of cast_rays().
  RayCaster(const char* ray_description, const std::vector<SceneObject>& objects, const RenderContext& context,
            double min_spacing_m = 0)
      : ground_(ray_description, scenery_of(objects), context), context_(context) {
    while (finest_detail_ > dem::kRootLevel && dem::post_spacing_m(finest_detail_) < min_spacing_m) --finest_detail_;
  }

  enum class Targets { terrain_only, everything };
  // `within_m`: the length to which each ray is cast; empty: all are unlimited.
  std::vector<RayHit> cast(std::span<const Ray> rays, const std::optional<Sun>& sun, Targets targets,
                           std::vector<double> within_m = {}) {
    std::vector<RayHit> hits(rays.size());
    std::vector<Facet> facets(rays.size());
    const auto intersect = [&](const Scene& scene, const SceneryOnGround& scenery, const RayIndices& batch,
                               std::size_t first, int count) {
      Rays packet;
      for (int i = 0; i < kPacket; ++i) {
        const Ray& ray = rays[batch[first + static_cast<std::size_t>(std::min(i, count - 1))]];
        packet.set(i, ray.origin_m, ray.direction.normalized());
        packet.valid[i] = i < count;
      }
      SurfacePoints points;
      trace(scene, packet, points);
      ObjectLanes on_objects;
      const std::uint32_t lanes = targets == Targets::everything && !scenery.objects().empty()
                                      ? scenery.intersect(packet, points, on_objects)
                                      : 0;
      for (int i = 0; i < count; ++i) {
        const std::size_t at = batch[first + static_cast<std::size_t>(i)];
        if (lanes >> i & 1) {
          hits[at] = {true,
                      scenery.object(on_objects.object[i]),
                      on_objects.points.distance[i],
                      on_objects.points.position(i),
                      on_objects.shading.normal(i),
                      0,
                      on_objects.on_soil[i] ? std::nullopt : scenery.rock(on_objects.object[i])};
          facets[at] = {on_objects.points.facet_normal(i), scenery.rock(on_objects.object[i])};
        }
        if (!points.hit[i]) continue;
        hits[at] = {true,
                    std::nullopt,
                    points.distance[i],
                    points.position(i),
                    shading_normal(scene.mesh, points, i, packet.direction(i)),
                    0};
        facets[at] = {points.facet_normal(i), std::nullopt};
      }
    };
    in_steps({rays.begin(), rays.end()}, std::move(within_m), hits, intersect);
    if (sun) light(hits, facets, *sun);
    return hits;
  }

  // Returns the index of the object that each ray hits nearer than `range_m`; kNoObject: none.
  std::vector<std::uint16_t> nearest_objects(std::span<const Ray> rays, const std::vector<double>& range_m) const {
    std::vector<std::uint16_t> nearest(rays.size(), kNoObject);
    if (ground_.objects().empty()) return nearest;
    for_packets(rays.size(), context_.stop, [&](std::size_t first, int count) {
      Rays packet;
      SurfacePoints behind{};
      for (int i = 0; i < kPacket; ++i) {
        const std::size_t at = first + static_cast<std::size_t>(std::min(i, count - 1));
        packet.set(i, rays[at].origin_m, rays[at].direction.normalized());
        packet.valid[i] = i < count;
        behind.hit[i] = std::isfinite(range_m[at]);
        behind.distance[i] = range_m[at];
      }
      ObjectLanes lanes;
      const std::uint32_t hit = ground_.objects().intersect(packet, behind, lanes);
      for (int i = 0; i < count; ++i)
        if (hit >> i & 1) nearest[first + static_cast<std::size_t>(i)] = lanes.object[i];
    });
    return nearest;
  }

  // Returns the visible share of the Sun (RayHit::lit) at points above the ground, each on a surface that faces the
  // Sun.
  std::vector<RayHit> light_at(const std::vector<Vec3>& points_m, const Sun& sun) {
    std::vector<RayHit> hits;
    hits.reserve(points_m.size());
    for (const Vec3& point_m : points_m) hits.push_back({true, std::nullopt, 0, point_m, sun.direction, 0});
    light(hits, std::vector<Facet>(hits.size(), {sun.direction, std::nullopt}), sun);
    return hits;
  }

 private:
  using RayIndices = std::vector<std::size_t>;
  struct Facet {
    Vec3 normal;                        // as in SurfacePoints
    std::optional<std::uint64_t> rock;  // set on a rock and on the soil against it
  };

  // Sets `lit` and `incident` of the hits, as frames do: a hit is dark unless both its facet and its shading normal
  // face the Sun.
  void light(std::vector<RayHit>& hits, const std::vector<Facet>& facets, const Sun& sun) {
    std::vector<Ray> to_sun;
    std::vector<std::size_t> hit_index;  // by ray of to_sun
    // Select terrain toward the disc's rim, too: it occludes part of the disc.
    std::optional<DiscLight> disc;
    if (sun.angular_radius_deg > 0 && !hits.empty()) disc.emplace(sun, up_of(hits));
    std::vector<Vec3> toward{sun.direction};
    if (disc)
      for (const auto& [x, y] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) toward.push_back(disc->direction(x, y));
    for (std::size_t i = 0; i < hits.size(); ++i) {
      const auto faces = [&](const Vec3& d) { return hits[i].normal.dot(d) > 0 && facets[i].normal.dot(d) > 0; };
      if (hits[i].hit && std::any_of(toward.begin(), toward.end(), faces)) {
        to_sun.push_back({hits[i].position_m, sun.direction});
        hit_index.push_back(i);
      }
    }
    const auto work = [&](const Scene& scene, const SceneryOnGround& scenery, const RayIndices& batch,
                          std::size_t first, int count) {
      SurfacePoints points{};
      Shading shading{};
      std::uint32_t query_lanes = 0;
      std::uint16_t own[kPacket];
      for (int i = 0; i < kPacket; ++i) {
        const std::size_t at = hit_index[batch[first + static_cast<std::size_t>(std::min(i, count - 1))]];
        const RayHit& hit = hits[at];
        const Vec3& facet = facets[at].normal;
        own[i] = facets[at].rock ? scenery.index_of_rock(*facets[at].rock) : hit.object.value_or(kNoObject);
        points.hit[i] = i < count;
        if (points.hit[i] && (disc || facet.dot(sun.direction) > 0)) query_lanes |= 1U << i;
        points.x[i] = hit.position_m.x();
        points.y[i] = hit.position_m.y();
        points.z[i] = hit.position_m.z();
        points.nx[i] = facet.x();
        points.ny[i] = facet.y();
        points.nz[i] = facet.z();
        shading.nx[i] = hit.normal.x();
        shading.ny[i] = hit.normal.y();
        shading.nz[i] = hit.normal.z();
        shading.incident[i] = hit.normal.dot(sun.direction);
      }
      float lit[kPacket];
      const auto blocked = [&](std::uint32_t lanes, const Vec3& d) {
        const std::uint32_t dark = shaded(scene, points, lanes, d);
        return dark | (scenery.objects().empty() ? 0 : scenery.objects().blocked(points, own, lanes & ~dark, d));
      };
      if (disc) {
        DiscLanes turned;
        query_lanes &= disc->unoccluded(points, shading, turned, lit);
        disc->remove_blocked(blocked, query_lanes, turned, lit, shading.incident);
      } else {
        const std::uint32_t dark = blocked(query_lanes, sun.direction);
        for (int i = 0; i < kPacket; ++i) lit[i] = query_lanes & ~dark & 1U << i ? 1.F : 0.F;
      }
      for (int i = 0; i < count; ++i) {
        RayHit& hit = hits[hit_index[batch[first + static_cast<std::size_t>(i)]]];
        hit.lit = static_cast<double>(lit[i]);
        hit.incident = hit.lit > 0 ? hit.lit * std::max(shading.incident[i], 0.0) : 0;
      }
    };
    in_batches(to_sun, indices_of(to_sun), {}, work, toward);
  }

  // Returns the indices of all rays.
  static RayIndices indices_of(const std::vector<Ray>& rays) {
    RayIndices indices(rays.size());
    std::iota(indices.begin(), indices.end(), std::size_t{0});
    return indices;
  }

  // Casts rays, over ground with detail in steps of next_reach_m(). `intersect` is called per packet and writes `hits`.
  template <typename Intersect>
  void in_steps(const std::vector<Ray>& rays, std::vector<double> ends_m, std::vector<RayHit>& hits,
                Intersect&& intersect) {
    ends_m.resize(rays.size(), std::numeric_limits<double>::infinity());
    for (std::size_t i = 0; i < rays.size(); ++i)
      ends_m[i] = std::min(ends_m[i], range_below_terrain_m({rays[i].origin_m, rays[i].direction}));
    if (!context_.terrain.detailed()) return in_batches(rays, indices_of(rays), ends_m, intersect);
    const std::vector<RayHit> on_posts = cast_rays(rays, {}, std::nullopt, without_detail(context_));
    std::vector<double> to_m(rays.size(), 0);
    const auto extend = [&](std::size_t i) {
      to_m[i] = std::min(ends_m[i], next_reach_m(to_m[i], on_posts[i].range_m));
    };
    for (std::size_t i = 0; i < rays.size(); ++i) extend(i);
    for (RayIndices unresolved = indices_of(rays); !unresolved.empty();) {
      in_batches(rays, unresolved, to_m, intersect);
      std::erase_if(unresolved, [&](std::size_t i) {
        // A hit farther away than the followed length is not final: a block that was not selected may be nearer.
        if (to_m[i] >= ends_m[i] || (hits[i].hit && hits[i].range_m <= to_m[i])) return true;
        hits[i] = {};
        extend(i);
        return false;
      });
    }
  }

  // Returns the position of the first hit, as the up direction from which the Sun's disc is sampled.
  static Vec3 up_of(const std::vector<RayHit>& hits) {
    const auto hit = std::find_if(hits.begin(), hits.end(), [](const RayHit& h) { return h.hit; });
    return hit == hits.end() ? Vec3::unit_z() : hit->position_m;
  }

  // Calls work(scene, scenery, batch, first, count) on packets of a subset of the rays: those from batch[first] on. The
  // subset is split into batches whose terrain fits into one scene; rays that enter the terrain near each other share a
  // batch. Terrain is selected along each ray up to `to_m`. If `toward` is not empty, terrain is instead selected from
  // the origin of each ray along every direction of `toward`, without limit.
  template <typename Work>
  void in_batches(const std::vector<Ray>& rays, const RayIndices& subset, const std::vector<double>& to_m, Work&& work,
                  const std::vector<Vec3>& toward = {}) {
    constexpr int kBatchLevel = 6;  // rays that enter one block of this level, a degree wide, share a batch
    std::vector<std::pair<dem::BlockId, std::size_t>> entry_blocks;
    for (const std::size_t i : subset) {
      // The anchor of a view along the ray is near its origin or, for a distant one, near its entry into the terrain.
      const Geographic g = to_geographic(anchor_for(rays[i].origin_m, rays[i].direction));
      entry_blocks.emplace_back(dem::block_at_place(kBatchLevel, g.lat_deg, g.lon_deg), i);
    }
    std::sort(entry_blocks.begin(), entry_blocks.end());
    RayIndices order;
    order.reserve(entry_blocks.size());
    for (const auto& [block, ray] : entry_blocks) order.push_back(ray);
    split(rays, std::move(order), to_m, work, toward);
  }

  // Calls `work` on a batch; if its terrain is too much for one scene, on each of its halves.
  template <typename Work>
  void split(const std::vector<Ray>& rays, RayIndices batch, const std::vector<double>& to_m, Work& work,
             const std::vector<Vec3>& toward) {
    if (batch.empty()) return;
    std::vector<RayCone> cones;
    cones.reserve(batch.size() * std::max<std::size_t>(1, toward.size()));
    for (const std::size_t i : batch) {
      if (toward.empty())
        cones.push_back({.origin_m = rays[i].origin_m, .direction = rays[i].direction, .to_m = to_m[i]});
      for (const Vec3& direction : toward) cones.push_back({rays[i].origin_m, direction});
    }
    const auto ground_scene = ground_.build_scene(cones, batch.size() == 1, finest_detail_);
    if (!ground_scene) {
      const auto middle = batch.begin() + static_cast<std::ptrdiff_t>(batch.size() / 2);
      split(rays, {batch.begin(), middle}, to_m, work, toward);
      split(rays, {middle, batch.end()}, to_m, work, toward);
      return;
    }
    if (ground_scene->empty && toward.empty()) return;
    if (!toward.empty()) ground_scene->scenery.index_rocks();  // rays to the Sun may begin on a rock
    for_packets(batch.size(), context_.stop, [&](std::size_t first, int count) {
      work(*ground_scene->scene, ground_scene->scenery, batch, first, count);
    });
  }

  // Returns a frame request with these objects. It has no Sun: callers pass the Sun's direction with each test.
  static FrameRequest scenery_of(const std::vector<SceneObject>& objects) {
    FrameRequest request;
    request.objects = objects;
    return request;
  }

  GroundAlongRays ground_;
  const RenderContext& context_;
  int finest_detail_ = dem::kMaxLevel;
};

// Returns whether a ray passes below the highest possible terrain.
bool may_hit_relief(const Ray& ray) {
  constexpr double kHighest_m = kMoonRadius_m + double{dem::kHighestRelief_m};
  const double closest = std::max(0.0, -ray.origin_m.dot(ray.direction));
  return (ray.origin_m + closest * ray.direction).norm() < kHighest_m;
}

// A landmark at the terrain's height lies on the mesh to within rounding and the chords' sag (2 mm).
constexpr double kOnGround_m = 0.01;
// Returns the tolerance of a landmark's range: rounding grows with the range.
double slack_m(double range_m) { return std::max(0.05, 1e-7 * range_m); }

// Sets the landmark's pixel, range and time. Returns the camera's position at that time, NaN if no row images the
// point.
Vec3 locate_landmark(const RowViews& views, const Vec3& point_m, Landmark& out) {
  if (views.vary()) {
    const auto sighting = views.find(point_m);
    if (!sighting) return Vec3::constant(std::nan(""));
    out.x_px = sighting->pixel.x;
    out.y_px = sighting->pixel.y;
    out.time_s = sighting->time_s;
    out.range_m = (point_m - sighting->camera_m).norm();
    return sighting->camera_m;
  }
  const View& view = views.reference();
  out.range_m = (point_m - view.position()).norm();
  if (const auto pixel = view.project(point_m)) {
    out.x_px = pixel->x;
    out.y_px = pixel->y;
  }
  const double along_boresight_m = view.moon_from_camera().col(2).dot(point_m - view.position());
  out.behind_camera = !view.projection().fisheye() && !(along_boresight_m > 0);
  return view.position();
}

}  // namespace

std::vector<RayHit> cast_rays(std::span<const Ray> rays, const std::vector<SceneObject>& objects,
                              const std::optional<Sun>& sun, const RenderContext& context, double min_spacing_m) {
  return RayCaster("a ray, or its way to the Sun,", objects, context, min_spacing_m)
      .cast(rays, sun, RayCaster::Targets::everything);
}

std::vector<HiddenBy> what_hides(std::span<const Ray> rays, const std::vector<SceneObject>& objects, bool moon,
                                 const RenderContext& context, double detail_within_m) {
  RayCaster caster("the line of sight to something in the sky", objects, context);
  if (!context.terrain.detailed()) detail_within_m = std::numeric_limits<double>::infinity();
  std::vector<HiddenBy> hidden(rays.size(), HiddenBy::none);
  std::vector<double> range_m(rays.size(), std::numeric_limits<double>::infinity());
  std::vector<Ray> near_limb;
  std::vector<std::size_t> ray_index;
  for (std::size_t i = 0; moon && i < rays.size(); ++i) {
    const double range = range_below_terrain_m({rays[i].origin_m, rays[i].direction});
    if (std::isfinite(range)) {
      hidden[i] = HiddenBy::moon;
      range_m[i] = range;
    } else if (may_hit_relief(rays[i])) {
      near_limb.push_back(rays[i]);
      ray_index.push_back(i);
    }
  }
  const std::vector<RayHit> hits = caster.cast(near_limb, std::nullopt, RayCaster::Targets::everything,
                                               std::vector<double>(near_limb.size(), detail_within_m));
  for (std::size_t k = 0; k < hits.size(); ++k) {
    if (!hits[k].hit) continue;
    hidden[ray_index[k]] = HiddenBy::moon;
    range_m[ray_index[k]] = hits[k].range_m;
  }
  if (std::isfinite(detail_within_m)) {
    const std::vector<HiddenBy> by_posts = what_hides(near_limb, {}, true, without_detail(context));
    for (std::size_t k = 0; k < by_posts.size(); ++k)
      if (by_posts[k] == HiddenBy::moon) hidden[ray_index[k]] = HiddenBy::moon;
  }
  const std::vector<std::uint16_t> objects_in_front = caster.nearest_objects(rays, range_m);
  for (std::size_t i = 0; i < rays.size(); ++i)
    if (objects_in_front[i] != kNoObject) hidden[i] = HiddenBy::object;
  return hidden;
}

std::vector<Landmark> project_landmarks(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter,
                                        std::span<const LandmarkQuery> points, const std::vector<SceneObject>& objects,
                                        const std::optional<Sun>& sun, const RenderContext& context) {
  const RowViews views(camera, pose, shutter, context.stop);
  refuse_underground(context.terrain, views, context.stop);
  refuse_enclosed(&context.terrain, objects, views, context.stop);
  RayCaster caster("the line of sight to a point, or its way to the Sun,", objects, context);
  std::vector<Landmark> landmarks(points.size());
  // Three sets of rays, each with the indices of its landmarks: lines of sight, short rays down to landmarks on the
  // ground, and points above the ground.
  std::vector<Ray> sight_lines, downs;
  std::vector<Vec3> points_above;
  std::vector<double> ranges_m;
  std::vector<std::size_t> in_sight, on_ground, over_ground;
  for (std::size_t i = 0; i < points.size(); ++i) {
    context.stop.check();
    const LandmarkQuery& q = points[i];
    Landmark& a = landmarks[i];
    const double ground = context.terrain.height(q.lat_deg, q.lon_deg, context.stop).height_m;
    a.height_m = q.height_m.value_or(ground);
    a.x_px = a.y_px = a.range_m = std::nan("");
    if (std::isnan(a.height_m)) continue;
    const Vec3 point_m = to_cartesian({q.lat_deg, q.lon_deg, a.height_m});
    // A landmark on the ground is lit as the ground is, and a buried one is dark. Without data `ground` is NaN: then
    // the landmark counts as above the ground.
    if (sun) a.lit = 0;
    if (sun && !(a.height_m <= ground + kOnGround_m)) {
      points_above.push_back(point_m);
      over_ground.push_back(i);
    } else if (sun && a.height_m >= ground - kOnGround_m) {
      const Vec3 up = point_m.normalized();
      downs.push_back({point_m + up, -up});
      on_ground.push_back(i);
    }
    const Vec3 camera_m = locate_landmark(views, point_m, a);
    a.in_frame = a.x_px >= -0.5 && a.y_px >= -0.5 && a.x_px < camera.width - 0.5 && a.y_px < camera.height - 0.5;
    if (!a.in_frame) continue;
    sight_lines.push_back({camera_m, (point_m - camera_m).normalized()});
    ranges_m.push_back(a.range_m);
    in_sight.push_back(i);
  }
  const std::vector<RayHit> hits =
      caster.cast(sight_lines, std::nullopt, RayCaster::Targets::everything, std::move(ranges_m));
  for (std::size_t k = 0; k < hits.size(); ++k) {
    // The landmark is visible unless the hit is clearly nearer: the ray hits the landmark itself at its own range.
    Landmark& a = landmarks[in_sight[k]];
    a.visible = !hits[k].hit || hits[k].range_m > a.range_m - slack_m(a.range_m);
  }
  if (sun) {
    // Cast down to the terrain only: an object that stands on the landmark must not replace the ground below it.
    const std::vector<RayHit> grounds = caster.cast(downs, sun, RayCaster::Targets::terrain_only),
                              over = caster.light_at(points_above, *sun);
    for (std::size_t k = 0; k < grounds.size(); ++k) {
      Landmark& a = landmarks[on_ground[k]];
      a.lit = grounds[k].lit;
      if (grounds[k].hit) a.place = {grounds[k].position_m, grounds[k].normal, grounds[k].incident};
    }
    for (std::size_t k = 0; k < over.size(); ++k) landmarks[over_ground[k]].lit = over[k].lit;
  }
  return landmarks;
}

}  // namespace selenograph::engine
