// Meshes from files in the formats that people have.
#include "engine/scene/object_shape.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "dem/support/error.h"
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

// Corners to tenths of a micrometre, a thousand kilometres from the file's origin: float would have 6 cm of them.
TEST_F(ObjectShapes, FarFromTheOriginNothingIsLost) {
  const Vec3 away(1234567.125, -987654.25, 345678.5);
  const Vec3 places[] = {{0, 0, 0}, {0.1234567, 0, 0}, {0, 0.7654321, 0.0000001}, {0.5, 0.5, 0.25}};
  std::string obj = "# far\n", ascii, lines;
  for (const Vec3& p : places) {
    const Vec3 q = p + away;
    obj += fmt::format("v {:.10f} {:.10f}\t{:.10f} 1.0\r\n", q.x(), q.y(), q.z());
    lines += fmt::format("7 {:.10f} {:.10f} {:.10f}\n", q.x(), q.y(), q.z());
  }
  obj += "f 1 2 3\nf 1 2 4\n";
  const std::string properties = "property uchar w\nproperty double x\nproperty double y\nproperty double z\n";
  const auto header = [&](const char* format) {
    return fmt::format(
        "ply\nformat {} 1.0\ncomment far\nelement vertex 4\n{}element face 2\nproperty list uchar int "
        "vertex_indices\nend_header\n",
        format, properties);
  };
  ascii = header("ascii") + lines + "3 0 1 2\n3 0 1 3\n";
  const auto binary = [&](bool big) {
    std::string file = header(big ? "binary_big_endian" : "binary_little_endian");
    const auto put = [&](auto value) {
      char bytes[sizeof value];
      std::memcpy(bytes, &value, sizeof value);
      if (big) std::reverse(std::begin(bytes), std::end(bytes));
      file.append(bytes, sizeof value);
    };
    for (const Vec3& p : places) {
      file += '\7';
      for (const double x : Vec3(p + away)) put(x);
    }
    for (const int last : {2, 3}) {
      file += '\3';
      for (const std::int32_t corner : {0, 1, last}) put(corner);
    }
    return file;
  };
  for (const auto& [name, file] : {std::pair<const char*, std::string>{"far.obj", obj},
                                   {"ascii.ply", ascii},
                                   {"little.ply", binary(false)},
                                   {"big.ply", binary(true)}}) {
    const ObjectShape shape = test::read_shape(write(name, file));
    ASSERT_EQ(shape.triangles.size(), 2U) << name;
    for (const ObjectTriangle& t : shape.triangles)
      for (int k = 0; k < 3; ++k) {
        double nearest = 1;
        for (const Vec3& p : places) nearest = std::min(nearest, (shape.place(t, k) - (p + away)).norm());
        EXPECT_LT(nearest, 1e-7) << name;
      }
    EXPECT_EQ(shape.rounding, 0) << name;
    EXPECT_TRUE(ObjectMesh(shape).notes().empty());
  }
  // Where the file itself holds float, it is said.
  std::string rounded = binary(false);
  ObjectShape shape = test::read_shape(write(
      "float.ply",
      fmt::format("ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float "
                  "y\nproperty float z\nelement face 1\nproperty list uchar int "
                  "vertex_indices\nend_header\n") +
          [&] {
            std::string bytes;
            for (const Vec3& p : {places[0], places[1], places[2]})
              for (const double x : Vec3(p + away)) {
                const auto value = static_cast<float>(x);
                bytes.append(reinterpret_cast<const char*>(&value), 4);
              }
            const std::int32_t corners[] = {0, 1, 2};
            return bytes + '\3' + std::string(reinterpret_cast<const char*>(corners), 12);
          }()));
  EXPECT_NEAR(shape.rounding, 1234567 * 0x1p-24, 0.01);
  ASSERT_EQ(ObjectMesh(shape).notes().size(), 1U);
  EXPECT_NE(ObjectMesh(shape).notes()[0].find("float"), std::string::npos);
}

// The root node of a glTF far away: its translation is text.
TEST_F(ObjectShapes, AGltfFarAway) {
  const std::string near = test::gltf_file();
  const ObjectShape here = test::read_shape(write("near.gltf", near));
  nlohmann::json gltf = nlohmann::json::parse(near);
  nlohmann::json& root = gltf["nodes"][gltf["scenes"][0]["nodes"][0].get<std::size_t>()];
  ASSERT_TRUE(root.contains("translation")) << root;
  const double moved = root["translation"][0].get<double>() + 4e6 + 0.123456789;
  root["translation"][0] = moved;
  const ObjectShape there = test::read_shape(write("far.gltf", gltf.dump()));
  for (int k = 0; k < 3; ++k)
    EXPECT_NEAR(
        (there.place(there.triangles[0], k) - here.place(here.triangles[0], k) - Vec3(4e6 + 0.123456789, 0, 0)).norm(),
        0, 1e-6);
  // The same in a .glb.
  gltf["buffers"][0].erase("uri");
  std::string json = gltf.dump();
  json.resize((json.size() + 3) / 4 * 4, ' ');
  const auto bytes = [](std::size_t n) {
    const auto number = static_cast<std::uint32_t>(n);
    return std::string(reinterpret_cast<const char*>(&number), 4);
  };
  const float corners[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const std::string triangle(reinterpret_cast<const char*>(corners), sizeof corners);
  const ObjectShape binary =
      test::read_shape(write("far.glb", "glTF" + bytes(2) + bytes(28 + json.size() + 36) + bytes(json.size()) + "JSON" +
                                            json + bytes(36) + std::string("BIN\0", 4) + triangle));
  EXPECT_EQ(binary.place(binary.triangles[0], 0), there.place(there.triangles[0], 0));
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
