// Mesh files that are damaged, prepared or too large, read in a process of their own; and the assets that hold them.
#include "engine/visibility/meshes/mesh_reader.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "api/assets/assets.h"
#include "api/message/problem.h"
#include "dem/base/error.h"
#include "tests/support/effort.h"
#include "tests/support/mesh_files.h"
#include "tests/support/meshes.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

class MeshFiles : public ::testing::Test {
 protected:
  std::string write(const std::string& name, const std::string& content) {
    std::ofstream(folder_ / name, std::ios::binary) << content;
    return folder_ / name;
  }
  // A program in the reader's place.
  std::string script(const std::string& text) {
    const std::string path = write("reader", "#!/bin/sh\n" + text + "\n");
    ::chmod(path.c_str(), 0700);
    return path;
  }
  static std::string fault_of(const std::string& path, const ReaderOptions& options = test::mesh_options()) {
    try {
      read_mesh(ConfinedReader(options), path);
    } catch (const DataError& e) {
      EXPECT_EQ(e.file(), path);
      return e.what();
    }
    return "";
  }
  static void expect_within(const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  }
  test::TemporaryFolder folder_;
};

TEST_F(MeshFiles, MayNotNameOtherFiles) {
  write("secret.bin", std::string(36, '\0'));
  for (const char* uri : {"/etc/hostname", "secret.bin", "../secret.bin", "file:///etc/hostname", "http://127.0.0.1/x"})
    expect_within(fault_of(write("a.gltf", test::gltf_file(uri))), std::string("names another file, \""));
  EXPECT_EQ(fault_of(write("b.gltf", test::gltf_file())), "") << "data: is no other file";
}

// Assimp takes quantised coordinates for others.
TEST_F(MeshFiles, ExtensionsOfGeometryAreRefused) {
  const auto requiring = [&](const std::string& names) {
    return fault_of(write("a.gltf", "{\"extensionsRequired\": [" + names + "]," + test::gltf_file().substr(1)));
  };
  EXPECT_EQ(requiring(""), "");
  EXPECT_EQ(requiring("\"KHR_materials_unlit\", \"KHR_texture_transform\""), "");
  for (const char* name : {"KHR_mesh_quantization", "EXT_meshopt_compression", "EXT_mesh_gpu_instancing"})
    expect_within(requiring("\"KHR_materials_unlit\" , \"" + std::string(name) + "\""),
                  std::string("requires the glTF extension ") + name);
}

// An OBJ's materials are their names, whatever the library of materials that it names would say.
TEST_F(MeshFiles, ObjMaterialsAreNamesOnly) {
  const ObjectShape shape = test::read_shape(
      write("a.obj", "mtllib /etc/hostname\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl foil\nf 1 2 3\nusemtl glass\nf 3 2 1\n"));
  EXPECT_EQ(shape.parts, (std::vector<std::string>{"foil", "glass"}));
}

TEST_F(MeshFiles, NamesAreUtf8) {
  const std::string before = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl gr";
  expect_within(fault_of(write("latin.obj", before + "\xfcn\nf 1 2 3\n")),
                "line 4: the name of a material is not UTF-8");
  EXPECT_EQ(test::read_shape(write("good.obj", before + "\xc3\xbcn\nf 1 2 3\n")).parts[0], "gr\xc3\xbcn");
}

TEST_F(MeshFiles, MustBeRegularFiles) {
  ::mkfifo((folder_ / "pipe.obj").c_str(), 0600);
  expect_within(fault_of(folder_ / "pipe.obj"), "not a regular file");
  std::filesystem::create_directory(folder_ / "folder.obj");
  expect_within(fault_of(folder_ / "folder.obj"), "not a regular file");
  // Content of another of the library's sixty formats.
  EXPECT_NE(fault_of(write("a.obj",
                           "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
                           "endloop\nendfacet\nendsolid x\n")),
            "");
  EXPECT_NE(fault_of(write("a.stl", "solid x\nendsolid x\n")), "");
}

