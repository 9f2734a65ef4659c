#include "engine/visibility/zbuffer/raster_pass.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <numbers>
#include <optional>
#include <span>

#include "dem/error.h"
#include "dem/parallel.h"
#include "engine/support/stopwatch.h"
#include "engine/support/vectorise.h"
#include "engine/visibility/objects_in_frame.h"
#include "engine/visibility/raytrace/trace.h"

namespace selenograph::engine {
namespace {

// Pixels of a tile. A lens's are smaller: the nearer to affine, the fewer samples a triangle is tested at in vain.
constexpr int kWide = 128, kHigh = 64, kLensSide = 32;
static_assert(kWide % kPacket == 0 && kLensSide % kPacket == 0, "lanes beyond a tile are beyond the image");

constexpr float kNear_m = 0.01F;
constexpr double kFar_m = 500e3;
constexpr float kSlack_px = 0.05F;
constexpr double kEdge = 1e-5;  // share of a triangle that counts as its edge, where light is looked at in double

// The first `inside` lanes have a triangle, or none. In whole vectors: what is stored in pieces and then loaded whole
// waits until all stores before it are through.
SELENOGRAPH_VECTORISED
void take_triangles(const std::uint32_t* ids, int inside, SurfacePoints& points) {
  static_assert(sizeof(TriangleId) == sizeof(std::uint32_t) && sizeof(bool) == 1);
  alignas(64) std::uint32_t taken[kPacket];
  alignas(16) std::uint8_t hit[kPacket];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) taken[i] = i < inside ? ids[i] : kNoTriangle;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) hit[i] = taken[i] != kNoTriangle ? 1 : 0;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) taken[i] = taken[i] != kNoTriangle ? taken[i] : 0;
  std::memcpy(static_cast<void*>(points.triangle), taken, sizeof taken);
  std::memcpy(points.hit, hit, sizeof hit);
}

// Where a point is lit as far as it is alone with the Sun. Returns whether all lanes are, with none within a share
// `kEdge` of its triangle's edges.
SELENOGRAPH_VECTORISED
bool lit_lanes(const SurfacePoints& p, const Shading& shading, const std::int32_t* facing, float* lit) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) lit[i] = p.hit[i] && facing[i] && shading.mu0[i] > 0 ? 1.F : 0.F;
  int some = 0;
  for (int i = 0; i < kPacket; ++i)
    some |= (lit[i] > 0 ? 0 : 1) | (p.v[i] <= kEdge ? 1 : 0) | (p.w[i] <= kEdge ? 1 : 0) |
            (1 - p.v[i] - p.w[i] <= kEdge ? 1 : 0);
  return some == 0;
}

