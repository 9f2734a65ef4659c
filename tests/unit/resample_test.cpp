#include "engine/verify/resample.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <vector>

namespace selenograph::engine {
namespace {

constexpr int kAcross = 40, kDown = 30;
constexpr PostRectangle kPosts{100, 200, 25, 20};

double plane(double x, double y) { return 12.5 + 3.25 * x - 1.75 * y; }

// Pixels turned against the posts, at another spacing, on a plane that starts beyond the first post.
std::vector<SeenPoint> turned(double spacing) {
  std::vector<SeenPoint> points;
  const double turn = 0.2, c = std::cos(turn), s = std::sin(turn);
  for (int r = 0; r < kDown; ++r)
    for (int col = 0; col < kAcross; ++col) {
      const double u = spacing * (col - kAcross / 2.0), v = spacing * (r - kDown / 2.0);
      const double x = 112 + c * u - s * v, y = 209.5 + s * u + c * v;
      points.push_back({x, y, plane(x, y)});
    }
  return points;
}

std::size_t covered(const std::vector<double>& heights) {
  std::size_t count = 0;
  for (const double h : heights) count += !std::isnan(h);
  return count;
}

TEST(Resample, APlaneIsExact) {
  for (const double spacing : {0.31, 0.97, 1.0}) {
    const std::vector<double> heights = resample(turned(spacing), kAcross, kDown, kPosts, 4, 4);
    ASSERT_EQ(heights.size(), 500u);
    EXPECT_GT(covered(heights), 40u);
    for (int r = 0; r < kPosts.height; ++r)
      for (int c = 0; c < kPosts.width; ++c) {
        const double h = heights[static_cast<std::size_t>(r * kPosts.width + c)];
        if (!std::isnan(h)) {
          EXPECT_NEAR(h, plane(kPosts.x0 + c, kPosts.y0 + r), 1e-10);
        }
      }
  }
}

TEST(Resample, NoPostWithinIsLeftOut) {
  const std::vector<double> heights = resample(turned(1.3), kAcross, kDown, kPosts, 4, 4);
  EXPECT_EQ(covered(heights), heights.size());
}

// Posts that pixels meet exactly lie on the corners of six triangles, and belong to at least one.
TEST(Resample, PixelsOnPostsGiveTheirOwnHeights) {
  std::vector<SeenPoint> points;
  for (int r = 0; r < kDown; ++r)
    for (int c = 0; c < kAcross; ++c) points.push_back({98.0 + c, 195.0 + r, std::sin(7.0 * r + 3.0 * c)});
  const std::vector<double> heights = resample(points, kAcross, kDown, kPosts, 4, 4);
  for (int r = 0; r < kPosts.height; ++r)
    for (int c = 0; c < kPosts.width; ++c)
      EXPECT_DOUBLE_EQ(heights[static_cast<std::size_t>(r * kPosts.width + c)],
                       std::sin(7.0 * (r + 5) + 3.0 * (c + 2)));
}

TEST(Resample, NothingIsMadeUpAcrossAGapOrAFold) {
  const auto with = [](auto&& change) {
    std::vector<SeenPoint> points;
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 6; ++c) points.push_back(change(SeenPoint{c - 0.5, r - 0.5, 1.0}, c));
    return covered(resample(points, 6, 4, {0, 0, 5, 3}, 3, 3));
  };
  EXPECT_EQ(with([](SeenPoint p, int) { return p; }), 15u);
  // Columns from 3 on are seen five posts farther on: posts 2.. have nothing but the gap's planes.
  EXPECT_EQ(with([](SeenPoint p, int c) { return c < 3 ? p : SeenPoint{p.x + 5, p.y, p.height_m}; }), 6u);
  EXPECT_EQ(with([](SeenPoint p, int) { return SeenPoint{4 - p.x, p.y, p.height_m}; }), 0u);
  EXPECT_EQ(with([](SeenPoint p, int c) { return c != 2 ? p : SeenPoint{NAN, NAN, NAN}; }), 9u);
}

TEST(Resample, StopsAtTheDeadline) {
  const std::vector<SeenPoint> pixels(4);
  EXPECT_THROW(resample(pixels, 2, 2, {0, 0, 1, 1}, 1, 1, StopToken(std::chrono::steady_clock::now())), Cancelled);
}

}  // namespace
}  // namespace selenograph::engine
