#include "server/campaign/order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "api/message/problem.h"
#include "api/requests/frame_json.h"

namespace selenograph::server {
namespace {

using api::Json;

// Reads the request's pose as if it were that of a minimal frame. Errors in the other members are found at rendering,
// and files that they name may change until then.
std::optional<engine::Pose> pose_of(const Json& request) {
  if (!request.is_object()) return std::nullopt;
  // Several cameras of one request are close to each other: the pose of the first stands for all.
  const Json* body = &request;
  if (const auto cameras = request.find("cameras"); cameras != request.end() && cameras->is_object() &&
                                                    !cameras->empty() && cameras->front().is_object() &&
                                                    cameras->front().contains("pose"))
    body = &cameras->front();
  Json frame{{"camera", {{"width", 1}, {"height", 1}, {"fov_deg", 1}}}, {"products", {"depth"}}};
  if (const auto pose = body->find("pose"); pose != body->end()) {
    frame["pose"] = *pose;
  } else if (const auto shutter = body->find("shutter"); shutter != body->end() && shutter->is_object()) {
    const auto poses = shutter->find("poses");
    if (poses == shutter->end() || !poses->is_array() || poses->empty() || !poses->front().is_object())
      return std::nullopt;
    frame["pose"] = poses->front();
    frame["pose"].erase("time_s");
  }
  // Poses in ICRF may take their epoch from the Sun.
  if (const auto sun = request.find("sun"); sun != request.end()) frame["sun"] = *sun;
  // For an order, the ground is near enough at the reference sphere.
  const auto sphere = [](const auto&, double, double) { return 0.0; };
  try {
    return api::read_frame(frame, {}, api::Assets(), {}, sphere).request.pose;
  } catch (const api::RequestError&) {
    return std::nullopt;
  }
}

// Returns the intersection of the boresight with the sphere, or the boresight's point nearest to the centre.
//
//   camera *------to_nearest----->+       +: the boresight's point nearest to the centre
//                 (<-half_chord-->| offset
//                                 o       (: the sphere; o: its centre
Vec3 point_in_view(const engine::Pose& pose) {
  const Vec3 boresight = pose.camera_from_moon.conjugate() * Vec3::UnitZ();
  const double to_nearest_m = -pose.position_m.dot(boresight);
  const double squared_offset_m2 = pose.position_m.squaredNorm() - to_nearest_m * to_nearest_m;
  const double squared_half_chord_m2 = kMoonRadius_m * kMoonRadius_m - squared_offset_m2;  // negative: no intersection
  const double half_chord_m = std::sqrt(std::max(0.0, squared_half_chord_m2));
  return pose.position_m + std::max(0.0, to_nearest_m - half_chord_m) * boresight;
}

// Returns a member that is a number, else the fallback: the request has not been checked yet.
double number_or(const Json& object, const char* member, double fallback) {
  if (!object.is_object()) return fallback;
  const auto found = object.find(member);
  return found != object.end() && found->is_number() ? found->get<double>() : fallback;
}

// Returns the approximate number of samples of a frame. Edge samples are taken at some pixels only: they count twice.
double pixels_of(const Json& frame) {
  const Json none;
  const auto member = [&](const char* name) -> const Json& {
    const auto found = frame.is_object() ? frame.find(name) : frame.end();
    return found != frame.end() ? *found : none;
  };
  // 1024 stands for the size of a camera preset, which is not read here.
  const double width = number_or(member("camera"), "width", 1024);
  const double height = number_or(member("camera"), "height", 1024);
  const double samples = number_or(member("accuracy"), "samples_per_pixel", 1);
  const double edges = number_or(member("accuracy"), "edge_samples", 1) > 1 ? 2 : 1;
  return edges * std::clamp(width, 1.0, 65535.0) * std::clamp(height, 1.0, 65535.0) * std::clamp(samples, 1.0, 65536.0);
}

}  // namespace

// J. Skilling: Programming the Hilbert curve. AIP Conference Proceedings 707 (2004) 381-387: AxestoTranspose(). It
// turns the cell's coordinates x into the "transpose" of its index, whose bits are distributed over the three numbers.
std::uint64_t hilbert_index(const Vec3& point, int bits) {
  std::array<std::uint32_t, 3> x{};
  const double cells = std::ldexp(1.0, bits);
  for (int i = 0; i < 3; ++i)
    x[static_cast<std::size_t>(i)] = static_cast<std::uint32_t>(std::clamp((point[i] + 1) / 2 * cells, 0.0, cells - 1));
  // Undo the rotations and reflections of the sub-cubes, from the largest to the smallest: at each bit, invert the
  // lower bits of the first axis, or exchange them with those of the other axis.
  for (std::uint32_t bit_mask = 1U << (bits - 1); bit_mask > 1; bit_mask >>= 1) {
    const std::uint32_t lower_bits = bit_mask - 1;
    for (std::uint32_t& axis : x) {
      if (axis & bit_mask) {
        x[0] ^= lower_bits;
      } else {
        const std::uint32_t differing_bits = (x[0] ^ axis) & lower_bits;
        x[0] ^= differing_bits;
        axis ^= differing_bits;
      }
    }
  }
  // Encode the result as a Gray code: consecutive cells of the curve differ in one coordinate.
  x[1] ^= x[0];
  x[2] ^= x[1];
  std::uint32_t inverted_bits = 0;
  for (std::uint32_t bit_mask = 1U << (bits - 1); bit_mask > 1; bit_mask >>= 1)
    if (x[2] & bit_mask) inverted_bits ^= bit_mask - 1;
  for (std::uint32_t& axis : x) axis ^= inverted_bits;
  // Collect the index from the transpose: a bit of each axis in turn, the highest first.
  std::uint64_t index = 0;
  for (int bit = bits - 1; bit >= 0; --bit)
    for (const std::uint32_t axis : x) index = index << 1 | (axis >> bit & 1);
  return index;
}

std::uint64_t terrain_key(const Json& request) {
  const auto pose = pose_of(request);
  if (!pose) return kNoPose;
  // Cells of 120 m: frames that are closer to each other see the same blocks. Scale and offset keep borders of cells
  // away from round coordinates, where the last bit of a cosine, which differs between machines, would decide the cell.
  constexpr int kBits = 15;
  const Vec3 point_in_cube = point_in_view(*pose) / (1.1037 * kMoonRadius_m) + Vec3(1.234e-4, 2.345e-4, 3.456e-4);
  return hilbert_index(point_in_cube, kBits);
}

std::uint64_t weight_of(const Json& request) {
  constexpr double kFrameOverhead = 1 << 16;  // cost of a frame in addition to its pixels
  double pixels = 0;
  const auto cameras = request.is_object() ? request.find("cameras") : request.end();
  if (cameras != request.end() && cameras->is_object()) {
    for (const Json& camera : *cameras) pixels += pixels_of(camera);
  } else {
    pixels = pixels_of(request);
  }
  return static_cast<std::uint64_t>(std::min(pixels + kFrameOverhead, 1e12));
}

std::vector<Span> cut_evenly(const std::vector<std::uint64_t>& weights, std::size_t count) {
  long double total = 0, weight_before_next = 0;
  for (const std::uint64_t weight : weights) total += static_cast<long double>(weight);
  std::vector<Span> spans(count);
  std::size_t next = 0;
  for (std::size_t i = 0; i < count; ++i) {
    spans[i].begin = next;
    // An element belongs to the span that contains the middle of its weight; the last span takes all that are left.
    const long double span_end = total * static_cast<long double>(i + 1) / static_cast<long double>(count);
    while (next < weights.size() &&
           (i + 1 == count || weight_before_next + static_cast<long double>(weights[next]) / 2 < span_end)) {
      weight_before_next += static_cast<long double>(weights[next]);
      ++next;
    }
    spans[i].end = next;
  }
  return spans;
}

}  // namespace selenograph::server
