#include "engine/render_pass.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <mutex>
#include <numbers>

#include "dem/error.h"
#include "dem/parallel.h"
#include "engine/photometry.h"
#include "engine/trace.h"
#include "engine/vectorise.h"

namespace selenograph::engine {
namespace {

constexpr int kTile = 32;  // pixels; a tile is one task
constexpr int kPacketSide = 4;
static_assert(kPacketSide * kPacketSide == kPacket);

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
  allocate(out.source, want & kSource, n, std::uint16_t{65535});
}

// Shading's view of a packet, per lane.
struct alignas(64) Shading {
  double nx[kPacket], ny[kPacket],
      nz[kPacket];                   // unit smooth normal: vertex normals weighted by the place in the triangle
  double mu0[kPacket], mu[kPacket];  // cosines of incidence and emission
  Vec3 normal(int i) const { return {nx[i], ny[i], nz[i]}; }
};

struct alignas(64) VertexNormals {
  double a[3][kPacket], b[3][kPacket], c[3][kPacket];
};

VertexNormals gather_normals(const Mesh& mesh, const SurfacePoints& p) {
  VertexNormals n;
  for (int i = 0; i < kPacket; ++i) {
    if (!p.hit[i]) {
      for (int k = 0; k < 3; ++k) n.a[k][i] = n.b[k][i] = n.c[k][i] = 0;
      continue;
    }
    const MeshBlock& block = mesh.blocks()[p.triangle[i].block];
    const dem::QuadVertices q = dem::vertices_of(p.triangle[i].r, p.triangle[i].c, p.triangle[i].upper);
    const Eigen::Vector3f &a = block.normal(q.r[0], q.c[0]), &b = block.normal(q.r[1], q.c[1]),
                          &c = block.normal(q.r[2], q.c[2]);
    for (int k = 0; k < 3; ++k)
      n.a[k][i] = static_cast<double>(a[k]), n.b[k][i] = static_cast<double>(b[k]),
      n.c[k][i] = static_cast<double>(c[k]);
  }
  return n;
}

SELENOGRAPH_VECTORISED
void shade(const VertexNormals& n, const SurfacePoints& p, const Rays& rays, double sx, double sy, double sz,
           Shading& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double v = p.v[i], w = p.w[i], u = 1 - v - w;
    const double smooth_x = u * n.a[0][i] + v * n.b[0][i] + w * n.c[0][i];
    const double smooth_y = u * n.a[1][i] + v * n.b[1][i] + w * n.c[1][i];
    const double smooth_z = u * n.a[2][i] + v * n.b[2][i] + w * n.c[2][i];
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
void radiances(const BrdfTerms& terms, double irradiance, const Shading& shading, const float* lit, float* out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i)
    out[i] = static_cast<float>(
        direct_radiance(terms, irradiance, shading.mu0[i], shading.mu[i], static_cast<double>(lit[i])));
}

// Rays of 4 x 4 pixels of a camera without distortion: linear in the pixel's coordinates.
SELENOGRAPH_VECTORISED
void linear_rays(const double* first, const double* right, const double* down, const double* origin, double x, double y,
                 Rays& rays) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double px = x + (i & 3), py = y + (i >> 2);
    rays.ox[i] = origin[0], rays.oy[i] = origin[1], rays.oz[i] = origin[2];
    rays.dx[i] = first[0] + right[0] * px + down[0] * py;
    rays.dy[i] = first[1] + right[1] * px + down[1] * py;
    rays.dz[i] = first[2] + right[2] * px + down[2] * py;
  }
}

struct SourceAt {
  dem::SourceMark index;  // of the catalogue; dem::kNoSource if none
  bool filled;
};

// The tile of the nearest vertex; filled when any vertex of the triangle is.
SourceAt source_at(const Mesh& mesh, const SurfacePoints& p, int lane) {
  const TriangleId& t = p.triangle[lane];
  const dem::Block& block = *mesh.blocks()[t.block].posts;
  if (block.sources.size() == 1) return {block.sources[0] & dem::kNoSource, (block.sources[0] & dem::kFilledBit) != 0};
  const dem::QuadVertices q = dem::vertices_of(t.r, t.c, t.upper);
  const double weights[3] = {1 - p.v[lane] - p.w[lane], p.v[lane], p.w[lane]};
  SourceAt at{dem::kNoSource, false};
  double heaviest = -1;
  for (int i = 0; i < 3; ++i) {
    const dem::SourceMark s = block.source(q.r[i], q.c[i]);
    at.filled |= (s & dem::kFilledBit) != 0;
    if (weights[i] > heaviest) heaviest = weights[i], at.index = s & dem::kNoSource;
  }
  return at;
}

