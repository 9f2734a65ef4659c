#include "engine/maps/render_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/grid/rotation.h"
#include "engine/cache/budget.h"
#include "engine/cache/render_context.h"
#include "engine/frame/needs.h"
#include "engine/hazard/hazard_map.h"
#include "engine/radiometry/radiometry.h"
#include "engine/scene/anchor.h"
#include "engine/scene/selection.h"
#include "engine/sensor/sensor.h"
#include "engine/support/assign.h"
#include "engine/support/stopwatch.h"
#include "engine/visibility/image/frame_writer.h"
#include "engine/visibility/objects/objects_in_frame.h"
#include "engine/visibility/objects/rocks_in_view.h"
#include "engine/visibility/points/trace.h"
#include "engine/visibility/raytrace/ray_pass.h"

namespace selenograph::engine {
namespace {

// Size of patches. A patch is halved until its terrain fits into one scene within the target for shadows and it spans
// less of the Moon than a camera sees at once. The target for shadows is relaxed only in patches up to kSmallPatch_px.
constexpr int kLargestPatch_px = 512, kSmallPatch_px = 64;
const double kWidestPatchCosine = std::cos(30 * kRadiansPerDegree);
// Larger maps remove their scenes from the cache: they would evict those of moving cameras.
constexpr int kMaxCachedPatches = 16;

// A rectangle of the map's pixels, rendered as one frame.
struct Patch {
  int x, y, width, height;
  std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  // Halves the longer side.
  std::pair<Patch, Patch> halves() const {
    Patch a = *this, b = *this;
    if (width >= height) {
      a.width = width / 2;
      b.x += a.width;
      b.width -= a.width;
    } else {
      a.height = height / 2;
      b.y += a.height;
      b.height -= a.height;
    }
    return {a, b};
  }
};

// Unit directions from the Moon's centre to the patch's pixels.
struct PatchDirections {
  std::vector<Vec3> up;        // row by row; NaN where the map is off the Moon
  Vec3 middle = Vec3::zero();  // mean direction; zero: no pixel is on the Moon
  double min_cosine = 1;       // cosine of the angle from `middle` to the farthest pixel
};

// Returns the directions of a patch's pixels, their mean and their spread.
PatchDirections directions_of(const dem::MapGrid& grid, const Patch& patch, const StopToken& stop) {
  PatchDirections out;
  out.up.resize(patch.pixels());
  const dem::MapTransform map(grid.plane);
  in_parallel_pieces(static_cast<std::size_t>(patch.height), 8, [&](std::size_t first, std::size_t past_last) {
    stop.check();
    for (std::size_t row = first; row < past_last; ++row)
      for (int column = 0; column < patch.width; ++column)
        out.up[row * static_cast<std::size_t>(patch.width) + static_cast<std::size_t>(column)] =
            map.direction(grid.point(patch.x + column, patch.y + static_cast<int>(row)))
                .value_or(Vec3::constant(kNaN64));
  });
  Vec3 sum = Vec3::zero();
  for (const Vec3& d : out.up)
    if (!d.has_nan()) {
      sum += d;
      out.middle = d;
    }
  if (out.middle == Vec3::zero()) return out;
  // The mean of a patch around the whole Moon may vanish: keep any direction, from which the patch is too wide.
  if (sum.norm() > 1e-6) out.middle = sum.normalized();
  for (const Vec3& d : out.up)
    if (!d.has_nan()) out.min_cosine = std::min(out.min_cosine, d.dot(out.middle));
  return out;
}

// Distance of a patch's camera: far enough for its rays to be practically parallel, and near enough for coordinates
// with a resolution of nanometres.
constexpr double kFarAway_m = 1e8;

// Returns the view of a camera far away from a patch in a direction. It sees everything on the patch, from the lowest
// to the highest possible terrain, and its pixels have the map's size on the ground.
RowViews view_from(const Vec3& toward, const PatchDirections& patch, double gsd_m, const StopToken& stop) {
  const Vec3 z = -toward, x = any_across(toward), y = z.cross(x);
  Pose pose;
  pose.position_m = patch.middle * kMoonRadius_m + toward * kFarAway_m;
  const Mat3 axes = Mat3::from_rows(x, y, z);
  pose.camera_from_moon = Quat(axes);
  // Largest slopes x / z and y / z of the patch's ground in the camera.
  double right = 0, down = 0;
  for (const Vec3& d : patch.up) {
    if (d.has_nan()) continue;
    for (const float height_m : {dem::kLowestRelief_m, dem::kHighestRelief_m}) {
      const Vec3 c = axes * (d * (kMoonRadius_m + static_cast<double>(height_m)) - pose.position_m);
      right = std::max(right, std::abs(c.x() / c.z()));
      down = std::max(down, std::abs(c.y() / c.z()));
    }
  }
  Camera camera;
  camera.fx = camera.fy = kFarAway_m / gsd_m;
  constexpr double kMax_px = 1e9;
  // Returns the side of an image that reaches this slope on both sides of its middle, with a pixel to spare.
  const auto side = [&](double slope) { return 3 + 2 * static_cast<int>(std::min(slope * camera.fx, kMax_px)); };
  camera.width = side(right);
  camera.height = side(down);
  camera.cx = (camera.width - 1) / 2.0;
  camera.cy = (camera.height - 1) / 2.0;
  return {camera, pose, std::nullopt, stop};
}

// Returns the products to draw a patch with. Heights and the mask of data come from positions, slopes from normals.
ProductSet products_of_patch(ProductSet requested) {
  return (requested & ~(kHeight | kSlope | kRockHeight)) | kPosition | (requested & kSlope ? ProductSet{kNormal} : 0);
}

// Draws a map patch by patch into one set of products.
class MapDrawing {
 public:
  MapDrawing(const MapRequest& request, const RenderContext& context, const MapProgress& progress)
      : request_(request), context_(context), progress_(progress), frame_(request.scenery) {
    frame_.camera = {};
    frame_.shutter.reset();
    frame_.sensor.reset();
    frame_.objects.clear();
    frame_.terrain = true;
    frame_.products = products_of_patch(request.products);
    frame_.accuracy.samples_per_pixel = 1;
    frame_.visibility = Visibility::raytrace;
    radiance_ = radiance_terms(frame_);
    const std::size_t n = pixel_count();
    allocate_products(out_.products, request.products, n, n, context_.stop);
    std::fill(out_.products.radiance.begin(), out_.products.radiance.end(), kNaN32);
    out_.report.min_post_spacing_m = std::numeric_limits<double>::infinity();
    out_.report.shadow_limits_px = {frame_.accuracy.max_shadow_error_px};
  }

