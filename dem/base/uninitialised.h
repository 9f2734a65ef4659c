// A vector whose resize() does not initialise: for arrays that are filled by several threads at once.
#pragma once

#include <memory>
#include <utility>
#include <vector>

namespace selenograph::dem {

template <typename T>
struct UninitialisedAllocator : std::allocator<T> {
  template <typename U>
  struct rebind {  // NOLINT(readability-identifier-naming): the standard's name
    using other = UninitialisedAllocator<U>;
  };
  template <typename U>
  void construct(U* object) noexcept {
    ::new (static_cast<void*>(object)) U;
  }
  template <typename U, typename... Arguments>
  void construct(U* object, Arguments&&... arguments) {
    ::new (static_cast<void*>(object)) U(std::forward<Arguments>(arguments)...);
  }
};

template <typename T>
using UninitialisedVector = std::vector<T, UninitialisedAllocator<T>>;

}  // namespace selenograph::dem
