// The shapes of what comes in and goes out, as JSON Schema. Numbers' ranges are the parser's own objects.
#include "api/arrays.h"
#include "api/frame_json.h"
#include "api/mertis_json.h"
#include "api/metadata.h"
#include "api/openapi.h"
#include "api/ranges.h"
#include "api/round_trip_json.h"
#include "api/sensor_json.h"
#include "api/surface_json.h"
#include "engine/radiometry/brdf.h"

namespace selenograph::api {
namespace {

using OrderedJson = nlohmann::ordered_json;

OrderedJson ref(const std::string& name) { return {{"$ref", "#/components/schemas/" + name}}; }

OrderedJson number(const Range& range, const char* description) {
  OrderedJson json{{"type", "number"}, {"description", description}};
  if (range.min > kAnyNumber.min) json[range.min_open ? "exclusiveMinimum" : "minimum"] = range.min;
  if (range.max < kAnyNumber.max) json[range.max_open ? "exclusiveMaximum" : "maximum"] = range.max;
  return json;
}

OrderedJson number(const Range& range, const char* description, double fallback) {
  OrderedJson json = number(range, description);
  json["default"] = fallback;
  return json;
}

OrderedJson number_or_null(const char* description) {
  return {{"type", {"number", "null"}}, {"description", description}};
}

OrderedJson integer(std::int64_t min, std::int64_t max, const char* description) {
  return {{"type", "integer"}, {"minimum", min}, {"maximum", max}, {"description", description}};
}

OrderedJson boolean(const char* description) { return {{"type", "boolean"}, {"description", description}}; }

OrderedJson text(const char* description) { return {{"type", "string"}, {"description", description}}; }

OrderedJson vector(const char* description, const Range& range = kAnyNumber) {
  OrderedJson element = number(range, "");
  element.erase("description");
  return {{"type", "array"}, {"minItems", 3}, {"maxItems", 3}, {"items", element}, {"description", description}};
}

template <typename Table>
OrderedJson words(const Table& table, const char* description) {
  OrderedJson json{{"type", "string"}, {"enum", OrderedJson::array()}, {"description", description}};
  for (const auto& [name, meaning] : table) json["enum"].push_back(name);
  return json;
}

OrderedJson list(const OrderedJson& items, std::size_t most, const char* description) {
  return {{"type", "array"}, {"minItems", 1}, {"maxItems", most}, {"items", items}, {"description", description}};
}

// An object of the request: unknown members are errors.
OrderedJson closed(const char* description, OrderedJson properties, const std::vector<const char*>& required = {}) {
  OrderedJson json{{"type", "object"}, {"description", description}, {"additionalProperties", false}};
  json["properties"] = std::move(properties);
  if (!required.empty()) json["required"] = required;
  return json;
}

// An object of an answer: later versions may say more.
OrderedJson open(const char* description, OrderedJson properties, const std::vector<const char*>& required) {
  OrderedJson json = closed(description, std::move(properties), required);
  json.erase("additionalProperties");
  return json;
}

OrderedJson exactly_one(std::initializer_list<const char*> names) {
  OrderedJson choices = OrderedJson::array();
  for (const char* name : names) choices.push_back({{"required", {name}}});
  return {{"oneOf", choices}};
}

OrderedJson none_of(std::initializer_list<const char*> names) {
  OrderedJson choices = OrderedJson::array();
  for (const char* name : names) choices.push_back({{"required", {name}}});
  return {{"not", {{"anyOf", choices}}}};
}

OrderedJson with(OrderedJson json, const char* key, OrderedJson value) {
  json[key] = std::move(value);
  return json;
}

OrderedJson products_schema() {
  OrderedJson names = OrderedJson::array();
  std::string description = "What to render: arrays of height x width, row 0 on top.\n";
  for (const ProductRow& row : products()) {
    names.push_back(row.name);
    description += "\n- `" + std::string(row.name) + "` " + type_text(row) + ": " + std::string(row.meaning);
  }
  return {{"type", "array"},         {"items", {{"type", "string"}, {"enum", names}}},
          {"minItems", 1},           {"uniqueItems", true},
          {"default", {"radiance"}}, {"description", description}};
}

// Without a Sun only products that need none.
OrderedJson sun_where_needed() {
  OrderedJson names = OrderedJson::array();
  for (const ProductRow& row : products()) {
    if (!row.needs_sun) names.push_back(row.name);
  }
  const OrderedJson sunless{{"required", {"products"}}, {"properties", {{"products", {{"items", {{"enum", names}}}}}}}};
  return OrderedJson::array({{{"required", {"sun"}}}, sunless});
}

void add_camera(OrderedJson& schemas, const Limits& limits) {
  schemas["Distortion"] = closed(
      "Brown-Conrady, OpenCV's coefficients, on the plane z = 1: x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 "
      "(r^2 + "
      "2 x^2), and y' alike.",
      {{"model", {{"type", "string"}, {"const", "brown_conrady"}}},
       {"k1", number(kDistortion, "radial, r^2", 0)},
       {"k2", number(kDistortion, "radial, r^4", 0)},
       {"k3", number(kDistortion, "radial, r^6", 0)},
       {"p1", number(kDistortion, "tangential", 0)},
       {"p2", number(kDistortion, "tangential", 0)}});
  OrderedJson camera = closed(
      "A pinhole. `fov_deg` excludes `fx`, `fy`, `cx`, `cy`. The centre of the top-left pixel is (0, 0). width x "
      "height is "
      "limited, too.",
      {{"model", {{"type", "string"}, {"const", "pinhole"}}},
       {"width", integer(1, limits.max_image_side, "pixels")},
       {"height", integer(1, limits.max_image_side, "pixels")},
       {"fov_deg", number(kFieldOfView_deg,
                          "horizontal, full angle: fx = fy = (width/2) / tan(fov/2), principal point in the middle")},
       {"fx", number(kFocalLength_px, "focal length, pixels")},
       {"fy", number(kFocalLength_px, "focal length, pixels; default: fx")},
       {"cx", number(kPrincipalPoint_px, "principal point, pixels; default: (width-1)/2")},
       {"cy", number(kPrincipalPoint_px, "principal point, pixels; default: (height-1)/2")},
       {"distortion", ref("Distortion")}},
      {"width", "height"});
  camera["oneOf"] = exactly_one({"fov_deg", "fx"})["oneOf"];
  camera["dependentSchemas"] = {{"fov_deg", none_of({"fx", "fy", "cx", "cy"})}};
  schemas["Camera"] = camera;
}

void add_places(OrderedJson& schemas) {
  schemas["Place"] =
      closed("A place on the Moon, MOON_ME, planetocentric latitude, longitude east-positive.",
             {{"lat_deg", number(kLatitude_deg, "degrees")}, {"lon_deg", number(kLongitude_deg, "degrees")}},
             {"lat_deg", "lon_deg"});
  schemas["Geodetic"] = closed("A place and its height above the sphere of 1 737 400 m, MOON_ME.",
                               {{"lat_deg", number(kLatitude_deg, "degrees")},
                                {"lon_deg", number(kLongitude_deg, "degrees")},
                                {"height_m", number(kHeight_m, "m")}},
                               {"lat_deg", "lon_deg", "height_m"});
  schemas["Quaternion"] = closed("A unit quaternion (its length within 0.001 of 1; it is normalised).",
                                 {{"w", number(kAnyNumber, "scalar part")},
                                  {"x", number(kAnyNumber, "")},
                                  {"y", number(kAnyNumber, "")},
                                  {"z", number(kAnyNumber, "")}},
                                 {"w", "x", "y", "z"});
}

OrderedJson look_at_schema() {
  const OrderedJson up{
      {"oneOf", {{{"type", "string"}, {"const", "north"}}, vector("a MOON_ME vector")}},
      {"default", "north"},
      {"description",
       "What is up in the image: the Moon's north (looking straight down: local north), or a MOON_ME vector"}};
  return closed("Boresight through a place, which then appears at (cx, cy). MOON_ME whatever `frame` says.",
                {{"lat_deg", number(kLatitude_deg, "degrees")},
                 {"lon_deg", number(kLongitude_deg, "degrees")},
                 {"height_m", number(kHeight_m, "above the sphere of 1 737 400 m, m", 0)},
                 {"up", up}},
                {"lat_deg", "lon_deg"});
}

void add_pose(OrderedJson& schemas) {
  OrderedJson pose = closed(
      "Where the camera is (`position_m` or `geodetic`) and how it is turned (one of `camera_from_moon`, "
      "`moon_from_camera`, "
      "`look_at`, `nadir`). `frame` applies to `position_m` and the quaternions; places in latitude and longitude, and "
      "`look_at.up`, are MOON_ME always, so `geodetic` excludes the other frames. PA and ME differ by about 860 m.",
      {{"frame", with(words(kBodyFrames, "body frame of position_m and of the quaternions"), "default", "MOON_ME")},
       {"position_m", vector("Cartesian, m", kCoordinate_m)},
       {"geodetic", ref("Geodetic")},
       {"camera_from_moon", ref("Quaternion")},
       {"moon_from_camera", ref("Quaternion")},
       {"look_at", look_at_schema()},
       {"nadir",
        closed("Boresight to the Moon's centre.",
               {{"up_azimuth_deg",
                 number(kAzimuth_deg, "compass azimuth, clockwise from north, of the image's up direction (-y)", 0)}})},
       {"axes",
        with(words(kCameraAxes,
                   "camera axes of the quaternions: opencv +x right, +y down, +z boresight; opengl +x right, +y up, -z "
                   "boresight. Without meaning for look_at and nadir"),
             "default", "opencv")}});
  pose["allOf"] = {exactly_one({"position_m", "geodetic"}),
                   exactly_one({"camera_from_moon", "moon_from_camera", "look_at", "nadir"})};
  schemas["Pose"] = pose;
}

void add_sun(OrderedJson& schemas) {
  OrderedJson sun = closed(
      "Exactly one of direction, subsolar, local, utc. Always MOON_ME.",
      {{"direction", vector("toward the Sun; any length but zero")},
       {"subsolar", ref("Place")},
       {"local", closed("as seen from a place on the sphere of 1 737 400 m",
                        {{"lat_deg", number(kLatitude_deg, "degrees")},
                         {"lon_deg", number(kLongitude_deg, "degrees")},
                         {"azimuth_deg", number(kAzimuth_deg, "clockwise from north")},
                         {"elevation_deg", number(kElevation_deg, "above the local horizontal")}},
                        {"lat_deg", "lon_deg", "azimuth_deg", "elevation_deg"})},
       {"utc", text("epoch, ISO 8601, e.g. 2026-11-20T00:00:00Z")},
       {"distance_au", number(kDistance_au, "scales irradiance by 1/r^2; default: 1, or the ephemeris' with utc")},
       {"angular_radius_deg", number(kAngularRadius_deg, "0: a point Sun with hard shadows", 0)},
       {"limb_darkening",
        number(kUnitInterval,
               "u of the disc's brightness 1 - u (1 - cos), cos of the angle from the Sun's own vertical; "
               "about 0.6 in the visible",
               0)}});
  sun["oneOf"] = exactly_one({"direction", "subsolar", "local", "utc"})["oneOf"];
  schemas["Sun"] = sun;
}

std::string reflectance_description() {
  std::string out = "The BRDF f_r; radiance is E_sun * mu0 * f_r * lit.\n";
  for (const auto& [name, model] : kReflectanceModels) {
    out += "\n- `" + std::string(name) + "`: " + std::string(normalisation(model));
  }
  return out + "\n\n" + std::string(normalisation_elsewhere());
}

// Members of other models are refused; the model that is left out is the default.
OrderedJson only_its_own(engine::ReflectanceModel model) {
  const engine::Reflectance fallback;
  OrderedJson is_it{{"properties", {{"model", {{"const", name_of(model)}}}}}};
  if (model != fallback.model) is_it["required"] = {"model"};
  OrderedJson foreign = OrderedJson::array();
  const auto refuse = [&](std::string_view name) { foreign.push_back({{"required", {name}}}); };
  for (const ReflectanceMember& member : reflectance_members())
    if (!member.belongs_to(model)) refuse(member.name);
  if (model != engine::ReflectanceModel::lunar_lambert) refuse("limb_darkening");
  if (model != engine::ReflectanceModel::hapke) refuse("phase_function");
  OrderedJson then{{"not", {{"anyOf", foreign}}}};
  if (model == engine::ReflectanceModel::lunar_lambert)
    then["properties"] = {{"rho", {{"maximum", engine::kLunarLambertMaxRho}}}};
  return {{"if", is_it}, {"then", then}};
}

void add_surface(OrderedJson& schemas) {
  engine::Reflectance fallback;
  OrderedJson reflectance =
      closed("", {{"model", with(words(kReflectanceModels, "which BRDF"), "default", name_of(fallback.model))}});
  for (const ReflectanceMember& member : reflectance_members())
    reflectance["properties"][std::string(member.name)] = number(member.range, member.description, member.of(fallback));
  reflectance["properties"]["limb_darkening"] =
      number(kUnitInterval, "L of `lunar_lambert`; left out: McEwen's function of the phase angle");
  reflectance["properties"]["phase_function"] =
      with(words(kPhaseFunctions,
                 "of `hapke`: 1 + b cos g + c (3 cos^2 g - 1)/2, or two lobes of width b, weighted by c; "
                 "negative nowhere"),
           "default", kPhaseFunctions[0].first);
  reflectance["description"] = reflectance_description();
  reflectance["allOf"] = OrderedJson::array();
  for (const auto& [name, model] : kReflectanceModels) reflectance["allOf"].push_back(only_its_own(model));
  schemas["Reflectance"] = reflectance;
  schemas["Material"] = closed(
      "What a surface is made of.",
      {{"reflectance", ref("Reflectance")},
       {"temperature_k",
        number(
            kTemperature_k,
            "of the surface: it emits B(T) (1 - rho) (SENSOR++ eq. 3); 0: nothing. Not with `hapke`, which has no rho",
            0)}});
}

void add_ground(OrderedJson& schemas) {
  OrderedJson ground = schemas["Material"];
  ground["description"] =
      "The ground: what it is made of, or maps of it that the operator put into the assets folder. "
      "A map's mean over a pixel's footprint counts.";
  ground["properties"]["albedo_maps"] =
      list(text("of maps/NAME.json"), kMaxMaps,
           "rho, from the first of these that has a value at a place; where none has, the reflectance's. At most 0.25 "
           "counts for `lunar_lambert`. Not with `hapke`");
  ground["properties"]["temperature_maps"] =
      list(text("of maps/NAME.json"), kMaxMaps, "K, in the same way; where none has a value, temperature_k");
  schemas["Surface"] = ground;
}

void add_objects(OrderedJson& schemas) {
  OrderedJson pose = closed(
      "Where an object's origin is and how its own axes, which are its file's, are turned.",
      {{"frame", with(words(kBodyFrames, "body frame of position_m and of the quaternions"), "default", "MOON_ME")},
       {"position_m", vector("Cartesian, m", kCoordinate_m)},
       {"geodetic", ref("Geodetic")},
       {"moon_from_object", ref("Quaternion")},
       {"object_from_moon", ref("Quaternion")},
       {"upright",
        closed("its z axis away from the Moon's centre",
               {{"azimuth_deg", number(kAzimuth_deg, "compass azimuth of its x axis, clockwise from north", 0)}})}});
  pose["allOf"] = {exactly_one({"position_m", "geodetic"}),
                   exactly_one({"moon_from_object", "object_from_moon", "upright"})};
  schemas["ObjectPose"] = pose;
  schemas["Object"] = closed(
      "A triangle mesh that the operator put into the assets folder, from either side. It throws shadows on the "
      "terrain "
      "and on objects and receives them. `/v1/rays` and `/v1/project` know terrain only.",
      {{"mesh", text("of objects/NAME.obj, .ply, .gltf or .glb")},
       {"pose", ref("ObjectPose")},
       {"scale", number(kScale, "metres per unit of the file", 1)},
       {"material", with(ref("Material"), "description", "of all parts but those in part_materials")},
       {"part_materials",
        {{"type", "object"},
         {"additionalProperties", ref("Material")},
         {"description", "by the name that the file gives to a part's material"}}}},
      {"mesh", "pose", "material"});
}

void add_band(OrderedJson& schemas) {
  OrderedJson point{{"type", "array"},
                    {"prefixItems", {number(kWavelength_um, "um"), number(kUnitInterval, "response")}},
                    {"minItems", 2},
                    {"maxItems", 2}};
  OrderedJson curve = list(point, kMaxResponsePoints,
                           "[wavelength in um, response] at rising wavelengths; linear in between, 0 outside");
  curve["minItems"] = 2;
  OrderedJson band = closed(
      "The spectral channel that radiance is integrated over: center and width, or a response curve. Left out: all "
      "wavelengths.",
      {{"center_um", number(kWavelength_um, "um")},
       {"width_um", number(kWavelength_um, "um, below twice the center")},
       {"response", curve}});
  band["oneOf"] = {{{"required", {"center_um", "width_um"}}}, {{"required", {"response"}}}};
  band["dependentSchemas"] = {{"response", none_of({"center_um", "width_um"})}};
  schemas["Band"] = band;
}

OrderedJson pairs(const Range& first, const Range& second, std::size_t most, const char* description) {
  return list(
      {{"type", "array"}, {"prefixItems", {number(first, ""), number(second, "")}}, {"minItems", 2}, {"maxItems", 2}},
      most, description);
}

// The member that a model needs, and that the others refuse.
OrderedJson owned_by(const char* model, const char* member) {
  return {{"if", {{"properties", {{"model", {{"const", model}}}}}}},
          {"then", {{"required", {member}}}},
          {"else", none_of({member})}};
}

void add_sensor(OrderedJson& schemas) {
  const engine::Detector fallback;
  OrderedJson spread = closed(
      "How light spreads over pixels, applied in radiance; the frame is rendered with a margin, so that the border is "
      "as "
      "exact as the middle.",
      {{"model", words(kPointSpreads, "airy: of f_number at the band's center wavelength")},
       {"sigma_px", number(kSigma_px, "of `gaussian`")},
       {"kernel",
        {{"anyOf",
          {list(list(number({0, 1e9}, "weight"), kMaxKernelSide, "a row"), kMaxKernelSide, "rows"),
           text("of kernels/NAME.csv in the operator's assets folder, which holds the same rows")}},
         {"description",
          "of `kernel`: as measured; as many columns as rows, an odd number; normalised to 1. The metadata's request "
          "has "
          "its rows"}}}},
      {"model"});
  spread["allOf"] = {owned_by("gaussian", "sigma_px"), owned_by("kernel", "kernel")};
  OrderedJson vignetting = closed(
      "Transmission of the optics by the angle from the boresight.",
      {{"model", words(kVignettings, "which")},
       {"table", pairs(kOffBoresight_deg, kUnitInterval, kMaxVignettingPoints,
                       "of `table`: [degrees, transmission], angles rising; linear in between, constant beyond")}},
      {"model"});
  vignetting["allOf"] = {owned_by("table", "table")};
  OrderedJson detector = closed("A quantum detector: SENSOR++ eq. (8), and its electronics.", OrderedJson::object(),
                                {"pixel_pitch_um", "quantum_efficiency", "integration_time_s", "gain_e_dn"});
  for (const DetectorMember& member : detector_members()) {
    OrderedJson& schema = detector["properties"][std::string(member.name)];
    if (!member.of)
      schema = with(integer(1, 16, member.description), "default", fallback.bit_depth);
    else
      schema = member.required ? number(member.range, member.description)
                               : number(member.range, member.description, fallback.*member.of);
  }
  detector["properties"]["photon_noise"] =
      with(boolean("photons and dark electrons arrive one by one: Poisson"), "default", fallback.photon_noise);
  schemas["Sensor"] = closed(
      "Makes `image` from radiance: vignetting, point spread, electrons (SENSOR++ eq. 8), smear, PRNU, dark current, "
      "photon "
      "noise, full well, DSNU, read noise, gain, offset, digital numbers. Needs a `band`; excludes `image`. Noise is a "
      "function of seed, frame, pixel and source: the same request gives the same bytes.",
      {{"optics",
        closed("",
               {{"f_number", number(kFNumber, "of the optics")}, {"point_spread", spread}, {"vignetting", vignetting}},
               {"f_number"})},
       {"detector", detector},
       {"motion",
        closed("During the exposure, of which the pose is the middle: light is averaged over so many moments. Other "
               "products "
               "are those of the pose.",
               {{"angular_rate_deg_s", vector("of the camera, about its own axes (opencv)", kAngularRate_deg_s)},
                {"velocity_m_s", vector("MOON_ME", kVelocity_m_s)},
                {"samples", with(integer(1, kMaxMotionSamples, "moments"), "default", engine::Motion().samples)}})},
       {"seed", with(integer(0, kMaxSeed, "one detector's: its fixed pattern follows from it"), "default", 0)},
       {"frame", with(integer(0, kMaxSeed, "another frame has other noise"), "default", 0)}},
      {"optics", "detector"});
}

void add_mertis(OrderedJson& schemas) {
  const MertisQuery fallback;
  const engine::Spectrometer& s = fallback.spectrometer;
  OrderedJson eta{{"oneOf",
                   {number(kUnitInterval, "at all wavelengths"),
                    pairs(kWavelength_um, kUnitInterval, 1000, "[um, eta], wavelengths rising")}},
                  {"description", "of optics and grating"}};
  eta["default"] = s.efficiency[0].efficiency;
  schemas["MertisRequest"] = closed(
      "A spectrometer that looks at blackbodies: SENSOR++ eqs. (3), (9), (12). What is left out is MERTIS, or assumed: "
      "the "
      "answer says what.",
      {{"description", text("of a file; ignored")},
       {"first_um", number(kWavelength_um, "where the first channel begins", s.first_um)},
       {"last_um", number(kWavelength_um, "where the last one ends", s.last_um)},
       {"channels", with(integer(1, kMaxChannels, "of equal width"), "default", s.channels)},
       {"pixel_pitch_um", number({0, 1e4, true, false}, "p", s.pixel_pitch_um)},
       {"f_number", number(kFNumber, "f_#", s.f_number)},
       {"efficiency", eta},
       {"noise_equivalent_power_w", number({0, 1, true, false}, "NEP of a pixel, W", s.noise_equivalent_power_w)},
       {"temperatures_k",
        with(list(number({1, 1e4}, "K"), 16, "of the blackbodies"), "default", fallback.temperatures_k)}});
  OrderedJson channel{{"type", "object"},
                      {"description",
                       "center_um, width_um, radiance_w_m2_sr_um (B(T)), flux_w (eq. 9), noise_equivalent_power_w, "
                       "signal_to_noise (eq. 12), width_error: of L Delta lambda against the integral, relative"}};
  OrderedJson spectrum =
      open("", {{"temperature_k", number(kAnyNumber, "K")}, {"channels", {{"type", "array"}, {"items", channel}}}},
           {"temperature_k", "channels"});
  schemas["MertisAnswer"] =
      open("Per temperature and channel.",
           {{"instrument", with(ref("MertisRequest"), "description", "as understood")},
            {"assumptions_of_the_defaults", {{"type", "array"}, {"items", text("an assumption")}}},
            {"spectra", {{"type", "array"}, {"items", spectrum}}}},
           {"instrument", "assumptions_of_the_defaults", "spectra"});
}

void add_frame_request(OrderedJson& schemas, const Limits& limits) {
  const engine::Accuracy accuracy;
  const OrderedJson full_scale{
      {"oneOf", {number(kFullScaleRadiance, "W m-2 sr-1"), {{"type", "string"}, {"const", "auto"}}}},
      {"default", "auto"},
      {"description", "radiance of the largest digital number; auto: the largest radiance in the frame"}};
  OrderedJson samples = integer(1, limits.max_samples_per_pixel,
                                "radiance and image are means over so many points of each pixel; a square number");
  samples["default"] = accuracy.samples_per_pixel;
  OrderedJson frame = closed(
      "What to render. Unknown members are errors. `sun` is required for image, radiance, angles and lit.",
      {{"camera", ref("Camera")},
       {"pose", ref("Pose")},
       {"sun", ref("Sun")},
       {"surface", ref("Surface")},
       {"objects", list(ref("Object"), kMaxObjects, "what is there besides terrain; `object_id` indexes this")},
       {"terrain", with(boolean("false: the objects are alone, without the Moon"), "default", true)},
       {"band", ref("Band")},
       {"atmosphere",
        closed("A table that the operator put into the assets folder: transmittance, irradiance and path radiance by "
               "wavelength, computed elsewhere. Needs a `band` within it.",
               {{"name", text("of atmospheres/NAME.csv")}}, {"name"})},
       {"accuracy",
        closed("How exact, against how fast.",
               {{"max_error_px",
                 number(kMaxError_px, "bound on the mesh's projected error, pixels; 0: the finest posts everywhere",
                        accuracy.max_error_px)},
                {"max_shadow_error_px",
                 number(kMaxShadowError_px,
                        "aim for how far the mesh's error displaces a shadow's edge on level ground, pixels; gives way "
                        "where the terrain that it takes doesn't fit: `shadow_error_px` says what was reached",
                        accuracy.max_shadow_error_px)},
                {"budget_ms",
                 number(kBudget_ms,
                        "instead of the others: the best of them that is predicted to take no longer, on terrain in "
                        "memory. The metadata's request says what was chosen, the header Selenograph-Budget what was "
                        "predicted; asked for by its numbers the choice gives the same bytes")},
                {"samples_per_pixel", samples}})},
       {"image", closed("How radiance becomes the digital numbers of the product `image`.",
                        {{"bit_depth", {{"type", "integer"}, {"enum", {8, 16}}, {"default", 8}}},
                         {"full_scale_radiance", full_scale}})},
       {"sensor", ref("Sensor")},
       {"camera_preset",
        text(
            "of cameras/NAME.json in the operator's assets folder: its camera and band where the request has none, its "
            "sensor, of which the request's own members replace those that it has. The metadata's request says what "
            "came "
            "of it")},
       {"visibility",
        with(words(kVisibilities,
                   "how to find what each pixel sees and whether the Sun reaches it: zbuffer (z-buffer and irregular "
                   "shadow map, several times as fast but for tiny images), raytrace, or auto, which of the two is "
                   "faster by the request and the terrain alone. All are exact; the metadata says which it was"),
             "default", "auto")},
       {"products", products_schema()}},
      {"pose"});
  frame["allOf"] = {{{"anyOf", {{{"required", {"camera"}}}, {{"required", {"camera_preset"}}}}}}};
  frame["anyOf"] = sun_where_needed();
  const auto needs_band = [](const char* member) -> OrderedJson {
    return {{"if", {{"required", {member}}}},
            {"then", {{"anyOf", {{{"required", {"band"}}}, {{"required", {"camera_preset"}}}}}}}};
  };
  frame["allOf"].push_back(needs_band("sensor")), frame["allOf"].push_back(needs_band("atmosphere"));
  frame["dependentSchemas"] = {{"sensor", none_of({"image"})}};
  schemas["FrameRequest"] = frame;
}

void add_metadata(OrderedJson& schemas) {
  const OrderedJson source =
      open("", {{"name", text("DEM tile")}, {"version", text("hash of path, size and modification time")}},
           {"name", "version"});
  schemas["FrameMetadata"] = open(
      "What is said about a frame besides its pixels: meta.json in an .npz, the attribute `selenograph` of images, the "
      "header "
      "Selenograph-Meta elsewhere. The same request gives the same text.",
      {{"software", {{"type", "object"}, {"description", "name and version"}}},
       {"content_hash", text("the ETag without quotes")},
       {"request", with(ref("FrameRequest"), "description",
                        "The request as understood: pose in MOON_ME and opencv axes, intrinsics, Sun vector. A valid "
                        "request itself")},
       {"reflectance", {{"type", "object"}, {"description", "normalisation: the equation as printed in the paper"}}},
       {"solar_irradiance",
        {{"type", "object"}, {"description", "value_w_m2 at the Moon after 1/r^2, its band and source"}}},
       {"full_scale_radiance_w_m2_sr", number(kAnyNumber, "that `image` was made with")},
       {"radiance_terms", list(text("direct, indirect, scattered, emitted, thermal_path"), 5,
                               "components of radiance that were evaluated: SENSOR++ eq. (1)")},
       {"point_spread",
        {{"type", "object"},
         {"description",
          "of an image by a sensor: margin_px that was rendered around it (the shares of pixels below count "
          "it), captured_fraction of a point's light within the kernel"}}},
       {"visibility", with(words(kVisibilities, "that the frame was made with"), "enum", {"zbuffer", "raytrace"})},
       {"lod_error_px", number(kAnyNumber, "level-of-detail error bound actually reached, pixels")},
       {"lod_error_m", number(kAnyNumber, "the same in metres")},
       {"shadow_error_px",
        number(kAnyNumber, "bound on how far the mesh's error displaces a shadow's edge on level ground, pixels")},
       {"post_spacing_m", {{"type", "object"}, {"description", "min and max over the mesh in view"}}},
       {"triangles", {{"type", "integer"}, {"description", "of the scene"}}},
       {"hit_fraction", number(kUnitInterval, "share of pixels that see the Moon or an object")},
       {"maps", {{"type", "array"}, {"description", "of each map of the ground: name and version"}}},
       {"object_fraction", number(kUnitInterval, "share of pixels that see an object")},
       {"objects",
        {{"type", "array"}, {"description", "of each object: mesh, version (hash of its content), triangles, parts"}}},
       {"filled_fraction", number(kUnitInterval, "share of pixels on posts filled by interpolation")},
       {"missing_fraction", number(kUnitInterval, "share of pixels that look at the Moon where there is no data")},
       {"sources", {{"type", "array"}, {"items", source}, {"description", "what the product `source` indexes"}}},
       {"sources_omitted", {{"type", "integer"}, {"description", "in the header only: so many did not fit"}}},
       {"warnings", {{"type", "array"}, {"items", {{"type", "string"}}}}}},
      {"software", "content_hash", "request", "lod_error_px", "lod_error_m", "sources", "warnings"});
}

void add_rays(OrderedJson& schemas, std::size_t most) {
  const OrderedJson ray = closed(
      "", {{"origin_m", vector("MOON_ME, m", kCoordinate_m)}, {"direction", vector("MOON_ME; any length but zero")}},
      {"origin_m", "direction"});
  schemas["RaysRequest"] =
      closed("Rays against the finest terrain.", {{"rays", list(ray, most, "rays")}, {"sun", ref("Sun")}}, {"rays"});
  const OrderedJson hit = open("hit alone where nothing is hit",
                               {{"hit", boolean("whether terrain was hit")},
                                {"range_m", number_or_null("from the origin, m")},
                                {"position_m", vector("MOON_ME, m")},
                                {"normal", vector("outward unit normal, MOON_ME")},
                                {"lit", number_or_null("lit fraction, when a Sun was given")}},
                               {"hit"});
  schemas["RaysAnswer"] = open("In the order of the request.", {{"rays", list(hit, most, "hits")}}, {"rays"});
}

void add_project(OrderedJson& schemas, std::size_t most) {
  OrderedJson point = schemas["Geodetic"];
  point["description"] = "Without height_m: on the terrain.";
  point["required"] = {"lat_deg", "lon_deg"};
  schemas["ProjectRequest"] = closed("Landmarks for a camera and pose.",
                                     {{"camera", ref("Camera")},
                                      {"pose", ref("Pose")},
                                      {"sun", ref("Sun")},
                                      {"points", list(point, most, "landmarks")}},
                                     {"camera", "pose", "points"});
  const OrderedJson seen = open("",
                                {{"x_px", number_or_null("column; null behind the camera")},
                                 {"y_px", number_or_null("row; null behind the camera")},
                                 {"range_m", number_or_null("from the camera, m")},
                                 {"height_m", number_or_null("that was used; null without data")},
                                 {"in_frame", boolean("in front of the camera and within the image")},
                                 {"visible", boolean("in_frame and nothing stands between")},
                                 {"lit", number_or_null("lit fraction, when a Sun was given")},
                                 {"reason", text("why a value is null")}},
                                {"x_px", "y_px", "range_m", "height_m", "in_frame", "visible"});
  schemas["ProjectAnswer"] =
      open("In the order of the request.", {{"points", list(seen, most, "landmarks")}}, {"points"});
}

void add_heights(OrderedJson& schemas, std::size_t most) {
  schemas["HeightsRequest"] = closed("Places.", {{"points", list(ref("Place"), most, "places")}}, {"points"});
  schemas["Height"] = open("Terrain at a place, by the triangles that frames are made of.",
                           {{"lat_deg", number(kLatitude_deg, "as asked")},
                            {"lon_deg", number({-180, 180, false, true}, "as asked, in [-180, 180)")},
                            {"height_m", number_or_null("above the sphere of 1 737 400 m; null without data")},
                            {"post_spacing_m", number_or_null("of the tile")},
                            {"source", text("tile name")},
                            {"filled", boolean("interpolated across a void")},
                            {"reason", text("why height_m is null")}},
                           {"lat_deg", "lon_deg", "height_m"});
  schemas["HeightsAnswer"] =
      open("In the order of the request.", {{"points", list(ref("Height"), most, "places")}}, {"points"});
}

void add_datasets(OrderedJson& schemas) {
  const OrderedJson footprint = open("of the posts, degrees",
                                     {{"south_deg", number(kLatitude_deg, "")},
                                      {"north_deg", number(kLatitude_deg, "")},
                                      {"west_deg", number({-180, 180, false, true}, "")},
                                      {"east_deg", number({-180, 540}, "west_deg < east_deg <= west_deg + 360")}},
                                     {"south_deg", "north_deg", "west_deg", "east_deg"});
  const OrderedJson dataset = open(
      "One DEM tile.",
      {{"name", text("what `source` lists")},
       {"path", text("as opened")},
       {"format", text("e.g. PDS3 Kaguya")},
       {"projection", {{"type", "string"}, {"enum", {"geographic", "polar_stereographic"}}}},
       {"width", integer(1, 1LL << 31, "posts")},
       {"height", integer(1, 1LL << 31, "posts")},
       {"footprint", footprint},
       {"post_spacing_m", number(kAnyNumber, "along a meridian, m")},
       {"posts_per_degree", number(kAnyNumber, "along a meridian")},
       {"posts",
        {{"type", "string"},
         {"enum", {"copied", "resampled"}},
         {"description", "copied: the mesh's vertices are the posts"}}},
       {"datum", text("of the heights")},
       {"quantisation_m", number(kAnyNumber, "step between heights; 0: floating point")},
       {"gaps",
        {{"type", "object"}, {"description", "void_value: what stands for a missing post, in file units; null: none"}}},
       {"bytes", {{"type", "integer"}, {"description", "of the file with the posts"}}}},
      {"name", "path", "footprint", "post_spacing_m", "posts", "datum", "gaps", "bytes"});
  const OrderedJson problem =
      open("", {{"path", text("file or folder")}, {"what", text("what is wrong with it")}}, {"path", "what"});
  schemas["Datasets"] =
      open("The catalogue, from coarse to fine.",
           {{"fingerprint", text("changes when a file changes")},
            {"datasets", {{"type", "array"}, {"items", dataset}}},
            {"problems", {{"type", "array"}, {"items", problem}, {"description", "files that can't be used"}}}},
           {"fingerprint", "datasets", "problems"});
}

OrderedJson group_of_differences(OrderedJson more, const char* description) {
  more["posts"] = integer(0, 1LL << 62, "compared");
  more["mean_m"] = number_or_null("extracted minus original");
  more["mean_absolute_m"] = number_or_null("mean of the differences' sizes");
  more["rms_m"] = number_or_null("root of the mean square");
  more["standard_error_m"] = number_or_null("of the mean, from its scatter over squares of 32 x 32 posts or more");
  more["z"] = number_or_null("mean over standard error: above 3 in size by chance once in 370");
  return open(description, std::move(more), {"posts", "mean_m", "mean_absolute_m", "rms_m", "standard_error_m", "z"});
}

OrderedJson difference_schema() {
  const OrderedJson percentile =
      open("", {{"percent", number({0, 100}, "")}, {"value_m", number_or_null("")}}, {"percent", "value_m"});
  const OrderedJson list{{"type", "array"}, {"items", percentile}};
  return group_of_differences(
      {{"median_m", number_or_null("")},
       {"median_absolute_m", number_or_null("")},
       {"standard_deviation_m", number_or_null("")},
       {"percentiles", list},
       {"absolute_percentiles", list},
       {"worst",
        {{"type", {"object", "null"}}, {"description", "difference_m, lat_deg, lon_deg, original_m of the largest"}}}},
      "All posts.");
}

void add_round_trip(OrderedJson& schemas, const Limits& limits) {
  OrderedJson posts = integer(1, most_posts(limits), "along each side of the window; fewer where the tile ends");
  posts["default"] = default_posts(limits);
  OrderedJson mode = words(kRoundTripModes, "");
  mode["default"] = "exact";
  schemas["RoundTripRequest"] =
      closed("A DEM's way into images and back.",
             {{"center", with(ref("Place"), "description", "The finest tile that holds it is compared")},
              {"height_m", number(kStationHeight_m, "of the cameras above the ground, m", 20000)},
              {"mode", mode},
              {"posts", posts},
              {"footprint_ratio", number(kFootprintRatio, "pixel footprint over post spacing, mode camera", 1)},
              {"max_error_px", number(kMaxError_px, "of the frames, mode camera; 0: the finest posts", 0)}},
             {"center"});
  const OrderedJson quadrants{{"type", "array"},
                              {"items", group_of_differences({{"name", text("NW, NE, SW, SE")}}, "Of the window.")}};
  const OrderedJson slopes{
      {"type", "array"},
      {"items", group_of_differences({{"from_deg", number(kAnyNumber, "")}, {"to_deg", number(kAnyNumber, "")}},
                                     "Posts on ground of such slopes.")}};
  schemas["RoundTripAnswer"] =
      open("Extracted minus original heights.",
           {{"tile", {{"type", "object"}, {"description", "name, post_spacing_m, quantisation_m, posts"}}},
            {"mode", words(kRoundTripModes, "")},
            {"center", ref("Place")},
            {"height_m", number(kStationHeight_m, "of the cameras above the ground")},
            {"footprint_ratio", number(kFootprintRatio, "as asked; mode camera")},
            {"pixel_footprint_m", number(kAnyNumber, "straight below a camera; mode camera")},
            {"max_error_px", number(kMaxError_px, "as asked; mode camera")},
            {"window", {{"type", "object"}, {"description", "rows, columns, and the bounds of the posts"}}},
            {"stations", integer(0, 1LL << 62, "camera positions")},
            {"counts",
             {{"type", "object"},
              {"description",
               "posts = compared + hidden (nearer terrain before them) + missed (nothing met: beside voids, beyond the "
               "last tile) + elsewhere (under a finer tile) + voids"}}},
            {"difference", difference_schema()},
            {"histogram",
             {{"type", "object"},
              {"description",
               "counts of posts in classes of equal width between from_m and to_m; posts below and above them"}}},
            {"quadrants", quadrants},
            {"slopes", slopes},
            {"software", text("name and version")}},
           {"tile", "mode", "center", "height_m", "window", "stations", "counts", "difference", "histogram",
            "quadrants", "slopes"});
}

void add_problem(OrderedJson& schemas) {
  const OrderedJson finding = open(
      "",
      {{"pointer", text("JSON Pointer (RFC 6901) to the offending member")}, {"detail", text("what is wrong with it")}},
      {"pointer", "detail"});
  schemas["Problem"] =
      open("RFC 9457.",
           {{"type", {{"type", "string"}, {"format", "uri"}, {"description", "urn:selenograph:problem:CODE"}}},
            {"title", text("the same for every problem of this type")},
            {"status", integer(400, 599, "HTTP status")},
            {"detail", text("about this one")},
            {"errors", {{"type", "array"}, {"items", finding}}}},
           {"type", "title", "status", "detail"});
}

}  // namespace

OrderedJson openapi_schemas(const Limits& limits) {
  const auto most = static_cast<std::size_t>(limits.max_rays);
  OrderedJson schemas = OrderedJson::object();
  add_camera(schemas, limits);
  add_places(schemas);
  add_pose(schemas);
  add_sun(schemas);
  add_surface(schemas);
  add_ground(schemas);
  add_objects(schemas);
  add_band(schemas);
  add_sensor(schemas);
  add_mertis(schemas);
  add_frame_request(schemas, limits);
  add_metadata(schemas);
  add_rays(schemas, most);
  add_project(schemas, most);
  add_heights(schemas, most);
  add_datasets(schemas);
  add_round_trip(schemas, limits);
  add_problem(schemas);
  return schemas;
}

}  // namespace selenograph::api