// A corner of a strip's box: x / z and y / z are its pixels.
struct Corner {
  float x, y, z;
};
Corner corner_of(const Strip& s, int corner, const TileView& view) {
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

// Whether a strip's box lies beyond one side of the tile, wherever the eye is.
bool beside(const Strip& s, const TileView& t) {
  int left = 0, right = 0, above = 0, below = 0;
  const float before_x = -1 - t.slack[0], past_x = static_cast<float>(t.width) + t.slack[0], before_y = -1 - t.slack[1],
              past_y = static_cast<float>(t.height) + t.slack[1];
  for (int corner = 0; corner < 8; ++corner) {
    const auto [x, y, z] = corner_of(s, corner, t);
    left += x < before_x * z ? 1 : 0, right += x > past_x * z ? 1 : 0;
    above += y < before_y * z ? 1 : 0, below += y > past_y * z ? 1 : 0;
  }
  return left == 8 || right == 8 || above == 8 || below == 8;
}

// Whether some of a strip's vertices may not be plain in a tile.
bool is_wide(const Strip& s, const TileView& t) {
  constexpr float kMost = 0.9F * kFarAside_px;
  for (int corner = 0; corner < 8; ++corner) {
    const auto [x, y, z] = corner_of(s, corner, t);
    if (!(z > 2 * kNear_m && std::abs(x) <= kMost * z && std::abs(y) <= kMost * z)) return true;
  }
  return false;
}

class RasterPass {
 public:
  RasterPass(const RasterMesh& mesh, PixelStore& store, const ObjectsInFrame& objects, const StopToken& stop,
             FrameScratch& scratch)
      : mesh_(mesh),
        store_(store),
        objects_(objects),
        view_(store.view()),
        request_(store.request()),
        out_(store.out()),
        stop_(stop),
        scratch_(scratch),
        bends_(!request_.camera.distortion.none()) {
    if (!store.wants_light()) return;
    shadows_.emplace(mesh, request_.sun.direction);
    if (request_.sun.angular_radius_deg > 0) disc_.emplace(request_.sun);
  }

  void run() {
    for (const Layer& layer : store_.layers()) draw(layer);
  }

 private:
  // From places relative to the anchor to a tile's pixels: pixel = a (x / z, y / z) + b, in the camera's axes.
  TileView tile_view(const Eigen::Matrix2d& a, const Eigen::Vector2d& b, int width, int height) const {
    TileView t{};
    const Eigen::Matrix3d m = view_.moon_from_camera().transpose();
    const Vec3 eye = view_.position() - mesh_.anchor();
    const bool far = eye.norm() > kFar_m;
    const Vec3 x = m.row(0), y = m.row(1), z = m.row(2);
    const Vec3 rows[3] = {x * a(0, 0) + y * a(0, 1) + z * b.x(), x * a(1, 0) + y * a(1, 1) + z * b.y(), z};
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

  // Without the lens.
  TileView plain_view(double x0, double y0, int width, int height) const {
    const Camera& c = request_.camera;
    return tile_view(Eigen::Vector2d(c.fx, c.fy).asDiagonal(), {c.cx - x0, c.cy - y0}, width, height);
  }

  // Through the lens: the affine map that fits at the tile's middle, and where each pixel's sample is then.
  TileView lens_view(const ImageTile& tile, const PixelRays& rays, TileBuffer& buffer) const {
    const auto at = [&](int x, int y) {
      return static_cast<std::size_t>(tile.y0 + y) * static_cast<std::size_t>(request_.camera.width) +
             static_cast<std::size_t>(tile.x0 + x);
    };
    // The valid pixel nearest to the middle.
    int best_x = -1, best_y = -1, least = std::numeric_limits<int>::max();
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        const int from_middle = std::abs(2 * x - tile.width) + std::abs(2 * y - tile.height);
        if (from_middle < least && !std::isnan(rays.x[at(x, y)])) best_x = x, best_y = y, least = from_middle;
      }
    const std::size_t n = static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height);
    constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
    buffer.sample_x.assign(n + kTilePadding, kNone), buffer.sample_y.assign(n + kTilePadding, kNone);
    if (best_x < 0) return tile_view(Eigen::Matrix2d::Zero(), {0, 0}, 0, 0);
    const Eigen::Vector2d middle(rays.x[at(best_x, best_y)], rays.y[at(best_x, best_y)]);
    const Eigen::Matrix2d a = Eigen::Vector2d(request_.camera.fx, request_.camera.fy).asDiagonal() *
                              view_.lens().jacobian(middle.x(), middle.y());
    const Eigen::Vector2d b = Eigen::Vector2d(best_x, best_y) - a * middle;
    TileView view = tile_view(a, b, tile.width, tile.height);
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        const Eigen::Vector2d p = a * Eigen::Vector2d(rays.x[at(x, y)], rays.y[at(x, y)]) + b;
        if (std::isnan(p.x())) continue;
        const std::size_t k =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(tile.width) + static_cast<std::size_t>(x);
        buffer.sample_x[k] = static_cast<float>(p.x()), buffer.sample_y[k] = static_cast<float>(p.y());
        view.slack[0] = std::max(view.slack[0], std::abs(buffer.sample_x[k] - static_cast<float>(x)));
        view.slack[1] = std::max(view.slack[1], std::abs(buffer.sample_y[k] - static_cast<float>(y)));
      }
    view.sample_x = buffer.sample_x.data(), view.sample_y = buffer.sample_y.data();
    return view;
  }

  StripBox box_of(const Strip& s, const TileView& whole) const {
    constexpr float kAnywhere = std::numeric_limits<float>::infinity();
    StripBox box{{kAnywhere, kAnywhere}, {-kAnywhere, -kAnywhere}, false};
    int behind = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const Corner c = corner_of(s, corner, whole);
      if (!(c.z > 2 * kNear_m)) {
        ++behind;
        continue;
      }
      const float px[2] = {c.x / c.z, c.y / c.z};
      for (int k = 0; k < 2; ++k) box.low[k] = std::min(box.low[k], px[k]), box.high[k] = std::max(box.high[k], px[k]);
    }
    if (behind == 8) return box;
    // Tiles have pixels of their own, up to an image's size away from the image's.
    const float most =
        0.9F * kFarAside_px - static_cast<float>(std::max(request_.camera.width, request_.camera.height));
    box.wide = behind > 0 || std::max({-box.low[0], -box.low[1], box.high[0], box.high[1]}) > most;
    for (int k = 0; k < 2; ++k) {
      if (behind > 0) box.low[k] = -kAnywhere, box.high[k] = kAnywhere;
      box.low[k] -= kSlack_px, box.high[k] += kSlack_px;
    }
    return box;
  }

  void lay_tiles(const Layer& layer, const PixelRays& rays) {
    const int width = request_.camera.width, height = request_.camera.height;
    const int wide = bends_ ? kLensSide : kWide, high = bends_ ? kLensSide : kHigh;
    const int across = (width + wide - 1) / wide, along = (height + high - 1) / high;
    const TileView whole = plain_view(layer.dx, layer.dy, width, height);
    scratch_.boxes.resize(mesh_.strips().size());
    in_parallel_pieces(scratch_.boxes.size(), 256, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) scratch_.boxes[i] = box_of(mesh_.strips()[i], whole);
    });
    scratch_.tiles.resize(static_cast<std::size_t>(across) * static_cast<std::size_t>(along));
    in_parallel(static_cast<std::size_t>(along), [&](std::size_t row) {
      const auto tiles =
          std::span(scratch_.tiles).subspan(row * static_cast<std::size_t>(across), static_cast<std::size_t>(across));
      float low = std::numeric_limits<float>::infinity(), high_end = -low;
      for (std::size_t column = 0; column < tiles.size(); ++column) {
        ImageTile& tile = tiles[column];
        tile.x0 = static_cast<int>(column) * wide, tile.y0 = static_cast<int>(row) * high;
        tile.width = std::min(wide, width - tile.x0), tile.height = std::min(high, height - tile.y0);
        tile.strips.clear();
        bound(tile, rays);
        low = std::min(low, tile.low[1]), high_end = std::max(high_end, tile.high[1]);
      }
      for (std::size_t i = 0; i < scratch_.boxes.size(); ++i) {
        const StripBox& b = scratch_.boxes[i];
        if (b.empty() || b.high[1] < low || b.low[1] > high_end) continue;
        for (ImageTile& tile : tiles)
          if (b.low[0] <= tile.high[0] && b.high[0] >= tile.low[0] && b.low[1] <= tile.high[1] &&
              b.high[1] >= tile.low[1])
            tile.strips.push_back(static_cast<std::uint32_t>(i));
      }
    });
  }

  void bound(ImageTile& tile, const PixelRays& rays) const {
    tile.low[0] = static_cast<float>(tile.x0), tile.high[0] = static_cast<float>(tile.x0 + tile.width - 1);
    tile.low[1] = static_cast<float>(tile.y0), tile.high[1] = static_cast<float>(tile.y0 + tile.height - 1);
    if (!bends_) return;
    const Camera& c = request_.camera;
    tile.low[0] = tile.low[1] = std::numeric_limits<float>::infinity(), tile.high[0] = tile.high[1] = -tile.low[0];
    for (int y = tile.y0; y < tile.y0 + tile.height; ++y)
      for (int x = tile.x0; x < tile.x0 + tile.width; ++x) {
        const std::size_t at =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(c.width) + static_cast<std::size_t>(x);
        if (std::isnan(rays.x[at])) continue;
        const float p[2] = {static_cast<float>(rays.x[at] * c.fx + c.cx), static_cast<float>(rays.y[at] * c.fy + c.cy)};
        for (int k = 0; k < 2; ++k)
          tile.low[k] = std::min(tile.low[k], p[k]), tile.high[k] = std::max(tile.high[k], p[k]);
      }
  }

  void draw(const Layer& layer) {
    const bool centre = layer.dx == 0 && layer.dy == 0;
    const PixelRays own = bends_ && !centre ? PixelRays(request_.camera, layer.dx, layer.dy) : PixelRays();
    const PixelRays& rays = centre ? store_.centres() : own;
    lay_tiles(layer, rays);
    const auto width = static_cast<std::size_t>(request_.camera.width),
               height = static_cast<std::size_t>(request_.camera.height);
    scratch_.samples.resize(scratch_.tiles.size());
    if (layer.weight > 0 && !layer.store) scratch_.layer.assign(width * height, 0.F);
    scratch_.bases.clear();
    if (layer.weight > 0 && (store_.mapped() || !objects_.empty()))
      scratch_.bases.assign(width * height, store_.base_radiance());
    Stopwatch watch;
    std::mutex mutex;
    double draw_ms = 0, resolve_ms = 0;  // of all threads
    in_parallel_pieces(scratch_.tiles.size(), 1, [&](std::size_t first, std::size_t past_last) {
      PassCounts counts;
      double draws_ms = 0, resolves_ms = 0;
      const Pool<TileBuffer>::Lease buffer(scratch_.buffers);
      for (std::size_t i = first; i < past_last; ++i) {
        stop_.check();
        Stopwatch lap;
        draw_tile(scratch_.tiles[i], layer, rays, *buffer);
        draws_ms += lap.lap_ms();
        resolve_tile(scratch_.tiles[i], layer, rays, *buffer, layer.count ? &counts : nullptr, scratch_.samples[i]);
        resolves_ms += lap.lap_ms();
      }
      store_.merge(counts);
      std::lock_guard lock(mutex);
      draw_ms += draws_ms, resolve_ms += resolves_ms;
    });
    PassCounts times;  // and nothing seen
    const double tiles_ms = watch.lap_ms(), work_ms = std::max(draw_ms + resolve_ms, 1e-9);
    times.draw_ms = tiles_ms * draw_ms / work_ms, times.resolve_ms = tiles_ms * resolve_ms / work_ms;
    if (layer.light) cast_shadows(layer);
    times.shadow_ms = watch.lap_ms();
    store_.merge(times);
    if (layer.weight > 0 && !layer.store)
      in_parallel_pieces(scratch_.layer.size(), 65536, [&](std::size_t first, std::size_t past_last) {
        for (std::size_t i = first; i < past_last; ++i) out_.radiance[i] += layer.weight * scratch_.layer[i];
      });
  }

  void draw_tile(const ImageTile& tile, const Layer& layer, const PixelRays& rays, TileBuffer& buffer) const {
    const TileView view = bends_ ? lens_view(tile, rays, buffer)
                                 : plain_view(tile.x0 + layer.dx, tile.y0 + layer.dy, tile.width, tile.height);
    buffer.clear(tile.width, tile.height);
    for (const std::uint32_t s : tile.strips) {
      const Strip& strip = mesh_.strips()[s];
      const bool wide = bends_ ? is_wide(strip, view) : scratch_.boxes[s].wide;
      if ((wide || bends_) && beside(strip, view)) continue;
      draw_strip(mesh_.blocks()[strip.block], strip, view, wide, buffer);
    }
  }

  void resolve_tile(const ImageTile& tile, const Layer& layer, const PixelRays& rays, const TileBuffer& buffer,
                    PassCounts* counts, LightSamples& samples) {
    samples.clear(static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height) + kPacket,
                  disc_.has_value());
    PixelStore::Sampler sampler = store_.sampler();
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; x += kPacket) resolve(tile, buffer, x, y, layer, rays, counts, samples, sampler);
    samples.bound();
  }

  // Sixteen pixels in a row of a drawn tile: seen, and lit until the shadow map says otherwise.
  void resolve(const ImageTile& tile, const TileBuffer& buffer, int x, int y, const Layer& layer,
               const PixelRays& layer_rays, PassCounts* counts, LightSamples& samples, PixelStore::Sampler& sampler) {
    const std::uint32_t* ids = &buffer.triangle[static_cast<std::size_t>(y) * static_cast<std::size_t>(tile.width) +
                                                static_cast<std::size_t>(x)];
    Rays rays;
    store_.aim(Shape::row, tile.x0 + x, tile.y0 + y, layer, bends_ ? &layer_rays : nullptr, rays);
    SurfacePoints points;
    take_triangles(ids, std::min(kPacket, tile.width - x), points);
    prefetch_next(ids + kPacket);
    Facets facets;
    refine(store_.mesh(), rays, points, facets);
    if (!objects_.empty()) resolve_objects(tile.x0 + x, tile.y0 + y, layer, rays, points, counts, samples);
    const std::uint32_t hits = hit_bits(points);
    const bool all = hits == 0xffff;
    if (counts && !all) {
      find_missing(rays, points);
      counts->missing += static_cast<std::uint64_t>(std::count(points.toward_moon, points.toward_moon + kPacket, true));
    }
    if (!hits) return;
    Shading shading;
    store_.shade(facets, points, rays, shading);
    alignas(64) float lit[kPacket] = {}, radiance[kPacket], base[kPacket];
    const std::size_t first = static_cast<std::size_t>(tile.y0 + y) * static_cast<std::size_t>(request_.camera.width) +
                              static_cast<std::size_t>(tile.x0 + x);
    if (layer.light) light(points, shading, nullptr, static_cast<std::uint32_t>(first), lit, samples);
    if (layer.weight > 0) store_.radiances(points, shading, rays, lit, sampler, radiance, base);
    const bool bases = layer.weight > 0 && store_.mapped();
    std::vector<float>& target = radiance_of(layer);
    std::uint32_t left = hits;  // to be accounted for
    if (out_.source.empty()) left = counts ? store_.account_all(points, hits, counts) : 0;
    const bool stores = layer.store && store_.wants_geometry();
    if (all && left == 0 && !stores && !bases) {
      if (layer.weight > 0) std::copy_n(radiance, kPacket, &target[first]);
      return;
    }
    for (int i = 0; i < kPacket; ++i) {
      if (!points.hit[i]) continue;
      const std::size_t at = first + static_cast<std::size_t>(i);
      if (layer.weight > 0) target[at] = radiance[i];
      if (bases) scratch_.bases[at] = base[i];
      if (left >> i & 1 && (counts || layer.store)) store_.account(points, i, at, counts);
      if (stores) store_.store_geometry(points, i, rays.direction(i), shading, lit[i], at);
    }
  }

  // Those of the packet's pixels that see objects; they are no longer terrain's. Their points are samples of the shadow
  // map like any others.
  // Never inlined, nor is shade_by_objects: frames without objects have the same code as ever.
  [[gnu::noinline]] void resolve_objects(int x, int y, const Layer& layer, Rays& rays, SurfacePoints& points,
                                         PassCounts* counts, LightSamples& samples) {
    ObjectLanes lanes;
    if (objects_.meet(rays, points, lanes) == 0) return;
    alignas(64) float lit[kPacket] = {};
    const std::size_t first =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(request_.camera.width) + static_cast<std::size_t>(x);
    if (layer.light) light(lanes.points, lanes.shading, lanes.object, static_cast<std::uint32_t>(first), lit, samples);
    store_.store_objects(objects_, lanes, rays, lit, Shape::row, x, y, layer,
                         {radiance_of(layer), layer.weight > 0 ? 1.F : 0.F, &scratch_.bases}, counts);
  }

  // Asks memory for what the next pixels' triangles are made of: a third of the time would go by waiting for it. Every
  // second one will do, neighbours share cache lines.
  void prefetch_next(const std::uint32_t* ids) const {
    for (int i = 0; i < kPacket; i += 2) {
      if (ids[i] == kNoTriangle) continue;
      const TriangleId id(ids[i]);
      const MeshBlock& block = store_.mesh().blocks()[id.block()];
      const MeshVertex* corner = block.vertices.data() + id.r() * block.side + id.c();
      __builtin_prefetch(corner), __builtin_prefetch(corner + block.side);
    }
  }

  std::vector<float>& radiance_of(const Layer& layer) { return layer.store ? out_.radiance : scratch_.layer; }

  // `own`: objects that the points are on; null on terrain.
  void light(const SurfacePoints& points, const Shading& shading, const std::uint16_t* own, std::uint32_t first_pixel,
             float* lit, LightSamples& samples) const {
    alignas(64) std::int32_t facing[kPacket];
    if (disc_)
      disc_->faced_by(points, facing);
    else
      facing_sun(points, request_.sun.direction, facing);
    if (!objects_.empty()) shade_by_objects(points, own, facing);
    const bool plain = lit_lanes(points, shading, facing, lit);
    add_samples(points, facing, first_pixel, lit, plain, samples);
  }

  // What an object blocks counts as not faced.
  [[gnu::noinline]] void shade_by_objects(const SurfacePoints& points, const std::uint16_t* own,
                                          std::int32_t* facing) const {
    const auto shade = [&](const Vec3& sun, int bit) {
      std::uint32_t asking = 0;
      for (int i = 0; i < kPacket; ++i) asking |= points.hit[i] && facing[i] >> bit & 1 ? 1U << i : 0U;
      const std::uint32_t blocked = objects_.blocked(points, own, asking, sun);
      for (int i = 0; i < kPacket; ++i)
        if (blocked >> i & 1) facing[i] &= ~static_cast<std::int32_t>(1U << bit);
    };
    if (!disc_) return shade(request_.sun.direction, 0);
    for (int k = 0; k < kDiscSamples; ++k) shade(disc_->directions()[static_cast<std::size_t>(k)], k);
  }

  // Samples of the lit lanes. `plain`: all are lit, none is on an edge of its triangle. There float can't tell a ridge,
  // whose far side lies beneath the point, from a crease, where it rises above it: double looks whether the Sun's ray
  // goes into the ground at once, and the sample is taken that little way up the ray.
  void add_samples(const SurfacePoints& p, const std::int32_t* facing, std::uint32_t first_pixel, float* lit,
                   bool plain, LightSamples& samples) const {
    constexpr float kStep_m = 0.01F;
    LightLanes lanes;
    shadows_->place(p, lanes);
    if (plain) {
      if (disc_) samples.add_faces(facing);
      samples.add_all(lanes, first_pixel);
      return;
    }
    for (int i = 0; i < kPacket; ++i) {
      if (!(lit[i] > 0)) continue;
      float up = 0;
      if (std::min({p.v[i], p.w[i], 1 - p.v[i] - p.w[i]}) <= kEdge) {
        up = kStep_m;
        if (buried(store_.mesh(), p.triangle[i],
                   p.position(i) + static_cast<double>(kStep_m) * request_.sun.direction)) {
          lit[i] = 0;
          continue;
        }
      }
      if (disc_) samples.add_face(facing[i]);
      samples.add(lanes.u[i], lanes.v[i], lanes.d[i] + up, first_pixel + static_cast<std::uint32_t>(i));
    }
  }

  void cast_shadows(const Layer& layer) {
    std::vector<float>& radiance = radiance_of(layer);
    const float everywhere = store_.base_radiance();
    const auto base_of = [&](std::uint32_t at) { return scratch_.bases.empty() ? everywhere : scratch_.bases[at]; };
    if (!disc_) {
      shadows_->cast(scratch_.samples, scratch_.light, stop_);
      in_parallel(scratch_.light.shadowed.size(), [&](std::size_t band) {
        for (const std::uint32_t at : scratch_.light.shadowed[band]) {
          if (layer.weight > 0) radiance[at] = base_of(at);
          if (layer.store && !out_.lit.empty()) out_.lit[at] = 0;
        }
      });
      return;
    }
    disc_->cast(mesh_, *shadows_, request_.camera.width, request_.camera.height, scratch_.samples, scratch_.light,
                scratch_.disc, stop_);
    in_parallel(scratch_.samples.size(), [&](std::size_t tile) {
      const LightSamples& samples = scratch_.samples[tile];
      for (std::size_t k = 0; k < samples.count; ++k) {
        const std::uint32_t at = samples.pixel[k];
        const float share = disc_->lit_share(samples.faces[k], scratch_.disc.dark[at]);
        if (layer.weight > 0) radiance[at] = base_of(at) + (radiance[at] - base_of(at)) * share;
        if (layer.store && !out_.lit.empty()) out_.lit[at] = share;
      }
    });
  }

  const RasterMesh& mesh_;
  PixelStore& store_;
  const ObjectsInFrame& objects_;
  const View& view_;
  const FrameRequest& request_;
  FrameProducts& out_;
  const StopToken& stop_;
  FrameScratch& scratch_;
  bool bends_;
  std::optional<ShadowMap> shadows_;
  std::optional<SunDisc> disc_;
};

}  // namespace

std::size_t FrameScratch::bytes() const {
  std::size_t sum = sizeof(FrameScratch) + bytes_of(boxes) + bytes_of(tiles) + bytes_of(layer) + bytes_of(bases) +
                    light.bytes() + disc.bytes() + buffers.bytes();
  for (const ImageTile& tile : tiles) sum += bytes_of(tile.strips);
  for (const LightSamples& s : samples) sum += s.bytes();
  return sum;
}

void draw_pixels(const RasterMesh& mesh, PixelStore& store, const ObjectsInFrame& objects, const StopToken& stop,
                 FrameScratch& scratch) {
  RasterPass(mesh, store, objects, stop, scratch).run();
}

}  // namespace selenograph::engine
