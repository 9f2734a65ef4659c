#include "engine/verify/round_trip.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "dem/base/error.h"
#include "dem/grid/rotation.h"
#include "engine/rays/ray_queries.h"
#include "engine/verify/resample.h"

namespace selenograph::engine {
namespace {

// Half the field of view of a camera, along its rows or columns, as ordinary cameras have.
constexpr double kHalfAngle_deg = 15;
// Largest number of posts along a side of a frame, for frames of ordinary size.
constexpr int kMaxPostsPerFrame = 1000;
constexpr std::size_t kRaysAtOnce = 65536;  // rays of one query
// Pixels outside the outermost posts, so that these lie between pixels.
constexpr int kMargin_px = 2;
constexpr std::int64_t kMaxPixels = std::int64_t{1} << 25;
// A triangle between pixels whose ground is this many footprints apart spans hidden ground. Tilt alone stretches
// visible ground less: 20 degrees off the vertical, a slope of 60 degrees facing away spans 2.7 footprints per pixel.
constexpr double kMaxStretch = 4;

// Returns the finest tile at the request's place, and its index in the catalogue.
const dem::RasterInfo& finest_tile(const dem::Catalogue& catalogue, const RoundTripRequest& request, int& index) {
  const std::vector<int> found = catalogue.touching(request.lat_deg, request.lat_deg, request.lon_deg, request.lon_deg);
  if (found.empty())
    throw ImpossibleRequest(
        fmt::format("no tile holds latitude {}, longitude {} degrees", request.lat_deg, request.lon_deg));
  index = found.back();
  const dem::RasterInfo& tile = catalogue.rasters()[static_cast<std::size_t>(index)];
  if (tile.projection() != dem::Projection::geographic)
    throw ImpossibleRequest(tile.name + " is not in geographic coordinates: round trips are for tiles that are");
  return tile;
}

// Returns the window of posts around the request's place.
PostWindow window_around(const dem::RasterInfo& tile, const RoundTripRequest& request) {
  const auto centre = dem::locate(tile, request.lat_deg, request.lon_deg);
  // If x is periodic, a window may continue at the tile's other end; a window of all columns begins with the first.
  const auto first = [](double at, int size, int count, bool periodic) {
    const int centred = static_cast<int>(std::lround(at)) - count / 2;
    return periodic && count < size ? centred : std::clamp(centred, 0, size - count);
  };
  PostWindow w{tile};
  w.width = request.posts > 0 ? std::min(request.posts, tile.width) : tile.width;
  w.height = request.posts > 0 ? std::min(request.posts, tile.height) : tile.height;
  w.x0 = first(centre.x, tile.width, w.width, tile.wraps_longitude);
  w.y0 = first(centre.y, tile.height, w.height, false);
  return w;
}

// Returns a pose looking straight down, image up to the north: +x east, +y south, +z down.
Pose looking_down(const Vec3& position) {
  const EastNorthUp local = local_axes(position);
  return {position, Quat(Mat3::from_rows(local.east, -local.north, -local.up)).normalized()};
}

// Rows and columns [r0, r1) x [c0, c1) of a window, which are seen from one camera position.
struct Patch {
  int r0, c0, r1, c1;
};

// Bounds of the slopes x/z and y/z under which a camera sees a patch.
struct Slopes {
  double left = INFINITY, right = -INFINITY, top = INFINITY, bottom = -INFINITY;
  void add(const Vec3& in_camera) {
    const double x = in_camera.x() / in_camera.z(), y = in_camera.y() / in_camera.z();
    left = std::min(left, x);
    right = std::max(right, x);
    top = std::min(top, y);
    bottom = std::max(bottom, y);
  }
};

// Compares the posts of a window, patch by patch, with what the engine shows of them.
class Comparison {
 public:
  Comparison(const Renderer& renderer, const RoundTripRequest& request, const Progress& progress, const StopToken& stop)
      : renderer_(renderer), request_(request), progress_(progress), stop_(stop) {
    const dem::Catalogue& catalogue = renderer.terrain().catalogue();
    out_.window = window_around(finest_tile(catalogue, request, tile_index_), request);
    read_original(catalogue);
    find_other_layers(catalogue);
  }

