#include "engine/visibility/object_shape.h"

#include <assimp/DefaultIOSystem.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <assimp/IOStream.hpp>
#include <assimp/Importer.hpp>
#include <memory>
#include <stdexcept>

#include "dem/error.h"

namespace selenograph::engine {
namespace {

// Assimp's readers of some formats (PLY's header, 5.2) wait for more at the end of a file, forever. A stream that has
// been asked in vain so often says so by an exception, which Assimp makes an error of.
class PatientStream : public Assimp::IOStream {
 public:
  explicit PatientStream(std::unique_ptr<Assimp::IOStream> stream) : stream_(std::move(stream)) {}
  std::size_t Read(void* to, std::size_t size, std::size_t count) override {
    const std::size_t got = stream_->Read(to, size, count);
    in_vain_ = got == 0 ? in_vain_ + 1 : 0;
    if (in_vain_ > 100) throw std::runtime_error("the file ends too early");
    return got;
  }
  std::size_t Write(const void*, std::size_t, std::size_t) override { return 0; }
  aiReturn Seek(std::size_t offset, aiOrigin origin) override { return stream_->Seek(offset, origin); }
  std::size_t Tell() const override { return stream_->Tell(); }
  std::size_t FileSize() const override { return stream_->FileSize(); }
  void Flush() override {}

 private:
  std::unique_ptr<Assimp::IOStream> stream_;
  int in_vain_ = 0;
};

class PatientFiles : public Assimp::DefaultIOSystem {
 public:
  Assimp::IOStream* Open(const char* path, const char* mode) override {
    std::unique_ptr<Assimp::IOStream> stream(DefaultIOSystem::Open(path, mode));
    return stream ? new PatientStream(std::move(stream)) : nullptr;
  }
};

Eigen::Vector3f vector_of(const aiVector3D& v) { return {v.x, v.y, v.z}; }

void add_corners(const aiMesh& mesh, const std::string& path, ObjectShape& out) {
  for (unsigned i = 0; i < mesh.mNumVertices; ++i) {
    const Eigen::Vector3f place = vector_of(mesh.mVertices[i]);
    const Eigen::Vector3f normal = mesh.HasNormals() ? vector_of(mesh.mNormals[i]) : Eigen::Vector3f::Zero();
    if (!place.allFinite()) throw DataError(path, "has a corner that isn't finite");
    const bool usable = normal.allFinite() && normal.norm() > 0;
    out.corners.push_back({place, usable ? Eigen::Vector3f(normal.normalized()) : Eigen::Vector3f::Zero()});
  }
}

void add_triangles(const aiMesh& mesh, std::uint32_t first_corner, ObjectShape& out) {
  for (unsigned i = 0; i < mesh.mNumFaces; ++i) {
    const aiFace& face = mesh.mFaces[i];
    if (face.mNumIndices != 3) continue;
    ObjectTriangle t{{}, mesh.mMaterialIndex};
    for (unsigned k = 0; k < 3; ++k) t.corner[k] = first_corner + face.mIndices[k];
    const Vec3 a = out.place(t, 0), ab = out.place(t, 1) - a, ac = out.place(t, 2) - a;
    if (ab.cross(ac).squaredNorm() > 0) out.triangles.push_back(t);
  }
}

// Assimp adds a material of its own that nothing may be made of.
void keep_used_parts(ObjectShape& shape) {
  std::vector<std::uint32_t> number(shape.parts.size(), ~0U);
  std::vector<std::string> used;
  for (ObjectTriangle& t : shape.triangles) {
    if (number[t.part] == ~0U) {
      number[t.part] = static_cast<std::uint32_t>(used.size());
      used.push_back(shape.parts[t.part]);
    }
    t.part = number[t.part];
  }
  shape.parts = std::move(used);
}

}  // namespace

ObjectShape read_object_shape(const std::string& path) {
  Assimp::Importer importer;
  importer.SetIOHandler(new PatientFiles);  // the importer's own from now on
  // What isn't a triangle by then is a point or a line.
  const aiScene* scene =
      importer.ReadFile(path, aiProcess_Triangulate | aiProcess_JoinIdenticalVertices | aiProcess_SortByPType |
                                  aiProcess_PreTransformVertices | aiProcess_ValidateDataStructure);
  if (!scene) throw DataError(path, fmt::format("can't be read as a mesh: {}", importer.GetErrorString()));
  ObjectShape shape;
  for (unsigned i = 0; i < scene->mNumMaterials; ++i) shape.parts.emplace_back(scene->mMaterials[i]->GetName().C_Str());
  if (shape.parts.empty()) shape.parts.emplace_back();
  for (unsigned i = 0; i < scene->mNumMeshes; ++i) {
    const aiMesh& mesh = *scene->mMeshes[i];
    const auto first = static_cast<std::uint32_t>(shape.corners.size());
    add_corners(mesh, path, shape);
    add_triangles(mesh, first, shape);
  }
  if (shape.triangles.empty()) throw DataError(path, "has no triangle");
  keep_used_parts(shape);
  return shape;
}

}  // namespace selenograph::engine
