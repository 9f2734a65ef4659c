#include "engine/verify/resample.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace selenograph::engine {
namespace {

// A post on an edge shared by two triangles belongs to both, whatever the rounding.
constexpr double kOnEdge = 1e-9;

// Heights of a rectangle of posts, filled by triangles.
class PostGrid {
 public:
  PostGrid(const PostRectangle& posts, double widest_x, double widest_y)
      : posts_(posts),
        widest_x_(widest_x),
        widest_y_(widest_y),
        heights_(static_cast<std::size_t>(posts.width) * static_cast<std::size_t>(posts.height),
                 std::numeric_limits<double>::quiet_NaN()) {}

  // Sets the posts within a triangle, unless it spans hidden ground. Vertices are clockwise in the image.
  void add(const SeenPoint& a, const SeenPoint& b, const SeenPoint& c) {
    const auto [left, right] = std::minmax({a.x, b.x, c.x});
    const auto [top, bottom] = std::minmax({a.y, b.y, c.y});
    // The comparison is also false for NaN, a pixel without ground.
    if (!(right - left <= widest_x_ && bottom - top <= widest_y_)) return;
    const double area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    if (!(area > 0)) return;
    const int first_x = std::max(posts_.x0, ceiling(left)),
              last_x = std::min(posts_.x0 + posts_.width - 1, floor(right));
    const int first_y = std::max(posts_.y0, ceiling(top)),
              last_y = std::min(posts_.y0 + posts_.height - 1, floor(bottom));
    for (int y = first_y; y <= last_y; ++y)
      for (int x = first_x; x <= last_x; ++x) {
        const double v = ((x - a.x) * (c.y - a.y) - (y - a.y) * (c.x - a.x)) / area;
        const double w = ((b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)) / area;
        if (v < -kOnEdge || w < -kOnEdge || v + w > 1 + kOnEdge) continue;
        heights_[static_cast<std::size_t>(y - posts_.y0) * static_cast<std::size_t>(posts_.width) +
                 static_cast<std::size_t>(x - posts_.x0)] =
            a.height_m + v * (b.height_m - a.height_m) + w * (c.height_m - a.height_m);
      }
  }

  std::vector<double> take() { return std::move(heights_); }

 private:
  static int ceiling(double x) { return static_cast<int>(std::ceil(std::clamp(x - kOnEdge, -1e9, 1e9))); }
  static int floor(double x) { return static_cast<int>(std::floor(std::clamp(x + kOnEdge, -1e9, 1e9))); }

  PostRectangle posts_;
  double widest_x_, widest_y_;
  std::vector<double> heights_;
};

}  // namespace

std::vector<double> resample(std::span<const SeenPoint> pixels, int width, int height, const PostRectangle& posts,
                             double widest_x, double widest_y, const StopToken& stop) {
  PostGrid grid(posts, widest_x, widest_y);
  const auto at = [&](int r, int c) -> const SeenPoint& {
    return pixels[static_cast<std::size_t>(r) * static_cast<std::size_t>(width) + static_cast<std::size_t>(c)];
  };
  for (int r = 0; r + 1 < height; ++r) {
    stop.check();
    for (int c = 0; c + 1 < width; ++c) {
      const SeenPoint &nw = at(r, c), &ne = at(r, c + 1), &sw = at(r + 1, c), &se = at(r + 1, c + 1);
      // Use the mesh's own diagonals, from north-west to south-east.
      grid.add(nw, ne, se);
      grid.add(nw, se, sw);
    }
  }
  return grid.take();
}

}  // namespace selenograph::engine
