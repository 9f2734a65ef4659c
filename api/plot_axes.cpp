#include "api/plot_axes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace selenograph::api {
namespace {

constexpr double kNumberSize = 10, kLabelSize = 11, kTickLength = 4;
constexpr Colour kGrid{0.88, 0.89, 0.91}, kPaleGrid{0.94, 0.945, 0.955};

// A true minus sign: a hyphen is hard to see before a small number.
std::string with_minus(std::string number) {
  if (!number.empty() && number.front() == '-') number.replace(0, 1, "\u2212");
  return number;
}

std::string superscript(int exponent) {
  static const char* const digits[] = {"\u2070", "\u00b9", "\u00b2", "\u00b3", "\u2074",
                                       "\u2075", "\u2076", "\u2077", "\u2078", "\u2079"};
  std::string out = exponent < 0 ? "\u207b" : "";
  for (const char c : std::to_string(std::abs(exponent))) out += digits[c - '0'];
  return out;
}

// The step of 1, 2 or 5 times a power of ten that gives at most `wanted` intervals.
double step_for(double span, int wanted) {
  const double raw = span / wanted;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  for (const double digit : {1.0, 2.0, 5.0})
    if (digit * power >= raw * (1 - 1e-9)) return digit * power;
  return 10 * power;
}

std::vector<Tick> linear_ticks(const Axis& axis, int wanted) {
  const double step = step_for(axis.max - axis.min, wanted);
  const int decimals = std::max(0, static_cast<int>(-std::floor(std::log10(step) + 1e-9)));
  std::vector<Tick> ticks;
  const auto first = static_cast<std::int64_t>(std::ceil(axis.min / step - 1e-6));
  const auto last = static_cast<std::int64_t>(std::floor(axis.max / step + 1e-6));
  for (std::int64_t i = first; i <= last; ++i) {
    const double value = static_cast<double>(i) * step;
    ticks.push_back({value, with_minus(fmt::format("{:.{}f}", value, decimals)) + axis.unit});
  }
  return ticks;
}

bool labelled(int digit, int exponent, int decades, int wanted) {
  if (digit == 1) return exponent % std::max(1, (decades + wanted - 1) / wanted) == 0;
  return decades <= 1 || (decades <= 2 && (digit == 2 || digit == 5));
}

std::vector<Tick> logarithmic_ticks(const Axis& axis, int wanted) {
  const int first = static_cast<int>(std::floor(std::log10(axis.min) + 1e-9));
  const int last = static_cast<int>(std::floor(std::log10(axis.max) + 1e-9));
  const int decades = std::max(1, static_cast<int>(std::ceil(std::log10(axis.max / axis.min) - 1e-9)));
  std::vector<Tick> ticks;
  for (int exponent = first; exponent <= last; ++exponent) {
    for (int digit = 1; digit <= 9; ++digit) {
      const double value = digit * std::pow(10.0, exponent);
      if (value < axis.min * (1 - 1e-9) || value > axis.max * (1 + 1e-9)) continue;
      const bool label = labelled(digit, exponent, decades, wanted);
      ticks.push_back({value, label ? power_label(digit, exponent) + axis.unit : std::string()});
    }
  }
  return ticks;
}

double share(const Axis& axis, double value) {
  if (axis.scale == Scale::linear) return (value - axis.min) / (axis.max - axis.min);
  if (!(value > 0)) return -1e3;
  return std::log(value / axis.min) / std::log(axis.max / axis.min);
}

void check(const Axis& axis) {
  const bool possible = std::isfinite(axis.min) && std::isfinite(axis.max) && axis.min < axis.max &&
                        (axis.scale == Scale::linear || axis.min > 0);
  if (!possible) throw std::invalid_argument(fmt::format("no axis runs from {} to {}", axis.min, axis.max));
}

Axis around_linear(double low, double high, std::string label) {
  if (!(high > low)) {
    const double room = low == 0 ? 1 : std::abs(low) / 2;
    low -= room;
    high += room;
  }
  const double step = step_for(high - low, 5);
  return {.min = std::floor(low / step + 1e-9) * step,
          .max = std::ceil(high / step - 1e-9) * step,
          .label = std::move(label)};
}

Axis around_logarithmic(double low, double high, std::string label) {
  if (!(low > 0)) low = 0.1, high = 10;
  const double first = std::floor(std::log10(low) + 1e-9);
  const double last = std::max(first + 1, std::ceil(std::log10(high) - 1e-9));
  return {
      .min = std::pow(10, first), .max = std::pow(10, last), .scale = Scale::logarithmic, .label = std::move(label)};
}

void draw_sample(Canvas& canvas, Point from, double length, const CurveStyle& style) {
  if (style.width > 0)
    canvas.line(from, {from.x + length, from.y},
                {.colour = style.colour, .width = style.width, .dashes = style.dashes});
  canvas.marker(style.marker, {from.x + length / 2, from.y}, style.marker_size, style.colour);
}

}  // namespace

