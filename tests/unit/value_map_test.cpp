// Maps with values in closed form: what a pixel's footprint gets of them.
#include "dem/value_maps/value_map.h"

#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <numbers>
#include <random>
#include <thread>

#include "dem/base/error.h"
#include "dem/gdal/geotiff_writer.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

const StopToken kNever;

ValueMap opened(const ValueMapOptions& options) { return {options, make_value_map_tiles(std::size_t{16} << 20)}; }

using Value = std::function<double(double lat_deg, double lon_deg)>;

class ValueMaps : public ::testing::Test {
 protected:
  // `across` x `down` texels over a rectangle given by its outer borders.
  std::string write(const std::string& name, const Footprint& f, int across, int down, const Value& value) {
    const double dx = (f.east_deg - f.west_deg) / across, dy = (f.north_deg - f.south_deg) / down;
    std::vector<float> values;
    for (int y = 0; y < down; ++y)
      for (int x = 0; x < across; ++x)
        values.push_back(static_cast<float>(value(f.north_deg - (y + 0.5) * dy, f.west_deg + (x + 0.5) * dx)));
    write_geotiff(folder_ / name, {f.north_deg - dy / 2, f.west_deg + dx / 2, dy, dx, across, down}, values, "value");
    return folder_ / name;
  }
  ValueMap open(const std::string& path) {
    ValueMapOptions options;
    options.path = path;
    return opened(options);
  }
  test::TemporaryFolder folder_;
};

// A square of so many metres.
ValueMap::Sampler::Mean square(const ValueMap& map, double lat_deg, double lon_deg, double side_m = 1) {
  return ValueMap::Sampler(map, kNever).mean({lat_deg, lon_deg, {side_m, 0}, {0, side_m}});
}
double mean(const ValueMap& map, double lat_deg, double lon_deg, double side_m = 1) {
  return square(map, lat_deg, lon_deg, side_m).value;
}

// Warm and cold stripes emit as much by their mean as one by one: sums of T^4. Neither is below 0 K.
TEST_F(ValueMaps, TemperaturesHaveTheMeanOfTheirFourthPowers) {
  ValueMapOptions options;
  options.path = write("stripes.tif", {-8, 8, 0, 16}, 64, 64,
                       [](double, double lon) { return std::fmod(lon, 0.5) < 0.25 ? 250 : -40; });
  options.fourth_power = true;
  const ValueMap map = opened(options);
  EXPECT_NEAR(mean(map, 0.125, 2.125), 250, 1e-3);
  EXPECT_NEAR(mean(map, 0.125, 2.375), 0, 1e-3);
  EXPECT_NEAR(mean(map, 0, 8, 300000), 250 / std::pow(2, 0.25), 0.5);
  const double lats[kFootprints] = {0.125}, lons[kFootprints] = {2.25}, cosines[kFootprints] = {1},
               metre[kFootprints] = {1}, none[kFootprints] = {};
  double values[kFootprints];
  ASSERT_EQ(ValueMap::Sampler(map, kNever).means_of_small({lats, lons, cosines, metre, none, none, metre}, 1, values),
            1u);
  EXPECT_NEAR(values[0], 250 / std::pow(2, 0.25), 1e-3);
}

