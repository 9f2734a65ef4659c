// The members of a request's JSON objects, each declared once. From one row come its reader, its text in the resolved
// request, its JSON Schema in the API document and its line in requests.md. api/README.md says how to add one.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "api/assets/assets.h"
#include "api/json/json_reader.h"
#include "api/message/limits.h"

namespace selenograph::api {

using OrderedJson = nlohmann::ordered_json;

// Context for reading a request.
struct ReadContext {
  const Limits& limits;
  const Assets& assets;
  StopToken stop{};       // files may take long to read
  std::string sun_utc{};  // epoch of the request's Sun; empty: not given by an epoch
  double later_s = 0;     // time of the pose that is read, from that epoch
};

class MemberTable;

// Description of a member: its row without the functions that access a C++ object.
struct MemberRow {
  std::string_view name;
  std::string_view unit;  // empty: none
  std::string text;       // one line
  bool required = false;
  // Words of the table's model (MemberTable::set_model) that have this member; empty: all. The others refuse it.
  std::vector<std::string_view> models{};
  std::function<OrderedJson(const Limits&)> schema{};    // schema of its values, without description and default
  std::function<OrderedJson(const Limits&)> fallback{};  // null: no default
  std::vector<const MemberTable*> objects{};             // tables of its objects
};

// Description of an object, independent of its C++ type.
class MemberTable {
 public:
  MemberTable(std::string_view name, std::string description) : name_(name), description_(std::move(description)) {}
  MemberTable(const MemberTable&) = delete;
  MemberTable& operator=(const MemberTable&) = delete;

  std::string_view name() const { return name_; }  // name of the component in the API document
  const std::string& description() const { return description_; }
  std::span<const MemberRow> rows() const { return rows_; }

  // Rules across members. Violations are reported by name, and the schema has the same rules.
  void exactly_one(std::vector<std::string_view> names);
  // At least one of these; an error asks for the first.
  void any_of(std::vector<std::string_view> names);
  // `name` excludes all of `others`.
  void excludes(std::string_view name, std::vector<std::string_view> others, std::string why = {});
  // `name` requires one of `others`; an error asks for the first, or reports the only one.
  void needs(std::string_view name, std::vector<std::string_view> others, std::string why = {});
  // Sets the member whose word decides which rows apply (MemberRow::models).
  void set_model(std::string_view name) { model_ = name; }
  // Adds a condition to the schema's "allOf" for a check outside the table.
  void also(std::function<OrderedJson(const Limits&)> condition) { conditions_.push_back(std::move(condition)); }

  OrderedJson schema(const Limits& limits) const;
  // "### Name", the description, the rules, a line for each member.
  std::string markdown(const Limits& limits) const;

 protected:
  // Reports values that are not objects, unknown members, missing ones, and those of other models.
  bool check_names(const JsonReader& in) const;
  void check_rules(const JsonReader& in) const;
  bool belongs(const MemberRow& row, const OrderedJson& written) const;

  std::vector<MemberRow> rows_;

 private:
  struct Rule {
    enum class Kind { exactly_one, any_of, excludes, needs };
    Kind kind;
    std::string_view name;  // for excludes and needs
    std::vector<std::string_view> others;
    std::string why;
    OrderedJson schema() const;
    std::string text() const;                // in words
    bool check(const JsonReader& in) const;  // false: violated and reported
  };
  std::optional<std::string> model_of(const JsonReader& in) const;
  void check_models(const JsonReader& in) const;
  std::vector<OrderedJson> model_schemas(const Limits& limits) const;
  const MemberRow* row_called(std::string_view name) const;

  std::string_view name_;
  std::string description_;
  std::string_view model_;
  std::vector<Rule> rules_;
  std::vector<std::function<OrderedJson(const Limits&)>> conditions_;
};

// A table's heading in requests.md.
std::string link_to(const MemberTable& table);

// Accessors of a value that is not a member of the form: `get` returns empty if there is nothing to write.
template <typename Get, typename Set>
struct Property {
  Get get;
  Set set;
};
template <typename Get, typename Set>
Property(Get, Set) -> Property<Get, Set>;

namespace detail {
template <typename T>
inline constexpr bool is_optional = false;
template <typename T>
inline constexpr bool is_optional<std::optional<T>> = true;
template <typename T>
inline constexpr bool is_property = false;
template <typename Get, typename Set>
inline constexpr bool is_property<Property<Get, Set>> = true;
}  // namespace detail

// An object that is read into a Form and then, if it is valid, resolved into a Value.
template <typename Form, typename Value = Form>
class Members : public MemberTable {
 public:
  using FormType = Form;
  using ValueType = Value;
  using MemberTable::MemberTable;

  // A row being declared.
  class Added {
   public:
    Added(MemberRow& row, std::function<bool(const Form&)>& written) : row_(row), written_(written) {}
    Added& required() { return row_.required = true, row_.fallback = nullptr, *this; }
    Added& of(std::vector<std::string_view> models) { return row_.models = std::move(models), *this; }
    // Written into the resolved request only if the condition holds.
    Added& written_if(std::function<bool(const Form&)> condition) { return written_ = std::move(condition), *this; }

   private:
    MemberRow& row_;
    std::function<bool(const Form&)>& written_;
  };

