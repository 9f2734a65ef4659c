// Client for the lunar image service selenograph. One file, C++17, uses cpp-httplib and nlohmann-json.
//
//   apt-get install libcpp-httplib-dev libssl-dev zlib1g-dev libbrotli-dev nlohmann-json3-dev
//   g++ -std=c++17 mine.cpp $(pkg-config --cflags --libs cpp-httplib) -lcrypto -lssl -pthread
//
//   selenograph::Client client("http://127.0.0.1:8080");
//   selenograph::Frame frame = client.frame({
//       {"camera", {{"width", 1024}, {"height", 1024}, {"fov_deg", 50}}},
//       {"pose", selenograph::pose::nadir(selenograph::pose::geodetic(-6.5, 40.0, 30000.0))},
//       {"sun", {{"subsolar", {{"lat_deg", 0}, {"lon_deg", 100}}}}},
//       {"products", {"radiance", "range"}}});
//   double metres = frame["range"].at(512, 512);
//
// Requests and responses are those of the service's HTTP interface (GET /openapi.json), as nlohmann::json. Body frame
// MOON_ME, metres, degrees; camera axes and pixels as in OpenCV: +x right, +y down, +z boresight.
//
// Thread-safe: all calls of one Client may be made from several threads at once. Each call in flight has its own
// connection; connections are kept alive and reused.
//
// Failures are exceptions derived from selenograph::Error: Refused (the service rejected the request, and why),
// NoAnswer (no response in time), BadAnswer (an unreadable response). Rendering changes nothing in the service, so a
// call whose connection breaks is repeated; 429 and 503 with Retry-After (in seconds) are repeated after that time.
// BadAnswer is also thrown for a service of another major version than kServiceMajorVersion.
#ifndef SELENOGRAPH_CLIENT_HPP
#define SELENOGRAPH_CLIENT_HPP

#include <httplib.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <future>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

namespace selenograph {

// Major version of the services that this client works with (api/versions.md): they send "Server: selenograph/1.2.3".
inline constexpr int kServiceMajorVersion = 1;

using Json = nlohmann::json;
using Vector3 = std::array<double, 3>;
using Matrix3 = std::array<Vector3, 3>;  // rows first

// --- failures

class Error : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

// No response within the timeout, or no connection that lasted.
class NoAnswer : public Error {
  using Error::Error;
};

// An answer that is truncated, or that is not from this service.
class BadAnswer : public Error {
  using Error::Error;
};

// A rejection by the service, with its problem document (RFC 9457). what() has the title, the detail and all pointers.
class Refused : public Error {
 public:
  Refused(int http_status, Json document)
      : Error(describe(http_status, document)), status(http_status), problem(std::move(document)) {
    for (const Json& error : errors(problem)) pointers.push_back(text(error, "pointer"));
  }

  int status;
  Json problem;                       // null if the response was not a problem document
  std::vector<std::string> pointers;  // JSON Pointers to the request's offending members, e.g. "/camera/width"

 private:
  static std::string describe(int status, const Json& problem) {
    std::string description = std::to_string(status) + " ";
    description +=
        problem.is_null() ? "without a problem document" : text(problem, "title") + ": " + text(problem, "detail");
    for (const Json& error : errors(problem))
      description += "\n  " + text(error, "pointer") + ": " + text(error, "detail");
    return description;
  }

  // Returns the list "errors" of any JSON, which may be a proxy's; empty if there is none.
  static Json errors(const Json& problem) {
    const auto found = problem.find("errors");
    return found != problem.end() && found->is_array() ? *found : Json::array();
  }
  static std::string text(const Json& object, const char* name) {
    const auto found = object.find(name);
    return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
  }
};

// --- arrays

// A product: height x width, or height x width x channels; row 0 on top, the last index varies fastest. float16 is
// read as float32, a truth value as uint8. Arrays of a scan, of an outline or of places are N, or N x components.
class Array {
 public:
  using Data =
      std::variant<std::vector<std::uint8_t>, std::vector<std::uint16_t>, std::vector<std::uint32_t>,
                   std::vector<std::int32_t>, std::vector<float>, std::vector<double>, std::vector<std::uint64_t>>;

  std::vector<std::size_t> shape;
  Data data;

  std::size_t height() const { return extent(0); }
  std::size_t width() const { return extent(1); }
  std::size_t channels() const { return extent(2); }
  std::size_t size() const {
    return std::visit([](const auto& values) { return values.size(); }, data);
  }

  // Returns NumPy's name of the element type, e.g. "float32".
  const char* type() const {
    static constexpr const char* kNames[] = {"uint8", "uint16", "uint32", "int32", "float32", "float64", "uint64"};
    return kNames[data.index()];
  }

  // Returns the elements without conversion: as<float>() for a float32 array. Throws Error for another type.
  template <typename T>
  const std::vector<T>& as() const {
    const auto* values = std::get_if<std::vector<T>>(&data);
    if (!values) throw Error(std::string("the array's elements are ") + type());
    return *values;
  }

  // Returns an element, converted to double. Throws Error outside of the array.
  double at(std::size_t row, std::size_t column, std::size_t channel = 0) const {
    if (row >= height() || column >= width() || channel >= channels()) throw Error("outside of the array");
    const std::size_t index = (row * width() + column) * channels() + channel;
    return std::visit([&](const auto& values) { return static_cast<double>(values[index]); }, data);
  }

