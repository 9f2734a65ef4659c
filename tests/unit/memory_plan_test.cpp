#include "server/memory_plan.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <stdexcept>

#include "server/config.h"

namespace selenograph::server {
namespace {

TEST(MemoryPlan, PartsMakeTheWhole) {
  const MemorySettings settings{.memory_mb = 4096, .cache_mb = 1024, .scene_mb = 512, .mesh_mb = 256};
  const MemoryPlan plan = plan_memory(settings, 65536);
  EXPECT_EQ(plan.total_bytes, std::size_t{4096} << 20);
  EXPECT_EQ(plan.requests_bytes + plan.bodies_bytes, (std::size_t{4096} - 1024 - 512 - 256 - kOwnMb) << 20);
  EXPECT_GT(plan.requests_bytes, plan.bodies_bytes);
}

TEST(MemoryPlan, TooLittleIsAnErrorThatNamesTheOptions) {
  try {
    plan_memory({.memory_mb = 1024, .cache_mb = 512, .scene_mb = 512, .mesh_mb = 100}, 65536);
    FAIL();
  } catch (const std::runtime_error& e) {
    for (const char* option : {"--memory-mb 1024", "--cache-mb 512", "--scene-mb 512", "--mesh-mb 100"})
      EXPECT_NE(std::string(e.what()).find(option), std::string::npos) << e.what();
  }
}

TEST(MemoryPlan, TheDefaultFollowsTheMachine) {
  const ServeSettings options;
  const MemorySettings defaults{
      .cache_mb = options.terrain.cache_mb, .scene_mb = options.terrain.scene_mb, .mesh_mb = options.terrain.mesh_mb};
  EXPECT_EQ(default_memory_mb(65536, defaults), 8192U);
  EXPECT_EQ(default_memory_mb(8192, defaults), 6144U);
  EXPECT_EQ(default_memory_mb(2048, defaults),
            defaults.cache_mb + defaults.scene_mb + defaults.mesh_mb + kOwnMb + 1024);
  // A request of the default limits, all products, whose answer is as large: 16 Mi pixels of 106 bytes, twice, and what
  // the frame is rendered with.
  EXPECT_GT(plan_memory(defaults, 65536).requests_bytes, (std::size_t{16} << 20) * (106 + 106));
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
