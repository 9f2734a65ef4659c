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

// Description of an object in an answer, independent of what it is written from.
class AnswerTable {
 public:
  explicit AnswerTable(const char* description) : description_(description) {}

  // Adds a member to the schema only: other code writes its value.
  void describe(const char* name, OrderedJson schema) { rows_.push_back({name, std::move(schema), {}, {}}); }
  // Returns the schema, in which members that are always written are required.
  OrderedJson schema() const;

 protected:
  struct Row {
    const char* name;
    OrderedJson schema;
    std::function<OrderedJson(const void* source)> value;  // null: written by other code
    std::function<bool(const void* source)> is_written;    // null: always
  };
  OrderedJson write_rows(const void* source) const;
  std::vector<Row> rows_;

 private:
  const char* description_;
};

// Table of an object in an answer, which is written from a Source.
template <typename Source>
class Answer : public AnswerTable {
 public:
  using AnswerTable::AnswerTable;

  // Adds a member, which is written if `is_written` returns true, or always if there is no such function.
  template <typename Value>
  void add(const char* name, OrderedJson schema, Value value, bool (*is_written)(const Source&) = nullptr) {
    Row row{name, std::move(schema), {}, {}};
    if constexpr (requires { +value; })
      row.value = writer_of(+value);
    else
      row.value = [value](const void* s) { return answer_json(value(*static_cast<const Source*>(s))); };
    if (is_written) row.is_written = [is_written](const void* s) { return is_written(*static_cast<const Source*>(s)); };
    rows_.push_back(std::move(row));
  }

  OrderedJson write(const Source& source) const { return write_rows(&source); }
  template <typename Sources>
  OrderedJson write_all(const Sources& sources) const {
    OrderedJson json = OrderedJson::array();
    for (const auto& source : sources) json.push_back(write(source));
    return json;
  }

 private:
  // A function for each type of value, not for each row.
  template <typename T>
  static std::function<OrderedJson(const void*)> writer_of(T (*value)(const Source&)) {
    return [value](const void* s) { return answer_json(value(*static_cast<const Source*>(s))); };
  }
};

// Returns a table whose rows fill(answer) has added.
template <typename Source, typename Fill>
Answer<Source> make_answer(const char* description, Fill&& fill) {
  Answer<Source> answer(description);
  fill(answer);
  return answer;
}

}  // namespace selenograph::api
