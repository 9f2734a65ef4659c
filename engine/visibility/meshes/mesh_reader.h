// Object meshes: read by mesh_file.h in a child process, checked and limited here.
#pragma once

#include <string>

#include "dem/base/stop_token.h"
#include "engine/scene/object_shape.h"
#include "engine/support/confined_reader.h"

namespace selenograph::engine {

// First argument of the child process.
inline constexpr const char* kReadMeshCommand = "read-mesh";
// Called by main() for that argument; returns the exit status.
int read_mesh_in_child(int argc, char** argv);

// Reads .obj, .ply, .gltf or .glb. Throws as ConfinedReader::read; DataError also for another format, or if the mesh
// with its ray-tracing structure would take more than the reader's max_bytes.
ObjectShape read_mesh(const ConfinedReader& reader, const std::string& path, const StopToken& stop = {});

}  // namespace selenograph::engine
