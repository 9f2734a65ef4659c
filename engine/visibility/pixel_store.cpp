#include "engine/visibility/pixel_store.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "engine/support/vectorise.h"
#include "engine/visibility/objects_in_frame.h"

namespace selenograph::engine {
namespace {

constexpr float kNaN32 = std::numeric_limits<float>::quiet_NaN();
constexpr double kNaN64 = std::numeric_limits<double>::quiet_NaN();
constexpr double kDegrees = 180 / std::numbers::pi;

template <typename T>
void allocate(std::vector<T>& array, bool wanted, std::size_t size, T value) {
  if (wanted) array.assign(size, value);
}

void allocate_all(const FrameRequest& request, FrameProducts& out) {
  const std::size_t n =
      static_cast<std::size_t>(request.camera.width) * static_cast<std::size_t>(request.camera.height);
  const ProductSet want = request.products;
  allocate(out.radiance, want & (kRadiance | kImage), n, 0.F);
  allocate(out.depth, want & kDepth, n, kNaN64);
  allocate(out.range, want & kRange, n, kNaN64);
  allocate(out.position, want & kPosition, 3 * n, kNaN64);
  allocate(out.geodetic, want & kGeodetic, 3 * n, kNaN64);
  allocate(out.normal, want & kNormal, 3 * n, kNaN32);
  allocate(out.angles, want & kAngles, 3 * n, kNaN32);
  allocate(out.lit, want & kLit, n, kNaN32);
  allocate(out.gsd, want & kGsd, n, kNaN32);
  allocate(out.source, want & kSource, n, FrameSources::kNone);
  allocate(out.object_id, want & kObjectId, n, kNoObject);
}

SELENOGRAPH_VECTORISED
void shade_lanes(const Facets& n, const SurfacePoints& p, const Rays& rays, double sx, double sy, double sz,
                 Shading& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double v = p.v[i], w = p.w[i], u = 1 - v - w;
    const double smooth_x = u * static_cast<double>(n.normal_a[0][i]) + v * static_cast<double>(n.normal_b[0][i]) +
                            w * static_cast<double>(n.normal_c[0][i]);
    const double smooth_y = u * static_cast<double>(n.normal_a[1][i]) + v * static_cast<double>(n.normal_b[1][i]) +
                            w * static_cast<double>(n.normal_c[1][i]);
    const double smooth_z = u * static_cast<double>(n.normal_a[2][i]) + v * static_cast<double>(n.normal_b[2][i]) +
                            w * static_cast<double>(n.normal_c[2][i]);
    // What is seen faces the camera. Where the smooth normal doesn't, the facet's own does: otherwise slopes seen at
    // grazing angles had black specks at opposition.
    const bool away = smooth_x * rays.dx[i] + smooth_y * rays.dy[i] + smooth_z * rays.dz[i] >= 0;
    const double x = away ? p.nx[i] : smooth_x, y = away ? p.ny[i] : smooth_y, z = away ? p.nz[i] : smooth_z;
    const double dx = rays.dx[i], dy = rays.dy[i], dz = rays.dz[i];
    const double unit = 1 / std::sqrt(x * x + y * y + z * z), back = -1 / std::sqrt(dx * dx + dy * dy + dz * dz);
    out.nx[i] = x * unit, out.ny[i] = y * unit, out.nz[i] = z * unit;
    out.mu0[i] = (x * sx + y * sy + z * sz) * unit;
    out.mu[i] = (x * dx + y * dy + z * dz) * unit * back;
  }
}

SELENOGRAPH_VECTORISED
void radiances_of(const BrdfTerms& terms, double irradiance, const Shading& shading, const float* lit, float* out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i)
    out[i] = static_cast<float>(
        direct_radiance(terms, irradiance, shading.mu0[i], shading.mu[i], static_cast<double>(lit[i])));
}

constexpr int across(Shape shape) { return shape == Shape::square ? kPacketSide : kPacket; }

