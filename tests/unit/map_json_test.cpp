// A map's request: where it lies, what is refused, what it resolves to.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <string>

#include "api/answers/map_answer.h"

namespace selenograph::api {
namespace {

MapQuery read(const std::string& text, const Limits& limits = {}) { return read_map(Json::parse(text), limits); }

MapQuery of(const std::string& area) { return read(R"({"products": ["height"], "map": )" + area + "}"); }

std::string pointer_of(const std::string& text, const Limits& limits = {}) {
  try {
    read(text, limits);
  } catch (const RequestError& e) {
    return e.findings().empty() ? e.code() : e.findings().front().pointer;
  }
  return "accepted";
}

constexpr const char* kSite =
    R"("center": {"lat_deg": 60, "lon_deg": 200}, "width_m": 1001, "height_m": 499, "gsd_m": 10})";

TEST(MapJson, BoundsAreCoveredFromTheNorthWest) {
  const dem::MapGrid grid = of(R"({"projection": "equirectangular", "gsd_m": 1000,
                                   "bounds": {"south_deg": -1, "north_deg": 2, "west_deg": 10, "east_deg": 12}})")
                                .request.grid;
  EXPECT_EQ(grid.plane.lon_deg, 0);
  EXPECT_EQ(grid.plane.standard_parallel_deg, 0);
  EXPECT_EQ(grid.width, static_cast<int>(std::ceil(2 * kMetresPerDegree / 1000)));
  EXPECT_EQ(grid.height, static_cast<int>(std::ceil(3 * kMetresPerDegree / 1000)));
  EXPECT_DOUBLE_EQ(grid.west_m, 10 * kMetresPerDegree);
  EXPECT_DOUBLE_EQ(grid.north_m, 2 * kMetresPerDegree);
}

TEST(MapJson, TheCentralMeridianKeepsAMapInOnePiece) {
  const auto meridian = [](double west, double east) {
    const std::string bounds = std::to_string(west) + ", \"east_deg\": " + std::to_string(east);
    const dem::MapGrid grid =
        of(R"({"projection": "equirectangular", "gsd_m": 10000, "bounds": {"south_deg": 0, "north_deg": 1, "west_deg": )" +
           bounds + "}}")
            .request.grid;
    EXPECT_LE(std::abs(grid.west_m), 180.0001 * kMetresPerDegree);
    EXPECT_GE(grid.width, 60);
    return grid.plane.lon_deg;
  };
  EXPECT_EQ(meridian(-180, 180), 0);
  EXPECT_EQ(meridian(0, 360), 180);
  EXPECT_EQ(meridian(170, -170), 180);
  EXPECT_EQ(meridian(170, 190), 180);
  EXPECT_EQ(meridian(-90, 0), 0);
  EXPECT_EQ(meridian(-10, 340), 165);
  EXPECT_EQ(meridian(20, 10), 180 + 15);
  EXPECT_EQ(meridian(360, -180), 0);
}

// To whole pixels, about the centre.
TEST(MapJson, SizesAreAboutTheCentre) {
  const dem::MapGrid flat = of(std::string(R"({"projection": "equirectangular", )") + kSite).request.grid;
  EXPECT_EQ(flat.plane.standard_parallel_deg, 60);
  EXPECT_EQ(flat.plane.lon_deg, -160);
  EXPECT_EQ(flat.width, 100);
  EXPECT_EQ(flat.height, 50);
  EXPECT_DOUBLE_EQ(flat.west_m, -500);
  EXPECT_DOUBLE_EQ(flat.north_m, 60 * kMetresPerDegree + 250);
  const dem::MapGrid view = of(std::string(R"({"projection": "orthographic", )") + kSite).request.grid;
  EXPECT_EQ(view.west_m, -500);
  EXPECT_EQ(view.north_m, 250);
  const dem::MapGrid polar = of(std::string(R"({"projection": "polar_stereographic", )") + kSite).request.grid;
  EXPECT_EQ(polar.plane.lat_deg, 90);
  EXPECT_EQ(polar.plane.lon_deg, 0);
  const double rho = 2 * kMoonRadius_m * std::tan(15 * kRadiansPerDegree);
  EXPECT_NEAR(polar.west_m + 500, rho * std::sin(200 * kRadiansPerDegree), 1e-6);
  EXPECT_NEAR(polar.north_m - 250, -rho * std::cos(200 * kRadiansPerDegree), 1e-6);
}

TEST(MapJson, RefusalsPointAtMembers) {
  const std::string site = std::string(R"({"products": ["height"], "map": {"projection": "orthographic", )") + kSite;
  EXPECT_EQ(pointer_of(site + "}"), "accepted");
  Limits small;
  small.max_map_pixels = 4999;
  EXPECT_EQ(pointer_of(site + "}", small), "/map/gsd_m");
  EXPECT_EQ(pointer_of(site + R"(, "view": {"direction": [0, 0, 0]}})"), "/view/direction");
  EXPECT_EQ(pointer_of(site + R"(, "view": "zenith"})"), "/view");
  EXPECT_EQ(pointer_of(site + R"(, "view": 3})"), "/view");
  EXPECT_EQ(pointer_of(site + R"(, "accuracy": {"samples_per_pixel": 4}})"), "/accuracy/samples_per_pixel");
  EXPECT_EQ(pointer_of(R"({"products": ["height"]})"), "/map");
  EXPECT_EQ(pointer_of(R"({"products": ["lit"], "map": {"projection": "orthographic", )" + std::string(kSite) + "}"),
            "/sun");
  EXPECT_EQ(pointer_of(R"({"products": ["height"], "map": {"projection": "equirectangular", "gsd_m": 10}})"), "/map");
  const auto of_area = [](const std::string& area) {
    return pointer_of(R"({"products": ["height"], "map": )" + area + "}");
  };
  const std::string bounds = R"("bounds": {"south_deg": -1, "north_deg": 2, "west_deg": 10, "east_deg": 12})";
  EXPECT_EQ(of_area(std::string(R"({"projection": "mercator", )") + kSite), "/map/projection");
  EXPECT_EQ(of_area(std::string(R"({"projection": "orthographic", "standard_parallel_deg": 3, )") + kSite),
            "/map/standard_parallel_deg");
  EXPECT_EQ(of_area(R"({"projection": "orthographic", "gsd_m": 100, )" + bounds + "}"), "/map/bounds");
  EXPECT_EQ(of_area(R"({"projection": "equirectangular", )" + bounds + ", " + kSite), "/map/center");
  EXPECT_EQ(of_area(R"({"projection": "equirectangular", "gsd_m": 9, "width_m": 90, "height_m": 90,
                        "center": {"lat_deg": 90, "lon_deg": 0}})"),
            "/map/center/lat_deg");
  for (const auto& [sides, member] :
       {std::pair{R"("south_deg": 2, "north_deg": 2, "west_deg": 10, "east_deg": 12)", "north_deg"},
        {R"("south_deg": 2, "north_deg": 91, "west_deg": 10, "east_deg": 12)", "north_deg"},
        {R"("south_deg": 1, "north_deg": 2, "west_deg": 5, "east_deg": 5)", "east_deg"},
        {R"("south_deg": 1, "north_deg": 2, "west_deg": -180, "east_deg": 200)", "east_deg"}})
    EXPECT_EQ(of_area(fmt::format(R"({{"projection": "equirectangular", "gsd_m": 100, "bounds": {{{}}}}})", sides)),
              std::string("/map/bounds/") + member);
}

