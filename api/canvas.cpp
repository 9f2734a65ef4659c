// One recording surface takes the drawing; it is replayed onto an SVG surface and onto pixels.
#include "api/canvas.h"

#include <cairo-svg.h>
#include <cairo.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace selenograph::api {
namespace {

struct DestroySurface {
  void operator()(cairo_surface_t* s) const { cairo_surface_destroy(s); }
};
struct DestroyContext {
  void operator()(cairo_t* c) const { cairo_destroy(c); }
};
using Surface = std::unique_ptr<cairo_surface_t, DestroySurface>;
using Context = std::unique_ptr<cairo_t, DestroyContext>;

void check(cairo_status_t status) {
  if (status != CAIRO_STATUS_SUCCESS)
    throw std::runtime_error(std::string("drawing: ") + cairo_status_to_string(status));
}

cairo_status_t append(void* text, const unsigned char* data, unsigned int length) {
  static_cast<std::string*>(text)->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else
      out += c;
  }
  return out;
}

void set_colour(cairo_t* c, const Colour& colour) { cairo_set_source_rgba(c, colour.r, colour.g, colour.b, colour.a); }

void set_font(cairo_t* c, double size, bool bold) {
  cairo_select_font_face(c, "DejaVu Sans", CAIRO_FONT_SLANT_NORMAL,
                         bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(c, size);
}

void stroke_path(cairo_t* c, const Stroke& stroke) {
  set_colour(c, stroke.colour);
  cairo_set_line_width(c, stroke.width);
  cairo_set_dash(c, stroke.dashes.data(), static_cast<int>(stroke.dashes.size()), 0);
  cairo_stroke(c);
}

void fill_path(cairo_t* c, const Colour& colour) {
  set_colour(c, colour);
  cairo_fill(c);
}

void path(cairo_t* c, std::span<const Point> points) {
  cairo_new_path(c);
  for (const Point& p : points) cairo_line_to(c, p.x, p.y);
}

}  // namespace

struct Canvas::Impl {
  double width, height;
  Surface recording;
  Context context;
  std::vector<std::string> texts;

  Impl(double w, double h) : width(w), height(h) {
    if (!(w >= 1 && h >= 1 && w <= 20000 && h <= 20000))
      throw std::invalid_argument("a drawing is 1 to 20000 points wide and high");
    const cairo_rectangle_t extents{0, 0, w, h};
    recording.reset(cairo_recording_surface_create(CAIRO_CONTENT_COLOR_ALPHA, &extents));
    context.reset(cairo_create(recording.get()));
    check(cairo_status(context.get()));
    cairo_set_line_join(context.get(), CAIRO_LINE_JOIN_ROUND);
    // Unhinted: text is as wide at every scale as it was when room was left for it.
    cairo_font_options_t* options = cairo_font_options_create();
    cairo_font_options_set_hint_style(options, CAIRO_HINT_STYLE_NONE);
    cairo_font_options_set_hint_metrics(options, CAIRO_HINT_METRICS_OFF);
    cairo_font_options_set_antialias(options, CAIRO_ANTIALIAS_GRAY);
    cairo_set_font_options(context.get(), options);
    cairo_font_options_destroy(options);
    set_colour(context.get(), kWhite);
    cairo_paint(context.get());
  }

  void replay(cairo_surface_t* target, double scale) const {
    const Context c(cairo_create(target));
    cairo_scale(c.get(), scale, scale);
    cairo_set_source_surface(c.get(), recording.get(), 0, 0);
    cairo_paint(c.get());
    check(cairo_status(context.get()));
    check(cairo_status(c.get()));
  }

  std::string described(std::string svg) const {
    std::string words;
    for (const std::string& text : texts) words += escaped(text) + "\n";
    const std::size_t root = svg.find("<svg");
    const std::size_t end = root == std::string::npos ? root : svg.find('>', root);
    if (end == std::string::npos) throw std::runtime_error("drawing: Cairo's SVG has no root");
    return svg.insert(end + 1, "\n<desc>" + words + "</desc>");
  }
};

Canvas::Canvas(double width, double height) : impl_(std::make_unique<Impl>(width, height)) {}
Canvas::~Canvas() = default;
Canvas::Canvas(Canvas&&) noexcept = default;
Canvas& Canvas::operator=(Canvas&&) noexcept = default;

double Canvas::width() const { return impl_->width; }
double Canvas::height() const { return impl_->height; }

void Canvas::line(Point from, Point to, const Stroke& stroke) {
  const Point points[] = {from, to};
  polyline(points, stroke);
}

void Canvas::polyline(std::span<const Point> points, const Stroke& stroke) {
  path(impl_->context.get(), points);
  stroke_path(impl_->context.get(), stroke);
}

void Canvas::fill(std::span<const Point> polygon, const Colour& colour) {
  path(impl_->context.get(), polygon);
  cairo_close_path(impl_->context.get());
  fill_path(impl_->context.get(), colour);
}

void Canvas::rectangle(const Rectangle& r, const Stroke& stroke) {
  cairo_rectangle(impl_->context.get(), r.x, r.y, r.width, r.height);
  stroke_path(impl_->context.get(), stroke);
}

void Canvas::fill(const Rectangle& r, const Colour& colour) {
  cairo_rectangle(impl_->context.get(), r.x, r.y, r.width, r.height);
  fill_path(impl_->context.get(), colour);
}

void Canvas::circle(Point centre, double radius, const Stroke& stroke) {
  cairo_new_path(impl_->context.get());
  cairo_arc(impl_->context.get(), centre.x, centre.y, radius, 0, 2 * std::numbers::pi);
  stroke_path(impl_->context.get(), stroke);
}

