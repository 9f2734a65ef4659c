#include "api/requests/parts/detail_json.h"

#include <fmt/format.h>

#include "api/assets/assets.h"
#include "engine/frame/accuracy.h"

namespace selenograph::api {

std::optional<DetailName::Value> DetailName::read(const JsonReader& in, const ReadContext& context) const {
  if (in.value().is_null()) return Value{};
  return Asset{&Assets::detail, "detail", "details"}.read(in, context);
}

OrderedJson DetailName::write(const Value& value) const { return value.content ? OrderedJson(value.name) : nullptr; }

GroundHeight ground_height_of(const Json& body, const GroundHeights& ground, const ReadContext& context) {
  if (!ground) return {};
  return [&](double lat_deg, double lon_deg) {
    std::shared_ptr<const dem::Detail> detail;
    if (body.is_object() && body.contains("detail")) {
      Findings reported_elsewhere;
      const auto named = DetailName{}.read(JsonReader(body["detail"], reported_elsewhere), context);
      if (named) detail = named->content;
    }
    return ground(detail, lat_deg, lon_deg);
  };
}

std::string max_detail_error_meaning() {
  return fmt::format(
      "size limit of omitted detail, or max_error_px if larger: craters, relief, clods and fragments of at least {:g} "
      "times as many pixels are shown. It is relaxed when that needs more than {:g} triangles per pixel and more than "
      "{:g} million: `detail_limit_px` is the value used, `detail_error_px` bounds the height error left",
      engine::Accuracy::kSmallestShown, engine::Accuracy::kDetailTrianglesPerPixel,
      engine::Accuracy::kMinDetailTriangles / 1e6);
}

OrderedJson detail_metadata(const std::string& name, const dem::Detail& detail) {
  OrderedJson metadata{{"name", name},
                       {"version", fmt::format("{:016x}", detail.preset().fingerprint)},
                       {"synthetic", "ground finer than the posts: where `gsd` is finer than the source's posts"}};
  for (const dem::LawSource& source : detail.preset().sources)
    metadata["sources"][source.law] = {{"measured", source.measured}, {"extrapolated", source.extrapolated}};
  return metadata;
}

void warn_of_no_rocks(const dem::Detail& detail, OrderedJson& warnings) {
  if (detail.rocks().empty())
    warnings.push_back(
        "rocks are requested, but the detail has none: name one with rocks (\"landing\"), or add \"rocks\" to its "
        "file");
}

}  // namespace selenograph::api