  Map draw() {
    const int patch_columns = (request_.grid.width + kLargestPatch_px - 1) / kLargestPatch_px;
    const int patch_rows = (request_.grid.height + kLargestPatch_px - 1) / kLargestPatch_px;
    drops_scenes_ = patch_columns * patch_rows > kMaxCachedPatches;
    for (int j = 0; j < patch_rows; ++j)
      for (int i = 0; i < patch_columns; ++i) {
        const int x = i * kLargestPatch_px, y = j * kLargestPatch_px;
        draw({x, y, std::min(kLargestPatch_px, request_.grid.width - x),
              std::min(kLargestPatch_px, request_.grid.height - y)});
      }
    context_.cache.settle();  // evicts what the scratch memory of drawing displaced
    return finish();
  }

 private:
  std::size_t pixel_count() const {
    return static_cast<std::size_t>(request_.grid.width) * static_cast<std::size_t>(request_.grid.height);
  }

  // Draws a patch, or its halves if it is too wide or its terrain too much.
  void draw(const Patch& patch) {
    Stopwatch watch;
    const PatchDirections directions = directions_of(request_.grid, patch, context_.stop);
    if (directions.middle == Vec3::zero()) return done(patch);
    if (directions.min_cosine < kWidestPatchCosine && patch.pixels() > 1) return draw_halves(patch);
    // Select for two views: from above, and from the viewer, whose line of sight other terrain may occlude.
    const RowViews above = view_from(directions.middle, directions, request_.grid.gsd_m, context_.stop);
    std::vector<ViewBundle> views(above.bundles().begin(), above.bundles().end());
    if (const auto& toward = request_.toward_viewer;
        toward && wants_radiance(frame_) && toward->dot(directions.middle) > kLowestView)
      views.push_back(view_from(*toward, directions, request_.grid.gsd_m, context_.stop).bundles().front());
    const auto selection = select(patch, views);
    if (!selection) return draw_halves(patch);
    out_.times.select_ms += watch.lap_ms();
    draw(patch, directions, above, *selection);
    done(patch);
  }

  // Cosine of the viewer's zenith angle below which a patch is invisible whatever its slopes.
  static constexpr double kLowestView = -0.6;

  // Draws both halves; the scenes of a map that is divided so are not cached.
  void draw_halves(const Patch& patch) {
    const auto [a, b] = patch.halves();
    drops_scenes_ = true;
    draw(a);
    draw(b);
  }

