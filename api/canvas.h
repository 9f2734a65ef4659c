// A drawing that comes out as SVG and as PNG, made by the same calls. All of Cairo is behind this pair of files.
//
// Lengths are points (1/72 inch in the SVG, one pixel in a PNG of scale 1); (0, 0) is the top left corner, y grows
// downwards. The ground is white. Text is DejaVu Sans; in the SVG glyphs are outlines, so that every viewer shows the
// same, and the texts themselves stand in its <desc>, to be searched and to be read aloud.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace selenograph::api {

// Red, green, blue, opacity: 0 .. 1, sRGB.
struct Colour {
  double r = 0, g = 0, b = 0, a = 1;
};
inline constexpr Colour kBlack{0, 0, 0}, kWhite{1, 1, 1}, kInk{0.13, 0.14, 0.16}, kPaleInk{0.42, 0.44, 0.48};

// Apart for the colour-blind too (Okabe & Ito 2008, "Color Universal Design"); yellow is left out, being too pale for
// lines on white. Curve i takes entry i modulo the size.
inline constexpr Colour kPalette[] = {{0, 0.447, 0.698},     {0.835, 0.369, 0}, {0, 0.620, 0.451},
                                      {0.800, 0.475, 0.655}, {0.902, 0.624, 0}, {0.337, 0.706, 0.914}};

struct Point {
  double x = 0, y = 0;
};

struct Rectangle {
  double x = 0, y = 0, width = 0, height = 0;
  double right() const { return x + width; }
  double bottom() const { return y + height; }
};

struct Stroke {
  Colour colour = kInk;
  double width = 1;
  std::vector<double> dashes = {};  // lengths on, off, on ...; empty: solid
};

enum class Marker { none, circle, square, diamond, triangle, cross };

// Where the given place lies in the text's box, along the text and across it. `baseline` is where letters stand.
enum class Anchor { start, middle, end };
enum class Lie { top, centre, baseline };

struct TextStyle {
  double size = 11;  // em
  Anchor anchor = Anchor::start;
  Lie lie = Lie::baseline;
  double rotation_deg = 0;  // counter-clockwise about the given place: 90 reads upwards
  Colour colour = kInk;
  bool bold = false;
};

// Not for use by two threads at once. Throws std::runtime_error when Cairo fails (memory, no font), and
// std::invalid_argument for a size that is none.
class Canvas {
 public:
  Canvas(double width, double height);
  ~Canvas();
  Canvas(Canvas&&) noexcept;
  Canvas& operator=(Canvas&&) noexcept;

  double width() const;
  double height() const;

  void line(Point from, Point to, const Stroke& stroke);
  void polyline(std::span<const Point> points, const Stroke& stroke);
  void fill(std::span<const Point> polygon, const Colour& colour);
  void rectangle(const Rectangle& r, const Stroke& stroke);
  void fill(const Rectangle& r, const Colour& colour);
  void circle(Point centre, double radius, const Stroke& stroke);
  void fill_circle(Point centre, double radius, const Colour& colour);
  // A filled mark `size` across; a cross is two strokes.
  void marker(Marker kind, Point at, double size, const Colour& colour);
  // UTF-8, one line.
  void text(Point at, std::string_view words, const TextStyle& style);
  // Advance of a line of text: what to leave room for.
  double text_width(std::string_view words, double size) const;
  // w x h pixels of red, green, blue, row 0 on top, stretched over r without smoothing.
  void picture(const Rectangle& r, int w, int h, std::span<const std::uint8_t> rgb);
  // What `draw` draws shows within r only.
  void clipped(const Rectangle& r, const std::function<void()>& draw);

  std::string svg() const;
  // round(width * scale) x round(height * scale) pixels, 8 bits RGB.
  std::string png(double scale = 1) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::api