std::string power_label(int digit, int exponent) {
  if (exponent >= 0 && exponent <= 4)
    return std::to_string(digit) + std::string(static_cast<std::size_t>(exponent), '0');
  if (exponent < 0 && exponent >= -3) return fmt::format("{:.{}f}", digit * std::pow(10.0, exponent), -exponent);
  return (digit == 1 ? "10" : fmt::format("{}\u00b710", digit)) + superscript(exponent);
}

std::vector<Tick> ticks_of(const Axis& axis, int wanted) {
  return axis.scale == Scale::linear ? linear_ticks(axis, wanted) : logarithmic_ticks(axis, wanted);
}

Axis axis_around(std::span<const double> values, Scale scale, std::string label) {
  double low = INFINITY, high = -INFINITY;
  for (const double v : values) {
    if (!std::isfinite(v) || (scale == Scale::logarithmic && v <= 0)) continue;
    low = std::min(low, v);
    high = std::max(high, v);
  }
  if (low > high) low = high = 0;
  return scale == Scale::linear ? around_linear(low, high, std::move(label))
                                : around_logarithmic(low, high, std::move(label));
}

PlotAxes::PlotAxes(const Rectangle& area, Axis x, Axis y) : area_(area), x_(std::move(x)), y_(std::move(y)) {
  check(x_);
  check(y_);
  // A number needs about 70 points beside the next one, and 35 above it.
  x_ticks_ = ticks_of(x_, std::max(2, static_cast<int>(area.width / 70)));
  y_ticks_ = ticks_of(y_, std::max(2, static_cast<int>(area.height / 35)));
}

double PlotAxes::x(double value) const { return area_.x + share(x_, value) * area_.width; }
double PlotAxes::y(double value) const { return area_.bottom() - share(y_, value) * area_.height; }

void PlotAxes::draw_grid(Canvas& canvas) const {
  if (x_.grid) {
    for (const Tick& tick : x_ticks_)
      canvas.line({x(tick.value), area_.y}, {x(tick.value), area_.bottom()},
                  {.colour = tick.label.empty() ? kPaleGrid : kGrid, .width = 0.8});
  }
  if (y_.grid) {
    for (const Tick& tick : y_ticks_)
      canvas.line({area_.x, y(tick.value)}, {area_.right(), y(tick.value)},
                  {.colour = tick.label.empty() ? kPaleGrid : kGrid, .width = 0.8});
  }
}

void PlotAxes::draw_frame(Canvas& canvas) const {
  canvas.rectangle(area_, {.colour = kInk, .width = 0.9});
  if (x_.numbers != Numbers::none) draw_x_numbers(canvas);
  if (y_.numbers != Numbers::none) draw_y_numbers(canvas);
}

