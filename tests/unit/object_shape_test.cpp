// Meshes from files in the formats that people have.
#include "engine/scene/object_shape.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "dem/base/error.h"
#include "engine/visibility/objects/object_mesh.h"
#include "tests/support/mesh_files.h"
#include "tests/support/meshes.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

class ObjectShapes : public ::testing::Test {
 protected:
  std::string write(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return folder_ / name;
  }
  test::TemporaryFolder folder_;
};

double area_of(const ObjectShape& shape, std::uint32_t part) {
  double area = 0;
  for (const ObjectTriangle& t : shape.triangles)
    if (t.part == part) {
      const Vec3 a = shape.place(t, 0);
      area += (shape.place(t, 1) - a).cross(Vec3(shape.place(t, 2) - a)).norm() / 2;
    }
  return area;
}

std::uint32_t part_called(const ObjectShape& shape, const std::string& name) {
  for (std::uint32_t i = 0; i < shape.parts.size(); ++i)
    if (shape.parts[i] == name) return i;
  ADD_FAILURE() << "no part " << name;
  return 0;
}

TEST_F(ObjectShapes, TheSatelliteHasItsPartsAndTheirAreas) {
  const ObjectMesh mesh(test::read_shape(SELENOGRAPH_SOURCE_DIR "/deploy/assets/objects/satellite.obj"));
  const ObjectShape& shape = mesh.shape();
  EXPECT_EQ(shape.triangles.size(), 7U * 12);
  // Two boxes of 0.04 x 6 x 2.2.
  EXPECT_NEAR(area_of(shape, part_called(shape, "panel")), 2 * 2 * (0.04 * 6 + 6 * 2.2 + 0.04 * 2.2), 1e-4);
  // 2 x 2 x 3, three struts.
  EXPECT_NEAR(area_of(shape, part_called(shape, "body")),
              2 * (4 + 6 + 6) + 2 * 2 * (0.12 * 0.12 + 2 * 0.12 * 0.8) + 2 * (0.01 + 2 * 0.06), 1e-4);
  // From (-1, -7.8, -1.5) to (1, 7.8, 2.15).
  EXPECT_NEAR((mesh.centre() - Vec3(0, 0, 0.325)).norm(), 0, 1e-6);
  EXPECT_GT(mesh.radius(), 7.8);
}

TEST_F(ObjectShapes, PolygonsOfAnObjBecomeTriangles) {
  const ObjectShape shape = test::read_shape(write("a.obj", "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nf 1 2 3 4\n"));
  EXPECT_EQ(shape.triangles.size(), 2U);
  EXPECT_NEAR(area_of(shape, shape.triangles[0].part), 2, 1e-6);
  EXPECT_EQ(shape.corners[0].normal.norm(), 0) << "the file has none";
}

TEST_F(ObjectShapes, NormalsAreKept) {
  const ObjectShape shape =
      test::read_shape(write("n.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0.6 0.8\nvn 0 0 2\nf 1//1 2//1 3//2\n"));
  ASSERT_EQ(shape.triangles.size(), 1U);
  for (const ObjectCorner& c : shape.corners) EXPECT_NEAR(c.normal.norm(), 1, 1e-6);
  EXPECT_NEAR(shape.corners[shape.triangles[0].corner[0]].normal.y(), 0.6, 1e-6);
}

TEST_F(ObjectShapes, Ply) {
  const ObjectShape shape = test::read_shape(write("a.ply", test::ply_file(/*binary=*/false)));
  EXPECT_EQ(shape.triangles.size(), 2U);
  EXPECT_EQ(shape.parts.size(), 1U);
  EXPECT_NEAR(area_of(shape, 0), 2, 1e-6);
}