// Rays of a camera without distortion: linear in the pixel's coordinates.
template <Shape shape>
SELENOGRAPH_VECTORISED void linear_rays(const double* first, const double* right, const double* down,
                                        const double* origin, double x, double y, Rays& rays) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const int column = i % across(shape), row = i / across(shape);
    const double px = x + column, py = y + row;
    rays.ox[i] = origin[0], rays.oy[i] = origin[1], rays.oz[i] = origin[2];
    rays.dx[i] = first[0] + right[0] * px + down[0] * py;
    rays.dy[i] = first[1] + right[1] * px + down[1] * py;
    rays.dz[i] = first[2] + right[2] * px + down[2] * py;
  }
}

// The same from places on the camera's plane z = 1; `m`: MOON_ME from camera, by columns.
SELENOGRAPH_VECTORISED
void lens_rays(const double* x, const double* y, const double* m, const double* origin, Rays& rays) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    rays.ox[i] = origin[0], rays.oy[i] = origin[1], rays.oz[i] = origin[2];
    rays.dx[i] = m[0] * x[i] + m[3] * y[i] + m[6];
    rays.dy[i] = m[1] * x[i] + m[4] * y[i] + m[7];
    rays.dz[i] = m[2] * x[i] + m[5] * y[i] + m[8];
  }
}

struct SourceAt {
  dem::SourceIndex index;  // dem::kNoSource if none
  bool filled;
};

// The tile of the nearest vertex; filled when any vertex of the triangle is.
SourceAt source_at(const Mesh& mesh, const SurfacePoints& p, int lane) {
  const TriangleId& t = p.triangle[lane];
  const dem::Block& block = *mesh.blocks()[t.block()].posts;
  if (block.sources.size() == 1) return {dem::source_of(block.sources[0]), dem::is_filled(block.sources[0])};
  const dem::QuadVertices q = t.vertices();
  const double weights[3] = {1 - p.v[lane] - p.w[lane], p.v[lane], p.w[lane]};
  SourceAt at{dem::kNoSource, false};
  double heaviest = -1;
  for (int i = 0; i < 3; ++i) {
    const dem::SourceMark s = block.source(q.r[i], q.c[i]);
    at.filled |= dem::is_filled(s);
    if (weights[i] > heaviest) heaviest = weights[i], at.index = dem::source_of(s);
  }
  return at;
}

double angle_deg(double cosine) { return std::acos(std::clamp(cosine, -1.0, 1.0)) * kDegrees; }

}  // namespace

PixelStore::PixelStore(const Mesh& mesh, const View& view, const FrameRequest& request, const RadianceTerms& radiance,
                       const PixelRays& rays, FrameSources& sources, FrameProducts& out)
    : mesh_(mesh),
      view_(view),
      request_(request),
      centres_(rays),
      sources_(sources),
      out_(out),
      irradiance_(radiance.direct_w_m2),
      base_(static_cast<float>(radiance.base_w_m2_sr())),
      brdf_(request.reflectance) {
  const ProductSet want = request.products;
  wants_radiance_ = want & (kRadiance | kImage);
  if (wants_radiance_ && !(request.albedo_maps.empty() && request.temperature_maps.empty()))
    mapped_.emplace(request, view);
  wants_geometry_ = want & ~static_cast<ProductSet>(kRadiance | kImage);
  wants_light_ = wants_radiance_ || (want & kLit);
  grid_ = static_cast<int>(std::lround(std::sqrt(request.accuracy.samples_per_pixel)));
  // Without distortion a pixel's ray is linear in its coordinates.
  const Camera& c = view.camera();
  linear_ = c.distortion.none();
  const Eigen::Matrix3d& m = view.moon_from_camera();
  right_ = m.col(0) / c.fx, down_ = m.col(1) / c.fy, first_ = m.col(2) - right_ * c.cx - down_ * c.cy;
  allocate_all(request, out);
}

std::vector<Layer> PixelStore::layers() const {
  if (grid_ == 1) return {{0, 0, true, wants_radiance_ ? 1.F : 0.F, wants_light_, true}};
  std::vector<Layer> layers;
  if (wants_geometry_) layers.push_back({0, 0, true, 0.F, (request_.products & kLit) != 0, true});
  if (!wants_radiance_) return layers;
  const float weight = 1.F / static_cast<float>(grid_ * grid_);
  for (int j = 0; j < grid_; ++j)
    for (int i = 0; i < grid_; ++i)
      layers.push_back({(i + 0.5) / grid_ - 0.5, (j + 0.5) / grid_ - 0.5, false, weight, true, layers.empty()});
  return layers;
}