double angle_deg(double cosine) { return std::acos(std::clamp(cosine, -1.0, 1.0)) * kDegrees; }

class Pass {
 public:
  Pass(const Scene& scene, const View& view, const FrameRequest& request, std::size_t catalogue_size,
       const StopToken& stop, FrameProducts& out)
      : scene_(scene),
        view_(view),
        request_(request),
        stop_(stop),
        out_(out),
        irradiance_(kSolarConstant_w_m2 / (request.sun.distance_au * request.sun.distance_au)),
        terms_(terms_of(request.reflectance)),
        catalogue_size_(catalogue_size) {
    const ProductSet want = request.products;
    wants_radiance_ = want & (kRadiance | kImage);
    wants_geometry_ = want & ~static_cast<ProductSet>(kRadiance | kImage);
    wants_light_ = wants_radiance_ || (want & kLit);
    grid_ = static_cast<int>(std::lround(std::sqrt(request.accuracy.samples_per_pixel)));
    total_.sources.assign(catalogue_size, 0);
    // Without distortion a pixel's ray is linear in its coordinates.
    const Camera& c = view.camera();
    linear_ = c.distortion.none();
    const Eigen::Matrix3d& m = view.moon_from_camera();
    right_ = m.col(0) / c.fx, down_ = m.col(1) / c.fy, first_ = m.col(2) - right_ * c.cx - down_ * c.cy;
  }

  PassCounts run() {
    const int across = (request_.camera.width + kTile - 1) / kTile,
              along = (request_.camera.height + kTile - 1) / kTile;
    in_parallel_pieces(static_cast<std::size_t>(across * along), 1, [&](std::size_t first, std::size_t past_last) {
      PassCounts counts;
      counts.sources.assign(catalogue_size_, 0);
      for (int tile = static_cast<int>(first); tile < static_cast<int>(past_last); ++tile) {
        if (stop_.stopped()) throw Cancelled();
        render_tile(tile % across * kTile, tile / across * kTile, counts);
      }
      merge(counts);
    });
    return std::move(total_);
  }

 private:
  void render_tile(int x0, int y0, PassCounts& counts) {
    for (int y = y0; y < std::min(y0 + kTile, request_.camera.height); y += kPacketSide)
      for (int x = x0; x < std::min(x0 + kTile, request_.camera.width); x += kPacketSide) {
        if (grid_ == 1) {
          render_packet(x, y, 0, 0, true, wants_radiance_ ? 1.F : 0.F, &counts);
          continue;
        }
        if (wants_geometry_) render_packet(x, y, 0, 0, true, 0.F, &counts);
        if (!wants_radiance_) continue;
        const float weight = 1.F / static_cast<float>(grid_ * grid_);
        for (int j = 0; j < grid_; ++j)
          for (int i = 0; i < grid_; ++i)
            render_packet(x, y, (i + 0.5) / grid_ - 0.5, (j + 0.5) / grid_ - 0.5, false, weight,
                          wants_geometry_ || i + j > 0 ? nullptr : &counts);
      }
  }

  void aim(int x, int y, double dx, double dy, Rays& rays) const {
    if (linear_) linear_rays(first_.data(), right_.data(), down_.data(), view_.position().data(), x + dx, y + dy, rays);
    for (int i = 0; i < kPacket; ++i) {
      const int px = x + i % kPacketSide, py = y + i / kPacketSide;
      rays.valid[i] = px < request_.camera.width && py < request_.camera.height;
      if (linear_) continue;
      const auto direction = rays.valid[i] ? view_.ray(px + dx, py + dy) : std::nullopt;
      rays.set(i, view_.position(), direction.value_or(Vec3::UnitX()));
      rays.valid[i] = direction.has_value();
    }
  }

