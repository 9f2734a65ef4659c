// Reads mesh files in a separate process, which contains the effects of a damaged or malicious file on the library that
// reads it (see mesh_file.h).
//
// That process is the same executable. It has the file as its standard input, a pipe for its answer, no other file, and
// limits of memory and time.
#pragma once

#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>

#include "dem/base/stop_token.h"
#include "engine/scene/object_shape.h"

namespace selenograph::engine {

struct MeshReaderOptions {
  // The program whose main() calls read_mesh_as_child(). The server uses "/proc/self/exe". Empty: meshes cannot be
  // read.
  std::string program{};
  // Memory limit for reading one mesh, and for a mesh with its ray-tracing structure afterwards. Measured: 1 GiB reads
  // 2 million triangles as a .ply and half a million as an OBJ, not a million of the latter.
  std::size_t max_bytes = std::size_t{1} << 30;
  // Time limit for reading one mesh.
  std::chrono::milliseconds time{20000};
};

// Thread-safe: one file is read at a time, so that the memory for reading is used once.
class MeshReader {
 public:
  explicit MeshReader(MeshReaderOptions options) : options_(std::move(options)) {}

  // Reads .obj, .ply, .gltf or .glb. Throws DataError naming the file when it cannot be read within the limits, has
  // another format, or its reader fails; Cancelled when `stop` says so.
  ObjectShape read(const std::string& path, const StopToken& stop = {}) const;

  const MeshReaderOptions& options() const { return options_; }

 private:
  const MeshReaderOptions options_;
  mutable std::timed_mutex reader_mutex_;
};

// First argument of the reading process.
inline constexpr const char* kReadMeshCommand = "read-mesh";
// Called by main() for that argument; returns the exit status.
int read_mesh_as_child(int argc, char** argv);

}  // namespace selenograph::engine
