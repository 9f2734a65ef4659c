// Errors of a lander's map: the member "map_error", and the operator's presets of published products.
#pragma once

#include <optional>
#include <string>

#include "api/schema/member_kinds.h"
#include "dem/map_error/map_error.h"

namespace selenograph::api {

// A resolved "map_error".
struct MapErrorQuery {
  dem::MapError error;
  std::string preset{};   // name of map_errors/NAME.json; empty: none
  OrderedJson sources{};  // where the preset's figures were published, by member; null: not stated

  // Returns the error of a query's map; empty without "map_error".
  static std::optional<dem::MapError> of(const std::optional<MapErrorQuery>& query) {
    return query ? std::optional(query->error) : std::nullopt;
  }
};

const Members<MapErrorQuery>& map_error_members();

// Kind of the member "map_error": an object whose members override those of its preset.
struct MapErrorObject {
  using Value = MapErrorQuery;
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const;
  OrderedJson write(const Value& value) const { return map_error_members().write(value); }
  OrderedJson schema(const Limits&) const { return reference_to(map_error_members()); }
  std::vector<const MemberTable*> objects() const { return {&map_error_members()}; }
};

// Adds the row "map_error". Query has a std::optional<MapErrorQuery> of that name.
template <typename Query>
void add_map_error(Members<Query>& m) {
  m.add("map_error", &Query::map_error, MapErrorObject{},
        "answers from the map that a lander would carry, which differs from the terrain as stated here; left out: from "
        "the terrain itself");
}

// Returns the metadata of a map's error: the resolved members, and what the preset says about their sources.
OrderedJson map_error_metadata(const MapErrorQuery& query);

// Adds warnings about members of a map's error that change nothing. `has_detail`: the map has made ground.
void warn_of_map_error(const MapErrorQuery& query, bool has_detail, OrderedJson& warnings);

}  // namespace selenograph::api
