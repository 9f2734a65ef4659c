#include "engine/object_shape.h"

#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <assimp/Importer.hpp>
#include <filesystem>

#include "dem/error.h"

namespace selenograph::engine {
namespace {

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

}  // namespace

ObjectShape read_object_shape(const std::string& path) {
  Assimp::Importer importer;
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
  return shape;
}

}  // namespace selenograph::engine
