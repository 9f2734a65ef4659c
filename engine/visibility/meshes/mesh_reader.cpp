#include "engine/visibility/meshes/mesh_reader.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <new>
#include <utility>

#include "dem/base/error.h"
#include "engine/support/child_process.h"
#include "engine/support/confinement.h"
#include "engine/visibility/meshes/mesh_answer.h"
#include "engine/visibility/meshes/mesh_file.h"
#include "engine/visibility/objects/object_mesh.h"

namespace selenograph::engine {
namespace {

constexpr double kMiB = 0x1p20;

// Opens an ordinary file of limited size. It must not block: opening a FIFO would wait for its writer.
class MeshFile {
 public:
  MeshFile(const std::string& path, std::size_t max_bytes)
      : descriptor_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY)) {
    if (descriptor_ < 0) throw DataError(path, fmt::format("cannot be opened: {}", std::strerror(errno)));
    struct stat status {};
    const bool ordinary = ::fstat(descriptor_, &status) == 0 && S_ISREG(status.st_mode);
    if (ordinary && static_cast<std::size_t>(status.st_size) <= max_bytes) return;
    ::close(descriptor_);
    if (!ordinary) throw DataError(path, "is not an ordinary file");
    throw DataError(
        path, fmt::format("has {:.0f} MiB, more than the {:.0f} of a mesh", static_cast<double>(status.st_size) / kMiB,
                          static_cast<double>(max_bytes) / kMiB));
  }
  ~MeshFile() { ::close(descriptor_); }
  MeshFile(const MeshFile&) = delete;
  MeshFile& operator=(const MeshFile&) = delete;
  int descriptor() const { return descriptor_; }

 private:
  int descriptor_;
};

std::string extension_of(const std::string& path) {
  const std::string dotted = std::filesystem::path(path).extension().string();
  return dotted.empty() ? dotted : dotted.substr(1);
}

void lock_until(std::unique_lock<std::timed_mutex>& lock, const StopToken& stop) {
  while (!lock.try_lock_for(std::chrono::milliseconds(20))) stop.check();
}

// --- the child process

// The answer for the case that memory runs out, built while there is some.
std::string& out_of_memory_answer() {
  static std::string answer;
  return answer;
}

// Ends the process without destructors and exit handlers: there is nothing to clean up.
[[noreturn]] void answer(const std::string& text) { ::_exit(write_to_parent(text) ? EXIT_SUCCESS : EXIT_FAILURE); }

// Returns the content of the file on standard input.
std::string read_input() {
  // Find the size by seeking: the confinement forbids stat().
  const off_t size = ::lseek(STDIN_FILENO, 0, SEEK_END);
  if (size < 0 || ::lseek(STDIN_FILENO, 0, SEEK_SET) != 0) throw std::runtime_error("cannot be read");
  std::string content(static_cast<std::size_t>(size), '\0');
  for (std::size_t bytes_read = 0; bytes_read < content.size();) {
    const ssize_t result = ::read(STDIN_FILENO, content.data() + bytes_read, content.size() - bytes_read);
    if (result < 0 && errno == EINTR) continue;
    if (result <= 0) throw std::runtime_error("has become shorter while it was read");
    bytes_read += static_cast<std::size_t>(result);
  }
  return content;
}

}  // namespace

ObjectShape MeshReader::read(const std::string& path, const StopToken& stop) const {
  if (options_.program.empty()) throw DataError(path, "no program is set up to read meshes");
  const MeshFile file(path, options_.max_bytes);
  std::unique_lock lock(reader_mutex_, std::defer_lock);
  lock_until(lock, stop);
  ObjectShape shape;
  try {
    const auto seconds = std::chrono::ceil<std::chrono::seconds>(options_.time).count();
    shape = shape_of_answer(
        run_child(options_.program,
                  {kReadMeshCommand, extension_of(path), std::to_string(options_.max_bytes), std::to_string(seconds)},
                  file.descriptor(), {options_.time, options_.max_bytes}, stop));
  } catch (const ChildFailed& e) {
    throw DataError(path, fmt::format("cannot be read as a mesh: its reader {}", e.what()));
  } catch (const Cancelled&) {
    throw;
  } catch (const std::runtime_error& e) {
    throw DataError(path, e.what());
  }
  if (const std::size_t bytes = ObjectMesh::bytes_for(shape); bytes > options_.max_bytes)
    throw DataError(path, fmt::format("has {} triangles, which take {:.0f} MiB: more than the {:.0f} of a mesh",
                                      shape.triangles.size(), static_cast<double>(bytes) / kMiB,
                                      static_cast<double>(options_.max_bytes) / kMiB));
  return shape;
}

// Runs in the child process: reads a mesh from standard input, within limits, and answers with it or with a refusal.
int read_mesh_as_child(int argc, char** argv) {
  if (argc != 5) return EXIT_FAILURE;
  const std::string extension = argv[2];
  const std::size_t max_bytes = std::strtoull(argv[3], nullptr, 10);
  const auto seconds = static_cast<unsigned>(std::strtoul(argv[4], nullptr, 10));
  out_of_memory_answer() = refusal_answer(
      fmt::format("takes more than {:.0f} MiB to read as a mesh", static_cast<double>(max_bytes) / kMiB));
  std::set_new_handler([] { answer(out_of_memory_answer()); });
  try {
    confine(max_bytes, seconds);
    answer(shape_answer(read_mesh_file(read_input(), extension, max_bytes)));
  } catch (const std::exception& e) {
    answer(refusal_answer(e.what()));
  }
}

}  // namespace selenograph::engine
