// Tables of an answer's members (api/schema/answers.h). A row is a.add(name in JSON, JSON Schema, function that returns
// the value, condition); a member without a condition is always written.
#include "api/answers/points_answer.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "api/encode/columns.h"
#include "api/json/ranges.h"
#include "api/message/json_text.h"
#include "api/requests/features_json.h"

namespace selenograph::api {
namespace {

// Reasons why a landmark has no value. Arrays hold the number, JSON the text.
enum class Reason : std::uint8_t { none, no_dataset, no_post, behind_camera, beyond_lens, no_row };
constexpr const char* kReasons[] = {"",
                                    "no dataset covers this place",
                                    "the datasets here have no valid post",
                                    "behind the camera",
                                    "beyond the lens's field of view",
                                    "seen by no row"};
const char* text_of(Reason reason) { return kReasons[static_cast<std::size_t>(reason)]; }

// Returns why a place has no height: no tile covers it, or no post of the tiles there is valid.
Reason why_no_height(double lat_deg, double lon_deg, const dem::Catalogue& catalogue) {
  return catalogue.touching(lat_deg, lat_deg, lon_deg, lon_deg).empty() ? Reason::no_dataset : Reason::no_post;
}

// Returns why a landmark has no height or no position in the image; `none` if it has both.
Reason reason_of(const LandmarkSource& s) {
  if (!std::isfinite(s.landmark.height_m)) return why_no_height(s.point.lat_deg, s.point.lon_deg, s.catalogue);
  if (std::isfinite(s.landmark.x_px)) return Reason::none;
  if (s.query.shutter) return Reason::no_row;
  return s.landmark.behind_camera ? Reason::behind_camera : Reason::beyond_lens;
}

// Returns the function that reads a field of the landmark.
template <typename Field>
auto landmark(Field field) {
  return [field](const LandmarkSource& s) { return s.landmark.*field; };
}

void add_lit(auto& a, auto lit, auto sun_given) {
  a.add("lit", schema::number_or_null("lit fraction, when a Sun was given"), lit, sun_given);
}

template <typename Source>
void add_irradiance(Answer<Source>& a) {
  a.add(
      "irradiance",
      schema::vector("W m-2, with `indirect`, on terrain, on its own slope: from the Sun directly, from terrain, from "
                     "the Earth"),
      [](const Source& s) { return Vec3(s.light->direct_w_m2, s.light->terrain_w_m2, s.light->earth_w_m2); },
      [](const Source& s) { return s.light.has_value(); });
}

}  // namespace

const Answer<HitSource>& hit_answer() {
  using S = HitSource;
  using namespace schema;
  static const auto answer = make_answer<S>("hit alone where nothing is hit", [](auto& a) {
    const auto hit = [](const S& s) { return s.hit.hit; };
    a.add("hit", boolean("whether anything was hit; also false for a ray that begins below the ground"), hit);
    a.add(
        "range_m", number_or_null("from the origin, m"), [](const S& s) { return s.hit.range_m; }, hit);
    a.add(
        "position_m", schema::vector("MOON_ME, m"), [](const S& s) { return s.hit.position_m; }, hit);
    a.add(
        "normal", schema::vector("outward unit normal, MOON_ME"), [](const S& s) { return s.hit.normal; }, hit);
    a.add(
        "object", number_or_null("index into the request's objects, if it has some; null: terrain"),
        [](const S& s) { return s.hit.object; }, [](const S& s) { return s.hit.hit && !s.query.objects.empty(); });
    a.add(
        "rock", text("its id in POST /v1/features, if it is one of the detail's rocks"),
        [](const S& s) { return id_text(*s.hit.rock); }, [](const S& s) { return s.hit.hit && s.hit.rock; });
    add_lit(
        a, [](const S& s) { return s.hit.lit; }, [](const S& s) { return s.hit.hit && s.query.sun_given; });
    add_irradiance(a);
  });
  return answer;
}

OrderedJson with_map_error(OrderedJson answer, const std::optional<MapErrorQuery>& map_error) {
  if (map_error) answer["map_error"] = map_error_metadata(*map_error);
  return answer;
}

OrderedJson rays_json(std::span<const engine::RayHit> hits, std::span<const LightOfPoint> light,
                      const RaysQuery& query) {
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < hits.size(); ++i) list.push_back(hit_answer().write({hits[i], light[i], query}));
  return with_map_error({{"rays", std::move(list)}}, query.map_error);
}