 private:
  std::size_t extent(std::size_t axis) const { return axis < shape.size() ? shape[axis] : 1; }
};

namespace detail {

[[noreturn]] inline void bad(const std::string& what) { throw BadAnswer("the answer cannot be read: " + what); }

// Reads a little-endian number on any machine.
inline std::uint64_t unsigned_at(std::string_view bytes, std::size_t at, std::size_t size) {
  if (at > bytes.size() || size > bytes.size() - at) bad("it is cut off");
  std::uint64_t value = 0;
  for (std::size_t i = size; i-- > 0;) value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
  return value;
}

inline std::string_view slice(std::string_view bytes, std::uint64_t at, std::uint64_t size) {
  if (at > bytes.size() || size > bytes.size() - at) bad("it is cut off");
  return bytes.substr(static_cast<std::size_t>(at), static_cast<std::size_t>(size));
}

// Returns true if this machine stores numbers in little-endian order.
inline bool little_endian() {
  const std::uint16_t number = 1;
  unsigned char first = 0;
  std::memcpy(&first, &number, 1);
  return first == 1;
}

// Returns `count` little-endian numbers; throws if the bytes have another length.
template <typename T>
std::vector<T> elements(std::string_view bytes, std::size_t count) {
  if (bytes.size() != count * sizeof(T)) bad("an array's size isn't that of its shape");
  std::vector<T> values(count);
  if (count > 0) std::memcpy(values.data(), bytes.data(), bytes.size());
  if (!little_endian()) {
    for (T& value : values) {
      auto* raw = reinterpret_cast<unsigned char*>(&value);
      std::reverse(raw, raw + sizeof(T));
    }
  }
  return values;
}

// Converts IEEE 754 binary16 numbers, given as their bits, to float, which represents all of them exactly.
inline std::vector<float> halves(const std::vector<std::uint16_t>& bits) {
  std::vector<float> values(bits.size());
  for (std::size_t i = 0; i < bits.size(); ++i) {
    const int exponent = bits[i] >> 10 & 31, fraction = bits[i] & 1023;
    const float size = exponent < 31
                           ? std::ldexp(float(exponent > 0 ? 1024 + fraction : fraction), std::max(exponent, 1) - 25)
                       : fraction == 0 ? std::numeric_limits<float>::infinity()
                                       : std::numeric_limits<float>::quiet_NaN();
    values[i] = bits[i] >> 15 ? -size : size;
  }
  return values;
}

// Returns the elements of a NumPy type, e.g. "<f8".
inline Array::Data typed(const std::string& descr, std::string_view bytes, std::size_t count) {
  if (descr == "|u1" || descr == "|b1") return elements<std::uint8_t>(bytes, count);
  if (descr == "<u2") return elements<std::uint16_t>(bytes, count);
  if (descr == "<u4") return elements<std::uint32_t>(bytes, count);
  if (descr == "<u8") return elements<std::uint64_t>(bytes, count);
  if (descr == "<i4") return elements<std::int32_t>(bytes, count);
  if (descr == "<f2") return halves(elements<std::uint16_t>(bytes, count));
  if (descr == "<f4") return elements<float>(bytes, count);
  if (descr == "<f8") return elements<double>(bytes, count);
  bad("elements of the type " + descr);
}

// Returns the text after "'name':" in the dictionary of an npy header.
inline std::string_view npy_entry(std::string_view dictionary, const std::string& name) {
  const std::size_t at = dictionary.find("'" + name + "':");
  if (at == std::string_view::npos) bad("an npy header without " + name);
  std::string_view value = dictionary.substr(at + name.size() + 3);
  value.remove_prefix(std::min(value.find_first_not_of(' '), value.size()));
  return value;
}

// Reads an npy file: NumPy Enhancement Proposal 1 (Robert Kern, 2007), versions 1.0 to 3.0, C order.
inline Array read_npy(std::string_view bytes) {
  if (bytes.substr(0, 6) != "\x93NUMPY") bad("an array that isn't npy");
  const std::size_t length_size = unsigned_at(bytes, 6, 1) == 1 ? 2 : 4;
  const std::size_t length = static_cast<std::size_t>(unsigned_at(bytes, 8, length_size));
  const std::string_view dictionary = slice(bytes, 8 + length_size, length);
  const std::string_view descr = npy_entry(dictionary, "descr"), shape = npy_entry(dictionary, "shape");
  if (npy_entry(dictionary, "fortran_order").substr(0, 5) != "False") bad("an array in Fortran's order");
  if (descr.substr(0, 1) != "'" || shape.substr(0, 1) != "(") bad("an npy header of another form");
  Array array;
  std::size_t count = 1;
  for (std::size_t i = 1; i < shape.size() && shape[i] != ')';) {
    if (shape[i] < '0' || shape[i] > '9') {
      ++i;
      continue;
    }
    std::size_t extent = 0;
    for (; i < shape.size() && shape[i] >= '0' && shape[i] <= '9'; ++i)
      extent = 10 * extent + std::size_t(shape[i] - '0');
    if (extent > 0 && count > bytes.size() / extent) bad("an array's size isn't that of its shape");
    array.shape.push_back(extent);
    count *= extent;
  }
  const std::string type(descr.substr(1, descr.find('\'', 1) - 1));
  array.data = typed(type, bytes.substr(8 + length_size + length), count);
  return array;
}

// Returns the members of an uncompressed zip (PKWARE's APPNOTE, 4.3), as the service sends it, as views into `zip`.
inline std::map<std::string, std::string_view> read_zip(std::string_view zip) {
  constexpr std::size_t kEndBytes = 22, kEntryBytes = 46, kLocalBytes = 30;
  const std::size_t end = zip.rfind("PK\x05\x06");
  if (end == std::string_view::npos || zip.size() - end < kEndBytes) bad("no npz");
  const std::size_t entries = static_cast<std::size_t>(unsigned_at(zip, end + 10, 2));
  std::size_t at = static_cast<std::size_t>(unsigned_at(zip, end + 16, 4));
  std::map<std::string, std::string_view> members;
  for (std::size_t i = 0; i < entries; ++i) {
    if (slice(zip, at, kEntryBytes).substr(0, 4) != "PK\x01\x02") bad("no entry of a zip's directory");
    const std::uint64_t method = unsigned_at(zip, at + 10, 2), stored = unsigned_at(zip, at + 20, 4);
    const std::uint64_t size = unsigned_at(zip, at + 24, 4), local = unsigned_at(zip, at + 42, 4);
    const auto name_bytes = static_cast<std::size_t>(unsigned_at(zip, at + 28, 2));
    const std::string name(slice(zip, at + kEntryBytes, name_bytes));
    if (method != 0 || stored != size) bad(name + " is compressed");
    if (size == 0xffffffff || local == 0xffffffff) bad(name + " is larger than 4 GiB: ask for fewer products");
    if (slice(zip, local, kLocalBytes).substr(0, 4) != "PK\x03\x04")
      bad(name + " isn't where the zip's directory says");
    const std::uint64_t skip =
        kLocalBytes + unsigned_at(zip, std::size_t(local) + 26, 2) + unsigned_at(zip, std::size_t(local) + 28, 2);
    members[name] = slice(zip, local + skip, size);
    at += kEntryBytes + name_bytes +
          static_cast<std::size_t>(unsigned_at(zip, at + 30, 2) + unsigned_at(zip, at + 32, 2));
  }
  return members;
}

// Parses the header Server-Timing (https://www.w3.org/TR/server-timing/): "parse;dur=0.1, load;dur=2".
inline std::map<std::string, double> read_timing(const std::string& header) {
  std::map<std::string, double> times;
  for (std::size_t at = 0; at < header.size();) {
    const std::size_t end = std::min(header.find(',', at), header.size());
    const std::string entry = header.substr(at, end - at);
    const std::size_t start = entry.find_first_not_of(' '), name_end = entry.find(';'), value = entry.find("dur=");
    if (start != std::string::npos && name_end != std::string::npos && value != std::string::npos) {
      times[entry.substr(start, name_end - start)] = std::strtod(entry.c_str() + value + 4, nullptr);
    }
    at = end + 1;
  }
  return times;
}

inline double number_or_nan(const Json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_number() ? found->get<double>() : std::numeric_limits<double>::quiet_NaN();
}

inline Vector3 vector_or_nan(const Json& object, const char* name) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const auto found = object.find(name);
  return found != object.end() ? found->get<Vector3>() : Vector3{kNan, kNan, kNan};
}

// Returns latitude and longitude of a place in JSON; throws Json::exception if it has none.
inline std::pair<double, double> degrees(const Json& point) {
  return {point.at("lat_deg").get<double>(), point.at("lon_deg").get<double>()};
}

// Returns latitude and longitude of the point below a Cartesian position.
inline std::pair<double, double> below(const Json& position_m) {
  const Vector3 p = position_m.get<Vector3>();
  const double degree = std::acos(-1.0) / 180;
  return {std::atan2(p[2], std::hypot(p[0], p[1])) / degree, std::atan2(p[1], p[0]) / degree};
}

// Returns latitude and longitude of the place that a request is about; throws Json::exception if it names none.
inline std::pair<double, double> place_of(const Json& request) {
  const bool has_pose = request.contains("pose");
  if (has_pose || (request.contains("cameras") && !request["cameras"].empty())) {
    const Json& pose = has_pose ? request["pose"] : request["cameras"].begin()->at("pose");
    if (pose.contains("geodetic")) return degrees(pose["geodetic"]);
    // ICRF, or J2000, does not rotate with the Moon: a position in it names no place.
    const std::string frame = pose.value("frame", "");
    if (pose.contains("position_m") && frame != "ICRF" && frame != "J2000") return below(pose["position_m"]);
    return degrees(pose.at("look_at"));
  }
  if (request.contains("map")) return degrees(request["map"].at("center"));
  return request.contains("rays") ? below(request["rays"].at(0).at("origin_m")) : degrees(request.at("points").at(0));
}

// Returns the value of the header Selenograph-Region: the cell of about 120 km that a request is about. A proxy in
// front of several nodes uses it to send neighbouring views to the node that has their terrain in memory. Empty if the
// place is not evident; errors in the request are left to the service. (The Python client's cells are the same.)
inline std::string region(const Json& request) {
  constexpr double kCell_deg = 4;
  try {
    const auto [lat_deg, lon_deg] = place_of(request);
    const double row = std::min(std::floor((lat_deg + 90) / kCell_deg), 180 / kCell_deg - 1);
    if (!(row >= 0) || !std::isfinite(lon_deg)) return "";
    // A row has fewer cells toward the poles, so that all have about the same width.
    const double middle_lat_rad = ((row + 0.5) * kCell_deg - 90) * std::acos(-1.0) / 180;
    const double columns = std::max(1.0, std::nearbyint(360 / kCell_deg * std::cos(middle_lat_rad)));
    const double share_of_turn = lon_deg / 360 - std::floor(lon_deg / 360);
    return std::to_string(static_cast<int>(row)) + "-" +
           std::to_string(static_cast<int>(std::fmod(std::floor(share_of_turn * columns), columns)));
  } catch (const Json::exception&) {
    return "";
  }
}

}  // namespace detail

