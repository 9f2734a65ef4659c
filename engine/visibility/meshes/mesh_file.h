// Mesh files: OBJ, PLY, glTF (.gltf, .glb). Behind it is Assimp: no other file includes its headers or names its types.
//
// Assimp is not safe with files that somebody prepared: it reads and writes out of bounds, recurses without end,
// allocates what a file's header asks for. engine/visibility/meshes/mesh_reader.h calls it in a process of its own.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "engine/scene/object_shape.h"

namespace selenograph::engine {

// A file's content by its extension ("obj", "ply", "gltf", "glb"). Polygons become triangles; nodes' transforms are
// applied; points, lines and triangles without area are left out. Normals are kept where the file has them. Nothing
// but these bytes is read, coordinates as float: an OBJ's materials are known by name
// alone, a glTF's buffers must be inside (a .glb, or data: URIs). Throws std::runtime_error when it can't be read,
// holds no triangle or a number that isn't finite, when a name is not UTF-8, or when the shape, counting each instance
// of a glTF's meshes, would have more than `max_bytes`.
ObjectShape read_mesh_file(std::string_view content, const std::string& extension, std::size_t max_bytes);

}  // namespace selenograph::engine
