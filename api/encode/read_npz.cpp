// Reads NPY files, whose layout is NumPy Enhancement Proposal 1 (Robert Kern, 2007), from zip archives by libzip:
//
//   "\x93NUMPY" | major, minor | header length (2 bytes, from version 2 on 4) | header | elements
//   header: {'descr': '<f8', 'fortran_order': False, 'shape': (3, 2), }
#include "api/encode/read_npz.h"

#include <fmt/format.h>
#include <zip.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <stdexcept>

#include "api/message/problem.h"

namespace selenograph::api {
namespace {

constexpr std::size_t kMaxArrays = 32, kMaxDimensions = 8, kMaxHeaderBytes = 4096;

// Throws the error about an array, or about the archive if the name is empty.
[[noreturn]] void refuse_npz(const std::string& name, const std::string& why) {
  const std::string what = name.empty() ? "the archive" : "array \"" + name + "\"";
  throw RequestError("malformed_npz", what + " " + why, {{name.empty() ? "" : "/" + name, why}});
}

// Parser of the header, a Python dictionary of which NumPy writes three entries in a fixed form.
class NpyHeader {
 public:
  NpyHeader(std::string_view text, const std::string& name) : text_(text), name_(name) {
    descr_ = quoted(after("'descr':"));
    const std::string_view order = after("'fortran_order':");
    fortran_ = order.starts_with("True");
    if (!fortran_ && !order.starts_with("False")) refuse();
    read_shape(after("'shape':"));
  }
  const std::string& descr() const { return descr_; }
  bool fortran() const { return fortran_; }
  const std::vector<std::size_t>& shape() const { return shape_; }

 private:
  [[noreturn]] void refuse() const { refuse_npz(name_, "has no header that numpy.save would write"); }
  // Returns the text after a key, which must occur exactly once.
  std::string_view after(std::string_view key) const {
    const std::size_t key_begin = text_.find(key);
    if (key_begin == std::string_view::npos || text_.find(key, key_begin + 1) != std::string_view::npos) refuse();
    std::string_view rest = text_.substr(key_begin + key.size());
    rest.remove_prefix(std::min(rest.find_first_not_of(' '), rest.size()));
    return rest;
  }
  // Returns the text in quotation marks with which `rest` begins. A list instead would describe a record's fields.
  std::string quoted(std::string_view rest) const {
    if (rest.starts_with("[")) refuse_npz(name_, "has fields; plain numbers are needed");
    const std::size_t end = rest.starts_with("'") ? rest.find('\'', 1) : std::string_view::npos;
    if (end == std::string_view::npos) refuse();
    return std::string(rest.substr(1, end - 1));
  }
  // Reads the tuple with which `rest` begins: "(3, 2)", "(3,)" or "()".
  void read_shape(std::string_view rest) {
    if (!rest.starts_with("(")) refuse();
    const std::size_t end = rest.find(')');
    if (end == std::string_view::npos) refuse();
    std::string_view list = rest.substr(1, end - 1);
    while (true) {
      list.remove_prefix(std::min(list.find_first_not_of(' '), list.size()));
      if (list.empty()) return;
      std::size_t number = 0;
      const auto [past, error] = std::from_chars(list.data(), list.data() + list.size(), number);
      if (error != std::errc() || shape_.size() == kMaxDimensions) refuse();
      shape_.push_back(number);
      list.remove_prefix(static_cast<std::size_t>(past - list.data()));
      if (list.starts_with("L")) list.remove_prefix(1);  // Python 2 writes 3L
      if (list.empty()) return;
      if (!list.starts_with(",")) refuse();
      list.remove_prefix(1);
    }
  }

