// Mesh files: OBJ, PLY, glTF (.gltf, .glb). Wraps Assimp: no other file includes its headers or names its types.
//
// Assimp is not safe with malicious files: it reads and writes out of bounds, recurses without limit, and allocates
// what a file's header asks for. engine/visibility/meshes/mesh_reader.h calls it in a separate process.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "engine/scene/object_shape.h"

namespace selenograph::engine {

// Reads a file's content by its extension ("obj", "ply", "gltf", "glb"). Polygons become triangles; nodes' transforms
// are applied; points, lines and triangles without area are dropped. Normals are kept if the file has them. Only these
// bytes are read, coordinates as float: an OBJ's materials are known by name alone, a glTF's buffers must be inside (a
// .glb, or data: URIs). Throws std::runtime_error when the content cannot be read, has no triangle or a non-finite
// number, when a name is not UTF-8, or when the shape, counting each instance of a glTF's meshes, would take more than
// `max_bytes`.
ObjectShape read_mesh_file(std::string_view content, const std::string& extension, std::size_t max_bytes);

}  // namespace selenograph::engine