template <Shape shape>
void PixelStore::aim_shape(int x, int y, const Layer& layer, const PixelRays* rays, Rays& out) const {
  constexpr int kAcross = across(shape);
  const Camera& camera = request_.camera;
  if (x + kAcross <= camera.width && y + kPacket / kAcross <= camera.height)
    std::fill_n(out.valid, kPacket, true);
  else
    for (int i = 0; i < kPacket; ++i) out.valid[i] = x + i % kAcross < camera.width && y + i / kAcross < camera.height;
  if (linear_) {
    linear_rays<shape>(first_.data(), right_.data(), down_.data(), view_.position().data(), x + layer.dx, y + layer.dy,
                       out);
    return;
  }
  alignas(64) double px[kPacket], py[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    px[i] = py[i] = 0;
    if (!out.valid[i]) continue;
    const int column = x + i % kAcross, row = y + i / kAcross;
    if (rays) {
      const std::size_t at =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(column);
      px[i] = rays->x[at], py[i] = rays->y[at];
    } else if (const auto p = view_.undistorted(column + layer.dx, row + layer.dy)) {
      px[i] = p->x(), py[i] = p->y();
    } else {
      px[i] = kNaN64;
    }
    out.valid[i] = !std::isnan(px[i]);
    if (!out.valid[i]) px[i] = py[i] = 0;
  }
  lens_rays(px, py, view_.moon_from_camera().data(), view_.position().data(), out);
}

void PixelStore::aim(Shape shape, int x, int y, const Layer& layer, const PixelRays* rays, Rays& out) const {
  if (shape == Shape::row)
    aim_shape<Shape::row>(x, y, layer, rays, out);
  else
    aim_shape<Shape::square>(x, y, layer, rays, out);
}

void PixelStore::shade(const Facets& facets, const SurfacePoints& points, const Rays& rays, Shading& out) const {
  const Vec3& sun = request_.sun.direction;
  shade_lanes(facets, points, rays, sun.x(), sun.y(), sun.z(), out);
}

void PixelStore::radiances(const SurfacePoints& points, const Shading& shading, const Rays& rays, const float* lit,
                           Sampler& sampler, float* out, float* base) const {
  if (mapped_) return mapped_->radiances(points, shading, rays, lit, sampler, out, base);
  if (const BrdfTerms* terms = brdf_.terms()) {
    radiances_of(*terms, irradiance_, shading, lit, out);
  } else {
    for (int i = 0; i < kPacket; ++i) out[i] = lit[i] > 0 ? direct(shading, rays.direction(i), lit[i], i) : 0;
  }
  if (base_ == 0) return;
  for (int i = 0; i < kPacket; ++i) out[i] += base_;  // eq. (1)
}

float PixelStore::direct(const Shading& shading, const Vec3& direction, float lit, int i) const {
  const double cos_phase = -direction.dot(request_.sun.direction) / direction.norm();
  return static_cast<float>(
      direct_radiance(brdf_, irradiance_, shading.mu0[i], shading.mu[i], cos_phase, static_cast<double>(lit)));
}

std::uint32_t PixelStore::account_all(const SurfacePoints& points, std::uint32_t hits, PassCounts* counts) const {
  const auto add = [&](const MeshBlock& block, std::uint64_t lanes) {
    counts->hit += lanes;
    if (dem::is_filled(block.source)) counts->filled += lanes;
    if (const dem::SourceIndex index = dem::source_of(block.source); index != dem::kNoSource) sources_.number(index);
  };
  // Most packets are in one block of one source.
  constexpr std::uint32_t kAll = 0xffff;
  const MeshBlock& first = mesh_.blocks()[points.triangle[0].block()];
  if (hits == kAll && first.mixed.empty() && in_one_block(points.triangle)) {
    add(first, kPacket);
    return 0;
  }
  std::uint32_t left = 0;
  for (int i = 0; i < kPacket; ++i) {
    if (!(hits >> i & 1)) continue;
    const TriangleId id = points.triangle[i];
    const MeshBlock& block = mesh_.blocks()[id.block()];
    if (!block.mixed.empty() && block.mixed[static_cast<std::size_t>(id.r())] >> id.c() & 1)
      left |= 1U << i;
    else
      add(block, 1);
  }
  return left;
}

