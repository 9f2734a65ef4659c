// Arrays of a request: whatever the bytes, they are read or refused as a client's fault, within the memory that is
// said.
#include <functional>
#include <numeric>
#include <string>

#include "api/encode/read_npz.h"
#include "api/message/problem.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace selenograph;
  constexpr std::size_t kMost = std::size_t{1} << 20;
  try {
    for (const auto& [name, array] : api::read_npz(fuzz::text_of(data, size), kMost)) {
      const std::size_t count =
          std::accumulate(array.shape.begin(), array.shape.end(), std::size_t{1}, std::multiplies<>());
      fuzz::require(array.text || array.numbers.size() == count, "as many numbers as the shape says", name);
      fuzz::require(array.numbers.size() <= kMost, "no more than is taken", name);
    }
  } catch (const api::RequestError& e) {
    fuzz::require(e.code() == "malformed_npz" || e.code() == "too_large", "a fault of the client", e.code());
  }
  // The same without the archive around it, which random bytes hardly get through.
  try {
    api::read_npy(fuzz::text_of(data, size), "array");
  } catch (const api::RequestError& e) {
    fuzz::require(e.code() == "malformed_npz", "a fault of the client", e.code());
  }
  return 0;
}
