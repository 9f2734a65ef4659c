// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/frame_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "api/encode/arrays.h"
#include "api/json/ranges.h"
#include "api/message/json_text.h"
#include "api/requests/cameras.h"
#include "api/requests/parts/band_json.h"
#include "api/requests/parts/camera_preset.h"
#include "api/requests/parts/detail_json.h"
#include "api/requests/parts/products_json.h"
#include "api/requests/parts/sensor_json.h"
#include "api/requests/parts/shutter_json.h"
#include "api/requests/parts/sky_options_json.h"
#include "api/requests/parts/truth_json.h"
#include "dem/base/error.h"
#include "engine/frame/needs.h"

namespace selenograph::api {
namespace {

using engine::FrameRequest;

// --- objects within a frame's request

// "accuracy" as a client writes it: settings, or a time budget from which the endpoint chooses them.
struct AccuracyForm : engine::Accuracy {
  std::optional<double> budget_ms;
};

std::int64_t max_samples(const Limits& limits) { return limits.max_samples_per_pixel; }

const Members<AccuracyForm>& accuracy_members() {
  static const auto table = make_table<Members<AccuracyForm>>("Accuracy", "Accuracy against speed.", [](auto& m) {
    m.add("max_error_px", &AccuracyForm::max_error_px, Number{kMaxError_px, "px"},
          "upper bound on the mesh's projected error; 0: the finest posts everywhere");
    m.add("samples_per_pixel", &AccuracyForm::samples_per_pixel, Integer{1, max_samples},
          "number of samples that radiance and image are averaged over; a square number");
    m.add("max_shadow_error_px", &AccuracyForm::max_shadow_error_px, Number{{0, 1e6}, "px"},
          "limit on the displacement of shadow edges on level ground by the mesh's error, with detail by the error "
          "that 99 % of the ground is expected to stay below; it is relaxed when the terrain it needs does not fit "
          "into memory: `shadow_limit_px` is the value used, `shadow_error_px` bounds the displacement");
    m.add("max_detail_error_px", &AccuracyForm::max_detail_error_px, Number{{0, 1e6}, "px"},
          max_detail_error_meaning());
    m.add("budget_ms", &AccuracyForm::budget_ms, Number{above(0).to(3.6e6), "ms"},
          "replaces the other members: the most accurate setting predicted to take no longer, with terrain in memory. "
          "The request in the metadata has the chosen setting, the header Selenograph-Budget the prediction; an "
          "explicit request of that setting gives the same bytes");
    for (const char* chosen : {"max_error_px", "samples_per_pixel", "max_shadow_error_px", "max_detail_error_px"})
      m.excludes(chosen, {"budget_ms"}, "a budget chooses the accuracy");
    m.check([](const JsonReader& in, AccuracyForm& accuracy, const ReadContext&) {
      const int side = static_cast<int>(std::lround(std::sqrt(accuracy.samples_per_pixel)));
      if (side * side != accuracy.samples_per_pixel)
        in.fail("samples_per_pixel", "must be a square number: 1, 4, 9, 16, ...");
    });
  });
  return *table;
}

const Members<engine::ImageSettings>& image_members() {
  using engine::ImageSettings;
  static const auto table = make_table<Members<ImageSettings>>(
      "ImageSettings", "Conversion of radiance to digital numbers in the product `image`.", [](auto& m) {
        m.add("bit_depth", &ImageSettings::bit_depth, Choice{{8, 16}}, "bits of the digital numbers");
        m.add("full_scale_radiance", &ImageSettings::full_scale_radiance_w_m2_sr,
              NumberOr{above(0).to(1e12), "auto", "W m-2 sr-1"},
              "radiance of the largest digital number; auto: that which all but the brightest thousandth of the lit "
              "pixels have at most");
      });
  return *table;
}

const Members<engine::RimOptions>& craters_members() {
  using engine::RimOptions;
  static const auto table = make_table<Members<RimOptions>>(
      "CratersInFrame", "Selection of the craters of the request's detail that `craters` of the metadata lists.",
      [](auto& m) {
        m.add("smallest_px", &RimOptions::least_px, Number{{1, 1e4}, "px"},
              "minimum diameter in the image, of a circle with the area within the rim");
        m.add("min_depth_over_diameter", &RimOptions::least_depth, Number{kUnitInterval},
              "minimum `depth_over_diameter`; 0: all, down to those no longer recognisable as craters");
      });
  return *table;
}

struct AtmosphereForm {
  Named<engine::Atmosphere> table;
};

const Members<AtmosphereForm>& atmosphere_members() {
  static const auto table = make_table<Members<AtmosphereForm>>(
      "Atmosphere",
      "A table in the operator's assets folder: transmittance, irradiance and path radiance by wavelength, computed "
      "elsewhere. Needs a `band` within its wavelengths.",
      [](auto& m) {
        m.add("name", &AtmosphereForm::table, Asset{&Assets::atmosphere, "atmosphere", "atmospheres"},
              "name of atmospheres/NAME.csv")
            .required();
      });
  return *table;
}

// --- the frame

// Fields whose names are in the FrameQuery and whose contents are in the engine's request: the engine does not know the
// names by which clients refer to assets.
const auto atmosphere_field =
    Property{[](const FrameQuery& q) {
               return q.request.atmosphere ? std::optional(AtmosphereForm{{q.atmosphere_name, q.request.atmosphere}})
                                           : std::nullopt;
             },
             [](FrameQuery& q, const AtmosphereForm& form) {
               q.request.atmosphere = form.table.content;
               q.atmosphere_name = form.table.name;
             }};
const auto objects_field = Property{[](const FrameQuery& q) {
                                      std::vector<PlacedObject> list;
                                      for (std::size_t i = 0; i < q.objects.size(); ++i)
                                        list.push_back({q.request.objects[i], q.objects[i]});
                                      return list.empty() ? std::nullopt : std::optional(std::move(list));
                                    },
                                    [](FrameQuery& q, const std::vector<PlacedObject>& list) {
                                      for (const auto& [object, query] : list) {
                                        q.request.objects.push_back(object);
                                        q.objects.push_back(query);
                                      }
                                    }};
// Written without the budget: the resolved request has the settings chosen from it.
const auto accuracy_field = Property{[](const FrameQuery& q) {
                                       return std::optional(AccuracyForm{q.request.accuracy, std::nullopt});
                                     },
                                     [](FrameQuery& q, const AccuracyForm& form) {
                                       q.request.accuracy = form;
                                       q.budget_ms = form.budget_ms;
                                     }};
// "ahead" does not change the frame: it is left out of the resolved request, and so of the ETag.
constexpr std::size_t kMaxAhead = 64;
const auto ahead_field = Property{[](const FrameQuery&) { return std::optional<std::vector<engine::Pose>>(); },
                                  [](FrameQuery& q, const std::vector<engine::Pose>& poses) { q.ahead = poses; }};

// "cameras", for the API document only: split_cameras() removes it before a frame is read.
struct CamerasByName {
  using Value = std::monostate;
  std::optional<Value> read(const JsonReader& in, const ReadContext&) const {
    in.fail("is for requests of POST /v1/frames as a whole");
    return std::nullopt;
  }
  OrderedJson write(Value) const { return {}; }
  OrderedJson schema(const Limits&) const {
    return {{"type", "object"},
            {"minProperties", 1},
            {"maxProperties", kMaxCameras},
            {"propertyNames", {{"pattern", fmt::format("^[A-Za-z0-9_-]{{1,{}}}$", kMaxCameraNameLength)}}},
            {"additionalProperties", {{"type", "object"}}}};
  }
  OrderedJson fallback() const { return {}; }
};

// Returns the schema condition, relaxed for a request with "cameras": there each camera's request must satisfy it, not
// the request itself.
std::function<OrderedJson(const Limits&)> of_one_camera(OrderedJson (*condition)(const Limits&)) {
  return [condition](const Limits& limits) {
    const OrderedJson cameras{{"required", OrderedJson::array({"cameras"})}};
    return OrderedJson{{"anyOf", OrderedJson::array({condition(limits), cameras})}};
  };
}

// "echo": any object, held as compact JSON in ASCII so that it can be a header's value.
struct Echo {
  using Value = std::string;
  static constexpr std::size_t kMaxBytes = 1024;
  std::optional<Value> read(const JsonReader& in, const ReadContext&) const {
    if (!in.value().is_object()) {
      in.fail("must be an object");
      return std::nullopt;
    }
    Value text = json_ascii(in.value());
    if (text.size() <= kMaxBytes) return text;
    in.fail(fmt::format("has {} bytes as compact JSON in ASCII: at most {}", text.size(), kMaxBytes));
    return std::nullopt;
  }
  OrderedJson write(const Value&) const { return {}; }
  OrderedJson schema(const Limits&) const { return {{"type", "object"}}; }
  OrderedJson fallback() const { return {}; }
};

// Checks what a shutter cannot be combined with. With poses of rows, sets the request's pose to that of row 0.
void check_shutter(const JsonReader& in, FrameQuery& query) {
  engine::FrameRequest& request = query.request;
  check_pose(in, request.camera, request.shutter, request.pose);
  if (!request.shutter) return;
  if (request.visibility == engine::Visibility::zbuffer && request.shutter->pushbroom)
    in.fail("visibility",
            "a line camera's rows are rendered by \"raytrace\": \"zbuffer\" draws them for a rolling shutter");
  if (!request.shutter->poses.empty() && in.has("ahead"))
    in.fail("ahead", "would replace a \"pose\", which a shutter with poses has not");
}

// Checks what optical flow cannot be combined with.
void check_flow(const JsonReader& in, const engine::FrameRequest& request) {
  if (request.shutter && !request.shutter->poses.empty())
    in.fail("flow_to", "replaces a \"pose\", which a shutter with poses has not");
  if (request.visibility == engine::Visibility::zbuffer)
    in.fail("visibility", "flow is rendered by \"raytrace\": \"zbuffer\" sees from one place");
}

// Checks rules between members and completes the query. The order of the checks is that of the faults in the answer.
void check_frame(const JsonReader& in, FrameQuery& query, const ReadContext& context) {
  const engine::FrameRequest& request = query.request;
  query.sun_utc = context.sun_utc;
  if (in.has("camera")) check_rendered_size(in.at("camera"), request.camera, context.limits);
  check_shutter(in, query);
  resolve_preset(query.request, query.surface);
  if (query.request.truth) resolve_truth(in, request.camera, *query.request.truth);
  if (request.sensor) check_sensor(in, request);
  // Build the atmosphere's terms once, only to report a band that its table does not cover.
  if (request.atmosphere && request.band) {
    try {
      request.atmosphere->over(*request.band, 0);
    } catch (const ImpossibleRequest& e) {
      in.fail("atmosphere", e.what());
    }
  }
  if (!request.terrain && !in.has("objects"))
    in.fail("terrain", "without terrain and \"objects\" there is nothing to render");
  if (!request.terrain && request.visibility == engine::Visibility::zbuffer)
    in.fail("visibility", "\"zbuffer\" draws terrain, and there is none");
  // A fisheye images directions beyond 90 degrees from its boresight, which have no place on the z-buffer's plane.
  if (request.camera.beyond_plane() && request.visibility == engine::Visibility::zbuffer)
    in.fail("visibility", "a fisheye is rendered by \"raytrace\": \"zbuffer\" draws onto a plane");
  if (request.products & engine::kFlow && !in.has("flow_to"))
    in.fail("flow_to", "is required for the product \"flow\"");
  if (engine::wants_flow(request)) check_flow(in, request);
  for (const auto& [name, requested] : {std::pair("craters", request.craters.has_value()), {"labels", query.labels}}) {
    if (!requested || !in.has(name)) continue;
    if (!in.has("detail")) in.fail(name, "requires \"detail\": the craters are its");
    if (!request.terrain) in.fail(name, "craters are terrain's, and \"terrain\" is false");
  }
  // Labels need the pixels of rocks, and craters by the defaults unless "craters" selects them.
  if (query.labels) {
    query.request.products |= engine::kRock;
    if (!request.craters) query.request.craters.emplace();
  }
  require_sun(in, products(), request.products);
  if (request.sky && in.faults() == 0)
    query.icrf_lag_s = icrf_lag_s(in, request.camera, request.shutter, context.sun_utc, request.sky->utc);
}

// Returns the rule that "craters" and "labels" require "detail", as a schema condition.
OrderedJson craters_condition(const Limits&) {
  const OrderedJson without_craters{{"properties", {{"craters", {{"const", false}}}, {"labels", {{"const", false}}}}}};
  return {{"anyOf", OrderedJson::array({without_craters, {{"required", {"detail"}}}})}};
}

// Returns the rule that the product "flow" requires "flow_to", as a schema condition.
OrderedJson flow_condition(const Limits&) {
  const OrderedJson without_flow{{"properties", {{"products", {{"not", {{"contains", {{"const", "flow"}}}}}}}}}};
  return {{"anyOf", OrderedJson::array({without_flow, {{"required", {"flow_to"}}}})}};
}

bool has_image_by_sensor(const FrameQuery& q) { return q.request.products & engine::kImage && q.request.sensor; }
bool has_image_without_sensor(const FrameQuery& q) { return q.request.products & engine::kImage && !q.request.sensor; }

// Add the rows of a frame's request. Their order is that of the resolved request, whose text the ETag is made
// from: a row that moves changes every ETag.
void add_scene(Members<FrameQuery>& m) {
  add_camera_and_pose(m).written_if(
      [](const FrameQuery& q) { return !q.request.shutter || q.request.shutter->poses.empty(); });
  m.add("shutter", nested(&FrameQuery::request, &FrameRequest::shutter), Object{shutter_members()},
        "times of the rows: a rolling shutter or a line camera; left out: all rows are exposed at once");
  add_scenery(m);
  m.add("band", nested(&FrameQuery::request, &FrameRequest::band), Object{band_members()},
        "spectral channel; left out: all wavelengths");
  m.add("sky", nested(&FrameQuery::request, &FrameRequest::sky), Object{sky_members()},
        "stars, Sun, Earth and planets in view; left out: a black sky");
  m.add("atmosphere", atmosphere_field, Object{atmosphere_members()}, "left out: none");
  m.add("objects", objects_field, List{Object{object_members()}, 1, kMaxObjects},
        "triangle meshes besides the terrain; `object_id` holds indices into this list");
  m.add("terrain", nested(&FrameQuery::request, &FrameRequest::terrain), Flag{},
        "false: objects only, without the Moon")
      .written_if([](const FrameQuery& q) { return !q.request.terrain; });
}

void add_rendering(Members<FrameQuery>& m) {
  m.add("visibility", nested(&FrameQuery::request, &FrameRequest::visibility), Word{kVisibilities},
        "visibility algorithm: zbuffer (z-buffer and irregular shadow map, several times as fast except for tiny "
        "images), raytrace, or auto, the faster of the two, chosen from the request and the terrain alone. Both are "
        "exact for a point Sun; for its disc they are a few hundredths off at worst (engine/verify/errors.md). The "
        "metadata names the one used");
  m.add("accuracy", accuracy_field, Object{accuracy_members()}, "level of detail and samples");
  m.add("sensor", nested(&FrameQuery::request, &FrameRequest::sensor), Object{sensor_members()},
        "sensor model that produces `image`")
      .written_if(has_image_by_sensor);
  m.add("image", nested(&FrameQuery::request, &FrameRequest::image), Object{image_members()},
        "produces `image` without a sensor model")
      .written_if(has_image_without_sensor);
  m.add("camera_preset", no_field<FrameQuery, std::string>(), Text{},
        std::string(kCameraPresetMeaning) + ". The request in the metadata shows the result");
  m.add("products", nested(&FrameQuery::request, &FrameRequest::products), Products{products()},
        "what to render: arrays of height x width, row 0 on top");
  m.add("flow_to", nested(&FrameQuery::request, &FrameRequest::flow_to), Object{pose_members()},
        "camera pose of the other image of the product `flow`, e.g. the next frame's; the scene is static. Frames with "
        "it are ray traced")
      .written_if([](const FrameQuery& q) { return engine::wants_flow(q.request); });
  m.add(
      "craters", nested(&FrameQuery::request, &FrameRequest::craters), FlagOrObject{craters_members()},
      "lists the craters of `detail` that the frame shows, with their rims in the image, as `craters` of the metadata; "
      "changes no pixel. true: with all defaults; left out or false: no list");
  m.add("labels", &FrameQuery::labels, Flag{},
        "training labels for the whole image, in an .npz: arrays `crater_mask` and `rock_mask` (uint16: a "
        "`mask_id`, 0 without one; where craters overlap, the smallest). `craters` and `labelled_rocks` of the "
        "metadata say which crater or rock has it. `craters` selects the craters; rocks are labelled if they cover as "
        "many pixels as a circle of `smallest_px`")
      .written_if([](const FrameQuery& q) { return q.labels; });
  m.add("truth", nested(&FrameQuery::request, &FrameRequest::truth), Object{truth_members()},
        "subset of pixels for ground truth; left out: every pixel of every product, positions as float64")
      .written_if([](const FrameQuery& q) { return q.request.truth && q.request.products & engine::kTruth; });
  m.add("ahead", ahead_field, List{Object{pose_members()}, 1, kMaxAhead},
        "expected poses of this camera's next frames, soonest first: their scenes are prepared while no request is in "
        "work, for 20 s of processor time and in half of --scene-mb at most. The Sun's motion is "
        "extrapolated. Changes no byte of any answer");
  m.add("echo", &FrameQuery::echo, Echo{},
        "any object of at most 1024 bytes (a time tag, the frame's number, the camera's name): returned unchanged in "
        "the header Selenograph-Echo. Changes no byte of any answer");
  m.add("compression", &FrameQuery::compression, Word{kCompressions},
        "compression of an .npz: deflate is smaller but slower; PNG is always compressed, TIFF and OpenEXR never")
      .written_if([](const FrameQuery& q) { return q.compression != Compression::none; });
  m.add("cameras", no_field<FrameQuery, std::monostate>(), CamerasByName{},
        "several cameras at one instant, by name: each is an object of members of this table, which replace the "
        "request's own. The answer is one .npz with arrays NAME/PRODUCT, and its meta.json has the metadata of each "
        "camera; only the request itself can have `echo`");
}

}  // namespace

std::string_view visibility_name(engine::Visibility visibility) { return word_of(kVisibilities, visibility); }

const Members<FrameQuery>& frame_members() {
  static const auto table = make_table<Members<FrameQuery>>(
      "FrameRequest",
      "A frame to render. Unknown members are errors. `sun` is required for image, radiance, angles, lit, irradiance.",
      [](auto& m) {
        add_scene(m);
        add_rendering(m);
        m.any_of({"camera", "camera_preset", "cameras"});
        m.excludes("sensor", {"image"}, "that is exposure without a sensor");
        m.needs("sensor", {"band", "camera_preset"}, "which photons it counts");
        m.needs("atmosphere", {"band", "camera_preset"});
        m.excludes("sky", {"atmosphere"}, "whose table says nothing of light from beyond");
        m.check(check_frame);
        m.add_condition(rendered_size_condition);
        m.add_condition(of_one_camera(pose_condition));
        m.add_condition(of_one_camera(craters_condition));
        m.add_condition(of_one_camera(flow_condition));
        m.add_condition(of_one_camera([](const Limits&) { return sun_where_needed(products()); }));
      });
  return *table;
}

FrameQuery read_frame(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop,
                      const GroundHeights& ground) {
  ReadContext context{limits, assets, stop, utc_of_sun(body)};
  if (const auto merged = with_camera_preset(body, context)) return read_frame(*merged, limits, assets, stop, ground);
  context.ground_height = ground_height_of(body, ground, context);
  return frame_members().read_body(body, context);
}

OrderedJson resolved_json(const FrameQuery& query) { return frame_members().write(query); }

}  // namespace selenograph::api
