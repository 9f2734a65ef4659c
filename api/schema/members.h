// Tables of the members of a request's JSON objects. Each member is declared once, in a row from which follow:
//
//   client's JSON --read--> Form --resolve--> Value (engine's type)
//                                                |
//   resolved JSON <-write-- Form <-unresolve-----+
//
//   schema() --> /openapi.json       markdown() --> requests.md
//
// A Form has the members that a client may write (a pose by look_at), a Value what they mean (a quaternion). Without
// resolve() both are the same type. api/README.md says how to add a member.
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

// Returns the terrain's height above the sphere at a place, m; NaN without data.
using GroundHeight = std::function<double(double lat_deg, double lon_deg)>;

// Context for reading a request.
struct ReadContext {
  const Limits& limits;
  const Assets& assets;
  StopToken stop{};              // stops the reading of files
  std::string sun_utc{};         // epoch of the request's Sun; empty: not given by an epoch
  double pose_time_s = 0;        // while a pose at a time is read: its time after that epoch
  GroundHeight ground_height{};  // ground with the request's detail; empty: the request is read without terrain
};

class MemberTable;

// The values of a member, whatever their C++ type.
class MemberValues {
 public:
  virtual ~MemberValues() = default;
  virtual OrderedJson schema(const Limits& limits) const = 0;    // without description and default
  virtual OrderedJson fallback(const Limits& limits) const = 0;  // the default; null: none
};

// Description of a member: its row without the access to a C++ object.
struct MemberRow {
  std::string_view name;
  std::string_view unit;  // empty: none
  std::string text;       // what the member means: one line of Markdown
  bool required = false;
  // Words of the table's model (MemberTable::set_model) that have this member; empty: all. With other words the member
  // is a fault.
  std::vector<std::string_view> models{};
  const MemberValues* values = nullptr;       // in the table; never null in a row
  std::vector<const MemberTable*> objects{};  // tables of the objects in its values

  // Returns true if objects with this word as their model have the member.
  bool is_of(std::string_view model) const;
};

// Description of an object, independent of its C++ type.
class MemberTable {
 public:
  MemberTable(std::string_view name, std::string description) : name_(name), description_(std::move(description)) {}
  MemberTable(const MemberTable&) = delete;
  MemberTable& operator=(const MemberTable&) = delete;

  std::string_view name() const { return name_; }  // name of the component in the API document
  std::span<const MemberRow> rows() const { return rows_; }

  // The next four functions add a rule across members. Violations are reported at the members, and the schema has the
  // same rules.
  //
  // Requires exactly one of these members.
  void exactly_one(std::vector<std::string_view> names);
  // Requires at least one of these members; the error asks for the first.
  void any_of(std::vector<std::string_view> names);
  // Forbids all of `excluded` where the member `name` is present. `why` is part of the error.
  void excludes(std::string_view name, std::vector<std::string_view> excluded, std::string why = {});
  // Requires one of `needed` where the member `name` is present; the error asks for the first. `why` is part of the
  // error if there are several.
  void needs(std::string_view name, std::vector<std::string_view> needed, std::string why = {});
  // Declares that the member `name` holds the object's model, a word such as "pinhole" or "fisheye" that decides which
  // rows apply (MemberRow::models). Its row must be complete: its words and its default are taken from there.
  void set_model(std::string_view name);
  // Adds a condition to the schema's "allOf" for a check outside the table.
  void add_condition(std::function<OrderedJson(const Limits&)> condition) {
    conditions_.push_back(std::move(condition));
  }

  OrderedJson schema(const Limits& limits) const;
  // Returns the object's section of requests.md: heading, description, rules, and a table with a row for each member.
  std::string markdown(const Limits& limits) const;

 protected:
  // Reports a value that is not an object (then returns false), unknown members, missing ones, and those of other
  // models.
  bool check_names(const JsonReader& in) const;
  // Reports violations of the rules across members.
  void check_rules(const JsonReader& in) const;
  // Returns true if the model has this member. `written` is the object as far as it is written: the row of the model
  // precedes the rows that depend on it.
  bool belongs(const MemberRow& row, const OrderedJson& written) const;
  void add_row(MemberRow row);

  std::vector<MemberRow> rows_;

 private:
  // A rule across members:
  //
  //   exactly_one, any_of   exactly one, or at least one, of `members` must be present
  //   excludes              where `subject` is present, none of `members` may be
  //   needs                 where `subject` is present, one of `members` must be
  struct Rule {
    enum class Kind { exactly_one, any_of, excludes, needs };
    Kind kind;
    std::string_view subject;  // empty for exactly_one and any_of
    std::vector<std::string_view> members;
    std::string why;  // reason that the error gives; empty: none
    // Returns the rule as an entry of the schema's "allOf".
    OrderedJson schema() const;
    // Returns the rule in words, for requests.md.
    std::string text() const;
    // Returns true if the object keeps the rule; reports a violation.
    bool check(const JsonReader& in) const;
  };
  // Reports members that the object's model lacks, and missing ones that it requires.
  void check_models(const JsonReader& in) const;
  // Returns one "if ... then" schema per word of the model.
  std::vector<OrderedJson> model_schemas() const;

