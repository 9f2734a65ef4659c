// The header Server-Timing, by hand.
#include "api/message/timing.h"

#include <gtest/gtest.h>

namespace selenograph::api {
namespace {

TEST(Timing, OtherIsTheTimeOfNoStage) {
  Durations durations{{"parse", 0.25}, {"select", 1.5}, {"load", 1}};
  complete_timing(durations, 2);
  EXPECT_EQ(timing_text(durations),
            "parse;dur=0.250, select;dur=1.500, load;dur=1.000, other;dur=0.250, total;dur=2.000");
}

TEST(Timing, StagesThatOverlapExceedTheTotal) {
  Durations durations{{"select", 1.5}, {"build", 1}};
  complete_timing(durations, 2);
  EXPECT_EQ(durations[2], (std::pair<std::string, double>("other", 0)));
  EXPECT_EQ(durations[3], (std::pair<std::string, double>("total", 2)));
}

TEST(Timing, IsReadAsItIsWritten) {
  const Durations durations{{"queue", 0.004}, {"touch", 12.5}, {"total", 1234.567}};
  EXPECT_EQ(read_timing(timing_text(durations)), durations);
  EXPECT_TRUE(read_timing("").empty());
  EXPECT_TRUE(read_timing("cache, parse").empty());
}

}  // namespace
}  // namespace selenograph::api