  RoundTrip run() {
    if (request_.mode == RoundTripMode::camera) out_.pixel_footprint_m = request_.footprint_ratio * spacing_m();
    const std::vector<Patch> patches = this->patches();
    for (std::size_t i = 0; i < patches.size(); ++i) {
      stop_.check();
      request_.mode == RoundTripMode::exact ? cast_through_posts(patches[i]) : photograph(patches[i]);
      if (progress_) progress_(static_cast<double>(i + 1) / static_cast<double>(patches.size()));
    }
    send();
    return std::move(out_);
  }

 private:
  double spacing_m() const { return out_.window.tile.post_spacing_m; }

  // Reads the tile's heights from the file and applies the catalogue's offset.
  void read_original(const dem::Catalogue& catalogue) {
    const PostWindow& w = out_.window;
    dem::Raster raster(w.tile);
    out_.original_m.resize(w.size());
    raster.read(w.x0, w.y0, w.width, w.height, out_.original_m.data());
    if (const double offset_m = catalogue.offset_m(tile_index_); offset_m != 0)
      for (float& height_m : out_.original_m) height_m = static_cast<float>(static_cast<double>(height_m) + offset_m);
    out_.difference_m.assign(w.size(), std::numeric_limits<float>::quiet_NaN());
  }

  // Sets other_layers_ if a finer tile is near enough to cover the window or to blend into it. Only then is the source
  // checked at every post, which is slow.
  void find_other_layers(const dem::Catalogue& catalogue) {
    const PostWindow& w = out_.window;
    const Geographic first = w.place(0, 0), last = w.place(w.height - 1, w.width - 1);
    const double east = last.lon_deg < first.lon_deg ? last.lon_deg + 360 : last.lon_deg;
    const double band_deg = catalogue.joins().blend_posts * spacing_m() / kMetresPerDegree;
    const double narrowest =
        std::max(0.05, std::cos(std::max(std::abs(first.lat_deg), std::abs(last.lat_deg)) * kRadiansPerDegree));
    const std::vector<int> near =
        catalogue.touching(last.lat_deg, first.lat_deg, first.lon_deg, east, 1e-3 + band_deg / narrowest);
    other_layers_ = !near.empty() && near.back() > tile_index_;
  }

  // Divides the window into patches that are about square on the ground.
  std::vector<Patch> patches() const {
    const PostWindow& w = out_.window;
    const double side_m = 2 * std::tan(kHalfAngle_deg * kRadiansPerDegree) * request_.height_m;
    const double rows = std::min(side_m / spacing_m(), static_cast<double>(kMaxPostsPerFrame));
    if (request_.mode == RoundTripMode::camera && side_m < 8 * out_.pixel_footprint_m)
      throw ImpossibleRequest(fmt::format("cameras at {} m see less than 8 pixels of {:.3g} m: give a larger height",
                                          request_.height_m, out_.pixel_footprint_m),
                              "height_m");
    const Geographic middle = w.place(w.height / 2, w.width / 2);
    // Posts are closer along a parallel than along a meridian: a square patch has more columns than rows.
    const double narrower = std::max(0.05, std::cos(middle.lat_deg * kRadiansPerDegree));
    const int high = std::max(1, static_cast<int>(rows));
    int wide = std::max(1, static_cast<int>(rows / narrower));
    // Keep a patch off the opposite meridian, where x jumps.
    if (w.tile.wraps_longitude) wide = std::min(wide, w.tile.width / 2);
    std::vector<Patch> patches;
    for (int r = 0; r < w.height; r += high)
      for (int c = 0; c < w.width; c += wide)
        patches.push_back({r, c, std::min(r + high, w.height), std::min(c + wide, w.width)});
    return patches;
  }

  // Returns the camera position above the middle of a patch, and counts it.
  Vec3 camera_above(const Patch& p) {
    const PostWindow& w = out_.window;
    const Geographic nw = w.place(p.r0, p.c0), se = w.place(p.r1 - 1, p.c1 - 1);
    const double east = se.lon_deg < nw.lon_deg ? se.lon_deg + 360 : se.lon_deg;
    Geographic g{(nw.lat_deg + se.lat_deg) / 2, (nw.lon_deg + east) / 2, 0};
    const double ground = renderer_.terrain().height(g.lat_deg, g.lon_deg, stop_).height_m;
    g.height_m = (std::isnan(ground) ? 0 : ground) + request_.height_m;
    ++out_.stations;
    return to_cartesian(g);
  }

