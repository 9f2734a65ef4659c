#include "engine/render_pass.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <mutex>
#include <numbers>

#include "dem/error.h"
#include "dem/parallel.h"
#include "engine/photometry.h"
#include "engine/raster_kernels.h"
#include "engine/shadow_map.h"
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

SELENOGRAPH_VECTORISED
void shade(const Facets& n, const SurfacePoints& p, const Rays& rays, double sx, double sy, double sz,
           Shading& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double v = p.v[i], w = p.w[i], u = 1 - v - w;
    const double smooth_x = u * static_cast<double>(n.normal_a[0][i]) + v * static_cast<double>(n.normal_b[0][i]) + w * static_cast<double>(n.normal_c[0][i]);
    const double smooth_y = u * static_cast<double>(n.normal_a[1][i]) + v * static_cast<double>(n.normal_b[1][i]) + w * static_cast<double>(n.normal_c[1][i]);
    const double smooth_z = u * static_cast<double>(n.normal_a[2][i]) + v * static_cast<double>(n.normal_b[2][i]) + w * static_cast<double>(n.normal_c[2][i]);
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

// How sixteen pixels lie together: rays that are traced are bundled best in a square, pixels drawn lie in a row.
enum class Shape { square, row };
constexpr int across(Shape shape) { return shape == Shape::square ? kPacketSide : kPacket; }

// Rays of a camera without distortion: linear in the pixel's coordinates.
template <Shape shape>
SELENOGRAPH_VECTORISED void linear_rays(const double* first, const double* right, const double* down,
                                        const double* origin, double x, double y, Rays& rays) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double px = x + i % across(shape), py = y + i / across(shape);
    rays.ox[i] = origin[0], rays.oy[i] = origin[1], rays.oz[i] = origin[2];
    rays.dx[i] = first[0] + right[0] * px + down[0] * py;
    rays.dy[i] = first[1] + right[1] * px + down[1] * py;
    rays.dz[i] = first[2] + right[2] * px + down[2] * py;
  }
}

SELENOGRAPH_VECTORISED
void lit_lanes(const bool* hit, const Shading& shading, const std::int32_t* facing, float* lit) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) lit[i] = hit[i] && facing[i] && shading.mu0[i] > 0 ? 1.F : 0.F;
}

// Whether all lanes are lit, and none lies within a share `edge` of its triangle's edges.
SELENOGRAPH_VECTORISED
bool none_at_edges(const SurfacePoints& p, const float* lit, double edge) {
  int some = 0;
  for (int i = 0; i < kPacket; ++i)
    some |= (lit[i] > 0 ? 0 : 1) | (p.v[i] <= edge ? 1 : 0) | (p.w[i] <= edge ? 1 : 0) |
            (1 - p.v[i] - p.w[i] <= edge ? 1 : 0);
  return some == 0;
}

struct SourceAt {
  dem::SourceMark index;  // of the catalogue; dem::kNoSource if none
  bool filled;
};

