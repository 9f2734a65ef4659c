#include "api/encode/encode.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "api/encode/arrays.h"

namespace selenograph::api {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
const std::string kMeta = "{\"software\": \"selenograph\", \"products\": [\"radiance\"]}";

// A frame of 5 x 7 pixels with every product, values different everywhere, one pixel that hits nothing.
constexpr int kHeight = 5, kWidth = 7, kPixels = kHeight * kWidth, kMissing = 11;

template <typename Element>
std::vector<Element> values(int channels, double first, double step, Element missing) {
  std::vector<Element> result;
  for (int i = 0; i < kPixels * channels; ++i) {
    result.push_back(i / channels == kMissing ? missing : static_cast<Element>(first + step * i));
  }
  return result;
}

engine::Frame sample_frame() {
  const auto nanf = static_cast<float>(kNan);
  engine::Frame frame;
  engine::FrameProducts& p = frame.products;
  p.image = values<std::uint16_t>(1, 3, 7, 0);
  p.radiance = values<float>(1, 0.125, 0.01, 0.0f);
  p.depth = values<double>(1, 19876.54321, 1.0 / 3, kNan);
  p.range = values<double>(1, 19999.87654, 1.0 / 7, kNan);
  p.position = values<double>(3, -1737400.123456789, 1234.56789012345, kNan);
  p.geodetic = values<double>(3, -89.123456789012, 1.7654321, kNan);
  p.normal = values<float>(3, -0.9f, 0.01, nanf);
  p.angles = values<float>(3, 1.5f, 0.7, nanf);
  p.lit = values<float>(1, 0, 1.0 / 64, nanf);
  p.gsd = values<float>(1, 7.4f, 0.1, nanf);
  p.source = values<std::uint16_t>(1, 0, 1800, 65535);
  p.object_id = values<std::uint16_t>(1, 1, 1700, 65535);
  p.detail = values<std::uint16_t>(1, 0, 1, 65535);
  return frame;
}

engine::FrameRequest sample_request(int bit_depth) {
  engine::FrameRequest request;
  request.camera.width = kWidth;
  request.camera.height = kHeight;
  request.image.bit_depth = bit_depth;
  return request;
}

constexpr engine::ProductSet kAll = (1u << 13) - 1;

// A frame with its views.
struct Sample {
  explicit Sample(int bit_depth, engine::ProductSet wanted = kAll)
      : arrays(arrays_of(frame, sample_request(bit_depth), wanted, narrowed)) {}
  const ArrayView& operator[](std::string_view name) const {
    return *std::find_if(arrays.begin(), arrays.end(), [&](const ArrayView& a) { return a.name == name; });
  }

  engine::Frame frame = sample_frame();
  Narrowed narrowed;
  std::vector<ArrayView> arrays;
};

std::size_t size_bytes(const ArrayView& a) {
  return std::size_t(a.height) * std::size_t(a.width) * std::size_t(a.channels) * element_size(a.type);
}

// Bit for bit, so that NaN equals NaN.
testing::AssertionResult same_bytes(const void* bytes, const ArrayView& a) {
  if (std::memcmp(bytes, a.data, size_bytes(a)) == 0) return testing::AssertionSuccess();
  return testing::AssertionFailure() << a.name << " differs";
}

// --- reading back with OpenImageIO

struct Image {
  OIIO::ImageSpec spec;
  std::vector<unsigned char> native;  // pixels in the file's own types

