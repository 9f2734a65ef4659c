// "products": those of frames and those of maps, and the Sun that some of them need.
#pragma once

#include <span>

#include "api/encode/arrays.h"
#include "api/schema/member_kinds.h"

namespace selenograph::api {

// A list of names of these products, each at most once.
struct Products {
  using Value = engine::ProductSet;
  std::span<const ProductRow> rows;
  std::optional<Value> read(const JsonReader& in, const ReadContext&) const;
  OrderedJson write(Value set) const;
  OrderedJson schema(const Limits& limits) const;
};

// Reports the first of the wanted products that cannot be made without a Sun.
void require_sun(const JsonReader& in, std::span<const ProductRow> rows, engine::ProductSet wanted);
// The same as a condition of the schema: there is a "sun", or no product needs one.
OrderedJson sun_where_needed(std::span<const ProductRow> rows);

}  // namespace selenograph::api
