// Reads mesh files in a process of its own: what a damaged or prepared file does to the library that reads it (see
// mesh_file.h) ends there.
//
// That process is the same executable, started anew. It has the file as its standard input, a pipe for its answer, no
// other file, and limits of memory and time; on x86-64 and arm64 the kernel refuses it whatever opens a file, a
// connection or a program (seccomp).
#pragma once

#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>

#include "dem/support/stop_token.h"
#include "engine/scene/object_shape.h"

namespace selenograph::engine {

struct MeshReaderOptions {
  // The program whose main() hands over to read_mesh_as_child(). The server says "/proc/self/exe". Empty: meshes can't
  // be read.
  std::string program{};
  // Memory for reading one mesh, and what a mesh with the structure that rays need may take afterwards. Measured: 1 GiB
  // reads 2 million triangles as a .ply and half a million as an OBJ, not a million of the latter.
  std::size_t max_bytes = std::size_t{1} << 30;
  // For reading one mesh.
  std::chrono::milliseconds time{20000};
};

// const means safe to call concurrently: one file is read at a time, so that the memory for reading is taken once.
class MeshReader {
 public:
  explicit MeshReader(MeshReaderOptions options) : options_(std::move(options)) {}

  // .obj, .ply, .gltf or .glb. Throws DataError naming the file when it can't be read within the limits, is not such
  // a file, or its reader fails; Cancelled when `stop` says so.
  ObjectShape read(const std::string& path, const StopToken& stop = {}) const;

  const MeshReaderOptions& options() const { return options_; }

 private:
  const MeshReaderOptions options_;
  mutable std::timed_mutex one_;
};

// The first argument of the process that reads.
inline constexpr const char* kReadMeshCommand = "read-mesh";
// What main() does when it is that: the exit status.
int read_mesh_as_child(int argc, char** argv);

}  // namespace selenograph::engine
