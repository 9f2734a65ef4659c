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
#include "api/schema/fields.h"

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

// The kind of a row's values.
class RowKind : public AnyKind {
 public:
  virtual OrderedJson schema(const Limits& limits) const = 0;  // without description and default
  // Returns the default in the schema if it is not that of the form; null: none.
  virtual std::optional<OrderedJson> own_fallback() const = 0;
};

// A member: data from which reader, resolved request, schema and document follow.
struct MemberRow {
  std::string_view name;
  std::string_view unit;  // empty: none
  std::string text;       // what the member means: one line of Markdown
  std::unique_ptr<const Field> field;
  std::unique_ptr<const RowKind> kind;
  std::vector<const MemberTable*> objects{};  // tables of the objects in its values
  bool required = false;
  // Words of the table's model (MemberTable::set_model) that have this member; empty: all. With other words the member
  // is a fault.
  std::vector<std::string_view> models{};
  std::function<bool(const void* form)> is_written{};  // in the resolved request; null: always

  // Returns true if objects with this word as their model have the member.
  bool is_of(std::string_view model) const;
};

// Description of an object, independent of its C++ type.
class MemberTable {
 public:
  MemberTable(std::string_view name, std::string description) : name_(name), description_(std::move(description)) {}
  virtual ~MemberTable() = default;
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
  // Reads the members into the form. Reports faults, and violations of the rules across members.
  void read_rows(const JsonReader& in, void* form, const ReadContext& context) const;
  // Writes the members that the form's model has and that have a value.
  OrderedJson write_rows(const void* form) const;
  void add_row(MemberRow row);
  // Returns what a form with all defaults has for a row.
  virtual OrderedJson default_of(const MemberRow& row, const Limits& limits) const = 0;

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
  // Reports violations of the rules across members.
  void check_rules(const JsonReader& in) const;
  // Returns true if the model has this member. `written` is the object as far as it is written: the row of the model
  // precedes the rows that depend on it.
  bool belongs(const MemberRow& row, const OrderedJson& written) const;
  // Returns the default for the schema. Objects have none: their members have defaults.
  OrderedJson fallback(const MemberRow& row, const Limits& limits) const;
  OrderedJson row_schema(const MemberRow& row, const Limits& limits) const;
  std::string default_text(const MemberRow& row, const Limits& limits) const;
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

// A row's kind of this type.
template <typename Kind>
class KindOf final : public RowKind {
 public:
  explicit KindOf(Kind kind) : kind_(std::move(kind)) {}
  bool read(const JsonReader& in, const ReadContext& context, const Slot& to) const override {
    std::optional<Value> value = kind_.read(in, context);
    if (!value) return false;
    if constexpr (kIsNumber)
      store_in(to, static_cast<Number>(*value));
    else if (to.optional)
      *static_cast<std::optional<Value>*>(to.at) = std::move(value);
    else
      *static_cast<Value*>(to.at) = std::move(*value);
    return true;
  }
  OrderedJson write(const Slot& from) const override {
    if constexpr (kIsNumber) {
      const std::optional<Number> number = load(from, Number{});
      return number ? kind_.write(static_cast<Value>(*number)) : OrderedJson();
    } else if (from.optional) {
      const auto& value = *static_cast<const std::optional<Value>*>(from.at);
      return value ? kind_.write(*value) : OrderedJson();
    } else {
      return kind_.write(*static_cast<const Value*>(from.at));
    }
  }
  OrderedJson schema(const Limits& limits) const override { return kind_.schema(limits); }
  std::optional<OrderedJson> own_fallback() const override {
    if constexpr (requires { kind_.fallback(); }) return kind_.fallback();
    return std::nullopt;
  }