// A triangle in a buffer inside the file, on a node that is moved and scaled.
TEST_F(ObjectShapes, GltfWithANodesTransform) {
  const ObjectShape shape = test::read_shape(write("a.gltf", test::gltf_file()));
  ASSERT_EQ(shape.triangles.size(), 1U);
  const std::uint32_t foil = part_called(shape, "foil");
  EXPECT_NEAR(area_of(shape, foil), 2, 1e-6);
  EXPECT_NEAR(shape.place(shape.triangles[0], 0).x(), 10, 1e-6);
}

// A thousand kilometres from the file's origin float has 6 cm left: enough for a large object, not for a small one.
TEST_F(ObjectShapes, WarnsOfCoordinatesTooFarForFloat) {
  const auto notes = [&](double side) {
    std::string obj;
    for (const auto& [x, y] : {std::pair{0., 0.}, {side, 0.}, {0., side}})
      obj += fmt::format("v {:.3f} {:.3f} 345678.5\n", x + 1234567.125, y - 987654.25);
    return ObjectMesh(test::read_shape(write("far.obj", obj + "f 1 2 3\n"))).notes();
  };
  EXPECT_TRUE(notes(10000).empty());
  ASSERT_EQ(notes(10).size(), 1U);
  EXPECT_NE(notes(10)[0].find("float rounds them by 0.074"), std::string::npos) << notes(10)[0];
}

TEST_F(ObjectShapes, WarnsOfUnusedTextures) {
  nlohmann::json gltf = nlohmann::json::parse(test::gltf_file());
  EXPECT_TRUE(ObjectMesh(test::read_shape(write("plain.gltf", gltf.dump()))).notes().empty());
  gltf["images"] = {{{"uri", "data:image/png;base64,iVBORw0KGgo="}}};
  gltf["textures"] = {{{"source", 0}}};
  gltf["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = 0;
  const ObjectMesh mesh(test::read_shape(write("textured.gltf", gltf.dump())));
  ASSERT_EQ(mesh.notes().size(), 1U);
  EXPECT_NE(mesh.notes()[0].find("textures"), std::string::npos);
}

TEST_F(ObjectShapes, InvalidFilesAreNamed) {
  const auto refused = [&](const std::string& path) -> std::string {
    try {
      test::read_shape(path);
    } catch (const DataError& e) {
      EXPECT_EQ(e.file(), path);
      return e.what();
    }
    return "";
  };
  EXPECT_NE(refused(folder_ / "missing.obj"), "");
  EXPECT_NE(refused(write("noise.ply", "no ply at all")), "");
  EXPECT_NE(refused(write("header.ply", "ply\nformat ascii 1.0\nelement vertex 9\n")), "");
  EXPECT_NE(refused(write("cut.ply",
                          "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nproperty "
                          "float y\nproperty float z\nelement face 2\nproperty list uchar int "
                          "vertex_indices\nend_header\n1234567")),
            "");
  EXPECT_NE(refused(write("noise.glb", std::string("glTF\2\0\0\0\xff\xff\xff\xff", 12))), "");
  EXPECT_NE(refused(write("empty.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n")), "");
  EXPECT_NE(refused(write("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")), "") << "without area";
  EXPECT_NE(refused(write("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")), "");
  EXPECT_NE(refused(write("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")), "");
}

std::uint64_t fingerprint_of(const std::string& path) { return ObjectMesh(test::read_shape(path)).fingerprint(); }

// The bytes that a frame depends on, and no others.
TEST_F(ObjectShapes, FingerprintsTellShapesApart) {
  const std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
  const std::uint64_t one = fingerprint_of(write("1.obj", text));
  EXPECT_EQ(fingerprint_of(write("2.obj", "# again\n" + text)), one);
  EXPECT_NE(fingerprint_of(write("3.obj", "v 0 0 0\nv 1 0 0\nv 0 1.5 0\nusemtl a\nf 1 2 3\n")), one);
  EXPECT_NE(fingerprint_of(write("4.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl b\nf 1 2 3\n")), one);
}

}  // namespace
}  // namespace selenograph::engine
