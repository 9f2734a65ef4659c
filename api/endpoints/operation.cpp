#include "api/endpoints/operation.h"

namespace selenograph::api {
namespace {

OrderedJson json_content(const char* schema) { return {{"application/json", {{"schema", schema::ref(schema)}}}}; }

}  // namespace

OrderedJson parameter_json(const char* name, const char* in, const char* description, bool required,
                           OrderedJson schema) {
  return {
      {"name", name}, {"in", in}, {"description", description}, {"required", required}, {"schema", std::move(schema)}};
}

OrderedJson header_references(std::initializer_list<const char*> names) {
  OrderedJson headers = OrderedJson::object();
  for (const char* name : names) headers[name] = {{"$ref", std::string("#/components/headers/") + name}};
  return headers;
}

const OrderedJson& examples() {
  static const auto parsed = OrderedJson::parse(examples_json());
  return parsed;
}

void Operation::parameter(const char* name, const char* in, const char* description, bool required,
                          OrderedJson schema) {
  json["parameters"].push_back(parameter_json(name, in, description, required, std::move(schema)));
}

void Operation::may_be_not_modified(const char* description) {
  parameter("If-None-Match", "header", "ETags that the client has", false, {{"type", "string"}});
  json["responses"]["304"] = {{"description", description}, {"headers", header_references({"ETag"})}};
}

void Operation::body(std::string_view path, const MemberTable& members) {
  request = &members;
  OrderedJson content = json_content(std::string(members.name()).c_str());
  for (const auto& [name, value] : examples().at(std::string(path)).items())
    content["application/json"]["examples"][name] = {{"value", value}};
  json["requestBody"] = {{"required", true}, {"content", std::move(content)}};
}

void Operation::accepts_arrays(const char* description) {
  json["requestBody"]["content"]["application/x-npz"]["schema"] = {
      {"type", "string"}, {"contentMediaType", "application/x-npz"}, {"description", description}};
}

void Operation::answer(const char* description, const char* name, OrderedJson schema) {
  schemas[name] = std::move(schema);
  json["responses"]["200"] = {{"description", description}, {"content", json_content(name)}};
}

void Operation::answer_as_accepted(std::span<const Alternative> alternatives, const char* json_schema,
                                   std::initializer_list<const char*> headers) {
  std::string description = "In the format of `Accept`; without a preference the first.\n";
  OrderedJson content = OrderedJson::object();
  for (const Alternative& a : alternatives) {
    const std::string media_type(a.media_type);
    content[media_type] = {{"schema", media_type == "application/json"
                                          ? schema::ref(json_schema)
                                          : OrderedJson{{"type", "string"}, {"contentMediaType", media_type}}}};
    description += "\n- `" + media_type + "`: " + std::string(a.meaning);
  }
  json["responses"]["200"] = {
      {"description", description}, {"headers", header_references(headers)}, {"content", content}};
}

}  // namespace selenograph::api
