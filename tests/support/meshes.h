// Mesh files, read as the service reads them.
#pragma once

#include <memory>
#include <string>

#include "engine/visibility/meshes/mesh_reader.h"
#include "engine/visibility/objects/object_mesh.h"

namespace selenograph::test {

// Returns options with which the executable built with the tests reads meshes.
inline engine::ReaderOptions mesh_options() {
  engine::ReaderOptions options;
  options.program = SELENOGRAPH_EXECUTABLE;
  return options;
}

inline engine::ObjectShape read_shape(const std::string& path) {
  return engine::read_mesh(engine::ConfinedReader(mesh_options()), path);
}

}  // namespace selenograph::test