// The tile of the nearest vertex; filled when any vertex of the triangle is.
SourceAt source_at(const Mesh& mesh, const SurfacePoints& p, int lane) {
  const TriangleId& t = p.triangle[lane];
  const dem::Block& block = *mesh.blocks()[t.block()].posts;
  if (block.sources.size() == 1) return {block.sources[0] & dem::kNoSource, (block.sources[0] & dem::kFilledBit) != 0};
  const dem::QuadVertices q = t.vertices();
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

// Scratch memory between frames: as many as frames have been drawn at once.
template <typename Scratch>
class Pool {
 public:
  std::unique_ptr<Scratch> take() {
    std::lock_guard lock(mutex_);
    if (free_.empty()) return std::make_unique<Scratch>();
    auto one = std::move(free_.back());
    free_.pop_back();
    return one;
  }
  void give(std::unique_ptr<Scratch> one) {
    std::lock_guard lock(mutex_);
    free_.push_back(std::move(one));
  }

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<Scratch>> free_;
};

Pool<LightScratch>& light_scratch() {
  static Pool<LightScratch> pool;
  return pool;
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
    if (scene_.raster) {
      run_raster();
      return std::move(total_);
    }
    const int across = (request_.camera.width + kTile - 1) / kTile,
              along = (request_.camera.height + kTile - 1) / kTile;
    const std::vector<Layer> all = layers();
    in_parallel_pieces(static_cast<std::size_t>(across * along), 1, [&](std::size_t first, std::size_t past_last) {
      PassCounts counts;
      counts.sources.assign(catalogue_size_, 0);
      for (int tile = static_cast<int>(first); tile < static_cast<int>(past_last); ++tile) {
        if (stop_.stopped()) throw Cancelled();
        render_tile(tile % across * kTile, tile / across * kTile, all, counts);
      }
      merge(counts);
    });
    return std::move(total_);
  }

 private:
  // A sub-pixel sample of every pixel, at an offset from its centre: geometry is stored if asked for, radiance added
  // with a weight, light looked for where either wants it, hits counted once.
  struct Layer {
    double dx, dy;
    bool store;
    float weight;
    bool light, count;
  };

  std::vector<Layer> layers() const {
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

  void render_tile(int x0, int y0, const std::vector<Layer>& layers, PassCounts& counts) {
    for (int y = y0; y < std::min(y0 + kTile, request_.camera.height); y += kPacketSide)
      for (int x = x0; x < std::min(x0 + kTile, request_.camera.width); x += kPacketSide)
        for (const Layer& layer : layers) render_packet(x, y, layer, layer.count ? &counts : nullptr);
  }

  // ---- z-buffer and shadow map ----------------------------------------------------------------------------------

  // Where a strip may be in the image, in pixels; empty when it can't be in view. `wide`: not all of its vertices
  // are plain in every tile.
  struct StripBox {
    int x0 = 1, x1 = 0, y0 = 1, y1 = 0;
    bool wide = false;
  };

  static constexpr int kWide = 128, kHigh = 64;  // pixels of a tile

  static constexpr float kNear_m = 0.01F;
  static constexpr double kFar_m = 500e3;

  TileView tile_view(double x0, double y0, int width, int height) const {
    TileView t{};
    const Camera& c = view_.camera();
    const Eigen::Matrix3d m = view_.moon_from_camera().transpose();
    const Vec3 eye = view_.position() - scene_.anchor;
    const bool far = eye.norm() > kFar_m;
    const Vec3 rows[3] = {m.row(0).transpose() * c.fx + m.row(2).transpose() * (c.cx - x0),
                          m.row(1).transpose() * c.fy + m.row(2).transpose() * (c.cy - y0), m.row(2).transpose()};
    Vec3 pivot = Vec3::Zero();
    for (int k = 0; k < 3; ++k) {
      if (!far) pivot[k] = static_cast<double>(static_cast<float>(eye[k]));
      t.pivot[k] = static_cast<float>(pivot[k]);
      for (int i = 0; i < 3; ++i) t.row[k][i] = static_cast<float>(rows[k][i]);
    }
    for (int k = 0; k < 3; ++k) t.offset[k] = static_cast<float>(rows[k].dot(pivot - eye));
    t.near0 = far ? 0.F : 1.F, t.near1 = far ? 1.F : 0.F;
    t.width = width, t.height = height, t.least_depth = kNear_m;
    return t;
  }

  // A corner of a strip's box: x / z and y / z are its pixels.
  struct Corner {
    float x, y, z;
  };
  static Corner corner_of(const Strip& s, int corner, const TileView& view) {
    float p[3];
    for (int k = 0; k < 3; ++k) {
      p[k] = s.centre[k] - view.pivot[k];
      for (int e = 0; e < 3; ++e) p[k] += corner >> e & 1 ? s.half[e][k] : -s.half[e][k];
    }
    const auto dot = [&](int k) {
      return view.row[k][0] * p[0] + view.row[k][1] * p[1] + view.row[k][2] * p[2] + view.offset[k];
    };
    return {dot(0), dot(1), dot(2)};
  }

  StripBox box_of(const Strip& s, const TileView& whole) const {
    StripBox box;
    float low[2] = {1e30F, 1e30F}, high[2] = {-1e30F, -1e30F};
    int behind = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const Corner c = corner_of(s, corner, whole);
      if (!(c.z > 2 * kNear_m)) {
        ++behind;
        continue;
      }
      const float px[2] = {c.x / c.z, c.y / c.z};
      for (int k = 0; k < 2; ++k) low[k] = std::min(low[k], px[k]), high[k] = std::max(high[k], px[k]);
    }
    if (behind == 8) return box;
    const float w = static_cast<float>(request_.camera.width - 1), h = static_cast<float>(request_.camera.height - 1);
    // Tiles have pixels of their own, up to an image's size away from the image's.
    const float most = 0.9F * kFarAside_px - std::max(w, h);
    box.wide = behind > 0 || std::max({-low[0], -low[1], high[0], high[1]}) > most;
    if (behind > 0) low[0] = low[1] = 0, high[0] = w, high[1] = h;  // anywhere
    constexpr float kSlack = 0.05F;
    box.x0 = static_cast<int>(std::floor(std::clamp(low[0] - kSlack, 0.F, w + 1))),
    box.x1 = static_cast<int>(std::ceil(std::clamp(high[0] + kSlack, -1.F, w)));
    box.y0 = static_cast<int>(std::floor(std::clamp(low[1] - kSlack, 0.F, h + 1))),
    box.y1 = static_cast<int>(std::ceil(std::clamp(high[1] + kSlack, -1.F, h)));
    return box;
  }

  // Whether a strip's box lies beyond one side of the tile, wherever the eye is.
  static bool beside(const Strip& s, const TileView& t) {
    int left = 0, right = 0, above = 0, below = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const auto [x, y, z] = corner_of(s, corner, t);
      left += x < -z ? 1 : 0, right += x > static_cast<float>(t.width) * z ? 1 : 0;
      above += y < -z ? 1 : 0, below += y > static_cast<float>(t.height) * z ? 1 : 0;
    }
    return left == 8 || right == 8 || above == 8 || below == 8;
  }

  void run_raster() {
    if (wants_light_) shadows_ = std::make_unique<ShadowMap>(*scene_.raster, request_.sun.direction);
    for (const Layer& layer : layers()) draw(layer);
  }

  void draw(const Layer& layer) {
    const RasterMesh& mesh = *scene_.raster;
    const int width = request_.camera.width, height = request_.camera.height;
    const int across = (width + kWide - 1) / kWide, along = (height + kHigh - 1) / kHigh;
    const TileView whole = tile_view(layer.dx, layer.dy, width, height);
    std::vector<StripBox> boxes(mesh.strips().size());
    in_parallel_pieces(boxes.size(), 256, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) boxes[i] = box_of(mesh.strips()[i], whole);
    });
    std::vector<std::vector<std::uint32_t>> bins(static_cast<std::size_t>(across * along));
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      const StripBox& b = boxes[i];
      if (b.x0 > b.x1 || b.y0 > b.y1) continue;
      for (int ty = b.y0 / kHigh; ty <= b.y1 / kHigh; ++ty)
        for (int tx = b.x0 / kWide; tx <= b.x1 / kWide; ++tx)
          bins[static_cast<std::size_t>(ty * across + tx)].push_back(static_cast<std::uint32_t>(i));
    }
    std::unique_ptr<LightScratch> scratch = light_scratch().take();
    scratch->tiles.resize(bins.size());
    if (layer.weight > 0 && !layer.store)
      layer_.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 0.F);
    in_parallel_pieces(bins.size(), 1, [&](std::size_t first, std::size_t past_last) {
      PassCounts counts;
      counts.sources.assign(catalogue_size_, 0);
      thread_local TileBuffer buffer;
      for (std::size_t tile = first; tile < past_last; ++tile) {
        if (stop_.stopped()) throw Cancelled();
        const int x0 = static_cast<int>(tile) % across * kWide, y0 = static_cast<int>(tile) / across * kHigh;
        const TileView view =
            tile_view(x0 + layer.dx, y0 + layer.dy, std::min(kWide, width - x0), std::min(kHigh, height - y0));
        buffer.clear(view.width, view.height);
        for (const std::uint32_t s : bins[tile]) {
          const Strip& strip = mesh.strips()[s];
          if (boxes[s].wide && beside(strip, view)) continue;
          draw_strip(mesh.blocks()[strip.block], strip, view, boxes[s].wide, buffer);
        }
        LightSamples& samples = scratch->tiles[tile];
        samples.clear(static_cast<std::size_t>(kWide * kHigh));
        for (int y = 0; y < view.height; ++y)
          for (int x = 0; x < view.width; x += kPacket)
            resolve(buffer, view, x0, y0, x, y, layer, layer.count ? &counts : nullptr, samples);
        samples.bound();
      }
      merge(counts);
    });
    if (layer.light) {
      shadows_->cast(*scratch, stop_);
      std::vector<float>& radiance = layer.store ? out_.radiance : layer_;
      in_parallel(scratch->shadowed.size(), [&](std::size_t band) {
        for (const std::uint32_t at : scratch->shadowed[band]) {
          if (layer.weight > 0) radiance[at] = 0;
          if (layer.store && !out_.lit.empty()) out_.lit[at] = 0;
        }
      });
    }
    light_scratch().give(std::move(scratch));
    if (layer.weight > 0 && !layer.store)
      in_parallel_pieces(layer_.size(), 65536, [&](std::size_t first, std::size_t past_last) {
        for (std::size_t i = first; i < past_last; ++i) out_.radiance[i] += layer.weight * layer_[i];
      });
  }

  // Sixteen pixels in a row of a drawn tile: as render_packet, but lit until the shadow map says otherwise.
  void resolve(const TileBuffer& buffer, const TileView& view, int x0, int y0, int x, int y, const Layer& layer,
               PassCounts* counts, LightSamples& samples) {
    const std::uint32_t* ids =
        &buffer.triangle[static_cast<std::size_t>(y) * static_cast<std::size_t>(view.width) +
                         static_cast<std::size_t>(x)];
    Rays rays;
    aim<Shape::row>(x0 + x, y0 + y, layer.dx, layer.dy, rays);
    SurfacePoints points;
    const int inside = std::min(kPacket, view.width - x);
    unsigned hits = 0;
    for (int i = 0; i < kPacket; ++i) {
      const bool hit = i < inside && ids[i] != kNoTriangle;
      points.triangle[i] = TriangleId(hit ? ids[i] : 0), points.hit[i] = hit;
      hits |= (hit ? 1U : 0U) << i;
    }
    Facets facets;
    if (hits) refine(scene_.mesh, rays, points, facets);
    hits = 0;
    for (int i = 0; i < kPacket; ++i) hits |= (points.hit[i] ? 1U : 0U) << i;
    const bool all = hits == 0xffff;
    if (counts && !all) {
      find_missing(rays, points);
      counts->missing += static_cast<std::uint64_t>(std::count(points.toward_moon, points.toward_moon + kPacket, true));
    }
    if (!hits) return;
    Shading shading;
    const Vec3& sun = request_.sun.direction;
    shade(facets, points, rays, sun.x(), sun.y(), sun.z(), shading);
    alignas(64) float lit[kPacket] = {}, radiance[kPacket];
    const std::size_t first =
        static_cast<std::size_t>(y0 + y) * static_cast<std::size_t>(request_.camera.width) +
        static_cast<std::size_t>(x0 + x);
    if (layer.light) {
      alignas(64) std::int32_t facing[kPacket];
      facing_sun(points, sun, facing);
      lit_lanes(points.hit, shading, facing, lit);
      add_samples(points, static_cast<std::uint32_t>(first), lit, samples);
    }
    if (layer.weight > 0) radiances(terms_, irradiance_, shading, lit, radiance);
    std::vector<float>& target = layer.store ? out_.radiance : layer_;
    unsigned left = hits;  // to be accounted for
    if (out_.source.empty()) left = counts ? account_all(points, hits, counts) : 0;
    const bool stores = layer.store && wants_geometry_;
    if (all && left == 0 && !stores) {
      if (layer.weight > 0) std::copy_n(radiance, kPacket, &target[first]);
      return;
    }
    for (int i = 0; i < kPacket; ++i) {
      if (!points.hit[i]) continue;
      const std::size_t at = first + static_cast<std::size_t>(i);
      if (layer.weight > 0) target[at] = radiance[i];
      if (left >> i & 1 && (counts || layer.store)) account(points, i, at, counts);
      if (stores) store_geometry(points, i, rays.direction(i), shading, lit[i], at);
    }
  }

  // Samples of the lit lanes. On an edge of its triangle float can't tell a ridge, whose far side lies beneath the
  // point, from a crease, where it rises above it: there double looks whether the Sun's ray goes into the ground at
  // once, and the sample is taken that little way up the ray.
  void add_samples(const SurfacePoints& p, std::uint32_t first_pixel, float* lit, LightSamples& samples) const {
    constexpr double kEdge = 1e-5;
    constexpr float kStep_m = 0.01F;
    LightLanes lanes;
    shadows_->place(p, lanes);
    if (none_at_edges(p, lit, kEdge)) {
      samples.add_all(lanes, first_pixel);
      return;
    }
    for (int i = 0; i < kPacket; ++i) {
      if (!(lit[i] > 0)) continue;
      float up = 0;
      if (std::min({p.v[i], p.w[i], 1 - p.v[i] - p.w[i]}) <= kEdge) {
        up = kStep_m;
        if (buried(scene_.mesh, p.triangle[i], p.position(i) + static_cast<double>(kStep_m) * request_.sun.direction)) {
          lit[i] = 0;
          continue;
        }
      }
      samples.add(lanes.u[i], lanes.v[i], lanes.d[i] + up, first_pixel + static_cast<std::uint32_t>(i));
    }
  }

  // ---- both ---------------------------------------------------------------------------------------------------

  template <Shape shape>
  void aim(int x, int y, double dx, double dy, Rays& rays) const {
    if (linear_)
      linear_rays<shape>(first_.data(), right_.data(), down_.data(), view_.position().data(), x + dx, y + dy, rays);
    for (int i = 0; i < kPacket; ++i) {
      const int px = x + i % across(shape), py = y + i / across(shape);
      rays.valid[i] = px < request_.camera.width && py < request_.camera.height;
      if (linear_) continue;
      const auto direction = rays.valid[i] ? view_.ray(px + dx, py + dy) : std::nullopt;
      rays.set(i, view_.position(), direction.value_or(Vec3::UnitX()));
      rays.valid[i] = direction.has_value();
    }
  }

  // 4 x 4 pixels from (x, y).
  void render_packet(int x, int y, const Layer& layer, PassCounts* counts) {
    if (layer.weight > 0)  // memory fetches the rows while rays are traced
      for (int row = y; row < std::min(y + kPacketSide, request_.camera.height); ++row)
        __builtin_prefetch(
            &out_.radiance[static_cast<std::size_t>(row) * static_cast<std::size_t>(request_.camera.width) +
                           static_cast<std::size_t>(x)],
            1);
    Rays rays;
    aim<Shape::square>(x, y, layer.dx, layer.dy, rays);
    SurfacePoints points;
    Facets facets;
    trace(scene_, rays, points, facets);
    if (std::find(points.hit, points.hit + kPacket, true) == points.hit + kPacket) {
      if (counts)
        counts->missing +=
            static_cast<std::uint64_t>(std::count(points.toward_moon, points.toward_moon + kPacket, true));
      return;
    }
    Shading shading;
    const Vec3& sun = request_.sun.direction;
    shade(facets, points, rays, sun.x(), sun.y(), sun.z(), shading);
    float lit[kPacket] = {}, radiance[kPacket];
    if (layer.light) light(points, shading, lit);
    if (layer.weight > 0) radiances(terms_, irradiance_, shading, lit, radiance);
    for (int i = 0; i < kPacket; ++i) {
      if (counts && points.toward_moon[i]) ++counts->missing;
      if (!points.hit[i]) continue;
      const std::size_t at =
          static_cast<std::size_t>(y + i / kPacketSide) * static_cast<std::size_t>(request_.camera.width) +
          static_cast<std::size_t>(x + i % kPacketSide);
      if (layer.weight > 0) out_.radiance[at] += layer.weight * radiance[i];
      if (counts || layer.store) account(points, i, at, counts);
      if (layer.store && wants_geometry_) store_geometry(points, i, rays.direction(i), shading, lit[i], at);
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

  // All at once but for quads of several sources, whose lanes are left: a bit for each.
  unsigned account_all(const SurfacePoints& points, unsigned hits, PassCounts* counts) const {
    std::uint32_t last = kNoTriangle;
    const MeshBlock* block = nullptr;
    unsigned left = 0, filled = 0;
    for (unsigned todo = hits; todo != 0; todo &= todo - 1) {
      const int i = std::countr_zero(todo);
      const TriangleId id = points.triangle[i];
      if (id.block() != last) {
        last = id.block();
        block = &scene_.mesh.blocks()[last];
      }
      const bool one = block->mixed.empty() || !(block->mixed[static_cast<std::size_t>(id.r())] >> id.c() & 1);
      if (!one) left |= 1U << i;
      if (one && block->source & dem::kFilledBit) filled |= 1U << i;
      if (const dem::SourceMark index = block->source & dem::kNoSource; one && index != dem::kNoSource)
        counts->sources[index] = 1;
    }
    counts->hit += static_cast<std::uint64_t>(std::popcount(hits & ~left));
    counts->filled += static_cast<std::uint64_t>(std::popcount(filled));
    return left;
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
      out_.gsd[at] = static_cast<float>(dem::post_spacing_m(scene_.mesh.blocks()[p.triangle[i].block()].posts->id.level));
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
  std::unique_ptr<ShadowMap> shadows_;
  std::vector<float> layer_;  // radiance of one sub-pixel sample
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
