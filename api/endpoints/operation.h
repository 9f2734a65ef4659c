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

  // `text`: Markdown.
  void describe(const char* text) { json["description"] = text; }
  void parameter(const char* name, const char* in, const char* description, bool required, OrderedJson schema);
  // The call supports If-None-Match, and 304 with the description `known`.
  void may_be_known(const char* known);
  // Adds the body of a POST, with the examples in examples.json for this path.
  void body(std::string_view path, const MemberTable& request);
  // The body may also be an .npz of arrays.
  void takes_arrays(const char* description);

  // Answer 200: JSON, as a component with this name.
  void answer(const char* description, const char* name, OrderedJson schema);
  // Answer 200 in each of its media types. JSON is described, the others are binary.
  void answer_as_accepted(std::span<const Alternative> alternatives, const char* json_schema,
                          std::initializer_list<const char*> headers);
  // Adds a component.
  void schema(const char* name, OrderedJson schema) { schemas[name] = std::move(schema); }

  std::size_t most_points() const { return static_cast<std::size_t>(limits_.max_rays); }

  OrderedJson json = OrderedJson::object();
  OrderedJson schemas = OrderedJson::object();
  const MemberTable* request = nullptr;  // table of the body; null: no body

 private:
  const Limits& limits_;
};

OrderedJson parameter_json(const char* name, const char* in, const char* description, bool required,
                           OrderedJson schema);
// References to components: {"ETag": ..}, and so on.
OrderedJson header_references(std::initializer_list<const char*> names);

// Examples of valid requests, by path and name. Shown in the document, sent by tests.
const OrderedJson& examples();
std::string_view examples_json();  // examples.json, made by deploy/support/embed.cmake

}  // namespace selenograph::api