// 26 bytes whose header asks for 4 GB.
TEST_F(MeshFiles, MemoryIsLimited) {
  std::string glb("glTF\2\0\0\0\xff\xff\xff\xff\xf0\xff\xff\xffJSON{}    ", 26);
  EXPECT_NE(fault_of(write("header.glb", glb)), "");
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers reserve addresses without end";
#endif
  // A file that fits, whose corners as numbers in a list don't.
  std::string obj = "f 1 2 3\n";
  for (int i = 0; i < 700000; ++i) obj += "v 0 0 1\n";
  ReaderOptions options = test::mesh_options();
  options.max_bytes = std::size_t{16} << 20;
  expect_within(fault_of(write("large.obj", obj), options), "takes more than 16 MiB to read");
  options.max_bytes = 1 << 20;
  expect_within(fault_of(folder_ / "large.obj", options), "takes more than 1 MiB to read");
}

TEST_F(MeshFiles, InstancesAreCountedBeforeTheyAreMade) {
  expect_within(fault_of(write("a.gltf", test::gltf_of_instances(20000, 10000))), "would take 3053 MiB");
  EXPECT_EQ(test::read_shape(write("b.gltf", test::gltf_of_instances(20, 10))).triangles.size(), 200U);
}

TEST_F(MeshFiles, MemoryOfRayTracingCounts) {
  const std::string path = write("a.gltf", test::gltf_of_instances(100, 2000));  // of 16 bytes; 95 more for rays
  ReaderOptions options = test::mesh_options();
  options.max_bytes = std::size_t{40} << 20;
  EXPECT_EQ(fault_of(path, options), "");
  options.max_bytes = std::size_t{16} << 20;
  EXPECT_NE(fault_of(path, options), "");
}

// Bytes of a damaged child: none of them may lead outside the arrays of a shape.
TEST_F(MeshFiles, DamagedAnswersAreRefused) {
  const std::string path = write("a.obj", "v 0 0 0\n");
  ReaderOptions options = test::mesh_options();
  options.program = script("cat " + (folder_ / "answer"));
  const auto fault_with = [&](const ObjectShape& shape, std::size_t triangles, const std::string& parts) {
    const std::size_t header[] = {shape.corners.size(), triangles, 0};
    std::string answer(reinterpret_cast<const char*>(header), sizeof header);
    answer.append(reinterpret_cast<const char*>(shape.corners.data()), shape.corners.size() * sizeof(ObjectCorner));
    answer.append(reinterpret_cast<const char*>(shape.triangles.data()),
                  shape.triangles.size() * sizeof(ObjectTriangle));
    write("answer", answer + parts);
    return fault_of(path, options);
  };
  const std::string parts("part\0", 5);
  ObjectShape shape;
  shape.corners = {{{0, 0, 0}, {0, 0, 0}}, {{1, 0, 0}, {0, 0, 1}}, {{0, 1, 0}, {0, 0, 1}}};
  shape.triangles = {{{0, 1, 2}, 0}};
  EXPECT_EQ(fault_with(shape, 1, parts), "");
  expect_within(fault_with(shape, 2, parts), "damaged");
  expect_within(fault_with(shape, ~std::size_t{0}, parts), "damaged");
  expect_within(fault_with(shape, 1, ""), "damaged");
  expect_within(fault_with(shape, 1, "part"), "damaged");
  shape.triangles[0].corner[2] = 3;
  expect_within(fault_with(shape, 1, parts), "damaged");
  shape.triangles[0] = {{0, 1, 2}, 1};
  expect_within(fault_with(shape, 1, parts), "damaged");
  shape.triangles[0].part = 0;
  shape.corners[1].normal.x() = std::nanf("");
  expect_within(fault_with(shape, 1, parts), "damaged");
  shape.corners[1] = {{1, INFINITY, 0}, {0, 0, 1}};
  expect_within(fault_with(shape, 1, parts), "damaged");
  write("answer", "");
  expect_within(fault_of(path, options), "damaged");
}