  // Returns whether a post shows the tile's own value; counts the posts that do not.
  bool comparable(int row, int col) {
    if (std::isnan(out_.original_m[out_.window.index(row, col)])) {
      ++out_.voids;
      return false;
    }
    if (!other_layers_) return true;
    const Geographic g = out_.window.place(row, col);
    const dem::HeightAnswer surface = renderer_.terrain().height(g.lat_deg, g.lon_deg, stop_);
    const bool is_own = surface.source == tile_index_ && !surface.blended;
    if (!is_own) ++out_.elsewhere;
    return is_own;
  }

  // Returns the position of a post at the file's height.
  Vec3 post(int row, int col) const {
    Geographic g = out_.window.place(row, col);
    g.height_m = static_cast<double>(out_.original_m[out_.window.index(row, col)]);
    return to_cartesian(g);
  }

  // Queues rays through the posts of a patch. Rays from several stations are sent together: a station may serve few
  // posts.
  void cast_through_posts(const Patch& p) {
    const Vec3 camera = camera_above(p);
    for (int r = p.r0; r < p.r1; ++r)
      for (int c = p.c0; c < p.c1; ++c) {
        if (!comparable(r, c)) continue;
        rays_.push_back({camera, (post(r, c) - camera).normalized()});
        aims_.push_back({r, c});
        if (rays_.size() == kRaysAtOnce) send();
      }
  }

  // Casts the queued rays and records their hits.
  void send() {
    const std::vector<RayHit> hits = renderer_.query(
        {}, stop_, [&](const RenderContext& context) { return cast_rays(rays_, {}, std::nullopt, context); });
    for (std::size_t i = 0; i < hits.size(); ++i) {
      if (hits[i].hit)
        note(aims_[i], to_geographic(hits[i].position_m));
      else
        ++out_.missed;
    }
    rays_.clear();
    aims_.clear();
  }

  struct Aim {
    int row, col;
  };

  // Records a hit; the post is hidden if the hit is nearer to a different post.
  void note(const Aim& aim, const Geographic& hit) {
    const PostWindow& w = out_.window;
    const auto at = dem::locate(w.tile, hit.lat_deg, hit.lon_deg);
    double dx = at.x - (w.x0 + aim.col);
    const double dy = at.y - (w.y0 + aim.row);
    if (w.tile.wraps_longitude) dx = std::remainder(dx, w.tile.width);
    if (std::abs(dx) > 0.5 || std::abs(dy) > 0.5)
      ++out_.hidden;
    else
      note(aim, hit.height_m);
  }

  // Records the height that was found at a post.
  void note(const Aim& aim, double height_m) {
    const std::size_t i = out_.window.index(aim.row, aim.col);
    out_.difference_m[i] = static_cast<float>(height_m - static_cast<double>(out_.original_m[i]));
    ++out_.compared;
  }

  // Renders a frame of a patch and compares it with the posts.
  void photograph(const Patch& p) {
    const Pose pose = looking_down(camera_above(p));
    Slopes slopes;
    bool has_ground = false;  // any of the patch's posts is in front of the camera
    for (int r = p.r0; r < p.r1; ++r)
      for (int c = p.c0; c < p.c1; ++c) {
        if (std::isnan(out_.original_m[out_.window.index(r, c)])) continue;
        const Vec3 in_camera = pose.camera_from_moon * (post(r, c) - pose.position_m);
        // Leave out ground close beneath the camera or above it: it would need an unbounded image. It counts as missed.
        if (in_camera.z() < 0.1 * request_.height_m) continue;
        slopes.add(in_camera);
        has_ground = true;
      }
    if (has_ground)
      compare(p, seen_by(frame_request(pose, slopes), out_.window.x0 + 0.5 * (p.c0 + p.c1 - 1)));
    else
      for (int r = p.r0; r < p.r1; ++r)
        for (int c = p.c0; c < p.c1; ++c)
          if (comparable(r, c)) ++out_.missed;
  }

