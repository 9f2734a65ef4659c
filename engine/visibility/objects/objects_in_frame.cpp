#include "engine/visibility/objects/objects_in_frame.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>

#include "engine/frame/needs.h"
#include "engine/radiometry/radiometry.h"
#include "engine/support/box.h"
#include "engine/visibility/objects/object_mesh.h"
#include "engine/visibility/objects/rock_shapes.h"

namespace selenograph::engine {
namespace {

// Relative margin of bounding balls: the ball on which rays start encloses the object as Embree rounds it.
constexpr double kMargin = 1e-5;

struct BallEntry {
  bool enters;
  double distance;  // in lengths of the direction; 0 if the ray starts inside
};

// Returns where a ray enters a ball.
BallEntry enter_ball(const Vec3& from_centre, const Vec3& direction, double radius) {
  const double a = direction.squared_norm();
  const double middle = -from_centre.dot(direction) / a;
  // Compute the perpendicular as a vector: the difference of squares would lose it for a ray from afar.
  const double off2 = (from_centre + middle * direction).squared_norm();
  const double inside2 = radius * radius - off2;
  if (inside2 <= 0) return {false, 0};
  const double half_chord = std::sqrt(inside2 / a);
  if (middle + half_chord < 0) return {false, 0};
  return {true, std::max(0.0, middle - half_chord)};
}

// A cone around the rays of a packet. Their origins are equal or, with a view per row, close to each other.
class Cone {
 public:
  explicit Cone(const Rays& rays) {
    Vec3 unit[kPacket], sum = Vec3::zero();
    for (int i = 0; i < kPacket; ++i) {
      if (!rays.valid[i]) continue;
      unit[i] = rays.direction(i).normalized();
      sum += unit[i];
      if (empty_) {
        apex_ = rays.origin(i);
        empty_ = false;
      }
      spread_m_ = std::max(spread_m_, (rays.origin(i) - apex_).norm());
    }
    axis_ = sum.normalized();
    double widest2 = 0;
    for (int i = 0; i < kPacket; ++i)
      if (rays.valid[i]) widest2 = std::max(widest2, (unit[i] - axis_).squared_norm());
    spread_ = angle_of_chord(std::sqrt(widest2));
  }

  bool may_hit(const Ball& ball) const {
    if (empty_) return false;
    const Vec3 to = ball.centre_m - apex_;
    // Enlarge the ball by the spread of origins: a ray that hits the ball from another origin hits the enlarged ball
    // when moved to the apex.
    const double distance = to.norm();
    const double radius_m = ball.radius_m + spread_m_;
    if (distance <= radius_m) return true;
    return angle_of_chord((to / distance - axis_).norm()) <= spread_ + std::asin(radius_m / distance) + 1e-12;
  }

 private:
  static double angle_of_chord(double chord) { return 2 * std::asin(std::min(1.0, chord / 2)); }