// Sixteen at once, where they are small, have the means that each has alone: over several tiles, beside voids and the
// map's borders, and past the date line.
TEST_F(ValueMaps, SmallFootprintsTogetherHaveTheirOwnMeans) {
  std::mt19937 random(31);
  std::normal_distribution<float> any(0.5F, 0.2F);
  // 3.6 km, so that a thousandth of a degree is nothing.
  const Footprint all{-12, 12, 168, 204};
  const ValueMap map = open(write("noise.tif", all, 300, 200, [&](double lat, double lon) {
    return std::hypot(lat - 3, lon - 182) < 1 ? std::nan("") : static_cast<double>(any(random));
  }));
  ValueMap::Sampler sampler(map, kNever);
  std::uniform_real_distribution<double> lat(-13, 13), lon(166, 206), side(-1500, 1500), near(-0.15, 0.15);
  int found = 0, beside_voids = 0;
  for (int packet = 0; packet < 3000; ++packet) {
    double lats[kFootprints], lons[kFootprints], cosines[kFootprints], ae[kFootprints], an[kFootprints],
        be[kFootprints], bn[kFootprints], values[kFootprints];
    const double middle_lat = lat(random), middle_lon = lon(random) - (packet % 2 ? 360 : 0);
    for (std::size_t i = 0; i < kFootprints; ++i) {
      lats[i] = middle_lat + near(random), lons[i] = middle_lon + near(random);
      cosines[i] = std::cos(lats[i] * kRadiansPerDegree);
      ae[i] = side(random), an[i] = side(random), be[i] = side(random), bn[i] = side(random);
    }
    const std::uint32_t bits = sampler.means_of_small({lats, lons, cosines, ae, an, be, bn}, 0xffff, values);
    for (std::size_t i = 0; i < kFootprints; ++i) {
      const auto [value, coverage] = sampler.mean({lats[i], lons[i], {ae[i], an[i]}, {be[i], bn[i]}});
      beside_voids += coverage > 0 && coverage < 1;
      if (!(bits >> i & 1)) continue;
      ++found;
      // Alone, a side shorter than a twentieth of a texel counts as a point.
      ASSERT_NEAR(values[i], value, 3e-4) << lats[i] << " " << lons[i];
      ASSERT_EQ(coverage, 1) << lats[i] << " " << lons[i];
    }
  }
  EXPECT_GT(found, 30000) << "those across texels' centres, too";
  EXPECT_GT(beside_voids, 100);
}

TEST_F(ValueMaps, AreLinearBetweenTexels) {
  const auto plane = [](double lat, double lon) { return 0.1 + 0.01 * lat - 0.003 * lon; };
  const ValueMap map = open(write("plane.tif", {-5, 5, 20, 30}, 100, 100, plane));
  for (double lat = -4.9; lat < 4.9; lat += 0.37)
    for (double lon = 20.1; lon < 29.9; lon += 0.29) ASSERT_NEAR(mean(map, lat, lon), plane(lat, lon), 2e-8);
  EXPECT_NEAR(mean(map, 1, 25 - 360), plane(1, 25), 2e-8) << "by any turn";
  EXPECT_TRUE(std::isnan(mean(map, 5.2, 25)));
  EXPECT_TRUE(std::isnan(mean(map, 0, 19.8)));
  EXPECT_TRUE(std::isnan(mean(map, 0, 30.2)));
}

// A wave of length l seen by a square of side s keeps sin(pi s / l) / (pi s / l) of its height.
TEST_F(ValueMaps, AFootprintIsAMeanOverItsArea) {
  const double length_deg = 0.8;
  const ValueMap map = open(write("wave.tif", {0, 8, 0, 8}, 800, 800, [&](double, double lon) {
    return 0.5 + 0.4 * std::sin(2 * std::numbers::pi * lon / length_deg);
  }));
  for (const double share : {0.05, 0.1, 0.2, 0.3, 0.5}) {
    const double lat = 4, lon = 3 * length_deg + length_deg / 4;  // a crest
    const double east_m = share * length_deg * kMetresPerDegree * std::cos(lat * std::numbers::pi / 180);
    const double kept = (ValueMap::Sampler(map, kNever).mean({lat, lon, {east_m, 0}, {0, east_m}}).value - 0.5) / 0.4;
    const double x = std::numbers::pi * share;
    EXPECT_NEAR(kept, std::sin(x) / x, 0.02) << share;
  }
}