  // Reports the progress.
  void done(const Patch& patch) {
    drawn_ += patch.pixels();
    if (progress_) progress_(static_cast<double>(drawn_) / static_cast<double>(pixel_count()));
  }

  // Returns the blocks of a patch; empty if the patch must be halved.
  std::optional<Selection> select(const Patch& patch, const std::vector<ViewBundle>& views) const {
    try {
      Selection selection =
          select_for_views(context_.terrain, views, wants_light(frame_) ? &frame_.sun : nullptr, frame_.accuracy,
                           context_.stop, {context_.cache.capacity(), Visibility::raytrace});
      const bool was_relaxed = selection.shadow_limit_px > frame_.accuracy.max_shadow_error_px;
      if (was_relaxed && std::max(patch.width, patch.height) > kSmallPatch_px) return std::nullopt;
      return selection;
    } catch (const TooMuchTerrain&) {
      if (patch.pixels() == 1)
        throw TooMuchTerrain(
            fmt::format("one pixel of the map needs more terrain than the {} MB for scenes hold: ask for a larger "
                        "gsd_m or max_error_px",
                        context_.cache.capacity() >> 20),
            "gsd_m");
      return std::nullopt;
    }
  }

  // Builds the scene of a patch and traces it.
  void draw(const Patch& patch, const PatchDirections& directions, const RowViews& above, const Selection& selection) {
    // The products have the size of the patch. Its rays are vertical ones (trace), not those of a camera.
    frame_.camera.width = patch.width;
    frame_.camera.height = patch.height;
    const View& view = above.reference();
    const SceneContent content{selection.blocks, anchor_for(view.position(), view.middle(), kFarAway_m),
                               Visibility::raytrace, &context_.terrain};
    const FrameWork work = work_of(frame_, frame_.accuracy, Visibility::raytrace, triangles_of(selection),
                                   /*build=*/!context_.cache.holds(content));
    // Throws if the rest of the map, all patches taken to be like this one, cannot end before the deadline.
    const std::size_t patches_left = (pixel_count() - drawn_) / patch.pixels();
    context_.cache.speed(Visibility::raytrace)
        .refuse_hopeless(work, std::max<std::size_t>(patches_left, 1), "a larger gsd_m or a smaller area takes less",
                         context_.stop);
    Stopwatch watch;
    StageTimes spent;
    const double earlier_indirect_ms = out_.times.indirect_ms;
    {  // releases the scene before it is forgotten
      const std::shared_ptr<const Scene> scene = context_.cache.scene(content, context_.stop);
      spent.build_ms = watch.lap_ms();
      trace(patch, directions, above, selection, *scene);
      report(selection, *scene);
    }
    spent.visibility_ms = watch.lap_ms() - (out_.times.indirect_ms - earlier_indirect_ms);
    context_.cache.speed(Visibility::raytrace).learn(work, spent);
    out_.times.build_ms += spent.build_ms;
    out_.times.visibility_ms += spent.visibility_ms;
    if (drops_scenes_) context_.cache.forget(content);
  }

