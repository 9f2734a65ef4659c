// "products" of frames and of maps, and whether they need a Sun.
#pragma once

#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "api/encode/arrays.h"
#include "api/schema/member_kinds.h"

namespace selenograph::api {

// Kind of the member "products": a list of names from a table of products, each at most once.
struct Products {
  using Value = engine::ProductSet;
  explicit Products(std::span<const ProductRow> table);
  std::span<const ProductRow> rows;
  std::vector<std::pair<std::string_view, engine::Product>> words;  // names of the rows
  std::optional<Value> read(const JsonReader& in, const ReadContext&) const;
  OrderedJson write(Value set) const;
  OrderedJson schema(const Limits& limits) const;
};

// Reports the first of the requested products that needs a Sun, if the request has none.
void require_sun(const JsonReader& in, std::span<const ProductRow> rows, engine::ProductSet requested);
// Returns the same rule as a schema condition: there is a "sun", or no product needs one.
OrderedJson sun_where_needed(std::span<const ProductRow> rows);

}  // namespace selenograph::api
