#include "server/campaign/trajectory.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <fstream>
#include <map>
#include <optional>
#include <regex>
#include <set>
#include <stdexcept>

namespace selenograph::server {
namespace {

using api::Json;

constexpr const char* kDirections[] = {"camera_from_moon", "moon_from_camera"};

std::string trimmed(std::string text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && blank(text.back())) text.pop_back();
  text.erase(text.begin(), std::find_if_not(text.begin(), text.end(), blank));
  if (text.size() >= 2 && text.front() == '"' && text.back() == '"') text = text.substr(1, text.size() - 2);
  return text;
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> parts;
  for (std::size_t at = 0;;) {
    const std::size_t comma = line.find(',', at);
    parts.push_back(trimmed(line.substr(at, comma - at)));
    if (comma == std::string::npos) return parts;
    at = comma + 1;
  }
}

struct Epoch {
  std::string text;
  double seconds = 0;  // since 1970, leap seconds not counted
};

// Date with the month or the day of the year, time with any fraction.
std::optional<Epoch> epoch_of(const std::string& text) {
  static const std::regex form(R"((\d{4})-(?:(\d\d)-(\d\d)|(\d{3}))[T ](\d\d):(\d\d):(\d\d)(\.\d*)?(?:Z|\+00:00)?)");
  std::smatch found;
  if (!std::regex_match(text, found, form)) return std::nullopt;
  const auto number = [&](std::size_t i) { return std::stoi(found[i].str()); };
  const std::chrono::year year(number(1));
  std::chrono::sys_days day;
  if (found[4].matched) {
    day = std::chrono::sys_days(year / 1 / 1) + std::chrono::days(number(4) - 1);
    if (std::chrono::year_month_day(day).year() != year) return std::nullopt;
  } else {
    const std::chrono::year_month_day date = year / number(2) / number(3);
    if (!date.ok()) return std::nullopt;
    day = date;
  }
  const int hour = number(5), minute = number(6), second = number(7);
  if (hour > 23 || minute > 59 || second > 59) return std::nullopt;
  const std::string fraction = found[8].length() > 1 ? found[8].str() : "";
  const std::chrono::year_month_day date(day);
  return Epoch{fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}{}Z", static_cast<int>(date.year()),
                           static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()), hour, minute, second,
                           fraction),
               86400.0 * static_cast<double>(day.time_since_epoch().count()) + 3600 * hour + 60 * minute + second +
                   (fraction.empty() ? 0 : std::stod("0" + fraction))};
}

class Columns {
 public:
  Columns(const std::string& path, const std::vector<std::string>& names) : path_(path) {
    if (names.size() == 1 && names[0].find(';') != std::string::npos)
      fail("columns are separated by semicolons; commas are needed, and points in numbers");
    for (std::size_t i = 0; i < names.size(); ++i)
      if (!places_.emplace(names[i], i).second) fail(fmt::format("two columns are called \"{}\"", names[i]));
  }

  // All of these or none.
  bool take(const std::vector<std::string>& names) {
    std::string there, missing;
    for (const std::string& name : names) {
      used_.insert(name);
      std::string& list = places_.contains(name) ? there : missing;
      list += (list.empty() ? "" : ", ") + name;
    }
    if (!there.empty() && !missing.empty()) fail(fmt::format("there is {} but not {}", there, missing));
    return missing.empty();
  }
  void refuse_others() const {
    for (const auto& [name, place] : places_)
      if (!used_.contains(name)) fail(fmt::format("unknown column \"{}\"", name));
  }
  std::size_t size() const { return places_.size(); }

  void read(std::size_t number, std::vector<std::string> values) {
    number_ = number;
    if (values.size() != places_.size())
      fail(fmt::format("line {}: {} values for {} columns", number, values.size(), places_.size()));
    values_ = std::move(values);
  }
  const std::string& text(const std::string& name) const { return values_[places_.at(name)]; }
  double number(const std::string& name) const {
    const std::string& given = text(name);
    double value = 0;
    const auto [end, error] = std::from_chars(given.data(), given.data() + given.size(), value);
    if (error != std::errc() || end != given.data() + given.size() || !std::isfinite(value))
      fail_here(fmt::format("{} is \"{}\", no number", name, given));
    return value;
  }
  [[noreturn]] void fail(const std::string& why) const { throw std::runtime_error(path_ + ": " + why); }
  [[noreturn]] void fail_here(const std::string& why) const { fail(fmt::format("line {}: {}", number_, why)); }

