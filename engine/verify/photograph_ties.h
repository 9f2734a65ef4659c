// Tie points of a photograph and a frame of the same view, and the view fitted to them.
#pragma once

#include <span>
#include <vector>

#include "engine/camera/view.h"
#include "engine/verify/grey_image.h"

namespace selenograph::engine {

// Windows of the frame that are looked for in the photograph. Sizes follow from the image's shorter side, so that no
// photograph has settings of its own.
struct TieGrid {
  int half_px, step_px;  // a window is 2 half_px + 1 wide; windows are step_px apart
  double normalised_px;  // standard deviation of the local normalisation
  double min_correlation = 0.45;
};
TieGrid tie_grid(int width, int height);

// A window's middle in both images.
struct Tie {
  PixelXY frame, photograph;
  Vec3 ground_m;       // surface point that the frame shows there, MOON_ME
  double correlation;  // of the two windows, locally normalised
  // Ties alternate like the fields of a chessboard: the view is fitted to one colour and measured on the other.
  bool held_out;
};

// Finds the windows of the frame in the photograph, each within search_px of its own position, by normalised cross
// correlation with a parabola through its maximum. A window needs ground in 98 % of its pixels; a maximum on the border
// of the search is no tie. Images of fewer than 50 pixels have none. `radiance`: the frame; `position`: 3 per pixel, m,
// NaN without ground.
std::vector<Tie> find_ties(const GreyImage& photograph, const GreyImage& radiance, std::span<const double> position,
                           int search_px);

// Parameters of a view that its fit may change, besides the attitude.
struct FreeParameters {
  bool position = false, focal_length = false, aspect = false, principal_point = false, k1 = false;
};

struct CameraView {
  Camera camera;
  Pose pose;
};

// Fits the view to the ties that are not held out: Gauss-Newton on the distances in the image, with the weights of the
// loss sqrt(1 + (r / 0.5 px)^2) against false ties. The position is bound to its start with a standard deviation of 300
// m, the principal point with 1.5 px. Throws std::runtime_error if there are fewer than eight such ties.
CameraView fitted_view(const CameraView& start, const FreeParameters& free, std::span<const Tie> ties);

// Returns photograph minus projected ground, px, of the ties that are held out or not.
std::vector<double> tie_distances_px(const CameraView& view, std::span<const Tie> ties, bool held_out);

}  // namespace selenograph::engine