// --- answers

// A frame, a map, a scan or another answer of arrays: arrays by name, and their metadata.
class Frame {
 public:
  std::map<std::string, Array> products;
  Json meta;                                // the resolved request, DEM tiles, error bounds, ... (meta.json)
  std::map<std::string, double> timing_ms;  // stages of the service's work, from Server-Timing
  std::string etag;                         // the header ETag, with its quotes; empty where there was none
  std::string echo;                         // JSON text of the request's "echo"; empty without one

  const Array& operator[](const std::string& product) const {
    const auto found = products.find(product);
    if (found == products.end()) throw Error("the frame has no product " + product);
    return found->second;
  }
};

struct Ray {
  Vector3 origin_m;   // MOON_ME
  Vector3 direction;  // MOON_ME, any length but zero
};

struct RayHit {
  bool hit = false;
  double range_m = 0;       // NaN without a hit, like all members below
  Vector3 position_m = {};  // MOON_ME
  Vector3 normal = {};      // outward, MOON_ME
  double lit = 0;           // lit fraction of the solar disc; NaN without a Sun
};

struct Place {
  double lat_deg, lon_deg;
  std::optional<double> height_m = std::nullopt;  // above the sphere of 1 737 400 m; left out: on the terrain
};

struct Landmark {
  double x_px = 0, y_px = 0;  // the centre of the top-left pixel is (0, 0); NaN where nothing is imaged
  double range_m = 0, height_m = 0;
  bool in_frame = false, visible = false;
  double lit = 0;      // NaN without a Sun
  std::string reason;  // reason for a missing position in the image, or height
};

