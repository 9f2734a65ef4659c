#include "api/requests/parts/products_json.h"

#include <fmt/format.h>

namespace selenograph::api {

Products::Products(std::span<const ProductRow> table) : rows(table) {
  for (const ProductRow& row : rows) words.emplace_back(row.name, row.product);
}

std::optional<engine::ProductSet> Products::read(const JsonReader& in, const ReadContext&) const {
  const std::size_t before = in.faults();
  engine::ProductSet set = 0;
  in.elements(1, rows.size(), [&](const JsonReader& element) {
    const auto product = element.word(Words<engine::Product>(words));
    if (!product) return;
    if (set & *product) element.fail("is listed twice");
    set |= *product;
  });
  return in.faults() == before ? std::optional(set) : std::nullopt;
}

OrderedJson Products::write(engine::ProductSet set) const {
  OrderedJson names = OrderedJson::array();
  for (const ProductRow& row : rows)
    if (set & row.product) names.push_back(row.name);
  return names;
}

OrderedJson Products::schema(const Limits& limits) const {
  OrderedJson json = array_schema(Word<engine::Product>{words}.schema(limits), 1, rows.size());
  json["uniqueItems"] = true;
  std::string list;
  for (const ProductRow& row : rows) list += fmt::format("\n- `{}` {}: {}", row.name, type_text(row), row.meaning);
  json["description"] = list;
  return json;
}

void require_sun(const JsonReader& in, std::span<const ProductRow> rows, engine::ProductSet requested) {
  if (in.has("sun")) return;
  for (const ProductRow& row : rows) {
    if (!row.needs_sun || !(requested & row.product)) continue;
    in.fail("sun", fmt::format("is required for the product \"{}\"", row.name));
    return;
  }
}

OrderedJson sun_where_needed(std::span<const ProductRow> rows) {
  OrderedJson names = OrderedJson::array();
  for (const ProductRow& row : rows)
    if (!row.needs_sun) names.push_back(row.name);
  const OrderedJson sunless{{"required", {"products"}}, {"properties", {{"products", {{"items", {{"enum", names}}}}}}}};
  return {{"anyOf", OrderedJson::array({{{"required", {"sun"}}}, sunless})}};
}

}  // namespace selenograph::api
