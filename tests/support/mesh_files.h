// Mesh files to read, whole and damaged.
#pragma once

#include <cstddef>
#include <random>
#include <string>
#include <string_view>

namespace selenograph::test {

// Returns a PLY file of two triangles, as text or as little-endian numbers.
std::string ply_file(bool binary);

// Returns a glTF file of a triangle on a node, with its buffer at `uri`: by default within the file.
std::string gltf_file(
    const std::string& uri = "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA");

// Returns a glTF file with `nodes` instances of a mesh of `triangles` triangles.
std::string gltf_of_instances(int nodes, int triangles);

// Reads a file in a fork of this process, which starts a hundred times as fast as a program of its own. Returns what
// engine::shape_of_answer takes; empty if the fork crashed.
std::string mesh_answer_of_fork(std::string_view content, const std::string& extension, std::size_t max_bytes);

// Returns the file with a few of its bytes changed, or a piece of it left out, doubled or cut off.
std::string mutated(std::string file, std::mt19937& random);

}  // namespace selenograph::test
