// What the process that reads meshes answers: it may have been made to say anything.
#include <stdexcept>

#include "engine/visibility/meshes/mesh_answer.h"
#include "engine/visibility/objects/object_mesh.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/shape_promises.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace selenograph;
  engine::ObjectShape shape;
  try {
    shape = engine::shape_of_answer(fuzz::text_of(data, size));
  } catch (const std::runtime_error&) {
    return 0;  // a refusal, or no answer
  }
  fuzz::check_shape(shape);
  fuzz::require(engine::shape_answer(shape) == fuzz::text_of(data, size), "a shape has one answer");
  fuzz::require(engine::ObjectMesh(shape).bytes() > shape.bytes(), "rays meet it");
  return 0;
}