// Down to footprints of a tenth of a texel: the mean of what is linear between random texels, by summing it up.
TEST_F(ValueMaps, SmallFootprintsAreMeansToo) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> any(0, 1), place(1, 1.7);
  const ValueMap map = open(write("random.tif", {0, 3, 0, 3}, 300, 300, [&](double, double) { return any(random); }));
  ValueMap::Sampler sampler(map, kNever);
  for (const double texels : {0.1, 0.5, 1.0, 1.5, 2.0, 3.0}) {
    double square = 0, point = 0;
    constexpr int kPlaces = 60;
    for (int n = 0; n < kPlaces; ++n) {
      const double lat = place(random), lon = place(random), turn = 6.3 * any(random);
      // A tenth of a metre at 0.01 degrees a texel; 1 degree north of the equator columns are as wide as rows.
      const double side_m = texels * 0.01 * kMetresPerDegree;
      const std::array<double, 2> a{side_m * std::cos(turn), side_m * std::sin(turn)}, b{-a[1], a[0]};
      constexpr int kSteps = 24;
      double sum = 0;
      for (int j = 0; j < kSteps; ++j)
        for (int i = 0; i < kSteps; ++i) {
          const double u = (i + 0.5) / kSteps - 0.5, v = (j + 0.5) / kSteps - 0.5;
          sum += sampler
                     .mean({lat + (u * a[1] + v * b[1]) / kMetresPerDegree,
                            lon + (u * a[0] + v * b[0]) / kMetresPerDegree / std::cos(lat * std::numbers::pi / 180),
                            {1e-3, 0},
                            {0, 1e-3}})
                     .value;
        }
      const double exact = sum / kSteps / kSteps;
      square += std::pow(sampler.mean({lat, lon, a, b}).value - exact, 2);
      point += std::pow(sampler.mean({lat, lon, {1e-3, 0}, {0, 1e-3}}).value - exact, 2);
    }
    // The texels' own spread is 0.29.
    EXPECT_LT(std::sqrt(square / kPlaces), 0.008) << texels;
    if (texels == 1.5) {
      EXPECT_GT(std::sqrt(point / kPlaces), 0.05) << "a point would not do";
    }
  }
}

// Seen obliquely a footprint is long and narrow: along the stripes it must not wash them out, across it must.
TEST_F(ValueMaps, LongFootprintsAreFilteredAlongThemselves) {
  const auto stripes = [](double, double lon) { return std::fmod(lon, 0.08) < 0.04 ? 0.8 : 0.2; };
  const ValueMap map = open(write("stripes.tif", {0, 4, 0, 4}, 400, 400, stripes));
  const double texel_m = 0.01 * kMetresPerDegree;
  ValueMap::Sampler sampler(map, kNever);
  EXPECT_NEAR(sampler.mean({2, 2.02, {texel_m, 0}, {0, 14 * texel_m}}).value, 0.8, 0.02);
  EXPECT_NEAR(sampler.mean({2, 2.02, {0, 14 * texel_m}, {texel_m, 0}}).value, 0.8, 0.02);
  EXPECT_NEAR(sampler.mean({2, 2.02, {16 * texel_m, 0}, {0, texel_m}}).value, 0.5, 0.02);
  // Diagonally, six stripes.
  EXPECT_NEAR(sampler.mean({2, 2.02, {11.3 * texel_m, 11.3 * texel_m}, {0.7 * texel_m, -0.7 * texel_m}}).value, 0.5,
              0.1);
}

TEST_F(ValueMaps, AGlobalMapHasNoSeam) {
  const auto smooth = [](double lat, double lon) {
    return 0.5 + 0.3 * std::cos(lat * std::numbers::pi / 180) * std::cos((lon - 170) * std::numbers::pi / 180);
  };
  // 720 columns halve to an odd number: the seam of coarse levels is between texels of unlike width.
  for (const double west : {-180.0, 0.0}) {
    const ValueMap map = open(write("global" + std::to_string(static_cast<int>(west)) + ".tif",
                                    {-90, 90, west, west + 360}, 720, 360, smooth));
    for (const double lon : {-180.0, -179.9, 179.9, 180.0, 0.0, -0.1, 0.1, 359.9})
      for (const double side_m : {1.0, 60e3, 400e3})
        ASSERT_NEAR(mean(map, 10, lon, side_m), smooth(10, lon), 0.004) << lon;
    for (const double lat : {89.0, 89.9, 90.0, -90.0, -76.0})
      for (const double side_m : {1000.0, 60e3}) ASSERT_NEAR(mean(map, lat, 33, side_m), smooth(lat, 33), 0.006) << lat;
  }
}

