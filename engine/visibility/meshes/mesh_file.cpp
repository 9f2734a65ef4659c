#include "engine/visibility/meshes/mesh_file.h"

#include <assimp/BaseImporter.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>

#include <algorithm>
#include <assimp/IOStream.hpp>
#include <assimp/IOSystem.hpp>
#include <assimp/Importer.hpp>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <vector>

#include "engine/support/utf8.h"

namespace selenograph::engine {
namespace {

// A stream over memory. The readers of some formats (the header of PLY in 5.2) retry forever at the end of a file.
// After many reads without data the stream therefore throws, which Assimp turns into an error.
class MemoryStream : public Assimp::IOStream {
 public:
  explicit MemoryStream(std::string_view content) : content_(content) {}
  std::size_t Read(void* to, std::size_t size, std::size_t count) override {
    if (size == 0 || count == 0) return 0;
    const std::size_t items = std::min(count, (content_.size() - at_) / size);
    std::memcpy(to, content_.data() + at_, items * size);
    at_ += items * size;
    empty_reads_ = items == 0 ? empty_reads_ + 1 : 0;
    if (empty_reads_ > 100) throw std::runtime_error("the file ends too early");
    return items;
  }
  std::size_t Write(const void*, std::size_t, std::size_t) override { return 0; }
  aiReturn Seek(std::size_t offset, aiOrigin origin) override {
    const std::size_t from = origin == aiOrigin_SET ? 0 : origin == aiOrigin_CUR ? at_ : content_.size();
    const std::size_t to = from + offset;  // a negative offset wraps modulo 2^64
    if (to > content_.size()) return aiReturn_FAILURE;
    at_ = to;
    return aiReturn_SUCCESS;
  }
  std::size_t Tell() const override { return at_; }
  std::size_t FileSize() const override { return content_.size(); }
  void Flush() override {}

 private:
  const std::string_view content_;
  std::size_t at_ = 0;
  int empty_reads_ = 0;
};

// A file system that contains one file.
class OneFile : public Assimp::IOSystem {
 public:
  OneFile(std::string name, std::string_view content, std::string& refused_path)
      : name_(std::move(name)), content_(content), refused_path_(refused_path) {}
  bool Exists(const char* path) const override { return path == name_; }
  char getOsSeparator() const override { return '/'; }
  Assimp::IOStream* Open(const char* path, const char* mode) override {
    if (path == name_ && mode[0] == 'r') return new MemoryStream(content_);
    refused_path_ = path;
    return nullptr;
  }
  void Close(Assimp::IOStream* stream) override { delete stream; }

