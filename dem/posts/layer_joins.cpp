#include "dem/posts/layer_joins.h"

#include <fmt/format.h>
#include <fnmatch.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <stdexcept>

#include "dem/posts/post_source.h"
#include "dem/support/error.h"
#include "dem/support/parallel.h"
#include "dem/support/quantile.h"

namespace selenograph::dem {
namespace {

constexpr std::size_t kMostPosts = 4096;  // of a border: the median's error is about its spread by 50
constexpr double kMostOffset_m = 20000;   // beyond it no height remains a lunar one
constexpr double kFitStep_m = 0.001;

PostWindow window_at(const Geographic& place) {
  const auto tick = [](double deg) { return static_cast<std::int64_t>(std::llround(deg * kTicksPerDegree)); };
  return {std::clamp<std::int64_t>(tick(place.lat_deg + 90), 0, kLatTicks),
          wrap_lon(tick(place.lon_deg + 180)),
          1,
          1,
          1,
          1};
}

// A post on the finer side of a border.
struct Compared {
  float own_m = 0;      // as the file has it
  float beneath_m = 0;  // NaN: nothing is there
  SourceIndex beneath = kNoSource;
  float joined_m = 0;
};

std::vector<Compared> compare(const Catalogue& catalogue, const PostSource& source, int file) {
  const std::vector<LayerEdges::BorderPost> posts = source.edges().border(file, kMostPosts);
  std::vector<Compared> all(posts.size());
  in_parallel(posts.size(), [&](std::size_t i) {
    const LayerEdges::BorderPost& p = posts[i];
    const RasterInfo& info = catalogue.rasters()[static_cast<std::size_t>(p.source)];
    source.read(p.source, p.x, p.y, 1, 1, &all[i].own_m);
    all[i].own_m -= static_cast<float>(catalogue.offset_m(p.source));
    const PostWindow window = window_at(place_of_post(info, p.x, p.y));
    const Posts beneath = source.compose(window, catalogue.layer_begin(p.source), {});
    all[i].beneath_m = beneath.heights[0], all[i].beneath = source_of(beneath.sources[0]);
    all[i].joined_m = source.compose(window).heights[0];
  });
  std::erase_if(all, [](const Compared& c) { return std::isnan(c.beneath_m) || std::isnan(c.own_m); });
  return all;
}

template <typename Step>
Steps steps_of(const std::vector<Compared>& all, const Step& step) {
  Steps s;
  for (const Compared& c : all) {
    const double d = static_cast<double>(step(c)) - static_cast<double>(c.beneath_m);
    s.mean_m += d, s.rms_m += d * d;
    if (std::abs(d) > std::abs(s.worst_m)) s.worst_m = d;
  }
  s.mean_m /= static_cast<double>(all.size());
  s.rms_m = std::sqrt(s.rms_m / static_cast<double>(all.size()));
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

bool matches(const RasterInfo& info, const std::string& pattern) {
  const std::string file = std::filesystem::path(info.path).filename().string();
  return ::fnmatch(pattern.c_str(), info.name.c_str(), 0) == 0 || ::fnmatch(pattern.c_str(), file.c_str(), 0) == 0;
}

NamedNumber parse_layer_offset(const std::string& text) {
  return parse_named_number(text, {"METRES", -kMostOffset_m, kMostOffset_m});
}

std::vector<FittedOffset> join_layers(Catalogue& catalogue, double blend_posts,
                                      const std::vector<NamedNumber>& offsets) {
  const std::vector<RasterInfo>& rasters = catalogue.rasters();
  LayerJoins joins{blend_posts, {}};
  std::vector<char> fitted(rasters.size());
  if (!offsets.empty()) joins.offsets_m.resize(rasters.size());
  for (const NamedNumber& offset : offsets) {
    bool any = false;
    for (std::size_t i = 0; i < rasters.size(); ++i) {
      if (!matches(rasters[i], offset.pattern)) continue;
      any = true, fitted[i] = !offset.value;
      joins.offsets_m[i] = offset.value.value_or(0);
    }
    if (!any) throw DataError(offset.pattern, "no DEM file has such a name (--layer-offset)");
  }
  catalogue.join_layers(joins);
  std::vector<FittedOffset> found;
  std::vector<char> done(rasters.size());
  for (std::size_t i = 0; i < rasters.size(); ++i) {
    if (!fitted[i] || done[i]) continue;
    const int file = static_cast<int>(i);
    // Its neighbours have the offset that is fitted here, whatever borders they have.
    const PostSource source(catalogue, false, ignore);
    FittedOffset fit{file, 0, 0};
    std::vector<int> group{file};
    if (source.edges().meets(file) || catalogue.layer_begin(file) > 0) {
      group = source.edges().group_of(file);
      int over = file;
      for (const int other : group)
        if (source.edges().meets(other)) over = other;
      std::vector<double> steps;
      for (const Compared& c : compare(catalogue, source, over))
        steps.push_back(static_cast<double>(c.beneath_m) - static_cast<double>(c.own_m));
      fit.posts = steps.size();
      if (!steps.empty()) fit.offset_m = std::round(median(std::move(steps)) / kFitStep_m) * kFitStep_m;
    }
    for (const int other : group) {
      const auto o = static_cast<std::size_t>(other);
      if (!fitted[o]) continue;
      done[o] = 1, joins.offsets_m[o] = fit.offset_m;
    }
    catalogue.join_layers(joins);
    found.push_back(fit);
  }
  return found;
}

std::vector<LayerBorder> measure_borders(const Catalogue& catalogue, std::size_t most) {
  std::vector<LayerBorder> found;
  if (catalogue.one_layer()) return found;
  const PostSource source(catalogue, false, ignore);
  std::vector<char> done(catalogue.rasters().size());
  for (std::size_t i = 0; i < done.size() && found.size() < most; ++i) {
    const int file = static_cast<int>(i);
    if (done[i] || !source.edges().meets(file)) continue;
    const std::vector<int>& group = source.edges().group_of(file);
    for (const int other : group) done[static_cast<std::size_t>(other)] = 1;
    const std::vector<Compared> all = compare(catalogue, source, file);
    if (all.empty()) continue;
    LayerBorder border;
    border.sources = group;
    border.posts = all.size();
    border.offset_m = catalogue.offset_m(group.front());
    border.band_m = source.edges().band_posts(file) * catalogue.rasters()[i].post_spacing_m;
    std::map<SourceIndex, std::size_t> beneath;
    for (const Compared& c : all) ++beneath[c.beneath];
    border.beneath =
        static_cast<int>(std::max_element(beneath.begin(), beneath.end(), [](const auto& a, const auto& b) {
                           return a.second < b.second;
                         })->first);
    border.before = steps_of(all, [](const Compared& c) { return c.own_m; });
    border.after = steps_of(all, [](const Compared& c) { return c.joined_m; });
    found.push_back(std::move(border));
  }
  return found;
}

}  // namespace selenograph::dem
