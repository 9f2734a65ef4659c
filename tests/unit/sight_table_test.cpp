// Tables of lines of sight against the lenses that they are taken from, their inverse, and what is refused.
#include "engine/camera/sight_table.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "dem/base/error.h"
#include "engine/camera/view.h"

namespace selenograph::engine {
namespace {

// OpenCV's terms, a tilted sensor included: no symmetry is left.
Camera calibrated() {
  return {321, 257, 300, 305, 158, 131, {-0.12, 0.03, 0, 0.002, -0.001, 0, 0, 0, 0.003, 0, -0.002, 0, 2, -3}};
}

std::vector<Vec3> directions_of(const Camera& camera, int columns, int rows) {
  const Projection projection(camera);
  std::vector<Vec3> directions;
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i)
      directions.push_back(
          projection.direction((camera.width - 1.0) * i / (columns - 1), (camera.height - 1.0) * j / (rows - 1))
              .value()
              .normalized());
  return directions;
}

Camera table_camera(int columns, int rows, const std::vector<Vec3>& directions) {
  Camera camera{321, 257};
  set_sights(std::make_shared<SightTable>("name", columns, rows, directions, "name.tif"), camera);
  return camera;
}

Camera table_of(const Camera& camera, int columns, int rows) {
  return table_camera(columns, rows, directions_of(camera, columns, rows));
}

// Largest distance, from `margin_px` beyond the border pixels' centres on, of the table's image of a pixel's direction
// from the pixel.
double largest_error_px(const Camera& camera, const Camera& table, double margin_px = 0) {
  const Projection lens(camera), sights(table);
  double largest = 0;
  for (double y = -margin_px; y <= camera.height - 1 + margin_px; y += 3.1)
    for (double x = -margin_px; x <= camera.width - 1 + margin_px; x += 2.9) {
      const auto pixel = sights.image(*lens.direction(x, y));
      EXPECT_TRUE(pixel) << x << ' ' << y;
      if (pixel) largest = std::max(largest, std::hypot(pixel->x - x, pixel->y - y));
    }
  return largest;
}

TEST(SightTableTest, ImagesAsTheLensThatItIsTakenFrom) {
  const Camera camera = calibrated();
  EXPECT_LT(largest_error_px(camera, table_of(camera, 321, 257)), 2e-6);
  EXPECT_LT(largest_error_px(camera, table_of(camera, 321, 257), 0.5), 1e-3);  // straight on beyond the nodes
  const double coarse = largest_error_px(camera, table_of(camera, 21, 17));
  EXPECT_LT(coarse, 0.01);
  EXPECT_LT(largest_error_px(camera, table_of(camera, 41, 33)), coarse / 6);  // of third order
}

TEST(SightTableTest, IsExactForAPinhole) {
  const Camera pinhole{321, 257, 280, 290, 150, 120, {}};
  const Camera table = table_of(pinhole, 2, 3);
  EXPECT_NEAR(table.fx, 280, 1e-9);
  EXPECT_NEAR(table.fy, 290, 1e-9);
  EXPECT_NEAR(table.cx, 150, 1e-9);
  EXPECT_NEAR(table.cy, 120, 1e-9);
  EXPECT_LT(largest_error_px(pinhole, table, 0.5), 1e-9);
}

TEST(SightTableTest, DirectionsInvertPixels) {
  const Camera table = table_of(calibrated(), 21, 17);
  const Projection projection(table);
  for (double y = -40; y <= 300; y += 17)
    for (double x = -50; x <= 370; x += 15) {
      const auto back = projection.image(*projection.direction(x, y));
      ASSERT_TRUE(back) << x << ' ' << y;
      EXPECT_NEAR(back->x, x, 1e-8);
      EXPECT_NEAR(back->y, y, 1e-8);
    }
  EXPECT_FALSE(projection.direction(-170, 100));
  EXPECT_FALSE(projection.image({3, 0, 1}));
}

TEST(SightTableTest, JacobianIsTheDerivative) {
  const Lens lens(table_of(calibrated(), 21, 17));
  const double h = 1e-6;
  const Mat2 j = lens.jacobian(0.3, -0.2);
  EXPECT_LT((j.col(0) - (lens.distorted(0.3 + h, -0.2) - lens.distorted(0.3 - h, -0.2)) / (2 * h)).norm(), 1e-8);
  EXPECT_LT((j.col(1) - (lens.distorted(0.3, -0.2 + h) - lens.distorted(0.3, -0.2 - h)) / (2 * h)).norm(), 1e-8);
}

// The scale of a view is an upper bound: pixels per radian of any step from the camera.
TEST(SightTableTest, BoundsItsScale) {
  const View view(table_of(calibrated(), 21, 17), Pose{});
  const double step = 1e-6;
  for (double y = 0; y <= 256; y += 16)
    for (double x = 0; x <= 320; x += 16) {
      const Vec3 direction = view.ray(x, y)->normalized(), across = direction.unit_orthogonal();
      for (double angle = 0; angle < 6; angle += 0.4) {
        const Vec3 turned = AngleAxis(angle, direction) * across;
        const auto moved = view.project(direction + step * turned);
        EXPECT_LE(std::hypot(moved->x - x, moved->y - y), step * view.pixels_per_metre_from(1));
      }
    }
}

TEST(SightTableTest, RefusesWhatIsNoImage) {
  const std::vector<Vec3> good = directions_of(calibrated(), 5, 4);
  const auto refused = [&](int columns, int rows, std::vector<Vec3> directions) -> std::string {
    try {
      SightTable("name", columns, rows, directions, "name.tif");
    } catch (const DataError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_EQ(refused(5, 4, good), "");
  EXPECT_NE(refused(20, 1, good).find("20 x 1"), std::string::npos);
  auto bad = good;
  bad[7].z() = -bad[7].z();
  EXPECT_NE(refused(5, 4, bad).find("column 2, row 1"), std::string::npos);
  bad = good;
  bad[3].x() = std::nan("");
  EXPECT_NE(refused(5, 4, bad).find("column 3, row 0"), std::string::npos);
  bad = good;
  std::swap(bad[7], bad[8]);
  EXPECT_NE(refused(5, 4, bad).find("fold"), std::string::npos);
  bad = good;
  for (Vec3& d : bad) d.x() = -d.x();
  EXPECT_NE(refused(5, 4, bad).find("+x"), std::string::npos);
  EXPECT_NE(refused(5, 4, std::vector<Vec3>(20, Vec3::unit_z())).find("+x"), std::string::npos);
}

}  // namespace
}  // namespace selenograph::engine
