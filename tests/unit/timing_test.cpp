// The header Server-Timing, by hand.
#include "api/message/timing.h"

#include <gtest/gtest.h>

namespace selenograph::api {
namespace {

TEST(Timing, OtherIsTheTimeOfNoStage) {
  StageTimes stages{{"parse", 0.25}, {"select", 1.5}, {"load", 1}};
  complete_timing(stages, 2);
  EXPECT_EQ(timing_text(stages), "parse;dur=0.250, select;dur=1.500, load;dur=1.000, other;dur=0.250, total;dur=2.000");
}

TEST(Timing, StagesThatOverlapExceedTheTotal) {
  StageTimes stages{{"select", 1.5}, {"build", 1}};
  complete_timing(stages, 2);
  EXPECT_EQ(stages[2], (StageTime{"other", 0}));
  EXPECT_EQ(stages[3], (StageTime{"total", 2}));
}

}  // namespace
}  // namespace selenograph::api
