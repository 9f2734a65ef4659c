// Compares a real image of the Moon's disc with a frame of the same view.
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
  int per_pixel = 1;  // for a frame: its pixels along one pixel of the real image
};

// Displacement of lines by a spinning scanner. It reads `lines` lines per turn, upwards, and from turn to turn the Moon
// moves by step_px to the right. Lines begin at whole pixels, so that the displacement is at most half a pixel.
struct SpinScan {
  int lines = 1;
  double step_px = 0;
  // The bottom row's index among the lines of its turn, and its turn's displacement.
  int first = 0;
  double phase_px = 0;

  double displacement_px(int row, int height) const;  // to the right, row 0 on top
};
// Returns `scan` with the `first` and `phase_px` for which adjacent lines are smoothest after undoing the displacement,
// to a fortieth of a pixel. Uses only the images. `channels`: read at the same time, all of the same size.
SpinScan scan_of(const std::vector<DiscImage>& channels, SpinScan scan);

// A point spread and a displacement, in pixels of the real image: a Gaussian of sigma_px > 0, (dx, dy) of at most half
// a pixel, and the scan.
struct Placement {
  double sigma_px = 0, dx_px = 0, dy_px = 0;
  SpinScan scan{};
};
// Returns a frame spread and displaced, and averaged over the real image's pixels.
DiscImage spread(const DiscImage& image, const Placement& by);

// Returns the correlation over the pixels whose rays hit the sphere.
double disc_correlation(const DiscImage& observed, const DiscImage& frame, const View& view);

struct DiscComparison {
  double correlation;
  double scale;    // light of the observed disc over that of the frame's
  double limb_px;  // mean distance of the observed lit limb outside the frame's
  // RMS of observed - scale * frame over the frame's mean: mare, highlands, limb (emission above 60 degrees),
  // terminator (incidence above 70 degrees). Mare: pixels of the frame darker than 0.85 of the mean Moon.
  std::array<double, 4> residual;
};
inline constexpr std::array<const char*, 4> kDiscRegions{"mare", "highlands", "limb", "terminator"};

// Returns `by` with the displacement that correlates best, to a twentieth of a pixel. The disc's position in a real
// image is known only from the image itself.
Placement registered(const DiscImage& observed, const DiscImage& frame, const View& view, Placement by);

DiscComparison compare_disc(const DiscImage& observed, const DiscImage& frame, const FrameRequest& request);

}  // namespace selenograph::engine
