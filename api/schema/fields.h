// Fields of a form: the places of the values of rows. Rows are data: what reads, writes and describes them is compiled
// once, not for each row.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>

#include "api/json/json_reader.h"

namespace selenograph::api {

struct ReadContext;

// The C++ type of a number in a form. `whole`: not a number; its kind knows the type.
enum class Store : std::uint8_t { whole, flag, f64, f32, i32, i64, u16, u32, u64 };

template <typename T>
constexpr Store store_of() {
  if constexpr (std::is_same_v<T, bool>) {
    return Store::flag;
  } else if constexpr (std::is_floating_point_v<T>) {
    return sizeof(T) == 8 ? Store::f64 : Store::f32;
  } else if constexpr (std::is_integral_v<T>) {
    static_assert(sizeof(T) >= (std::is_signed_v<T> ? 4 : 2));
    if (std::is_signed_v<T>) return sizeof(T) == 8 ? Store::i64 : Store::i32;
    return sizeof(T) == 8 ? Store::u64 : sizeof(T) == 4 ? Store::u32 : Store::u16;
  } else {
    return Store::whole;
  }
}

// A value in a form, or a std::optional of one, which is empty without a value.
struct Slot {
  void* at;
  Store store;
  bool optional = false;
};
// Numbers are converted to the type in the form.
void store_in(const Slot& slot, bool value);
void store_in(const Slot& slot, double value);
void store_in(const Slot& slot, std::int64_t value);
// Return the number; empty: the slot is a std::optional without one.
std::optional<bool> flag_in(const Slot& slot);
std::optional<double> number_in(const Slot& slot);
std::optional<std::int64_t> integer_in(const Slot& slot);

// A kind of member_kinds.h, whatever its type.
class AnyKind {
 public:
  virtual ~AnyKind() = default;
  // Returns false if the value is not valid, which is reported; then nothing is stored.
  virtual bool read(const JsonReader& in, const ReadContext& context, const Slot& to) const = 0;
  // Returns null for a std::optional without a value.
  virtual nlohmann::ordered_json write(const Slot& from) const = 0;
};

// The place of a value in a form.
class Field {
 public:
  virtual ~Field() = default;
  virtual void read(const AnyKind& kind, const JsonReader& in, const ReadContext& context, void* form) const = 0;
  // Returns null if there is nothing to write.
  virtual nlohmann::ordered_json write(const AnyKind& kind, const void* form) const = 0;
};

// A member of the form, or of a member of it.
class MemberField final : public Field {
 public:
  MemberField(std::ptrdiff_t offset, Store store, bool optional)
      : offset_(offset), store_(store), optional_(optional) {}
  void read(const AnyKind& kind, const JsonReader& in, const ReadContext& context, void* form) const override {
    kind.read(in, context, {static_cast<char*>(form) + offset_, store_, optional_});
  }
  nlohmann::ordered_json write(const AnyKind& kind, const void* form) const override {
    return kind.write({const_cast<char*>(static_cast<const char*>(form)) + offset_, store_, optional_});
  }

 private:
  std::ptrdiff_t offset_;
  Store store_;
  bool optional_;
};

// A field that is not a member of the form: `get` returns its value, empty if there is nothing to write; `set` stores
// it.
template <typename Get, typename Set>
struct Property {
  Get get;
  Set set;
};
template <typename Get, typename Set>
Property(Get, Set) -> Property<Get, Set>;

template <typename Form, typename Get, typename Set>
class PropertyField final : public Field {
 public:
  explicit PropertyField(Property<Get, Set> property) : property_(std::move(property)) {}
  void read(const AnyKind& kind, const JsonReader& in, const ReadContext& context, void* form) const override {
    std::optional<Value> value;
    if (kind.read(in, context, {&value, store_of<Value>(), true}))
      property_.set(*static_cast<Form*>(form), std::move(*value));
  }
  nlohmann::ordered_json write(const AnyKind& kind, const void* form) const override {
    std::optional<Value> value = property_.get(*static_cast<const Form*>(form));
    return kind.write({&value, store_of<Value>(), true});
  }

 private:
  using Value = typename std::invoke_result_t<Get, const Form&>::value_type;
  Property<Get, Set> property_;
};

// Returns the field `inner` of the form's member `outer`.
template <typename Outer, typename Inner>
auto nested(Outer outer, Inner inner) {
  return [=](auto& form) -> auto& { return std::invoke(inner, std::invoke(outer, form)); };
}

// Returns a field that stores and writes nothing: other code reads the member, or it is only documented.
template <typename Form, typename Value>
auto no_field() {
  return Property{[](const Form&) { return std::optional<Value>(); }, [](Form&, const Value&) {}};
}

namespace detail {
template <typename T>
inline constexpr bool is_optional = false;
template <typename T>
inline constexpr bool is_optional<std::optional<T>> = true;

// Returns the field at this place of the form, of a kind with values of type Value.
template <typename Value, typename Member>
std::unique_ptr<const Field> member_field(std::ptrdiff_t offset, const Member&) {
  // A std::optional may stand for a missing member, or be the kind's own value, as that of NumberOr.
  if constexpr (is_optional<Member> && !std::is_same_v<Member, Value>) {
    using T = typename Member::value_type;
    static_assert(std::is_same_v<T, Value> || std::is_arithmetic_v<Value>);
    return std::make_unique<MemberField>(offset, store_of<T>(), true);
  } else {
    static_assert(std::is_same_v<Member, Value> || (std::is_arithmetic_v<Member> && std::is_arithmetic_v<Value>));
    return std::make_unique<MemberField>(offset, store_of<Member>(), false);
  }
}
}  // namespace detail

// Returns the field of a row: `field` is a pointer to a member, a function that returns a reference to a part of the
// form, or a Property. `form`: any form.
template <typename Value, typename Form, typename F>
std::unique_ptr<const Field> field_of(F field, Form& form) {
  auto& member = std::invoke(field, form);
  return detail::member_field<Value>(reinterpret_cast<const char*>(&member) - reinterpret_cast<const char*>(&form),
                                     member);
}
template <typename Value, typename Form, typename Get, typename Set>
std::unique_ptr<const Field> field_of(Property<Get, Set> property, Form&) {
  return std::make_unique<PropertyField<Form, Get, Set>>(std::move(property));
}

}  // namespace selenograph::api
