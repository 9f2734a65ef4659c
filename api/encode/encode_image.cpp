// The image library: PNG, TIFF and OpenEXR through OpenImageIO, in memory.
#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "api/encode/arrays.h"
#include "api/encode/image_library.h"
#include "dem/base/error.h"

namespace selenograph::api {
namespace {

OIIO::TypeDesc oiio_type(ElementType type) {
  switch (type) {
    case ElementType::boolean:
    case ElementType::uint8:
      return OIIO::TypeDesc::UINT8;
    case ElementType::uint16:
      return OIIO::TypeDesc::UINT16;
    case ElementType::float16:
      return OIIO::TypeDesc::HALF;
    case ElementType::uint64:
      return OIIO::TypeDesc::UINT64;
    case ElementType::float32:
      return OIIO::TypeDesc::FLOAT;
    case ElementType::float64:
      return OIIO::TypeDesc::DOUBLE;
  }
  throw std::invalid_argument("unknown element type");
}

// Throws std::invalid_argument for an array that no image format can hold.
void check_shape(const ArrayView& array, const char* format) {
  if (array.height <= 0 || array.width <= 0) throw std::invalid_argument(std::string(format) + ": the array is empty");
  if (array.channels < 1 || array.channels > 3) {
    throw std::invalid_argument(std::string(format) + ": " + std::string(array.name) + " has " +
                                std::to_string(array.channels) + " channels, not 1 to 3");
  }
}

// Output of OpenImageIO: it writes directly into the answer, which therefore never exists twice in memory.
// (OpenImageIO's own IOVecOutput is a vector of unsigned char, which would have to be copied into the answer's
// std::string.)
class Destination : public OIIO::Filesystem::IOProxy {
 public:
  explicit Destination(std::size_t expected_bytes) : IOProxy("", Write) { bytes_.reserve(expected_bytes); }
  std::string take() { return std::move(bytes_); }

  const char* proxytype() const override { return "selenograph"; }
  void close() override {}
  bool opened() const override { return true; }
  std::size_t size() const override { return bytes_.size(); }
  std::size_t write(const void* data, std::size_t size) override {
    const std::size_t written = pwrite(data, size, m_pos);
    m_pos += static_cast<std::int64_t>(written);
    return written;
  }
  // Overwrites what has been written behind `offset`, and appends the rest: OpenImageIO seeks back to complete headers.
  std::size_t pwrite(const void* data, std::size_t size, std::int64_t offset) override {
    const auto position = static_cast<std::size_t>(offset);
    if (bytes_.size() < position) bytes_.resize(position);
    const auto* from = static_cast<const char*>(data);
    const std::size_t overwritten = std::min(size, bytes_.size() - position);
    bytes_.replace(position, overwritten, from, overwritten);
    bytes_.append(from + overwritten, size - overwritten);
    return size;
  }

 private:
  std::string bytes_;
};

// A file in memory, open for writing.
class Writer {
 public:
  Writer(const char* format, const OIIO::ImageSpec& spec, const StopToken& stop)
      : format_(format), stop_(stop), destination_(spec.image_bytes(true) + 65536) {
    output_ = OIIO::ImageOutput::create(format_, &destination_);
    if (!output_) throw std::runtime_error(format_ + ": " + OIIO::geterror());
    check(output_->open("memory." + format_, spec));
  }

  void write(const OIIO::TypeDesc& type, const void* pixels) {
    const auto stopped = [](void* stop, float) { return static_cast<const StopToken*>(stop)->stopped(); };
    check(output_->write_image(type, pixels, OIIO::AutoStride, OIIO::AutoStride, OIIO::AutoStride, stopped,
                               const_cast<StopToken*>(&stop_)));
    stop_.check();  // write_image() reports success when the callback stops it
  }

  // Writes scanlines whose pixels have each channel's own element type, interleaved.
  void write_rows(int first, int past_last, const void* pixels) {
    stop_.check();
    check(output_->write_scanlines(first, past_last, 0, OIIO::TypeDesc::UNKNOWN, pixels));
  }

  std::string finish() {
    check(output_->close());
    return destination_.take();
  }

 private:
  void check(bool success) const {
    if (!success) throw std::runtime_error(format_ + ": " + output_->geterror());
  }

