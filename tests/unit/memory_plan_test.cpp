#include "server/service/memory_plan.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <stdexcept>

namespace selenograph::server {
namespace {

constexpr std::size_t kMachineMb = 65536;

TEST(MemoryPlan, PartsMakeTheWhole) {
  const MemoryPlan plan =
      plan_memory({.memory_mb = 4096, .cache_mb = 1024, .scene_mb = 512, .mesh_mb = 256}, kMachineMb);
  EXPECT_EQ(plan.total_mb, 4096U);
  EXPECT_EQ(plan.requests_mb, 4096 - 1024 - 512 - 256 - kOwnMb);
}

TEST(MemoryPlan, TooLittleIsAnErrorThatNamesTheOptions) {
  try {
    require_memory_for_requests(
        plan_memory({.memory_mb = 1024, .cache_mb = 512, .scene_mb = 512, .mesh_mb = 100}, kMachineMb));
    FAIL();
  } catch (const std::runtime_error& e) {
    for (const char* option : {"--memory-mb 1024", "--cache-mb 512", "--scene-mb 512", "--mesh-mb 100"})
      EXPECT_NE(std::string(e.what()).find(option), std::string::npos) << e.what();
  }
  EXPECT_THROW(require_memory_for_requests(plan_memory({}, 600)), std::runtime_error);
}

TEST(MemoryPlan, WithoutOptionsItFollowsTheMachine) {
  const MemoryPlan large = plan_memory({}, kMachineMb);
  EXPECT_EQ(large.total_mb, 8192U);
  EXPECT_EQ(large.scene_mb, 1024U);
  EXPECT_EQ(large.cache_mb, 960U);
  EXPECT_EQ(large.mesh_mb, 960U);
  // A request of the default limits, all products, whose answer is as large: 16 Mi pixels of 106 bytes, twice, and what
  // the frame is rendered with.
  EXPECT_GT(large.requests_mb, std::size_t{16} * (106 + 106));
  // A control group's limit is kept, however small.
  for (const std::size_t machine_mb : {1000, 1024, 1536, 2048, 4096, 8192, 16384}) {
    const MemoryPlan plan = plan_memory({}, machine_mb);
    EXPECT_LE(plan.total_mb, machine_mb / 4 * 3);
    EXPECT_GE(plan.requests_mb, (plan.total_mb - kOwnMb) / 8 * 3);
    EXPECT_GE(plan.scene_mb, plan.cache_mb);
    EXPECT_NO_THROW(require_memory_for_requests(plan)) << machine_mb;
  }
}

TEST(MemoryPlan, GivenOptionsAreKept) {
  const MemoryPlan of_total = plan_memory({.memory_mb = 2048}, kMachineMb);
  EXPECT_EQ(of_total.total_mb, 2048U);
  EXPECT_EQ(of_total.scene_mb, 3 * 192U);
  EXPECT_EQ(of_total.cache_mb, 192U);
  const MemoryPlan of_small = plan_memory({.scene_mb = 256}, 2048);
  EXPECT_EQ(of_small.total_mb, 1536U);
  EXPECT_EQ(of_small.scene_mb, 256U);
  EXPECT_EQ(of_small.cache_mb, 96U);
  // The whole grows with what is asked for, to three quarters of what there is.
  EXPECT_EQ(plan_memory({.cache_mb = 20000}, kMachineMb).total_mb, 40000 + kOwnMb);
  EXPECT_EQ(plan_memory({.cache_mb = 20000}, 16384).total_mb, 12288U);
  EXPECT_THROW(require_memory_for_requests(plan_memory({.cache_mb = 20000}, 16384)), std::runtime_error);
  // More than the machine has is taken at its word.
  EXPECT_EQ(plan_memory({.memory_mb = 8192}, 1024).total_mb, 8192U);
}

TEST(MemoryPlan, ThisMachineHasMemory) {
  EXPECT_GT(machine_memory_mb(), 64U);
  EXPECT_LT(machine_memory_mb(), std::size_t{1} << 30);
}

TEST(MemoryPlan, ALimitOfAddressesIsAMachineOfThatSize) {
  rlimit was{};
  ASSERT_EQ(::getrlimit(RLIMIT_AS, &was), 0);
  const std::size_t half_mb = machine_memory_mb() / 2;
  const rlimit half{static_cast<rlim_t>(half_mb) << 20, was.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_AS, &half), 0);
  EXPECT_EQ(machine_memory_mb(), half_mb);
  ASSERT_EQ(::setrlimit(RLIMIT_AS, &was), 0);
}

}  // namespace
}  // namespace selenograph::server
