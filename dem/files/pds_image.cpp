#include "dem/files/pds_image.h"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <filesystem>
#include <optional>
#include <string_view>

#include "dem/base/names.h"
#include "dem/files/pds_grid.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kFarthestByte =
    1'000'000'000'000'000;  // largest offset in a file: sums with row sizes then fit into 64 bits

// Returns the sample type by the names of the PDS Standards Reference, appendix C. Plain INTEGER, REAL and the like are
// MSB (Sun, Mac, IEEE).
RawSample sample_type(const PdsReader& image) {
  const std::string type = image.word("SAMPLE_TYPE");
  const int bits = image.count("SAMPLE_BITS");
  RawSample s;
  s.bytes = bits / 8;
  s.real = type.find("REAL") != std::string::npos || type == "FLOAT";
  s.has_sign = type.find("UNSIGNED") == std::string::npos;
  s.little_endian = type.starts_with("LSB_") || type.starts_with("PC_") || type.starts_with("VAX_");
  const bool integer = type.ends_with("INTEGER");
  if (integer && bits == 8) image.no_heights("samples of 8 bits are not heights");
  const bool vax_real = type.starts_with("VAX") && s.real;
  const bool known_size = s.real ? bits == 32 || bits == 64 : bits == 16 || bits == 32;
  if ((!integer && !s.real) || vax_real || !known_size)
    image.fail("samples of type '" + type + "' with " + std::to_string(bits) + " bits are not supported");
  return s;
}

// Returns the metres of a unit by its name in capitals, as labels spell it; empty if it is none of length.
std::optional<double> metres(std::string_view unit) {
  if (unit.starts_with("MET")) return 1;
  if (unit.starts_with("KILOMET")) return 1000;
  return metres_in(unit);
}

// Returns the metres of the image's UNIT; 1 without it.
double unit_in_metres(const PdsReader& image) {
  const std::string unit = image.word("UNIT");
  if (unit.empty() || unit == "N/A") return 1;
  if (const auto m = metres(unit)) return *m;
  image.no_heights(fmt::format("its UNIT '{}' is none of those in which heights are read: {}", unit, kLengthUnits));
}

// Returns SCALING_FACTOR or OFFSET in the image's unit; the keyword may have its own unit (km, m/DN).
double in_unit(const PdsReader& image, const char* keyword, double default_value, double unit_m) {
  const double x = image.number_or(keyword, default_value);
  const PdsValue* value = image.value(keyword);
  if (!value || value->unit.empty()) return x;
  const std::string unit = upper_case(value->unit);
  const auto own_m = metres(std::string_view(unit).substr(0, unit.find('/')));
  if (!own_m)
    image.fail(fmt::format("{} is in '{}', which is none of the units in which heights are read: {}", keyword,
                           value->unit, kLengthUnits));
  return x * (*own_m / unit_m);
}

// Returns OFFSET in the image's unit. Without its own unit, the Moon's radius is recognised in metres and in
// kilometres: some labels of samples in metres have OFFSET = 1737.4.
double offset_in_unit(const PdsReader& image, double unit_m) {
  const double offset = in_unit(image, "OFFSET", 0, unit_m);
  const PdsValue* value = image.value("OFFSET");
  if (!value || !value->unit.empty()) return offset;
  constexpr double kRadiusTolerance_m = 1000;
  for (const double own_unit_m : {1.0, 1000.0})
    if (std::abs(offset * own_unit_m - kMoonRadius_m) <= kRadiusTolerance_m) return offset * (own_unit_m / unit_m);
  return offset;
}

// Returns a void value. A bit pattern such as 16#FF7FFFFB# or 16#8000# stands for the number with those bits.
double void_of(const std::string& text, const RawSample& sample, double number) {
  const auto bits = parse_pds_based(text);
  if (!bits) return number;
  if (!sample.real) return sample.bytes == 2 ? static_cast<std::int16_t>(*bits) : number;
  return sample.bytes == 4 ? static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(*bits)))
                           : std::bit_cast<double>(*bits);
}

std::vector<double> void_values(const PdsReader& image, const RawSample& sample) {
  std::vector<double> voids;
  for (const char* keyword : {"DUMMY", "MISSING_CONSTANT", "MISSING", "INVALID_CONSTANT", "NOT_APPLICABLE_CONSTANT",
                              "NULL", "NULL_CONSTANT", "CORE_NULL", "INVALID_VALUE"}) {
    const PdsValue* v = image.value(keyword);
    for (std::size_t i = 0; v && i < v->items.size(); ++i)
      if (const auto x = v->number(i)) voids.push_back(void_of(v->items[i], sample, *x));
  }
  return voids;
}

// Returns the path of the data file in the label's folder: the name that the label gives, or the same name in another
// case (archives change the case of names, labels keep it).
fs::path find_data_file(const std::string& label_path, const std::string& name) {
  const fs::path folder = fs::path(label_path).parent_path();
  const fs::path data_path = folder / fs::path(name).filename();
  std::error_code error;
  if (fs::is_regular_file(data_path, error)) return data_path;
  for (const auto& entry : fs::directory_iterator(folder.empty() ? fs::path(".") : folder, error))
    if (same_text(entry.path().filename().string(), data_path.filename().string()))
      return folder / entry.path().filename();
  if (is_system_fault(error.value())) throw SystemFault(folder.string(), error.value());
  throw DataError(label_path, "its data file " + data_path.filename().string() + " is missing");
}

// Throws NotHeights for a label of a compressed file, which holds the described image. An uncompressed file of the name
// that the label gives has its own label, which may place it elsewhere.
void refuse_compressed(const PdsObject& label, const PdsReader& reader) {
  const PdsObject* compressed = label.find_object("COMPRESSED_FILE");
  if (!compressed) return;
  const PdsValue* name = compressed->find("FILE_NAME");
  reader.no_heights("describes the compressed file " + (name ? name->text() : std::string()) +
                    ", which is not read: use the uncompressed image with its own label");
}

