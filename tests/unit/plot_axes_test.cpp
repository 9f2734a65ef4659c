#include "api/plot_axes.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <vector>

namespace selenograph::api {
namespace {

std::vector<std::string> labels(const Axis& axis, int wanted) {
  std::vector<std::string> found;
  for (const Tick& tick : ticks_of(axis, wanted))
    if (!tick.label.empty()) found.push_back(tick.label);
  return found;
}

using Labels = std::vector<std::string>;

TEST(PlotAxes, LinearTicksAreRound) {
  EXPECT_EQ(labels({.min = 0, .max = 1}, 5), (Labels{"0.0", "0.2", "0.4", "0.6", "0.8", "1.0"}));
  EXPECT_EQ(labels({.min = -100, .max = 100}, 4), (Labels{"\u2212100", "\u221250", "0", "50", "100"}));
  EXPECT_EQ(labels({.min = 17.93, .max = 18.06}, 3), (Labels{"17.95", "18.00", "18.05"}));
  EXPECT_EQ(labels({.min = 26.1, .max = 26.9, .unit = "°"}, 2), (Labels{"26.5°"}));
}

TEST(PlotAxes, LogarithmicTicksAreDecades) {
  const Axis many{.min = 1e-9, .max = 1e3, .scale = Scale::logarithmic};
  EXPECT_EQ(labels(many, 4), (Labels{"10⁻⁹", "10⁻⁶", "0.001", "1", "1000"}));
  const Axis few{.min = 1, .max = 100, .scale = Scale::logarithmic};
  EXPECT_EQ(labels(few, 4), (Labels{"1", "2", "5", "10", "20", "50", "100"}));
  // All digits have a tick, labelled or not.
  EXPECT_EQ(ticks_of(few, 4).size(), 19u);
}

TEST(PlotAxes, PowersReadNaturally) {
  EXPECT_EQ(power_label(1, 0), "1");
  EXPECT_EQ(power_label(5, 2), "500");
  EXPECT_EQ(power_label(2, -2), "0.02");
  EXPECT_EQ(power_label(1, -12), "10⁻¹²");
  EXPECT_EQ(power_label(5, 7), "5·10⁷");
}

TEST(PlotAxes, RangesEndOnRoundNumbers) {
  const std::vector<double> values{3.2, 47.9, -2.0};
  const Axis linear = axis_around(values, Scale::linear, "");
  EXPECT_DOUBLE_EQ(linear.min, -10);
  EXPECT_DOUBLE_EQ(linear.max, 50);
  const Axis logarithmic = axis_around(values, Scale::logarithmic, "");
  EXPECT_DOUBLE_EQ(logarithmic.min, 1);
  EXPECT_DOUBLE_EQ(logarithmic.max, 100);
  const Axis one = axis_around(std::vector<double>{5.0}, Scale::linear, "");
  EXPECT_LT(one.min, 5);
  EXPECT_GT(one.max, 5);
}

TEST(PlotAxes, DataLandWhereTheAxesSay) {
  const PlotAxes axes({100, 50, 400, 200}, {.min = 10, .max = 1000, .scale = Scale::logarithmic},
                      {.min = -1, .max = 1});
  EXPECT_DOUBLE_EQ(axes.x(10), 100);
  EXPECT_DOUBLE_EQ(axes.x(100), 300);
  EXPECT_DOUBLE_EQ(axes.x(1000), 500);
  EXPECT_DOUBLE_EQ(axes.y(-1), 250);
  EXPECT_DOUBLE_EQ(axes.y(0), 150);
  EXPECT_LT(axes.x(0), -1000);
}

TEST(PlotAxes, RefusesRangesThatAreNone) {
  const Rectangle area{0, 0, 10, 10};
  EXPECT_THROW(PlotAxes(area, {.min = 1, .max = 1}, {}), std::invalid_argument);
  EXPECT_THROW(PlotAxes(area, {.min = 0, .max = 1, .scale = Scale::logarithmic}, {}), std::invalid_argument);
}

TEST(PlotAxes, APlotTellsItsLabelsNumbersAndLegend) {
  Canvas canvas(500, 350);
  const PlotAxes axes({60, 30, 420, 260}, {.min = 1, .max = 1000, .scale = Scale::logarithmic, .label = "time, ms"},
                      {.min = 0, .max = 5, .label = "error, px"});
  axes.draw_grid(canvas);
  const std::vector<Point> curve{{2, 4.5}, {20, 2}, {700, 0.3}};
  axes.draw_curve(canvas, curve, {.marker = Marker::circle});
  axes.draw_frame(canvas);
  const LegendEntry entries[] = {{"nadir", {.marker = Marker::circle}}, {"limb", {.colour = kPalette[1]}}};
  draw_legend(canvas, {470, 40}, entries);
  const std::string svg = canvas.svg();
  for (const char* text : {"time, ms", "error, px", "nadir", "limb", "100", "5"})
    EXPECT_NE(svg.find(std::string("\n") + text + "\n"), std::string::npos) << text;
}

}  // namespace
}  // namespace selenograph::api