void PixelStore::account(const SurfacePoints& points, int i, std::size_t at, PassCounts* counts) const {
  const SourceAt source = source_at(mesh_, points, i);
  const bool known = source.index != dem::kNoSource;
  if (!out_.source.empty() && known) out_.source[at] = sources_.product_number(source.index);
  if (!counts) return;
  ++counts->hit;
  counts->filled += source.filled;
  if (known) sources_.number(source.index);
}

void PixelStore::store_geometry(const SurfacePoints& p, int i, const Vec3& direction, const Shading& shading, float lit,
                                std::size_t at) const {
  const auto spacing_m = static_cast<float>(dem::post_spacing_m(mesh_.blocks()[p.triangle[i].block()].posts->id.level));
  store_point(p, i, direction, shading, lit, spacing_m, at);
}

void PixelStore::store_objects(const ObjectsInFrame& objects, const ObjectLanes& lanes, const Rays& rays,
                               const float* lit, Shape shape, int x, int y, const Layer& layer, const Target& target,
                               PassCounts* counts) const {
  float radiance[kPacket], base[kPacket];
  if (target.weight > 0) objects.radiances(lanes, rays, lit, radiance, base);
  for (int i = 0; i < kPacket; ++i) {
    if (!lanes.points.hit[i]) continue;
    const std::size_t at =
        static_cast<std::size_t>(y + i / across(shape)) * static_cast<std::size_t>(request_.camera.width) +
        static_cast<std::size_t>(x + i % across(shape));
    if (target.weight > 0) {
      target.radiance[at] += target.weight * radiance[i];
      if (target.bases) (*target.bases)[at] = base[i];
    }
    if (counts) ++counts->hit, ++counts->on_object;
    if (!layer.store) continue;
    if (!out_.object_id.empty()) out_.object_id[at] = lanes.object[i];
    if (wants_geometry_) store_point(lanes.points, i, rays.direction(i), lanes.shading, lit[i], kNaN32, at);
  }
}

void PixelStore::store_point(const SurfacePoints& p, int i, const Vec3& direction, const Shading& shading, float lit,
                             float spacing_m, std::size_t at) const {
  const double length = direction.norm();
  const Vec3 position = p.position(i), normal = shading.normal(i);
  if (!out_.depth.empty()) out_.depth[at] = p.distance[i];  // the direction's component along the boresight is 1
  if (!out_.range.empty()) out_.range[at] = p.distance[i] * length;
  if (!out_.position.empty()) std::copy_n(position.data(), 3, &out_.position[3 * at]);
  if (!out_.geodetic.empty()) {
    const Geographic g = to_geographic(position);
    out_.geodetic[3 * at] = g.lat_deg, out_.geodetic[3 * at + 1] = g.lon_deg, out_.geodetic[3 * at + 2] = g.height_m;
  }
  if (!out_.normal.empty())
    for (int k = 0; k < 3; ++k) out_.normal[3 * at + static_cast<std::size_t>(k)] = static_cast<float>(normal[k]);
  if (!out_.angles.empty()) {
    const Vec3 to_camera = -direction / length;
    out_.angles[3 * at] = static_cast<float>(angle_deg(shading.mu0[i]));
    out_.angles[3 * at + 1] = static_cast<float>(angle_deg(shading.mu[i]));
    out_.angles[3 * at + 2] = static_cast<float>(angle_deg(to_camera.dot(request_.sun.direction)));
  }
  if (!out_.lit.empty()) out_.lit[at] = lit;
  if (!out_.gsd.empty()) out_.gsd[at] = spacing_m;
}

void PixelStore::merge(const PassCounts& counts) {
  std::lock_guard lock(mutex_);
  total_.draw_ms += counts.draw_ms, total_.resolve_ms += counts.resolve_ms, total_.shadow_ms += counts.shadow_ms;
  total_.hit += counts.hit, total_.missing += counts.missing, total_.filled += counts.filled;
  total_.on_object += counts.on_object;
}

}  // namespace selenograph::engine
