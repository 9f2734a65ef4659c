// Mesh files, as the process that reads them does. The library's own crashes are no finding: that is what the process
// is for, so each file is read in a fork. A finding is whatever the other side then makes of the answer.
//
// The first byte says which kind of file the rest is.
#include <iterator>
#include <stdexcept>

#include "engine/visibility/meshes/mesh_answer.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/shape_promises.h"
#include "tests/support/mesh_files.h"

namespace selenograph::fuzz {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{16} << 20;
constexpr const char* kExtensions[] = {"obj", "ply", "gltf", "glb"};

}  // namespace
}  // namespace selenograph::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace selenograph;
  if (size == 0) return 0;
  const std::string answer = test::mesh_answer_of_fork(
      fuzz::text_of(data + 1, size - 1), fuzz::kExtensions[data[0] % std::size(fuzz::kExtensions)], fuzz::kMaxBytes);
  if (answer.empty()) return 0;
  engine::ObjectShape shape;
  try {
    shape = engine::shape_of_answer(answer);
  } catch (const std::runtime_error& e) {
    // At its start: further on it may quote the file.
    fuzz::require(!std::string_view(e.what()).starts_with("the answer of its reader is damaged"), "an answer is whole",
                  e.what());
    return 0;
  }
  fuzz::check_shape(shape);
  fuzz::require(shape.bytes() <= fuzz::kMaxBytes, "a shape keeps to its size");
  return 0;
}
