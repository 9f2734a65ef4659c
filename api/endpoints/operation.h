// Description of a call in the API document. Each endpoint describes itself.
#pragma once

#include <initializer_list>
#include <span>
#include <string>
#include <string_view>

#include "api/encode/negotiate.h"
#include "api/schema/answers.h"

namespace selenograph::api {

class Operation {
 public:
  explicit Operation(const Limits& limits) : limits_(limits) {}

  // Sets the description, in Markdown.
  void describe(const char* text) { json["description"] = text; }
  void parameter(const char* name, const char* in, const char* description, bool required, OrderedJson schema);
  // Adds If-None-Match, and the answer 304 with this description.
  void may_be_not_modified(const char* description);
  // Adds the body of a POST, with the examples in examples.json for this path.
  void body(std::string_view path, const MemberTable& request);
  // Adds an .npz of arrays as another form of the body.
  void accepts_arrays(const char* description);

  // Adds the answer 200 as JSON whose schema is a component with this name.
  void answer(const char* description, const char* name, OrderedJson schema);
  // Adds the answer 200 in each of its media types. JSON has the component `json_schema`, the others are binary.
  void answer_as_accepted(std::span<const Alternative> alternatives, const char* json_schema,
                          std::initializer_list<const char*> headers);
  // Adds a schema as a component.
  void schema(const char* name, OrderedJson schema) { schemas[name] = std::move(schema); }

  std::size_t max_points() const { return static_cast<std::size_t>(limits_.max_rays); }

  OrderedJson json = OrderedJson::object();     // the operation object of OpenAPI
  OrderedJson schemas = OrderedJson::object();  // components that it names
  const MemberTable* request = nullptr;         // table of the body; null: no body

 private:
  const Limits& limits_;
};

// Returns the parameter object of OpenAPI.
OrderedJson parameter_json(const char* name, const char* in, const char* description, bool required,
                           OrderedJson schema);
// Returns references to components: {"ETag": {"$ref": ...}, ...}.
OrderedJson header_references(std::initializer_list<const char*> names);

// Returns examples of valid requests, by path and name. The document shows them, and tests send them.
const OrderedJson& examples();
std::string_view examples_json();  // examples.json, made by deploy/support/embed.cmake

}  // namespace selenograph::api
