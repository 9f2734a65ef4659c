#include "server/service/memory_plan.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <stdexcept>

namespace selenograph::server {
namespace {

constexpr std::size_t kMachineMb = 65536;

TEST(MemoryPlan, PartsMakeTheWhole) {
  const MemoryParts parts =
      memory_parts({.memory_mb = 4096, .cache_mb = 1024, .scene_mb = 512, .mesh_mb = 256}, kMachineMb);
  const MemoryPlan plan = plan_memory(parts);
  EXPECT_EQ(plan.total_bytes, std::size_t{4096} << 20);
  EXPECT_EQ(plan.requests_bytes + plan.bodies_bytes, (std::size_t{4096} - 1024 - 512 - 256 - kOwnMb) << 20);
  EXPECT_GT(plan.requests_bytes, plan.bodies_bytes);
}

TEST(MemoryPlan, TooLittleIsAnErrorThatNamesTheOptions) {
  try {
    plan_memory(memory_parts({.memory_mb = 1024, .cache_mb = 512, .scene_mb = 512, .mesh_mb = 100}, kMachineMb));
    FAIL();
  } catch (const std::runtime_error& e) {
    for (const char* option : {"--memory-mb 1024", "--cache-mb 512", "--scene-mb 512", "--mesh-mb 100"})
      EXPECT_NE(std::string(e.what()).find(option), std::string::npos) << e.what();
  }
  EXPECT_THROW(plan_memory(memory_parts({}, 600)), std::runtime_error);
}

TEST(MemoryPlan, WithoutOptionsItFollowsTheMachine) {
  const MemoryParts large = memory_parts({}, kMachineMb);
  EXPECT_EQ(large.total_mb, 8192U);
  EXPECT_EQ(large.cache_mb, 1024U);
  EXPECT_EQ(large.scene_mb, 1024U);
  EXPECT_EQ(large.mesh_mb, 1024U);
  // A request of the default limits, all products, whose answer is as large: 16 Mi pixels of 106 bytes, twice, and what
  // the frame is rendered with.
  EXPECT_GT(plan_memory(large).requests_bytes, (std::size_t{16} << 20) * (106 + 106));
  // A control group's limit is kept, however small.
  for (const std::size_t machine_mb : {1000, 1024, 1536, 2048, 4096, 8192, 16384}) {
    const MemoryParts parts = memory_parts({}, machine_mb);
    const MemoryPlan plan = plan_memory(parts);
    EXPECT_LE(plan.total_bytes >> 20, machine_mb / 4 * 3);
    EXPECT_GE(plan.requests_bytes + plan.bodies_bytes,
              std::min((plan.total_bytes - (kOwnMb << 20)) / 2, std::size_t{1} << 30));
    EXPECT_GE(parts.scene_mb, parts.cache_mb);
    EXPECT_GE(parts.cache_mb, parts.mesh_mb);
    EXPECT_GE(parts.mesh_mb, kMinPartMb);
  }
}

TEST(MemoryPlan, GivenOptionsAreKept) {
  const MemoryParts of_total = memory_parts({.memory_mb = 2048}, kMachineMb);
  EXPECT_EQ(of_total.total_mb, 2048U);
  EXPECT_EQ(of_total.scene_mb, 640U);  // of 768, beside 64 each
  EXPECT_EQ(of_total.cache_mb, 96U);
  EXPECT_EQ(of_total.mesh_mb, 32U);
  const MemoryParts of_small = memory_parts({.scene_mb = 256}, 2048);
  EXPECT_EQ(of_small.total_mb, 1536U);
  EXPECT_EQ(of_small.scene_mb, 256U);
  EXPECT_EQ(of_small.cache_mb + of_small.mesh_mb, 256U);
  // The whole grows with what is asked for, to three quarters of what there is.
  EXPECT_EQ(memory_parts({.cache_mb = 20000}, kMachineMb).total_mb, 20000 + kOwnMb + 1024);
  EXPECT_EQ(memory_parts({.cache_mb = 20000}, 16384).total_mb, 12288U);
  EXPECT_THROW(plan_memory(memory_parts({.cache_mb = 20000}, 16384)), std::runtime_error);
  // More than the machine has is taken at its word.
  EXPECT_EQ(memory_parts({.memory_mb = 8192}, 1024).total_mb, 8192U);
}

TEST(MemoryPlan, TilesOnANetworkHaveABuilderOfTheirOwn) {
  const MemorySettings settings{.memory_mb = 4096, .cache_mb = 1024, .scene_mb = 512, .mesh_mb = 256};
  MemorySettings of_remote = settings;
  of_remote.remote_tiles = true;
  const MemoryPlan plan = plan_memory(memory_parts(settings, kMachineMb)),
                   remote = plan_memory(memory_parts(of_remote, kMachineMb));
  EXPECT_EQ(plan.total_bytes, remote.total_bytes);
  EXPECT_EQ(plan.requests_bytes + plan.bodies_bytes,
            remote.requests_bytes + remote.bodies_bytes + (kSecondBuildMb << 20));
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
