#include "api/canvas.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace selenograph::api {
namespace {

using Rgb = std::array<int, 3>;

struct Pixels {
  int width = 0, height = 0, channels = 0;
  std::vector<std::uint8_t> values;
  Rgb at(int x, int y) const {
    const std::size_t i = static_cast<std::size_t>(y * width + x) * static_cast<std::size_t>(channels);
    return {values[i], values[i + 1], values[i + 2]};
  }
};

Pixels decoded(const std::string& png) {
  OIIO::Filesystem::IOMemReader memory(png.data(), png.size());
  const auto input = OIIO::ImageInput::open("memory.png", nullptr, &memory);
  EXPECT_TRUE(input);
  Pixels pixels{input->spec().width, input->spec().height, input->spec().nchannels, {}};
  pixels.values.resize(input->spec().image_pixels() * static_cast<std::size_t>(pixels.channels));
  EXPECT_TRUE(input->read_image(0, 0, 0, pixels.channels, OIIO::TypeDesc::UINT8, pixels.values.data()));
  return pixels;
}

// Names of elements still open when each closes; enough XML for what has no comments or CDATA within.
bool well_formed(const std::string& xml) {
  std::vector<std::string> open;
  for (std::size_t i = xml.find('<'); i != std::string::npos; i = xml.find('<', i + 1)) {
    const std::size_t end = xml.find('>', i);
    if (end == std::string::npos) return false;
    const std::string tag = xml.substr(i + 1, end - i - 1);
    if (tag.empty()) return false;
    if (tag.front() == '?' || tag.back() == '/') continue;
    const std::string name = tag.substr(tag.front() == '/', tag.find_first_of(" \n") - (tag.front() == '/'));
    if (tag.front() != '/') {
      open.push_back(name);
    } else {
      if (open.empty() || open.back() != name) return false;
      open.pop_back();
    }
  }
  return open.empty() && xml.find("<svg") != std::string::npos;
}

int darkest(const Pixels& p, int x0, int y0, int x1, int y1) {
  int dark = 255;
  for (int y = y0; y < y1; ++y)
    for (int x = x0; x < x1; ++x) dark = std::min(dark, p.at(x, y)[1]);
  return dark;
}

TEST(Canvas, PngHasTheSizeAndTheColoursAskedFor) {
  Canvas canvas(60, 40);
  canvas.fill(Rectangle{10, 10, 20, 10}, {1, 0, 0});
  canvas.fill_circle({45, 20}, 8, {0, 0, 1});
  const Pixels p = decoded(canvas.png());
  ASSERT_EQ(p.width, 60);
  ASSERT_EQ(p.height, 40);
  EXPECT_EQ(p.at(0, 0), (Rgb{255, 255, 255}));
  EXPECT_EQ(p.at(10, 10), (Rgb{255, 0, 0}));
  EXPECT_EQ(p.at(29, 19), (Rgb{255, 0, 0}));
  EXPECT_EQ(p.at(30, 20), (Rgb{255, 255, 255}));
  EXPECT_EQ(p.at(45, 20), (Rgb{0, 0, 255}));
}

TEST(Canvas, ScaleMagnifiesTheSameDrawing) {
  Canvas canvas(30, 20);
  canvas.fill(Rectangle{10, 5, 10, 10}, {0, 0.5, 0});
  const Pixels p = decoded(canvas.png(2.5));
  ASSERT_EQ(p.width, 75);
  ASSERT_EQ(p.height, 50);
  EXPECT_EQ(p.at(26, 14), (Rgb{0, 128, 0}));
  EXPECT_EQ(p.at(24, 14), (Rgb{255, 255, 255}));
}

TEST(Canvas, PictureKeepsItsPixelsAndTheirPlaces) {
  Canvas canvas(50, 50);
  const std::vector<std::uint8_t> rgb{255, 0, 0, 0, 255, 0, 0, 0, 255, 10, 20, 30, 40, 50, 60, 70, 80, 90};
  canvas.picture({10, 10, 30, 20}, 3, 2, rgb);
  const Pixels p = decoded(canvas.png());
  EXPECT_EQ(p.at(10, 10), (Rgb{255, 0, 0}));
  EXPECT_EQ(p.at(19, 19), (Rgb{255, 0, 0}));
  EXPECT_EQ(p.at(20, 10), (Rgb{0, 255, 0}));
  EXPECT_EQ(p.at(39, 10), (Rgb{0, 0, 255}));
  EXPECT_EQ(p.at(10, 29), (Rgb{10, 20, 30}));
  EXPECT_EQ(p.at(39, 29), (Rgb{70, 80, 90}));
  EXPECT_EQ(p.at(40, 29), (Rgb{255, 255, 255}));
  EXPECT_THROW(canvas.picture({0, 0, 1, 1}, 2, 2, rgb), std::invalid_argument);
}

TEST(Canvas, ClippingEndsWithItsDrawing) {
  Canvas canvas(40, 20);
  canvas.clipped({0, 0, 20, 20}, [&] { canvas.fill(Rectangle{10, 0, 20, 10}, kBlack); });
  canvas.fill(Rectangle{30, 10, 10, 10}, kBlack);
  const Pixels p = decoded(canvas.png());
  EXPECT_EQ(p.at(15, 5), (Rgb{0, 0, 0}));
  EXPECT_EQ(p.at(25, 5), (Rgb{255, 255, 255}));
  EXPECT_EQ(p.at(35, 15), (Rgb{0, 0, 0}));
}

TEST(Canvas, TextStandsWhereItIsAnchored) {
  const double width = Canvas(10, 10).text_width("HHHH", 20);
  EXPECT_GT(width, 50);
  EXPECT_LT(width, 70);
  const auto drawn = [](Anchor anchor, double rotation_deg) {
    Canvas canvas(200, 200);
    canvas.text({100, 100}, "HHHH", {.size = 20, .anchor = anchor, .rotation_deg = rotation_deg});
    return decoded(canvas.png());
  };
  EXPECT_LT(darkest(drawn(Anchor::start, 0), 100, 85, 165, 100), 80);
  EXPECT_EQ(darkest(drawn(Anchor::start, 0), 0, 0, 99, 200), 255);
  EXPECT_EQ(darkest(drawn(Anchor::end, 0), 101, 0, 200, 200), 255);
  // Turned by 90 degrees it reads upwards, and stands at the left of its foot.
  EXPECT_LT(darkest(drawn(Anchor::start, 90), 84, 40, 101, 100), 80);
  EXPECT_EQ(darkest(drawn(Anchor::start, 90), 0, 101, 200, 200), 255);
  EXPECT_EQ(darkest(drawn(Anchor::start, 90), 102, 0, 200, 200), 255);
}

TEST(Canvas, SvgIsWellFormedAndTellsItsTexts) {
  Canvas canvas(120, 80);
  canvas.text({10, 20}, "errors < 1 mm & no bias", {});
  canvas.polyline(std::vector<Point>{{0, 0}, {50, 50}, {100, 20}}, {.dashes = {4, 2}});
  const std::string svg = canvas.svg();
  EXPECT_TRUE(well_formed(svg)) << svg;
  EXPECT_NE(svg.find("errors &lt; 1 mm &amp; no bias"), std::string::npos);
  EXPECT_NE(svg.find("width=\"120pt\""), std::string::npos);
}

TEST(Canvas, SamePngEveryTime) {
  const auto drawn = [] {
    Canvas canvas(80, 60);
    canvas.text({40, 30}, "same", {.anchor = Anchor::middle});
    canvas.marker(Marker::diamond, {20, 20}, 8, kPalette[1]);
    return canvas.png(2);
  };
  EXPECT_EQ(drawn(), drawn());
}

TEST(Canvas, SameFromEveryThread) {
  const auto drawn = [] {
    Canvas canvas(200, 60);
    for (int i = 0; i < 50; ++i)
      canvas.text({5.0 + i, 5.0 + i}, "text " + std::to_string(i), {.size = 8.0 + i % 7, .bold = i % 2 == 0});
    return canvas.png();
  };
  const std::string expected = drawn();
  std::vector<std::string> answers(8);
  std::vector<std::thread> threads;
  for (std::string& answer : answers) threads.emplace_back([&] { answer = drawn(); });
  for (std::thread& thread : threads) thread.join();
  for (const std::string& answer : answers) EXPECT_EQ(answer, expected);
}

TEST(Canvas, RefusesSizesThatAreNone) {
  EXPECT_THROW(Canvas(0, 10), std::invalid_argument);
  EXPECT_THROW(Canvas(10, 1e9), std::invalid_argument);
  EXPECT_THROW(Canvas(10, 10).png(0), std::invalid_argument);
}

}  // namespace
}  // namespace selenograph::api
