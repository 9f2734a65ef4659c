// Resamples surface points seen by a frame's pixels to heights at the posts of a grid.
#pragma once

#include <span>
#include <vector>

#include "dem/base/stop_token.h"

namespace selenograph::engine {

// A surface point in post coordinates: x along rows of posts (eastwards), y across them (southwards). NaN: the pixel
// sees no ground.
struct SeenPoint {
  double x = 0, y = 0, height_m = 0;
};

// Posts x0 .. x0 + width - 1, y0 .. y0 + height - 1.
struct PostRectangle {
  int x0 = 0, y0 = 0, width = 0, height = 0;
};

// Returns one height per post, row by row; NaN for a post outside all triangles. Every 2 x 2 pixels form two triangles,
// and a post within one gets the height of its plane:
//
//   nw --- ne     Triangles wider than `widest_x` or higher than `widest_y` posts, or turned over, span hidden ground
//    | \    |     and are skipped.
//    |   \  |
//   sw --- se
//
// `pixels`: width x height, row 0 on top, columns eastwards and rows southwards. Throws Cancelled when stopped.
std::vector<double> resample(std::span<const SeenPoint> pixels, int width, int height, const PostRectangle& posts,
                             double widest_x, double widest_y, const StopToken& stop = {});

}  // namespace selenograph::engine
