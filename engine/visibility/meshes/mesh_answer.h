// The answer of the mesh-reading process, as bytes: a shape, or the reason why there is none.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "engine/scene/object_shape.h"

namespace selenograph::engine {

inline constexpr std::size_t kMaxRefusalBytes = 1000;

std::string shape_answer(const ObjectShape& shape);
// Truncates the text to kMaxRefusalBytes.
std::string refusal_answer(std::string_view why);

// Returns the shape of an answer. Throws std::runtime_error with the text of a refusal, or if the bytes are not a valid
// answer: they are untrusted. The shape has at least one triangle and one part, indices within bounds, finite
// positions, normals of unit length or zero, and names in UTF-8. Allocates no more than the size of the answer.
ObjectShape shape_of_answer(std::string_view answer);

}  // namespace selenograph::engine