TEST_F(ValueMaps, NoDataIsLeftOut) {
  const ValueMap map =
      open(write("hole.tif", {0, 4, 0, 4}, 400, 400, [](double lat, double) { return lat > 2 ? std::nan("") : 0.3; }));
  EXPECT_TRUE(std::isnan(mean(map, 2.5, 2)));
  EXPECT_EQ(square(map, 2.5, 2).coverage, 0);
  EXPECT_NEAR(mean(map, 1.5, 2), 0.3, 1e-6);
  EXPECT_EQ(square(map, 1.5, 2).coverage, 1);
  EXPECT_NEAR(mean(map, 1.996, 2), 0.3, 1e-6) << "half a texel from the border";
  EXPECT_NEAR(mean(map, 1.9, 2, 20000), 0.3, 1e-6) << "a large pixel over the border";
  // 20 km are 66 texels; 0.1 degrees of them south of the border, and half.
  EXPECT_NEAR(square(map, 1.9, 2, 20000).coverage, 0.5 + 10 / 65.95, 0.02);
}

// Means at every size keep what a hole of no data takes away from them: its share of the footprint.
TEST_F(ValueMaps, HolesRemainInOverviews) {
  const auto in_hole = [](double lat, double lon) { return std::hypot(lat - 2.03, lon - 2.07) < 0.123; };
  const ValueMap map = open(write("disc.tif", {0, 4, 0, 4}, 400, 400,
                                  [&](double lat, double lon) { return in_hole(lat, lon) ? std::nan("") : 0.3; }));
  const double area = std::numbers::pi * 0.123 * 0.123;
  for (const double pixel_deg : {0.04, 0.1, 0.25, 0.5}) {
    double lost = 0;
    for (double lat = 1; lat < 3; lat += pixel_deg)
      for (double lon = 1; lon < 3; lon += pixel_deg) {
        const double y = lat + pixel_deg / 2, x = lon + pixel_deg / 2;
        const double east_m = pixel_deg * kMetresPerDegree * std::cos(y * std::numbers::pi / 180);
        const auto one = ValueMap::Sampler(map, kNever).mean({y, x, {east_m, 0}, {0, pixel_deg * kMetresPerDegree}});
        lost += (1 - one.coverage) * pixel_deg * pixel_deg;
      }
    EXPECT_NEAR(lost, area, 0.05 * area) << pixel_deg;
  }
}

void with_gdal(const std::string& driver, const std::string& path, int across, int down, int bands, GDALDataType type,
               const std::function<void(GDALDataset&)>& fill) {
  GDALAllRegister();
  GDALDataset* d =
      GetGDALDriverManager()->GetDriverByName(driver.c_str())->Create(path.c_str(), across, down, bands, type, nullptr);
  ASSERT_NE(d, nullptr);
  fill(*d);
  GDALClose(d);
}

TEST_F(ValueMaps, TheFilesOwnOverviewsAreUsed) {
  const std::string path = write("overview.tif", {0, 4, 0, 4}, 512, 512, [](double, double) { return 0.2; });
  GDALDataset* d = static_cast<GDALDataset*>(GDALOpen(path.c_str(), GA_Update));
  int factor = 4;
  ASSERT_EQ(d->BuildOverviews("AVERAGE", 1, &factor, 0, nullptr, nullptr, nullptr), CE_None);
  std::vector<float> other(128 * 128, 0.7F);
  ASSERT_EQ(d->GetRasterBand(1)->GetOverview(0)->RasterIO(GF_Write, 0, 0, 128, 128, other.data(), 128, 128, GDT_Float32,
                                                          0, 0, nullptr),
            CE_None);
  GDALClose(d);
  const ValueMap map = open(path);
  const double texel_m = 4.0 / 512 * kMetresPerDegree;
  EXPECT_NEAR(mean(map, 2, 2, texel_m), 0.2, 1e-6);
  EXPECT_NEAR(mean(map, 2, 2, 8 * texel_m), 0.7, 1e-3);
  EXPECT_NEAR(mean(map, 2, 2, 40 * texel_m), 0.7, 1e-3) << "levels above are made of it";
}

