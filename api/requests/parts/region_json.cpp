// Table of a region's members (api/schema/members.h).
#include "api/requests/parts/region_json.h"

#include <fmt/format.h>

#include "api/schema/member_kinds.h"

namespace selenograph::api {

using engine::ImageRegion;

std::int64_t largest_side(const Limits& limits) { return limits.max_image_side; }

namespace {

std::int64_t last_pixel(const Limits& limits) { return limits.max_image_side - 1; }

}  // namespace

const Members<ImageRegion>& region_members() {
  static const auto table = make_table<Members<ImageRegion>>("Region", "Pixels of the image.", [](auto& m) {
    m.add("x", &ImageRegion::x, Integer{0, last_pixel, "px"}, "first column").required();
    m.add("y", &ImageRegion::y, Integer{0, last_pixel, "px"}, "first row").required();
    m.add("width", &ImageRegion::width, Integer{1, largest_side, "px"}, "columns").required();
    m.add("height", &ImageRegion::height, Integer{1, largest_side, "px"}, "rows").required();
  });
  return *table;
}

void check_region(const JsonReader& in, const ImageRegion& region, const engine::Camera& camera) {
  const JsonReader members = in.at("region");
  const auto check = [&](const char* member, int first_px, int size_px, int image_px) {
    if (first_px + size_px > image_px)
      members.fail(member, fmt::format("ends at pixel {}: the image has {}", first_px + size_px - 1, image_px));
  };
  check("width", region.x, region.width, camera.width);
  check("height", region.y, region.height, camera.height);
}

}  // namespace selenograph::api