 private:
  const std::string& path_;
  std::map<std::string, std::size_t> places_;
  std::set<std::string> used_;
  std::vector<std::string> values_;
  std::size_t number_ = 0;
};

std::vector<std::string> quaternion_of(const std::string& direction) {
  return {direction + "_w", direction + "_x", direction + "_y", direction + "_z"};
}

// Which columns there are.
struct Layout {
  bool utc = false, cartesian = false, velocities = false;
  std::string direction;  // empty: up_azimuth_deg

  Layout(Columns& columns, const std::string& frame) {
    utc = columns.take({"utc"});
    if (utc == columns.take({"time_s"})) columns.fail("one column with the time is needed, time_s or utc");
    cartesian = columns.take({"x_m", "y_m", "z_m"});
    velocities = columns.take({"vx_m_s", "vy_m_s", "vz_m_s"});
    if (cartesian == columns.take({"lat_deg", "lon_deg", "height_m"}))
      columns.fail("either x_m, y_m, z_m or lat_deg, lon_deg, height_m are needed");
    if (!cartesian && (velocities || frame != "MOON_ME"))
      columns.fail("velocities and other frames than MOON_ME go with x_m, y_m, z_m");
    int attitudes = columns.take({"up_azimuth_deg"});
    for (const char* each : kDirections)
      if (columns.take(quaternion_of(each))) direction = each, ++attitudes;
    if (attitudes != 1)
      columns.fail(
          "one attitude is needed: camera_from_moon_w, .._x, .._y, .._z, or moon_from_camera_w, .., or "
          "up_azimuth_deg of a camera that looks at nadir");
    if (frame == "ICRF" && !utc) columns.fail("poses in ICRF need the column utc");
    columns.refuse_others();
  }
};

Json pose_of(const Columns& row, const Layout& layout, const std::string& frame, const std::string& utc) {
  Json pose;
  if (frame != "MOON_ME") pose["frame"] = frame;
  if (frame == "ICRF") pose["utc"] = utc;
  if (layout.cartesian) {
    pose["position_m"] = {row.number("x_m"), row.number("y_m"), row.number("z_m")};
  } else {
    pose["geodetic"] = {
        {"lat_deg", row.number("lat_deg")}, {"lon_deg", row.number("lon_deg")}, {"height_m", row.number("height_m")}};
  }
  if (layout.direction.empty()) {
    pose["nadir"] = {{"up_azimuth_deg", row.number("up_azimuth_deg")}};
  } else {
    for (const char component : std::string("wxyz"))
      pose[layout.direction][std::string(1, component)] = row.number(layout.direction + "_" + component);
  }
  return pose;
}

}  // namespace

std::vector<TimedPose> read_trajectory(const std::string& path, const std::string& frame) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error(path + ": can't be read");
  std::optional<Columns> columns;
  std::optional<Layout> layout;
  std::vector<TimedPose> poses;
  double last_s = 0;
  std::string line;
  for (std::size_t number = 1; std::getline(file, line); ++number) {
    if (number == 1 && line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);
    if (trimmed(line).empty() || line.front() == '#') continue;
    if (!columns) {
      layout.emplace(columns.emplace(path, split(line)), frame);
      continue;
    }
    columns->read(number, split(line));
    TimedPose pose;
    double time_s = 0;
    if (layout->utc) {
      const auto epoch = epoch_of(columns->text("utc"));
      if (!epoch)
        columns->fail_here(fmt::format("utc is \"{}\", no epoch like 2026-11-20T00:00:00.000Z", columns->text("utc")));
      pose.utc = epoch->text, time_s = epoch->seconds;
    } else {
      time_s = columns->number("time_s");
    }
    if (!poses.empty() && time_s <= last_s) columns->fail_here("times must rise");
    last_s = time_s;
    pose.pose = pose_of(*columns, *layout, frame, pose.utc);
    for (const char* velocity : {"vx_m_s", "vy_m_s", "vz_m_s"})
      if (layout->velocities) columns->number(velocity);  // must be one
    poses.push_back(std::move(pose));
  }
  if (poses.empty()) throw std::runtime_error(path + ": a line of names and at least one of numbers are needed");
  return poses;
}

}  // namespace selenograph::server