  // Returns a frame whose image contains these slopes. The additive recurrence of the plastic number (Roberts 2018)
  // shifts pixels against posts from frame to frame, so that no phase between them is preferred.
  FrameRequest frame_request(const Pose& pose, const Slopes& s) const {
    FrameRequest frame;
    Camera& camera = frame.camera;
    camera.fx = camera.fy = request_.height_m / out_.pixel_footprint_m;
    const auto k = static_cast<double>(out_.stations);
    const double u = std::fmod(0.7548776662466927 * k, 1.0), v = std::fmod(0.5698402909980532 * k, 1.0);
    const double width = std::ceil((s.right - s.left) * camera.fx) + 2 * kMargin_px + 1;
    const double height = std::ceil((s.bottom - s.top) * camera.fy) + 2 * kMargin_px + 1;
    if (width * height > static_cast<double>(kMaxPixels))
      throw ImpossibleRequest(fmt::format("frames of {} x {} pixels: ask for a larger footprint", width, height),
                              "footprint_ratio");
    camera.width = static_cast<int>(width);
    camera.height = static_cast<int>(height);
    camera.cx = kMargin_px + u - s.left * camera.fx;
    camera.cy = kMargin_px + v - s.top * camera.fy;
    frame.pose = pose;
    frame.accuracy.max_error_px = request_.max_error_px;
    frame.products = kGeodetic;
    return frame;
  }

  struct SeenImage {
    int width, height;
    std::vector<SeenPoint> points;
  };

  // Renders a frame and returns its points in post coordinates. If x is periodic, the period nearest to `middle_x` is
  // used.
  SeenImage seen_by(const FrameRequest& request, double middle_x) const {
    const dem::RasterInfo& tile = out_.window.tile;
    const Frame frame = renderer_.render(request, stop_);
    const std::vector<double>& geodetic = frame.products.geodetic;
    SeenImage image{request.camera.width, request.camera.height, {}};
    image.points.reserve(geodetic.size() / 3);
    for (std::size_t i = 0; i + 2 < geodetic.size(); i += 3) {
      if (i % 3072 == 0) stop_.check();
      const auto at = dem::locate(tile, geodetic[i], geodetic[i + 1]);
      const double x = tile.wraps_longitude ? middle_x + std::remainder(at.x - middle_x, tile.width) : at.x;
      image.points.push_back({x, at.y, geodetic[i + 2]});
    }
    return image;
  }

  // Resamples a frame's points to the posts of a patch and records the differences.
  void compare(const Patch& p, const SeenImage& image) {
    const PostWindow& w = out_.window;
    const PostRectangle posts{w.x0 + p.c0, w.y0 + p.r0, p.c1 - p.c0, p.r1 - p.r0};
    const double poleward = std::max(std::abs(w.place(p.r0, p.c0).lat_deg), std::abs(w.place(p.r1 - 1, p.c0).lat_deg));
    const double widest = kMaxStretch * request_.footprint_ratio;
    const std::vector<double> heights =
        resample(image.points, image.width, image.height, posts,
                 widest / std::max(0.01, std::cos(poleward * kRadiansPerDegree)), widest, stop_);
    std::size_t i = 0;
    for (int r = p.r0; r < p.r1; ++r)
      for (int c = p.c0; c < p.c1; ++c, ++i) {
        if (!comparable(r, c)) continue;
        if (std::isnan(heights[i]))
          ++out_.missed;
        else
          note(Aim{r, c}, heights[i]);
      }
  }

  const Renderer& renderer_;
  const RoundTripRequest& request_;
  const Progress& progress_;
  const StopToken& stop_;
  int tile_index_ = -1;
  bool other_layers_ = false;
  std::vector<Ray> rays_;
  std::vector<Aim> aims_;
  RoundTrip out_;
};

}  // namespace

RoundTrip round_trip(const Renderer& renderer, const RoundTripRequest& request, const Progress& progress,
                     const StopToken& stop) {
  return Comparison(renderer, request, progress, stop).run();
}

}  // namespace selenograph::engine