struct Height {
  double lat_deg = 0, lon_deg = 0;
  double height_m = 0;        // above the sphere of 1 737 400 m; NaN without data
  double post_spacing_m = 0;  // NaN without data
  std::string source;         // name of the source tile
  bool filled = false;        // interpolated across no-data
  std::string reason;         // reason for a missing height
  bool blended = false;       // a mean of two layers
};

// The raw HTTP answer.
struct Answer {
  int status = 0;
  httplib::Headers headers;
  std::string body;

  // Returns the value of a header; empty without it.
  std::string header(const std::string& name) const {
    const auto found = headers.find(name);
    return found != headers.end() ? found->second : std::string();
  }
};

// --- the client

class Client {
 public:
  using Clock = std::chrono::steady_clock;

  // `url` has scheme, host, port and, behind a proxy, the path before /v1. https needs a build with
  // CPPHTTPLIB_OPENSSL_SUPPORT.
  //
  // `token` is sent as a bearer token: printable ASCII without blanks; empty: none.
  //
  // `timeout` limits one call with all its retries. For the header of a response, which cpp-httplib reads by itself, it
  // limits only each wait for more bytes.
  explicit Client(const std::string& url, std::string token = "",
                  std::chrono::milliseconds timeout = std::chrono::seconds(60))
      : token_(std::move(token)), timeout_(timeout) {
    const std::size_t scheme_end = url.find("://");
    if (scheme_end == std::string::npos) throw Error("not a URL: " + url);
    const std::size_t path = std::min(url.find('/', scheme_end + 3), url.size());
    origin_ = url.substr(0, path);
    prefix_ = url.substr(path);
    while (!prefix_.empty() && prefix_.back() == '/') prefix_.pop_back();
    // Reject such a token here: cpp-httplib would silently omit the header.
    if (std::any_of(token_.begin(), token_.end(), [](char c) { return c <= ' ' || c > '~'; }))
      throw Error("the token has a character that no token has");
  }

  // POST /v1/frames: all products that the request names, and metadata.
  Frame frame(const Json& request) { return arrays("/v1/frames", request); }

  // POST /v1/maps: a map's arrays; meta has the geotransform and the coordinate system.
  Frame map(const Json& request) { return arrays("/v1/maps", request); }

  // Renders a sequence of frames: calls `take(index, frame)` for each frame, in order, in the calling thread, while up
  // to `in_flight` later frames are requested.
  //
  // Each request carries the poses of the `ahead` requests that follow it, so that the service loads terrain in idle
  // time. A request with a member "ahead" of its own keeps it. If the service rejects only these added poses, the
  // request is sent again without them.
  //
  // `next` returns the requests one by one, and nullopt at the end; it is called for `ahead` requests more than are in
  // flight. The first failure ends the sequence. If a pose depends on the previous frame, call frame() instead.
  void frames(const std::function<std::optional<Json>()>& next, const std::function<void(std::size_t, Frame)>& take,
              std::size_t in_flight = 2, std::size_t ahead = 4) {
    if (in_flight == 0 || ahead > kMaxAhead) throw Error("in_flight must be at least 1, ahead at most 64");
    std::deque<Json> upcoming;               // requests from `next` that are not yet sent
    std::deque<std::future<Frame>> pending;  // frames in flight; each future joins its thread on destruction
    bool has_next = true;
    const auto refill = [&] {
      while (pending.size() < in_flight) {
        while (has_next && upcoming.size() <= ahead) {
          std::optional<Json> request = next();
          has_next = request.has_value();
          if (has_next) upcoming.push_back(std::move(*request));
        }
        if (upcoming.empty()) return;
        Json request = std::move(upcoming.front());
        upcoming.pop_front();
        Json poses = poses_ahead(request, upcoming);
        pending.push_back(std::async(std::launch::async, [this, sent = std::move(request), poses = std::move(poses)] {
          return frame_with_ahead(sent, poses);
        }));
      }
    };
    refill();
    for (std::size_t index = 0; !pending.empty(); ++index) {
      Frame frame = pending.front().get();
      pending.pop_front();
      refill();
      take(index, std::move(frame));
    }
  }

