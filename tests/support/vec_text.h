// Vectors and attitudes in messages of tests.
#pragma once

#include <ostream>

#include "dem/grid/rotation.h"

namespace selenograph {

template <typename T>
std::ostream& operator<<(std::ostream& out, const Vector3<T>& v) {
  return out << v.x() << ' ' << v.y() << ' ' << v.z();
}
inline std::ostream& operator<<(std::ostream& out, const Quat& q) {
  return out << q.w << ' ' << q.x << ' ' << q.y << ' ' << q.z;
}

}  // namespace selenograph