 private:
  const std::string name_;
  const std::string_view content_;
  std::string& refused_path_;  // path of the last other file that Assimp tried to open
};

// Keeps only the readers for the extension. Assimp would try all of its sixty readers on a file that these reject.
void keep_readers_of(const std::string& extension, Assimp::Importer& importer) {
  for (std::size_t i = importer.GetImporterCount(); i-- > 0;) {
    const std::string extensions = fmt::format(" {} ", importer.GetImporterInfo(i)->mFileExtensions);
    if (extensions.find(" " + extension + " ") != std::string::npos) continue;
    Assimp::BaseImporter* const reader = importer.GetImporter(i);
    importer.UnregisterLoader(reader);
    delete reader;
  }
}

[[noreturn]] void refuse_size(double bytes, std::size_t max_bytes) {
  throw std::runtime_error(fmt::format("would take {:.0f} MiB, more than the {:.0f} of a mesh", bytes / 0x1p20,
                                       static_cast<double>(max_bytes) / 0x1p20));
}

// Throws if all instances together take too much memory, before they are made: nodes are instances.
void check_instances(const aiScene& scene, std::size_t max_bytes) {
  std::vector<double> bytes_of_mesh;
  for (unsigned i = 0; i < scene.mNumMeshes; ++i) {
    const aiMesh& mesh = *scene.mMeshes[i];
    double triangles = 0;
    for (unsigned k = 0; k < mesh.mNumFaces; ++k) triangles += std::max(2U, mesh.mFaces[k].mNumIndices) - 2;
    bytes_of_mesh.push_back(mesh.mNumVertices * double{sizeof(ObjectCorner)} +
                            triangles * double{sizeof(ObjectTriangle)});
  }
  double bytes = 0;
  std::vector<const aiNode*> nodes{scene.mRootNode};
  while (!nodes.empty()) {
    const aiNode& node = *nodes.back();
    nodes.pop_back();
    for (unsigned i = 0; i < node.mNumMeshes; ++i) bytes += bytes_of_mesh[node.mMeshes[i]];
    nodes.insert(nodes.end(), node.mChildren, node.mChildren + node.mNumChildren);
  }
  if (bytes > static_cast<double>(max_bytes)) refuse_size(bytes, max_bytes);
}

Vec3f vector_of(const aiVector3D& v) { return {v.x, v.y, v.z}; }

void add_corners(const aiMesh& mesh, ObjectShape& out) {
  for (unsigned i = 0; i < mesh.mNumVertices; ++i) {
    const Vec3f position = vector_of(mesh.mVertices[i]);
    const Vec3f normal = mesh.HasNormals() ? vector_of(mesh.mNormals[i]) : Vec3f::zero();
    if (!position.is_finite()) throw std::runtime_error("has a corner that is not finite");
    const bool usable = normal.is_finite() && normal.norm() > 0;
    out.corners.push_back({position, usable ? Vec3f(normal.normalized()) : Vec3f::zero()});
  }
}

void add_triangles(const aiMesh& mesh, std::uint32_t first_corner, ObjectShape& out) {
  for (unsigned i = 0; i < mesh.mNumFaces; ++i) {
    const aiFace& face = mesh.mFaces[i];
    if (face.mNumIndices != 3) continue;
    ObjectTriangle t{{}, mesh.mMaterialIndex};
    for (unsigned k = 0; k < 3; ++k) {
      if (face.mIndices[k] >= mesh.mNumVertices) throw std::runtime_error("has a corner that is not there");
      t.corner[k] = first_corner + face.mIndices[k];
    }
    const Vec3 a = out.place(t, 0), ab = out.place(t, 1) - a, ac = out.place(t, 2) - a;
    if (ab.cross(ac).squared_norm() > 0) out.triangles.push_back(t);
  }
}

// Returns the line number of a name in a text file, as a prefix of a message; empty if the name is not found.
std::string line_of(const std::string& name, std::string_view content) {
  const std::size_t at = content.find(name);
  if (at == std::string_view::npos) return {};
  return fmt::format("line {}: ",
                     1 + std::count(content.begin(), content.begin() + static_cast<std::ptrdiff_t>(at), '\n'));
}

// Drops materials that no triangle uses: Assimp adds one of its own.
void keep_used_parts(ObjectShape& shape) {
  std::vector<std::uint32_t> new_index(shape.parts.size(), ~0U);
  std::vector<std::string> used_parts;
  for (ObjectTriangle& t : shape.triangles) {
    if (t.part >= new_index.size()) throw std::runtime_error("has a material that is not there");
    if (new_index[t.part] == ~0U) {
      new_index[t.part] = static_cast<std::uint32_t>(used_parts.size());
      used_parts.push_back(shape.parts[t.part]);
    }
    t.part = new_index[t.part];
  }
  shape.parts = std::move(used_parts);
}

bool has_textures(const aiScene& scene) {
  if (scene.mNumTextures > 0) return true;
  for (unsigned i = 0; i < scene.mNumMaterials; ++i)
    for (int type = aiTextureType_NONE + 1; type <= AI_TEXTURE_TYPE_MAX; ++type)
      if (scene.mMaterials[i]->GetTextureCount(static_cast<aiTextureType>(type)) > 0) return true;
  return false;
}

// Required extensions of glTF that do not change the shape.
constexpr std::string_view kAppearanceExtensions[] = {"KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_",
                                                      "KHR_xmp"};

// Refuses a glTF that requires an extension of its geometry: Assimp misreads quantised or compressed numbers. The list
// of names is found in the text of .gltf, and of .glb, which starts with such text.
void refuse_extensions(std::string_view content, const std::string& extension) {
  if (extension != "glb" && extension != "gltf") return;
  const std::size_t key = content.find("\"extensionsRequired\"");
  if (key == std::string_view::npos) return;
  const std::size_t first = std::min(content.find('[', key), content.size());
  std::string_view list = content.substr(first, content.find(']', first) - first);
  for (std::size_t at = list.find('"'); at != std::string_view::npos; at = list.find('"')) {
    list.remove_prefix(at + 1);
    const std::string_view name = list.substr(0, list.find('"'));
    list.remove_prefix(std::min(name.size() + 1, list.size()));
    const auto begins_name = [&](std::string_view beginning) { return name.starts_with(beginning); };
    if (std::ranges::none_of(kAppearanceExtensions, begins_name))
      throw std::runtime_error(fmt::format(
          "requires the glTF extension {}, which is not read: write it without extensions of geometry, e.g. "
          "gltf-transform dequantize in.glb out.glb, or as OBJ, PLY or STL",
          name));
  }
}

// Returns the reason why a file cannot be read. References of an OBJ to material files are not an error.
std::string why_not(const Assimp::Importer& importer, const std::string& extension, const std::string& refused_path) {
  if (!refused_path.empty() && extension != "obj")
    return fmt::format(
        "names another file, \"{}\", which is not read: a mesh must be one file (.glb, or .gltf with data: URIs)",
        refused_path);
  return fmt::format("cannot be read as a mesh: {}", importer.GetErrorString());
}

}  // namespace

ObjectShape read_mesh_file(std::string_view content, const std::string& extension, std::size_t max_bytes) {
  refuse_extensions(content, extension);
  const std::string name = "mesh." + extension;
  std::string refused_path;
  Assimp::Importer importer;
  keep_readers_of(extension, importer);
  importer.SetIOHandler(new OneFile(name, content, refused_path));  // the importer owns it from now on
  const aiScene* scene = importer.ReadFile(name, aiProcess_ValidateDataStructure);
  if (!scene || !scene->mRootNode) throw std::runtime_error(why_not(importer, extension, refused_path));
  check_instances(*scene, max_bytes);
  // After these steps, all faces that are not triangles are points or lines.
  scene = importer.ApplyPostProcessing(aiProcess_Triangulate | aiProcess_JoinIdenticalVertices | aiProcess_SortByPType |
                                       aiProcess_PreTransformVertices);
  if (!scene) throw std::runtime_error(why_not(importer, extension, refused_path));

  ObjectShape shape;
  shape.textured = has_textures(*scene);
  for (unsigned i = 0; i < scene->mNumMaterials; ++i) shape.parts.emplace_back(scene->mMaterials[i]->GetName().C_Str());
  if (shape.parts.empty()) shape.parts.emplace_back();
  for (unsigned i = 0; i < scene->mNumMeshes; ++i) {
    const aiMesh& mesh = *scene->mMeshes[i];
    const auto first = static_cast<std::uint32_t>(shape.corners.size());
    add_corners(mesh, shape);
    add_triangles(mesh, first, shape);
    if (shape.bytes() > max_bytes) refuse_size(static_cast<double>(shape.bytes()), max_bytes);
  }
  if (shape.triangles.empty()) throw std::runtime_error("has no triangle");
  keep_used_parts(shape);
  for (const std::string& part : shape.parts)
    if (!is_utf8(part))
      throw std::runtime_error(fmt::format("{}the name of a material is not UTF-8", line_of(part, content)));
  return shape;
}

}  // namespace selenograph::engine
