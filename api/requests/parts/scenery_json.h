// Members common to requests that light or show terrain: Sun, indirect light, ground and detail. A query holds the
// engine's request, whose scenery is returned by `scenery()`, and the names of assets, which the engine does not know.
#pragma once

#include <optional>
#include <string>

#include "api/requests/parts/detail_json.h"
#include "api/requests/parts/indirect_json.h"
#include "api/requests/parts/sun_json.h"
#include "api/requests/parts/surface_json.h"

namespace selenograph::api {

// Members of a query's scenery that the engine's request does not have.
struct SceneryQuery {
  std::string detail;  // name of the request's detail
  SurfaceQuery surface;
  bool sun_given = false;  // false: no product needs one; the engine's Sun is unused
  std::string sun_utc{};   // epoch of the Sun, UTC; empty: the Sun was not given by an epoch
};

// Adds the rows "detail" and "surface". Query is a SceneryQuery with scenery().
template <typename Query>
void add_ground(Members<Query>& m) {
  m.add("detail",
        Property{
            [](const Query& q) {
              return q.scenery().detail ? std::optional(DetailName::Value{q.detail, q.scenery().detail}) : std::nullopt;
            },
            [](Query& q, const DetailName::Value& detail) {
              q.scenery().detail = detail.content;
              q.detail = detail.name;
            }},
        DetailName{}, kDetailMeaning);
  m.add("surface",
        Property{[](const Query& q) { return std::optional(ground_of(q.scenery(), q.surface)); },
                 [](Query& q, const Ground& ground) { set_ground(q.scenery(), q.surface, ground); }},
        Object{ground_members()}, "reflectance and temperature of the ground");
}

// Adds the rows "sun", "indirect", "detail" and "surface", in this order. Query is a SceneryQuery with scenery().
template <typename Query>
void add_scenery(Members<Query>& m) {
  m.add("sun",
        Property{[](const Query& q) { return q.sun_given ? std::optional(q.scenery().sun) : std::nullopt; },
                 [](Query& q, const engine::Sun& sun) {
                   q.scenery().sun = sun;
                   q.sun_given = true;
                 }},
        Object{sun_members()}, "direction, distance and size of the Sun");
  m.add(
       "indirect", [](auto& q) -> auto& { return q.scenery().indirect; }, Object{indirect_members()},
       "light from surrounding terrain and from the Earth; left out: none")
      .written_if([](const Query& q) { return q.scenery().indirect.any(); });
  add_ground(m);
}

}  // namespace selenograph::api
