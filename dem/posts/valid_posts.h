// Finds the valid posts of a file, and the places that they cover.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

// Thread-safe: const functions may be called concurrently.
class ValidPosts {
 public:
  // Reads posts of one file as PostSource::read() does.
  using Read = std::function<void(int source, int x0, int y0, int w, int h, float* heights_m)>;
  // With `fall_through` an unreadable file counts as if none of its posts were valid, and is appended to `unusable`;
  // otherwise DataError is thrown.
  ValidPosts(const Catalogue& catalogue, Read read, bool fall_through);

  // Validity of w x h posts of a file.
  void read(int source, std::int64_t x0, std::int64_t y0, int w, int h, std::vector<char>& valid,
            std::vector<SourceIndex>& unusable) const;

  // Adds to the cover of places: kInside where the nearest post is a valid one of the file, kBeside less than a post
  // outside a valid outermost one. Tiles of one product leave a gap of one post between them: a place beside two of
  // them is in that gap.
  static constexpr char kBeside = 1, kInside = 2;
  enum class Reach { none, half_a_post };  // extent of a file beyond its outermost posts
  void cover(int source, const std::vector<Geographic>& places, Reach reach, std::vector<char>& cover,
             std::vector<SourceIndex>& unusable) const;

 private:
  // A place and the nearest post of a file.
  struct Near {
    std::size_t place;
    int x, y;
    char cover;
  };
  static std::vector<Near> near(const RasterInfo& info, const std::vector<Geographic>& places, Reach reach,
                                const std::vector<char>& cover);

  const Catalogue& catalogue_;
  Read read_;
  bool fall_through_;
};

}  // namespace selenograph::dem
