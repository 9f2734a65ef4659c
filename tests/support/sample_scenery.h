// 2 x 2 tiles of the sample terrain with posts 30 m apart. Under ctest, SELENOGRAPH_TEST_SCENERY names a folder with
// `dem` and `cache` that is made once for all tests; without it, each suite writes its own tiles.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

#include "dem/sample/sample_terrain.h"
#include "tests/support/frame_judge.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {

class SampleScenery : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (const char* ready = std::getenv("SELENOGRAPH_TEST_SCENERY")) {
      tiles_ = std::string(ready) + "/dem";
      scenery_ = new Scenery(tiles_, std::string(ready) + "/cache");
      return;
    }
    folder_ = new TemporaryFolder;
    dem::SampleOptions options;
    options.south_deg = -11;
    options.west_deg = 43;
    options.rows = 2;
    options.columns = 2;
    options.posts_per_degree = 1024;
    tiles_ = folder_->path();
    dem::write_sample_terrain(tiles_, options);
    scenery_ = new Scenery(tiles_);
  }
  static void TearDownTestSuite() {
    delete scenery_;
    delete folder_;
    scenery_ = nullptr;
    folder_ = nullptr;
  }
  static std::string folder() { return tiles_; }
  static const Scenery& scenery() { return *scenery_; }

 private:
  static inline std::string tiles_;
  static inline TemporaryFolder* folder_ = nullptr;
  static inline Scenery* scenery_ = nullptr;
};

}  // namespace selenograph::test
