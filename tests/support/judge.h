// The surface and its shadows in double precision, straight from the files: what the engine is judged by.
//
// Shares nothing with engine/ or with the meshes and pyramids of dem/ but the sphere: it reads Kaguya tiles itself and
// knows the Moon as plane triangles between posts at (row / ppd, column / ppd) degrees, two per quad, the diagonal from
// the south-east to the north-west post. Rays are marched in steps that are provably shorter than a post, so it is slow
// and plain. Frame MOON_ME, metres. Within 75 degrees of the equator (towards the poles the lattice of the engine
// leaves out posts).
//
// Voids: how they are filled is not the judge's business. Wherever the answer could hang on a void it is `unknown`.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::test {

// A triangle: the quad's south-west post (rows and columns from the mosaic's south-west corner) and which half.
struct Face {
  int row = -1, column = -1;
  bool north_east = false;
  bool operator==(const Face&) const = default;
};

// Counter-clockwise from outside.
struct FaceVertices {
  Vec3 a, b, c;
  Vec3 normal() const { return (b - a).cross(c - a).normalized(); }
};

enum class Verdict { no, yes, unknown };

struct FirstHit {
  Verdict hit = Verdict::no;
  double distance_m = std::numeric_limits<double>::infinity();
  Face face;
  bool from_above = false;
};

class Judge {
 public:
  // All *.lbl files of a folder, one mosaic of equal resolution. `raised_m` falsifies: the whole surface is lifted by
  // it, for tests of whether the judge notices. Throws std::runtime_error for anything that it doesn't read.
  explicit Judge(const std::string& folder, double raised_m = 0);

  int posts_per_degree() const { return ppd_; }
  int rows() const { return rows_; }        // of posts, south to north
  int columns() const { return columns_; }  // west to east
  double south_deg() const { return static_cast<double>(south_) / ppd_; }
  double west_deg() const { return static_cast<double>(west_) / ppd_; }

  // Empty where a post is missing or void.
  std::optional<FaceVertices> vertices(const Face& face) const;

  // The first triangle that a ray (unit direction) meets, from whichever side.
  FirstHit first_hit(const Vec3& origin, const Vec3& direction) const;

  // The same by testing every triangle there is: what first_hit is judged by.
  FirstHit first_hit_by_brute_force(const Vec3& origin, const Vec3& direction) const;

  // Whether anything but `face` itself, which the point lies on, stands between the point and the Sun.
  Verdict sun_blocked(const Vec3& point, const Face& face, const Vec3& sun) const;

  // Whether the Sun ray passes within `margin_m`, vertically, of changing its verdict: a blocked one is free once it is
  // lifted by the margin; a free one is blocked once it is lowered by it (from where it has left its own triangle's
  // plane).
  bool grazes(const Vec3& point, const Face& face, const Vec3& sun, double margin_m) const;

  // Vertical distance of a point above the triangle that lies in its direction, times the cosine of that triangle's
  // slope: its distance from the plane. Empty over voids and outside.
  std::optional<double> height_above_surface(const Vec3& point) const;

 private:
  struct Maxima {
    int factor = 1;  // quads per cell side
    int rows = 0, columns = 0;
    std::vector<std::int16_t>
        highest;  // of the cell and its eight neighbours; a rim of one cell around the mosaic is included
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

  int ppd_ = 0, south_ = 0, west_ = 0, rows_ = 0,
      columns_ = 0;  // south and west in posts from the equator and the meridian
  double raised_m_ = 0;
  double lowest_m_ = 0, highest_m_ = 0;
  std::vector<std::int16_t> posts_;
  std::vector<std::int16_t> void_highest_;  // per post: the highest valid post around its void, where it is one
  std::vector<double> sin_lat_, cos_lat_, sin_lon_, cos_lon_;
  std::array<Maxima, 3> maxima_;
};

}  // namespace selenograph::test