 private:
  using Value = typename Kind::Value;
  static constexpr bool kIsNumber = std::is_arithmetic_v<Value>;
  using Number = std::conditional_t<std::is_floating_point_v<Value>, double,
                                    std::conditional_t<std::is_same_v<Value, bool>, bool, std::int64_t>>;
  static std::optional<bool> load(const Slot& from, bool) { return flag_in(from); }
  static std::optional<double> load(const Slot& from, double) { return number_in(from); }
  static std::optional<std::int64_t> load(const Slot& from, std::int64_t) { return integer_in(from); }

  Kind kind_;
};

// Table of an object that is read into a Form and then, if it is valid, resolved into a Value.
template <typename Form, typename Value = Form>
class Members : public MemberTable {
 public:
  using ValueType = Value;
  using MemberTable::MemberTable;

  // The row that add() has just added, for further properties. It is valid until the next add().
  class AddedRow {
   public:
    explicit AddedRow(MemberRow& row) : row_(row) {}
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
    AddedRow& written_if(bool (*condition)(const Form&)) {
      row_.is_written = [condition](const void* form) { return condition(*static_cast<const Form*>(form)); };
      return *this;
    }

   private:
    MemberRow& row_;
  };

  // Adds a member. `field`: see field_of(). A std::optional of the kind's value may stay empty; any other field has the
  // value in a new Form as its default. `kind` is one of member_kinds.h, or has the same interface.
  template <typename F, typename Kind>
  AddedRow add(std::string_view name, F field, Kind kind, std::string text) {
    MemberRow row{name, {}, std::move(text), field_of<typename Kind::Value>(std::move(field), any_form()), {}};
    if constexpr (requires { kind.unit; }) row.unit = kind.unit;
    if constexpr (requires { kind.objects(); }) row.objects = kind.objects();
    row.kind = std::make_unique<const KindOf<Kind>>(std::move(kind));
    add_row(std::move(row));
    return AddedRow(rows_.back());
  }

  // Sets defaults that depend on the service's limits.
  void set_initial(Form (*with_defaults)(const Limits&)) { initial_ = with_defaults; }
  // Sets the check that runs after an object was read, even if it has faults: faulty members then have their defaults.
  void check(void (*checks)(const JsonReader&, Form&, const ReadContext&)) { check_ = checks; }
  // Sets the conversion of a form without faults to a value. It returns empty, and reports, if there is no such value.
  void resolve(std::optional<Value> (*to_value)(const JsonReader&, const Form&, const ReadContext&)) {
    resolve_ = to_value;
  }
  // Sets the conversion of a value to the form in which it is written.
  void unresolve(Form (*form_of)(const Value&)) { form_of_ = form_of; }

  // Reads an object; returns empty if it has faults, which are reported.
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    const std::size_t before = in.faults();
    if (!check_names(in)) return std::nullopt;
    Form form = initial(context.limits);
    read_rows(in, &form, context);
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
      if (!form_of_) return write_rows(&value);
    }
    const Form form = form_of_(value);
    return write_rows(&form);
  }

 private:
  // Returns a form in which every field has its default.
  Form initial(const Limits& limits) const { return initial_ ? initial_(limits) : Form{}; }
  OrderedJson default_of(const MemberRow& row, const Limits& limits) const override {
    const Form form = initial(limits);
    return row.field->write(*row.kind, &form);
  }
  static Form& any_form() {
    static Form form{};
    return form;
  }

  Form (*initial_)(const Limits&) = nullptr;
  void (*check_)(const JsonReader&, Form&, const ReadContext&) = nullptr;
  std::optional<Value> (*resolve_)(const JsonReader&, const Form&, const ReadContext&) = nullptr;
  Form (*form_of_)(const Value&) = nullptr;
};

// Returns a table whose rows fill(members) has added. The table never moves, since its rows point to it.
template <typename M, typename Fill>
std::unique_ptr<const M> make_table(std::string_view name, std::string description, Fill&& fill) {
  auto members = std::make_unique<M>(name, std::move(description));
  fill(*members);
  return members;
}

}  // namespace selenograph::api