// A picture that says nothing of itself: extent, bands and scale are told.
TEST_F(ValueMaps, PicturesFollowTheirDescription) {
  const std::string path = folder_ / "picture.tif";
  with_gdal("GTiff", path, 40, 20, 3, GDT_Byte, [](GDALDataset& d) {
    for (int b = 1; b <= 3; ++b) {
      std::vector<std::uint8_t> samples(800, static_cast<std::uint8_t>(60 * b));
      samples[0] = 255;
      ASSERT_EQ(d.GetRasterBand(b)->RasterIO(GF_Write, 0, 0, 40, 20, samples.data(), 40, 20, GDT_Byte, 0, 0, nullptr),
                CE_None);
    }
  });
  ValueMapOptions told;
  told.path = path;
  EXPECT_THROW(opened(told), DataError) << "where is it?";
  told.extent = Footprint{-10, 10, 350, 390};
  told.scale = 0.001, told.offset = 0.05;
  EXPECT_NEAR(mean(opened(told), 0, 10), 0.17, 1e-6) << "mean of 60, 120, 180";
  told.bands = {3};
  EXPECT_NEAR(mean(opened(told), 0, -5), 0.23, 1e-6);
  EXPECT_NEAR(mean(opened(told), 9.5, 350.5), 0.305, 1e-6);
  const std::uint64_t linear = opened(told).fingerprint();
  told.exponent = 2.8;
  EXPECT_NEAR(mean(opened(told), 0, -5), std::pow(0.23, 2.8), 1e-6);
  EXPECT_NE(opened(told).fingerprint(), linear);
  told.exponent = 1;
  const std::uint64_t fingerprint = opened(told).fingerprint();
  told.high = 0.25;
  EXPECT_NEAR(mean(opened(told), 9.5, 350.5), 0.25, 1e-6);
  EXPECT_NE(opened(told).fingerprint(), fingerprint);
  told.no_data = 180;
  EXPECT_TRUE(std::isnan(mean(opened(told), 0, 10)));
  told.bands = {4};
  EXPECT_THROW(opened(told), DataError);
}

// Returns whether this process has a file open.
bool is_open(const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc/self/fd"))
    if (fs::read_symlink(entry.path(), error) == fs::canonical(path)) return true;
  return false;
}

// A JPEG is decoded from its first row on: whoever reads rows from below would have all above them decoded each time.
// One that is closed while its map is read is decoded no more.
TEST_F(ValueMaps, AJpegIsDecodedOnce) {
  const std::string path = folder_ / "colours.jpg";
  constexpr int kAcross = 1024, kDown = 512;
  with_gdal("GTiff", folder_ / "colours.tif", kAcross, kDown, 3, GDT_Byte, [&](GDALDataset& d) {
    for (int y = 0; y < kDown; ++y) {
      std::vector<std::uint8_t> row(3 * kAcross, static_cast<std::uint8_t>(y / 4 + 50));
      ASSERT_EQ(d.RasterIO(GF_Write, 0, y, kAcross, 1, row.data(), kAcross, 1, GDT_Byte, 3, nullptr, 0, 0, 0, nullptr),
                CE_None);
    }
    GDALDriver* jpeg = GetGDALDriverManager()->GetDriverByName("JPEG");
    GDALClose(jpeg->CreateCopy(path.c_str(), &d, FALSE, nullptr, nullptr, nullptr));
  });
  ValueMapOptions told;
  told.path = path;
  told.extent = Footprint{-90, 90, -180, 180};
  const ValueMap map = opened(told);
  EXPECT_FALSE(is_open(path));
  for (int row = kDown - 10; row > 0; row -= 31)
    EXPECT_NEAR(mean(map, 90 - (row + 0.5) * 180 / kDown, 33, 100), row / 4 + 50, 2) << row;
  EXPECT_FALSE(is_open(path));
}