// Returns false for names of formats with headers or compression.
bool has_raw_samples(const fs::path& data_path) {
  const std::string extension = lower(data_path.extension().string());
  for (const char* encoded : {".tif", ".tiff", ".jp2", ".jpg", ".png"})
    if (extension == encoded) return false;
  return true;
}

// Sets the data file and first byte from the pointer ^IMAGE = "FILE" | ("FILE", record) | ("FILE", n <BYTES>) | record
// | n <BYTES>; records and bytes count from 1.
void find_pixels(const PdsReader& label, const std::string& label_path, RawImage& out) {
  const PdsValue* pointer = label.value("^IMAGE");
  if (!pointer || pointer->items.empty()) label.fail("^IMAGE is missing");
  const bool attached = pointer->number(0).has_value();
  out.data_path = attached ? label_path : find_data_file(label_path, pointer->text()).string();
  if (!has_raw_samples(out.data_path))
    label.no_heights("describes " + fs::path(out.data_path).filename().string() + ", which holds no raw samples");
  const std::size_t position = attached ? 0 : 1;
  if (position >= pointer->items.size()) return;
  const auto start = pointer->number(position);
  if (!start || *start < 1 || *start > kFarthestByte || *start != std::floor(*start))
    label.fail("^IMAGE has no valid position");
  const auto before = static_cast<std::uint64_t>(*start) - 1;
  const bool bytes = upper_case(pointer->unit).starts_with("BYTE");
  const auto record = static_cast<std::uint64_t>(bytes || before == 0 ? 1 : label.count("RECORD_BYTES"));
  if (before > kFarthestByte / record) label.fail("^IMAGE has no valid position");
  out.first_byte = before * record;
}

// Throws DataError if the data file is shorter than the rows that its label describes.
void check_data_size(const std::string& label_path, const RawImage& image) {
  std::error_code error;
  const std::uint64_t have = fs::file_size(image.data_path, error);
  if (error && is_system_fault(error.value())) throw SystemFault(image.data_path, error.value());
  if (error) throw DataError(label_path, "its data file " + image.data_path + " cannot be read: " + error.message());
  const std::uint64_t rows = static_cast<std::uint64_t>(image.height) - 1;
  const std::uint64_t last = static_cast<std::uint64_t>(image.width) * static_cast<std::uint64_t>(image.sample.bytes);
  const std::uint64_t need = image.first_byte + rows * image.row_bytes + last;
  if (have < need)
    throw DataError(label_path, "its data file " + fs::path(image.data_path).filename().string() +
                                    " is truncated: it has " + std::to_string(have) + " bytes, the label asks for " +
                                    std::to_string(need));
}

std::string format_name(const PdsReader& label) {
  for (const char* keyword : {"MISSION_NAME", "INSTRUMENT_HOST_NAME", "DATA_SET_ID"}) {
    const std::string word = label.word(keyword);
    if (word.find("SELENE") != std::string::npos || word.starts_with("SLN-")) return "PDS3 Kaguya";
  }
  return label.word("INSTRUMENT_ID") == "LOLA" ? "PDS3 LOLA" : "PDS3";
}

}  // namespace

RawImage describe_pds_image(const PdsObject& label, const std::string& label_path) {
  const PdsObject* image_object = label.find_object("IMAGE");
  const PdsObject* map_object = label.find_object("IMAGE_MAP_PROJECTION");
  if (!image_object || !map_object)
    throw DataError(label_path, "describes no map (IMAGE or IMAGE_MAP_PROJECTION is missing)");
  const PdsReader label_reader(label, label_path), image(*image_object, label_path), map(*map_object, label_path);

  RawImage out;
  out.format = format_name(label_reader);
  out.synthetic = label_reader.word("DATA_SET_ID").starts_with("SYNTHETIC-SELENOGRAPH-");
  out.quantity = image.word("NAME") + " " + image.word("IMAGE_VALUE_TYPE");
  out.product = label_reader.word("PRODUCT_ID");
  refuse_compressed(label, label_reader);
  out.unit_m = unit_in_metres(image);
  out.width = image.count("LINE_SAMPLES");
  out.height = image.count("LINES");
  if (image.number_or("BANDS", 1) != 1) image.no_heights("has several BANDS; a height map has one");
  out.sample = sample_type(image);
  out.scale = in_unit(image, "SCALING_FACTOR", 1, out.unit_m);
  out.offset = offset_in_unit(image, out.unit_m);
  if (out.scale == 0) image.fail("SCALING_FACTOR is zero");
  out.voids = void_values(image, out.sample);

  const double prefix = image.number_or("LINE_PREFIX_BYTES", 0);
  const double suffix = image.number_or("LINE_SUFFIX_BYTES", 0);
  if (prefix < 0 || suffix < 0 || prefix + suffix > 1e6)
    image.fail("LINE_PREFIX_BYTES or LINE_SUFFIX_BYTES is impossible");
  out.row_bytes = static_cast<std::uint64_t>(out.width) * static_cast<std::uint64_t>(out.sample.bytes) +
                  static_cast<std::uint64_t>(prefix + suffix);
  find_pixels(label_reader, label_path, out);
  out.first_byte += static_cast<std::uint64_t>(prefix);
  out.sphere_m = pds_sphere_m(label_reader, map);
  out.grid = pds_grid(label_reader, map, out.sphere_m, out.width, out.height);
  check_data_size(label_path, out);
  return out;
}

}  // namespace selenograph::dem
