// Tables of the members of answers. Each member is declared once, in a row that gives both the value that is written
// and its JSON Schema in the API document:
//
//   a.add("hit_fraction", number(kUnitInterval, "share of ..."), [](const Source& s) { return s.hit_fraction; });
//
//   write(source) -> {"hit_fraction": 0.5}     schema() -> {"properties": {"hit_fraction": {"type": "number", ...}}}
#pragma once

#include <cmath>
#include <concepts>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "api/schema/member_kinds.h"

namespace selenograph::api {

// Functions that return the JSON Schemas of values.
namespace schema {

OrderedJson ref(const std::string& name);
OrderedJson number(const Range& range, const char* description);
OrderedJson number_or_null(const char* description);
OrderedJson integer(std::int64_t min, std::int64_t max, const char* description);
OrderedJson boolean(const char* description);
OrderedJson text(const char* description);
OrderedJson vector(const char* description);
// Returns the schema of an array of 1 to max_count elements.
OrderedJson list(const OrderedJson& items, std::size_t max_count, const char* description);
// Returns the schema of an array of any length.
OrderedJson array(OrderedJson items, const char* description = "");
// Returns the schema with one more keyword.
OrderedJson with_keyword(OrderedJson json, const char* key, OrderedJson value);
// Returns the schema of an object whose members are named only in the description.
OrderedJson free_object(const char* description);
// Returns the schema of an object with these members. It does not exclude others: later versions may add members.
OrderedJson object(const char* description, OrderedJson properties, std::initializer_list<const char*> required);

template <typename Table>
OrderedJson words(const Table& table, const char* description) {
  return {{"type", "string"}, {"enum", names_of(table)}, {"description", description}};
}

}  // namespace schema

// Returns a value as JSON. A number that is not finite becomes null, like an empty std::optional: JSON has no NaN.
template <typename T>
OrderedJson answer_json(const T& value) {
  if constexpr (std::floating_point<T>)
    return std::isfinite(value) ? OrderedJson(value) : OrderedJson();
  else if constexpr (detail::is_optional<T>)
    return value ? answer_json(*value) : OrderedJson();
  else if constexpr (std::is_same_v<T, Vec3>)
    return vector_json(value);
  else
    return OrderedJson(value);
}

// Table of an object in an answer, which is written from a Source.
template <typename Source>
class Answer {
 public:
  using Condition = std::function<bool(const Source&)>;

  explicit Answer(const char* description) : description_(description) {}

  // Adds a member, which is written if `is_written` returns true, or always if there is no such function.
  template <typename Value>
  void add(const char* name, OrderedJson schema, Value value, Condition is_written = {}) {
    rows_.push_back(
        {name, std::move(schema), [value](const Source& s) { return answer_json(value(s)); }, std::move(is_written)});
  }
  // Adds a member to the schema only: other code writes its value.
  void describe(const char* name, OrderedJson schema) { rows_.push_back({name, std::move(schema), {}, {}}); }

  OrderedJson write(const Source& source) const {
    OrderedJson json = OrderedJson::object();
    for (const Row& row : rows_)
      if (row.value && (!row.is_written || row.is_written(source))) json[row.name] = row.value(source);
    return json;
  }
  template <typename Sources>
  OrderedJson write_all(const Sources& sources) const {
    OrderedJson json = OrderedJson::array();
    for (const auto& source : sources) json.push_back(write(source));
    return json;
  }

  // Returns the schema, in which members that are always written are required.
  OrderedJson schema() const {
    OrderedJson json = schema::object(description_, OrderedJson::object(), {});
    for (const Row& row : rows_) {
      json["properties"][row.name] = row.schema;
      if (row.value && !row.is_written) json["required"].push_back(row.name);
    }
    return json;
  }

 private:
  struct Row {
    const char* name;
    OrderedJson schema;
    std::function<OrderedJson(const Source&)> value;  // null: written by other code
    Condition is_written;                             // null: always
  };

  const char* description_;
  std::vector<Row> rows_;
};

// Returns a table whose rows fill(answer) has added.
template <typename Source, typename Fill>
Answer<Source> make_answer(const char* description, Fill&& fill) {
  Answer<Source> answer(description);
  fill(answer);
  return answer;
}

}  // namespace selenograph::api
