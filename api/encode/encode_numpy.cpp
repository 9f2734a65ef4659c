// Encodes raw arrays, NPY and NPZ. The NPY layout is NumPy Enhancement Proposal 1 (Robert Kern, 2007), version 1.0.
#include <zip.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <utility>

#include "api/encode/encode.h"

namespace selenograph::api {

static_assert(std::endian::native == std::endian::little, "raw and npy promise little-endian elements");

namespace {

std::size_t array_bytes(const ArrayView& array) {
  return std::size_t(array.height) * std::size_t(array.width) * std::size_t(array.channels) * element_size(array.type);
}

const char* data_of(const ArrayView& array) { return static_cast<const char*>(array.data); }

// Returns the bytes in front of an array's elements.
std::string npy_header(const ArrayView& array) {
  std::string shape = std::to_string(array.height) + ", " + std::to_string(array.width);
  if (array.channels > 1) shape += ", " + std::to_string(array.channels);
  if (!array.shape.empty()) {
    shape.clear();
    for (const std::size_t n : array.shape) shape += std::to_string(n) + ", ";
    if (array.shape.size() > 1) shape.resize(shape.size() - 2);  // Python needs the comma in (n, ) only
  }
  std::string dictionary =
      "{'descr': '" + numpy_descr(array.type) + "', 'fortran_order': False, 'shape': (" + shape + "), }";
  // The preamble is magic, version and length. Aligned data can be mapped into memory.
  constexpr std::size_t kPreamble = 10, kAlignment = 64;
  const std::size_t unpadded = kPreamble + dictionary.size() + 1;  // with the final newline
  dictionary.append((kAlignment - unpadded % kAlignment) % kAlignment, ' ');
  dictionary += '\n';
  std::string header("\x93NUMPY\x01\x00", 8);
  header += char(dictionary.size() & 0xff);
  header += char(dictionary.size() >> 8);
  return header + dictionary;
}

// --- zip

struct Discard {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
struct Free {
  void operator()(zip_source_t* source) const { zip_source_free(source); }
};
using Archive = std::unique_ptr<zip_t, Discard>;
using Source = std::unique_ptr<zip_source_t, Free>;

[[noreturn]] void fail(const std::string& what) { throw std::runtime_error("npz: " + what); }

// Adds a member made of fragments, which must outlive the archive: nothing is copied until the archive is written.
void add_member(zip_t* archive, const std::string& name, std::vector<zip_buffer_fragment_t> fragments, bool deflated) {
  Source source(zip_source_buffer_fragment_create(fragments.data(), fragments.size(), 0, nullptr));
  if (!source) fail("no memory for " + name);
  const zip_int64_t index = zip_file_add(archive, name.c_str(), source.get(), ZIP_FL_ENC_UTF_8);
  if (index < 0) {
    if (zip_error_code_zip(zip_get_error(archive)) == ZIP_ER_EXISTS) {
      throw std::invalid_argument("npz: two members are called " + name);
    }
    fail(name + ": " + zip_strerror(archive));
  }
  source.release();  // NOLINT(bugprone-unused-return-value): the archive owns it now
  // Store members by default: on one core the fastest deflate takes 16-21 ms per MB, half a second for a megapixel of
  // positions. It saves a sixth of positions and a third of radiance. Set the date to the first that zip can represent,
  // 1980-01-01, so that equal frames have equal bytes.
  constexpr zip_uint16_t kFirstDosDate = (1 << 5) | 1;
  constexpr zip_uint32_t kFastest = 1;
  if (zip_set_file_compression(archive, zip_uint64_t(index), deflated ? ZIP_CM_DEFLATE : ZIP_CM_STORE, kFastest) != 0 ||
      zip_file_set_dostime(archive, zip_uint64_t(index), 0, kFirstDosDate, 0) != 0) {
    fail(name + ": " + zip_strerror(archive));
  }
}

zip_buffer_fragment_t fragment(const char* data, std::size_t size) {
  // libzip's fragments are not const but are only read, as zip_source_buffer_create's const argument shows.
  return {reinterpret_cast<zip_uint8_t*>(const_cast<char*>(data)), size};
}

// Output of libzip: it writes directly into the answer, which therefore never exists twice in memory.
class ZipDestination {
 public:
  ZipDestination(std::size_t expected_bytes, const StopToken& stop) : stop_(stop) { bytes_.reserve(expected_bytes); }
  std::string take() { return std::move(bytes_); }

  // Callback of zip_source_function_create(). libzip begins, writes, seeks back to complete a member's header, and
  // commits.
  static zip_int64_t call(void* self, void* data, zip_uint64_t size, zip_source_cmd_t command) {
    return static_cast<ZipDestination*>(self)->answer(data, size, command);
  }

