// Normals that go over to those of a coarser level: the same on common edges, their own where nothing is coarser.
#include "engine/scene/soft_normals.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>
#include <vector>

namespace selenograph::engine {
namespace {

constexpr int kSide = 65;
constexpr Corners kSouthEast = 0x0C, kNorthWest = 0x30, kNorthEast = 0xC0, kAll = 0xFF;

std::size_t at(int r, int c) { return static_cast<std::size_t>(r * kSide + c); }

std::vector<dem::Vertex> any_vertices(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> slope(0, 0.2F);
  std::vector<dem::Vertex> vertices;
  for (int i = 0; i < kSide * kSide; ++i)
    vertices.push_back({1, Eigen::Vector3f(slope(random), slope(random), 1).normalized()});
  return vertices;
}

bool same(const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
  return std::memcmp(a.data(), b.data(), 3 * sizeof(float)) == 0;
}

TEST(SoftNormals, StayAsTheyAreWithoutASoftCorner) {
  const std::vector<dem::Vertex> before = any_vertices(1);
  std::vector<dem::Vertex> after = before;
  soften_normals(after, kSide, 0);
  for (std::size_t i = 0; i < before.size(); ++i) EXPECT_TRUE(same(before[i].normal, after[i].normal));
}

TEST(SoftNormals, AgreeOnCommonEdges) {
  for (const bool beside : {false, true}) {  // or one north of the other
    std::vector<dem::Vertex> first = any_vertices(2), second = any_vertices(3);
    const auto on = [&](int i, bool of_first) {
      return beside ? at(i, of_first ? kSide - 1 : 0) : at(of_first ? kSide - 1 : 0, i);
    };
    for (int i = 0; i < kSide; ++i) second[on(i, false)] = first[on(i, true)];
    // The coarser level is at one end of the edge, and at a corner of the second block that the first one lacks.
    soften_normals(first, kSide, kNorthEast);
    soften_normals(second, kSide, beside ? kNorthWest | kSouthEast : kSouthEast | kNorthWest);
    for (int i = 0; i < kSide; ++i) EXPECT_TRUE(same(first[on(i, true)].normal, second[on(i, false)].normal)) << i;
  }
}

// Largest slope of a wave so many vertices long, in the middle of the block.
double left_of_wave(double vertices_long, Corners smooth) {
  std::vector<dem::Vertex> vertices = any_vertices(4);
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c)
      vertices[at(r, c)].normal =
          Eigen::Vector3f(0.01F * std::cos(2 * static_cast<float>(M_PI * c / vertices_long)), 0, 1).normalized();
  soften_normals(vertices, kSide, smooth);
  float most = 0;
  for (int c = kSide / 2 - 8; c <= kSide / 2 + 8; ++c) most = std::max(most, vertices[at(kSide / 2, c)].normal.x());
  return static_cast<double>(most) / 0.01;
}

TEST(SoftNormals, LoseWhatTheCoarserLevelLacks) {
  const auto left = [](double w) { return std::pow(std::cos(w / 2) * std::cos(w), 4); };
  for (const double vertices : {4.0, 8.0, 16.0, 32.0})
    EXPECT_NEAR(left_of_wave(vertices, kAll), left(2 * M_PI / vertices), 0.01) << vertices;
  EXPECT_GT(left_of_wave(32, kAll), 0.9);
  // Halfway from a coarser level.
  EXPECT_NEAR(left_of_wave(4, kNorthWest | kNorthEast), 0.5, 0.03);
  // A third at all corners: two blocks from a coarser level.
  EXPECT_NEAR(left_of_wave(4, 0x55), 2.0 / 3, 0.03);
}

TEST(SoftNormals, AreTheirOwnAtSharpCornersAndAlongSharpEdges) {
  const std::vector<dem::Vertex> before = any_vertices(5);
  std::vector<dem::Vertex> after = before;
  soften_normals(after, kSide, kNorthWest | kNorthEast);
  int changed = 0;
  for (int c = 0; c < kSide; ++c) {
    EXPECT_TRUE(same(before[at(0, c)].normal, after[at(0, c)].normal)) << c;
    changed += !same(before[at(kSide - 2, c)].normal, after[at(kSide - 2, c)].normal);
    EXPECT_NEAR(after[at(kSide / 2, c)].normal.norm(), 1, 1e-6);
  }
  EXPECT_EQ(changed, kSide);
}

}  // namespace
}  // namespace selenograph::engine