  // Traces the vertical rays of a patch and copies its products to the map.
  void trace(const Patch& patch, const PatchDirections& directions, const RowViews& above, const Selection& selection,
             const Scene& scene) {
    const RocksInView rocks = rocks_on(above, selection);
    const ObjectsInFrame objects(frame_, rocks.rocks, context_.stop);
    std::vector<float> rock_height;
    if (request_.products & kRockHeight) rock_height.assign(patch.pixels(), 0);
    std::vector<double> sag_m(request_.products & kHeight ? patch.pixels() : 0, 0);
    const PixelRays lens;
    const EachSample each;
    std::optional<TerrainLight> indirect;
    if (wants_indirect(frame_)) {
      Stopwatch watch;
      std::optional<Vec3> viewer_m;
      if (request_.toward_viewer) viewer_m = directions.middle * kMoonRadius_m + *request_.toward_viewer * kFarAway_m;
      indirect.emplace(frame_,
                       ViewOfGround{above, scene.mesh, balls_around(frame_.objects), objects.balls_around_rocks()},
                       viewer_m, context_.terrain, radiance_.direct_w_m2, context_.cache.light_tiles(), context_.stop);
      out_.report.ground_view = std::max(out_.report.ground_view, indirect->max_ground_view());
      out_.times.indirect_ms += watch.lap_ms();
      out_.times.light += indirect->times();
    }
    const FrameJob job{
        frame_, above, scene, objects, radiance_, lens, context_.stop, each, indirect ? &*indirect : nullptr};
    FrameProducts drawn;
    FrameWriter writer(frame_, above, scene.mesh, context_.terrain.catalogue().rasters().size(), drawn, context_.stop);
    writer.set_light({radiance_.direct_w_m2, job.indirect});
    RayPass(job, writer).for_pixels([&](RayPass& pass, RayPass::Packet& packet) {
      aim(patch, directions, packet);
      pass.intersect_rays(packet);
      if (packet.on_object && !rock_height.empty()) note_rocks(patch, packet, rock_height);
      if (!sag_m.empty()) note_sag(patch, scene.mesh, packet, sag_m);
      pass.find_light(packet);
      const std::uint32_t hidden = turn_to_viewer(scene, packet);
      pass.find_radiance(packet);
      for (int i = 0; i < kPacket; ++i)
        if (hidden >> i & 1) packet.radiance[i] = kNaN32;
      pass.write_products(packet);
    });
    hit_ += writer.counts().hit;
    missing_ += writer.counts().missing;
    filled_ += writer.counts().filled;
    blended_ += writer.counts().blended;
    const std::vector<dem::SourceIndex> sources = writer.sources().resolve(drawn.source);
    drawn.rock_height = std::move(rock_height);
    copy(patch, directions, drawn, numbers_of(sources));
    if (!sag_m.empty()) lift(patch, sag_m);
  }

  // Returns the rocks in view of a patch, none unless the request has rocks.
  RocksInView rocks_on(const RowViews& above, const Selection& selection) {
    if (!request_.rocks) return {};
    RocksInView rocks =
        rocks_in_view(context_.terrain, context_.cache.rocks(), above, wants_light(frame_) ? &frame_.sun : nullptr,
                      selection.blocks, frame_.accuracy.max_error_px, context_.stop);
    out_.report.rocks += rocks.rocks.size();
    out_.report.least_rock_px = std::max(out_.report.least_rock_px, rocks.least_px);
    return rocks;
  }

  // Records the heights of rocks above the terrain below them. The packet's points are still those of the terrain.
  static void note_rocks(const Patch& patch, const RayPass::Packet& p, std::vector<float>& rock_height) {
    for (int i = 0; i < kPacket; ++i) {
      const int x = p.x + i % kPacketSide, y = p.y + i / kPacketSide;
      if (!(p.on_object >> i & 1) || p.objects.on_soil[i] || x >= patch.width || y >= patch.height) continue;
      rock_height[static_cast<std::size_t>(y) * static_cast<std::size_t>(patch.width) + static_cast<std::size_t>(x)] =
          static_cast<float>(p.points.distance[i] - p.objects.points.distance[i]);
    }
  }

  // Records the sag of the mesh below the heights interpolated between its vertices. Triangles are plane and the Moon
  // is round: between posts 1 km apart on level ground a triangle's centre is 0.07 m too low, and without this
  // correction so would be all heights of a map drawn with coarse triangles.
  static void note_sag(const Patch& patch, const Mesh& mesh, const RayPass::Packet& p, std::vector<double>& sag_m) {
    const SurfacePoints& points = p.points;
    for (int i = 0; i < kPacket; ++i) {
      const int x = p.x + i % kPacketSide, y = p.y + i / kPacketSide;
      if (!((p.on_terrain | p.on_object) >> i & 1) || x >= patch.width || y >= patch.height) continue;
      const double v = points.v[i], w = points.w[i], u = 1 - v - w;
      // Skip rocks that stand where the mesh has no ground: their barycentric coordinates are invalid.
      constexpr double kOutside = -1e-6;
      if (!(u >= kOutside && v >= kOutside && w >= kOutside)) continue;
      const dem::Triangle t = mesh.triangle(points.triangle[i]);
      sag_m[static_cast<std::size_t>(y) * static_cast<std::size_t>(patch.width) + static_cast<std::size_t>(x)] =
          u * t.a.norm() + v * t.b.norm() + w * t.c.norm() - (u * t.a + v * t.b + w * t.c).norm();
    }
  }

  // Adds the sag to the heights of a patch.
  void lift(const Patch& patch, const std::vector<double>& sag_m) {
    for (int row = 0; row < patch.height; ++row) {
      const double* sag = &sag_m[static_cast<std::size_t>(row) * static_cast<std::size_t>(patch.width)];
      double* height = &out_.products.height[(static_cast<std::size_t>(patch.y) + static_cast<std::size_t>(row)) *
                                                 static_cast<std::size_t>(request_.grid.width) +
                                             static_cast<std::size_t>(patch.x)];
      for (int column = 0; column < patch.width; ++column) height[column] += sag[column];
    }
  }

