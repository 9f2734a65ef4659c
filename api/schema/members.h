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

// What reading depends on besides the request.
struct ReadContext {
  const Limits& limits;
  const Assets& assets;
  StopToken stop{};       // files may take long to read
  std::string sun_utc{};  // the epoch that the request's Sun is given by; empty: it is given otherwise
};

class MemberTable;

// What is said about a member: all of its row but the functions that touch a C++ object.
struct MemberRow {
  std::string_view name;
  std::string_view unit;  // empty: none
  std::string text;       // one line
  bool required = false;
  // Words of the table's model (MemberTable::set_model) that have this member; empty: all. The others refuse it.
  std::vector<std::string_view> models{};
  std::function<OrderedJson(const Limits&)> schema{};    // of its values, without description and default
  std::function<OrderedJson(const Limits&)> fallback{};  // null: left out, it has no value
  std::vector<const MemberTable*> objects{};             // that its values consist of
};

// What is said about an object, whatever C++ type it is read into.
class MemberTable {
 public:
  MemberTable(std::string_view name, std::string description) : name_(name), description_(std::move(description)) {}
  MemberTable(const MemberTable&) = delete;
  MemberTable& operator=(const MemberTable&) = delete;

  std::string_view name() const { return name_; }  // of the component in the API document
  const std::string& description() const { return description_; }
  std::span<const MemberRow> rows() const { return rows_; }

  // Rules across members. What breaks one is reported by name, and the schema says the same.
  void exactly_one(std::vector<std::string_view> names);
  // One of these at least; the first is what is asked for.
  void any_of(std::vector<std::string_view> names);
  // Where `name` is, none of `others` may be.
  void excludes(std::string_view name, std::vector<std::string_view> others, std::string why = {});
  // Where `name` is, one of `others` must be; the first is what is asked for. A single other is what is reported.
  void needs(std::string_view name, std::vector<std::string_view> others, std::string why = {});
  // The member whose word decides which rows belong (MemberRow::models).
  void set_model(std::string_view name) { model_ = name; }
  // A condition that a check beside the table makes; one more of the schema's "allOf".
  void also(std::function<OrderedJson(const Limits&)> condition) { conditions_.push_back(std::move(condition)); }

  OrderedJson schema(const Limits& limits) const;
  // "### Name", the description, the rules, a line for each member.
  std::string markdown(const Limits& limits) const;

 protected:
  // Reports what is no object, unknown members, missing ones, those of other models.
  bool check_names(const JsonReader& in) const;
  void check_rules(const JsonReader& in) const;
  bool belongs(const MemberRow& row, const OrderedJson& written) const;

  std::vector<MemberRow> rows_;

 private:
  struct Rule {
    enum class Kind { exactly_one, any_of, excludes, needs };
    Kind kind;
    std::string_view name;  // of excludes and needs
    std::vector<std::string_view> others;
    std::string why;
    OrderedJson schema() const;
    std::string text() const;                // for people
    bool check(const JsonReader& in) const;  // false: broken, and reported
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

// Where a row's value lives when that is no member of the form: `get` answers nothing where there is none to write.
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

// An object that is read into a Form and then, when nothing is wrong with it, resolved into a Value.
template <typename Form, typename Value = Form>
class Members : public MemberTable {
 public:
  using FormType = Form;
  using ValueType = Value;
  using MemberTable::MemberTable;

  // A row as it is being declared.
  class Added {
   public:
    Added(MemberRow& row, std::function<bool(const Form&)>& written) : row_(row), written_(written) {}
    Added& required() { return row_.required = true, row_.fallback = nullptr, *this; }
    Added& of(std::vector<std::string_view> models) { return row_.models = std::move(models), *this; }
    // Left out of the resolved request otherwise.
    Added& written_if(std::function<bool(const Form&)> condition) { return written_ = std::move(condition), *this; }

   private:
    MemberRow& row_;
    std::function<bool(const Form&)>& written_;
  };

  // A field is a pointer to a member of Form, a function that answers a reference to one, or a Property. A
  // std::optional of the kind's value may stay empty; of anything else the value of a new Form is the default. A kind
  // is one of member_kinds.h, or of their shape.
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

  // The value of what is left out where that depends on the service's limits.
  void start_from(std::function<Form(const Limits&)> initial) { initial_ = std::move(initial); }
  // More checks, made when an object was read, whatever is wrong with it: faulty members have their defaults.
  void check(std::function<void(const JsonReader&, Form&, const ReadContext&)> check) { check_ = std::move(check); }
  // From a form without faults to a value; reports and answers nothing where that can't be. And back.
  void resolve(std::function<std::optional<Value>(const JsonReader&, Form&, const ReadContext&)> resolve) {
    resolve_ = std::move(resolve);
  }
  void unresolve(std::function<Form(const Value&)> form_of) { form_of_ = std::move(form_of); }

  // Nothing where there are faults, which are reported.
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

  // As resolved: a request's members that give this value again, in the order of the table.
  OrderedJson write(const Value& value) const {
    if constexpr (std::is_same_v<Form, Value>) {
      if (!form_of_) return write_form(value);
    }
    return write_form(form_of_(value));
  }

 private:
  struct Access {
    std::function<void(const JsonReader&, Form&, const ReadContext&)> read;
    std::function<OrderedJson(const Form&)> write;  // null: there is nothing to write
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

  // Objects have no default of their own: their members have.
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

// Builds a table in place: tables are not copied, rows refer to them.
template <typename M, typename Fill>
std::unique_ptr<const M> made(std::string_view name, std::string description, Fill&& fill) {
  auto members = std::make_unique<M>(name, std::move(description));
  fill(*members);
  return members;
}

}  // namespace selenograph::api