  void frames(const std::vector<Json>& requests, const std::function<void(std::size_t, Frame)>& take,
              std::size_t in_flight = 2, std::size_t ahead = 4) {
    std::size_t index = 0;
    frames([&] { return index < requests.size() ? std::optional<Json>(requests[index++]) : std::nullopt; }, take,
           in_flight, ahead);
  }

  // POST /v1/rays: intersections of any number of rays with the terrain. Long lists are split into several requests.
  std::vector<RayHit> rays(const std::vector<Ray>& rays, const Json& sun = nullptr) {
    std::vector<RayHit> hits;
    post_in_batches(
        "/v1/rays", "rays", with_sun(Json::object(), sun), rays,
        [](const Ray& ray) {
          return Json{{"origin_m", ray.origin_m}, {"direction", ray.direction}};
        },
        [&](const Json& hit) {
          hits.push_back({hit.at("hit").get<bool>(), detail::number_or_nan(hit, "range_m"),
                          detail::vector_or_nan(hit, "position_m"), detail::vector_or_nan(hit, "normal"),
                          detail::number_or_nan(hit, "lit")});
        });
    return hits;
  }

  // POST /v1/project: positions of places in the image, and whether they are visible.
  std::vector<Landmark> project(const Json& camera, const Json& pose, const std::vector<Place>& points,
                                const Json& sun = nullptr) {
    std::vector<Landmark> landmarks;
    post_in_batches("/v1/project", "points", with_sun({{"camera", camera}, {"pose", pose}}, sun), points, place_json,
                    [&](const Json& p) {
                      landmarks.push_back({detail::number_or_nan(p, "x_px"), detail::number_or_nan(p, "y_px"),
                                           detail::number_or_nan(p, "range_m"), detail::number_or_nan(p, "height_m"),
                                           p.at("in_frame").get<bool>(), p.at("visible").get<bool>(),
                                           detail::number_or_nan(p, "lit"), p.value("reason", "")});
                    });
    return landmarks;
  }

  // POST /v1/heights: the terrain's height at places, whose own heights are ignored.
  std::vector<Height> heights(const std::vector<Place>& points) {
    std::vector<Height> heights;
    post_in_batches(
        "/v1/heights", "points", Json::object(), points,
        [](const Place& point) {
          return Json{{"lat_deg", point.lat_deg}, {"lon_deg", point.lon_deg}};
        },
        [&](const Json& p) {
          heights.push_back({detail::number_or_nan(p, "lat_deg"), detail::number_or_nan(p, "lon_deg"),
                             detail::number_or_nan(p, "height_m"), detail::number_or_nan(p, "post_spacing_m"),
                             p.value("source", ""), p.value("filled", false), p.value("reason", ""),
                             p.value("blended", false)});
        });
    return heights;
  }

  // POST /v1/lidar: a scan's measurements (range_m, count, ...) and ground truth (true_range_m, ...), one row per
  // pulse.
  Frame lidar(const Json& request) { return arrays("/v1/lidar", request); }

  // POST /v1/limb: the Moon's limb (azimuth_deg, x_px, y_px, position_m, ...), one row per azimuth, and with a Sun the
  // terminator (terminator_azimuth_deg, ...).
  Frame limb(const Json& request) { return arrays("/v1/limb", request); }

  // POST /v1/horizons: elevation_deg of the horizon, by azimuth and pixel or place.
  Frame horizons(const Json& request) { return arrays("/v1/horizons", request); }

  // POST /v1/illumination: light of Sun and Earth over a time span, as statistics by pixel or place, and of places the
  // shares sun and earth by epoch and place.
  Frame illumination(const Json& request) { return arrays("/v1/illumination", request); }

  // POST /v1/sky: the list "objects" of stars, Sun, Earth and planets in view.
  Json sky(const Json& request) { return post("/v1/sky", request); }

  // POST /v1/features: the list "craters" or "rocks" of a detail in a region.
  Json features(const Json& request) { return post("/v1/features", request); }

  // GET /v1/datasets: the catalogue of terrain.
  Json datasets() { return json_of(get("/v1/datasets")); }

  // Sends any GET, e.g. of the path "metadata_at" in the header Selenograph-Meta.
  Answer get(const std::string& path) { return ask("GET", path, "", "*/*"); }

  // Sends any POST with a JSON response, for members that the calls above lack (objects, shutter, detail, ...).
  Json post(const std::string& path, const Json& request) {
    return json_of(ask("POST", path, text_of(request), "application/json", detail::region(request)));
  }

  // Sends a POST for another format, e.g. a frame as "image/png" to be written to a file.
  Answer post(const std::string& path, const Json& request, const std::string& accept) {
    return ask("POST", path, text_of(request), accept, detail::region(request));
  }