  // Sets a packet's rays: straight down at its pixels. Lanes off the patch or off the Moon are invalid.
  static void aim(const Patch& patch, const PatchDirections& directions, RayPass::Packet& p) {
    for (int i = 0; i < kPacket; ++i) {
      const int x = p.x + i % kPacketSide, y = p.y + i / kPacketSide;
      const bool inside = x < patch.width && y < patch.height;
      const Vec3 up = inside ? directions.up[static_cast<std::size_t>(y) * static_cast<std::size_t>(patch.width) +
                                             static_cast<std::size_t>(x)]
                             : directions.middle;
      const bool moon = !up.has_nan();
      p.rays.set(i, (moon ? up : directions.middle) * (kMoonRadius_m + kFarAway_m), moon ? -up : -directions.middle);
      p.rays.valid[i] = inside && moon;
    }
  }

  // Turns the packet's rays to the viewer's direction, for radiance. Returns the lanes that terrain hides from the
  // viewer, one bit each.
  std::uint32_t turn_to_viewer(const Scene& scene, RayPass::Packet& p) const {
    if (!request_.toward_viewer || !(p.sample.weight > 0) || p.on_terrain == 0) return 0;
    const Vec3& toward = *request_.toward_viewer;
    const std::uint32_t hidden = shaded(scene, p.points, p.on_terrain, toward);
    for (int i = 0; i < kPacket; ++i) {
      if (!(p.on_terrain & ~hidden & 1U << i)) continue;
      p.rays.dx[i] = -toward.x();
      p.rays.dy[i] = -toward.y();
      p.rays.dz[i] = -toward.z();
      p.shading.mu[i] = p.shading.normal(i).dot(toward);
    }
    return hidden;
  }

  // Returns the numbers of a patch's sources in the map's list. New sources are appended; finish() sorts the list.
  std::vector<std::uint16_t> numbers_of(const std::vector<dem::SourceIndex>& sources) {
    std::vector<std::uint16_t> numbers;
    for (const dem::SourceIndex source : sources) {
      const auto at = std::find(sources_.begin(), sources_.end(), source);
      numbers.push_back(static_cast<std::uint16_t>(at - sources_.begin()));
      if (at != sources_.end()) continue;
      if (sources_.size() >= FrameSources::kNone)
        throw TooMuchTerrain("the map has more sources than its product 'source' can tell apart");
      sources_.push_back(source);
    }
    return numbers;
  }

  // Copies the pixels with data from a patch to the map.
  void copy(const Patch& patch, const PatchDirections& directions, const FrameProducts& drawn,
            const std::vector<std::uint16_t>& numbers) {
    in_parallel_pieces(static_cast<std::size_t>(patch.height), 8, [&](std::size_t first, std::size_t past_last) {
      std::size_t from = first * static_cast<std::size_t>(patch.width);
      for (std::size_t row = first; row < past_last; ++row) {
        std::size_t to = (static_cast<std::size_t>(patch.y) + row) * static_cast<std::size_t>(request_.grid.width) +
                         static_cast<std::size_t>(patch.x);
        for (int column = 0; column < patch.width; ++column, ++from, ++to)
          if (!std::isnan(drawn.position[3 * from])) copy_pixel(drawn, from, directions.up[from], numbers, to);
      }
    });
  }

  // Copies one pixel's products, and derives its height and slope.
  void copy_pixel(const FrameProducts& drawn, std::size_t from, const Vec3& up,
                  const std::vector<std::uint16_t>& numbers, std::size_t to) {
    FrameProducts& out = out_.products;
    const auto copy_array = [&](const auto& array, auto& into) {
      if (into.empty() || array.empty()) return;
      const std::size_t components = into.size() / pixel_count();
      std::copy_n(&array[components * from], components, &into[components * to]);
    };
    const auto arrays = all_arrays(drawn);
    const auto into = all_arrays(out);
    [&]<std::size_t... i>(std::index_sequence<i...>) { (copy_array(std::get<i>(arrays), std::get<i>(into)), ...); }
    (std::make_index_sequence<std::tuple_size_v<decltype(into)>>());
    if (!out.source.empty() && out.source[to] != FrameSources::kNone) out.source[to] = numbers[out.source[to]];
    if (!out.height.empty()) out.height[to] = Vec3(&drawn.position[3 * from]).norm() - kMoonRadius_m;
    if (out.slope.empty()) return;
    const Vec3 normal = Vec3f(&drawn.normal[3 * from]).cast<double>();
    out.slope[to] = static_cast<float>(angle_between(normal, up) * kDegreesPerRadian);
  }