  std::string_view name_;
  std::string description_;
  std::vector<std::string_view> names_;  // names of the rows
  std::string_view model_;               // name of the row that holds the model; empty: the object has none
  std::vector<std::string> model_words_;
  std::string default_model_;  // empty: the client must give the model
  std::vector<Rule> rules_;
  std::vector<std::function<OrderedJson(const Limits&)>> conditions_;  // of add_condition()
};

// Returns a Markdown link to the table's heading in requests.md.
std::string link_to(const MemberTable& table);

// Field that is not a member of the form: `get` returns its value, empty if there is nothing to write; `set` stores it.
template <typename Get, typename Set>
struct Property {
  Get get;
  Set set;
};
template <typename Get, typename Set>
Property(Get, Set) -> Property<Get, Set>;

// Returns the field `inner` of the form's member `outer`.
template <typename Outer, typename Inner>
auto nested(Outer outer, Inner inner) {
  return [=](auto& form) -> auto& { return std::invoke(inner, std::invoke(outer, form)); };
}

// Returns a field that stores and writes nothing: other code reads the member, or it is only documented.
template <typename Form, typename Value>
auto no_field() {
  return Property{[](const Form&) { return std::optional<Value>(); }, [](Form&, const Value&) {}};
}

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

// Table of an object that is read into a Form and then, if it is valid, resolved into a Value.
template <typename Form, typename Value = Form>
class Members : public MemberTable {
 public:
  using ValueType = Value;
  using MemberTable::MemberTable;

  // The row that add() has just added, for further properties. It is valid until the next add().
  class AddedRow {
   public:
    AddedRow(MemberRow& row, std::function<bool(const Form&)>& written_if) : row_(row), written_if_(written_if) {}
    AddedRow& required() {
      row_.required = true;
      return *this;
    }
    // Restricts the member to these words of the table's model.
    AddedRow& only_for(std::vector<std::string_view> models) {
      row_.models = std::move(models);
      return *this;
    }
    // Writes the member into the resolved request only if the condition holds.
    AddedRow& written_if(std::function<bool(const Form&)> condition) {
      written_if_ = std::move(condition);
      return *this;
    }

   private:
    MemberRow& row_;
    std::function<bool(const Form&)>& written_if_;
  };

  // Adds a member. `field` is a pointer to a member of Form, a function that returns a reference to one, or a Property.
  // A std::optional of the kind's value may stay empty; any other field has the value in a new Form as its default.
  // `kind` is one of member_kinds.h, or has the same interface.
  template <typename Field, typename Kind>
  AddedRow add(std::string_view name, Field field, Kind kind, std::string text) {
    MemberRow row{name, {}, std::move(text)};
    if constexpr (requires { kind.unit; }) row.unit = kind.unit;
    if constexpr (requires { kind.objects(); }) row.objects = kind.objects();
    access_.push_back(std::make_unique<FieldAccess<Field, Kind>>(*this, field, std::move(kind)));
    row.values = access_.back().get();
    add_row(std::move(row));
    return {rows_.back(), access_.back()->written_if};
  }

  // Sets defaults that depend on the service's limits.
  void set_initial(std::function<Form(const Limits&)> initial) { initial_ = std::move(initial); }
  // Sets the check that runs after an object was read, even if it has faults: faulty members then have their defaults.
  void check(std::function<void(const JsonReader&, Form&, const ReadContext&)> check) { check_ = std::move(check); }
  // Sets the conversion of a form without faults to a value. It returns empty, and reports, if there is no such value.
  void resolve(std::function<std::optional<Value>(const JsonReader&, Form&, const ReadContext&)> resolve) {
    resolve_ = std::move(resolve);
  }
  // Sets the conversion of a value to the form in which it is written.
  void unresolve(std::function<Form(const Value&)> form_of) { form_of_ = std::move(form_of); }

