// What the answers' schemas are made of, and where they are: one file per topic. (The requests' come from their
// tables.)
#pragma once

#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>

#include "api/schema/member_kinds.h"

namespace selenograph::api {

void add_frame_answers(OrderedJson& schemas);
void add_point_answers(OrderedJson& schemas, const Limits& limits);
void add_feature_answers(OrderedJson& schemas);
void add_dataset_answers(OrderedJson& schemas);
void add_verify_answers(OrderedJson& schemas);

namespace schema {

OrderedJson ref(const std::string& name);
OrderedJson number(const Range& range, const char* description);
OrderedJson number_or_null(const char* description);
OrderedJson integer(std::int64_t min, std::int64_t max, const char* description);
OrderedJson boolean(const char* description);
OrderedJson text(const char* description);
OrderedJson vector(const char* description);
OrderedJson list(const OrderedJson& items, std::size_t most, const char* description);
// Of any length.
OrderedJson array(OrderedJson items);
OrderedJson with(OrderedJson json, const char* key, OrderedJson value);
// Later versions may say more.
OrderedJson object(const char* description, OrderedJson properties, std::initializer_list<const char*> required);

template <typename Table>
OrderedJson words(const Table& table, const char* description) {
  OrderedJson json{{"type", "string"}, {"enum", OrderedJson::array()}, {"description", description}};
  for (const auto& [name, meaning] : table) json["enum"].push_back(name);
  return json;
}

}  // namespace schema
}  // namespace selenograph::api