// Whatever is done to a file, it is a mesh or an error that names it. Of thousands some end their reader.
TEST_F(MeshFiles, DamagedFilesAreMeshesOrErrors) {
  std::ifstream satellite(SELENOGRAPH_SOURCE_DIR "/deploy/assets/objects/satellite.obj");
  const std::pair<const char*, std::string> files[] = {{"m.ply", test::ply_file(true)},
                                                       {"m.gltf", test::gltf_file()},
                                                       {"m.ply", test::ply_file(false)},
                                                       {"m.obj", {std::istreambuf_iterator<char>(satellite), {}}},
                                                       {"m.gltf", test::gltf_of_instances(3, 5)}};
  std::mt19937 random(7);
  const int damaged = test::full_effort() ? 3000 : 30;
  int errors = 0, crashes = 0;
  for (int i = 0; i < damaged; ++i) {
    const auto& [name, content] = files[static_cast<std::size_t>(i) % std::size(files)];
    const std::string fault = fault_of(write(name, test::mutated(content, random)));
    errors += !fault.empty();
    crashes += fault.find("its reader ended with") != std::string::npos;
  }
  EXPECT_GT(errors, damaged / 6);
  EXPECT_LT(errors, damaged);
  if (test::full_effort()) {
    EXPECT_GT(crashes, 0) << "of the library, or this doesn't test what it should";
  }
}

// --- the assets folder

class ObjectAssets : public MeshFiles {
 protected:
  void SetUp() override {
    std::filesystem::create_directory(folder_ / "objects");
    for (const char* name : {"objects/a.ply", "objects/b.ply"}) write(name, test::ply_file(true));
  }
  // A reader that writes a line for each file and then does its work.
  ReaderOptions counted(const std::string& first) {
    ReaderOptions options = test::mesh_options();
    options.program = script("echo >> " + (folder_ / "reads") + "\n" + first + "\nexec " + options.program + " \"$@\"");
    return options;
  }
  long reads() const {
    std::ifstream lines(folder_ / "reads");
    return std::count(std::istreambuf_iterator<char>(lines), {}, '\n');
  }
};

TEST_F(ObjectAssets, FaultsAreAssetErrors) {
  write("objects/c.obj", "f 1 2 3\n");
  const api::Assets assets(folder_.path(), test::mesh_options());
  try {
    assets.object("c");
    ADD_FAILURE();
  } catch (const api::RequestError& e) {
    EXPECT_EQ(e.code(), "asset_error");
    expect_within(e.what(), "c.obj");
  }
  EXPECT_EQ(assets.object("none"), nullptr);
}

// Those that nobody uses make room.
TEST_F(ObjectAssets, StayWithinTheirMemory) {
  for (const char* name : {"a", "b"})
    write(std::string("objects/") + name + ".gltf", test::gltf_of_instances(100, 2000));
  for (const char* name : {"objects/a.ply", "objects/b.ply"}) std::filesystem::remove(folder_ / name);
  ReaderOptions options = counted(":");
  options.max_bytes = std::size_t{40} << 20;
  const api::Assets assets(folder_.path(), options);
  EXPECT_TRUE(assets.object("a"));
  const std::size_t one = assets.mesh_bytes();
  EXPECT_GT(one, std::size_t{20} << 20);
  EXPECT_TRUE(assets.object("b"));
  EXPECT_EQ(assets.mesh_bytes(), one);
  EXPECT_TRUE(assets.object("b"));
  EXPECT_EQ(reads(), 2);
}

}  // namespace
}  // namespace selenograph::engine

// --- other files of the assets folder: read once, within the budget and the request's deadline

namespace selenograph::api {
namespace {

class AssetFiles : public ::testing::Test {
 protected:
  AssetFiles() {
    for (const char* kind :
         {"atmospheres", "cameras", "details", "kernels", "lidars", "map_errors", "maps", "objects", "stars"})
      std::filesystem::create_directory(folder_ / kind);
  }
  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
  void write_stars(const std::string& name, int count) const {
    std::ofstream file(folder_ / ("stars/" + name + ".csv"));
    file << "id,ra_deg,dec_deg,epoch_yr,pm_ra_mas_yr,pm_dec_mas_yr,parallax_mas,v_mag,b_v\n";
    for (int i = 0; i < count; ++i) file << fmt::format("S{},{},{},2000,0,0,0,5,0.6\n", i, i % 360, i % 90);
  }
  Assets with_budget(std::size_t bytes) const {
    engine::ReaderOptions options;
    options.max_bytes = bytes;
    return Assets(folder_.path(), options);
  }
  static std::string refusal(const auto& read) {
    try {
      read();
    } catch (const RequestError& e) {
      EXPECT_EQ(e.code(), "asset_error");
      return e.what();
    }
    return "read";
  }

