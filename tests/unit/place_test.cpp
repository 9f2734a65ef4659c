// Places on the command line: server/commands/place.h.
#include "server/commands/place.h"

#include <gtest/gtest.h>

namespace selenograph::server {
namespace {

TEST(PlaceOf, ReadsDegreesAndSexagesimals) {
  const struct {
    const char* text;
    double lat_deg, lon_deg;
  } places[] = {{"26.1,3.6", 26.1, 3.6},
                {"-7.5,39.5", -7.5, 39.5},
                {"-90,0", -90, 0},
                {"10,350", 10, 350},
                {"26:06N,3:36E", 26.1, 3.6},
                {"3:36E,26:06N", 26.1, 3.6},
                {"7:30S,140:30W", -7.5, -140.5},
                {"26d6'0\"N,3d36'0\"E", 26.1, 3.6}};
  for (const auto& [text, lat_deg, lon_deg] : places) {
    const auto place = place_of(text);
    ASSERT_TRUE(place) << text;
    EXPECT_NEAR(place->lat_deg, lat_deg, 1e-13) << text;
    EXPECT_NEAR(place->lon_deg, lon_deg, 1e-13) << text;
    EXPECT_EQ(place->height_m, 0) << text;
  }
}

TEST(PlaceOf, RefusesOtherText) {
  for (const char* text : {"", ",", "26.1", "26.1,", "26.1,3.6,0", "91,0", "0,361", "0,181W", "7:30S,320:30W", "nan,0",
                           "0,inf", "26.1N,3.6N", "a,b"})
    EXPECT_FALSE(place_of(text)) << text;
}

}  // namespace
}  // namespace selenograph::server
