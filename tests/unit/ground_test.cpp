// The shipped presets against the slopes and the numbers that they are made for: what `verify ground` measures.
#include "engine/verify/ground.h"

#include <gtest/gtest.h>

#include <cmath>

#include "api/assets/assets.h"
#include "tests/support/effort.h"

namespace selenograph::engine {
namespace {

dem::DetailPreset shipped(const std::string& name) {
  return api::read_detail_file(SELENOGRAPH_SOURCE_DIR "/deploy/assets/details/" + name + ".json");
}

// Places measured on ground to the last metre, which has the most posts.
const int kFinestPlaces = test::full_effort() ? 60 : 20;

TEST(Ground, SlopesAreThePublishedOnes) {
  for (const char* const name : {"mare", "highlands", "polar", "landing"}) {
    // Those that differ most; OfTheLastMetresIsAsRoughAsMeasured has the finest.
    if (!test::full_effort() && name != std::string("mare") && name != std::string("polar")) continue;
    double at_1_m = 0, at_100_m = 0;  // RMS slopes
    for (const SlopeRow& row : ground_slopes(shipped(name), 60)) {
      if (row.baseline_m == 1) at_1_m = row.rms_deg;
      if (row.baseline_m == 100) at_100_m = row.rms_deg;
      if (row.baseline_m > 100 || row.baseline_m < 0.5) continue;
      EXPECT_NEAR(row.median_deg / row.published_deg, 1, 0.2) << name << ' ' << row.baseline_m;
      EXPECT_NEAR(row.craters_share + row.relief_share + row.clods_share + row.fragments_share, 1, 1e-12);
      if (name == std::string("mare") && row.baseline_m == 1) {
        EXPECT_LT(row.relief_share, 0.4);
      }
    }
    // Cai & Fa (2020): 0.7 to 0.95. From one baseline to the next a single fresh crater counts.
    const double hurst =
        1 + std::log(std::tan(at_100_m * kRadiansPerDegree) / std::tan(at_1_m * kRadiansPerDegree)) / std::log(100);
    EXPECT_NEAR(hurst, 0.825, 0.125) << name;
  }
  EXPECT_EQ(shipped("landing").relief.deviation_m, shipped("mare").relief.deviation_m);
  EXPECT_EQ(shipped("landing").fingerprint, shipped("regolith").fingerprint);  // an older name
}

// Chang'e-4 (Guo et al. 2021): median slopes of some 10 degrees over 7 mm, the steepest above 40; Hurst exponents of
// 0.6 to 0.85.
TEST(Ground, OfTheLastMetresIsAsRoughAsMeasured) {
  int rows = 0;
  for (const SlopeRow& row : ground_slopes(shipped("landing"), kFinestPlaces)) {
    if (row.baseline_m > 0.2) continue;
    ++rows;
    if (row.baseline_m == 0.007) {
      EXPECT_NEAR(row.median_deg, 10, 2);
      EXPECT_GT(row.steepest_deg, 40);
      EXPECT_GT(row.clods_share, 0.3);
    } else {
      EXPECT_NEAR(row.hurst, 0.7, 0.15) << row.baseline_m;
    }
  }
  EXPECT_EQ(rows, 5);
}

// To the last metre on steep ground: what is added to the slopes over half a metre is Chang'e-4's, the rest is as
// before.
TEST(Ground, OfTheLastMetresIsTheSameOnSteepGround) {
  for (const std::string name : {"highlands", "polar"}) {
    if (!test::full_effort() && name != "polar") continue;
    const dem::DetailPreset coarse = shipped(name), fine = shipped(name + "_landing");
    EXPECT_EQ(fine.relief.deviation_m, coarse.relief.deviation_m);
    EXPECT_EQ(fine.relief.min_factor, coarse.relief.min_factor);
    EXPECT_EQ(fine.craters.largest_m, coarse.craters.largest_m);
    EXPECT_EQ(fine.craters.smallest_m, shipped("landing").craters.smallest_m);
    double over_7_mm = 0, over_half_a_metre = 0;  // tangents of median slopes
    for (const SlopeRow& row : ground_slopes(fine, kFinestPlaces)) {
      if (row.baseline_m == 0.007) over_7_mm = std::tan(row.median_deg * kRadiansPerDegree);
      if (row.baseline_m == 0.5) over_half_a_metre = std::tan(row.median_deg * kRadiansPerDegree);
      if (row.baseline_m >= 0.5 && row.baseline_m <= 100) {
        EXPECT_NEAR(row.median_deg / row.published_deg, 1, 0.2) << name << ' ' << row.baseline_m;
      }
    }
    const double added = std::sqrt(over_7_mm * over_7_mm - over_half_a_metre * over_half_a_metre);
    EXPECT_NEAR(std::atan(added) * kDegreesPerRadian, 10, 2) << name;
  }
}

TEST(Ground, CratersAreAsManyAsTheLawHas) {
  for (const char* const name : {"mare", "polar"})
    for (const CraterRow& row : ground_craters(shipped(name))) {
      EXPECT_NEAR(row.visible / row.law, 1, 0.15) << name << ' ' << row.diameter_m;
      EXPECT_GE(row.listed, row.visible);
      if (row.diameter_m < 3) {
        EXPECT_NEAR(row.depth_over_diameter, 0.06, 0.005) << name << ' ' << row.diameter_m;
      }
    }
}

// The area of the rocks of an octave is the law's, from fragments of 4 mm to rocks of 4 m.
TEST(Ground, RocksCoverAsMuchAsTheLawHas) {
  for (const std::string name : {"landing", "polar_landing", "polar", "polar_rocky"}) {
    const std::vector<RockRow> rows = ground_rocks(shipped(name));
    EXPECT_EQ(rows.size(), name.ends_with("landing") ? 11U : 8U);
    for (const RockRow& row : rows) {
      EXPECT_NEAR(row.area / row.law, 1, row.diameter_m < 4 ? 0.15 : 0.3) << name << ' ' << row.diameter_m;
      EXPECT_EQ(row.fragments > 0, row.diameter_m < 0.05) << row.diameter_m;
    }
  }
  EXPECT_TRUE(ground_rocks(shipped("mare")).empty());
}

// Haworth's two grounds: the rocky parts have 20 times the rocks above 1 m, and more of smaller ones.
TEST(Ground, PolarRocksAreThoseOfHaworth) {
  const dem::RockLaw between = shipped("polar").rocks, rocky = shipped("polar_rocky").rocks;
  EXPECT_NEAR(between.frequency.above(1), 0.0001, 1e-9);
  EXPECT_NEAR(rocky.frequency.above(1), dem::rocks_of_haworth().above(1), 1e-9);
  EXPECT_NEAR(between.frequency.above(1) * between.on_ejecta, rocky.frequency.above(1), 1e-6);
}

// Every preset names what its laws were measured on and what it extrapolates.
TEST(Ground, PresetsNameTheirSources) {
  for (const char* const name :
       {"mare", "highlands", "landing", "polar", "polar_rocky", "highlands_landing", "polar_landing"}) {
    const dem::DetailPreset preset = shipped(name);
    const std::size_t laws = 2U + (preset.clods.cover > 0) + (preset.rocks.smallest_m < preset.rocks.largest_m);
    ASSERT_EQ(preset.sources.size(), laws) << name;
    for (const dem::LawSource& source : preset.sources) {
      EXPECT_FALSE(source.measured.empty()) << name << ' ' << source.law;
      EXPECT_FALSE(source.extrapolated.empty()) << name << ' ' << source.law;
    }
  }
}

// RMS heights in windows of 125 mm: from 1 to 18 mm, median 4 (Guo et al. 2021).
TEST(Ground, OfTheLastMetresIsAsHighAsMeasured) {
  const std::vector<RoughnessRow> rows = ground_roughness(shipped("landing"), 120);
  ASSERT_EQ(rows.size(), 1U);
  EXPECT_LT(rows[0].median_m, 0.005);
  EXPECT_GT(rows[0].median_about_mean_m, 0.0025);
  EXPECT_GT(rows[0].low_m, 0.001);
  EXPECT_LT(rows[0].high_m, 0.018);
  EXPECT_TRUE(ground_roughness(shipped("mare"), 4).empty());
}

// What an albedo map's mean is must stay; the deviation and the bright share are those that the law was chosen for.
// Steep walls are half a percent of the ground.
TEST(Ground, YoungCratersMakeAFewPercentBright) {
  const std::vector<AlbedoRow> rows = ground_albedo(shipped("landing"), 60);
  ASSERT_EQ(rows.size(), 3U);
  for (const AlbedoRow& row : rows) {
    EXPECT_NEAR(row.mean, 1, 0.015) << row.pixel_m;
    EXPECT_NEAR(row.deviation, 0.1, 0.03) << row.pixel_m;
    EXPECT_NEAR(row.bright_share, 0.035, 0.02) << row.pixel_m;
  }
}

}  // namespace
}  // namespace selenograph::engine
