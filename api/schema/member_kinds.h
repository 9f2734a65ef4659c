// Kinds of request members. A kind is a type with this interface:
//
//   Value                                  type of the C++ value
//   read(JsonReader, ReadContext)          the value; empty, and reported, if it is not valid
//   write(value)                           the value as JSON
//   schema(Limits)                         its JSON Schema
//   fallback()       (optional)            its default in the schema, if not that of the C++ member
//   objects()        (optional)            tables of the objects in it
//
// The kind holds the range, so that reader and schema cannot differ.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "api/schema/members.h"

namespace selenograph::api {

// Returns {"type": "number"} with the range's bounds.
OrderedJson number_schema(const Range& range);
// Returns the schema of an array of `min` to `max` elements.
OrderedJson array_schema(OrderedJson items, std::size_t min, std::size_t max);
// Returns a reference to a table's component in the API document.
OrderedJson reference_to(const MemberTable& table);

inline OrderedJson vector_json(const Vec3& v) { return OrderedJson::array({v.x(), v.y(), v.z()}); }

// A bound of an integer or a length: a constant, or one of the service's limits.
struct Bound {
  template <typename Integer, std::enable_if_t<std::is_integral_v<Integer>, int> = 0>
  constexpr Bound(Integer fixed) : value(static_cast<std::int64_t>(fixed)) {}
  constexpr Bound(std::int64_t (*service_limit)(const Limits&)) : limit(service_limit) {}
  std::int64_t operator()(const Limits& limits) const { return limit ? limit(limits) : value; }

  std::int64_t value = 0;
  std::int64_t (*limit)(const Limits&) = nullptr;  // null: the bound is `value`
};

// A number within a range.
struct Number {
  using Value = double;
  Range range;
  std::string_view unit{};
  std::optional<double> read(const JsonReader& in, const ReadContext&) const { return in.number(range); }
  OrderedJson write(double value) const { return value; }
  OrderedJson schema(const Limits&) const { return number_schema(range); }
};

// A whole number between two bounds.
struct Integer {
  using Value = std::int64_t;
  Bound min, max;
  std::string_view unit{};
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    return in.integer(min(context.limits), max(context.limits));
  }
  template <typename T>
  OrderedJson write(T value) const {
    return value;
  }
  OrderedJson schema(const Limits& limits) const;
};

// One of a few whole numbers.
struct Choice {
  using Value = std::int64_t;
  std::vector<std::int64_t> choices;
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const;
  OrderedJson write(Value value) const { return value; }
  OrderedJson schema(const Limits&) const { return {{"type", "integer"}, {"enum", choices}}; }
};

// true or false.
struct Flag {
  using Value = bool;
  std::optional<bool> read(const JsonReader& in, const ReadContext&) const { return in.boolean(); }
  OrderedJson write(bool value) const { return value; }
  OrderedJson schema(const Limits&) const { return {{"type", "boolean"}}; }
};

// A word from a table, read into the value that the table gives it.
template <typename T>
struct Word {
  using Value = T;
  Words<T> words;
  WordHints hints{};
  std::optional<T> read(const JsonReader& in, const ReadContext&) const { return in.word(words, hints); }
  OrderedJson write(const T& value) const { return word_of(words, value); }
  OrderedJson schema(const Limits&) const { return {{"type", "string"}, {"enum", names_of(words)}}; }
};
template <typename T, std::size_t N>
Word(const std::pair<std::string_view, T> (&)[N]) -> Word<T>;

// A constant word.
struct Constant {
  using Value = std::monostate;
  std::string_view word;
  std::optional<Value> read(const JsonReader& in, const ReadContext&) const;
  OrderedJson write(Value) const { return word; }
  OrderedJson schema(const Limits&) const { return {{"type", "string"}, {"const", word}}; }
  OrderedJson fallback() const { return {}; }
};

// A string, checked by a function if there is one.
struct Text {
  using Value = std::string;
  // Reports faults of a text; null: any text is valid.
  void (*check)(const JsonReader& in, const std::string& text, const ReadContext& context) = nullptr;
  std::optional<std::string> read(const JsonReader& in, const ReadContext& context) const;
  OrderedJson write(const std::string& value) const { return value; }
  OrderedJson schema(const Limits&) const { return {{"type", "string"}}; }
};

// An array of three numbers, each within the range.
struct Vector {
  using Value = Vec3;
  Range range;
  std::string_view unit{};
  std::optional<Vec3> read(const JsonReader& in, const ReadContext&) const { return in.vector(range); }
  OrderedJson write(const Vec3& value) const { return vector_json(value); }
  OrderedJson schema(const Limits&) const { return array_schema(number_schema(range), 3, 3); }
};

// A number within the range, or a word in its place, which is read as an empty value.
struct NumberOr {
  using Value = std::optional<double>;
  Range range;
  std::string_view word;
  std::string_view unit{};
  std::optional<Value> read(const JsonReader& in, const ReadContext&) const;
  OrderedJson write(const Value& value) const { return value ? OrderedJson(*value) : OrderedJson(word); }
  OrderedJson schema(const Limits&) const;
};

