// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/round_trip_json.h"

#include <algorithm>
#include <cmath>

#include "api/json/ranges.h"
#include "api/requests/parts/pose_json.h"
#include "api/schema/member_kinds.h"

namespace selenograph::api {
std::string_view mode_name(engine::RoundTripMode mode) { return word_of(kRoundTripModes, mode); }

std::int64_t max_posts(const Limits& limits) {
  return std::max(1, static_cast<int>(std::sqrt(static_cast<double>(limits.max_rays))));
}

int default_posts(const Limits& limits) { return static_cast<int>(std::min<std::int64_t>(256, max_posts(limits))); }

const Members<engine::RoundTripRequest>& round_trip_members() {
  using Trip = engine::RoundTripRequest;
  static const auto table = make_table<Members<Trip>>(
      "RoundTripRequest", "DEM round trip: frames of a tile are converted back to heights and compared with the file.",
      [](auto& m) {
        m.set_initial([](const Limits& limits) {
          Trip request;
          request.posts = default_posts(limits);
          return request;
        });
        m.add("center",
              Property{[](const Trip& r) {
                         return std::optional(Geographic{r.lat_deg, r.lon_deg, 0});
                       },
                       [](Trip& r, const Geographic& g) {
                         r.lat_deg = g.lat_deg;
                         r.lon_deg = g.lon_deg;
                       }},
              Object{place_members()}, "the finest tile that contains it is compared")
            .required();
        m.add("height_m", &Trip::height_m, Number{kStationHeight_m, "m"}, "height of the cameras above the ground");
        m.add("mode", &Trip::mode, Word{kRoundTripModes}, "exact: rays through the posts; camera: frames");
        m.add("posts", &Trip::posts, Integer{1, max_posts},
              "posts along each side of the window, which is moved inwards at the tile's border; fewer where the tile "
              "is smaller");
        m.add("footprint_ratio", &Trip::footprint_ratio, Number{kFootprintRatio},
              "pixel footprint over post spacing, mode camera");
        m.add("max_error_px", &Trip::max_error_px, Number{kMaxError_px, "px"},
              "level of detail of the frames, mode camera; 0: the finest posts");
      });
  return *table;
}

engine::RoundTripRequest read_round_trip(const Json& body, const Limits& limits) {
  return round_trip_members().read_body(body, {limits, Assets{}});
}

}  // namespace selenograph::api
