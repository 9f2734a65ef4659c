// The members of answers, each declared once: one row gives the value that is written and its JSON Schema in the API
// document.
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

// Schemas of values.
namespace schema {

OrderedJson ref(const std::string& name);
OrderedJson number(const Range& range, const char* description);
OrderedJson number_or_null(const char* description);
OrderedJson integer(std::int64_t min, std::int64_t max, const char* description);
OrderedJson boolean(const char* description);
OrderedJson text(const char* description);
OrderedJson vector(const char* description);
OrderedJson list(const OrderedJson& items, std::size_t most, const char* description);
// An array of any length.
OrderedJson array(OrderedJson items, const char* description = "");
OrderedJson with(OrderedJson json, const char* key, OrderedJson value);
// An object whose members are named in the description.
OrderedJson free_object(const char* description);
// An object; later versions may add members.
OrderedJson object(const char* description, OrderedJson properties, std::initializer_list<const char*> required);

template <typename Table>
OrderedJson words(const Table& table, const char* description) {
  OrderedJson json{{"type", "string"}, {"enum", OrderedJson::array()}, {"description", description}};
  for (const auto& [name, meaning] : table) json["enum"].push_back(name);
  return json;
}

}  // namespace schema

// JSON has no NaN: a number that is not finite is null, like an empty std::optional.
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

// An object in an answer, written from a Source.
template <typename Source>
class Answer {
 public:
  using There = std::function<bool(const Source&)>;

  explicit Answer(const char* description) : description_(description) {}

  // Adds a member, written always or if `there` is true.
  template <typename Value>
  void add(const char* name, OrderedJson schema, Value value, There there = {}) {
    rows_.push_back(
        {name, std::move(schema), [value](const Source& s) { return answer_json(value(s)); }, std::move(there)});
  }
  // Describes a member that is written elsewhere.
  void describe(const char* name, OrderedJson schema) { rows_.push_back({name, std::move(schema), {}, {}}); }

  OrderedJson write(const Source& source) const {
    OrderedJson json = OrderedJson::object();
    for (const Row& row : rows_)
      if (row.value && (!row.there || row.there(source))) json[row.name] = row.value(source);
    return json;
  }
  template <typename Sources>
  OrderedJson write_all(const Sources& sources) const {
    OrderedJson json = OrderedJson::array();
    for (const auto& source : sources) json.push_back(write(source));
    return json;
  }

  // Members that are always written are required.
  OrderedJson schema() const {
    OrderedJson json = schema::object(description_, OrderedJson::object(), {});
    for (const Row& row : rows_) {
      json["properties"][row.name] = row.schema;
      if (row.value && !row.there) json["required"].push_back(row.name);
    }
    return json;
  }

 private:
  struct Row {
    const char* name;
    OrderedJson schema;
    std::function<OrderedJson(const Source&)> value;
    There there;
  };

  const char* description_;
  std::vector<Row> rows_;
};

template <typename Source, typename Fill>
Answer<Source> answer_of(const char* description, Fill&& fill) {
  Answer<Source> answer(description);
  fill(answer);
  return answer;
}

}  // namespace selenograph::api