void Canvas::fill_circle(Point centre, double radius, const Colour& colour) {
  cairo_new_path(impl_->context.get());
  cairo_arc(impl_->context.get(), centre.x, centre.y, radius, 0, 2 * std::numbers::pi);
  fill_path(impl_->context.get(), colour);
}

void Canvas::marker(Marker kind, Point at, double size, const Colour& colour) {
  const double h = size / 2;
  switch (kind) {
    case Marker::none:
      return;
    case Marker::circle:
      return fill_circle(at, h, colour);
    case Marker::square:
      return fill(Rectangle{at.x - 0.88 * h, at.y - 0.88 * h, 1.76 * h, 1.76 * h}, colour);
    case Marker::diamond: {
      const Point corners[] = {{at.x, at.y - 1.2 * h}, {at.x + h, at.y}, {at.x, at.y + 1.2 * h}, {at.x - h, at.y}};
      return fill(corners, colour);
    }
    case Marker::triangle: {
      const Point corners[] = {
          {at.x, at.y - 1.1 * h}, {at.x + 1.05 * h, at.y + 0.8 * h}, {at.x - 1.05 * h, at.y + 0.8 * h}};
      return fill(corners, colour);
    }
    case Marker::cross:
      line({at.x - h, at.y - h}, {at.x + h, at.y + h}, {.colour = colour, .width = size / 4});
      line({at.x - h, at.y + h}, {at.x + h, at.y - h}, {.colour = colour, .width = size / 4});
  }
}

void Canvas::text(Point at, std::string_view words, const TextStyle& style) {
  cairo_t* c = impl_->context.get();
  const std::string line(words);
  set_font(c, style.size, style.bold);
  cairo_text_extents_t extents;
  cairo_text_extents(c, line.c_str(), &extents);
  const double along = style.anchor == Anchor::start ? 0 : style.anchor == Anchor::middle ? 0.5 : 1.0;
  // DejaVu Sans: capitals and digits are 0.729 em high.
  const double across = style.lie == Lie::baseline ? 0 : style.lie == Lie::centre ? 0.5 : 1.0;
  cairo_save(c);
  cairo_translate(c, at.x, at.y);
  cairo_rotate(c, -style.rotation_deg * std::numbers::pi / 180.0);
  cairo_move_to(c, -along * extents.x_advance, across * 0.729 * style.size);
  set_colour(c, style.colour);
  cairo_show_text(c, line.c_str());
  cairo_restore(c);
  impl_->texts.push_back(line);
}

double Canvas::text_width(std::string_view words, double size) const {
  set_font(impl_->context.get(), size, false);
  cairo_text_extents_t extents;
  cairo_text_extents(impl_->context.get(), std::string(words).c_str(), &extents);
  return extents.x_advance;
}

void Canvas::picture(const Rectangle& r, int w, int h, std::span<const std::uint8_t> rgb) {
  if (w < 1 || h < 1 || rgb.size() != static_cast<std::size_t>(w) * static_cast<std::size_t>(h) * 3)
    throw std::invalid_argument("a picture's pixels don't match its size");
  const Surface pixels(cairo_image_surface_create(CAIRO_FORMAT_RGB24, w, h));
  check(cairo_surface_status(pixels.get()));
  unsigned char* data = cairo_image_surface_get_data(pixels.get());
  const int stride = cairo_image_surface_get_stride(pixels.get());
  for (int y = 0; y < h; ++y) {
    auto* row = reinterpret_cast<std::uint32_t*>(data + static_cast<std::ptrdiff_t>(y) * stride);
    for (int x = 0; x < w; ++x) {
      const std::uint8_t* p =
          rgb.data() + (static_cast<std::size_t>(y) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x)) * 3;
      row[x] = static_cast<std::uint32_t>(p[0] << 16 | p[1] << 8 | p[2]);
    }
  }
  cairo_surface_mark_dirty(pixels.get());
  cairo_t* c = impl_->context.get();
  cairo_save(c);
  cairo_translate(c, r.x, r.y);
  cairo_scale(c, r.width / w, r.height / h);
  cairo_set_source_surface(c, pixels.get(), 0, 0);
  cairo_pattern_set_filter(cairo_get_source(c), CAIRO_FILTER_NEAREST);
  cairo_rectangle(c, 0, 0, w, h);
  cairo_fill(c);
  cairo_restore(c);
}

void Canvas::clipped(const Rectangle& r, const std::function<void()>& draw) {
  cairo_t* c = impl_->context.get();
  cairo_save(c);
  cairo_rectangle(c, r.x, r.y, r.width, r.height);
  cairo_clip(c);
  draw();
  cairo_restore(c);
}

std::string Canvas::svg() const {
  std::string text;
  {
    const Surface target(cairo_svg_surface_create_for_stream(append, &text, impl_->width, impl_->height));
    check(cairo_surface_status(target.get()));
    impl_->replay(target.get(), 1);
    cairo_surface_finish(target.get());
    check(cairo_surface_status(target.get()));
  }
  return impl_->described(std::move(text));
}

std::string Canvas::png(double scale) const {
  const double w = std::round(impl_->width * scale), h = std::round(impl_->height * scale);
  if (!(w >= 1 && h >= 1 && w <= 32767 && h <= 32767)) throw std::invalid_argument("a PNG of this scale can't be made");
  const Surface pixels(cairo_image_surface_create(CAIRO_FORMAT_RGB24, static_cast<int>(w), static_cast<int>(h)));
  check(cairo_surface_status(pixels.get()));
  impl_->replay(pixels.get(), scale);
  std::string bytes;
  check(cairo_surface_write_to_png_stream(pixels.get(), append, &bytes));
  return bytes;
}

}  // namespace selenograph::api