// An array [a, b], read into a struct with two members, which may have ranges of their own.
template <typename T>
struct Pair {
  using Value = T;
  Range first, second;
  std::optional<T> read(const JsonReader& in, const ReadContext&) const {
    const auto pair = in.pair(first, second);
    return pair ? std::optional(T{pair->first, pair->second}) : std::nullopt;
  }
  OrderedJson write(const T& value) const {
    const auto& [a, b] = value;
    return OrderedJson::array({a, b});
  }
  OrderedJson schema(const Limits&) const {
    OrderedJson json = array_schema(nullptr, 2, 2);
    json.erase("items");
    json["prefixItems"] = {number_schema(first), number_schema(second)};
    return json;
  }
};

// An object with its own table.
template <typename M>
struct Object {
  using Value = typename M::ValueType;
  const M& members;
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    return members.read(in, context);
  }
  OrderedJson write(const Value& value) const { return members.write(value); }
  OrderedJson schema(const Limits&) const { return reference_to(members); }
  std::vector<const MemberTable*> objects() const { return {&members}; }
};
template <typename M>
Object(const M&) -> Object<M>;

// An object with its own table, or true for an object with all defaults, or false for none (an empty value).
template <typename M>
struct FlagOrObject {
  using Value = std::optional<typename M::ValueType>;
  const M& members;
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    if (in.value().is_boolean()) return in.value().template get<bool>() ? Value(std::in_place) : Value();
    auto value = members.read(in, context);
    return value ? std::optional<Value>(std::move(*value)) : std::nullopt;
  }
  OrderedJson write(const Value& value) const { return value ? members.write(*value) : OrderedJson(); }
  OrderedJson schema(const Limits&) const {
    return {{"anyOf", OrderedJson::array({{{"type", "boolean"}}, reference_to(members)})}};
  }
  std::vector<const MemberTable*> objects() const { return {&members}; }
};
template <typename M>
FlagOrObject(const M&) -> FlagOrObject<M>;

// An array of elements of one kind.
template <typename Kind>
struct List {
  using Value = std::vector<typename Kind::Value>;
  Kind item;
  Bound min, max;
  std::string_view unit{};
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    Value list;
    const std::size_t before = in.faults();
    in.elements(static_cast<std::size_t>(min(context.limits)), static_cast<std::size_t>(max(context.limits)),
                [&](const JsonReader& element) {
                  if (auto value = item.read(element, context)) list.push_back(std::move(*value));
                });
    return in.faults() == before ? std::optional(std::move(list)) : std::nullopt;
  }
  OrderedJson write(const Value& list) const {
    OrderedJson json = OrderedJson::array();
    for (const auto& value : list) json.push_back(item.write(value));
    return json;
  }
  OrderedJson schema(const Limits& limits) const {
    return array_schema(item.schema(limits), static_cast<std::size_t>(min(limits)),
                        static_cast<std::size_t>(max(limits)));
  }
  std::vector<const MemberTable*> objects() const requires requires(const Kind& kind) { kind.objects(); }
  { return item.objects(); }
};

template <typename Kind>
List(Kind, Bound, Bound) -> List<Kind>;
template <typename Kind>
List(Kind, Bound, Bound, std::string_view) -> List<Kind>;

// An object with members of any names, all of one kind.
template <typename Kind>
struct Map {
  using Value = std::map<std::string, typename Kind::Value>;
  Kind item;
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    if (!in.value().is_object()) {
      in.fail("must be an object");
      return std::nullopt;
    }
    Value map;
    for (const auto& [name, json] : in.value().items())
      if (auto value = item.read(in.at(name), context)) map.emplace(name, std::move(*value));
    return map;
  }
  OrderedJson write(const Value& map) const {
    OrderedJson json = OrderedJson::object();
    for (const auto& [name, value] : map) json[name] = item.write(value);
    return json;
  }
  OrderedJson schema(const Limits& limits) const {
    return {{"type", "object"}, {"additionalProperties", item.schema(limits)}};
  }
  std::vector<const MemberTable*> objects() const { return item.objects(); }
};
template <typename Kind>
Map(Kind) -> Map<Kind>;

// Content of a file in the assets folder, and the name by which the request refers to it.
template <typename T>
struct Named {
  std::string name;
  std::shared_ptr<const T> content;
};

// The name of a file in the assets folder, read into the file's content.
template <typename T>
struct Asset {
  using Value = Named<T>;
  std::shared_ptr<const T> (Assets::*find)(std::string_view name, const StopToken& stop) const;
  const char* noun;    // "map"
  const char* folder;  // "maps"
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    std::optional<std::string> name = in.text();
    if (!name) return std::nullopt;
    if (auto content = (context.assets.*find)(*name, context.stop)) return Value{std::move(*name), std::move(content)};
    in.fail(std::string("no such ") + noun + "; the service has " + listed(context.assets.names(folder)));
    return std::nullopt;
  }
  OrderedJson write(const Value& value) const { return value.name; }
  OrderedJson schema(const Limits&) const { return {{"type", "string"}}; }
  OrderedJson fallback() const { return {}; }
};
template <typename T>
Asset(std::shared_ptr<const T> (Assets::*)(std::string_view, const StopToken&) const, const char*, const char*)
    -> Asset<T>;

}  // namespace selenograph::api
