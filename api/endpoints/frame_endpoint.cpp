// POST /v1/frames, from the body to the bytes of the answer:
//
//   body -> read_frame -> representation (Accept) -> accuracy (budget) -> hash (If-None-Match: 304)
//        -> memory -> render -> arrays, labels, metadata -> encoder -> headers
//
// A request with "cameras" goes through the same stages once per camera and is answered by one .npz.
#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <list>

#include "api/answers/coco.h"
#include "api/answers/metadata.h"
#include "api/encode/arrays.h"
#include "api/encode/encode.h"
#include "api/encode/negotiate.h"
#include "api/endpoints/routes.h"
#include "api/requests/cameras.h"
#include "api/requests/frame_json.h"
#include "dem/base/error.h"
#include "engine/cache/budget.h"
#include "engine/frame/needs.h"
#include "engine/sky/sky_in_view.h"
#include "engine/sky/star_catalogue.h"
#include "engine/support/stopwatch.h"

namespace selenograph::api {
namespace {

// Returns the system time of all threads of the process. Most of it is spent on page faults of newly allocated memory.
double kernel_ms() {
  ::rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return 1e3 * static_cast<double>(usage.ru_stime.tv_sec) + 1e-3 * static_cast<double>(usage.ru_stime.tv_usec);
}

// Returns the header's stages. `kernel_ms` is the system's time during the request, most of it for new memory
// ("touch").
StageTimes stages_of(double parse_ms, const engine::StageTimes& times, double encode_ms, double kernel_ms) {
  StageTimes stages{{"parse", parse_ms},
                    {"select", times.select_ms},
                    {"build", times.build_ms},
                    {"pyramid", times.pyramid_ms},
                    {"load", times.load_ms}};
  add_indirect(times, stages);
  stages.push_back({"visibility", times.visibility_ms});
  if (times.draw_ms > 0)
    stages.insert(stages.end(), {{"draw", times.draw_ms}, {"resolve", times.resolve_ms}, {"shadow", times.shadow_ms}});
  stages.insert(
      stages.end(),
      {{"sensor", times.sensor_ms}, {"craters", times.craters_ms}, {"encode", encode_ms}, {"touch", kernel_ms}});
  return stages;
}

// Labels of frames as members of an .npz. Owns the masks and names to which the added views point.
class LabelMembers {
 public:
  // Adds a frame's masks and annotations; their names begin with `prefix`.
  void add(const FrameQuery& query, const engine::Frame& frame, const std::string& prefix, const StopToken& stop,
           std::vector<ArrayView>& arrays, NpzExtras& extras) {
    if (!query.labels) return;
    const engine::Camera& camera = query.request.camera;
    const FrameLabels labels(frame, camera, query.request.craters->least_px);
    const auto add_mask = [&](const char* name, std::vector<std::uint16_t> mask) {
      arrays.push_back({names_.emplace_back(prefix + name),
                        ElementType::uint16,
                        camera.height,
                        camera.width,
                        1,
                        masks_.emplace_back(std::move(mask)).data(),
                        {}});
    };
    add_mask("crater_mask", labels.crater_mask());
    add_mask("rock_mask", labels.rock_mask());
    stop.check();
    extras.texts.emplace_back(prefix + kCocoMember, json_text(labels.coco(query, "frame.npz")));
  }

