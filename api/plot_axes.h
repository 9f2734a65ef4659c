// Linear and logarithmic axes around a plot's area, and what is drawn within: curves, a legend.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "api/canvas.h"

namespace selenograph::api {

enum class Scale { linear, logarithmic };
// Which side the numbers stand on: near is left or below, far is right or above.
enum class Numbers { near, far, none };

struct Axis {
  double min = 0, max = 1;  // min < max; above 0 on a logarithmic axis
  Scale scale = Scale::linear;
  std::string label = {};
  Numbers numbers = Numbers::near;
  bool grid = true;
  // Before and after each number, e.g. "°N".
  std::string unit = {};
};

struct Tick {
  double value;
  std::string label;  // empty: a minor tick
};

// Ticks within [min, max]: at 1, 2 or 5 times a power of ten, about `wanted` of them with labels; on a logarithmic axis
// at the powers of ten, the digits between as minor ticks, or with labels where there are few decades.
std::vector<Tick> ticks_of(const Axis& axis, int wanted);

// A number of one, two or five times a power of ten as a label: "0.05", "200", "10⁻⁷".
std::string power_label(int digit, int exponent);

// The smallest range of an axis of this scale that holds all values and ends on labelled ticks. For linear axes, values
// that are all alike get room around them. Logarithmic axes leave out what is not above 0.
Axis axis_around(std::span<const double> values, Scale scale, std::string label);

struct CurveStyle {
  Colour colour = kPalette[0];
  double width = 1.6;
  std::vector<double> dashes = {};
  Marker marker = Marker::none;
  double marker_size = 6;
};

struct LegendEntry {
  std::string text;
  CurveStyle style;  // width 0: no line
};

class PlotAxes {
 public:
  // `area` is where data are drawn; numbers and labels stand outside of it: leave about 45 points at the left and 40
  // below. Throws std::invalid_argument for a range that is none.
  PlotAxes(const Rectangle& area, Axis x, Axis y);

  const Rectangle& area() const { return area_; }
  const Axis& x_axis() const { return x_; }
  const Axis& y_axis() const { return y_; }

  // Data -> canvas. What is not above 0 on a logarithmic axis lands far outside of the area.
  double x(double value) const;
  double y(double value) const;
  Point at(double x_value, double y_value) const { return {x(x_value), y(y_value)}; }

  // Grid first, then data, then frame: a grid drawn over data hides it.
  void draw_grid(Canvas& canvas) const;
  void draw_frame(Canvas& canvas) const;

  // Data points joined by lines and marked, within the area.
  void draw_curve(Canvas& canvas, std::span<const Point> data, const CurveStyle& style) const;

 private:
  void draw_x_numbers(Canvas& canvas) const;
  void draw_y_numbers(Canvas& canvas) const;

  Rectangle area_;
  Axis x_, y_;
  std::vector<Tick> x_ticks_, y_ticks_;
};

// A box with one line for each entry, its top right corner at `corner`.
void draw_legend(Canvas& canvas, Point corner, std::span<const LegendEntry> entries);

}  // namespace selenograph::api