 private:
  using Connection = std::unique_ptr<httplib::Client>;
  static constexpr std::size_t kMaxAhead = 64;
  static constexpr std::size_t kBatchSize = 10000;  // rays or points per request: within the service's usual limits
  static constexpr int kMaxAttempts = 3;            // of a request whose connections break

  // Returns an idle connection, or a new one: no two calls share a connection.
  Connection connect() {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        Connection connection = std::move(idle_.back());
        idle_.pop_back();
        return connection;
      }
    }
    Connection connection;
    try {
      connection = std::make_unique<httplib::Client>(origin_);
    } catch (const std::invalid_argument&) {
      throw Error("https needs a build with CPPHTTPLIB_OPENSSL_SUPPORT");
    }
    if (!connection->is_valid()) throw Error("not a URL of a service: " + origin_);
    connection->set_keep_alive(true);
    connection->set_tcp_nodelay(true);
    return connection;
  }

  // Sends one request and returns any response; nullopt if the connection broke, with the reason in `broken`.
  std::optional<Answer> attempt(httplib::Request request, Clock::time_point until, std::string& broken) {
    Connection connection = connect();
    const auto remaining = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now());
    const std::chrono::milliseconds wait = std::max(remaining, std::chrono::milliseconds(1));
    connection->set_connection_timeout(wait);
    connection->set_read_timeout(wait);
    connection->set_write_timeout(wait);
    // Tell the service the time limit, so that it stops when this client no longer waits.
    request.set_header("Request-Timeout-Ms", std::to_string(wait.count()));
    Answer answer;
    request.content_receiver = [&](const char* data, std::size_t size, std::uint64_t offset, std::uint64_t total) {
      if (offset == 0) answer.body.reserve(static_cast<std::size_t>(std::min<std::uint64_t>(total, kMaxReserved)));
      answer.body.append(data, size);
      return Clock::now() < until;
    };
    const httplib::Result result = connection->send(request);
    if (!result) {
      broken = httplib::to_string(result.error());
      return std::nullopt;
    }
    answer.status = result->status;
    answer.headers = result->headers;
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(connection));
    return answer;
  }

  // Sends a request and returns its successful answer. Repeats it if the connection breaks or the service is busy.
  Answer ask(const std::string& method, const std::string& path, std::string body, const std::string& accept,
             const std::string& region = "") {
    const Clock::time_point until = Clock::now() + timeout_;
    httplib::Request request;
    request.method = method;
    request.path = prefix_ + path;
    request.set_header("Accept", accept);
    if (!token_.empty()) request.set_header("Authorization", "Bearer " + token_);
    if (!region.empty()) request.set_header("Selenograph-Region", region);
    if (!body.empty()) request.set_header("Content-Type", "application/json");
    request.body = std::move(body);
    for (int broken_count = 0;;) {
      std::string broken;
      std::optional<Answer> answer = attempt(request, until, broken);
      if (!answer) {
        if (++broken_count < kMaxAttempts && Clock::now() < until) continue;
        throw NoAnswer(origin_ + request.path + ": " + (Clock::now() < until ? broken : "nothing within the timeout"));
      }
      check_version(answer->header("Server"));
      if (answer->status >= 200 && answer->status < 300) return std::move(*answer);
      if (!wait_to_retry(*answer, until)) throw Refused(answer->status, problem_of(*answer));
    }
  }

  // Throws BadAnswer for a service of another major version. A proxy may hide the header: then nothing is checked.
  void check_version(const std::string& server) const {
    const std::string name = "selenograph/";
    if (server.compare(0, name.size(), name) != 0 || server.find('.') == std::string::npos) return;
    if (std::atoi(server.c_str() + name.size()) == kServiceMajorVersion) return;
    throw BadAnswer(origin_ + " is " + server + ", but this client works with services of version " +
                    std::to_string(kServiceMajorVersion) + ": take the header of the service's version");
  }

  // Sleeps for the time in Retry-After. Returns false without sleeping if there is none, or if it exceeds the time
  // left.
  static bool wait_to_retry(const Answer& answer, Clock::time_point until) {
    const std::string text = answer.header("Retry-After");
    if ((answer.status != 429 && answer.status != 503) || text.empty()) return false;
    if (text.find_first_not_of("0123456789") != std::string::npos || text.size() > 6) return false;
    const Clock::time_point retry_time = Clock::now() + std::chrono::seconds(std::atol(text.c_str()));
    if (retry_time >= until) return false;
    std::this_thread::sleep_until(retry_time);
    return true;
  }

  // Returns a request as text. Invalid UTF-8 is replaced; the service then reports an unknown word.
  static std::string text_of(const Json& request) {
    return request.dump(-1, ' ', false, Json::error_handler_t::replace);
  }

  static Json problem_of(const Answer& answer) {
    Json problem = Json::parse(answer.body, nullptr, false);
    return problem.is_object() ? problem : Json(nullptr);
  }

  static Json json_of(const Answer& answer) {
    Json json = Json::parse(answer.body, nullptr, false);
    if (json.is_discarded()) detail::bad("no JSON");
    return json;
  }

  // Returns true if a request, or one of its cameras, asks for a compressed .npz, which read_zip() cannot read.
  static bool deflated(const Json& request) {
    if (!request.is_object()) return false;
    if (request.value("compression", Json()) == "deflate") return true;
    const Json cameras = request.value("cameras", Json());
    return std::any_of(cameras.begin(), cameras.end(), deflated);
  }

  // Posts a request and reads the .npz of its answer.
  Frame arrays(const std::string& path, const Json& request) {
    if (deflated(request)) throw Error("\"compression\": \"deflate\" cannot be read: leave it out");
    const Answer answer = ask("POST", path, text_of(request), "application/x-npz", detail::region(request));
    Frame frame;
    for (const auto& [name, bytes] : detail::read_zip(answer.body)) {
      const std::size_t dot = std::min(name.rfind('.'), name.size());
      if (name == "meta.json") {
        frame.meta = Json::parse(bytes, nullptr, false);
        if (frame.meta.is_discarded()) detail::bad(name + " is no JSON");
      } else if (name.substr(dot) == ".npy") {
        frame.products[name.substr(0, dot)] = detail::read_npy(bytes);
      }
    }
    frame.timing_ms = detail::read_timing(answer.header("Server-Timing"));
    frame.etag = answer.header("ETag");
    frame.echo = answer.header("Selenograph-Echo");
    return frame;
  }

  // Returns the poses of the upcoming requests; none if the request has a member "ahead" of its own or no pose.
  static Json poses_ahead(const Json& request, const std::deque<Json>& upcoming) {
    Json poses = Json::array();
    if (!request.is_object() || request.contains("ahead") || !request.contains("pose")) return poses;
    for (const Json& r : upcoming) {
      if (r.is_object() && r.contains("pose")) poses.push_back(r["pose"]);
    }
    return poses;
  }

  // Requests a frame with added poses ahead. If the service rejects only these, requests it again without them: such a
  // fault belongs to the later request that the pose comes from.
  Frame frame_with_ahead(Json request, const Json& poses) {
    if (poses.empty()) return frame(request);
    request["ahead"] = poses;
    try {
      return frame(request);
    } catch (const Refused& refused) {
      const auto is_ahead = [](const std::string& p) { return p == "/ahead" || p.compare(0, 7, "/ahead/") == 0; };
      if (refused.pointers.empty() || !std::all_of(refused.pointers.begin(), refused.pointers.end(), is_ahead)) throw;
    }
    request.erase("ahead");
    return frame(request);
  }

  static Json with_sun(Json request, const Json& sun) {
    if (!sun.is_null()) request["sun"] = sun;
    return request;
  }

  static Json place_json(const Place& point) {
    Json json{{"lat_deg", point.lat_deg}, {"lon_deg", point.lon_deg}};
    if (point.height_m) json["height_m"] = *point.height_m;
    return json;
  }

  // Sends `items` as the list `member` of `request`, kBatchSize per request, and passes the elements of the responses
  // to `read`.
  template <typename Item, typename Write, typename Read>
  void post_in_batches(const std::string& path, const char* member, Json request, const std::vector<Item>& items,
                       const Write& write, const Read& read) {
    for (std::size_t begin = 0; begin < items.size(); begin += kBatchSize) {
      const std::size_t end = std::min(begin + kBatchSize, items.size());
      Json& list = request[member] = Json::array();
      for (std::size_t i = begin; i < end; ++i) list.push_back(write(items[i]));
      const Json answer = post_batch(path, request, std::string("/") + member + "/", begin);
      const auto found = answer.find(member);
      if (found == answer.end() || !found->is_array() || found->size() != end - begin) {
        detail::bad(std::string("no list of all ") + member);
      }
      try {
        for (const Json& element : *found) read(element);
      } catch (const Json::exception& e) {
        detail::bad(e.what());
      }
    }
  }

  // Posts a batch. Pointers of a rejection get indices into the complete list, of which the batch begins at `begin`.
  Json post_batch(const std::string& path, const Json& request, const std::string& list, std::size_t begin) {
    try {
      return post(path, request);
    } catch (const Refused& refused) {
      if (begin == 0 || refused.pointers.empty()) throw;
      Json problem = refused.problem;
      for (Json& error : problem["errors"]) {
        const std::string pointer = error.is_object() ? error.value("pointer", Json()).dump() : "";
        if (pointer.compare(0, list.size() + 1, '"' + list) != 0) continue;
        const std::string rest = error["pointer"].get<std::string>().substr(list.size());
        const std::size_t digits = std::min(rest.find('/'), rest.size());
        const std::size_t index = std::strtoul(rest.c_str(), nullptr, 10) + begin;
        error["pointer"] = list + std::to_string(index) + rest.substr(digits);
      }
      throw Refused(refused.status, std::move(problem));
    }
  }

  // Memory reserved at most before the body arrives: a Content-Length may be larger than the body.
  static constexpr std::uint64_t kMaxReserved = std::uint64_t(1) << 26;

  std::string origin_, prefix_, token_;
  std::chrono::milliseconds timeout_;
  std::mutex mutex_;
  std::vector<Connection> idle_;  // open connections that no call uses, guarded by mutex_
};

