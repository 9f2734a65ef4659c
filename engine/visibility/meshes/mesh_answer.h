// What the process that reads a mesh file tells the one that asked, as bytes: a shape, or why there is none.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "engine/scene/object_shape.h"

namespace selenograph::engine {

inline constexpr std::size_t kMaxRefusalBytes = 1000;

std::string shape_answer(const ObjectShape& shape);
// What is beyond kMaxRefusalBytes is cut off.
std::string refusal_answer(std::string_view why);

// Throws std::runtime_error with the refusal's text, or when the bytes are no answer: nothing in them is taken on
// trust. The shape has a triangle and a part at least, indices within bounds, finite places, normals of unit length or
// zero, and names in UTF-8. No more is allocated than is there.
ObjectShape shape_of_answer(std::string_view answer);

}  // namespace selenograph::engine
