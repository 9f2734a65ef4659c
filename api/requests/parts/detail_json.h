// Terrain detail: the operator's presets, and the member that names one.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "api/schema/member_kinds.h"
#include "dem/detail/detail.h"

namespace selenograph::api {

// Kind of the member "detail": the name of a preset, or null for none.
struct DetailName {
  using Value = Named<dem::Detail>;
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const;
  OrderedJson write(const Value& value) const;
  OrderedJson schema(const Limits&) const { return {{"oneOf", {{{"type", "string"}}, {{"type", "null"}}}}}; }
  OrderedJson fallback() const { return {}; }
};

// Returns the terrain's height above the sphere, with a detail or (null) without; m, NaN without data.
using GroundHeights =
    std::function<double(const std::shared_ptr<const dem::Detail>& detail, double lat_deg, double lon_deg)>;
// Returns the heights of the ground that a request's body asks for by "detail", for ReadContext. The detail is read
// when a height is needed, which most requests never do. An invalid detail is taken as none: its own member reports it.
// The arguments must outlive the result.
GroundHeight ground_height_of(const Json& body, const GroundHeights& ground, const ReadContext& context);

inline constexpr const char* kDetailMeaning =
    "ground finer than the posts: name of details/NAME.json in the operator's assets folder; null or left "
    "out: none";

// Returns the description of Accuracy::max_detail_error_px.
std::string max_detail_error_meaning();

// Returns the metadata of a detail, which always declare that its terrain is synthetic.
OrderedJson detail_metadata(const std::string& name, const dem::Detail& detail);

// Adds a warning to an answer for which rocks were requested of a detail without rocks.
void warn_of_no_rocks(const dem::Detail& detail, OrderedJson& warnings);

}  // namespace selenograph::api