// --- attitudes and poses

// A unit quaternion that rotates vectors: b_from_a.rotate(v_a) is v_b, and c_from_b * b_from_a is c_from_a. The names
// of the functions that create one give the order of the components.
class Quaternion {
 public:
  static Quaternion wxyz(double w, double x, double y, double z) { return Quaternion(w, x, y, z); }  // scalar first
  static Quaternion xyzw(double x, double y, double z, double w) { return Quaternion(w, x, y, z); }  // scalar last

  // Returns the quaternion of a rotation matrix b_from_a, whose rows are the axes of b in a. (Shepperd 1978: dividing
  // by the largest component avoids cancellation.)
  static Quaternion matrix(const Matrix3& m) {
    const double trace = m[0][0] + m[1][1] + m[2][2];
    const std::array<double, 4> squares{1 + trace, 1 + 2 * m[0][0] - trace, 1 + 2 * m[1][1] - trace,
                                        1 + 2 * m[2][2] - trace};  // 4 w^2, 4 x^2, 4 y^2, 4 z^2
    const auto largest = static_cast<std::size_t>(std::max_element(squares.begin(), squares.end()) - squares.begin());
    const double twice = std::sqrt(squares[largest]), f = 0.5 / twice;
    const double wx = f * (m[2][1] - m[1][2]), wy = f * (m[0][2] - m[2][0]), wz = f * (m[1][0] - m[0][1]);
    const double xy = f * (m[0][1] + m[1][0]), xz = f * (m[0][2] + m[2][0]), yz = f * (m[1][2] + m[2][1]);
    if (largest == 0) return Quaternion(twice / 2, wx, wy, wz);
    if (largest == 1) return Quaternion(wx, twice / 2, xy, xz);
    if (largest == 2) return Quaternion(wy, xy, twice / 2, yz);
    return Quaternion(wz, xz, yz, twice / 2);
  }