  // 4 x 4 pixels from (x, y), each at an offset from its centre: geometry is stored if asked for, radiance added with a
  // weight.
  void render_packet(int x, int y, double dx, double dy, bool store, float weight, PassCounts* counts) {
    if (weight > 0)  // memory fetches the rows while rays are traced
      for (int row = y; row < std::min(y + kPacketSide, request_.camera.height); ++row)
        __builtin_prefetch(
            &out_.radiance[static_cast<std::size_t>(row) * static_cast<std::size_t>(request_.camera.width) +
                           static_cast<std::size_t>(x)],
            1);
    Rays rays;
    aim(x, y, dx, dy, rays);
    SurfacePoints points;
    trace(scene_, rays, points);
    if (std::find(points.hit, points.hit + kPacket, true) == points.hit + kPacket) {
      if (counts)
        counts->missing +=
            static_cast<std::uint64_t>(std::count(points.toward_moon, points.toward_moon + kPacket, true));
      return;
    }
    Shading shading;
    const Vec3& sun = request_.sun.direction;
    shade(gather_normals(scene_.mesh, points), points, rays, sun.x(), sun.y(), sun.z(), shading);
    float lit[kPacket] = {}, radiance[kPacket];
    if (wants_light_) light(points, shading, lit);
    if (weight > 0) radiances(terms_, irradiance_, shading, lit, radiance);
    for (int i = 0; i < kPacket; ++i) {
      if (counts && points.toward_moon[i]) ++counts->missing;
      if (!points.hit[i]) continue;
      const std::size_t at =
          static_cast<std::size_t>(y + i / kPacketSide) * static_cast<std::size_t>(request_.camera.width) +
          static_cast<std::size_t>(x + i % kPacketSide);
      if (weight > 0) out_.radiance[at] += weight * radiance[i];
      if (counts || store) account(points, i, at, counts);
      if (store && wants_geometry_) store_geometry(points, i, rays.direction(i), shading, lit[i], at);
    }
  }

  void light(const SurfacePoints& points, const Shading& shading, float* lit) const {
    bool wanted[kPacket];
    for (int i = 0; i < kPacket; ++i) wanted[i] = points.hit[i] && shading.mu0[i] > 0;
    if (request_.sun.angular_radius_deg > 0)
      sunlit_disc(scene_, points, wanted, request_.sun.direction, request_.sun.angular_radius_deg / kDegrees, lit);
    else
      sunlit(scene_, points, wanted, request_.sun.direction, lit);
  }

  void account(const SurfacePoints& points, int i, std::size_t at, PassCounts* counts) {
    const SourceAt source = source_at(scene_.mesh, points, i);
    const bool known = source.index != dem::kNoSource;
    if (!out_.source.empty() && known) out_.source[at] = static_cast<std::uint16_t>(source.index);
    if (!counts) return;
    ++counts->hit;
    counts->filled += source.filled;
    if (known) counts->sources[source.index] = 1;
  }

  void store_geometry(const SurfacePoints& p, int i, const Vec3& direction, const Shading& shading, float lit,
                      std::size_t at) {
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
    if (!out_.gsd.empty())
      out_.gsd[at] = static_cast<float>(dem::post_spacing_m(scene_.mesh.blocks()[p.triangle[i].block].posts->id.level));
  }

  void merge(const PassCounts& counts) {
    std::lock_guard lock(mutex_);
    total_.hit += counts.hit, total_.missing += counts.missing, total_.filled += counts.filled;
    for (std::size_t i = 0; i < counts.sources.size(); ++i)
      if (counts.sources[i]) total_.sources[i] = 1;
  }

  const Scene& scene_;
  const View& view_;
  const FrameRequest& request_;
  const StopToken& stop_;
  FrameProducts& out_;
  double irradiance_;
  BrdfTerms terms_;
  std::size_t catalogue_size_;
  bool wants_radiance_, wants_geometry_, wants_light_, linear_;
  int grid_;
  Vec3 first_, right_, down_;
  std::mutex mutex_;
  PassCounts total_;
};

}  // namespace

PassCounts render_pixels(const Scene& scene, const View& view, const FrameRequest& request, std::size_t catalogue_size,
                         const StopToken& stop, FrameProducts& products) {
  allocate_all(request, products);
  return Pass(scene, view, request, catalogue_size, stop, products).run();
}

}  // namespace selenograph::engine