namespace {

// Returns the shape of the request's arrays; without arrays that of a list.
template <typename Query>
std::vector<std::size_t> shape_of(const Query& query, std::size_t count) {
  return query.shape.empty() ? std::vector<std::size_t>{count} : query.shape;
}

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

void add_irradiances(ColumnArrays& arrays, std::span<const LightOfPoint> light) {
  arrays.add("irradiance", light, [](const LightOfPoint& light_of_point) -> Vec3 {
    if (!light_of_point) return Vec3::constant(kMissing);
    return {light_of_point->direct_w_m2, light_of_point->terrain_w_m2, light_of_point->earth_w_m2};
  });
}

}  // namespace

std::string rays_npz(std::span<const engine::RayHit> hits, std::span<const LightOfPoint> light, const RaysQuery& query,
                     const StopToken& stop) {
  using engine::RayHit;
  ColumnArrays arrays(shape_of(query, hits.size()), ElementType::boolean, stop);
  const auto add_vector = [&](const char* name, Vec3 RayHit::*member) {
    arrays.add(name, hits, [&](const RayHit& h) -> Vec3 { return h.hit ? h.*member : Vec3::constant(kMissing); });
  };
  arrays.add("hit", hits, &RayHit::hit);
  arrays.add("range_m", hits, [](const RayHit& h) { return h.hit ? h.range_m : kMissing; });
  add_vector("position_m", &RayHit::position_m);
  add_vector("normal", &RayHit::normal);
  arrays.add("rock", hits, [](const RayHit& h) { return h.rock.value_or(0); });
  if (!query.objects.empty())
    arrays.add("object", hits, [](const RayHit& h) { return h.object.value_or(std::uint16_t{65535}); });
  if (query.sun_given) arrays.add("lit", hits, [](const RayHit& h) { return h.hit ? h.lit : kMissing; });
  if (query.request.indirect.any()) add_irradiances(arrays, light);
  return arrays.npz(json_text(with_map_error(OrderedJson::object(), query.map_error)));
}

const Answer<LandmarkSource>& landmark_answer() {
  using S = LandmarkSource;
  using engine::Landmark;
  using namespace schema;
  static const auto answer = make_answer<S>("", [](auto& a) {
    a.add("x_px", number_or_null("column; null behind the camera and beyond the lens's field of view"),
          landmark(&Landmark::x_px));
    a.add("y_px",
          number_or_null("row; null as x_px is. With a shutter both, and range_m, are null where no row sees the "
                         "point; where several do, one of its positions is given, in the image if there is one"),
          landmark(&Landmark::y_px));
    a.add("range_m", number_or_null("from the camera, m"), landmark(&Landmark::range_m));
    a.add("height_m", number_or_null("that was used; null without data"), landmark(&Landmark::height_m));
    a.add("in_frame", boolean("in front of the camera and within the image"), landmark(&Landmark::in_frame));
    a.add("visible",
          boolean("in_frame and not hidden by the finest terrain. Points of a frame's `geodetic` lie on its coarser "
                  "surface, which may be below it: leave out their height_m, or request the frame with a smaller "
                  "accuracy.max_error_px"),
          landmark(&Landmark::visible));
    a.add("time_s",
          number_or_null("with a shutter: when the row that sees it is exposed, line_time_s * y_px; null where none "
                         "does"),
          landmark(&Landmark::time_s), [](const S& s) { return s.query.shutter.has_value(); });
    add_lit(a, landmark(&Landmark::lit), [](const S& s) { return s.query.sun_given; });
    add_irradiance(a);
    a.add(
        "reason",
        text("why a value is null: no data there; behind the camera; beyond the lens's field of view, where its "
             "distortion folds and at 179 degrees from a fisheye's boresight; seen by no row"),
        [](const S& s) { return text_of(reason_of(s)); }, [](const S& s) { return reason_of(s) != Reason::none; });
  });
  return answer;
}

