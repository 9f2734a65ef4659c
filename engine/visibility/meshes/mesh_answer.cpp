#include "engine/visibility/meshes/mesh_answer.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "engine/support/utf8.h"

namespace selenograph::engine {

// Both ends are the same executable, so numbers are transferred as they lie in memory.
static_assert(std::endian::native == std::endian::little);
static_assert(sizeof(ObjectCorner) == 24 && sizeof(ObjectTriangle) == 16);

namespace {

constexpr std::uint32_t kShape = 0x53474d31, kRefusal = 0x53474d30;  // first number of an answer: its kind

[[noreturn]] void fail(const char* why) {
  throw std::runtime_error(std::string("the answer of its reader is damaged: ") + why);
}

void append(std::string& to, const void* from, std::size_t bytes) { to.append(static_cast<const char*>(from), bytes); }

void append_number(std::string& to, std::uint32_t number) { append(to, &number, sizeof number); }

// Fixed-size head of an answer: the counts of the lists that follow.
struct Header {
  std::uint32_t kind, corners, triangles, parts;
  std::uint32_t textured, unused;
};
static_assert(sizeof(Header) == 24);

// Takes items off the front of an answer. Throws if it is too short.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : unread_(bytes) {}

  template <typename T>
  T item() {
    T value{};
    copy(&value, sizeof value);
    return value;
  }
  std::uint32_t number() { return item<std::uint32_t>(); }
  // The count comes from the untrusted answer: check it before memory is allocated.
  template <typename T>
  std::vector<T> list(std::size_t count) {
    if (count > unread_.size() / sizeof(T)) fail("too short");
    std::vector<T> items(count);
    copy(items.data(), count * sizeof(T));
    return items;
  }
  std::string text(std::size_t size) {
    const std::vector<char> characters = list<char>(size);
    return {characters.begin(), characters.end()};
  }
  bool empty() const { return unread_.empty(); }

 private:
  void copy(void* to, std::size_t bytes) {
    if (bytes > unread_.size()) fail("too short");
    if (bytes > 0) std::memcpy(to, unread_.data(), bytes);
    unread_.remove_prefix(bytes);
  }
  std::string_view unread_;
};

// Throws if the shape is not one that read_mesh_file() returns: the reader, a separate process, is not trusted.
void check(const ObjectShape& shape) {
  if (shape.triangles.empty() || shape.parts.empty()) fail("no triangle");
  for (const ObjectCorner& corner : shape.corners) {
    if (!corner.place.allFinite()) fail("a corner that is not finite");
    const float length2 = corner.normal.squaredNorm();
    if (!(length2 == 0 || std::abs(length2 - 1) < 1e-4F)) fail("a normal that is not one");
  }
  for (const ObjectTriangle& t : shape.triangles) {
    for (const std::uint32_t corner : t.corner)
      if (corner >= shape.corners.size()) fail("a corner that is not there");
    if (t.part >= shape.parts.size()) fail("a part that is not there");
  }
  for (const std::string& part : shape.parts)
    if (!is_utf8(part)) fail("a part whose name is not UTF-8");
}

}  // namespace

std::string shape_answer(const ObjectShape& shape) {
  const std::size_t corner_bytes = shape.corners.size() * sizeof(ObjectCorner);
  const std::size_t triangle_bytes = shape.triangles.size() * sizeof(ObjectTriangle);
  std::string answer;
  const Header header{kShape,
                      static_cast<std::uint32_t>(shape.corners.size()),
                      static_cast<std::uint32_t>(shape.triangles.size()),
                      static_cast<std::uint32_t>(shape.parts.size()),
                      shape.textured,
                      0};
  answer.reserve(sizeof header + corner_bytes + triangle_bytes);
  append(answer, &header, sizeof header);
  append(answer, shape.corners.data(), corner_bytes);
  append(answer, shape.triangles.data(), triangle_bytes);
  for (const std::string& part : shape.parts) {
    append_number(answer, static_cast<std::uint32_t>(part.size()));
    answer += part;
  }
  return answer;
}

std::string refusal_answer(std::string_view why) {
  std::string answer;
  append_number(answer, kRefusal);
  return answer.append(why.substr(0, kMaxRefusalBytes));
}

ObjectShape shape_of_answer(std::string_view answer) {
  const auto kind = ByteReader(answer).number();
  if (kind == kRefusal) throw std::runtime_error(std::string(answer.substr(sizeof kind, kMaxRefusalBytes)));
  if (kind != kShape) fail("neither a mesh nor a refusal");
  ByteReader in(answer);
  const auto header = in.item<Header>();
  if (header.textured > 1 || header.unused != 0) fail("neither yes nor no");
  ObjectShape shape;
  shape.corners = in.list<ObjectCorner>(header.corners);
  shape.triangles = in.list<ObjectTriangle>(header.triangles);
  for (std::uint32_t i = 0; i < header.parts; ++i) shape.parts.push_back(in.text(in.number()));
  shape.textured = header.textured != 0;
  if (!in.empty()) fail("too long");
  check(shape);
  return shape;
}

}  // namespace selenograph::engine
