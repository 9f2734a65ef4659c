#include "api/answers/lidar_answer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <variant>

#include "api/encode/columns.h"
#include "api/message/json_text.h"
#include "api/message/version.h"
#include "api/requests/features_json.h"
#include "engine/lidar/detection.h"

namespace selenograph::api {
namespace {

using engine::LidarReturns;

// Pointer to the member of LidarReturns that holds a column, with `components` elements for each beam. The vector of
// a column that the scan does not have is empty, and the column is left out.
using LidarElements =
    std::variant<std::vector<double> LidarReturns::*, std::vector<float> LidarReturns::*,
                 std::vector<std::uint8_t> LidarReturns::*, std::vector<std::uint16_t> LidarReturns::*,
                 std::vector<std::uint64_t> LidarReturns::*>;

// Form of a column's values in JSON: numbers, booleans, indices of objects (65535: null), or hexadecimal ids of rocks
// and craters (0: null).
enum class ValueKind { number, flag, object, id };
struct LidarColumn {
  const char* name;
  LidarElements elements;
  std::size_t components;  // per beam: 1, or 3 for a vector
  ValueKind kind;
  const char* meaning;
};

constexpr LidarColumn kLidarColumns[] = {
    {"time_s", &LidarReturns::time_s, 1, ValueKind::number, "time of the pulse relative to the pose"},
    {"origin_m", &LidarReturns::origin_m, 3, ValueKind::number, "position of the aperture, MOON_ME"},
    {"direction", &LidarReturns::direction, 3, ValueKind::number, "direction of the beam's axis, unit vector, MOON_ME"},
    {"range_m", &LidarReturns::range_m, 1, ValueKind::number, "measured range of the strongest detection; NaN: none"},
    {"intensity", &LidarReturns::intensity, 1, ValueKind::number,
     "signal of the strongest detection: photoelectrons less the mean dark counts, which may be negative, or multiples "
     "of the noise"},
    {"first_m", &LidarReturns::first_m, 1, ValueKind::number, "range of the nearest detection"},
    {"first_intensity", &LidarReturns::first_intensity, 1, ValueKind::number, "signal of the nearest detection"},
    {"last_m", &LidarReturns::last_m, 1, ValueKind::number, "range of the farthest detection"},
    {"last_intensity", &LidarReturns::last_intensity, 1, ValueKind::number, "signal of the farthest detection"},
    {"count", &LidarReturns::count, 1, ValueKind::number, "number of detections, false alarms included, at most 255"},
    {"velocity_m_s", &LidarReturns::velocity_m_s, 1, ValueKind::number,
     "measured velocity along the beam, positive toward the surface; NaN without a detection, and of a false alarm"},
    {"false_alarm", &LidarReturns::false_alarm, 1, ValueKind::flag, "truth: `range_m` belongs to no target"},
    {"true_range_m", &LidarReturns::true_range_m, 1, ValueKind::number,
     "truth: centroid of the strongest return, detected or not; NaN: the beam hits nothing"},
    {"true_width_m", &LidarReturns::true_width_m, 1, ValueKind::number,
     "truth: standard deviation of the strongest return, as a range"},
    {"true_intensity", &LidarReturns::true_intensity, 1, ValueKind::number,
     "truth: mean signal of the strongest return"},
    {"true_count", &LidarReturns::true_count, 1, ValueKind::number, "truth: number of resolved returns"},
    {"true_velocity_m_s", &LidarReturns::true_velocity_m_s, 1, ValueKind::number,
     "truth: velocity of the aperture along the beam"},
    {"axis_range_m", &LidarReturns::axis_range_m, 1, ValueKind::number,
     "truth: where the beam's axis hits the surface, which is as fine as the beam's footprint needs"},
    {"object", &LidarReturns::object, 1, ValueKind::object,
     "truth: index into `objects` of the main source of the strongest return; 65535: ground, a rock, nothing"},
    {"rock", &LidarReturns::rock, 1, ValueKind::id,
     "truth: id of the rock that is the main source of the strongest return, in hexadecimal that of POST /v1/features; "
     "0: none"},
    {"crater", &LidarReturns::crater, 1, ValueKind::id,
     "truth, with `craters`: id of the smallest crater in whose rim the strongest return lies, in hexadecimal that of "
     "POST /v1/features; 0: none"},
};

// Returns one value of a column as JSON.
template <typename T>
OrderedJson element_json(const LidarColumn& column, T value) {
  switch (column.kind) {
    case ValueKind::flag:
      return value != 0;
    case ValueKind::object:
      return static_cast<double>(value) == 65535 ? OrderedJson() : OrderedJson(value);
    case ValueKind::id:
      return value == 0 ? OrderedJson() : OrderedJson(id_text(static_cast<std::uint64_t>(value)));
    case ValueKind::number:
      break;
  }
  if constexpr (std::is_floating_point_v<T>)
    if (!std::isfinite(value)) return {};
  return value;
}

// Returns warnings about a valid scan that measures nothing: no beam hits a surface, or all surfaces are out of the
// gate.
OrderedJson warnings_of(const LidarReturns& returns, const engine::LidarGate& gate) {
  double nearest_m = std::numeric_limits<double>::infinity(), farthest_m = 0;
  bool any_in_gate = false;
  for (const double range_m : returns.true_range_m) {
    if (std::isnan(range_m)) continue;
    nearest_m = std::min(nearest_m, range_m);
    farthest_m = std::max(farthest_m, range_m);
    any_in_gate |= range_m >= gate.near_m && range_m <= gate.far_m;
  }
  OrderedJson warnings = OrderedJson::array();
  if (!(nearest_m <= farthest_m))
    warnings.push_back("no beam meets a surface: the pose may point away from the Moon");
  else if (!any_in_gate)
    warnings.push_back(
        fmt::format("no beam's strongest return is within range_gate_m, {:g} to {:g} m: they come from "
                    "{:.6g} to {:.6g} m",
                    gate.near_m, gate.far_m, nearest_m, farthest_m));
  return warnings;
}

OrderedJson meta_of(const LidarReturns& returns, const LidarQuery& query) {
  return {{"software", {{"name", "selenograph"}, {"version", software_version()}}},
          {"request", lidar_members().write(query)},
          {"beams", query.beams},
          {"shape", shape_of(query)},
          {"expected_false_alarms", engine::LidarReceiverModel(query.request.instrument).expected_false_alarms()},
          {"warnings", warnings_of(returns, query.request.instrument.gate)}};
}

}  // namespace

OrderedJson lidar_return_schema() {
  OrderedJson members = OrderedJson::object();
  for (const LidarColumn& c : kLidarColumns)
    members[c.name] = c.components == 3           ? schema::vector(c.meaning)
                      : c.kind == ValueKind::flag ? schema::boolean(c.meaning)
                      : c.kind == ValueKind::id ? OrderedJson{{"type", {"string", "null"}}, {"description", c.meaning}}
                                                : schema::number_or_null(c.meaning);
  return schema::object("A beam, and what came back.", members, {});
}

std::string lidar_columns_text() {
  std::string out;
  for (const LidarColumn& c : kLidarColumns) out += fmt::format("\n- `{}`: {}", c.name, c.meaning);
  return out;
}

OrderedJson lidar_json(const LidarReturns& returns, const LidarQuery& query, const StopToken& stop) {
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < returns.size(); ++i) {
    if (i % 256 == 0) stop.check();
    OrderedJson beam = OrderedJson::object();
    for (const LidarColumn& c : kLidarColumns)
      std::visit(
          [&](auto elements) {
            const auto& values = returns.*elements;
            if (values.empty()) return;
            if (c.components == 1) {
              beam[c.name] = element_json(c, values[i]);
              return;
            }
            OrderedJson vector = OrderedJson::array();
            for (std::size_t k = 0; k < c.components; ++k) vector.push_back(values[c.components * i + k]);
            beam[c.name] = std::move(vector);
          },
          c.elements);
    list.push_back(std::move(beam));
  }
  return {{"returns", std::move(list)}, {"meta", meta_of(returns, query)}};
}

std::string lidar_npz(const LidarReturns& returns, const LidarQuery& query, const StopToken& stop) {
  std::vector<ArrayView> arrays;
  for (const LidarColumn& c : kLidarColumns)
    std::visit(
        [&](auto elements) {
          const auto& values = returns.*elements;
          if (values.empty()) return;
          using Element = typename std::decay_t<decltype(values)>::value_type;
          const auto type = c.kind == ValueKind::flag ? ElementType::boolean : element_type_of<Element>();
          std::vector<std::size_t> shape{returns.size()};
          if (c.components > 1) shape.push_back(c.components);
          // Two dimensions are enough for `shape`, which the .npz uses; the height is the number of beams.
          arrays.push_back({c.name,
                            type,
                            static_cast<int>(returns.size()),
                            static_cast<int>(c.components),
                            1,
                            values.data(),
                            {},
                            std::move(shape)});
        },
        c.elements);
  return encode_npz(arrays, json_text(meta_of(returns, query)), stop);
}

}  // namespace selenograph::api