  test::TemporaryFolder folder_;
};

constexpr std::size_t kMany_bytes = std::size_t{64} << 20;

TEST_F(AssetFiles, ACatalogueBeyondTheBudgetIsRefused) {
  write_stars("many", 50000);
  const Assets assets = with_budget(4 << 20);
  const std::string text = refusal([&] { assets.stars("many"); });
  EXPECT_NE(text.find("many.csv: has 50001 lines"), std::string::npos) << text;
  EXPECT_NE(text.find("--mesh-mb"), std::string::npos) << text;
  write_stars("few", 1000);
  EXPECT_EQ(assets.stars("few")->size(), 1000U);
  EXPECT_EQ(with_budget(kMany_bytes).stars("many")->size(), 50000U);
}

TEST_F(AssetFiles, StayWithinTheBudget) {
  constexpr std::size_t kBudget_bytes = 1 << 20;
  const std::string row(4000, '0');
  for (int i = 0; i < 10; ++i) write(fmt::format("kernels/k{}.csv", i), row + "\n");
  write("kernels/large.csv", std::string(20000, '0') + "\n");
  const Assets assets = with_budget(kBudget_bytes);
  for (int i = 0; i < 10; ++i) {
    EXPECT_TRUE(assets.kernel(fmt::format("k{}", i)));
    EXPECT_LE(assets.mesh_bytes(), kBudget_bytes);
  }
  EXPECT_GT(assets.mesh_bytes(), kBudget_bytes / 2);
  EXPECT_NE(refusal([&] { assets.kernel("large"); }).find("large.csv: has 20001 bytes"), std::string::npos);
}

TEST_F(AssetFiles, ReadingEndsWithTheRequest) {
  write_stars("many", 5000);
  std::string rows;
  for (int i = 0; i < 5000; ++i) rows += "1,2,3\n";
  write("kernels/long.csv", rows);
  const Assets assets(folder_.path());
  const StopToken late(StopToken::Clock::now());
  EXPECT_THROW(assets.stars("many", late), Cancelled);
  EXPECT_THROW(assets.kernel("long", late), Cancelled);
  EXPECT_EQ(assets.stars("many")->size(), 5000U);
  EXPECT_EQ(assets.kernel("long")->size(), 5000U);
}

// Opening a FIFO waits for its writer.
TEST_F(AssetFiles, FifosAreNoFiles) {
  for (const char* name : {"atmospheres/f.csv", "cameras/f.json", "details/f.json", "kernels/f.csv", "lidars/f.json",
                           "map_errors/f.json", "maps/f.json", "objects/f.obj", "stars/f.csv"})
    ASSERT_EQ(::mkfifo((folder_ / name).c_str(), 0600), 0);
  const Assets assets(folder_.path());
  EXPECT_EQ(assets.atmosphere("f"), nullptr);
  EXPECT_EQ(assets.camera("f"), nullptr);
  EXPECT_EQ(assets.detail("f"), nullptr);
  EXPECT_EQ(assets.kernel("f"), nullptr);
  EXPECT_EQ(assets.lidar("f"), nullptr);
  EXPECT_EQ(assets.map_error("f"), nullptr);
  EXPECT_EQ(assets.map("f"), nullptr);
  EXPECT_EQ(assets.object("f"), nullptr);
  EXPECT_EQ(assets.stars("f"), nullptr);
}

TEST_F(AssetFiles, AChangedRasterIsOpenedAgain) {
  write("maps/m.json",
        R"({"file": "m.asc", "extent": {"south_deg": -90, "north_deg": 90, "west_deg": -180, "east_deg": 180}})");
  const Assets assets(folder_.path());
  EXPECT_NE(refusal([&] { assets.map("m"); }).find("m.asc"), std::string::npos);
  const auto write_raster = [&](const std::string& values) {
    write("maps/m.asc", "ncols 2\nnrows 1\nxllcorner -180\nyllcorner -90\ncellsize 180\n" + values + "\n");
  };
  write_raster("0.1 0.2");
  const auto map = assets.map("m");
  ASSERT_TRUE(map) << "a fault of another file is not remembered";
  EXPECT_EQ(assets.map("m"), map);
  EXPECT_NE(assets.temperature_map("m"), nullptr);
  write_raster("0.1 0.25");
  EXPECT_NE(assets.map("m"), map);
}

}  // namespace
}  // namespace selenograph::api
