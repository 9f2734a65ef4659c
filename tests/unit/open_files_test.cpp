#include "server/service/open_files.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <stdexcept>
#include <string>

namespace selenograph::server {
namespace {

class OpenFiles : public ::testing::Test {
 protected:
  OpenFiles() { EXPECT_EQ(::getrlimit(RLIMIT_NOFILE, &before_), 0); }
  ~OpenFiles() override { ::setrlimit(RLIMIT_NOFILE, &before_); }
  rlimit before_{};
};

TEST_F(OpenFiles, TheSoftLimitIsRaisedToTheNeed) {
  const auto need = static_cast<rlim_t>(open_files_needed(16));
  const rlimit low{64, before_.rlim_max};
  ASSERT_GE(before_.rlim_max, need);
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &low), 0);
  raise_open_files_limit(16);
  rlimit now{};
  ::getrlimit(RLIMIT_NOFILE, &now);
  EXPECT_EQ(now.rlim_cur, need);
  EXPECT_EQ(now.rlim_max, before_.rlim_max);
}

TEST_F(OpenFiles, TooManyConnectionsAreRefusedWithBothFigures) {
  if (before_.rlim_max == RLIM_INFINITY) GTEST_SKIP() << "no hard limit here";
  const int connections = static_cast<int>(std::min<rlim_t>(before_.rlim_max, 1 << 24));
  try {
    raise_open_files_limit(connections);
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("--max-connections " + std::to_string(connections)), std::string::npos);
    EXPECT_NE(std::string(e.what()).find(std::to_string(before_.rlim_max)), std::string::npos);
  }
}

}  // namespace
}  // namespace selenograph::server
