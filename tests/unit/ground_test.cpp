// The shipped presets against the slopes and the numbers that they are made for. Prints the rows of
// dem/detail/ground.md.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "api/assets/assets.h"
#include "tests/support/effort.h"
#include "tests/support/ground_statistics.h"

namespace selenograph::test {
namespace {

dem::DetailPreset shipped(const std::string& name) {
  return api::read_detail_file(SELENOGRAPH_SOURCE_DIR "/deploy/assets/details/" + name + ".json");
}

// Published slopes begin at half a metre; those of the last metres are Chang'e-4's.
constexpr double kPublished_m[] = {0.5, 1, 2, 5, 10, 17, 50, 100, 200};
constexpr double kLastMetres_m[] = {0.007, 0.014, 0.028, 0.056, 0.112};

int places(int quick) { return full_effort() ? 200 : quick; }

std::vector<SlopeRow> printed_slopes(const std::string& name, const dem::DetailPreset& preset,
                                     std::span<const double> baselines_m, int places) {
  const std::vector<SlopeRow> rows = ground_slopes(preset, baselines_m, places);
  fmt::print(
      "| {}: baseline, m | median slope, degrees | published | Hurst | craters' share | relief's | clods' | "
      "fragments' | 99 % of slopes |\n|---|---|---|---|---|---|---|---|---|\n",
      name);
  for (const SlopeRow& r : rows)
    fmt::print("| {:g} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.1f} |\n", r.baseline_m,
               r.median_deg, r.published_deg, r.hurst, r.craters_share, r.relief_share, r.clods_share,
               r.fragments_share, r.steepest_deg);
  return rows;
}

TEST(Ground, SlopesAreThePublishedOnes) {
  for (const char* const name : {"mare", "highlands", "polar", "landing"}) {
    // Those that differ most; OfTheLastMetresIsAsRoughAsMeasured has the finest.
    if (!full_effort() && name != std::string("mare") && name != std::string("polar")) continue;
    double at_1_m = 0, at_100_m = 0;  // RMS slopes
    for (const SlopeRow& row : printed_slopes(name, shipped(name), kPublished_m, places(60))) {
      if (row.baseline_m == 1) at_1_m = row.rms_deg;
      if (row.baseline_m == 100) at_100_m = row.rms_deg;
      if (row.baseline_m > 100) continue;
      EXPECT_NEAR(row.median_deg / row.published_deg, 1, 0.2) << name << ' ' << row.baseline_m;
      EXPECT_NEAR(row.craters_share + row.relief_share + row.clods_share + row.fragments_share, 1, 1e-12);
      // From one baseline to the next a single fresh crater counts, in few squares too much.
      if (full_effort() && row.baseline_m > 1) {
        EXPECT_NEAR(row.hurst, 0.85, 0.2) << name << ' ' << row.baseline_m;
      }
      if (name == std::string("mare") && row.baseline_m == 1) {
        EXPECT_LT(row.relief_share, 0.4);
      }
    }
    // Cai & Fa (2020): 0.7 to 0.95.
    const double hurst =
        1 + std::log(std::tan(at_100_m * kRadiansPerDegree) / std::tan(at_1_m * kRadiansPerDegree)) / std::log(100);
    EXPECT_NEAR(hurst, 0.825, 0.125) << name;
  }
  EXPECT_EQ(shipped("landing").relief.deviation_m, shipped("mare").relief.deviation_m);
  EXPECT_EQ(shipped("landing").fingerprint, shipped("regolith").fingerprint);  // an older name
}

// A preset rougher than the slopes that it names is found to be so.
TEST(Ground, RougherReliefIsNotAsPublished) {
  dem::DetailPreset rough = shipped("mare");
  rough.relief.deviation_m *= 4;
  constexpr double kBaseline_m[] = {17};
  const SlopeRow row = ground_slopes(rough, kBaseline_m, 10).at(0);
  EXPECT_NEAR(row.published_deg, 2, 1e-9);
  EXPECT_GT(row.median_deg / row.published_deg, 1.2);
}

// Chang'e-4 (Guo et al. 2021): median slopes of some 10 degrees over 7 mm, the steepest above 40; Hurst exponents of
// 0.6 to 0.85.
TEST(Ground, OfTheLastMetresIsAsRoughAsMeasured) {
  for (const SlopeRow& row : printed_slopes("landing", shipped("landing"), kLastMetres_m, places(20))) {
    if (row.baseline_m == 0.007) {
      EXPECT_NEAR(row.median_deg, 10, 2);
      EXPECT_GT(row.steepest_deg, 40);
      EXPECT_GT(row.clods_share, 0.3);
    } else {
      EXPECT_NEAR(row.hurst, 0.7, 0.15) << row.baseline_m;
    }
  }
}

// To the last metre on steep ground: what is added to the slopes over half a metre is Chang'e-4's, the rest is as
// before.
TEST(Ground, OfTheLastMetresIsTheSameOnSteepGround) {
  for (const std::string name : {"highlands", "polar"}) {
    if (!full_effort() && name != "polar") continue;
    const dem::DetailPreset coarse = shipped(name), fine = shipped(name + "_landing");
    EXPECT_EQ(fine.relief.deviation_m, coarse.relief.deviation_m);
    EXPECT_EQ(fine.relief.min_factor, coarse.relief.min_factor);
    EXPECT_EQ(fine.craters.largest_m, coarse.craters.largest_m);
    EXPECT_EQ(fine.craters.smallest_m, shipped("landing").craters.smallest_m);
    double over_7_mm = 0, over_half_a_metre = 0;  // tangents of median slopes
    constexpr double kBaselines_m[] = {0.007, 0.5, 1, 2, 5, 10, 17, 50, 100};
    for (const SlopeRow& row : printed_slopes(name + "_landing", fine, kBaselines_m, places(20))) {
      if (row.baseline_m == 0.007) over_7_mm = std::tan(row.median_deg * kRadiansPerDegree);
      if (row.baseline_m == 0.5) over_half_a_metre = std::tan(row.median_deg * kRadiansPerDegree);
      if (row.baseline_m >= 0.5) {
        EXPECT_NEAR(row.median_deg / row.published_deg, 1, 0.2) << name << ' ' << row.baseline_m;
      }
    }
    const double added = std::sqrt(over_7_mm * over_7_mm - over_half_a_metre * over_half_a_metre);
    EXPECT_NEAR(std::atan(added) * kDegreesPerRadian, 10, 2) << name;
  }
}

TEST(Ground, CratersAreAsManyAsTheLawHas) {
  for (const std::string name : {"mare", "polar", "highlands", "landing"}) {
    if (!full_effort() && name != "mare" && name != "polar") continue;
    fmt::print("| {}: craters from, m | the law's, per km^2 | visible, over the law's | depth over diameter |\n", name);
    fmt::print("|---|---|---|---|\n");
    for (const CraterRow& row : ground_craters(shipped(name))) {
      fmt::print("| {:.3g} | {:.4g} | {:.2f} | {:.3f} |\n", row.diameter_m, row.law, row.visible / row.law,
                 row.depth_over_diameter);
      EXPECT_NEAR(row.visible / row.law, 1, 0.15) << name << ' ' << row.diameter_m;
      EXPECT_GE(row.listed, row.visible);
      if (row.diameter_m < 3) {
        EXPECT_NEAR(row.depth_over_diameter, 0.06, 0.005) << name << ' ' << row.diameter_m;
      }
    }
  }
}

// The area of the rocks of an octave is the law's, from fragments of 4 mm to rocks of 4 m.
TEST(Ground, RocksCoverAsMuchAsTheLawHas) {
  for (const std::string name : {"landing", "polar_landing", "polar", "polar_rocky"}) {
    const std::vector<RockRow> rows = ground_rocks(shipped(name));
    EXPECT_EQ(rows.size(), name.ends_with("landing") ? 11U : 8U);
    fmt::print("| {}: rocks from, m | law, % of the ground | over the law's | fragments, % |\n|---|---|---|---|\n",
               name);
    for (const RockRow& row : rows) {
      fmt::print("| {:.3g} | {:.3f} | {:.2f} | {:.3f} |\n", row.diameter_m, 100 * row.law, row.area / row.law,
                 100 * row.fragments);
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
  const RoughnessRow row = ground_roughness(shipped("landing"), places(120));
  fmt::print("landing, RMS heights in {:g} mm: {:.1f} mm about a plane ({:.1f} to {:.1f}), {:.1f} about the mean\n",
             1000 * row.window_m, 1000 * row.median_m, 1000 * row.low_m, 1000 * row.high_m,
             1000 * row.median_about_mean_m);
  EXPECT_LT(row.median_m, 0.005);
  EXPECT_GT(row.median_about_mean_m, 0.0025);
  EXPECT_GT(row.low_m, 0.001);
  EXPECT_LT(row.high_m, 0.018);
}

// What an albedo map's mean is must stay; the deviation and the bright share are those that the law was chosen for.
// Steep walls are half a percent of the ground.
TEST(Ground, YoungCratersMakeAFewPercentBright) {
  const std::vector<AlbedoRow> rows = ground_albedo(shipped("landing"), places(60));
  ASSERT_EQ(rows.size(), 3U);
  fmt::print("| landing: pixel, m | mean albedo | standard deviation | 30 % brighter, % |\n|---|---|---|---|\n");
  for (const AlbedoRow& row : rows) {
    fmt::print("| {:g} | {:.3f} | {:.3f} | {:.1f} |\n", row.pixel_m, row.mean, row.deviation, 100 * row.bright_share);
    EXPECT_NEAR(row.mean, 1, 0.015) << row.pixel_m;
    EXPECT_NEAR(row.deviation, 0.1, 0.03) << row.pixel_m;
    EXPECT_NEAR(row.bright_share, 0.035, 0.02) << row.pixel_m;
  }
}

}  // namespace
}  // namespace selenograph::test
