#include "engine/verify/photograph_measures.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace selenograph::engine {
namespace {

constexpr int kFactor = 4;          // pixels of shadow masks along a pixel of the photograph
constexpr int kMinShadow_px = 40;   // smallest shadow that is compared
constexpr int kMinFragment_px = 5;  // smallest fragment near such a shadow
constexpr int kZone_px = 3;         // distance up to which fragments count

// A mask with its size.
struct Mask {
  int width, height;
  PixelMask inside;

  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  }
};

// Returns the mask of the values that fulfil the predicate within `limits`.
template <typename Predicate>
Mask mask_where(const GreyImage& image, const Mask& limits, const Predicate& predicate) {
  Mask out = limits;
  for (std::size_t i = 0; i < out.inside.size(); ++i) out.inside[i] = limits.inside[i] && predicate(image.values[i]);
  return out;
}

// Returns the mask without its 4-connected components of fewer pixels.
Mask without_small_components(const Mask& mask, std::size_t min_pixels) {
  Mask out = mask;
  std::vector<std::size_t> component;
  PixelMask visited(mask.inside.size(), 0);
  for (std::size_t first = 0; first < mask.inside.size(); ++first) {
    if (!mask.inside[first] || visited[first]) continue;
    component.assign(1, first);
    visited[first] = 1;
    for (std::size_t k = 0; k < component.size(); ++k) {
      const std::size_t at = component[k], width = static_cast<std::size_t>(mask.width);
      const std::size_t x = at % width;
      const auto visit = [&](bool exists, std::size_t next) {
        if (!exists || !mask.inside[next] || visited[next]) return;
        visited[next] = 1;
        component.push_back(next);
      };
      visit(x > 0, at - 1);
      visit(x + 1 < width, at + 1);
      visit(at >= width, at - width);
      visit(at + width < mask.inside.size(), at + width);
    }
    if (component.size() < min_pixels)
      for (const std::size_t at : component) out.inside[at] = 0;
  }
  return out;
}

// Replaces squared distances along a line by the lower envelope of the parabolas at its elements.
void envelope(std::vector<double>& line, std::vector<int>& roots, std::vector<double>& from) {
  const int count = static_cast<int>(line.size());
  roots.clear();
  from.clear();
  const auto at = [&](int k) { return line[static_cast<std::size_t>(k)]; };
  for (int k = 0; k < count; ++k) {
    if (std::isinf(at(k))) continue;
    double begin = -std::numeric_limits<double>::infinity();
    while (!roots.empty()) {
      const int root = roots.back();
      begin = (at(k) + static_cast<double>(k) * k - at(root) - static_cast<double>(root) * root) / (2.0 * (k - root));
      if (begin > from.back()) break;
      roots.pop_back();
      from.pop_back();
    }
    from.push_back(roots.empty() ? -std::numeric_limits<double>::infinity() : begin);
    roots.push_back(k);
  }
  if (roots.empty()) return;
  const std::vector<double> heights = line;
  for (std::size_t parabola = 0, k = 0; k < line.size(); ++k) {
    while (parabola + 1 < roots.size() && from[parabola + 1] < static_cast<double>(k)) ++parabola;
    const int root = roots[parabola];
    line[k] = std::pow(static_cast<double>(k) - root, 2) + heights[static_cast<std::size_t>(root)];
  }
}

// Returns each pixel's squared distance to the nearest pixel of the mask; infinity if it is empty (Felzenszwalb &
// Huttenlocher 2012).
std::vector<double> squared_distances(const Mask& mask) {
  std::vector<double> out(mask.inside.size());
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = mask.inside[i] ? 0 : std::numeric_limits<double>::infinity();
  std::vector<double> line, from;
  std::vector<int> roots;
  const auto pass = [&](int lines, int count, const auto& index) {
    for (int k = 0; k < lines; ++k) {
      line.clear();
      for (int j = 0; j < count; ++j) line.push_back(out[index(k, j)]);
      envelope(line, roots, from);
      for (int j = 0; j < count; ++j) out[index(k, j)] = line[static_cast<std::size_t>(j)];
    }
  };
  pass(mask.width, mask.height, [&](int x, int y) { return mask.index(x, y); });
  pass(mask.height, mask.width, [&](int y, int x) { return mask.index(x, y); });
  return out;
}

// Returns the mask's pixels with a neighbour outside it. Pixels on the image's border are not edges.
Mask edges_of(const Mask& mask) {
  Mask out{mask.width, mask.height, PixelMask(mask.inside.size(), 0)};
  for (int y = 1; y + 1 < mask.height; ++y)
    for (int x = 1; x + 1 < mask.width; ++x)
      out.inside[mask.index(x, y)] =
          mask.inside[mask.index(x, y)] && !(mask.inside[mask.index(x - 1, y)] && mask.inside[mask.index(x + 1, y)] &&
                                             mask.inside[mask.index(x, y - 1)] && mask.inside[mask.index(x, y + 1)]);
  return out;
}

double count_of(const Mask& mask) { return static_cast<double>(std::count(mask.inside.begin(), mask.inside.end(), 1)); }

// Returns the mask of the pixels that are at most `distance` pixels from it.
Mask dilated(const Mask& mask, double distance) {
  const std::vector<double> squared = squared_distances(mask);
  Mask out = mask;
  for (std::size_t i = 0; i < squared.size(); ++i) out.inside[i] = squared[i] <= distance * distance;
  return out;
}

Mask intersection(Mask a, const Mask& b) {
  for (std::size_t i = 0; i < a.inside.size(); ++i) a.inside[i] = a.inside[i] && b.inside[i];
  return a;
}

Mask joined(Mask a, const Mask& b) {
  for (std::size_t i = 0; i < a.inside.size(); ++i) a.inside[i] = a.inside[i] || b.inside[i];
  return a;
}

