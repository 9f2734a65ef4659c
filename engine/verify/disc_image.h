// A real image of the Moon's disc beside the frame of the same view.
#pragma once

#include <array>
#include <vector>

#include "dem/grid/geodesy.h"
#include "engine/camera/view.h"
#include "engine/frame/frame.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// Spectral radiance, W m-2 sr-1 um-1, of width x height, row 0 on top.
struct DiscImage {
  int width, height;
  std::vector<float> radiance;
  int per_pixel = 1;  // of a frame: its pixels along one of the image beside it
};

// How a spinning scanner displaces lines. It reads `lines` of them in a turn, upwards, and from turn to turn the Moon
// moves on by step_px to the right. Lines begin at whole pixels, so that half a pixel is the most that is left of it.
struct SpinScan {
  int lines = 1;
  double step_px = 0;
  // Of the bottom row: its place among the lines of its turn, and its turn's displacement.
  int first = 0;
  double phase_px = 0;

  double displacement_px(int row, int height) const;  // to the right, row 0 on top
};
// `scan` with the `first` and `phase_px` for which adjacent lines are most alike once they are moved back, to a
// fortieth of a pixel: from the images alone. `channels`: read at the same time, all of one size.
SpinScan scan_of(const std::vector<DiscImage>& channels, SpinScan scan);

// The same light spread by a Gaussian of sigma_px > 0 and moved by (dx, dy), at most half a pixel, and by the scan;
// then averaged over the image's pixels, in which all of these are.
struct Placement {
  double sigma_px = 0, dx_px = 0, dy_px = 0;
  SpinScan scan{};
};
DiscImage spread(const DiscImage& image, const Placement& by);

// Correlation over the pixels whose ray meets the sphere.
double disc_correlation(const DiscImage& observed, const DiscImage& frame, const View& view);

struct DiscComparison {
  double correlation;
  double scale;    // observed over frame, of the light of the disc
  double limb_px;  // mean distance of the observed lit limb outside the frame's
  // RMS of observed - scale * frame over the frame's mean: mare, highlands, limb (emission above 60 degrees),
  // terminator (incidence above 70 degrees). Mare is what is darker than 0.85 of the mean Moon in the frame.
  std::array<double, 4> residual;
};
inline constexpr std::array<const char*, 4> kDiscRegions{"mare", "highlands", "limb", "terminator"};

// `by` with the displacement that correlates best, to a twentieth of a pixel: where a real image's disc lies is known
// from the image alone.
Placement registered(const DiscImage& observed, const DiscImage& frame, const View& view, Placement by);

DiscComparison compare_disc(const DiscImage& observed, const DiscImage& frame, const FrameRequest& request);

}  // namespace selenograph::engine