// 200 x 200 texels around the origin of a projection in metres, by their places there.
void projected(const std::string& path, const std::string& projection,
               const std::function<double(double x_m, double y_m)>& value, double spacing_m = 2000) {
  const double half_m = 100 * spacing_m;
  with_gdal("GTiff", path, 200, 200, 1, GDT_Float32, [&](GDALDataset& d) {
    OGRSpatialReference srs;
    ASSERT_EQ(srs.SetFromUserInput(("+proj=" + projection + " +R=1737400 +units=m +no_defs").c_str()), OGRERR_NONE);
    double t[] = {-half_m, spacing_m, 0, half_m, 0, -spacing_m};
    ASSERT_EQ(d.SetGeoTransform(t), CE_None);
    ASSERT_EQ(d.SetSpatialRef(&srs), CE_None);
    std::vector<float> samples;
    for (int y = 0; y < 200; ++y)
      for (int x = 0; x < 200; ++x)
        samples.push_back(static_cast<float>(value(-half_m + (x + 0.5) * spacing_m, half_m - (y + 0.5) * spacing_m)));
    ASSERT_EQ(
        d.GetRasterBand(1)->RasterIO(GF_Write, 0, 0, 200, 200, samples.data(), 200, 200, GDT_Float32, 0, 0, nullptr),
        CE_None);
  });
}

// In metres around the south pole; beyond the square there is nothing.
TEST_F(ValueMaps, ProjectedRastersAreWarped) {
  const std::string path = folder_ / "polar.tif";
  projected(path, "stere +lat_0=-90 +lon_0=0 +k=1", [](double x_m, double y_m) {
    const double colatitude = 2 * std::atan(std::hypot(x_m, y_m) / (2 * kMoonRadius_m));
    return colatitude * 180 / std::numbers::pi * 0.01 + 0.1 * (x_m > 0);
  });
  const ValueMap map = open(path);
  EXPECT_NEAR(mean(map, -86, 90), 0.14, 1e-3);  // x grows toward 90 E
  EXPECT_NEAR(mean(map, -86, -90), 0.04, 1e-3);
  EXPECT_NEAR(mean(map, -88.5, 30), 0.115, 1e-3);
  EXPECT_TRUE(std::isnan(mean(map, -80, 45)));
  EXPECT_TRUE(std::isnan(mean(map, 10, 45)));
}