TEST(MapJson, AWindowIsAPartOfTheGrid) {
  const auto area_of = [](const std::string& side_m, const std::string& window) {
    return R"({"projection": "polar_stereographic", "center": {"lat_deg": 89, "lon_deg": 0}, "gsd_m": 10, "width_m": )" +
           side_m + R"(, "height_m": 5000)" + window + "}";
  };
  const auto window = [](int x_px) {
    return fmt::format(R"(, "window": {{"x_px": {}, "y_px": 10, "width_px": 50, "height_px": 40}})", x_px);
  };
  const dem::MapGrid whole = of(area_of("700", "")).request.grid;
  const dem::MapGrid part = of(area_of("700", window(20))).request.grid;
  EXPECT_EQ(part.west_m, whole.west_m + 200);
  EXPECT_EQ(part.north_m, whole.north_m - 100);
  EXPECT_EQ(part.width, 50);
  EXPECT_EQ(part.height, 40);
  EXPECT_EQ(pointer_of(R"({"products": ["height"], "map": )" + area_of("700", window(21)) + "}"), "/map/window");
  // The limit of pixels counts those of the answer.
  EXPECT_EQ(pointer_of(R"({"products": ["height"], "map": )" + area_of("655000", "") + "}"), "/map/gsd_m");
  EXPECT_EQ(of(area_of("655000", window(65450))).request.grid.width, 50);
}

TEST(MapJson, AResolvedRequestResolvesToItself) {
  for (const char* projection : {"equirectangular", "polar_stereographic", "orthographic"})
    for (const char* view : {R"("nadir")", R"({"direction": [1, 2, 3]})"}) {
      const MapQuery query =
          read(std::string(R"({"sun": {"utc": "2026-11-20T00:00:00Z"}, "products": ["lit", "radiance"], "view": )") +
               view + R"(, "map": {"projection": ")" + projection + "\", " + kSite + "}");
      const OrderedJson resolved = resolved_json(query);
      EXPECT_EQ(resolved_json(read(resolved.dump())), resolved);
      EXPECT_EQ(resolved["products"], OrderedJson({"radiance", "lit"}));
    }
}

TEST(MapJson, PngHoldsOneNumberAPixel) {
  MapQuery query = of(std::string(R"({"projection": "orthographic", )") + kSite);
  EXPECT_NO_THROW(check_map_answer(query, "image/png"));
  query.request.products = engine::kHeight | engine::kSlope;
  EXPECT_THROW(check_map_answer(query, "image/png"), RequestError);
  EXPECT_NO_THROW(check_map_answer(query, "image/tiff"));
  query.request.products = engine::kNormal;
  EXPECT_THROW(check_map_answer(query, "image/png"), RequestError);
}

TEST(MapJson, HashesDifferWhereAnswersDo) {
  MapQuery query = of(std::string(R"({"projection": "orthographic", )") + kSite);
  const std::string hash = content_hash(query, 1 << 30, 7, "image/tiff");
  EXPECT_EQ(hash, content_hash(query, 1 << 30, 7, "image/tiff"));
  EXPECT_NE(hash, content_hash(query, 1 << 29, 7, "image/tiff"));
  EXPECT_NE(hash, content_hash(query, 1 << 30, 8, "image/tiff"));
  EXPECT_NE(hash, content_hash(query, 1 << 30, 7, "image/png"));
  query.request.products |= engine::kSlope;
  EXPECT_NE(hash, content_hash(query, 1 << 30, 7, "image/tiff"));
}

}  // namespace
}  // namespace selenograph::api