  std::string format_;
  const StopToken& stop_;
  Destination destination_;
  std::unique_ptr<OIIO::ImageOutput> output_;  // last member, destroyed first: it writes to destination_ until closed
};

// --- OpenEXR

// One channel of the file: a component of an array, and its conversion to a 32-bit word. A double becomes two channels:
// the value rounded to float, and the residual.
struct ExrChannel {
  // integer: uint8 or uint16 to uint32; half: to float; single: none; rounded and residual: of a double.
  enum class Conversion { integer, half, single, rounded, residual };
  std::string name;
  const ArrayView* array;
  int component;
  Conversion conversion;
};

// Returns the channels of all arrays, in the order in which a pixel's words are interleaved.
std::vector<ExrChannel> exr_channels(const std::vector<ArrayView>& arrays) {
  using Conversion = ExrChannel::Conversion;
  std::vector<ExrChannel> channels;
  for (const ArrayView& array : arrays) {
    if (array.channel_names.size() != std::size_t(array.channels)) {
      throw std::invalid_argument("exr: " + std::string(array.name) + " has no name for each of its channels");
    }
    if (array.type == ElementType::uint64 || array.type == ElementType::boolean)
      throw std::invalid_argument("exr: " + std::string(array.name) + " is of a type that it does not have");
    for (int c = 0; c < array.channels; ++c) {
      const std::string& name = array.channel_names[std::size_t(c)];
      if (array.type == ElementType::float64) {
        channels.push_back({name, &array, c, Conversion::rounded});
        channels.push_back({name + ".residual", &array, c, Conversion::residual});
      } else {
        channels.push_back({name, &array, c,
                            array.type == ElementType::float32   ? Conversion::single
                            : array.type == ElementType::float16 ? Conversion::half
                                                                 : Conversion::integer});
      }
    }
  }
  return channels;
}

// Returns what rounding to float removed; 0 for NaN and infinity, so that their sum with the residual stays NaN or
// infinite.
float residual(double value) {
  const float rounded = static_cast<float>(value);
  return std::isfinite(rounded) ? static_cast<float>(value - rounded) : 0.0f;
}

// Converts `count` elements, every `from_stride`-th, and writes them to every `to_stride`-th 32-bit word.
template <typename Element, typename Convert>
void interleave(const Element* from, int from_stride, std::uint32_t* to, std::size_t to_stride, int count,
                Convert convert) {
  for (int i = 0; i < count; ++i, from += from_stride, to += to_stride)
    *to = std::bit_cast<std::uint32_t>(convert(*from));
}

// Writes row `y` of a channel to every `stride`-th word: a pixel's words are the channels' values, one after the other.
void interleave_row(const ExrChannel& channel, int y, std::uint32_t* to, std::size_t stride) {
  const ArrayView& a = *channel.array;
  const std::size_t first_element =
      std::size_t(y) * std::size_t(a.width) * std::size_t(a.channels) + std::size_t(channel.component);
  const auto interleave_as = [&](const auto* data, auto convert) {
    interleave(data + first_element, a.channels, to, stride, a.width, convert);
  };
  switch (channel.conversion) {
    case ExrChannel::Conversion::half:
      return interleave_as(static_cast<const Half*>(a.data), [](Half v) {
        return Eigen::half_impl::half_to_float(Eigen::half_impl::raw_uint16_to_half(v.bits));
      });
    case ExrChannel::Conversion::single:
      return interleave_as(static_cast<const float*>(a.data), [](float v) { return v; });
    case ExrChannel::Conversion::rounded:
      return interleave_as(static_cast<const double*>(a.data), [](double v) { return static_cast<float>(v); });
    case ExrChannel::Conversion::residual:
      return interleave_as(static_cast<const double*>(a.data), residual);
    case ExrChannel::Conversion::integer:
      break;
  }
  const auto widen = [](auto v) { return std::uint32_t{v}; };
  if (a.type == ElementType::uint8) return interleave_as(static_cast<const std::uint8_t*>(a.data), widen);
  interleave_as(static_cast<const std::uint16_t*>(a.data), widen);
}

OIIO::ImageSpec exr_spec(const std::vector<ArrayView>& arrays, const std::vector<ExrChannel>& channels) {
  OIIO::ImageSpec spec(arrays.front().width, arrays.front().height, int(channels.size()), OIIO::TypeDesc::FLOAT);
  spec.alpha_channel = spec.z_channel = -1;  // a fourth channel is not transparency here
  spec.channelnames.clear();
  for (const ExrChannel& channel : channels) {
    spec.channelnames.push_back(channel.name);
    spec.channelformats.push_back(channel.conversion == ExrChannel::Conversion::integer ? OIIO::TypeDesc::UINT32
                                                                                        : OIIO::TypeDesc::FLOAT);
  }
  // Do not compress: zip saves a sixth of positions and next to nothing of residuals, and takes five times as long.
  spec.attribute("compression", "none");
  spec.attribute("DateTime", "");  // prevents OpenImageIO from writing the local time
  return spec;
}

// Removes the empty Exif chunk that OpenImageIO 2.5 puts behind the header: files have the same bytes without it.
void remove_exif(std::string& png) {
  constexpr std::size_t kHeaderEnd = 8 + 25, kChunkOverhead = 12;  // signature, IHDR; length, kind and checksum
  if (png.compare(kHeaderEnd + 4, 4, "eXIf") != 0) return;
  std::size_t bytes = 0;
  for (std::size_t i = 0; i < 4; ++i) bytes = 256 * bytes + static_cast<unsigned char>(png[kHeaderEnd + i]);
  png.erase(kHeaderEnd, kChunkOverhead + bytes);
}

std::string png(const ArrayView& array, const Attributes& attributes, const StopToken& stop) {
  check_shape(array, "png");
  if (array.channels != 1 || (array.type != ElementType::uint8 && array.type != ElementType::uint16)) {
    throw std::invalid_argument("png: " + std::string(array.name) + " is not one channel of uint8 or uint16");
  }
  const OIIO::TypeDesc type = oiio_type(array.type);
  OIIO::ImageSpec spec(array.width, array.height, 1, type);
  for (const auto& [name, value] : attributes) spec.attribute(name, value);
  spec.attribute("png:compressionLevel", 1);  // level 6 takes four times as long for 6 % less
  Writer writer("png", spec, stop);
  writer.write(type, array.data);
  std::string file = writer.finish();
  remove_exif(file);
  return file;
}

std::string tiff(const ArrayView& array, const Attributes& attributes, const StopToken& stop) {
  check_shape(array, "tiff");
  const OIIO::TypeDesc type = oiio_type(array.type);
  OIIO::ImageSpec spec(array.width, array.height, array.channels, type);
  std::string description;
  for (const auto& [name, value] : attributes) description += (description.empty() ? "" : "\n") + value;
  if (!description.empty()) spec.attribute("ImageDescription", description);
  spec.attribute("compression", "none");  // as for OpenEXR; every reader supports it
  // Prevent OpenImageIO from writing the local time. A number is not written at all; an empty text would be a malformed
  // tag.
  spec.attribute("DateTime", 0);
  // Prevent OpenImageIO from repeating both attributes in an Exif directory, which has no such tags: libtiff would
  // report three errors.
  spec.attribute("tiff:write_exif", 0);
  Writer writer("tiff", spec, stop);
  writer.write(type, array.data);
  return writer.finish();
}

std::string exr(const std::vector<ArrayView>& arrays, const Attributes& attributes, const StopToken& stop) {
  if (arrays.empty()) throw std::invalid_argument("exr: no arrays");
  const int height = arrays.front().height, width = arrays.front().width;
  for (const ArrayView& array : arrays) {
    check_shape(array, "exr");
    if (array.height != height || array.width != width) {
      throw std::invalid_argument("exr: " + std::string(array.name) + " has another size than the rest");
    }
  }
  const std::vector<ExrChannel> channels = exr_channels(arrays);
  OIIO::ImageSpec spec = exr_spec(arrays, channels);
  for (const auto& [name, value] : attributes) spec.attribute(name, value);
  Writer writer("exr", spec, stop);
  constexpr int kRows = 16;  // few enough to stay in the processor's cache
  const std::size_t row_words = std::size_t(width) * channels.size();
  std::vector<std::uint32_t> rows(kRows * row_words);  // interleaved words of up to kRows rows
  for (int y = 0; y < height; y += kRows) {
    const int past_last = std::min(y + kRows, height);
    for (int row = y; row < past_last; ++row) {
      std::uint32_t* const to = rows.data() + std::size_t(row - y) * row_words;
      for (std::size_t c = 0; c < channels.size(); ++c) interleave_row(channels[c], row, to + c, channels.size());
    }
    writer.write_rows(y, past_last, rows.data());
  }
  return writer.finish();
}

void read(const std::string& path, const std::function<double*(const ImageSize&)>& destination) {
  OIIO::attribute("threads", 1);  // the calling process has little memory, and each thread would take stack
  const auto input = OIIO::ImageInput::open(path);
  if (!input) throw DataError(path, "cannot be read as an image: " + OIIO::geterror());
  const OIIO::ImageSpec& spec = input->spec();
  const ImageSize size{static_cast<std::size_t>(spec.width), static_cast<std::size_t>(spec.height), spec.nchannels,
                       spec.format.c_str(), spec.format.is_floating_point()};
  if (!input->read_image(0, 0, 0, size.channels, OIIO::TypeDesc::DOUBLE, destination(size)))
    throw DataError(path, "cannot be read: " + input->geterror());
}

}  // namespace

extern "C" const ImageLibrary selenograph_image_library{png, tiff, exr, read};

}  // namespace selenograph::api
