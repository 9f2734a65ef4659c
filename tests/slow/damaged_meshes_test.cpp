// Thousands of damaged mesh files: each is a mesh or an error that names it.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iterator>

#include "dem/base/error.h"
#include "tests/support/mesh_files.h"
#include "tests/support/meshes.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {
namespace {

TEST(DamagedMeshes, AreMeshesOrErrors) {
  std::ifstream satellite(SELENOGRAPH_SOURCE_DIR "/deploy/assets/objects/satellite.obj");
  const std::string obj{std::istreambuf_iterator<char>(satellite), {}};
  const struct {
    const char* name;
    std::string content;
  } files[] = {{"m.ply", ply_file(true)},
               {"m.ply", ply_file(false)},
               {"m.obj", obj},
               {"m.gltf", gltf_file()},
               {"m.gltf", gltf_of_instances(3, 5)}};
  const TemporaryFolder folder;
  std::mt19937 random(7);
  int meshes = 0, errors = 0, crashes = 0;
  for (int i = 0; i < 3000; ++i) {
    const auto& [name, content] = files[static_cast<std::size_t>(i) % std::size(files)];
    const std::string path = folder / name;
    std::ofstream(path, std::ios::binary) << mutated(content, random);
    try {
      read_shape(path);
      ++meshes;
    } catch (const DataError& e) {
      ++errors;
      crashes += std::string(e.what()).find("its reader ended with") != std::string::npos;
    }
  }
  EXPECT_GT(meshes, 200);
  EXPECT_GT(errors, 500);
  EXPECT_GT(crashes, 0) << "of the library, or this doesn't test what it should";
}

}  // namespace
}  // namespace selenograph::test