// Appends the distances of an edge's pixels within `limits` to the nearest pixel of the target edge, px of the
// photograph.
void append_distances(const Mask& edge, const Mask& limits, const Mask& target, std::vector<double>& out) {
  const std::vector<double> squared = squared_distances(target);
  for (std::size_t i = 0; i < squared.size(); ++i)
    if (edge.inside[i] && limits.inside[i] && std::isfinite(squared[i])) out.push_back(std::sqrt(squared[i]) / kFactor);
}

// Returns the value with a share of the values below it.
double quantile_of(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

Mask enlarged_mask(const PixelMask& mask, int width, int height) {
  Mask out{width * kFactor, height * kFactor, {}};
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x)
      out.inside.push_back(mask[static_cast<std::size_t>(y / kFactor) * static_cast<std::size_t>(width) +
                                static_cast<std::size_t>(x / kFactor)]);
  return out;
}

}  // namespace

PixelMask compared_pixels(const GreyImage& photograph, const PhotographFrame& frame) {
  const int width = photograph.width, height = photograph.height, border = std::min(width, height) / 64;
  PixelMask out(photograph.values.size(), 0);
  for (int y = border; y < height - border; ++y)
    for (int x = border; x < width - border; ++x) {
      const std::size_t i = photograph.index(x, y);
      out[i] = std::isfinite(photograph.values[i]) && std::isfinite(frame.position[3 * i]);
    }
  return out;
}

double shadow_threshold(const GreyImage& photograph, const PixelMask& mask) {
  constexpr int kBins = 256;
  constexpr double kSmoothing_bins = 3;
  std::vector<double> values;
  for (std::size_t i = 0; i < mask.size(); ++i)
    if (mask[i]) values.push_back(photograph.values[i]);
  if (values.empty()) return std::nan("");
  const double bright = quantile_of(values, 0.999), median = median_of(values);
  if (!(median > 0)) return std::nan("");
  // The histogram is an image of one row, so that the Gaussian of images smooths it.
  GreyImage histogram{kBins, 1, std::vector<double>(kBins, 0)};
  const auto bin = [&](double value) { return std::clamp(static_cast<int>(value / bright * kBins), 0, kBins - 1); };
  for (const double value : values) histogram.values[histogram.index(bin(value), 0)] += 1;
  const std::vector<double> counts = blurred(histogram, kSmoothing_bins).values;
  const auto peak = std::max_element(counts.begin(), counts.begin() + bin(median / 2) + 1);
  const auto valley = std::min_element(peak, counts.begin() + bin(median) + 1);
  if (*valley > *peak / 2) return std::nan("");
  return (static_cast<double>(valley - counts.begin()) + 0.5) * bright / kBins;
}

std::optional<ShadowMeasures> compare_shadows(const GreyImage& photograph, const PhotographFrame& frame,
                                              const PixelMask& mask) {
  constexpr auto kArea = static_cast<std::size_t>(kFactor * kFactor);
  const double threshold = shadow_threshold(photograph, mask);
  if (!std::isfinite(threshold)) return std::nullopt;
  const Mask limits = enlarged_mask(mask, photograph.width, photograph.height);
  const auto dark = [](double limit) { return [limit](double value) { return value < limit; }; };
  const Mask all_a = mask_where(enlarged(photograph, kFactor), limits, dark(threshold)),
             all_b = mask_where(enlarged(frame.lit, kFactor), limits, dark(0.5));
  const Mask large_a = without_small_components(all_a, kMinShadow_px * kArea),
             large_b = without_small_components(all_b, kMinShadow_px * kArea);
  const Mask zone = dilated(joined(large_a, large_b), kZone_px * kFactor);
  const Mask a = intersection(without_small_components(all_a, kMinFragment_px * kArea), zone),
             b = intersection(without_small_components(all_b, kMinFragment_px * kArea), zone);
  if (count_of(a) == 0 || count_of(b) == 0) return std::nullopt;
  ShadowMeasures out;
  out.threshold = threshold;
  out.photograph_share = count_of(all_a) / count_of(limits);
  out.area_ratio = count_of(b) / count_of(a);
  out.overlap = count_of(intersection(a, b)) / count_of(joined(a, b));
  // An edge on the border of the compared pixels is the border's.
  Mask excluded = limits;
  for (std::uint8_t& value : excluded.inside) value = !value;
  Mask inner = dilated(excluded, 2 * kFactor);
  for (std::uint8_t& value : inner.inside) value = !value;
  std::vector<double> distances;
  append_distances(edges_of(large_a), inner, edges_of(b), distances);
  append_distances(edges_of(large_b), inner, edges_of(a), distances);
  out.edge_p90_px = quantile_of(distances, 0.9);
  out.edge_median_px = median_of(std::move(distances));
  out.masks = {kFactor, a.width, a.height, a.inside, b.inside};
  return out;
}

PhotographMeasures compare_photograph(const GreyImage& photograph, const PhotographFrame& frame) {
  const PixelMask mask = compared_pixels(photograph, frame);
  PhotographMeasures out;
  out.toned_frame = ToneCurve(frame.radiance, photograph, mask)(frame.radiance);
  out.tone = correlation(photograph, out.toned_frame, mask);
  out.tone_blurred = correlation(blurred(photograph, 1), out.toned_frame, mask);
  out.shadows = compare_shadows(photograph, frame, mask);
  double observed = 0, rendered = 0;
  for (std::size_t i = 0; i < mask.size(); ++i)
    if (mask[i]) {
      observed += photograph.values[i];
      rendered += frame.radiance.values[i];
    }
  out.radiance_ratio = observed / rendered;
  return out;
}

}  // namespace selenograph::engine
