// A sphere without relief as a mesh of a few blocks: every triangle's place is known.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "engine/scene/mesh.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {

// Blocks of level 5 around 4 degrees north, 22 degrees east.
class SphereMesh : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    write_global_tile(*folder_ / "dem", 4, [](double, double) { return 0.0; });
    terrain_ = open_terrain(*folder_ / "dem");
    std::vector<dem::BlockId> blocks;
    for (const double lat : {3.0, 5.0})
      for (const double lon : {21.0, 23.0})
        blocks.push_back(dem::block_at(5, static_cast<dem::Tick>(std::lround((lat + 90) * dem::kTicksPerDegree)),
                                       dem::wrap_lon(std::llround((lon + 180) * dem::kTicksPerDegree))));
    std::sort(blocks.begin(), blocks.end());
    blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
    mesh_ = std::make_unique<engine::Mesh>(*terrain_, blocks);
  }
  static void TearDownTestSuite() {
    mesh_.reset();
    terrain_.reset();
    delete folder_;
  }
  static const engine::Mesh& mesh() { return *mesh_; }

  // Returns the point of a triangle with the weights v and w of its second and third vertex.
  static Vec3 place_on(const engine::TriangleId& id, double v, double w) {
    const dem::Triangle t = mesh().triangle(id);
    return t.a + v * (t.b - t.a) + w * (t.c - t.a);
  }

 private:
  static inline TemporaryFolder* folder_ = nullptr;
  static inline std::shared_ptr<dem::PyramidTerrain> terrain_;
  static inline std::unique_ptr<engine::Mesh> mesh_;
};

}  // namespace selenograph::test
