#include "engine/visibility/meshes/mesh_recentre.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

namespace selenograph::engine {
namespace {

// Farther away than this many times what lies around the middle, float loses a millionth of the mesh.
constexpr double kFar = 4;

// The median of all places, if it is so far away; its digits are few, so that differences are exact where they can be.
std::optional<Vec3> far_middle(const std::vector<Vec3>& places) {
  if (places.empty()) return std::nullopt;
  const auto median_of = [&](auto&& value) {
    std::vector<double> values(places.size());
    std::transform(places.begin(), places.end(), values.begin(), value);
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  };
  Vec3 middle;
  for (int axis = 0; axis < 3; ++axis) middle[axis] = median_of([axis](const Vec3& p) { return p[axis]; });
  const double around = median_of([&](const Vec3& p) { return (p - middle).norm(); });
  if (!middle.allFinite() || !(middle.norm() > kFar * around)) return std::nullopt;
  for (double& value : middle) value = static_cast<double>(static_cast<float>(value));
  return middle;
}

double float_rounding(const std::vector<Vec3>& places) {
  double largest = 0;
  for (const Vec3& p : places) largest = std::max(largest, p.cwiseAbs().maxCoeff());
  return largest * 0x1p-24;
}

bool blank(char c) { return c == ' ' || c == '\t' || c == '\r'; }

// The next word of a line, which is taken off.
std::string_view word(std::string_view& line) {
  while (!line.empty() && blank(line.front())) line.remove_prefix(1);
  std::size_t size = 0;
  while (size < line.size() && !blank(line[size])) ++size;
  const std::string_view found = line.substr(0, size);
  line.remove_prefix(size);
  return found;
}

std::optional<double> number(std::string_view text) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

// Lines with their ends.
std::string_view take_line(std::string_view& text) {
  const std::size_t end = text.find('\n');
  const std::string_view line = text.substr(0, end == std::string_view::npos ? text.size() : end + 1);
  text.remove_prefix(line.size());
  return line;
}

std::string_view without_end(std::string_view line) {
  if (!line.empty() && line.back() == '\n') line.remove_suffix(1);
  return line;
}

// --- OBJ

struct ObjVertex {
  Vec3 place;
  std::string_view rest;  // w or colours
};

std::optional<ObjVertex> obj_vertex(std::string_view line) {
  line = without_end(line);
  if (word(line) != "v") return std::nullopt;
  ObjVertex vertex;
  for (double& value : vertex.place) {
    const auto read = number(word(line));
    if (!read) return std::nullopt;
    value = *read;
  }
  vertex.rest = line;
  return vertex;
}

Recentred recentred_obj(std::string content) {
  std::vector<Vec3> places;
  for (std::string_view text = content; !text.empty();)
    if (const auto vertex = obj_vertex(take_line(text))) places.push_back(vertex->place);
  const auto middle = far_middle(places);
  if (!middle) return {std::move(content)};
  std::string moved;
  moved.reserve(content.size() + content.size() / 4);
  for (std::string_view text = content; !text.empty();) {
    const std::string_view line = take_line(text);
    if (const auto vertex = obj_vertex(line)) {
      const Vec3 p = vertex->place - *middle;
      fmt::format_to(std::back_inserter(moved), "v {} {} {}{}\n", p.x(), p.y(), p.z(), vertex->rest);
    } else {
      moved += line;
    }
  }
  return {std::move(moved), *middle};
}

// --- PLY

enum class PlyKind { ascii, little, big };
struct PlyHeader {
  PlyKind kind = PlyKind::ascii;
  std::size_t vertices = 0, size = 0;   // of the header, bytes
  std::size_t properties = 0, row = 0;  // of a vertex: how many, bytes
  struct Axis {
    std::size_t index = 0, offset = 0;
    bool is_double = false, known = false;
  };
  std::array<Axis, 3> axes;
  bool all_double() const {
    return std::all_of(axes.begin(), axes.end(), [](const Axis& a) { return a.is_double; });
  }
};

std::size_t ply_size(std::string_view type) {
  static constexpr std::pair<std::string_view, std::size_t> kSizes[] = {
      {"char", 1},  {"uchar", 1},   {"int8", 1},   {"uint8", 1},  {"short", 2}, {"ushort", 2},
      {"int16", 2}, {"uint16", 2},  {"int", 4},    {"uint", 4},   {"int32", 4}, {"uint32", 4},
      {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};
  for (const auto& [name, size] : kSizes)
    if (name == type) return size;
  return 0;
}

// Only of files whose first element is the vertices, without lists.
std::optional<PlyHeader> ply_header(std::string_view content) {
  std::string_view text = content;
  PlyHeader header;
  std::string_view first = without_end(take_line(text));
  if (word(first) != "ply") return std::nullopt;
  int elements = 0;
  while (!text.empty()) {
    std::string_view line = without_end(take_line(text));
    const std::string_view what = word(line);
    if (what == "format") {
      const std::string_view kind = word(line);
      if (kind != "ascii" && kind != "binary_little_endian" && kind != "binary_big_endian") return std::nullopt;
      header.kind = kind == "ascii" ? PlyKind::ascii : kind == "binary_little_endian" ? PlyKind::little : PlyKind::big;
    } else if (what == "element") {
      const bool vertex = word(line) == "vertex";
      const auto count = number(word(line));
      if (++elements == 1 && (!vertex || !count || !(*count > 0 && *count < 1e9))) return std::nullopt;
      if (elements == 1) header.vertices = static_cast<std::size_t>(*count);
    } else if (what == "property" && elements == 1) {
      const std::string_view type = word(line), name = word(line);
      const std::size_t size = ply_size(type);
      if (size == 0) return std::nullopt;
      for (std::size_t axis = 0; axis < 3; ++axis)
        if (name == std::string_view("xyz").substr(axis, 1)) {
          const bool is_double = type == "double" || type == "float64";
          if (!is_double && type != "float" && type != "float32") return std::nullopt;
          header.axes[axis] = {header.properties, header.row, is_double, true};
        }
      ++header.properties, header.row += size;
    } else if (what == "end_header") {
      header.size = content.size() - text.size();
      const bool whole = std::all_of(header.axes.begin(), header.axes.end(), [](const auto& a) { return a.known; });
      return whole && header.vertices > 0 ? std::optional(header) : std::nullopt;
    }
  }
  return std::nullopt;
}

std::uint32_t turned(std::uint32_t bits) { return __builtin_bswap32(bits); }
std::uint64_t turned(std::uint64_t bits) { return __builtin_bswap64(bits); }

template <typename Bits, typename Real>
double real_at(const char* from, bool swap) {
  Bits bits;
  std::memcpy(&bits, from, sizeof bits);
  return static_cast<double>(std::bit_cast<Real>(swap ? turned(bits) : bits));
}

template <typename Bits, typename Real>
void put_real(char* to, double value, bool swap) {
  const auto own = std::bit_cast<Bits>(static_cast<Real>(value)), bits = swap ? turned(own) : own;
  std::memcpy(to, &bits, sizeof bits);
}

Recentred recentred_binary_ply(std::string content, const PlyHeader& header) {
  const bool swap = header.kind == PlyKind::big;
  if (header.vertices > (content.size() - header.size) / header.row) return {std::move(content)};
  std::vector<Vec3> places(header.vertices);
  for (std::size_t i = 0; i < header.vertices; ++i)
    for (int axis = 0; axis < 3; ++axis) {
      const PlyHeader::Axis& a = header.axes[static_cast<std::size_t>(axis)];
      const char* at = content.data() + header.size + i * header.row + a.offset;
      places[i][axis] =
          a.is_double ? real_at<std::uint64_t, double>(at, swap) : real_at<std::uint32_t, float>(at, swap);
      if (!std::isfinite(places[i][axis])) return {std::move(content)};
    }
  const double rounding = header.all_double() ? 0 : float_rounding(places);
  const auto middle = far_middle(places);
  if (!middle) return {std::move(content), Vec3::Zero(), rounding};
  for (std::size_t i = 0; i < header.vertices; ++i)
    for (int axis = 0; axis < 3; ++axis) {
      const PlyHeader::Axis& a = header.axes[static_cast<std::size_t>(axis)];
      char* at = content.data() + header.size + i * header.row + a.offset;
      const double value = places[i][axis] - (*middle)[axis];
      a.is_double ? put_real<std::uint64_t, double>(at, value, swap) : put_real<std::uint32_t, float>(at, value, swap);
    }
  return {std::move(content), *middle, rounding};
}

// The words of a vertex's line; none: it isn't one.
std::vector<std::string_view> ply_row(std::string_view line, const PlyHeader& header) {
  std::vector<std::string_view> words;
  for (std::string_view rest = without_end(line); words.size() < header.properties;) {
    const std::string_view next = word(rest);
    if (next.empty()) return {};
    words.push_back(next);
  }
  return words;
}

Recentred recentred_ascii_ply(std::string content, const PlyHeader& header) {
  std::vector<Vec3> places;
  std::string_view text = std::string_view(content).substr(header.size);
  for (std::size_t i = 0; i < header.vertices; ++i) {
    const auto words = ply_row(take_line(text), header);
    if (words.empty()) return {std::move(content)};
    Vec3 place;
    for (int axis = 0; axis < 3; ++axis) {
      const auto value = number(words[header.axes[static_cast<std::size_t>(axis)].index]);
      if (!value) return {std::move(content)};
      place[axis] = *value;
    }
    places.push_back(place);
  }
  const auto middle = far_middle(places);
  if (!middle) return {std::move(content)};
  std::string moved = content.substr(0, header.size);
  moved.reserve(content.size() + content.size() / 4);
  text = std::string_view(content).substr(header.size);
  for (std::size_t i = 0; i < header.vertices; ++i) {
    const auto words = ply_row(take_line(text), header);
    for (std::size_t k = 0; k < words.size(); ++k) {
      const auto axis =
          std::find_if(header.axes.begin(), header.axes.end(), [k](const auto& a) { return a.index == k; });
      if (k > 0) moved += ' ';
      if (axis == header.axes.end()) {
        moved += words[k];
      } else {
        const auto at = static_cast<int>(axis - header.axes.begin());
        fmt::format_to(std::back_inserter(moved), "{}", places[i][at] - (*middle)[at]);
      }
    }
    moved += '\n';
  }
  moved += text;
  return {std::move(moved), *middle};
}

Recentred recentred_ply(std::string content) {
  const auto header = ply_header(content);
  if (!header) return {std::move(content)};
  return header->kind == PlyKind::ascii ? recentred_ascii_ply(std::move(content), *header)
                                        : recentred_binary_ply(std::move(content), *header);
}

// --- glTF

// The numbers of a root node that move it: its translation, or the last column of its matrix.
nlohmann::json* translation(nlohmann::json& node, std::size_t& first) {
  if (!node.is_object()) return nullptr;
  const bool matrix = node.contains("matrix");
  const char* name = matrix ? "matrix" : "translation";
  if (!matrix && !node.contains(name)) node[name] = {0.0, 0.0, 0.0};
  nlohmann::json& numbers = node[name];
  first = matrix ? 12 : 0;
  if (!numbers.is_array() || numbers.size() < first + 3) return nullptr;
  for (std::size_t i = 0; i < 3; ++i)
    if (!numbers[first + i].is_number()) return nullptr;
  return &numbers;
}

// Of the nodes of all scenes; empty if something in there is not as it should be.
std::vector<nlohmann::json*> root_nodes(nlohmann::json& gltf) {
  std::vector<nlohmann::json*> roots;
  if (!gltf.is_object() || !gltf.contains("scenes") || !gltf.contains("nodes")) return {};
  nlohmann::json& nodes = gltf["nodes"];
  std::vector<bool> seen(nodes.is_array() ? nodes.size() : 0);
  for (const nlohmann::json& scene : gltf["scenes"]) {
    if (!scene.is_object() || !scene.contains("nodes")) continue;
    for (const nlohmann::json& index : scene["nodes"]) {
      if (!index.is_number_unsigned() || index.get<std::size_t>() >= seen.size()) return {};
      const auto at = index.get<std::size_t>();
      if (!seen[at]) roots.push_back(&nodes[at]);
      seen[at] = true;
    }
  }
  return roots;
}

std::optional<Vec3> recentre_gltf(nlohmann::json& gltf) {
  std::vector<Vec3> places;
  std::vector<std::pair<nlohmann::json*, std::size_t>> numbers;
  for (nlohmann::json* root : root_nodes(gltf)) {
    std::size_t first = 0;
    nlohmann::json* const at = translation(*root, first);
    if (!at) return std::nullopt;
    numbers.emplace_back(at, first);
    places.emplace_back((*at)[first].get<double>(), (*at)[first + 1].get<double>(), (*at)[first + 2].get<double>());
  }
  const auto middle = far_middle(places);
  if (!middle) return std::nullopt;
  for (std::size_t i = 0; i < numbers.size(); ++i)
    for (int axis = 0; axis < 3; ++axis)
      (*numbers[i].first)[numbers[i].second + static_cast<std::size_t>(axis)] = places[i][axis] - (*middle)[axis];
  return middle;
}

Recentred recentred_gltf(std::string content) {
  nlohmann::json gltf = nlohmann::json::parse(content, nullptr, false);
  if (gltf.is_discarded()) return {std::move(content)};
  const auto middle = recentre_gltf(gltf);
  if (!middle) return {std::move(content)};
  return {gltf.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace), *middle};
}

// Header (magic, version, length), then chunks (length, kind, bytes), the first of which is the JSON.
Recentred recentred_glb(std::string content) {
  constexpr std::size_t kHeader = 12, kChunk = 8;
  if (content.size() < kHeader + kChunk || content.compare(0, 4, "glTF") != 0) return {std::move(content)};
  std::uint32_t json_bytes = 0;
  std::memcpy(&json_bytes, content.data() + kHeader, sizeof json_bytes);
  if (json_bytes > content.size() - kHeader - kChunk || content.compare(kHeader + 4, 4, "JSON") != 0)
    return {std::move(content)};
  Recentred json = recentred_gltf(content.substr(kHeader + kChunk, json_bytes));
  if (json.origin.isZero(0)) return {std::move(content)};
  json.content.resize((json.content.size() + 3) / 4 * 4, ' ');
  const auto put = [](std::string& to, std::size_t number) {
    const auto bits = static_cast<std::uint32_t>(number);
    to.append(reinterpret_cast<const char*>(&bits), sizeof bits);
  };
  std::string moved = content.substr(0, 8);
  put(moved, content.size() - json_bytes + json.content.size());
  put(moved, json.content.size());
  moved += "JSON" + json.content + content.substr(kHeader + kChunk + json_bytes);
  return {std::move(moved), json.origin};
}

}  // namespace

Recentred recentred(std::string content, const std::string& extension) {
  if (extension == "obj") return recentred_obj(std::move(content));
  if (extension == "ply") return recentred_ply(std::move(content));
  if (extension == "gltf") return recentred_gltf(std::move(content));
  if (extension == "glb") return recentred_glb(std::move(content));
  return {std::move(content)};
}

}  // namespace selenograph::engine
