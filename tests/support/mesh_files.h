// Mesh files to read, whole and damaged.
#pragma once

#include <cstddef>
#include <random>
#include <string>
#include <string_view>

namespace selenograph::test {

// Two triangles; `binary`: little-endian.
std::string ply_file(bool binary);

// A triangle on a node, its buffer where `uri` says: its own, by default.
std::string gltf_file(
    const std::string& uri = "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA");

// `nodes` instances of a mesh of `triangles`.
std::string gltf_of_instances(int nodes, int triangles);

// What reading a file gives, as engine::shape_of_answer takes it: in a fork of this process, which is a hundred times
// as fast as a program of its own. Empty: it crashed.
std::string mesh_answer_of_fork(std::string_view content, const std::string& extension, std::size_t max_bytes);

// A file with a few of its bytes changed, or a piece of it left out, doubled or cut off.
std::string mutated(std::string file, std::mt19937& random);

}  // namespace selenograph::test