  std::string_view text_;
  const std::string& name_;
  std::string descr_;
  bool fortran_ = false;
  std::vector<std::size_t> shape_;
};

// Calls visit(index in the file) for the elements in C order. With `columns_first` the file has Fortran order.
template <typename Visit>
void each_in_c_order(const std::vector<std::size_t>& shape, std::size_t count, bool columns_first, const Visit& visit) {
  if (!columns_first || shape.size() < 2) {
    for (std::size_t i = 0; i < count; ++i) visit(i);
    return;
  }
  // In Fortran order the first subscript varies fastest: index = s0 + n0 (s1 + n1 (s2 + ..)).
  std::vector<std::size_t> subscript(shape.size(), 0);
  for (std::size_t i = 0; i < count; ++i) {
    std::size_t index = 0;
    for (std::size_t k = shape.size(); k-- > 0;) index = index * shape[k] + subscript[k];
    visit(index);
    // Advance to the next subscript in C order: the last dimension varies fastest.
    for (std::size_t k = shape.size(); k-- > 0 && ++subscript[k] == shape[k];) subscript[k] = 0;
  }
}

// Returns `count` elements of the type T as doubles, in C order.
template <typename T>
std::vector<double> converted(std::string_view bytes, const std::vector<std::size_t>& shape, std::size_t count,
                              bool columns_first) {
  std::vector<double> numbers;
  numbers.reserve(count);
  each_in_c_order(shape, count, columns_first, [&](std::size_t index) {
    T value;
    std::memcpy(&value, bytes.data() + index * sizeof(T), sizeof(T));
    numbers.push_back(static_cast<double>(value));
  });
  return numbers;
}

// An element type by its code in the header, with the conversion of its elements to double.
struct NumberType {
  std::string_view descr;
  std::size_t bytes;
  std::vector<double> (*convert)(std::string_view bytes, const std::vector<std::size_t>& shape, std::size_t count,
                                 bool columns_first);
};
constexpr NumberType kNumberTypes[] = {
    {"<f8", 8, converted<double>},        {"<f4", 4, converted<float>},         {"<i8", 8, converted<std::int64_t>},
    {"<i4", 4, converted<std::int32_t>},  {"<i2", 2, converted<std::int16_t>},  {"|i1", 1, converted<std::int8_t>},
    {"<u8", 8, converted<std::uint64_t>}, {"<u4", 4, converted<std::uint32_t>}, {"<u2", 2, converted<std::uint16_t>},
    {"|u1", 1, converted<std::uint8_t>},  {"|b1", 1, converted<std::uint8_t>},
};

// Converts UTF-32, padded with zeros, to UTF-8: 1 to 4 bytes a character, the first of which tells their number and the
// others of which hold six bits each.
std::string text_of_utf32(std::string_view bytes, const std::string& name) {
  std::string out;
  for (std::size_t i = 0; i + 4 <= bytes.size(); i += 4) {
    std::uint32_t c;
    std::memcpy(&c, bytes.data() + i, 4);
    if (c == 0) break;
    if (c > 0x10ffff) refuse_npz(name, "has a text with a character that does not exist");
    const auto put = [&](std::uint32_t byte) { out += static_cast<char>(byte); };
    if (c < 0x80) {
      put(c);
    } else if (c < 0x800) {
      put(0xc0 | c >> 6);
      put(0x80 | (c & 0x3f));
    } else if (c < 0x10000) {
      put(0xe0 | c >> 12);
      put(0x80 | (c >> 6 & 0x3f));
      put(0x80 | (c & 0x3f));
    } else {
      put(0xf0 | c >> 18);
      put(0x80 | (c >> 12 & 0x3f));
      put(0x80 | (c >> 6 & 0x3f));
      put(0x80 | (c & 0x3f));
    }
  }
  return out;
}

struct CloseArchive {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
struct CloseMember {
  void operator()(zip_file_t* file) const { zip_fclose(file); }
};
using OpenArchive = std::unique_ptr<zip_t, CloseArchive>;

// Opens the archive whose zip source make_source(error) returns. refuse(why), which throws, reports a failure.
template <typename Make, typename Refuse>
OpenArchive open_archive(const Make& make_source, int flags, const Refuse& refuse) {
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* source = make_source(&error);
  OpenArchive archive(source ? zip_open_from_source(source, ZIP_RDONLY | flags, &error) : nullptr);
  if (!archive) {
    if (source) zip_source_free(source);
    const std::string why = std::string("cannot be read: ") + zip_error_strerror(&error);
    zip_error_fini(&error);
    refuse(why);
  }
  zip_error_fini(&error);
  return archive;
}

// Returns the content of a member, which must have exactly `size` bytes.
std::string unpacked(zip_t* archive, zip_uint64_t index, std::size_t size, const std::string& name,
                     const StopToken& stop) {
  const std::unique_ptr<zip_file_t, CloseMember> file(zip_fopen_index(archive, index, 0));
  if (!file) refuse_npz(name, std::string("cannot be opened: ") + zip_strerror(archive));
  std::string content(size, '\0');
  std::size_t filled = 0;
  while (true) {
    stop.check();
    // Read once more at the expected end: only then does libzip compare the checksum.
    char extra;
    const bool full = filled == size;
    const std::size_t chunk_bytes = std::min<std::size_t>(size - filled, std::size_t{1} << 20);
    const zip_int64_t got = zip_fread(file.get(), full ? &extra : content.data() + filled, full ? 1 : chunk_bytes);
    if (got < 0) refuse_npz(name, std::string("is damaged: ") + zip_file_strerror(file.get()));
    if (got == 0) break;
    if (full) refuse_npz(name, "is longer than the archive says");
    filled += static_cast<std::size_t>(got);
  }
  if (filled != size) refuse_npz(name, "is shorter than the archive says");
  return content;
}

}  // namespace

NpzArray read_npy(std::string_view bytes, const std::string& name) {
  static_assert(std::endian::native == std::endian::little);
  if (!bytes.starts_with("\x93NUMPY") || bytes.size() < 12) refuse_npz(name, "is not an .npy file");
  const auto byte = [&](std::size_t i) { return static_cast<std::size_t>(static_cast<unsigned char>(bytes[i])); };
  const std::size_t version = byte(6);
  if (version < 1 || version > 3) refuse_npz(name, "has an unknown version of the format");
  // The length of the header is little-endian, in the bytes from 8 on.
  const std::size_t header_begin = version == 1 ? 10 : 12;
  const std::size_t length = byte(8) | byte(9) << 8 | (version == 1 ? 0 : byte(10) << 16 | byte(11) << 24);
  if (length > kMaxHeaderBytes || header_begin + length > bytes.size()) refuse_npz(name, "ends within its header");
  const NpyHeader header(bytes.substr(header_begin, length), name);
  const std::string_view data = bytes.substr(header_begin + length);

  NpzArray array{header.shape(), {}, {}};
  const bool empty = std::find(array.shape.begin(), array.shape.end(), 0U) != array.shape.end();
  std::size_t count = empty ? 0 : 1;
  for (const std::size_t n : array.shape) {
    // An element has at least one byte. Comparing before the multiplication keeps the product from overflowing.
    if (!empty && count > data.size() / n) refuse_npz(name, "is shorter than its shape");
    count *= n;
  }
  // "<U5" is a text of up to 5 UTF-32 characters, "|S5" one of 5 bytes; ">" would be big-endian.
  if (header.descr().size() > 2 && (header.descr()[1] == 'U' || header.descr()[1] == 'S') && header.descr()[0] != '>') {
    if (count != 1) refuse_npz(name, "has several texts; one is needed");
    array.text = header.descr()[1] == 'U' ? text_of_utf32(data, name) : std::string(data.substr(0, data.find('\0')));
    return array;
  }
  for (const NumberType& type : kNumberTypes) {
    if (type.descr != header.descr()) continue;
    if (data.size() != count * type.bytes)
      refuse_npz(name, fmt::format("has {} bytes of numbers; its shape needs {}", data.size(), count * type.bytes));
    array.numbers = type.convert(data, array.shape, count, header.fortran());
    return array;
  }
  refuse_npz(name, "has elements of type " + header.descr() + "; little-endian numbers of up to 8 bytes are needed");
}

namespace {

struct NpzMember {
  std::string name;
  std::size_t bytes;
  bool npy;  // false: a text
};

// Returns the members in the archive's own order, without unpacking any.
std::vector<NpzMember> list_members(zip_t* archive, std::size_t max_bytes) {
  const zip_int64_t entries = zip_get_num_entries(archive, 0);
  if (entries < 1 || static_cast<std::size_t>(entries) > kMaxArrays)
    refuse_npz("", fmt::format("has {} members; 1 to {} arrays are needed", entries, kMaxArrays));
  std::vector<NpzMember> members;
  std::size_t total = 0;
  for (zip_uint64_t i = 0; i < static_cast<zip_uint64_t>(entries); ++i) {
    zip_stat_t stat;
    constexpr zip_uint64_t kNeeded = ZIP_STAT_NAME | ZIP_STAT_SIZE | ZIP_STAT_COMP_METHOD;
    if (zip_stat_index(archive, i, 0, &stat) != 0 || (stat.valid & kNeeded) != kNeeded)
      refuse_npz("", "has a member without name or size");
    const std::string_view file = stat.name;
    const bool npy = file.ends_with(".npy"), json = file.ends_with(".json");
    if (!npy && !json) refuse_npz("", fmt::format("has a member \"{}\"; all are called NAME.npy", file));
    const std::string name(file.substr(0, file.rfind('.')));
    if (stat.comp_method != ZIP_CM_STORE && stat.comp_method != ZIP_CM_DEFLATE)
      refuse_npz(name, "is packed in a way that numpy.savez_compressed does not use");
    // Test the size alone first: a false one near 2^64 would make the sum overflow.
    if (stat.size > max_bytes || total + stat.size > max_bytes)
      throw RequestError("too_large", fmt::format("the arrays are larger than {} bytes", max_bytes));
    total += stat.size;
    members.push_back({name, stat.size, npy});
  }
  return members;
}

}  // namespace

NpzArrays read_npz(std::string_view bytes, std::size_t max_bytes, const StopToken& stop) {
  const OpenArchive archive =
      open_archive([&](zip_error_t* error) { return zip_source_buffer_create(bytes.data(), bytes.size(), 0, error); },
                   ZIP_CHECKCONS, [](const std::string& why) { refuse_npz("", why + "; numpy.savez makes one"); });
  const std::vector<NpzMember> members = list_members(archive.get(), max_bytes);
  NpzArrays arrays;
  for (std::size_t i = 0; i < members.size(); ++i) {
    const NpzMember& member = members[i];
    std::string content = unpacked(archive.get(), i, member.bytes, member.name, stop);
    NpzArray array = member.npy ? read_npy(content, member.name) : NpzArray{{}, {}, std::move(content)};
    if (!arrays.emplace(member.name, std::move(array)).second) refuse_npz(member.name, "is there twice");
  }
  return arrays;
}

std::optional<std::string> text_in_npz(const std::string& path, std::uint64_t offset, std::uint64_t bytes,
                                       const std::string& name) {
  const auto refuse = [&](const std::string& why) { throw std::runtime_error(path + ": " + why); };
  const OpenArchive archive = open_archive(
      [&](zip_error_t* error) {
        return zip_source_file_create(path.c_str(), offset, static_cast<zip_int64_t>(bytes), error);
      },
      0, refuse);
  const zip_int64_t index = zip_name_locate(archive.get(), name.c_str(), 0);
  if (index < 0) return std::nullopt;
  zip_stat_t stat;
  if (zip_stat_index(archive.get(), static_cast<zip_uint64_t>(index), 0, &stat) != 0 || !(stat.valid & ZIP_STAT_SIZE))
    refuse("has a member " + name + " without size");
  try {
    return unpacked(archive.get(), static_cast<zip_uint64_t>(index), stat.size, name, {});
  } catch (const RequestError& e) {
    throw std::runtime_error(path + ": " + e.what());
  }
}

}  // namespace selenograph::api
