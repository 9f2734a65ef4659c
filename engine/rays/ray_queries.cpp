#include "engine/rays/ray_queries.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/terrain/surface_place.h"
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

template <typename Work>
void for_packets(std::size_t size, const StopToken& stop, Work&& work) {
  const std::size_t packets = (size + kPacket - 1) / kPacket;
  in_parallel_pieces(packets, 16, [&](std::size_t first, std::size_t past_last) {
    stop.check();
    for (std::size_t p = first; p < past_last; ++p)
      work(p * kPacket, static_cast<int>(std::min<std::size_t>(kPacket, size - p * kPacket)));
  });
}

class RayCaster {
 public:
  // `a_ray`: what a ray is in the words of the request.
  RayCaster(const char* a_ray, const std::vector<SceneObject>& objects, const dem::Terrain& terrain, RenderCache& kept,
            const StopToken& stop)
      : ground_(a_ray, scenery_of(objects), terrain, kept, stop), terrain_(terrain), kept_(kept), stop_(stop) {}

  enum class Meeting { terrain_alone, everything };
  // `within_m`: how far each ray is cast; empty: to its end.
  std::vector<RayHit> cast(std::span<const Ray> rays, const std::optional<Sun>& sun, Meeting meeting,
                           std::vector<double> within_m = {}) {
    std::vector<RayHit> hits(rays.size());
    std::vector<Facet> facets(rays.size());
    const auto meet = [&](const Scene& scene, const SceneryOnGround& on_it, const Batch& batch, std::size_t first,
                          int count) {
      Rays packet;
      for (int i = 0; i < kPacket; ++i) {
        const Ray& ray = rays[batch[first + static_cast<std::size_t>(std::min(i, count - 1))]];
        packet.set(i, ray.origin_m, ray.direction.normalized());
        packet.valid[i] = i < count;
      }
      SurfacePoints points;
      trace(scene, packet, points);
      ObjectLanes on_objects;
      const std::uint32_t lanes =
          meeting == Meeting::everything && !on_it.objects().empty() ? on_it.meet(packet, points, on_objects) : 0;
      for (int i = 0; i < count; ++i) {
        const std::size_t at = batch[first + static_cast<std::size_t>(i)];
        if (lanes >> i & 1) {
          hits[at] = {true,
                      on_it.object(on_objects.object[i]),
                      on_objects.points.distance[i],
                      on_objects.points.position(i),
                      on_objects.shading.normal(i),
                      0,
                      on_objects.on_soil[i] ? std::nullopt : on_it.rock(on_objects.object[i])};
          facets[at] = {on_objects.points.facet_normal(i), on_it.rock(on_objects.object[i])};
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
    in_steps({rays.begin(), rays.end()}, std::move(within_m), hits, meet);
    if (sun) light(hits, facets, *sun);
    return hits;
  }

  // The index of the object that each ray meets nearer than a range; kNoObject: none.
  std::vector<std::uint16_t> nearest_objects(std::span<const Ray> rays, const std::vector<double>& range_m) const {
    std::vector<std::uint16_t> met(rays.size(), kNoObject);
    if (ground_.objects().empty()) return met;
    for_packets(rays.size(), stop_, [&](std::size_t first, int count) {
      Rays packet;
      SurfacePoints behind{};
      for (int i = 0; i < kPacket; ++i) {
        const std::size_t at = first + static_cast<std::size_t>(std::min(i, count - 1));
        packet.set(i, rays[at].origin_m, rays[at].direction.normalized());
        packet.valid[i] = i < count;
        behind.hit[i] = std::isfinite(range_m[at]), behind.distance[i] = range_m[at];
      }
      ObjectLanes lanes;
      const std::uint32_t hit = ground_.objects().intersect(packet, behind, lanes);
      for (int i = 0; i < count; ++i)
        if (hit >> i & 1) met[first + static_cast<std::size_t>(i)] = lanes.object[i];
    });
    return met;
  }

  // How much of the Sun there is at places above the ground.
  std::vector<RayHit> light_at(const std::vector<Vec3>& places, const Sun& sun) {
    std::vector<RayHit> all;
    all.reserve(places.size());
    for (const Vec3& place : places) all.push_back({true, std::nullopt, 0, place, sun.direction, 0});
    light(all, std::vector<Facet>(all.size(), {sun.direction, std::nullopt}), sun);
    return all;
  }

 private:
  using Batch = std::vector<std::size_t>;  // indices of rays
  struct Facet {
    Vec3 normal;                        // as in SurfacePoints
    std::optional<std::uint64_t> rock;  // whose it is, or of the soil against it
  };

  // As in frames: by the facet and by the normal that it is shaded by.
  void light(std::vector<RayHit>& hits, const std::vector<Facet>& facets, const Sun& sun) {
    std::vector<Ray> to_sun;
    std::vector<std::size_t> asked;
    // Terrain along the way to the disc's rim matters, too.
    std::optional<DiscLight> disc;
    if (sun.angular_radius_deg > 0 && !hits.empty()) disc.emplace(sun, up_of(hits));
    std::vector<Vec3> toward{sun.direction};
    if (disc)
      for (const auto& [x, y] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) toward.push_back(disc->direction(x, y));
    for (std::size_t i = 0; i < hits.size(); ++i) {
      const auto faces = [&](const Vec3& d) { return hits[i].normal.dot(d) > 0 && facets[i].normal.dot(d) > 0; };
      if (hits[i].hit && std::any_of(toward.begin(), toward.end(), faces))
        to_sun.push_back({hits[i].position_m, sun.direction}), asked.push_back(i);
    }
    const auto work = [&](const Scene& scene, const SceneryOnGround& on_it, const Batch& batch, std::size_t first,
                          int count) {
      SurfacePoints points{};
      Shading shading{};
      std::uint32_t asking = 0;
      std::uint16_t own[kPacket];
      for (int i = 0; i < kPacket; ++i) {
        const std::size_t at = asked[batch[first + static_cast<std::size_t>(std::min(i, count - 1))]];
        const RayHit& hit = hits[at];
        const Vec3& facet = facets[at].normal;
        own[i] = facets[at].rock ? on_it.index_of_rock(*facets[at].rock) : hit.object.value_or(kNoObject);
        points.hit[i] = i < count;
        if (points.hit[i] && (disc || facet.dot(sun.direction) > 0)) asking |= 1U << i;
        points.x[i] = hit.position_m.x(), points.y[i] = hit.position_m.y(), points.z[i] = hit.position_m.z();
        points.nx[i] = facet.x(), points.ny[i] = facet.y(), points.nz[i] = facet.z();
        shading.nx[i] = hit.normal.x(), shading.ny[i] = hit.normal.y(), shading.nz[i] = hit.normal.z();
        shading.incident[i] = hit.normal.dot(sun.direction);
      }
      float lit[kPacket];
      const auto blocked = [&](std::uint32_t of, const Vec3& d) {
        const std::uint32_t dark = shaded(scene, points, of, d);
        return dark | (on_it.objects().empty() ? 0 : on_it.objects().blocked(points, own, of & ~dark, d));
      };
      if (disc) {
        DiscLanes turned;
        asking &= disc->unoccluded(points, shading, turned, lit);
        disc->remove_blocked(blocked, asking, turned, lit, shading.incident);
      } else {
        const std::uint32_t dark = blocked(asking, sun.direction);
        for (int i = 0; i < kPacket; ++i) lit[i] = asking & ~dark & 1U << i ? 1.F : 0.F;
      }
      for (int i = 0; i < count; ++i) {
        RayHit& hit = hits[asked[batch[first + static_cast<std::size_t>(i)]]];
        hit.lit = static_cast<double>(lit[i]);
        hit.incident = hit.lit > 0 ? hit.lit * std::max(shading.incident[i], 0.0) : 0;
      }
    };
    in_batches(to_sun, all_of(to_sun), {}, work, toward);
  }

  static Batch all_of(const std::vector<Ray>& rays) {
    Batch all(rays.size());
    std::iota(all.begin(), all.end(), std::size_t{0});
    return all;
  }

  // Over ground with detail in steps of next_reach_m(): `meet` writes `hits`.
  template <typename Meet>
  void in_steps(const std::vector<Ray>& rays, std::vector<double> ends_m, std::vector<RayHit>& hits, Meet&& meet) {
    ends_m.resize(rays.size(), std::numeric_limits<double>::infinity());
    for (std::size_t i = 0; i < rays.size(); ++i)
      ends_m[i] = std::min(ends_m[i], range_below_terrain_m({rays[i].origin_m, rays[i].direction}));
    if (!terrain_.detail()) return in_batches(rays, all_of(rays), ends_m, meet);
    const std::vector<RayHit> on_posts = cast_rays(rays, {}, std::nullopt, terrain_.plain(), kept_, stop_);
    std::vector<double> to_m(rays.size(), 0);
    const auto follow = [&](std::size_t i) {
      to_m[i] = std::min(ends_m[i], next_reach_m(to_m[i], on_posts[i].range_m));
    };
    for (std::size_t i = 0; i < rays.size(); ++i) follow(i);
    for (Batch left = all_of(rays); !left.empty();) {
      in_batches(rays, left, to_m, meet);
      std::erase_if(left, [&](std::size_t i) {
        if (to_m[i] >= ends_m[i] || (hits[i].hit && hits[i].range_m <= to_m[i])) return true;
        hits[i] = {}, follow(i);
        return false;
      });
    }
  }

  static Vec3 up_of(const std::vector<RayHit>& hits) {
    const auto hit = std::find_if(hits.begin(), hits.end(), [](const RayHit& h) { return h.hit; });
    return hit == hits.end() ? Vec3::UnitZ() : hit->position_m;
  }

  // work(scene, scenery, batch, first, count) on packets of some rays, as many batches of them as the terrain along
  // them makes scenes of bearable size. Rays that enter the terrain near each other go together. Each is followed as
  // far as `to_m` says; or, where it is empty, along all of `toward`, also from below the ground.
  template <typename Work>
  void in_batches(const std::vector<Ray>& rays, const Batch& some, const std::vector<double>& to_m, Work&& work,
                  const std::vector<Vec3>& toward = {}) {
    std::vector<std::pair<dem::BlockId, std::size_t>> places;
    for (const std::size_t i : some) {
      const Geographic g = to_geographic(anchor_for(rays[i].origin_m, rays[i].direction));
      places.emplace_back(dem::block_at_place(6, g.lat_deg, g.lon_deg), i);
    }
    std::sort(places.begin(), places.end());
    Batch order;
    order.reserve(places.size());
    for (const auto& place : places) order.push_back(place.second);
    split(rays, std::move(order), to_m, work, toward);
  }

  template <typename Work>
  void split(const std::vector<Ray>& rays, Batch batch, const std::vector<double>& to_m, Work& work,
             const std::vector<Vec3>& toward) {
    if (batch.empty()) return;
    std::vector<RayCone> some;
    some.reserve(batch.size() * std::max<std::size_t>(1, toward.size()));
    for (const std::size_t i : batch) {
      if (toward.empty())
        some.push_back({.origin_m = rays[i].origin_m, .direction = rays[i].direction, .to_m = to_m[i]});
      for (const Vec3& direction : toward) some.push_back({rays[i].origin_m, direction});
    }
    const auto here = ground_.along(some, batch.size() == 1);
    if (!here) {
      const auto middle = batch.begin() + static_cast<std::ptrdiff_t>(batch.size() / 2);
      split(rays, {batch.begin(), middle}, to_m, work, toward);
      split(rays, {middle, batch.end()}, to_m, work, toward);
      return;
    }
    if (here->empty && toward.empty()) return;
    if (!toward.empty()) here->scenery.number_rocks();  // rays of light begin on what was hit
    for_packets(batch.size(), stop_,
                [&](std::size_t first, int count) { work(*here->scene, here->scenery, batch, first, count); });
  }

  // What of a frame's request the objects are asked with; the Sun of each question is its own.
  static FrameRequest scenery_of(const std::vector<SceneObject>& objects) {
    FrameRequest request;
    request.objects = objects;
    return request;
  }

  GroundAlongRays ground_;
  const dem::Terrain& terrain_;
  RenderCache& kept_;
  const StopToken& stop_;
};

bool may_meet_relief(const Ray& ray) {
  constexpr double kHighest_m = kMoonRadius_m + double{dem::kHighestRelief_m};
  const double closest = std::max(0.0, -ray.origin_m.dot(ray.direction));
  return (ray.origin_m + closest * ray.direction).norm() < kHighest_m;
}

// A landmark at the terrain's height lies on the mesh to within rounding and the chords' sag (2 mm).
constexpr double kOnGround_m = 0.01;
double slack_m(double range_m) { return std::max(0.05, 1e-7 * range_m); }

// Where a place appears, and when; answers where the camera is then.
Vec3 look(const RowViews& views, const Vec3& place, Landmark& out) {
  if (views.vary()) {
    const auto sighting = views.find(place);
    if (!sighting) return Vec3::Constant(std::nan(""));
    out.x_px = sighting->pixel.x, out.y_px = sighting->pixel.y, out.time_s = sighting->time_s;
    out.range_m = (place - sighting->camera_m).norm();
    return sighting->camera_m;
  }
  const View& view = views.reference();
  out.range_m = (place - view.position()).norm();
  if (const auto pixel = view.project(place)) out.x_px = pixel->x, out.y_px = pixel->y;
  const double along_boresight_m = view.moon_from_camera().col(2).dot(place - view.position());
  out.behind_camera = !view.projection().fisheye() && !(along_boresight_m > 0);
  return view.position();
}

}  // namespace

std::vector<RayHit> cast_rays(std::span<const Ray> rays, const std::vector<SceneObject>& objects,
                              const std::optional<Sun>& sun, const dem::Terrain& terrain, RenderCache& kept,
                              const StopToken& stop) {
  return RayCaster("a ray, or its way to the Sun,", objects, terrain, kept, stop)
      .cast(rays, sun, RayCaster::Meeting::everything);
}

std::vector<HiddenBy> what_hides(std::span<const Ray> rays, const std::vector<SceneObject>& objects, bool moon,
                                 const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop,
                                 double detail_within_m) {
  RayCaster caster("the line of sight to something in the sky", objects, terrain, kept, stop);
  if (!terrain.detail()) detail_within_m = std::numeric_limits<double>::infinity();
  std::vector<HiddenBy> hidden(rays.size(), HiddenBy::none);
  std::vector<double> range_m(rays.size(), std::numeric_limits<double>::infinity());
  std::vector<Ray> near_limb;
  std::vector<std::size_t> asked;
  for (std::size_t i = 0; moon && i < rays.size(); ++i) {
    const double range = range_below_terrain_m({rays[i].origin_m, rays[i].direction});
    if (std::isfinite(range))
      hidden[i] = HiddenBy::moon, range_m[i] = range;
    else if (may_meet_relief(rays[i]))
      near_limb.push_back(rays[i]), asked.push_back(i);
  }
  const std::vector<RayHit> hits = caster.cast(near_limb, std::nullopt, RayCaster::Meeting::everything,
                                               std::vector<double>(near_limb.size(), detail_within_m));
  for (std::size_t k = 0; k < hits.size(); ++k)
    if (hits[k].hit) hidden[asked[k]] = HiddenBy::moon, range_m[asked[k]] = hits[k].range_m;
  if (std::isfinite(detail_within_m)) {
    const std::vector<HiddenBy> beyond = what_hides(near_limb, {}, true, terrain.plain(), kept, stop);
    for (std::size_t k = 0; k < beyond.size(); ++k)
      if (beyond[k] == HiddenBy::moon) hidden[asked[k]] = HiddenBy::moon;
  }
  const std::vector<std::uint16_t> met = caster.nearest_objects(rays, range_m);
  for (std::size_t i = 0; i < rays.size(); ++i)
    if (met[i] != kNoObject) hidden[i] = HiddenBy::object;
  return hidden;
}

std::vector<Landmark> project_landmarks(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter,
                                        std::span<const LandmarkQuery> points, const std::vector<SceneObject>& objects,
                                        const std::optional<Sun>& sun, const dem::Terrain& terrain, RenderCache& kept,
                                        const StopToken& stop) {
  const RowViews views(camera, pose, shutter, stop);
  refuse_underground(terrain, views, stop);
  refuse_enclosed(&terrain, objects, views, stop);
  RayCaster caster("the line of sight to a point, or its way to the Sun,", objects, terrain, kept, stop);
  std::vector<Landmark> answers(points.size());
  std::vector<Ray> looks, downs;
  std::vector<Vec3> places;
  std::vector<double> ranges_m;
  std::vector<std::size_t> looked, on_ground, over_ground;
  for (std::size_t i = 0; i < points.size(); ++i) {
    stop.check();
    const LandmarkQuery& q = points[i];
    Landmark& a = answers[i];
    const double ground = terrain.height(q.lat_deg, q.lon_deg, stop).height_m;
    a.height_m = q.height_m.value_or(ground);
    a.x_px = a.y_px = a.range_m = std::nan("");
    if (std::isnan(a.height_m)) continue;
    const Vec3 place = to_cartesian({q.lat_deg, q.lon_deg, a.height_m});
    // On the ground it is lit as the ground is; what is buried isn't, which nothing is where there are no data.
    if (sun) a.lit = 0;
    if (sun && !(a.height_m <= ground + kOnGround_m)) {
      places.push_back(place), over_ground.push_back(i);
    } else if (sun && a.height_m >= ground - kOnGround_m) {
      const Vec3 up = place.normalized();
      downs.push_back({place + up, -up}), on_ground.push_back(i);
    }
    const Vec3 camera_m = look(views, place, a);
    a.in_frame = a.x_px >= -0.5 && a.y_px >= -0.5 && a.x_px < camera.width - 0.5 && a.y_px < camera.height - 0.5;
    if (!a.in_frame) continue;
    looks.push_back({camera_m, (place - camera_m).normalized()}), ranges_m.push_back(a.range_m), looked.push_back(i);
  }
  const std::vector<RayHit> seen =
      caster.cast(looks, std::nullopt, RayCaster::Meeting::everything, std::move(ranges_m));
  for (std::size_t k = 0; k < seen.size(); ++k) {
    // Visible unless something stands clearly nearer: the landmark itself is met at its own range.
    Landmark& a = answers[looked[k]];
    a.visible = !seen[k].hit || seen[k].range_m > a.range_m - slack_m(a.range_m);
  }
  if (sun) {
    // An object that stands there doesn't hide the ground from its own light.
    const std::vector<RayHit> grounds = caster.cast(downs, sun, RayCaster::Meeting::terrain_alone),
                              over = caster.light_at(places, *sun);
    for (std::size_t k = 0; k < grounds.size(); ++k) {
      Landmark& a = answers[on_ground[k]];
      a.lit = grounds[k].lit;
      if (grounds[k].hit) a.place = {grounds[k].position_m, grounds[k].normal, grounds[k].incident};
    }
    for (std::size_t k = 0; k < over.size(); ++k) answers[over_ground[k]].lit = over[k].lit;
  }
  return answers;
}

}  // namespace selenograph::engine