  // A field is a pointer to a member of Form, a function that returns a reference to one, or a Property. A
  // std::optional of the kind's value may stay empty; for anything else the default is the value in a new Form. A kind
  // is one of member_kinds.h, or a type with the same interface.
  template <typename Field, typename Kind>
  Added add(std::string_view name, Field field, Kind kind, std::string text) {
    MemberRow row{name, {}, std::move(text)};
    if constexpr (requires { kind.unit; }) row.unit = kind.unit;
    if constexpr (requires { kind.objects(); }) row.objects = kind.objects();
    row.schema = [kind](const Limits& limits) { return kind.schema(limits); };
    row.fallback = [this, field, kind](const Limits& limits) { return fallback(field, kind, initial(limits)); };
    rows_.push_back(std::move(row));
    access_.push_back({[field, kind](const JsonReader& in, Form& form, const ReadContext& context) {
                         if (auto value = kind.read(in, context)) assign(field, form, std::move(*value));
                       },
                       [field, kind](const Form& form) { return written(field, kind, form); },
                       {}});
    return {rows_.back(), access_.back().written_if};
  }

  // Sets defaults that depend on the service's limits.
  void start_from(std::function<Form(const Limits&)> initial) { initial_ = std::move(initial); }
  // Adds checks that are made after an object was read, even if it has faults: faulty members have their defaults.
  void check(std::function<void(const JsonReader&, Form&, const ReadContext&)> check) { check_ = std::move(check); }
  // Sets the conversion of a form without faults to a value; it reports and returns empty if there is none.
  void resolve(std::function<std::optional<Value>(const JsonReader&, Form&, const ReadContext&)> resolve) {
    resolve_ = std::move(resolve);
  }
  void unresolve(std::function<Form(const Value&)> form_of) { form_of_ = std::move(form_of); }

  // Empty if there are faults, which are reported.
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    const std::size_t before = in.faults();
    if (!check_names(in)) return std::nullopt;
    Form form = initial(context.limits);
    check_rules(in);
    for (std::size_t i = 0; i < rows_.size(); ++i)
      if (in.has(rows_[i].name)) access_[i].read(in.at(rows_[i].name), form, context);
    if (check_) check_(in, form, context);
    if (in.faults() != before) return std::nullopt;
    if (resolve_) return resolve_(in, form, context);
    if constexpr (std::is_same_v<Form, Value>) return form;
    return std::nullopt;
  }

  // Writes the resolved members, which give this value when read, in the order of the table.
  OrderedJson write(const Value& value) const {
    if constexpr (std::is_same_v<Form, Value>) {
      if (!form_of_) return write_form(value);
    }
    return write_form(form_of_(value));
  }

 private:
  struct Access {
    std::function<void(const JsonReader&, Form&, const ReadContext&)> read;
    std::function<OrderedJson(const Form&)> write;  // null: nothing to write
    std::function<bool(const Form&)> written_if;
  };

  Form initial(const Limits& limits) const { return initial_ ? initial_(limits) : Form{}; }

  OrderedJson write_form(const Form& form) const {
    OrderedJson json = OrderedJson::object();
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      if (!belongs(rows_[i], json) || (access_[i].written_if && !access_[i].written_if(form))) continue;
      OrderedJson member = access_[i].write(form);
      if (!member.is_null()) json[std::string(rows_[i].name)] = std::move(member);
    }
    return json;
  }

  template <typename Field, typename V>
  static void assign(const Field& field, Form& form, V&& value) {
    if constexpr (detail::is_property<Field>) {
      field.set(form, std::forward<V>(value));
    } else {
      auto& place = std::invoke(field, form);
      using Place = std::remove_reference_t<decltype(place)>;
      if constexpr (std::is_arithmetic_v<Place>) {
        place = static_cast<Place>(value);
      } else {
        place = std::forward<V>(value);
      }
    }
  }

  template <typename Field, typename Kind>
  static OrderedJson written(const Field& field, const Kind& kind, const Form& form) {
    if constexpr (detail::is_property<Field>) {
      const auto value = field.get(form);
      return value ? kind.write(*value) : OrderedJson();
    } else {
      const auto& place = std::invoke(field, form);
      using Place = std::remove_cvref_t<decltype(place)>;
      if constexpr (detail::is_optional<Place> && !std::is_same_v<Place, typename Kind::Value>) {
        return place ? kind.write(*place) : OrderedJson();
      } else {
        return kind.write(place);
      }
    }
  }

  // Objects have no default: their members have.
  template <typename Field, typename Kind>
  static OrderedJson fallback(const Field& field, const Kind& kind, const Form& form) {
    if constexpr (requires { kind.objects(); }) {
      return {};
    } else if constexpr (requires { kind.fallback(); }) {
      return kind.fallback();
    } else {
      return written(field, kind, form);
    }
  }

  std::vector<Access> access_;
  std::function<Form(const Limits&)> initial_;
  std::function<void(const JsonReader&, Form&, const ReadContext&)> check_;
  std::function<std::optional<Value>(const JsonReader&, Form&, const ReadContext&)> resolve_;
  std::function<Form(const Value&)> form_of_;
};

// Builds a table in place: tables are not copied, since rows refer to them.
template <typename M, typename Fill>
std::unique_ptr<const M> made(std::string_view name, std::string description, Fill&& fill) {
  auto members = std::make_unique<M>(name, std::move(description));
  fill(*members);
  return members;
}

}  // namespace selenograph::api
