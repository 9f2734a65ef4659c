// Measures by which a photograph and a frame of the same view are compared: tone, shadows, radiance.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "engine/verify/grey_image.h"

namespace selenograph::engine {

// The frame's arrays, of the photograph's size.
struct PhotographFrame {
  GreyImage radiance, lit;
  std::span<const double> position;  // 3 per pixel, m, NaN without ground
};

// Returns the pixels that are compared: ground in the frame, and not within 1/64 of the image's shorter side of its
// borders, where scans have frames and labels.
PixelMask compared_pixels(const GreyImage& photograph, const PhotographFrame& frame);

// Returns the photograph's value that separates shadow from sunlit ground: the valley of its histogram between the peak
// of shadow, which is below half of the median, and the median (the mode method, Prewitt & Mendelsohn 1966). It does
// not depend on the frame. NaN if there is no such peak, twice as high as the valley.
double shadow_threshold(const GreyImage& photograph, const PixelMask& mask);

// Shadows of at least 40 pixels in the photograph or the frame, and the smaller ones within three pixels of them.
struct ShadowMasks {
  int factor;  // their pixels along one pixel of the photograph
  int width, height;
  PixelMask photograph, frame;
};

struct ShadowMeasures {
  double threshold;                    // value of the photograph below which it is in shadow
  double photograph_share;             // share of the compared pixels
  double area_ratio;                   // frame over photograph
  double overlap;                      // intersection over union
  double edge_median_px, edge_p90_px;  // distance of an edge to the nearest of the other image, both ways
  ShadowMasks masks;
};

// Compares shadows: in the frame where less than half of the Sun is visible, in the photograph where it is darker than
// shadow_threshold(). Empty if neither has a shadow of 40 pixels.
std::optional<ShadowMeasures> compare_shadows(const GreyImage& photograph, const PhotographFrame& frame,
                                              const PixelMask& mask);

struct PhotographMeasures {
  // Correlation over the compared pixels of the photograph and the frame with its tone curve; the same with the
  // photograph blurred by one pixel, which removes the grain of film.
  double tone = 0, tone_blurred = 0;
  std::optional<ShadowMeasures> shadows;
  double radiance_ratio = 0;  // photograph over frame, where the photograph is radiance
  GreyImage toned_frame;      // in the photograph's values
};

PhotographMeasures compare_photograph(const GreyImage& photograph, const PhotographFrame& frame);

}  // namespace selenograph::engine