// Waves of twelve texels keep their height, also across the date line and around a pole. A quarter of a polar map has
// its pole on the border; the picture of a disc has nothing in its corners.
TEST_F(ValueMaps, WarpedRastersAreAsFineAsTheirFiles) {
  struct Case {
    std::string projection;
    double spacing_m, reach_m;  // of the places that are compared, from the middle
  };
  for (const Case& c :
       {Case{"ortho +lat_0=-20 +lon_0=40", 2000, 185e3}, Case{"ortho +lat_0=30 +lon_0=178", 2000, 185e3},
        Case{"eqc +lat_ts=0 +lon_0=-179", 2000, 185e3}, Case{"tmerc +lat_0=0 +lon_0=180", 2000, 185e3},
        Case{"stere +lat_0=90 +lon_0=0 +k=1", 2000, 185e3}, Case{"stere +lat_0=-90 +lon_0=30 +k=1", 2000, 185e3},
        Case{"ortho +lat_0=87 +lon_0=70", 2000, 185e3},
        Case{"stere +lat_0=90 +lon_0=0 +k=1 +x_0=-200000 +y_0=-200000", 2000, 180e3},
        Case{"stere +lat_0=90 +lon_0=0 +k=1 +x_0=200000 +y_0=-200000", 2000, 180e3},
        Case{"stere +lat_0=-90 +lon_0=30 +k=1 +x_0=0 +y_0=200000", 2000, 180e3},
        Case{"ortho +lat_0=0 +lon_0=0", 17600, 1000e3}, Case{"ortho +lat_0=20 +lon_0=178", 17600, 1000e3},
        Case{"ortho +lat_0=0 +lon_0=90 +x_0=1600000", 2000, 100e3}}) {
    SCOPED_TRACE(c.projection);
    const double wave_m = 12 * c.spacing_m;
    const auto wave = [&](double x_m, double y_m) {
      return 0.2 + 0.1 * std::sin(x_m * 2 * std::numbers::pi / wave_m) * std::sin(y_m * 2 * std::numbers::pi / wave_m);
    };
    const std::string path = folder_ / "waves.tif";
    projected(path, c.projection, wave, c.spacing_m);
    const ValueMap map = open(path);
    OGRSpatialReference plane, degrees;
    ASSERT_EQ(plane.SetFromUserInput(("+proj=" + c.projection + " +R=1737400 +units=m +no_defs").c_str()), OGRERR_NONE);
    ASSERT_EQ(degrees.SetFromUserInput("+proj=longlat +R=1737400 +no_defs"), OGRERR_NONE);
    const std::unique_ptr<OGRCoordinateTransformation> there(OGRCreateCoordinateTransformation(&plane, &degrees));
    for (double x_m = -c.reach_m; x_m < c.reach_m; x_m += 0.051 * c.reach_m)
      for (double y_m = -c.reach_m; y_m < c.reach_m; y_m += 0.047 * c.reach_m) {
        double lon_deg = x_m, lat_deg = y_m;
        ASSERT_TRUE(there->Transform(1, &lon_deg, &lat_deg));
        ASSERT_NEAR(mean(map, lat_deg, lon_deg), wave(x_m, y_m), 0.02) << lat_deg << " N, " << lon_deg << " E";
      }
  }
}

TEST_F(ValueMaps, OtherBodiesAndDamagedFilesAreRefused) {
  EXPECT_THROW(open(folder_ / "missing.tif"), DataError);
  std::ofstream(folder_ / "noise.tif") << "no picture";
  EXPECT_THROW(open(folder_ / "noise.tif"), DataError);
  const std::string earth = folder_ / "earth.tif";
  with_gdal("GTiff", earth, 10, 10, 1, GDT_Float32, [](GDALDataset& d) {
    OGRSpatialReference srs;
    srs.SetWellKnownGeogCS("WGS84");
    double t[] = {0, 1, 0, 10, 0, -1};
    d.SetGeoTransform(t), d.SetSpatialRef(&srs);
  });
  EXPECT_THROW(open(earth), DataError);
  const std::string path = write("changing.tif", {0, 4, 0, 4}, 400, 400, [](double, double) { return 0.2; });
  const ValueMap map = open(path);
  EXPECT_TRUE(map.current());
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  write("changing.tif", {0, 4, 0, 4}, 400, 400, [](double, double) { return 0.4; });
  EXPECT_FALSE(map.current());
  EXPECT_THROW(mean(map, 2, 2), DataError) << "half of one file and half of another";
  EXPECT_NEAR(mean(open(path), 2, 2), 0.4, 1e-6);
  // Other values under the old time.
  const std::uint64_t fingerprint = open(path).fingerprint();
  const auto modified = std::filesystem::last_write_time(path);
  write("changing.tif", {0, 4, 0, 4}, 400, 400, [](double, double) { return 0.2; });
  std::filesystem::last_write_time(path, modified);
  EXPECT_NE(open(path).fingerprint(), fingerprint);
}

}  // namespace
}  // namespace selenograph::dem
