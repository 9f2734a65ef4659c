// 2 x 2 tiles of the sample terrain at 30 m posts, made once for a suite of tests.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "dem/sample/sample_terrain.h"
#include "tests/support/frame_judge.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {

class SampleScenery : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    dem::SampleOptions options;
    options.south_deg = -11, options.west_deg = 43, options.rows = 2, options.columns = 2;
    options.posts_per_degree = 1024;
    dem::write_sample_terrain(folder_->path(), options);
    scenery_ = new Scenery(folder_->path());
  }
  static void TearDownTestSuite() {
    delete scenery_;
    delete folder_;
    scenery_ = nullptr, folder_ = nullptr;
  }
  static std::string folder() { return folder_->path(); }
  static const Scenery& scenery() { return *scenery_; }

 private:
  static inline TemporaryFolder* folder_ = nullptr;
  static inline Scenery* scenery_ = nullptr;
};

}  // namespace selenograph::test