 private:
  // Lists, whose elements never move: views point to them.
  std::list<std::string> names_;
  std::list<std::vector<std::uint16_t>> masks_;
};

// Returns the answer's bytes. Formats that hold one array get one: representation_for() has ensured it.
std::string encode(const std::vector<ArrayView>& arrays, Format format, const std::string& meta,
                   const NpzExtras& extras, const StopToken& stop) {
  const Attributes attributes{{"selenograph", meta}};
  switch (format) {
    case Format::npy:
      return encode_npy(arrays.front());
    case Format::npz:
      return encode_npz(arrays, meta, stop, extras);
    case Format::png:
      return encode_png(arrays.front(), attributes, stop);
    case Format::tiff:
      return encode_tiff(arrays.front(), attributes, stop);
    case Format::exr:
      return encode_exr(arrays, attributes, stop);
    case Format::raw:
      return encode_raw(arrays.front());
  }
  throw std::logic_error("no such format");
}

// Returns the shape for the header: "1024,1024" or "1024,1024,3".
std::string shape(const ArrayView& array) {
  return fmt::format("{},{}", array.height, array.width) +
         (array.channels > 1 ? fmt::format(",{}", array.channels) : "");
}

// Adds the headers of .npy and raw answers, which cannot contain metadata.
void add_array_headers(Response& response, const ArrayView& array, MetadataHeader meta) {
  response.headers.emplace_back("Selenograph-Product", array.name);
  response.headers.emplace_back("Selenograph-Shape", shape(array));
  response.headers.emplace_back("Selenograph-Dtype", numpy_descr(array.type));
  response.headers.emplace_back("Selenograph-Meta", std::move(meta.text));
}

// Stores metadata for GET /v1/frames/{hash}/meta.
void remember(const std::string& hash, std::string metadata, LongMetadata& long_metadata) {
  // Replace older metadata of this hash, which may lack warnings: a frame on a coarser layer has the same hash.
  long_metadata.erase(hash);
  const std::size_t bytes = metadata.size();
  long_metadata.get(hash, [&] {
    return LongMetadata::Loaded{std::make_shared<const std::string>(std::move(metadata)), bytes};
  });
}

// Returns the memory of the sky: an image of points, an image of discs, and stars with their rays.
std::size_t bytes_of_sky(const engine::FrameRequest& request) {
  constexpr std::size_t kBytesPerStar = 600;
  if (!request.sky || !request.sky->any()) return 0;
  const std::size_t stars = request.sky->stars ? std::min(request.sky->stars->size(), engine::kMostStars) : 0;
  return 2 * sizeof(float) * engine::rendered_pixels(request) + kBytesPerStar * stars;
}

// Returns an upper bound of the memory of a frame while it is rendered and encoded, its answer included. Caches that
// outlive frames have budgets of their own.
std::size_t bytes_of(const engine::FrameRequest& request) {
  // Arrays that the engine fills, requested or not: an image is made from radiance, craters and the sky from ranges.
  engine::ProductSet arrays = request.products;
  if (arrays & engine::kImage) arrays |= engine::kRadiance;
  const bool needs_ranges = engine::wants_ranges(request);
  if (needs_ranges) arrays |= engine::kRange;
  // Products that have every pixel; the others are subsampled by the truth grid. If craters or the sky need ranges, all
  // are drawn in every pixel and subsampled afterwards.
  const engine::ProductSet full_size = request.truth && !needs_ranges ? arrays & ~engine::kTruth : arrays;
  // The working memory is free again when the answer is encoded, so that only the larger of the two counts.
  const std::size_t answer_bytes_per_pixel = bytes_per_pixel(request.products & full_size),
                    working_bytes_per_pixel = engine::working_bytes_per_pixel(request);
  // kRock stands for the labels, three arrays of uint16: the rocks' numbers and the two masks.
  const std::size_t bytes_of_labels =
      request.products & engine::kRock ? 3 * sizeof(std::uint16_t) * engine::rendered_pixels(request) : 0;
  // Subsampled products exist twice: as arrays and in the answer.
  const std::size_t truth_bytes =
      request.truth ? request.truth->size() * 2 * bytes_per_pixel(arrays & engine::kTruth) : 0;
  return truth_bytes +
         engine::rendered_pixels(request) *
             (bytes_per_pixel(full_size) + std::max(working_bytes_per_pixel, answer_bytes_per_pixel)) +
         engine::bytes_of_rows(request.camera, request.shutter) + engine::bytes_of_rocks(request.detail.get()) +
         engine::bytes_of_craters(request) + bytes_of_sky(request) + bytes_of_labels;
}

// Pointers of the members that the engine names in its errors. Errors without a member are about the camera's pose.
constexpr MemberPointer kRefusable[] = {{"max_error_px", "/accuracy/max_error_px"},
                                        {"max_detail_error_px", "/accuracy/max_detail_error_px"},
                                        {"visibility", "/visibility"},
                                        {"shutter", "/shutter"},
                                        {"albedo_maps", "/surface/albedo_maps"},
                                        {"indirect", "/indirect/spacing_px"},
                                        {"craters", "/craters"},
                                        {"flow_to", "/flow_to"},
                                        {"magnitude_limit", "/sky/magnitude_limit"},
                                        {"earth_map", "/sky/earth_map"}};

// Returns the representation of the answer. Labels and compression exist only in an .npz, so they require one whatever
// else Accept prefers.
const Representation& representation_for(const FrameQuery& query, const std::string& accept) {
  if (!query.labels && query.compression == Compression::none) return negotiate(accept, query.request.products);
  const Representation& npz = representation(Format::npz);
  if (!accepts(accept, npz.media_type))
    throw RequestError("invalid_request", fmt::format("Accept does not allow {}", npz.media_type),
                       {{query.labels ? "/labels" : "/compression", fmt::format("is of {} alone", npz.media_type)}});
  return npz;
}

// Rejects an OpenEXR of full-size and subsampled products: all channels of a file have one size.
void reject_mixed_sizes(const engine::FrameRequest& request, const Representation& representation) {
  if (representation.format != Format::exr || !request.truth || !(request.products & engine::kTruth)) return;
  const bool is_full_size = request.truth->width == request.camera.width &&
                            request.truth->height == request.camera.height && request.truth->every_px == 1;
  if (is_full_size || !(request.products & ~engine::kTruth)) return;
  const std::string what = fmt::format("image and radiance have another size in it than the other products: ask for {}",
                                       api::representation(Format::npz).media_type);
  throw RequestError("invalid_request", "OpenEXR holds arrays of one size", {{"/truth", what}});
}

// Renders a frame; errors of the engine become errors of the request's members.
engine::Frame render(const FrameQuery& query, const EndpointContext& context) {
  try {
    return with_refusals_at(kRefusable, "/pose", [&] { return context.renderer.render(query.request, context.stop); });
  } catch (const TooMuchWork& e) {
    refuse_work(e, "/camera", context.limits);
  }
}

Response not_modified(const std::string& hash) {
  Response response;
  response.status = 304;
  response.headers = {{"ETag", "\"" + hash + "\""}, {"Vary", "Accept"}};
  return response;
}

// Adds the request's "echo" as a header, if it has one.
Response with_echo(const FrameQuery& query, Response response) {
  if (!query.echo.empty()) response.headers.emplace_back("Selenograph-Echo", query.echo);
  return response;
}

// Returns the content hash of the answer. `shadow_limits_px`: FrameReport.
std::string hash_of(const FrameQuery& query, const std::vector<double>& shadow_limits_px,
                    const Representation& representation, const EndpointContext& context) {
  return content_hash(query, shadow_limits_px, context.renderer.terrain().catalogue().fingerprint(), representation);
}

// Returns the answer with a rendered frame: metadata, arrays, encoding, headers.
Response answer(const FrameQuery& query, const engine::Frame& frame, const Representation& representation,
                const EndpointContext& context) {
  const std::string hash = hash_of(query, frame.report.shadow_limits_px, representation, context);
  Response response;
  response.content_type = representation.media_type;
  response.headers.emplace_back("Vary", "Accept");
  // Send no ETag if a coarser layer replaced an unusable file: the hash assumes that every file is usable.
  if (frame.report.warnings.empty()) response.headers.emplace_back("ETag", "\"" + hash + "\"");
  const nlohmann::ordered_json meta = metadata(query, frame.report, context.renderer.terrain().catalogue(), hash);
  Narrowed narrowed;
  std::vector<ArrayView> arrays = arrays_of(frame, query.request, query.request.products, narrowed);
  NpzExtras extras{.deflated = query.compression == Compression::deflate};
  LabelMembers labels;
  labels.add(query, frame, "", context.stop, arrays, extras);
  std::string text = metadata_text(meta, query.request.craters.has_value());
  response.body = encode(arrays, representation.format, text, extras, context.stop);
  if (representation.format == Format::npy || representation.format == Format::raw) {
    MetadataHeader header = metadata_header(meta);
    if (!header.complete) remember(hash, std::move(text), context.long_metadata);
    add_array_headers(response, arrays.front(), std::move(header));
  }
  // Tell the share without data in a header, too: in the image its black pixels look like sky.
  if (frame.report.missing_fraction > 0)
    response.headers.emplace_back("Selenograph-Missing-Fraction", fmt::format("{:.6g}", frame.report.missing_fraction));
  add_warnings(response, meta.at("warnings"));
  return response;
}

// Sets the request's accuracy to the best that its time budget allows. Returns the header Selenograph-Budget, empty
// without a budget. The prediction is not in the metadata: an explicit request of that accuracy has the same bytes and
// the same ETag.
std::string choose_within_budget(FrameQuery& query, const EndpointContext& context) {
  if (!query.budget_ms) return {};
  const engine::BudgetChoice choice = with_refusals_at(kRefusable, "/pose", [&] {
    return context.renderer.choose(query.request, *query.budget_ms, context.limits.max_samples_per_pixel, context.stop);
  });
  query.request.accuracy = choice.accuracy;
  return fmt::format("budget_ms={:g}, predicted_ms={:.3f}, fits={}, max_error_px={:g}, samples_per_pixel={}",
                     *query.budget_ms, choice.predicted_ms, choice.fits ? 1 : 0, choice.accuracy.max_error_px,
                     choice.accuracy.samples_per_pixel);
}

// Returns hash_of() before the frame is rendered; errors of the engine point at `pointer`.
std::string hash_beforehand(const FrameQuery& query, std::string_view pointer, const Representation& representation,
                            const EndpointContext& context) {
  const auto limits = with_refusals_at(kRefusable, pointer,
                                       [&] { return context.renderer.shadow_limits_px(query.request, context.stop); });
  return hash_of(query, limits, representation, context);
}

// One camera of a request with several: its request and, once rendered, its frame.
struct CameraFrame {
  std::string name;
  FrameQuery query;
  std::string budget;  // its part of the header Selenograph-Budget
  engine::Frame frame{};
  std::string hash{};
  Narrowed narrowed{};
};

// Returns the content hash of an answer with several cameras, from their names and the hashes of their frames.
std::string hash_of_all(const std::vector<CameraFrame>& cameras) {
  std::string text;
  for (const CameraFrame& camera : cameras) text += camera.name + "\n" + camera.hash + "\n";
  return content_hash(text);
}

// Returns the .npz with arrays called NAME/PRODUCT and the metadata of each camera. Adds each camera's warnings to
// `warnings`.
std::string encode(std::vector<CameraFrame>& cameras, const std::string& hash, const EndpointContext& context,
                   OrderedJson& warnings) {
  OrderedJson meta{{"content_hash", hash}, {"cameras", OrderedJson::object()}};
  std::vector<ArrayView> arrays;
  std::list<std::string> names;  // a list, since the arrays point to its elements
  NpzExtras extras;
  LabelMembers labels;
  for (CameraFrame& camera : cameras) {
    meta["cameras"][camera.name] =
        metadata(camera.query, camera.frame.report, context.renderer.terrain().catalogue(), camera.hash);
    for (const OrderedJson& text : meta["cameras"][camera.name].at("warnings"))
      warnings.push_back(camera.name + ": " + text.get<std::string>());
    const engine::FrameRequest& request = camera.query.request;
    for (ArrayView& array : arrays_of(camera.frame, request, request.products, camera.narrowed)) {
      array.name = names.emplace_back(camera.name + "/" + std::string(array.name));
      arrays.push_back(std::move(array));
    }
    labels.add(camera.query, camera.frame, camera.name + "/", context.stop, arrays, extras);
    extras.deflated |= camera.query.compression == Compression::deflate;
  }
  const bool has_craters =
      std::ranges::any_of(cameras, [](const CameraFrame& c) { return c.query.request.craters.has_value(); });
  return encode_npz(arrays, metadata_text(meta, has_craters), context.stop, extras);
}

// Answers a request with "cameras". It parses and checks all cameras first, so that a fault of one costs no frame.
Response answer_cameras(const EndpointContext& context, const Json& body, engine::Stopwatch& watch) {
  const Representation& npz = representation(Format::npz);
  const std::string accept = header(context.request, "accept");
  if (!accepts(accept, npz.media_type))
    throw RequestError("not_acceptable", fmt::format("several cameras are answered as {}", npz.media_type));
  std::vector<CameraFrame> cameras;
  std::size_t bytes = 0;
  for (CameraBody& split : split_cameras(body)) {
    with_pointers_of(body, split.name, [&] {
      cameras.push_back({split.name,
                         read_frame(split.body, context.limits, context.assets, context.stop, ground_heights(context)),
                         {}});
      cameras.back().budget = choose_within_budget(cameras.back().query, context);
    });
    bytes += bytes_of(cameras.back().query.request);
  }
  if (const std::string etags = header(context.request, "if-none-match"); !etags.empty()) {
    for (CameraFrame& camera : cameras) camera.hash = hash_beforehand(camera.query, "/cameras", npz, context);
    if (const std::string hash = hash_of_all(cameras); names_etag(etags, hash))
      return with_echo(cameras.front().query, not_modified(hash));
  }
  const double parse_ms = watch.lap_ms();
  context.memory.claim_work(bytes, "/cameras", context.stop);
  const double kernel_before_ms = kernel_ms();

  engine::StageTimes times;
  bool has_replaced_files = false;  // then there is no ETag
  for (CameraFrame& camera : cameras) {
    with_pointers_of(body, camera.name, [&] { camera.frame = render(camera.query, context); });
    context.stop.check();
    times += camera.frame.times;
    camera.hash = hash_of(camera.query, camera.frame.report.shadow_limits_px, npz, context);
    has_replaced_files |= !camera.frame.report.warnings.empty();
  }
  watch.lap_ms();  // the lap of encoding begins here: the renderer has measured its own stages
  const std::string hash = hash_of_all(cameras);
  Response response;
  response.content_type = npz.media_type;
  response.headers.emplace_back("Vary", "Accept");
  if (!has_replaced_files) response.headers.emplace_back("ETag", "\"" + hash + "\"");
  OrderedJson warnings = OrderedJson::array();
  response.body = encode(cameras, hash, context, warnings);
  add_warnings(response, warnings);
  response.stages = stages_of(parse_ms, times, watch.lap_ms(), kernel_ms() - kernel_before_ms);
  std::string budgets;
  for (const CameraFrame& camera : cameras) {
    if (!camera.budget.empty()) budgets += (budgets.empty() ? "" : "; ") + camera.name + ": " + camera.budget;
    // Let the renderer prepare the camera's next scene while it is idle.
    context.renderer.expect(camera.query.request, camera.query.ahead, camera.name);
  }
  if (!budgets.empty()) response.headers.emplace_back("Selenograph-Budget", budgets);
  return with_echo(cameras.front().query, std::move(response));
}

Response answer_frame(const EndpointContext& context, const Json& body, engine::Stopwatch& watch) {
  FrameQuery query = read_frame(body, context.limits, context.assets, context.stop, ground_heights(context));
  const std::string accept = header(context.request, "accept");
  const Representation& representation = representation_for(query, accept);
  reject_mixed_sizes(query.request, representation);
  const std::string budget = choose_within_budget(query, context);
  if (const std::string etags = header(context.request, "if-none-match"); !etags.empty()) {
    const std::string hash = hash_beforehand(query, "/pose", representation, context);
    if (names_etag(etags, hash)) return with_echo(query, not_modified(hash));
  }
  const double parse_ms = watch.lap_ms();
  context.memory.claim_work(bytes_of(query.request), "/camera", context.stop);
  const double kernel_before_ms = kernel_ms();

  const engine::Frame frame = render(query, context);
  context.stop.check();

  watch.lap_ms();  // the lap of encoding begins here: the renderer has measured its own stages
  Response response = answer(query, frame, representation, context);
  if (!budget.empty()) response.headers.emplace_back("Selenograph-Budget", budget);
  response.stages = stages_of(parse_ms, frame.times, watch.lap_ms(), kernel_ms() - kernel_before_ms);
  // Let the renderer prepare the camera's next scene while it is idle.
  context.renderer.expect(query.request, query.ahead);
  return with_echo(query, std::move(response));
}

}  // namespace

Response answer_frames(const EndpointContext& context) {
  engine::Stopwatch watch;
  const Json body = json_body(context);
  return has_cameras(body) ? answer_cameras(context, body, watch) : answer_frame(context, body, watch);
}

Response answer_frame_metadata(const EndpointContext& context) {
  return json_response(*context.long_metadata.get(std::string(context.segment), []() -> LongMetadata::Loaded {
    throw RequestError("not_found",
                       "no metadata are kept under this hash: they are for a while, and only those that a "
                       "header had no room for");
  }) + "\n");
}

void describe_frames(Operation& o) {
  o.describe(
      "A safe request that uses POST because it is long: nothing changes on the service, and the same request gives "
      "the same bytes. Therefore If-None-Match is answered with 304 as for GET, without rendering.");
  o.may_be_not_modified("The client has this frame already");
  o.body("/v1/frames", frame_members());
  OrderedJson content = OrderedJson::object();
  std::string description =
      "The frame, in the format of `Accept`. Without a preference: image alone as PNG, one product as .npy, several as "
      ".npz.\n";
  for (const Representation& r : representations()) {
    content[std::string(r.media_type)] = {{"schema", {{"type", "string"}, {"contentMediaType", r.media_type}}}};
    description += "\n- `" + std::string(r.media_type) + "`: " + std::string(r.meaning);
  }
  o.json["responses"]["200"] = {
      {"description", description},
      {"headers", header_references({"ETag", "Vary", "Server-Timing", "Selenograph-Product", "Selenograph-Shape",
                                     "Selenograph-Dtype", "Selenograph-Meta", "Selenograph-Missing-Fraction",
                                     "Selenograph-Warnings", "Selenograph-Echo"})},
      {"content", content}};
  using namespace schema;
  o.schema("MetadataElsewhere",
           object("In the header, if the metadata do not fit.",
                  {{"content_hash", text("the ETag without quotes")}, {"metadata_at", text("path of the metadata")}},
                  {"content_hash", "metadata_at"}));
}

void describe_frame_metadata(Operation& o) {
  o.parameter("hash", "path", "content_hash of the frame", true, {{"type", "string"}, {"minLength", 1}});
  o.answer("All of the frame's metadata", "FrameMetadata", metadata_answer().schema());
}

}  // namespace selenograph::api