  int channel(const std::string& name) const { return spec.channelindex(name); }
  template <typename Element>
  Element at(int pixel, int channel) const {
    Element value;
    const std::size_t offset = std::size_t(pixel) * spec.pixel_bytes(true) + spec.pixel_bytes(0, channel, true);
    std::memcpy(&value, native.data() + offset, sizeof value);
    return value;
  }
};

Image read_back(const std::string& bytes, const std::string& format) {
  OIIO::Filesystem::IOMemReader proxy(bytes.data(), bytes.size());
  const auto input = OIIO::ImageInput::open("memory." + format, nullptr, &proxy);
  if (!input) throw std::runtime_error(OIIO::geterror());
  Image image;
  image.spec = input->spec();
  image.native.resize(image.spec.image_bytes(true));
  if (!input->read_image(0, 0, 0, image.spec.nchannels, OIIO::TypeDesc::UNKNOWN, image.native.data())) {
    throw std::runtime_error(input->geterror());
  }
  return image;
}

// --- product names and views

TEST(Arrays, NamesAreThoseOfTheContractInItsOrder) {
  std::vector<std::string> names;
  for (const ProductRow& entry : products()) {
    names.emplace_back(entry.name);
    EXPECT_EQ(name_of(entry.product), entry.name);
  }
  EXPECT_EQ(names,
            (std::vector<std::string>{"image", "radiance", "depth", "range", "position", "geodetic", "normal", "angles",
                                      "lit", "gsd", "source", "object_id", "detail", "albedo", "irradiance", "flow"}));
}

TEST(Arrays, TypesAndShapesAreThoseOfTheContract) {
  const Sample sample(16);
  std::vector<std::string> seen;
  for (const ArrayView& a : sample.arrays) {
    EXPECT_EQ(a.height, kHeight);
    EXPECT_EQ(a.width, kWidth);
    EXPECT_EQ(a.channel_names.size(), std::size_t(a.channels));
    seen.push_back(std::string(a.name) + " " + numpy_descr(a.type) + " " + std::to_string(a.channels));
  }
  EXPECT_EQ(seen,
            (std::vector<std::string>{"image <u2 1", "radiance <f4 1", "depth <f8 1", "range <f8 1", "position <f8 3",
                                      "geodetic <f8 3", "normal <f4 3", "angles <f4 3", "lit <f4 1", "gsd <f4 1",
                                      "source <u2 1", "object_id <u2 1", "detail <u2 1"}));
}

TEST(Arrays, AnEightBitImageIsNarrowed) {
  const Sample sample(8, engine::kImage);
  EXPECT_EQ(sample["image"].type, ElementType::uint8);
  const auto* narrowed = static_cast<const std::uint8_t*>(sample["image"].data);
  for (int i = 0; i < kPixels; ++i) EXPECT_EQ(narrowed[i], sample.frame.products.image[std::size_t(i)]);
}

// Halves around 2049 are 2048 and 2050, and floats 0.0002 apart.
TEST(Arrays, AHalfIsRoundedOnce) {
  engine::FrameRequest request;
  request.camera.width = 6, request.camera.height = 1;
  engine::TruthGrid& truth = request.truth.emplace();
  truth.width = 6, truth.height = 1, truth.distances = engine::TruthGrid::Floats::float16;
  engine::Frame frame;
  frame.products.depth = {2049 - 1e-6, 2049, 2049 + 1e-6, 2051 - 1e-6, 2051, kNan};
  Narrowed narrowed;
  ASSERT_EQ(arrays_of(frame, request, engine::kDepth, narrowed).size(), 1u);
  const std::uint16_t rounded[] = {0x6800, 0x6800, 0x6801, 0x6801, 0x6802};  // 2048, 2050 and 2052
  for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ(narrowed.half_depth[i].bits, rounded[i]) << i;
  EXPECT_EQ(narrowed.half_depth[5].bits & 0x7c00, 0x7c00);
  EXPECT_NE(narrowed.half_depth[5].bits & 0x03ff, 0) << "not a NaN";
}

TEST(Arrays, MissingProductThrows) {
  engine::Frame frame = sample_frame();
  frame.products.lit.clear();
  Narrowed narrowed;
  EXPECT_THROW(arrays_of(frame, sample_request(8), engine::kLit, narrowed), std::logic_error);
  EXPECT_EQ(arrays_of(frame, sample_request(8), engine::kGsd, narrowed).size(), 1u);
}

// --- raw, npy, npz

TEST(Npy, HasTheHeaderOfVersionOneAndAlignedData) {
  const Sample sample(8);
  for (const ArrayView& a : sample.arrays) {
    const std::string bytes = encode_npy(a);
    EXPECT_EQ(bytes.substr(0, 8), std::string("\x93NUMPY\x01\x00", 8));
    const std::size_t start = 10 + std::size_t(static_cast<unsigned char>(bytes[8])) +
                              256 * std::size_t(static_cast<unsigned char>(bytes[9]));
    EXPECT_EQ(start % 64, 0u);
    ASSERT_EQ(bytes.size(), start + size_bytes(a));
    EXPECT_TRUE(same_bytes(bytes.data() + start, a));
    const std::string header = bytes.substr(10, start - 10);
    EXPECT_EQ(header.back(), '\n');
    const std::string shape = a.channels == 3 ? "(5, 7, 3)" : "(5, 7)";
    EXPECT_EQ(header.find("{'descr': '" + numpy_descr(a.type) + "', 'fortran_order': False, 'shape': " + shape + ", }"),
              0u)
        << header;
  }
}

TEST(Npz, RefusesTwoArraysOfOneName) {
  const Sample sample(16);
  EXPECT_THROW(encode_npz({sample["depth"], sample["depth"]}, kMeta), std::invalid_argument);
}

TEST(Npz, HoldsMetadataAlone) { EXPECT_NE(encode_npz({}, kMeta).find(kMeta), std::string::npos); }

// --- images

// Kinds of a PNG file's chunks, in their order; several of one kind as one.
std::string chunk_kinds(const std::string& png) {
  std::string kinds, last;
  for (std::size_t at = 8; at + 12 <= png.size();) {
    std::size_t bytes = 0;
    for (std::size_t i = 0; i < 4; ++i) bytes = 256 * bytes + static_cast<unsigned char>(png[at + i]);
    const std::string kind = png.substr(at + 4, 4);
    if (kind != last) kinds += " " + kind;
    last = kind;
    at += 12 + bytes;
  }
  return kinds;
}

TEST(Png, HasTheSameChunksWhateverTheLibrary) {
  const Sample sample(8, engine::kImage);
  EXPECT_EQ(chunk_kinds(encode_png(sample["image"], {{"selenograph", kMeta}})), " IHDR oFFs tEXt IDAT IEND");
}

TEST(Png, GivesTheNumbersBack) {
  for (const int bit_depth : {8, 16}) {
    const Sample sample(bit_depth, engine::kImage);
    const std::string bytes = encode_png(sample["image"], {{"selenograph", kMeta}});
    EXPECT_EQ(bytes.substr(0, 8), "\x89PNG\r\n\x1a\n");
    const Image image = read_back(bytes, "png");
    EXPECT_EQ(image.spec.width, kWidth);
    EXPECT_EQ(image.spec.height, kHeight);
    EXPECT_EQ(image.spec.nchannels, 1);
    EXPECT_EQ(image.spec.format.size(), std::size_t(bit_depth) / 8);
    EXPECT_TRUE(same_bytes(image.native.data(), sample["image"]));
    EXPECT_EQ(image.spec.get_string_attribute("selenograph"), kMeta);
  }
}

TEST(Tiff, GivesEveryTypeBack) {
  for (const int bit_depth : {8, 16}) {
    const Sample sample(bit_depth);
    for (const ArrayView& a : sample.arrays) {
      const Image image = read_back(encode_tiff(a, {{"selenograph", kMeta}}), "tif");
      EXPECT_EQ(image.spec.width, kWidth);
      EXPECT_EQ(image.spec.height, kHeight);
      EXPECT_EQ(image.spec.nchannels, a.channels);
      EXPECT_EQ(image.spec.format.size(), element_size(a.type));
      EXPECT_EQ(image.spec.format.is_floating_point(),
                a.type == ElementType::float32 || a.type == ElementType::float64);
      EXPECT_TRUE(same_bytes(image.native.data(), a));
      EXPECT_EQ(image.spec.get_string_attribute("ImageDescription"), kMeta);
    }
  }
}

TEST(Tiff, KeepsEveryAttributeOnALineOfItsOwn) {
  const Sample sample(8, engine::kLit);
  const Image image = read_back(encode_tiff(sample["lit"], {{"a", "one"}, {"b", "two"}}), "tif");
  EXPECT_EQ(image.spec.get_string_attribute("ImageDescription"), "one\ntwo");
}

TEST(Exr, HasAllProductsAsNamedChannels) {
  const Sample sample(16);
  const Image image = read_back(encode_exr(sample.arrays, {{"selenograph", kMeta}}), "exr");
  EXPECT_EQ(image.spec.width, kWidth);
  EXPECT_EQ(image.spec.height, kHeight);
  std::vector<std::string> names = image.spec.channelnames;
  std::sort(names.begin(), names.end());
  EXPECT_EQ(fmt::format("{}", fmt::join(names, " ")),
            "angles.emission_deg angles.incidence_deg angles.phase_deg depth depth.residual detail geodetic.height_m "
            "geodetic.height_m.residual geodetic.lat_deg geodetic.lat_deg.residual geodetic.lon_deg "
            "geodetic.lon_deg.residual gsd image lit normal.x normal.y normal.z object_id position.x "
            "position.x.residual position.y position.y.residual position.z position.z.residual radiance range "
            "range.residual source");
  EXPECT_EQ(image.spec.get_string_attribute("selenograph"), kMeta);
}

TEST(Exr, IntegersStayIntegers) {
  for (const int bit_depth : {8, 16}) {
    const Sample sample(bit_depth, engine::kImage | engine::kSource | engine::kRadiance);
    const Image image = read_back(encode_exr(sample.arrays, {}), "exr");
    const engine::FrameProducts& p = sample.frame.products;
    for (const auto& [name, numbers] : {std::pair{"image", &p.image}, std::pair{"source", &p.source}}) {
      const int channel = image.channel(name);
      ASSERT_EQ(image.spec.channelformat(channel), OIIO::TypeDesc::UINT32);
      for (int i = 0; i < kPixels; ++i) EXPECT_EQ(image.at<std::uint32_t>(i, channel), (*numbers)[std::size_t(i)]);
    }
  }
}

TEST(Exr, FloatsComeBackBitForBit) {
  const Sample sample(16);
  const Image image = read_back(encode_exr(sample.arrays, {}), "exr");
  for (const char* name : {"radiance", "normal", "angles", "lit", "gsd"}) {
    const ArrayView& a = sample[name];
    const auto* expected = static_cast<const float*>(a.data);
    for (int c = 0; c < a.channels; ++c) {
      const int channel = image.channel(a.channel_names[std::size_t(c)]);
      ASSERT_EQ(image.spec.channelformat(channel), OIIO::TypeDesc::FLOAT);
      for (int i = 0; i < kPixels; ++i) {
        EXPECT_EQ(std::bit_cast<std::uint32_t>(image.at<float>(i, channel)),
                  std::bit_cast<std::uint32_t>(expected[i * a.channels + c]));
      }
    }
  }
}

TEST(Exr, ValueAndResidualRestoreTheDouble) {
  const Sample sample(16);
  const Image image = read_back(encode_exr(sample.arrays, {}), "exr");
  double largest_float_error_m = 0;
  for (const char* name : {"depth", "range", "position", "geodetic"}) {
    const ArrayView& a = sample[name];
    const auto* expected = static_cast<const double*>(a.data);
    for (int c = 0; c < a.channels; ++c) {
      const std::string& channel_name = a.channel_names[std::size_t(c)];
      const int value = image.channel(channel_name), residual = image.channel(channel_name + ".residual");
      for (int i = 0; i < kPixels; ++i) {
        const double truth = expected[i * a.channels + c];
        const double restored = double{image.at<float>(i, value)} + double{image.at<float>(i, residual)};
        if (i == kMissing) {
          EXPECT_TRUE(std::isnan(truth) && std::isnan(restored));
          continue;
        }
        EXPECT_LE(std::abs(restored - truth), std::ldexp(std::abs(truth), -49)) << channel_name;
        largest_float_error_m = std::max(largest_float_error_m, std::abs(image.at<float>(i, value) - truth));
      }
    }
  }
  EXPECT_GT(largest_float_error_m, 0.01);  // what the residual is for
}

// More rows than are handed over at a time.
TEST(Exr, TallImagesAreWhole) {
  std::vector<std::uint16_t> numbers(3 * 41);
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = static_cast<std::uint16_t>(i);
  const ArrayView a{"source", ElementType::uint16, 41, 3, 1, numbers.data(), {"source"}};
  const Image image = read_back(encode_exr({a}, {}), "exr");
  ASSERT_EQ(image.spec.height, 41);
  for (std::size_t i = 0; i < numbers.size(); ++i) EXPECT_EQ(image.at<std::uint32_t>(int(i), 0), i);
}

TEST(Images, RejectUnsupportedArrays) {
  const Sample sample(16);
  EXPECT_THROW(encode_png(sample["radiance"], {}), std::invalid_argument);
  EXPECT_THROW(encode_png(sample["position"], {}), std::invalid_argument);
  ArrayView colour = sample["image"];
  colour.width = 1;
  colour.channels = 3;
  EXPECT_THROW(encode_png(colour, {}), std::invalid_argument);
  ArrayView empty = sample["lit"];
  empty.height = 0;
  EXPECT_THROW(encode_tiff(empty, {}), std::invalid_argument);
  ArrayView four = sample["normal"];
  four.channels = 4;
  EXPECT_THROW(encode_tiff(four, {}), std::invalid_argument);
  ArrayView narrower = sample["lit"];
  narrower.width -= 1;
  EXPECT_THROW(encode_exr({sample["gsd"], narrower}, {}), std::invalid_argument);
  EXPECT_THROW(encode_exr({}, {}), std::invalid_argument);
}

// Formats with a date resolve seconds, zip two: a stamp would show after more than two seconds.
TEST(Encoders, GiveTheSameBytesAtAnyTime) {
  const Sample sample(16);
  const Attributes attributes = {{"selenograph", kMeta}};
  const auto everything = [&] {
    std::vector<std::string> all = {encode_npz(sample.arrays, kMeta), encode_png(sample["image"], attributes),
                                    encode_exr(sample.arrays, attributes)};
    for (const ArrayView& a : sample.arrays) {
      all.push_back(encode_npy(a));
      all.push_back(encode_tiff(a, attributes));
    }
    return all;
  };
  const std::vector<std::string> now = everything();
  std::this_thread::sleep_for(std::chrono::milliseconds(2100));
  EXPECT_EQ(everything(), now);
}

TEST(Encoders, LeaveNoDateOrLibraryVersionBehind) {
  const Sample sample(16);
  for (const auto& [bytes, format] :
       {std::pair{encode_png(sample["image"], {}), "png"}, std::pair{encode_tiff(sample["depth"], {}), "tif"},
        std::pair{encode_exr(sample.arrays, {}), "exr"}}) {
    const Image image = read_back(bytes, format);
    EXPECT_EQ(image.spec.find_attribute("DateTime"), nullptr) << format;
    EXPECT_EQ(image.spec.find_attribute("Software"), nullptr) << format;
  }
}

}  // namespace
}  // namespace selenograph::api
