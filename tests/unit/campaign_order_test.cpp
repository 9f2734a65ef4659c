// The order of a campaign's frames: a curve that leaves no cell out and makes no jumps, and cuts that are a partition.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "server/campaign/order.h"

namespace selenograph::server {
namespace {

using api::Json;

TEST(CampaignOrder, HilbertCurveVisitsEachCellOnceInStepsOfOne) {
  constexpr int kBits = 3, kCells = 1 << kBits;
  std::map<std::uint64_t, Vec3> by_index;
  for (int x = 0; x < kCells; ++x)
    for (int y = 0; y < kCells; ++y)
      for (int z = 0; z < kCells; ++z) {
        const Vec3 cell(x, y, z);
        const Vec3 middle = (cell + Vec3::Constant(0.5)) * 2 / kCells - Vec3::Ones();
        EXPECT_TRUE(by_index.emplace(hilbert_index(middle, kBits), cell).second);
      }
  EXPECT_EQ(by_index.begin()->first, 0U);
  EXPECT_EQ(by_index.rbegin()->first, static_cast<std::uint64_t>(kCells * kCells * kCells - 1));
  for (auto a = by_index.begin(), b = std::next(a); b != by_index.end(); ++a, ++b)
    EXPECT_EQ((a->second - b->second).cwiseAbs().sum(), 1) << a->first;
}

TEST(CampaignOrder, PointsOutsideTheCubeAreItsNearest) {
  EXPECT_EQ(hilbert_index({-7, -7, -7}, 5), hilbert_index({-1, -1, -1}, 5));
  EXPECT_EQ(hilbert_index({9, 0, 0}, 5), hilbert_index({1, 0, 0}, 5));
}

Json nadir(double lat_deg, double lon_deg, double height_m) {
  return {{"pose",
           {{"geodetic", {{"lat_deg", lat_deg}, {"lon_deg", lon_deg}, {"height_m", height_m}}},
            {"nadir", {{"up_azimuth_deg", 0}}}}}};
}

TEST(CampaignOrder, OrdersByThePlaceSeen) {
  EXPECT_EQ(terrain_key(nadir(10, 20, 1000)), terrain_key(nadir(10, 20, 90000)));
  EXPECT_NE(terrain_key(nadir(10, 20, 1000)), terrain_key(nadir(11, 20, 1000)));
  Json looking = nadir(12, 20, 50000);
  looking["pose"].erase("nadir");
  looking["pose"]["look_at"] = {{"lat_deg", 10}, {"lon_deg", 20}, {"height_m", 0}};
  EXPECT_EQ(terrain_key(looking), terrain_key(nadir(10, 20, 1000)));
}

TEST(CampaignOrder, AcceptsEveryFormOfAPose) {
  const Json pose = nadir(10, 20, 1000)["pose"];
  Json timed = pose;
  timed["time_s"] = 0;
  EXPECT_EQ(terrain_key({{"shutter", {{"poses", {timed, timed}}}}}), terrain_key({{"pose", pose}}));
  EXPECT_EQ(terrain_key({{"cameras", {{"a", {{"pose", pose}}}}}}), terrain_key({{"pose", pose}}));
  EXPECT_EQ(terrain_key({{"cameras", {{"a", Json::object()}}}, {"pose", pose}}), terrain_key({{"pose", pose}}));
  // The rest of the request is not its matter.
  EXPECT_EQ(terrain_key({{"pose", pose}, {"camera", 5}, {"camera_preset", "none"}}), terrain_key({{"pose", pose}}));
}

TEST(CampaignOrder, RequestsWithoutAPlaceComeLast) {
  for (const Json& request : {Json(), Json(17), Json::object(), Json{{"pose", 5}}, Json{{"pose", Json::object()}},
                              Json{{"shutter", {{"poses", Json::array()}}}}, Json{{"cameras", Json::array()}}})
    EXPECT_EQ(terrain_key(request), kNoPose) << request;
}

TEST(CampaignOrder, WeightGrowsWithPixels) {
  const auto weight = [](int side, int samples) {
    return weight_of({{"camera", {{"width", side}, {"height", side}}}, {"accuracy", {{"samples_per_pixel", samples}}}});
  };
  EXPECT_GT(weight(16, 1), 0U);
  EXPECT_NEAR(static_cast<double>(weight(4096, 4)) / static_cast<double>(weight(4096, 1)), 4, 0.1);
  EXPECT_EQ(weight_of(Json::object()), weight(1024, 1));
  for (const Json& request : {Json(), Json{{"camera", {{"width", -1e300}, {"height", 1e300}}}}, Json{{"cameras", 3}}})
    EXPECT_GT(weight_of(request), 0U);
}

TEST(CampaignOrder, CutsAreAPartitionOfLikeWeight) {
  std::vector<std::uint64_t> weights(1000);
  for (std::size_t i = 0; i < weights.size(); ++i) weights[i] = 1 + i % 7 + (i > 900 ? 100 : 0);
  const auto total = static_cast<double>(std::accumulate(weights.begin(), weights.end(), std::uint64_t{0}));
  for (const std::size_t count : {1, 2, 3, 7, 16, 999, 1000, 5000}) {
    const std::vector<Span> spans = cut_evenly(weights, count);
    ASSERT_EQ(spans.size(), count);
    std::size_t at = 0;
    for (const Span& span : spans) {
      EXPECT_EQ(span.begin, at);
      EXPECT_LE(span.begin, span.end);
      at = span.end;
      const auto weight = static_cast<double>(std::accumulate(weights.begin() + static_cast<std::ptrdiff_t>(span.begin),
                                                              weights.begin() + static_cast<std::ptrdiff_t>(span.end),
                                                              std::uint64_t{0}));
      EXPECT_NEAR(weight, total / static_cast<double>(count), 108);
    }
    EXPECT_EQ(at, weights.size());
  }
  EXPECT_EQ(cut_evenly({}, 2), (std::vector<Span>{{0, 0}, {0, 0}}));
}

}  // namespace
}  // namespace selenograph::server