void PlotAxes::draw_x_numbers(Canvas& canvas) const {
  const bool below = x_.numbers == Numbers::near;
  const double edge = below ? area_.bottom() : area_.y, out = below ? 1 : -1;
  const Lie lie = below ? Lie::top : Lie::baseline;
  for (const Tick& tick : x_ticks_) {
    const double px = x(tick.value), length = tick.label.empty() ? kTickLength / 2 : kTickLength;
    canvas.line({px, edge}, {px, edge + out * length}, {.width = 0.9});
    if (!tick.label.empty())
      canvas.text({px, edge + out * (kTickLength + 4)}, tick.label,
                  {.size = kNumberSize, .anchor = Anchor::middle, .lie = lie});
  }
  if (!x_.label.empty())
    canvas.text({area_.x + area_.width / 2, edge + out * (kTickLength + 2 * kNumberSize + 3)}, x_.label,
                {.size = kLabelSize, .anchor = Anchor::middle, .lie = lie});
}

void PlotAxes::draw_y_numbers(Canvas& canvas) const {
  const bool left = y_.numbers == Numbers::near;
  const double edge = left ? area_.x : area_.right(), out = left ? -1 : 1;
  double widest = 0;
  for (const Tick& tick : y_ticks_) {
    const double py = y(tick.value), length = tick.label.empty() ? kTickLength / 2 : kTickLength;
    canvas.line({edge, py}, {edge + out * length, py}, {.width = 0.9});
    if (tick.label.empty()) continue;
    canvas.text({edge + out * (kTickLength + 3), py}, tick.label,
                {.size = kNumberSize, .anchor = left ? Anchor::end : Anchor::start, .lie = Lie::centre});
    widest = std::max(widest, canvas.text_width(tick.label, kNumberSize));
  }
  // Read upwards; the text's foot is towards the axis on the left, its head on the right.
  if (!y_.label.empty())
    canvas.text(
        {edge + out * (kTickLength + widest + 10), area_.y + area_.height / 2}, y_.label,
        {.size = kLabelSize, .anchor = Anchor::middle, .lie = left ? Lie::baseline : Lie::top, .rotation_deg = 90});
}

void PlotAxes::draw_curve(Canvas& canvas, std::span<const Point> data, const CurveStyle& style) const {
  std::vector<Point> points;
  for (const Point& p : data)
    if (std::isfinite(p.x) && std::isfinite(p.y)) points.push_back(at(p.x, p.y));
  if (style.width > 0)
    canvas.clipped(area_, [&] {
      canvas.polyline(points, {.colour = style.colour, .width = style.width, .dashes = style.dashes});
    });
  // A marker on the frame shows whole; one beyond it not at all.
  const auto within = [](double at, double from, double to) { return at > from - 0.5 && at < to + 0.5; };
  for (const Point& p : points)
    if (within(p.x, area_.x, area_.right()) && within(p.y, area_.y, area_.bottom()))
      canvas.marker(style.marker, p, style.marker_size, style.colour);
}

void draw_legend(Canvas& canvas, Point corner, std::span<const LegendEntry> entries) {
  if (entries.empty()) return;
  constexpr double kRow = 16, kSample = 24, kRoom = 8;
  double widest = 0;
  for (const LegendEntry& entry : entries) widest = std::max(widest, canvas.text_width(entry.text, kNumberSize));
  const double width = 3 * kRoom + kSample + widest;
  const Rectangle box{corner.x - width, corner.y, width, kRow * static_cast<double>(entries.size()) + kRoom};
  canvas.fill(box, {1, 1, 1, 0.9});
  canvas.rectangle(box, {.colour = kGrid, .width = 0.8});
  double row = box.y + kRoom / 2 + kRow / 2;
  for (const LegendEntry& entry : entries) {
    draw_sample(canvas, {box.x + kRoom, row}, kSample, entry.style);
    canvas.text({box.x + 2 * kRoom + kSample, row}, entry.text, {.size = kNumberSize, .lie = Lie::centre});
    row += kRow;
  }
}

}  // namespace selenograph::api
