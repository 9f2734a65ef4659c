// Members common to requests for frames and maps: Sun, ground and detail. A query holds the engine's request, returned
// by `look()`, and data that the engine's request has no place for.
#pragma once

#include <optional>
#include <string>

#include "api/requests/parts/detail_json.h"
#include "api/requests/parts/indirect_json.h"
#include "api/requests/parts/sun_json.h"
#include "api/requests/parts/surface_json.h"

namespace selenograph::api {

struct SceneryQuery {
  std::string detail;  // name of the request's detail
  SurfaceQuery surface;
  bool sun_given = false;  // false: no product needs one; the engine's Sun is unused
  std::string sun_utc{};   // the epoch that the Sun was given by; empty: it was given otherwise
};

// Rows "detail" and "surface": the ground. Query: a SceneryQuery with look().
template <typename Query>
void add_ground(Members<Query>& m) {
  m.add("detail",
        Property{[](const Query& q) {
                   return q.look().detail ? std::optional(DetailName::Value{q.detail, q.look().detail}) : std::nullopt;
                 },
                 [](Query& q, const DetailName::Value& detail) {
                   q.look().detail = detail.content, q.detail = detail.name;
                 }},
        DetailName{}, kOfDetail)
      .written_if([](const Query& q) { return q.look().detail != nullptr; });
  m.add("surface",
        Property{[](const Query& q) { return std::optional(ground_of(q.look(), q.surface)); },
                 [](Query& q, const Ground& ground) { set_ground(q.look(), q.surface, ground); }},
        Object{ground_members()}, "reflectance and temperature of the ground");
}

// Rows "sun", "indirect", "detail" and "surface", in this order. Query: as above.
template <typename Query>
void add_scenery(Members<Query>& m) {
  m.add("sun",
        Property{[](const Query& q) { return q.sun_given ? std::optional(q.look().sun) : std::nullopt; },
                 [](Query& q, const engine::Sun& sun) { q.look().sun = sun, q.sun_given = true; }},
        Object{sun_members()}, "direction, distance and size of the Sun");
  m.add(
       "indirect", [](auto& q) -> auto& { return q.look().indirect; }, Object{indirect_members()},
       "light from surrounding terrain and from the Earth; left out: none")
      .written_if([](const Query& q) { return q.look().indirect.any(); });
  add_ground(m);
}

}  // namespace selenograph::api
