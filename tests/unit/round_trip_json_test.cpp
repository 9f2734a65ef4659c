#include <gtest/gtest.h>

#include <string>

#include "api/answers/round_trip_answer.h"
#include "api/encode/negotiate.h"

namespace selenograph::api {
namespace {

engine::RoundTripRequest read(const char* text) { return read_round_trip(Json::parse(text), Limits{}); }

std::string pointer_of(const char* text) {
  try {
    read(text);
  } catch (const RequestError& e) {
    return e.findings().empty() ? e.code() : e.findings().front().pointer;
  }
  return "accepted";
}

TEST(RoundTripJson, RefusalsPointAtMembers) {
  EXPECT_EQ(pointer_of(R"({})"), "/center");
  EXPECT_EQ(pointer_of(R"({"center": {"lat_deg": 91, "lon_deg": 0}})"), "/center/lat_deg");
  EXPECT_EQ(pointer_of(R"({"center": {"lat_deg": 1, "lon_deg": 0}, "mode": "both"})"), "/mode");
  EXPECT_EQ(pointer_of(R"({"center": {"lat_deg": 1, "lon_deg": 0}, "posts": 317})"), "/posts");
  EXPECT_EQ(pointer_of(R"({"center": {"lat_deg": 1, "lon_deg": 0}, "posts": 316})"), "accepted");
  EXPECT_EQ(pointer_of(R"({"center": {"lat_deg": 1, "lon_deg": 0}, "footprint_ratio": 0.01})"), "/footprint_ratio");
  EXPECT_EQ(pointer_of(R"({"center": {"lat_deg": 1, "lon_deg": 0}, "hight_m": 1})"), "/hight_m");
}

TEST(RoundTripJson, PostsFollowFromTheRaysThatAreAllowed) {
  Limits limits;
  limits.max_rays = 10000;
  EXPECT_EQ(max_posts(limits), 100);
  EXPECT_EQ(default_posts(limits), 100);
}

TEST(RoundTripJson, AnswersAreChosenByWeight) {
  const std::span<const Alternative> all(kRoundTripAnswers);
  EXPECT_EQ(choose_media_type("", all), "application/json");
  EXPECT_EQ(choose_media_type("*/*", all), "application/json");
  EXPECT_EQ(choose_media_type("image/*", all), "image/tiff");
  EXPECT_EQ(choose_media_type("application/json;q=0.5, image/tiff", all), "image/tiff");
  EXPECT_THROW(choose_media_type("text/html", all), RequestError);
  EXPECT_THROW(choose_media_type("image/png", all), RequestError);
}

TEST(RoundTripJson, LengthsHaveReadableUnits) {
  EXPECT_EQ(length_text(0), "0 m");
  EXPECT_EQ(length_text(-0.25), "\u22120.25 m");
  EXPECT_EQ(length_text(0.0123), "12.3 mm");
  EXPECT_EQ(length_text(4.66e-10), "0.466 nm");
  EXPECT_EQ(length_text(-3e-12), "\u22123 pm");
  EXPECT_EQ(length_text(std::nan("")), "none");
}

TEST(RoundTripJson, HoldsWhatAPictureNeeds) {
  engine::RoundTrip trip;
  engine::PostWindow& w = trip.window;
  w.width = w.tile.width = 40, w.height = w.tile.height = 30;
  w.tile.name = "a tile & its name";
  dem::set_grid(w.tile, dem::GeographicGrid{29 / 16.0, 10, 16, 16});
  trip.original_m.assign(w.size(), 5.F);
  trip.difference_m.assign(w.size(), 0.001F);
  trip.difference_m[w.index(3, 4)] = -0.0125F;
  trip.difference_m[w.index(0, 0)] = std::numeric_limits<float>::quiet_NaN();
  trip.compared = w.size() - 1;
  const Json json = round_trip_answer().write({{}, trip, engine::statistics_of(trip)});
  EXPECT_EQ(json["tile"]["name"], "a tile & its name");
  EXPECT_EQ(json["counts"]["compared"], 1199);
  EXPECT_EQ(json["window"]["north_deg"], 29 / 16.0);
  EXPECT_NEAR(json["difference"]["worst"]["difference_m"].get<double>(), -0.0125, 1e-9);
  EXPECT_EQ(json["difference"]["worst"]["lat_deg"], 26 / 16.0);
  EXPECT_EQ(json["quadrants"].size(), 4u);
  const Json& histogram = json["histogram"];
  EXPECT_EQ(histogram["from_m"], -0.002) << "0.001 in float is a little more than 1e-3";
  EXPECT_EQ(histogram["to_m"], 0.002);
  EXPECT_EQ(histogram["below"], 1);
  EXPECT_EQ(histogram["counts"].get<std::vector<int>>()[45], 1198);
}

TEST(RoundTripJson, LongitudesOfAWindowAreThoseOfOutput) {
  engine::RoundTrip trip;
  engine::PostWindow& w = trip.window;
  w.width = w.tile.width = 40, w.height = w.tile.height = 30;
  dem::set_grid(w.tile, dem::GeographicGrid{1, 179, 16, 16});
  trip.original_m.assign(w.size(), 5.F);
  trip.difference_m.assign(w.size(), 0.F);
  const Json json = round_trip_answer().write({{}, trip, engine::statistics_of(trip)});
  EXPECT_EQ(json["window"]["west_deg"], 179);
  EXPECT_EQ(json["window"]["east_deg"], 179 + 39 / 16.0 - 360);
}

}  // namespace
}  // namespace selenograph::api