OrderedJson landmarks_json(std::span<const engine::Landmark> landmarks, std::span<const LightOfPoint> light,
                           const ProjectQuery& query, const dem::Catalogue& catalogue) {
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < landmarks.size(); ++i)
    list.push_back(landmark_answer().write({landmarks[i], light[i], query.points[i], query, catalogue}));
  return {{"points", std::move(list)}};
}

std::string landmarks_npz(std::span<const engine::Landmark> landmarks, std::span<const LightOfPoint> light,
                          const ProjectQuery& query, const dem::Catalogue& catalogue, const StopToken& stop) {
  using engine::Landmark;
  ColumnArrays arrays(shape_of(query, landmarks.size()), ElementType::boolean, stop);
  arrays.add("x_px", landmarks, &Landmark::x_px);
  arrays.add("y_px", landmarks, &Landmark::y_px);
  arrays.add("range_m", landmarks, &Landmark::range_m);
  arrays.add("height_m", landmarks, &Landmark::height_m);
  arrays.add("in_frame", landmarks, &Landmark::in_frame);
  arrays.add("visible", landmarks, &Landmark::visible);
  if (query.shutter) arrays.add("time_s", landmarks, &Landmark::time_s);
  if (query.sun_given) arrays.add("lit", landmarks, &Landmark::lit);
  if (query.request.indirect.any()) add_irradiances(arrays, light);
  arrays.add("reason", landmarks, [&](const Landmark& landmark) {
    const auto i = static_cast<std::size_t>(&landmark - landmarks.data());
    return static_cast<std::uint8_t>(reason_of({landmark, light[i], query.points[i], query, catalogue}));
  });
  return arrays.npz("{}");
}

bool HeightSource::has_height() const { return std::isfinite(height.height_m) && height.source >= 0; }

const Answer<HeightSource>& height_answer() {
  using S = HeightSource;
  using namespace schema;
  static const auto answer = make_answer<S>("Terrain at a point, on the finest surface.", [](auto& a) {
    const auto has_height = [](const S& s) { return s.has_height(); };
    a.add("lat_deg", number(kLatitude_deg, "as asked"), [](const S& s) { return s.height.lat_deg; });
    a.add("lon_deg", number(from(-180).below(180), "as asked, in [-180, 180)"),
          [](const S& s) { return wrap_lon_deg(s.height.lon_deg); });
    a.add("height_m", number_or_null("above the sphere of 1 737 400 m; null without data"),
          [](const S& s) { return s.has_height() ? std::optional(s.height.height_m) : std::nullopt; });
    a.add(
        "post_spacing_m", number_or_null("of the tile"), [](const S& s) { return s.height.post_spacing_m; },
        has_height);
    a.add(
        "source", text("tile name"),
        [](const S& s) { return s.catalogue.rasters().at(static_cast<std::size_t>(s.height.source)).name; },
        has_height);
    a.add(
        "filled", boolean("interpolated across a void"), [](const S& s) { return s.height.filled; }, has_height);
    a.add(
        "blended", boolean("heights were shifted here to meet a finer layer"),
        [](const S& s) { return s.height.blended; }, has_height);
    a.add(
        "reason", text("why height_m is null"),
        [](const S& s) { return text_of(why_no_height(s.height.lat_deg, s.height.lon_deg, s.catalogue)); },
        [](const S& s) { return !s.has_height(); });
  });
  return answer;
}

}  // namespace selenograph::api