  Vec3 apex_ = Vec3::zero(), axis_;
  double spread_;        // largest angle between a ray and the axis, radians
  double spread_m_ = 0;  // largest distance of a ray's origin from the apex
  bool empty_ = true;
};

// Returns a ball around the points of some lanes.
Ball ball_around(const SurfacePoints& points, std::uint32_t lanes) {
  Box3 box;
  for (int i = 0; i < kPacket; ++i)
    if (lanes >> i & 1) box.extend(points.position(i));
  return {box.centre(), box.size().norm() / 2};
}

// Returns whether rays in a (unit) direction from inside one ball may hit another ball.
bool may_block(const Ball& from, const Vec3& toward, const Ball& ball) {
  const Vec3 to = ball.centre_m - from.centre_m;
  const double distance_along = to.dot(toward);
  const double reach = from.radius_m + ball.radius_m;
  return distance_along >= -reach && (to - distance_along * toward).squared_norm() <= reach * reach;
}

// Sets lane i to a ray, rounded to float, and activates it (Embree's mask of -1).
void set_lane(RayPacket& packet, int i, const Vec3& origin, const Vec3& direction) {
  packet.ox[i] = static_cast<float>(origin.x());
  packet.oy[i] = static_cast<float>(origin.y());
  packet.oz[i] = static_cast<float>(origin.z());
  packet.dx[i] = static_cast<float>(direction.x());
  packet.dy[i] = static_cast<float>(direction.y());
  packet.dz[i] = static_cast<float>(direction.z());
  packet.active[i] = -1;
}

// Gives idle lanes a copy of an active ray: arbitrary values would make the packet unsafe as a bundle.
void fill_idle(RayPacket& packet, std::uint32_t active) {
  const int source = std::countr_zero(active);
  for (int i = 0; i < kPacket; ++i) {
    if (active >> i & 1) continue;
    packet.ox[i] = packet.ox[source];
    packet.oy[i] = packet.oy[source];
    packet.oz[i] = packet.oz[source];
    packet.dx[i] = packet.dx[source];
    packet.dy[i] = packet.dy[source];
    packet.dz[i] = packet.dz[source];
    packet.active[i] = 0;
  }
}

}  // namespace

std::vector<Ball> balls_around(const std::vector<SceneObject>& objects) {
  std::vector<Ball> balls;
  balls.reserve(objects.size());
  for (const SceneObject& o : objects)
    balls.push_back({o.position_m + o.moon_from_object * Vec3(o.scale * o.mesh->centre()),
                     o.scale * o.mesh->radius() * (1 + kMargin)});
  return balls;
}

bool objects_emit(const std::vector<SceneObject>& objects) {
  return std::any_of(objects.begin(), objects.end(), [](const SceneObject& object) {
    return std::any_of(object.materials.begin(), object.materials.end(),
                       [](const Material& m) { return m.temperature_k > 0; });
  });
}

ObjectsInFrame::ObjectsInFrame(const FrameRequest& request, const RowViews& views,
                               std::span<const dem::RockFeature> rocks, const StopToken& stop)
    : ObjectsInFrame(request, &views) {
  place_rocks(rocks, views.reference().position(), &views, stop);
}

ObjectsInFrame::ObjectsInFrame(const FrameRequest& request, std::span<const dem::RockFeature> rocks,
                               const StopToken& stop)
    : ObjectsInFrame(request, nullptr) {
  Box3 box;
  for (const dem::RockFeature& rock : rocks) box.extend(rock.position_m);
  if (!rocks.empty()) place_rocks(rocks, box.centre(), nullptr, stop);
}

// Adds rocks, then the soil against them, to placed_. Builds the structures that rays find them by: one group around
// the anchor, and the cells of an image in which rays from the camera, or toward the Sun, may hit one.
void ObjectsInFrame::place_rocks(std::span<const dem::RockFeature> rocks, const Vec3& anchor_m, const RowViews* views,
                                 const StopToken& stop) {
  if (rocks.empty()) return;
  first_rock_ = placed_.size();
  shadings_.push_back(shadings_of({{request_.reflectance, request_.temperature_k}}));
  const auto add_shape = [&](const PlacedShape& shape, std::size_t number, bool soil) {
    const Mat3 stretch = shape.from_mesh.linear;  // with the rotation
    Placed added =
        placed(*shape.mesh, rocks[number].position_m + shape.from_mesh.translation, stretch, stretch.inverse(),
               stretch.norm());  // an upper bound of the scale
    added.in_view = true;
    added.number = static_cast<std::uint16_t>(first_rock_ + number);
    added.soil = soil;
    added.brightness = rocks[number].rock.brightness;
    added.part_shadings = &shadings_.back();
    placed_.push_back(std::move(added));
  };
  for (std::size_t i = 0; i < rocks.size(); ++i) add_shape(placed_rock(rocks[i].rock, rocks[i].up), i, false);
  const auto has_visible_soil = [&](const dem::RockFeature& rock) {
    return !views || std::any_of(views->bundles().begin(), views->bundles().end(), [&](const ViewBundle& bundle) {
      return bundle.pixels_per_metre(rock.position_m, 0) * rock.rock.fillet_m >= request_.accuracy.max_error_px / 2;
    });
  };
  for (std::size_t i = 0; i < (views ? std::min(rocks.size(), kMaxRocksWithSoil) : rocks.size()); ++i)
    if (has_visible_soil(rocks[i]))
      if (const auto soil = placed_fillet(rocks[i].rock, rocks[i].up)) add_shape(*soil, i, true);
  any_in_view_ = true;
  build_rock_group(anchor_m, stop);
  std::vector<Ellipsoid> ellipsoids;
  ellipsoids.reserve(placed_.size() - first_rock_);
  for (std::size_t i = first_rock_; i < placed_.size(); ++i)
    ellipsoids.push_back(
        {placed_[i].ball.centre_m, placed_[i].mesh->radius() * (1 + kMargin) * placed_[i].object_from_moon.inverse()});
  if (views && single_origin_ && !views->camera().beyond_plane()) {
    const View& view = views->reference();
    in_image_ = EllipsoidImages::from(view.position(), view.moon_from_camera(), view.widest_slope(), ellipsoids);
  }
  if (wants_light(request_)) toward_sun_ = EllipsoidImages::along(request_.sun.direction, anchor_m_, ellipsoids);
}

ObjectsInFrame::ObjectsInFrame(const FrameRequest& request, const RowViews* views)
    : request_(request), single_origin_(views && !views->vary()) {
  shadings_.reserve(request.objects.size() + 1);  // Placed::part_shadings points into it
  for (const SceneObject& object : request.objects) {
    const Mat3 turned = object.moon_from_object.matrix();
    Placed p =
        placed(*object.mesh, object.position_m, object.scale * turned, turned.transpose() / object.scale, object.scale);
    p.number = static_cast<std::uint16_t>(placed_.size());
    p.soil = false;
    p.in_view = !views || std::any_of(views->bundles().begin(), views->bundles().end(), [&](const ViewBundle& bundle) {
      return bundle.may_see(p.ball.centre_m, p.ball.radius_m);
    });
    any_in_view_ |= p.in_view;
    shadings_.push_back(shadings_of(object.materials));
    p.part_shadings = &shadings_.back();
    placed_.push_back(std::move(p));
  }
}

// Places a mesh. The caller sets in_view, number, soil and part_shadings.
ObjectsInFrame::Placed ObjectsInFrame::placed(const ObjectMesh& mesh, const Vec3& position_m,
                                              const Mat3& moon_from_object, const Mat3& object_from_moon,
                                              double scale) const {
  Placed p;
  p.mesh = &mesh;
  p.object_from_moon = object_from_moon;
  p.normals = object_from_moon.transpose();
  p.position = position_m;
  p.scale = scale;
  p.tracer_origin = position_m + moon_from_object * mesh.middle();
  p.ball = {position_m + moon_from_object * mesh.centre(), scale * mesh.radius() * (1 + kMargin)};
  return p;
}

std::vector<ObjectsInFrame::PartShading> ObjectsInFrame::shadings_of(const std::vector<Material>& materials) const {
  std::vector<PartShading> part_shadings;
  for (const Material& material : materials) {
    const RadianceTerms terms = radiance_terms(request_, material);
    part_shadings.push_back(
        {Brdf(material.reflectance, band_of(request_)), terms.direct_w_m2, static_cast<float>(terms.base_w_m2_sr())});
  }
  return part_shadings;
}

std::vector<Ball> ObjectsInFrame::balls_around_rocks() const {
  std::vector<Ball> out;
  for (std::size_t i = first_rock_; i < placed_.size(); ++i) out.push_back(placed_[i].ball);
  return out;
}

// Builds the group of rocks around the anchor. With the camera as the anchor, float resolves a small fraction of a
// pixel.
void ObjectsInFrame::build_rock_group(const Vec3& anchor_m, const StopToken& stop) {
  anchor_m_ = anchor_m;
  for (std::size_t i = first_rock_; i < placed_.size(); ++i)
    rocks_radius_m_ =
        std::max(rocks_radius_m_, (placed_[i].ball.centre_m - anchor_m_).norm() + placed_[i].ball.radius_m);
  rocks_.emplace(
      placed_.size() - first_rock_,
      [&](std::size_t i) {
        const Placed& p = placed_[first_rock_ + i];
        const Affine group_from_tracer{p.object_from_moon.inverse(), p.tracer_origin - anchor_m_};
        return ObjectGroup::Instance{&p.mesh->tracer(), group_from_tracer};
      },
      stop);
}

std::uint32_t ObjectsInFrame::intersect(Rays& rays, SurfacePoints& terrain, ObjectLanes& out, bool from_camera) const {
  if (from_camera ? !any_in_view_ : placed_.empty()) return 0;
  double nearest[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    nearest[i] = terrain.hit[i] ? terrain.distance[i] : std::numeric_limits<double>::infinity();
    out.object[i] = kNoObject;
  }
  // Intersect the objects of the request one by one, then all rocks at once.
  const std::size_t object_count = std::min(placed_.size(), first_rock_);
  std::optional<Cone> cone;
  if (from_camera && single_origin_ && object_count > 0) cone.emplace(rays);
  for (std::size_t k = 0; k < object_count; ++k)
    if ((placed_[k].in_view || !from_camera) && (!cone || cone->may_hit(placed_[k].ball)))
      intersect_object(placed_[k], rays, nearest, out);
  if (rocks_) intersect_rocks(rays, from_camera, nearest, out);
  std::uint32_t lanes = 0;
  for (int i = 0; i < kPacket; ++i) {
    out.points.hit[i] = out.object[i] != kNoObject;
    if (!out.points.hit[i]) continue;
    lanes |= 1U << i;
    terrain.hit[i] = terrain.toward_moon[i] = rays.valid[i] = false;
  }
  if (lanes == 0) return 0;
  const int source = std::countr_zero(lanes);
  for (int i = 0; i < kPacket; ++i) {
    out.points.toward_moon[i] = false;
    if (lanes >> i & 1) continue;
    // Copy valid values to the other lanes: vector code computes all of them.
    SurfacePoints& p = out.points;
    p.x[i] = p.x[source];
    p.y[i] = p.y[source];
    p.z[i] = p.z[source];
    p.nx[i] = p.nx[source];
    p.ny[i] = p.ny[source];
    p.nz[i] = p.nz[source];
    p.v[i] = p.v[source];
    p.w[i] = p.w[source];
    p.distance[i] = p.distance[source];
    out.shading.mu0[i] = out.shading.incident[i] = out.shading.mu[i] = 0;
    out.shading.nx[i] = out.shading.nx[source];
    out.shading.ny[i] = out.shading.ny[source];
    out.shading.nz[i] = out.shading.nz[source];
  }
  return lanes;
}

// Intersects the rays that enter the ball of an object before their nearest hit. `nearest`: distance of each lane's
// nearest hit so far, in lengths of its ray's direction.
void ObjectsInFrame::intersect_object(const Placed& object, const Rays& rays, double* nearest, ObjectLanes& out) const {
  RayPacket packet;
  std::uint32_t active = 0;
  for (int i = 0; i < kPacket; ++i) {
    if (!rays.valid[i]) continue;
    const Vec3 origin = rays.origin(i), direction = rays.direction(i);
    const BallEntry entry = enter_ball(origin - object.ball.centre_m, direction, object.ball.radius_m);
    if (!entry.enters || entry.distance >= nearest[i]) continue;
    set_lane(packet, i, object.to_tracer(origin + entry.distance * direction), object.object_from_moon * direction);
    active |= 1U << i;
  }
  if (active == 0) return;
  fill_idle(packet, active);
  std::uint32_t triangle[kPacket];
  object.mesh->tracer().intersect(packet, triangle);
  for (int i = 0; i < kPacket; ++i)
    if (triangle[i] != ObjectTracer::kNone) store(object, triangle[i], rays, i, nearest, out);
}

// Stores the hit of lane i if it is nearer. Float found the triangle; the point is that of its plane in double. Points,
// normals and the direction are in the object's coordinates until `facet`.
void ObjectsInFrame::store(const Placed& object, std::uint32_t triangle, const Rays& rays, int i, double* nearest,
                           ObjectLanes& out) const {
  const ObjectShape& shape = object.mesh->shape();
  const ObjectTriangle& t = shape.triangles[triangle];
  const Vec3 a = shape.place(t, 0);
  const Vec3 ab = shape.place(t, 1) - a;
  const Vec3 ac = shape.place(t, 2) - a;
  const Vec3 normal = ab.cross(ac);
  const Vec3 direction = object.object_from_moon * rays.direction(i),
             origin_from_a = object.to_object(rays.origin(i)) - a;
  const double along_normal = normal.dot(direction);
  if (along_normal == 0) return;                                      // edge-on: nothing of it is visible
  const double distance = -normal.dot(origin_from_a) / along_normal;  // in lengths of the ray's direction
  if (!(distance > 0 && distance < nearest[i])) return;
  nearest[i] = distance;
  const Vec3 hit_from_a = origin_from_a + distance * direction;
  const double area2 = normal.squared_norm();
  const double v = normal.dot(hit_from_a.cross(ac)) / area2;
  const double w = normal.dot(ab.cross(hit_from_a)) / area2;
  const auto corner = [&](std::size_t k) -> Vec3 { return shape.corners[t.corner[k]].normal.cast<double>(); };
  const Vec3 smooth = (1 - v - w) * corner(0) + v * corner(1) + w * corner(2);

  const Vec3 facet = (object.normals * ((along_normal > 0 ? -1 : 1) * normal)).normalized();
  Vec3 shading = object.normals * smooth;
  if (shading.dot(facet) < 0) shading = -shading;  // the ray sees the back of a sheet
  const Vec3 view_direction = rays.direction(i).normalized();
  // Use the normal of the facet if the interpolated one faces away from the camera, as for terrain.
  shading = shading.dot(view_direction) < 0 ? Vec3(shading.normalized()) : facet;

  SurfacePoints& p = out.points;
  const Vec3 position = rays.origin(i) + distance * rays.direction(i);
  p.x[i] = position.x();
  p.y[i] = position.y();
  p.z[i] = position.z();
  p.nx[i] = facet.x();
  p.ny[i] = facet.y();
  p.nz[i] = facet.z();
  p.v[i] = p.w[i] = 1.0 / 3;  // never on an edge: shadows are not tested as on edges of terrain
  p.distance[i] = distance;
  p.hit[i] = true;
  out.shading.nx[i] = shading.x();
  out.shading.ny[i] = shading.y();
  out.shading.nz[i] = shading.z();
  out.shading.mu0[i] = out.shading.incident[i] = shading.dot(request_.sun.direction);
  out.shading.mu[i] = -shading.dot(view_direction);
  out.object[i] = object.number;
  out.part[i] = t.part;
  out.on_soil[i] = object.soil;
}

// Traces the points toward the Sun, against each object of the request and then against all rocks.
std::uint32_t ObjectsInFrame::blocked(const SurfacePoints& points, const std::uint16_t* own_object,
                                      std::uint32_t requested, const Vec3& sun) const {
  std::uint32_t blocked_lanes = 0;
  if (requested == 0) return 0;
  const std::size_t object_count = std::min(placed_.size(), first_rock_);
  const Ball from = object_count > 0 ? ball_around(points, requested) : Ball{};
  for (std::size_t k = 0; k < object_count && requested != 0; ++k) {
    const Placed& object = placed_[k];
    if (!may_block(from, sun, object.ball)) continue;
    RayPacket packet;
    std::uint32_t active = 0;
    for (int i = 0; i < kPacket; ++i) {
      if (!(requested >> i & 1)) continue;
      const Vec3 point = points.position(i);
      const BallEntry entry = enter_ball(point - object.ball.centre_m, sun, object.ball.radius_m);
      if (!entry.enters) continue;
      set_lane(packet, i, object.to_tracer(point + entry.distance * sun), object.object_from_moon * sun);
      // Skip the facet that the ray leaves. The flatter the ray, the farther its rounded start may be inside.
      if (own_object && own_object[i] == k)
        packet.near[i] = static_cast<float>(object.scale * object.mesh->rounding_at(object.to_object(point)) /
                                            std::max(1.0 / 64, points.facet_normal(i).dot(sun)));
      active |= 1U << i;
    }
    if (active == 0) continue;
    fill_idle(packet, active);
    bool hit[kPacket];
    object.mesh->tracer().occluded(packet, hit);
    for (int i = 0; i < kPacket; ++i)
      if (hit[i]) {
        blocked_lanes |= 1U << i;
        requested &= ~(1U << i);
      }
  }
  if (rocks_ && requested != 0) blocked_lanes |= blocked_by_rocks(points, own_object, requested, sun);
  return blocked_lanes;
}

// Intersects the rays whose cell of the image contains a rock.
void ObjectsInFrame::intersect_rocks(const Rays& rays, bool from_camera, double* nearest, ObjectLanes& out) const {
  const std::uint32_t candidates =
      in_image_ && from_camera ? in_image_->may_hit(rays.dx, rays.dy, rays.dz, kAllLanes) : kAllLanes;
  if (candidates == 0) return;
  RayPacket packet;
  std::uint32_t active = 0;
  for (int i = 0; i < kPacket; ++i) {
    if (!rays.valid[i] || !(candidates >> i & 1)) continue;
    Vec3 origin = rays.origin(i) - anchor_m_;
    // Start rays with other origins on the bounding sphere of the rocks: float would not resolve rocks from afar.
    if (!single_origin_ || !from_camera) {
      const BallEntry entry = enter_ball(origin, rays.direction(i), rocks_radius_m_);
      if (!entry.enters) continue;
      origin += entry.distance * rays.direction(i);
    }
    set_lane(packet, i, origin, rays.direction(i));
    active |= 1U << i;
  }
  if (active == 0) return;
  fill_idle(packet, active);
  std::uint32_t rock[kPacket], triangle[kPacket];
  rocks_->intersect(packet, rock, triangle);
  for (int i = 0; i < kPacket; ++i)
    if (rock[i] != ObjectGroup::kNone) store(placed_[first_rock_ + rock[i]], triangle[i], rays, i, nearest, out);
}

// Returns the requested lanes that a rock blocks. A ray from a rock starts beyond the rounding error of its own facet.
std::uint32_t ObjectsInFrame::blocked_by_rocks(const SurfacePoints& points, const std::uint16_t* own_object,
                                               std::uint32_t requested, const Vec3& sun) const {
  if (toward_sun_ && sun == request_.sun.direction)
    requested = toward_sun_->may_hit(points.x, points.y, points.z, requested);
  if (requested == 0) return 0;
  constexpr double kRelativeRounding = 0x1p-22;  // rounding of a coordinate relative to the anchor, with a margin
  RayPacket packet;
  for (int i = 0; i < kPacket; ++i) {
    if (!(requested >> i & 1)) continue;
    const Vec3 from = points.position(i) - anchor_m_;
    set_lane(packet, i, from, sun);
    if (own_object && is_rock(own_object[i])) {
      const Placed& rock = placed_[own_object[i]];
      const double rounding_m = rock.scale * rock.mesh->rounding_at(rock.to_object(points.position(i))) +
                                kRelativeRounding * (from.norm() + rock.scale);
      packet.near[i] = static_cast<float>(rounding_m / std::max(1.0 / 64, points.facet_normal(i).dot(sun)));
    }
  }
  fill_idle(packet, requested);
  bool hit[kPacket];
  rocks_->occluded(packet, hit);
  std::uint32_t blocked_lanes = 0;
  for (int i = 0; i < kPacket; ++i)
    if (hit[i]) blocked_lanes |= 1U << i;
  return blocked_lanes;
}

void ObjectsInFrame::radiances(const ObjectLanes& lanes, const Rays& rays, const float* lit,
                               const TerrainLight* indirect, float* out, float* base) const {
  for (int i = 0; i < kPacket; ++i) {
    if (!lanes.points.hit[i]) continue;
    const PartShading& part_shading = (*placed_[lanes.object[i]].part_shadings)[lanes.part[i]];
    const Vec3 direction = rays.direction(i);
    const double cos_phase = -direction.dot(request_.sun.direction) / direction.norm();
    base[i] = part_shading.base;
    if (indirect) {
      // Indirect light comes from all sides: evaluate the reflectance for light from halfway up.
      constexpr double kHalfway = 0.5;
      const Irradiance light =
          indirect->on_objects(lanes.points.position(i), lanes.object[i]).on(lanes.shading.normal(i));
      base[i] += static_cast<float>((light.terrain_w_m2 + light.earth_w_m2) *
                                    part_shading.brdf(kHalfway, std::max(lanes.shading.mu[i], 0.0), 0));
    }
    const double direct = direct_radiance(part_shading.brdf, part_shading.direct_w_m2, lanes.shading.incident[i],
                                          lanes.shading.mu[i], cos_phase, static_cast<double>(lit[i]));
    out[i] = base[i] + static_cast<float>(brightness_of(lanes, i) * direct);
  }
}

void ObjectsInFrame::reflected_back(const ObjectLanes& lanes, double* out) const {
  for (int i = 0; i < kPacket; ++i) {
    if (!lanes.points.hit[i]) continue;
    const PartShading& part_shading = (*placed_[lanes.object[i]].part_shadings)[lanes.part[i]];
    const double mu = lanes.shading.mu[i];
    out[i] = mu > 0 ? brightness_of(lanes, i) * part_shading.brdf.times_mu0(mu, mu, 1) : 0;
  }
}

}  // namespace selenograph::engine
