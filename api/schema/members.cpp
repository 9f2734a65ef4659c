#include "api/schema/members.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

namespace selenograph::api {
namespace {

// Returns one schema per name that requires it, for "oneOf" and "anyOf".
OrderedJson require_each(std::span<const std::string_view> names) {
  OrderedJson list = OrderedJson::array();
  for (const std::string_view name : names) list.push_back({{"required", {name}}});
  return list;
}

// Returns a schema that an object with any of these members violates.
OrderedJson require_none(std::span<const std::string_view> names) {
  return {{"not", {{"anyOf", require_each(names)}}}};
}

// Returns the row's text with its unit: "center of a band (um)".
std::string with_unit(const MemberRow& row) {
  if (row.unit.empty()) return row.text;
  return row.text.empty() ? std::string(row.unit) : fmt::format("{} ({})", row.text, row.unit);
}

// Returns true for a default worth stating: not null and not an empty object or array.
bool is_stated(const OrderedJson& fallback) {
  return !fallback.is_null() && !(fallback.is_structured() && fallback.empty());
}

// --- texts of requests.md, from the schemas

// Returns "≥ 0, < 1" for the bounds of a number.
std::string bounds_text(const OrderedJson& schema) {
  const auto bound = [&](const char* closed, const char* open, const char* closed_sign,
                         const char* open_sign) -> std::string {
    if (schema.contains(closed)) return fmt::format("{}{}", closed_sign, schema[closed].get<double>());
    if (schema.contains(open)) return fmt::format("{}{}", open_sign, schema[open].get<double>());
    return {};
  };
  const std::string low = bound("minimum", "exclusiveMinimum", "≥ ", "> "),
                    high = bound("maximum", "exclusiveMaximum", "≤ ", "< ");
  return low.empty() || high.empty() ? low + high : low + ", " + high;
}

// Returns "1 to 3 × " for the length of an array.
std::string count_text(const OrderedJson& schema) {
  if (!schema.contains("minItems")) return {};
  const auto min = schema["minItems"].get<std::int64_t>(), max = schema["maxItems"].get<std::int64_t>();
  return min == max ? fmt::format("{} × ", min) : fmt::format("{} to {} × ", min, max);
}

std::string quoted_code(const OrderedJson& value) { return fmt::format("`{}`", value.dump()); }

// Returns a Markdown link to the heading `name`, whose anchor is in lower case.
std::string link_text(std::string_view name) {
  std::string anchor;
  for (const char c : name) anchor += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return fmt::format("[{}](#{})", name, anchor);
}

std::string type_text(const OrderedJson& schema);

// Returns the texts of the list's items, joined.
std::string joined(const OrderedJson& list, const char* separator, std::string (*text)(const OrderedJson&)) {
  std::string out;
  for (const OrderedJson& item : list) out += (out.empty() ? "" : separator) + text(item);
  return out;
}

// Returns a schema in words: "number ≥ 0", "array of 3 × number", "[Pose](#pose) or `false`".
std::string type_text(const OrderedJson& schema) {
  if (schema.contains("$ref")) {
    const std::string reference = schema["$ref"].get<std::string>();
    return link_text(std::string_view(reference).substr(reference.rfind('/') + 1));
  }
  for (const char* alternatives : {"oneOf", "anyOf"})
    if (schema.contains(alternatives)) return joined(schema[alternatives], " or ", type_text);
  if (schema.contains("const")) return quoted_code(schema["const"]);
  if (schema.contains("enum")) return joined(schema["enum"], ", ", quoted_code);
  const std::string type = schema["type"].get<std::string>();
  if (type == "array" && schema.contains("prefixItems"))
    return fmt::format("[{}]", joined(schema["prefixItems"], "; ", type_text));
  if (type == "array") return fmt::format("array of {}{}", count_text(schema), type_text(schema["items"]));
  if (type == "object" && schema.contains("additionalProperties"))
    return "object of any names: " + type_text(schema["additionalProperties"]);
  const std::string bounds = bounds_text(schema);
  return bounds.empty() ? type : type + " " + bounds;
}

// Returns a text as a cell of a Markdown table: on one line, with | escaped.
std::string cell(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  std::string out;
  for (const char c : text) out += c == '|' ? "\\|" : std::string(1, c);
  return out;
}

}  // namespace

void MemberTable::exactly_one(std::vector<std::string_view> names) {
  rules_.push_back({Rule::Kind::exactly_one, {}, std::move(names), {}});
}

void MemberTable::any_of(std::vector<std::string_view> names) {
  rules_.push_back({Rule::Kind::any_of, {}, std::move(names), {}});
}

void MemberTable::excludes(std::string_view name, std::vector<std::string_view> excluded, std::string why) {
  rules_.push_back({Rule::Kind::excludes, name, std::move(excluded), std::move(why)});
}

void MemberTable::needs(std::string_view name, std::vector<std::string_view> needed, std::string why) {
  rules_.push_back({Rule::Kind::needs, name, std::move(needed), std::move(why)});
}

OrderedJson MemberTable::Rule::schema() const {
  switch (kind) {
    case Kind::exactly_one:
      return {{"oneOf", require_each(members)}};
    case Kind::any_of:
      return {{"anyOf", require_each(members)}};
    case Kind::excludes:
      return {{"dependentSchemas", {{std::string(subject), require_none(members)}}}};
    case Kind::needs:
      return {{"dependentSchemas", {{std::string(subject), {{"anyOf", require_each(members)}}}}}};
  }
  return {};
}

std::string MemberTable::Rule::text() const {
  std::string names;
  for (const std::string_view member : members) names += fmt::format("{}`{}`", names.empty() ? "" : ", ", member);
  const bool has_single_member = members.size() == 1;
  switch (kind) {
    case Kind::exactly_one:
      return fmt::format("exactly one of {} is required", names);
    case Kind::any_of:
      return fmt::format("at least one of {} is required", names);
    case Kind::excludes:
      return fmt::format("`{}` cannot be combined with {}", subject, names);
    case Kind::needs:
      return fmt::format("`{}` needs {}{}", subject, has_single_member ? "" : "one of ", names);
  }
  return {};
}

bool MemberTable::Rule::check(const JsonReader& in) const {
  const auto is_present = [&](std::string_view member) { return in.has(member); };
  const auto first_present = std::find_if(members.begin(), members.end(), is_present);
  switch (kind) {
    case Kind::exactly_one: {
      std::vector<std::string_view> present;
      std::copy_if(members.begin(), members.end(), std::back_inserter(present), is_present);
      if (present.empty()) in.fail("needs one of " + quoted_list(members, " or "));
      if (present.size() > 1)
        in.fail(present[1], quoted_list(present, " and ") + " exclude each other: give one of them");
      return present.size() == 1;
    }
    case Kind::any_of:
      if (first_present != members.end()) return true;
      in.fail(members.front(), "is required");
      return false;
    case Kind::excludes:
      if (first_present == members.end() || !in.has(subject)) return true;
      in.fail(*first_present, fmt::format("\"{}\" cannot be combined with \"{}\"{}", *first_present, subject,
                                          why.empty() ? "" : ": " + why));
      return false;
    case Kind::needs:
      if (first_present != members.end() || !in.has(subject)) return true;
      if (members.size() == 1)
        in.fail(members.front(), fmt::format("is required with \"{}\"", subject));
      else
        in.fail(subject, fmt::format("needs a \"{}\"{}", members.front(), why.empty() ? "" : ": " + why));
      return false;
  }
  return true;
}

void MemberTable::add_row(MemberRow row) {
  names_.push_back(row.name);
  rows_.push_back(std::move(row));
}

void MemberTable::set_model(std::string_view name) {
  const MemberRow& row = *std::find_if(rows_.begin(), rows_.end(), [&](const MemberRow& r) { return r.name == name; });
  model_ = name;
  row.kind->schema(Limits{})["enum"].get_to(model_words_);
  if (!row.required) fallback(row, Limits{}).get_to(default_model_);
}

OrderedJson MemberTable::fallback(const MemberRow& row, const Limits& limits) const {
  if (!row.objects.empty()) return {};
  if (std::optional<OrderedJson> own = row.kind->own_fallback()) return *own;
  return default_of(row, limits);
}

// Returns the row's entry in the schema's "properties".
OrderedJson MemberTable::row_schema(const MemberRow& row, const Limits& limits) const {
  OrderedJson json = row.kind->schema(limits);
  std::string description = with_unit(row);
  if (json.contains("description")) description.append("\n").append(json["description"].get<std::string>());
  json["description"] = description;
  if (!row.unit.empty()) json["x-unit"] = row.unit;  // machine-readable; the description names the unit, too
  if (!row.required)
    if (const OrderedJson value = fallback(row, limits); is_stated(value)) json["default"] = value;
  return json;
}

// Returns the row's default for requests.md: "required", the value, or nothing for a default not worth stating.
std::string MemberTable::default_text(const MemberRow& row, const Limits& limits) const {
  if (row.required) return "required";
  const OrderedJson value = fallback(row, limits);
  return is_stated(value) ? quoted_code(value) : "";
}

void MemberTable::read_rows(const JsonReader& in, void* form, const ReadContext& context) const {
  check_rules(in);
  for (const MemberRow& row : rows_)
    if (in.has(row.name)) row.field->read(*row.kind, in.at(row.name), context, form);
}

OrderedJson MemberTable::write_rows(const void* form) const {
  OrderedJson json = OrderedJson::object();
  for (const MemberRow& row : rows_) {
    if (!belongs(row, json) || (row.is_written && !row.is_written(form))) continue;
    OrderedJson member = row.field->write(*row.kind, form);
    if (!member.is_null()) json[std::string(row.name)] = std::move(member);
  }
  return json;
}

bool MemberTable::check_names(const JsonReader& in) const {
  if (!in.object(names_)) return false;
  for (const MemberRow& row : rows_)
    if (row.required && row.models.empty() && !in.has(row.name)) in.fail(row.name, "is required");
  check_models(in);
  return true;
}

void MemberTable::check_rules(const JsonReader& in) const {
  // Tables add exactly_one before the exclusions that belong to it. Skip those once it is violated, or a client that
  // gives both "fov_deg" and "fx" would get a second error for the "cx" that belongs to "fx".
  bool exactly_one_holds = true;
  for (const Rule& rule : rules_) {
    if (rule.kind == Rule::Kind::excludes && !exactly_one_holds) continue;
    const bool holds = rule.check(in);
    if (rule.kind == Rule::Kind::exactly_one) exactly_one_holds &= holds;
  }
}

bool MemberRow::is_of(std::string_view model) const {
  return models.empty() || std::find(models.begin(), models.end(), model) != models.end();
}

void MemberTable::check_models(const JsonReader& in) const {
  if (model_.empty()) return;
  const Json* given_model = in.has(model_) ? &in.at(model_).value() : nullptr;
  const std::string model = !given_model               ? default_model_
                            : given_model->is_string() ? given_model->get<std::string>()
                                                       : "";
  // Check nothing for a model that is missing, unknown or not a string: its own row reports it.
  if (std::find(model_words_.begin(), model_words_.end(), model) == model_words_.end()) return;
  for (const MemberRow& row : rows_) {
    if (row.models.empty()) continue;
    const bool applies = row.is_of(model);
    if (!applies && in.has(row.name))
      in.fail(row.name, fmt::format("belongs to {}, not to \"{}\"", quoted_list(row.models, ", "), model));
    if (applies && row.required && !in.has(row.name)) in.fail(row.name, fmt::format("is required for \"{}\"", model));
  }
}

bool MemberTable::belongs(const MemberRow& row, const OrderedJson& written) const {
  return row.models.empty() || row.is_of(written.at(std::string(model_)).get_ref<const std::string&>());
}

// Each schema says: if the model is this word, then members of other models are forbidden and its own are required.
std::vector<OrderedJson> MemberTable::model_schemas() const {
  std::vector<OrderedJson> list;
  for (const std::string& word : model_words_) {
    // JSON Schema applies "const" only to a member that is present, so a missing model would satisfy every "if". Only
    // the default word may do without it.
    OrderedJson has_word{{"properties", {{std::string(model_), {{"const", word}}}}}};
    if (word != default_model_) has_word["required"] = {model_};
    std::vector<std::string_view> foreign, own;
    for (const MemberRow& row : rows_) {
      if (!row.is_of(word)) foreign.push_back(row.name);
      if (row.required && !row.models.empty() && row.is_of(word)) own.push_back(row.name);
    }
    OrderedJson then = foreign.empty() ? OrderedJson::object() : require_none(foreign);
    if (!own.empty()) then["required"] = own;
    if (!then.empty()) list.push_back({{"if", has_word}, {"then", then}});
  }
  return list;
}

std::string link_to(const MemberTable& table) { return link_text(table.name()); }

OrderedJson MemberTable::schema(const Limits& limits) const {
  OrderedJson json{{"type", "object"}, {"description", description_}, {"additionalProperties", false}};
  json["properties"] = OrderedJson::object();
  for (const MemberRow& row : rows_) {
    json["properties"][std::string(row.name)] = row_schema(row, limits);
    if (row.required && row.models.empty()) json["required"].push_back(row.name);
  }
  for (const Rule& rule : rules_) json["allOf"].push_back(rule.schema());
  for (const OrderedJson& model : model_schemas()) json["allOf"].push_back(model);
  for (const auto& condition : conditions_) json["allOf"].push_back(condition(limits));
  return json;
}

std::string MemberTable::markdown(const Limits& limits) const {
  std::string out = fmt::format("### {}\n\n{}\n\n", name_, description_);
  for (const Rule& rule : rules_) out += fmt::format("{}{}", &rule == &rules_.front() ? "Rules: " : "; ", rule.text());
  if (!rules_.empty()) out += ".\n\n";
  out += "| member | value | unit | default | |\n|---|---|---|---|---|\n";
  for (const MemberRow& row : rows_) {
    const std::string models = row.models.empty() ? "" : fmt::format("; of {}", quoted_list(row.models, ", "));
    out += fmt::format("| `{}` | {} | {} | {} | {} |\n", row.name, cell(type_text(row.kind->schema(limits))), row.unit,
                       cell(default_text(row, limits)), cell(row.text + models));
  }
  return out;
}

}  // namespace selenograph::api
