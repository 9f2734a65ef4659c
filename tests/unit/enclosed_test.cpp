#include "engine/visibility/objects/enclosed.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

#include "dem/base/error.h"
#include "engine/visibility/objects/object_mesh.h"
#include "tests/support/vec_text.h"

namespace selenograph::engine {
namespace {

// A cube of side 2 around the origin, its sides wound counter-clockwise as seen from outside. The sides are, in order,
// -z, +z, -y, +y, -x, +x.
ObjectShape cube(std::size_t sides) {
  constexpr std::uint32_t kSides[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                          {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  ObjectShape shape;
  for (int k = 0; k < 8; ++k)
    shape.corners.push_back({{k & 1 ? 1.F : -1.F, k & 2 ? 1.F : -1.F, k & 4 ? 1.F : -1.F}, Vec3f::zero()});
  for (std::size_t side = 0; side < sides; ++side) {
    const auto& c = kSides[side];
    shape.triangles.push_back({{c[0], c[1], c[2]}, 0});
    shape.triangles.push_back({{c[0], c[2], c[3]}, 0});
  }
  shape.parts = {"side"};
  return shape;
}

TEST(Enclosed, WindingNumberIsOneInsideAndZeroOutside) {
  for (const Vec3& inside : {Vec3(0, 0, 0), Vec3(0.99, -0.99, 0.5), Vec3(1e-300, 5e-324, 0)})
    EXPECT_NEAR(winding_number(cube(6), inside), 1, 1e-12) << inside;
  for (const Vec3& outside : {Vec3(1.01, 0, 0), Vec3(5, 5, 5), Vec3(0, -1e9, 0)})
    EXPECT_NEAR(winding_number(cube(6), outside), 0, 1e-12) << outside;
  // Each side of a cube takes a sixth of the sphere around its centre.
  EXPECT_NEAR(winding_number(cube(5), Vec3::zero()), 5.0 / 6, 1e-12);
}

std::string refusal(const ObjectShape& shape, const Vec3& camera_m) {
  SceneObject object;
  object.mesh = std::make_shared<ObjectMesh>(shape);
  object.position_m = {1.8e6, 0, 0};
  object.moon_from_object = AngleAxis(std::acos(-1.0) / 4, Vec3::unit_z());
  object.scale = 10;
  try {
    refuse_enclosed(nullptr, {object}, camera_m, "the camera", {});
  } catch (const ImpossibleRequest& error) {
    return error.what();
  }
  return "";
}

TEST(Enclosed, PlacesInsideClosedObjectsAreRefused) {
  // The turned cube's edge is 14.1 m from its centre, the middle of its sides 10 m.
  EXPECT_NE(refusal(cube(6), {1.8e6 + 13.9, 0, 0}).find("the camera is inside objects/0"), std::string::npos);
  EXPECT_EQ(refusal(cube(6), {1.8e6 + 14.3, 0, 0}), "");
  const double side_m = std::sqrt(0.5);
  EXPECT_NE(refusal(cube(6), Vec3(1.8e6, 0, 0) + 9.9 * Vec3(side_m, side_m, 0)), "");
  EXPECT_EQ(refusal(cube(6), Vec3(1.8e6, 0, 0) + 10.1 * Vec3(side_m, side_m, 0)), "");
}

TEST(Enclosed, OpenObjectsHaveNoInside) { EXPECT_EQ(refusal(cube(5), {1.8e6, 0, 0}), ""); }

}  // namespace
}  // namespace selenograph::engine