  // Merges a patch's errors and sizes into the map's report.
  void report(const Selection& selection, const Scene& scene) {
    FrameReport& r = out_.report;
    r.lod_error_px = std::max(r.lod_error_px, selection.error_px);
    r.lod_error_m = std::max(r.lod_error_m, selection.error_m);
    r.expected_error_px = std::max(r.expected_error_px, selection.expected_error_px);
    r.expected_error_m = std::max(r.expected_error_m, selection.expected_error_m);
    r.detail_error_px = std::max(r.detail_error_px, selection.detail_error_px);
    r.detail_limit_px = std::max(r.detail_limit_px, selection.detail_limit_px);
    r.shadow_error_px = std::max(r.shadow_error_px, selection.shadow_error_px);
    r.shadow_limits_px[0] = std::max(r.shadow_limits_px[0], selection.shadow_limit_px);
    if (selection.max_spacing_m > 0) r.min_post_spacing_m = std::min(r.min_post_spacing_m, selection.min_spacing_m);
    r.max_post_spacing_m = std::max(r.max_post_spacing_m, selection.max_spacing_m);
    r.triangles += scene.triangles;
    r.scene_bytes = std::max(r.scene_bytes, scene.bytes);
    replaced_.insert(replaced_.end(), selection.replaced.begin(), selection.replaced.end());
  }

  // Sorts the list of sources into the catalogue's order, as in frames, and renumbers the product "source".
  void sort_sources() {
    std::vector<dem::SourceIndex> sorted = sources_;
    std::sort(sorted.begin(), sorted.end());
    std::vector<std::uint16_t> rank;
    for (const dem::SourceIndex source : sources_)
      rank.push_back(
          static_cast<std::uint16_t>(std::lower_bound(sorted.begin(), sorted.end(), source) - sorted.begin()));
    for (std::uint16_t& number : out_.products.source)
      if (number != FrameSources::kNone) number = rank[number];
    for (const dem::SourceIndex source : sorted)
      out_.report.sources.push_back(source_tile(context_.terrain.catalogue().rasters()[source]));
  }

  // Completes the report from the sums over all patches.
  Map finish() {
    FrameReport& r = out_.report;
    sort_sources();
    const auto pixels = static_cast<double>(pixel_count());
    r.hit_fraction = static_cast<double>(hit_) / pixels;
    r.missing_fraction = static_cast<double>(missing_) / pixels;
    r.filled_fraction = static_cast<double>(filled_) / pixels;
    r.blended_fraction = static_cast<double>(blended_) / pixels;
    if (!std::isfinite(r.min_post_spacing_m)) r.min_post_spacing_m = 0;
    r.visibility = Visibility::raytrace;
    r.radiance = radiance_;
    r.emits_elsewhere = !frame_.temperature_maps.empty();
    r.lit = any_lit(out_.products.radiance);
    std::sort(replaced_.begin(), replaced_.end());
    replaced_.erase(std::unique(replaced_.begin(), replaced_.end()), replaced_.end());
    r.warnings = dem::warnings_about(context_.terrain.catalogue(), replaced_);
    return std::move(out_);
  }

  const MapRequest& request_;
  const RenderContext& context_;
  const MapProgress& progress_;
  FrameRequest frame_;  // request of the frame that a patch is drawn as
  RadianceTerms radiance_;
  bool drops_scenes_ = false;
  std::size_t drawn_ = 0;                                           // pixels of finished patches
  std::uint64_t hit_ = 0, missing_ = 0, filled_ = 0, blended_ = 0;  // pixels, over all patches
  std::vector<dem::SourceIndex> sources_, replaced_;
  Map out_;
};

}  // namespace

Map render_map(const MapRequest& request, const RenderContext& context, const MapProgress& progress) {
  if (!wants_footprint(request)) return MapDrawing(request, context, progress).draw();
  const MapRequest drawn = request_with_margin(request);
  Map map = MapDrawing(drawn, context, progress).draw();
  for (std::string& warning : find_hazards(request, drawn, map.products, context.stop))
    map.report.warnings.push_back(std::move(warning));
  return map;
}

}  // namespace selenograph::engine
