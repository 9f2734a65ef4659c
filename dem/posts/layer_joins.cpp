#include "dem/posts/layer_joins.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <stdexcept>

#include "dem/base/error.h"
#include "dem/base/names.h"
#include "dem/base/quantile.h"
#include "dem/posts/post_source.h"

namespace selenograph::dem {
namespace {

constexpr std::size_t kMaxPosts =
    4096;  // maximum per border: the median's error is then about 1/50 of the steps' spread
constexpr double kMaxOffset_m = 20000;  // with a larger offset no height is possible on the Moon
constexpr double kFitStep_m = 0.001;    // fitted offsets are multiples of it
// Global models' stated errors are 3 to 4 m at 60 m posts (SLDEM2015) and 10 to 20 m at 118 m (GLD100).
constexpr double kTypicalError = 0.1;  // ratio of a model's height error to its post spacing
constexpr double kMinTypicalError_m = 3;

// Returns the statistics of step_m(post) over posts, of which there is at least one.
Steps steps_of(const std::vector<BorderPost>& posts, const std::function<double(const BorderPost&)>& step_m) {
  Steps s;
  for (const BorderPost& post : posts) {
    const double d = step_m(post);
    s.mean_m += d;
    s.rms_m += d * d;
    if (std::abs(d) > std::abs(s.worst_m)) s.worst_m = d;
  }
  s.mean_m /= static_cast<double>(posts.size());
  s.rms_m = std::sqrt(s.rms_m / static_cast<double>(posts.size()));
  return s;
}

void ignore(const std::string&, const std::string&) {}

}  // namespace

NamedNumber parse_named_number(const std::string& text, const NumberRange& range) {
  const std::size_t equals = text.rfind('=');
  if (equals == std::string::npos || equals == 0)
    throw std::invalid_argument(fmt::format("'{}' is not PATTERN={}", text, range.name));
  const std::string value = text.substr(equals + 1);
  if (value == "fit") return {text.substr(0, equals), std::nullopt};
  std::size_t used = 0;
  double number = 0;
  try {
    number = std::stod(value, &used);
  } catch (const std::logic_error&) {
    used = std::string::npos;
  }
  if (value.empty() || used != value.size() || !(number >= range.low && number <= range.high))
    throw std::invalid_argument(
        fmt::format("'{}': {} must be fit, or a number from {} to {}", text, range.name, range.low, range.high));
  return {text.substr(0, equals), number};
}

NamedNumber parse_layer_offset(const std::string& text) {
  return parse_named_number(text, {"METRES", -kMaxOffset_m, kMaxOffset_m});
}

// Sets the given offsets first, then fits the others group by group, from coarse to fine.
std::vector<FittedOffset> join_layers(Catalogue& catalogue, double blend_posts,
                                      const std::vector<NamedNumber>& offsets) {
  const std::vector<RasterInfo>& rasters = catalogue.rasters();
  LayerJoins joins{blend_posts, {}};
  std::vector<char> fitted(rasters.size());  // files whose offset is to be fitted
  if (!offsets.empty()) joins.offsets_m.resize(rasters.size());
  for (const NamedNumber& offset : offsets) {
    bool has_match = false;
    for (std::size_t i = 0; i < rasters.size(); ++i) {
      if (!name_matches(rasters[i].path, offset.pattern)) continue;
      has_match = true;
      fitted[i] = !offset.value;
      joins.offsets_m[i] = offset.value.value_or(0);
    }
    if (!has_match) throw DataError(offset.pattern, "no DEM file has such a name (--layer-offset)");
  }
  catalogue.join_layers(joins);
  std::vector<FittedOffset> fits;
  std::vector<char> done(rasters.size());  // files whose group has its offset
  for (std::size_t i = 0; i < rasters.size(); ++i) {
    if (!fitted[i] || done[i]) continue;
    const int file = static_cast<int>(i);
    // Recreate the source after each fit: it reads coarser layers with the offsets fitted so far.
    const PostSource source(catalogue, false, ignore);
    FittedOffset fit{file, 0, 0};
    std::vector<int> group{file};
    if (catalogue.layer_begin(file) > 0) {
      group = source.bends().group_of(file);
      std::vector<double> steps;
      for (const BorderPost& post : source.bends().border_posts(file, kMaxPosts))
        // The step of the files as they are, with the sign of the offset that removes it.
        steps.push_back(catalogue.offset_m(post.source) - static_cast<double>(post.step_m));
      fit.posts = steps.size();
      if (!steps.empty()) fit.offset_m = std::round(median(std::move(steps)) / kFitStep_m) * kFitStep_m;
    }
    for (const int member : group) {
      const auto o = static_cast<std::size_t>(member);
      if (!fitted[o]) continue;
      done[o] = 1;
      joins.offsets_m[o] = fit.offset_m;
    }
    catalogue.join_layers(joins);
    fits.push_back(fit);
  }
  return fits;
}

// Visits each group once, at its first file.
std::vector<LayerBorder> measure_borders(const Catalogue& catalogue, std::size_t max_groups) {
  std::vector<LayerBorder> found;
  if (catalogue.one_layer()) return found;
  const PostSource source(catalogue, false, ignore);
  std::vector<char> done(catalogue.rasters().size());
  for (std::size_t i = 0; i < done.size() && found.size() < max_groups; ++i) {
    const int file = static_cast<int>(i);
    if (done[i] || catalogue.layer_begin(file) == 0) continue;
    const std::vector<int>& group = source.bends().group_of(file);
    for (const int member : group) done[static_cast<std::size_t>(member)] = 1;
    const std::vector<BorderPost> posts = source.bends().border_posts(file, kMaxPosts);
    if (posts.empty()) continue;
    LayerBorder border;
    border.sources = group;
    border.posts = posts.size();
    border.offset_m = catalogue.offset_m(group.front());
    border.band_m = source.bends().band_posts(file) * catalogue.rasters()[i].post_spacing_m;
    std::map<SourceIndex, std::size_t> posts_above;  // number of border posts above each file
    for (const BorderPost& post : posts) ++posts_above[post.beneath];
    const auto has_fewer_posts = [](const auto& a, const auto& b) { return a.second < b.second; };
    border.beneath = static_cast<int>(std::max_element(posts_above.begin(), posts_above.end(), has_fewer_posts)->first);
    border.in_files = steps_of(posts, [&](const BorderPost& post) {
      return static_cast<double>(post.step_m) - catalogue.offset_m(post.source);
    });
    border.bent = steps_of(posts, [](const BorderPost& post) { return static_cast<double>(post.step_m); });
    border.typical_error_m =
        std::max(kTypicalError * catalogue.rasters()[static_cast<std::size_t>(border.beneath)].post_spacing_m,
                 kMinTypicalError_m);
    found.push_back(std::move(border));
  }
  return found;
}

}  // namespace selenograph::dem