 private:
  zip_int64_t answer(void* data, zip_uint64_t size, zip_source_cmd_t command) {
    switch (static_cast<int>(command)) {  // as int: newer versions of libzip have more commands
      case ZIP_SOURCE_SUPPORTS:
        return zip_source_make_command_bitmap(
            ZIP_SOURCE_OPEN, ZIP_SOURCE_READ, ZIP_SOURCE_CLOSE, ZIP_SOURCE_STAT, ZIP_SOURCE_ERROR, ZIP_SOURCE_FREE,
            ZIP_SOURCE_SEEK, ZIP_SOURCE_TELL, ZIP_SOURCE_BEGIN_WRITE, ZIP_SOURCE_WRITE, ZIP_SOURCE_COMMIT_WRITE,
            ZIP_SOURCE_ROLLBACK_WRITE, ZIP_SOURCE_SEEK_WRITE, ZIP_SOURCE_TELL_WRITE, ZIP_SOURCE_REMOVE, -1);
      case ZIP_SOURCE_STAT:
        zip_stat_init(static_cast<zip_stat_t*>(data));
        static_cast<zip_stat_t*>(data)->size = 0;  // the archive is new
        static_cast<zip_stat_t*>(data)->valid = ZIP_STAT_SIZE;
        return sizeof(zip_stat_t);
      case ZIP_SOURCE_ERROR:
        return zip_error_to_data(&error_, data, size);
      case ZIP_SOURCE_WRITE:
        return write(static_cast<const char*>(data), size);
      case ZIP_SOURCE_SEEK_WRITE: {
        const zip_int64_t offset = zip_source_seek_compute_offset(position_, bytes_.size(), data, size, &error_);
        if (offset < 0) return -1;
        position_ = static_cast<std::size_t>(offset);
        return 0;
      }
      case ZIP_SOURCE_TELL_WRITE:
        return static_cast<zip_int64_t>(position_);
      case ZIP_SOURCE_OPEN:
      case ZIP_SOURCE_CLOSE:
      case ZIP_SOURCE_FREE:
      case ZIP_SOURCE_BEGIN_WRITE:
      case ZIP_SOURCE_COMMIT_WRITE:
      case ZIP_SOURCE_ROLLBACK_WRITE:
      case ZIP_SOURCE_REMOVE:
        return 0;
      default:  // a new archive is never read
        zip_error_set(&error_, ZIP_ER_OPNOTSUPP, 0);
        return -1;
    }
  }

  // Overwrites bytes from the current position and appends the rest. It never throws: its caller is C code.
  zip_int64_t write(const char* data, zip_uint64_t size) noexcept {
    if (stop_.stopped()) {
      zip_error_set(&error_, ZIP_ER_CANCELLED, 0);
      return -1;
    }
    try {
      const std::size_t overwritten = std::min<std::size_t>(size, bytes_.size() - position_);
      bytes_.replace(position_, overwritten, data, overwritten);
      bytes_.append(data + overwritten, size - overwritten);
    } catch (const std::exception&) {
      zip_error_set(&error_, ZIP_ER_MEMORY, 0);
      return -1;
    }
    position_ += size;
    return static_cast<zip_int64_t>(size);
  }

  const StopToken& stop_;
  std::string bytes_;
  std::size_t position_ = 0;
  zip_error_t error_{};
};

// Upper bound of the zip structures of a member: local header, directory entry, and the name in both.
constexpr std::size_t kMemberBytes = 512;

}  // namespace

std::size_t element_size(ElementType type) {
  switch (type) {
    case ElementType::boolean:
    case ElementType::uint8:
      return 1;
    case ElementType::uint16:
    case ElementType::float16:
      return 2;
    case ElementType::float32:
      return 4;
    case ElementType::uint64:
    case ElementType::float64:
      return 8;
  }
  throw std::invalid_argument("unknown element type");
}

std::string numpy_descr(ElementType type) {
  switch (type) {
    case ElementType::boolean:
      return "|b1";
    case ElementType::uint8:
      return "|u1";
    case ElementType::uint16:
      return "<u2";
    case ElementType::float16:
      return "<f2";
    case ElementType::uint64:
      return "<u8";
    case ElementType::float32:
      return "<f4";
    case ElementType::float64:
      return "<f8";
  }
  throw std::invalid_argument("unknown element type");
}

std::string encode_raw(const ArrayView& array) { return std::string(data_of(array), array_bytes(array)); }

std::string encode_npy(const ArrayView& array) {
  const std::string header = npy_header(array);
  std::string result;
  result.reserve(header.size() + array_bytes(array));
  result += header;
  result.append(data_of(array), array_bytes(array));
  return result;
}

std::string encode_npz(const std::vector<ArrayView>& arrays, const std::string& meta_json, const StopToken& stop,
                       bool deflated) {
  std::vector<std::string> headers;  // reserved, since fragments point to its elements
  headers.reserve(arrays.size());
  for (const ArrayView& array : arrays) headers.push_back(npy_header(array));
  // Reserve the answer's memory in advance: a growing string would copy it, and hold it twice meanwhile.
  std::size_t expected = meta_json.size() + kMemberBytes;
  for (const ArrayView& array : arrays) expected += array_bytes(array) + kMemberBytes;
  if (deflated) expected /= 2;
  ZipDestination destination(expected, stop);
  Source source(zip_source_function_create(ZipDestination::call, &destination, nullptr));
  if (!source) fail("no memory");
  Archive archive(zip_open_from_source(source.get(), ZIP_CREATE | ZIP_TRUNCATE, nullptr));
  if (!archive) fail("cannot start an archive");
  source.release();  // NOLINT(bugprone-unused-return-value): the archive owns it now
  for (std::size_t i = 0; i < arrays.size(); ++i) {
    add_member(archive.get(), std::string(arrays[i].name) + ".npy",
               {fragment(headers[i].data(), headers[i].size()), fragment(data_of(arrays[i]), array_bytes(arrays[i]))},
               deflated);
  }
  add_member(archive.get(), "meta.json", {fragment(meta_json.data(), meta_json.size())}, deflated);
  // The archive is written only now. Where `stop` made ZipDestination refuse, report that instead of libzip's error.
  if (zip_close(archive.get()) != 0) {
    stop.check();
    fail(zip_strerror(archive.get()));
  }
  archive.release();  // NOLINT(bugprone-unused-return-value): zip_close freed it
  return destination.take();
}

}  // namespace selenograph::api