  // Returns the quaternion of modified Rodrigues parameters in the convention of Schaub and Junkins and of Basilisk:
  // sigma_BN gives b_from_n, whose matrix is [BN] = I + (8 [s~]^2 - 4 (1 - s^2) [s~]) / (1 + s^2)^2. Their Euler
  // parameters rotate axes, this class rotates vectors: hence the sign.
  static Quaternion mrp(const Vector3& sigma) {
    const double square = sigma[0] * sigma[0] + sigma[1] * sigma[1] + sigma[2] * sigma[2], f = -2 / (1 + square);
    return Quaternion((1 - square) / (1 + square), f * sigma[0], f * sigma[1], f * sigma[2]);
  }

  double w() const { return w_; }
  double x() const { return x_; }
  double y() const { return y_; }
  double z() const { return z_; }

  Quaternion inverse() const { return Quaternion(w_, -x_, -y_, -z_); }

  Quaternion operator*(const Quaternion& b) const {
    return Quaternion(w_ * b.w_ - x_ * b.x_ - y_ * b.y_ - z_ * b.z_, w_ * b.x_ + x_ * b.w_ + y_ * b.z_ - z_ * b.y_,
                      w_ * b.y_ - x_ * b.z_ + y_ * b.w_ + z_ * b.x_, w_ * b.z_ + x_ * b.y_ - y_ * b.x_ + z_ * b.w_);
  }

  Vector3 rotate(const Vector3& v) const {
    const Quaternion r = *this * Quaternion(0, v[0], v[1], v[2]) * inverse();
    return {r.x_, r.y_, r.z_};
  }

 private:
  Quaternion(double w, double x, double y, double z) : w_(w), x_(x), y_(y), z_(z) {}
  double w_, x_, y_, z_;
};

// Poses for requests. Start with the camera's position, cartesian() or geodetic(), and add its attitude.
namespace pose {

inline Json cartesian(const Vector3& position_m) { return {{"position_m", position_m}}; }  // MOON_ME

// Returns a position by planetocentric latitude, east-positive longitude and height above the sphere of 1 737 400 m.
inline Json geodetic(double lat_deg, double lon_deg, double height_m) {
  return {{"geodetic", {{"lat_deg", lat_deg}, {"lon_deg", lon_deg}, {"height_m", height_m}}}};
}

namespace detail {
inline Json with_member(Json pose, const char* member, Json value) {
  pose[member] = std::move(value);
  return pose;
}
inline Json keys(const Quaternion& q) { return {{"w", q.w()}, {"x", q.x()}, {"y", q.y()}, {"z", q.z()}}; }
}  // namespace detail

// Adds the attitude that rotates MOON_ME vectors into camera axes. With a camera on a body: camera_from_body *
// body_from_moon.
inline Json camera_from_moon(Json position, const Quaternion& q) {
  return detail::with_member(std::move(position), "camera_from_moon", detail::keys(q));
}

// Adds the attitude that rotates vectors in camera axes into MOON_ME.
inline Json moon_from_camera(Json position, const Quaternion& q) {
  return detail::with_member(std::move(position), "moon_from_camera", detail::keys(q));
}

// Adds the attitude with the boresight to the Moon's centre and the image's up direction at this azimuth, clockwise
// from north.
inline Json nadir(Json position, double up_azimuth_deg = 0) {
  return detail::with_member(std::move(position), "nadir", {{"up_azimuth_deg", up_azimuth_deg}});
}

// Adds the attitude with the boresight through a place (without a height: at height 0). `up` is "north" or a vector as
// [x, y, z] in MOON_ME.
inline Json look_at(Json position, const Place& target, const Json& up = "north") {
  return detail::with_member(std::move(position), "look_at",
                             {{"lat_deg", target.lat_deg},
                              {"lon_deg", target.lon_deg},
                              {"height_m", target.height_m.value_or(0)},
                              {"up", up}});
}

}  // namespace pose
}  // namespace selenograph

#endif  // SELENOGRAPH_CLIENT_HPP
