// What a call takes and answers, as the API document says it. Each endpoint describes itself.
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

  // Markdown.
  void describe(const char* text) { json["description"] = text; }
  void parameter(const char* name, const char* in, const char* description, bool required, OrderedJson schema);
  // The client may have the answer already: If-None-Match, and 304 with what `known` says.
  void may_be_known(const char* known);
  // The body of a POST, with the examples of examples.json for this path.
  void body(std::string_view path, const MemberTable& request);

  // 200: JSON, as a component of this name.
  void answer(const char* description, const char* name, OrderedJson schema);
  // 200: in each of its media types. JSON is described, the others are bytes.
  void answer_as_accepted(std::span<const Alternative> alternatives, const char* json_schema,
                          std::initializer_list<const char*> headers);
  // One more component.
  void schema(const char* name, OrderedJson schema) { schemas[name] = std::move(schema); }

  std::size_t most_points() const { return static_cast<std::size_t>(limits_.max_rays); }

  OrderedJson json = OrderedJson::object();
  OrderedJson schemas = OrderedJson::object();
  const MemberTable* request = nullptr;  // of the body; null: there is none

 private:
  const Limits& limits_;
};

OrderedJson parameter_json(const char* name, const char* in, const char* description, bool required,
                           OrderedJson schema);
// References to components: {"ETag": ..}, and so on.
OrderedJson header_references(std::initializer_list<const char*> names);

// By path, then by name: requests that work. Shown in the document, sent by tests.
const OrderedJson& examples();
std::string_view examples_json();  // examples.json, made by deploy/support/embed.cmake

}  // namespace selenograph::api