  // Reads an object; returns empty if it has faults, which are reported.
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    const std::size_t before = in.faults();
    if (!check_names(in)) return std::nullopt;
    Form form = initial(context.limits);
    check_rules(in);
    for (std::size_t i = 0; i < rows_.size(); ++i)
      if (in.has(rows_[i].name)) access_[i]->read(in.at(rows_[i].name), form, context);
    if (check_) check_(in, form, context);
    if (in.faults() != before) return std::nullopt;
    if (resolve_) return resolve_(in, form, context);
    if constexpr (std::is_same_v<Form, Value>) return form;
    return std::nullopt;
  }

  // Reads the body of a request. Throws RequestError("invalid_request") with all faults found.
  Value read_body(const Json& body, const ReadContext& context) const {
    Findings findings;
    std::optional<Value> value = read(JsonReader(body, findings), context);
    findings.throw_if_any();
    return std::move(*value);
  }

  // Checks the content of a file of the operator's. Throws RequestError("asset_error") with its first fault.
  void check_file(const Json& content, const std::string& file, const ReadContext& context) const {
    Findings findings;
    read(JsonReader(content, findings), context);
    if (findings.empty()) return;
    const Finding& first = findings.entries().front();
    throw RequestError("asset_error", file + ": " + first.pointer + ": " + first.detail);
  }

  // Writes the resolved members, which give this value when read, in the order of the table.
  OrderedJson write(const Value& value) const {
    if constexpr (std::is_same_v<Form, Value>) {
      if (!form_of_) return write_form(value);
    }
    return write_form(form_of_(value));
  }

 private:
  // A row's access to a form.
  struct Access : MemberValues {
    virtual void read(const JsonReader& in, Form& form, const ReadContext& context) const = 0;
    virtual OrderedJson write(const Form& form) const = 0;  // returns null if there is nothing to write
    std::function<bool(const Form&)> written_if{};          // null: always
  };
  template <typename Field, typename Kind>
  struct FieldAccess final : Access {
    FieldAccess(const Members& of, Field of_form, Kind of_value)
        : table(of), field(std::move(of_form)), kind(std::move(of_value)) {}
    OrderedJson schema(const Limits& limits) const override { return kind.schema(limits); }
    OrderedJson fallback(const Limits& limits) const override {
      return Members::fallback(field, kind, table.initial(limits));
    }
    void read(const JsonReader& in, Form& form, const ReadContext& context) const override {
      if (auto value = kind.read(in, context)) assign(field, form, std::move(*value));
    }
    OrderedJson write(const Form& form) const override { return written(field, kind, form); }

    const Members& table;
    Field field;
    Kind kind;
  };

  // Returns a form in which every field has its default.
  Form initial(const Limits& limits) const { return initial_ ? initial_(limits) : Form{}; }

  // Writes the members that the form's model has and that have a value.
  OrderedJson write_form(const Form& form) const {
    OrderedJson json = OrderedJson::object();
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      if (!belongs(rows_[i], json) || (access_[i]->written_if && !access_[i]->written_if(form))) continue;
      OrderedJson member = access_[i]->write(form);
      if (!member.is_null()) json[std::string(rows_[i].name)] = std::move(member);
    }
    return json;
  }

  // Stores a value in the form; numbers are converted to the field's type.
  template <typename Field, typename NewValue>
  static void assign(const Field& field, Form& form, NewValue&& value) {
    if constexpr (detail::is_property<Field>) {
      field.set(form, std::forward<NewValue>(value));
    } else {
      auto& target = std::invoke(field, form);
      using Target = std::remove_reference_t<decltype(target)>;
      if constexpr (std::is_arithmetic_v<Target>) {
        target = static_cast<Target>(value);
      } else {
        target = std::forward<NewValue>(value);
      }
    }
  }

  // Returns the field's value as JSON; null if it is an empty std::optional.
  template <typename Field, typename Kind>
  static OrderedJson written(const Field& field, const Kind& kind, const Form& form) {
    if constexpr (detail::is_property<Field>) {
      const auto value = field.get(form);
      return value ? kind.write(*value) : OrderedJson();
    } else {
      const auto& member = std::invoke(field, form);
      using Member = std::remove_cvref_t<decltype(member)>;
      // A std::optional may stand for a missing member, or be the kind's own value, as that of NumberOr.
      if constexpr (detail::is_optional<Member> && !std::is_same_v<Member, typename Kind::Value>) {
        return member ? kind.write(*member) : OrderedJson();
      } else {
        return kind.write(member);
      }
    }
  }

  // Returns the default for the schema. Objects have none: their members have defaults.
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

  std::vector<std::unique_ptr<Access>> access_;
  std::function<Form(const Limits&)> initial_;
  std::function<void(const JsonReader&, Form&, const ReadContext&)> check_;
  std::function<std::optional<Value>(const JsonReader&, Form&, const ReadContext&)> resolve_;
  std::function<Form(const Value&)> form_of_;
};

// Returns a table whose rows fill(members) has added. The table never moves, since its rows point to it.
template <typename M, typename Fill>
std::unique_ptr<const M> make_table(std::string_view name, std::string description, Fill&& fill) {
  auto members = std::make_unique<M>(name, std::move(description));
  fill(*members);
  return members;
}

}  // namespace selenograph::api
