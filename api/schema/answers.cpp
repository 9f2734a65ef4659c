#include "api/schema/answers.h"

namespace selenograph::api {

OrderedJson AnswerTable::write_rows(const void* source) const {
  OrderedJson json = OrderedJson::object();
  for (const Row& row : rows_)
    if (row.value && (!row.is_written || row.is_written(source))) json[row.name] = row.value(source);
  return json;
}

OrderedJson AnswerTable::schema() const {
  OrderedJson json = schema::object(description_, OrderedJson::object(), {});
  for (const Row& row : rows_) {
    json["properties"][row.name] = row.schema;
    if (row.value && !row.is_written) json["required"].push_back(row.name);
  }
  return json;
}

namespace schema {

OrderedJson with_keyword(OrderedJson json, const char* key, OrderedJson value) {
  json[key] = std::move(value);
  return json;
}

OrderedJson ref(const std::string& name) { return {{"$ref", "#/components/schemas/" + name}}; }

OrderedJson number(const Range& range, const char* description) {
  return with_keyword(number_schema(range), "description", description);
}

OrderedJson number_or_null(const char* description) {
  return {{"type", {"number", "null"}}, {"description", description}};
}

OrderedJson integer(std::int64_t min, std::int64_t max, const char* description) {
  return {{"type", "integer"}, {"minimum", min}, {"maximum", max}, {"description", description}};
}

OrderedJson boolean(const char* description) { return {{"type", "boolean"}, {"description", description}}; }

OrderedJson text(const char* description) { return {{"type", "string"}, {"description", description}}; }

OrderedJson vector(const char* description) {
  return with_keyword(array_schema(number_schema({}), 3, 3), "description", description);
}

OrderedJson list(const OrderedJson& items, std::size_t max_count, const char* description) {
  return with_keyword(array_schema(items, 1, max_count), "description", description);
}

OrderedJson array(OrderedJson items, const char* description) {
  OrderedJson json{{"type", "array"}, {"items", std::move(items)}};
  if (*description) json["description"] = description;
  return json;
}

OrderedJson free_object(const char* description) { return {{"type", "object"}, {"description", description}}; }

OrderedJson object(const char* description, OrderedJson properties, std::initializer_list<const char*> required) {
  OrderedJson json{{"type", "object"}, {"description", description}, {"properties", std::move(properties)}};
  if (required.size() > 0) json["required"] = required;
  return json;
}

}  // namespace schema

}  // namespace selenograph::api
