#include "api/schema/member_kinds.h"

#include <fmt/format.h>

#include <algorithm>

namespace selenograph::api {

OrderedJson number_schema(const Range& range) {
  constexpr Range kAny;
  OrderedJson json{{"type", "number"}};
  if (range.min > kAny.min) json[range.min_open ? "exclusiveMinimum" : "minimum"] = range.min;
  if (range.max < kAny.max) json[range.max_open ? "exclusiveMaximum" : "maximum"] = range.max;
  return json;
}

OrderedJson array_schema(OrderedJson items, std::size_t min, std::size_t max) {
  return {{"type", "array"}, {"minItems", min}, {"maxItems", max}, {"items", std::move(items)}};
}

OrderedJson reference_to(const MemberTable& table) {
  return {{"$ref", "#/components/schemas/" + std::string(table.name())}};
}

OrderedJson Integer::schema(const Limits& limits) const {
  return {{"type", "integer"}, {"minimum", min(limits)}, {"maximum", max(limits)}};
}

std::optional<std::int64_t> Choice::read(const JsonReader& in, const ReadContext&) const {
  const auto value =
      in.integer(*std::min_element(choices.begin(), choices.end()), *std::max_element(choices.begin(), choices.end()));
  if (!value || std::find(choices.begin(), choices.end(), *value) != choices.end()) return value;
  in.fail(fmt::format("must be {}", fmt::join(choices, " or ")));
  return std::nullopt;
}

std::optional<std::monostate> Constant::read(const JsonReader& in, const ReadContext&) const {
  const std::pair<std::string_view, std::monostate> words[] = {{word, {}}};
  return in.word(Words<std::monostate>(words));
}

std::optional<std::string> Text::read(const JsonReader& in, const ReadContext& context) const {
  std::optional<std::string> text = in.text();
  if (text && check) check(in, *text, context);
  return text;
}

std::optional<NumberOr::Value> NumberOr::read(const JsonReader& in, const ReadContext&) const {
  if (in.value().is_number()) {
    const auto number = in.number(range);
    return number ? std::optional<Value>(*number) : std::nullopt;
  }
  if (in.value() == word) return std::optional<Value>(Value());
  in.fail(fmt::format("must be a number{} or \"{}\"", unit.empty() ? "" : fmt::format(" ({})", unit), word));
  return std::nullopt;
}

OrderedJson NumberOr::schema(const Limits&) const {
  return {{"oneOf", {number_schema(range), {{"type", "string"}, {"const", word}}}}};
}

}  // namespace selenograph::api
