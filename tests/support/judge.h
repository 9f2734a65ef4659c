// A reference for the surface and its shadows, in double precision and straight from the files. Frame MOON_ME, metres.
//
// It shares nothing with engine/ or with the meshes and pyramids of dem/ but the sphere. It reads Kaguya tiles itself,
// and marches rays in steps that are provably shorter than a post, so it is slow and plain. Its Moon consists of two
// plane triangles for each quad of posts:
//
//   north-west +---+ north-east     posts at (row / ppd, column / ppd) degrees from the mosaic's south-west corner
//              |\  |
//              | \ |                Face::north_east names the half beyond the diagonal
//              |  \|
//   south-west +---+ south-east
//
// It covers latitudes up to 75 degrees: poleward, the engine's lattice leaves out posts. It does not fill voids: an
// answer that could depend on a void is `unknown`.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::test {

// A triangle: its quad's south-west post, and the half of the quad. Rows and columns count from the mosaic's south-west
// corner.
struct Face {
  int row = -1, column = -1;
  bool north_east = false;
  bool operator==(const Face&) const = default;
};

// Vertices of a triangle, counter-clockwise seen from outside.
struct FaceVertices {
  Vec3 a, b, c;
  Vec3 normal() const { return (b - a).cross(c - a).normalized(); }
};

// Answer to a yes-or-no question; unknown where it could depend on a void.
enum class Verdict { no, yes, unknown };

// The first triangle that a ray hits.
struct FirstHit {
  Verdict hit = Verdict::no;
  double distance_m = std::numeric_limits<double>::infinity();
  Face face;
  bool from_above = false;  // false: from below the surface, as through the mosaic's rim
};

class Judge {
 public:
  // Reads all *.lbl files of a folder as one mosaic of equal resolution. `raised_m` lifts the whole surface, for tests
  // that the judge notices a wrong one. Throws std::runtime_error for files that it cannot read.
  explicit Judge(const std::string& folder, double raised_m = 0);

  int posts_per_degree() const { return ppd_; }
  int rows() const { return rows_; }        // number of rows of posts, from south to north
  int columns() const { return columns_; }  // number of columns of posts, from west to east
  double south_deg() const { return static_cast<double>(south_) / ppd_; }
  double west_deg() const { return static_cast<double>(west_) / ppd_; }

  // Returns a triangle's vertices; empty where a post is missing or void.
  std::optional<FaceVertices> vertices(const Face& face) const;

  // Returns the first triangle that a ray (unit direction) hits, from either side.
  FirstHit first_hit(const Vec3& origin, const Vec3& direction) const;

  // Returns the same by testing every triangle, as a reference for first_hit().
  FirstHit first_hit_by_brute_force(const Vec3& origin, const Vec3& direction) const;

  // Tells if a triangle other than `face`, on which the point lies, is between the point and the Sun.
  Verdict sun_blocked(const Vec3& point, const Face& face, const Vec3& sun) const;

  // Returns true if the verdict on the ray to the Sun changes when the ray is moved vertically by `margin_m`: a blocked
  // one is free once lifted; a free one is blocked once lowered, from where it leaves its own triangle's plane.
  bool grazes(const Vec3& point, const Face& face, const Vec3& sun, double margin_m) const;

  // Returns a point's distance from the plane of the triangle below or above it: the vertical distance times the cosine
  // of the triangle's slope. Empty over voids and outside the mosaic.
  std::optional<double> height_above_surface(const Vec3& point) const;

 private:
  // Greatest heights in square cells of quads, by which march() skips stretches of a ray that are above all ground.
  struct Maxima {
    int factor = 1;  // quads per cell side
    int rows = 0, columns = 0;
    // Height of each cell with its eight neighbours, m. A rim of one cell around the mosaic is included.
    std::vector<std::int16_t> highest;
    double at(int quad_row, int quad_column) const;
  };
  struct Crossing {
    double distance_m;
    bool from_above;
  };
  struct Place {
    double row, column;
  };

  void place_tiles(const std::string& folder);
  void bound_voids();
  Maxima maxima(int factor) const;
  std::int16_t highest_of_quad(int row, int column) const;
  std::int16_t post(int row, int column) const {
    return posts_[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
                  static_cast<std::size_t>(column)];
  }
  bool has_void(int row, int column) const;
  Vec3 position(int row, int column) const;
  Place place_of(const Vec3& p) const;
  std::optional<Crossing> cross(const Face& face, const Vec3& origin, const Vec3& direction) const;
  template <typename Visit>
  void march(const Vec3& origin, const Vec3& direction, double from_m, Visit&& visit) const;
  Verdict crosses_any(const Vec3& origin, const Vec3& direction, double from_m, const Face* except) const;

  int ppd_ = 0;               // posts per degree
  int south_ = 0, west_ = 0;  // first row and column, in posts from the equator and the prime meridian
  int rows_ = 0, columns_ = 0;
  double raised_m_ = 0;
  double lowest_m_ = 0, highest_m_ = 0;
  std::vector<std::int16_t> posts_;
  std::vector<std::int16_t> void_highest_;  // for a void post: the highest valid post around its void
  std::vector<double> sin_lat_, cos_lat_, sin_lon_, cos_lon_;
  std::array<Maxima, 3> maxima_;
};

}  // namespace selenograph::test
