// Mesh files to read, whole and damaged.
#pragma once

#include <random>
#include <string>

namespace selenograph::test {

// Returns a PLY file of two triangles, as text or as little-endian numbers.
std::string ply_file(bool binary);

// Returns a glTF file of a triangle on a node, with its buffer at `uri`: by default within the file.
std::string gltf_file(
    const std::string& uri = "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA");

// Returns a glTF file with `nodes` instances of a mesh of `triangles` triangles.
std::string gltf_of_instances(int nodes, int triangles);

// Returns the file with a few of its bytes changed, or a piece of it left out, doubled or cut off.
std::string mutated(std::string file, std::mt19937& random);

}  // namespace selenograph::test
