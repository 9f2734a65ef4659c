// Which posts of a file are valid, and which places they cover.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

// const means safe to call concurrently.
class ValidPosts {
 public:
  // Posts of one file, as PostSource::read() has them.
  using Read = std::function<void(int source, int x0, int y0, int w, int h, float* heights_m)>;
  // With `fall_through` a file that can't be read counts as if none of its posts were valid, and is appended to
  // `unusable`; without it throws DataError.
  ValidPosts(const Catalogue& catalogue, Read read, bool fall_through);

  // Of a piece of a file that is w x h posts.
  void read(int source, std::int64_t x0, std::int64_t y0, int w, int h, std::vector<char>& valid,
            std::vector<SourceIndex>& unusable) const;

  // Adds to the cover of places: kInside where the nearest post is a valid one of the file, kBeside less than a post
  // outside of a valid outermost one. Tiles of one product leave a gap of a post between them: what is beside two of
  // them lies between.
  static constexpr char kBeside = 1, kInside = 2;
  enum class Reach { none, half_a_post };  // of a file beyond its outermost posts
  void cover(int source, const std::vector<Geographic>& places, Reach reach, std::vector<char>& cover,
             std::vector<SourceIndex>& unusable) const;

 private:
  // A place by the post of a file that is nearest to it.
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
