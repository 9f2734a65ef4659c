#include "api/schema/fields.h"

namespace selenograph::api {
namespace {

// Calls a function with the slot's place as a pointer to its type of number.
template <typename Use>
auto with_number(const Slot& slot, Use&& use) {
  switch (slot.store) {
    case Store::f32:
      return use(static_cast<float*>(slot.at));
    case Store::i32:
      return use(static_cast<std::int32_t*>(slot.at));
    case Store::i64:
      return use(static_cast<std::int64_t*>(slot.at));
    case Store::u16:
      return use(static_cast<std::uint16_t*>(slot.at));
    case Store::u32:
      return use(static_cast<std::uint32_t*>(slot.at));
    case Store::u64:
      return use(static_cast<std::uint64_t*>(slot.at));
    case Store::flag:
      return use(static_cast<bool*>(slot.at));
    case Store::whole:
    case Store::f64:
      break;
  }
  return use(static_cast<double*>(slot.at));
}

template <typename T>
void store_number(const Slot& slot, T value) {
  with_number(slot, [&]<typename Number>(Number* at) {
    if (slot.optional)
      *static_cast<std::optional<Number>*>(slot.at) = static_cast<Number>(value);
    else
      *at = static_cast<Number>(value);
  });
}

template <typename T>
std::optional<T> load_number(const Slot& slot) {
  return with_number(slot, [&]<typename Number>(const Number* at) -> std::optional<T> {
    if (!slot.optional) return static_cast<T>(*at);
    const auto& number = *static_cast<const std::optional<Number>*>(slot.at);
    return number ? std::optional(static_cast<T>(*number)) : std::nullopt;
  });
}

}  // namespace

void store_in(const Slot& slot, bool value) { store_number(slot, value); }
void store_in(const Slot& slot, double value) { store_number(slot, value); }
void store_in(const Slot& slot, std::int64_t value) { store_number(slot, value); }
std::optional<bool> flag_in(const Slot& slot) { return load_number<bool>(slot); }
std::optional<double> number_in(const Slot& slot) { return load_number<double>(slot); }
std::optional<std::int64_t> integer_in(const Slot& slot) { return load_number<std::int64_t>(slot); }

}  // namespace selenograph::api
