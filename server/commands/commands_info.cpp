// `selenograph info` and `selenograph sample`.
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "api/answers/datasets_answer.h"
#include "api/message/json_text.h"
#include "dem/posts/layer_joins.h"
#include "dem/terrain/height_survey.h"
#include "dem/terrain/resampling.h"
#include "server/commands/commands.h"
#include "server/commands/coverage.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

// Posts read of each file in the table, unless --heights sets their number.
constexpr std::size_t kHeightPosts = std::size_t{1} << 20;

// Returns a footprint as "  -7.000..  -6.000 N    39.000..   40.000 E".
std::string box(const dem::Footprint& f) {
  return fmt::format("{:8.3f}..{:8.3f} N {:9.3f}..{:9.3f} E", f.south_deg, f.north_deg, f.west_deg, f.east_deg);
}

std::string steps_text(const dem::Steps& s) {
  return fmt::format("mean {:+.2f} m, rms {:.2f} m, worst {:+.2f} m", s.mean_m, s.rms_m, s.worst_m);
}

// Returns the warning about a layer that lies above or below its neighbour.
std::string displacement_text(const dem::Catalogue& catalogue, const dem::LayerBorder& b) {
  const auto name = [&](int i) { return catalogue.rasters()[static_cast<std::size_t>(i)].name; };
  return fmt::format(
      "{} lies {:+.1f} m above {} along its border, more than the typical error of such posts, {:.1f} m: move it by "
      "--layer-offset '{}={:+.1f}', or by the median with --layer-offset '{}=fit'",
      name(b.sources.front()), b.bent.mean_m, name(b.beneath), b.typical_error_m, name(b.sources.front()),
      b.offset_m - b.bent.mean_m, name(b.sources.front()));
}

void print_borders(const dem::Catalogue& catalogue, const std::vector<dem::LayerBorder>& borders) {
  const auto name = [&](int i) { return catalogue.rasters()[static_cast<std::size_t>(i)].name; };
  for (const dem::LayerBorder& b : borders) {
    const std::string other_sources = b.sources.size() > 1 ? fmt::format(" and {} more", b.sources.size() - 1) : "";
    fmt::print("border of {}{} over {}: {} posts, offset {:+.3f} m, {} bent over {:.0f} m\n", name(b.sources.front()),
               other_sources, name(b.beneath), b.posts, b.offset_m, name(b.beneath), b.band_m);
    fmt::print("  step in the files: {}\n  bent by:           {}\n", steps_text(b.in_files), steps_text(b.bent));
    if (b.is_displaced()) fmt::print("  warning: {}\n", displacement_text(catalogue, b));
  }
}

// Returns the heights of a readable file; nothing for a catalogue of so many files that reading takes minutes.
std::optional<dem::HeightRange> heights_of(const dem::Catalogue& catalogue, const dem::RasterInfo& info,
                                           std::size_t posts) {
  constexpr std::size_t kMaxFiles = 4096;
  if (posts == 0 || catalogue.rasters().size() > kMaxFiles || !info.damage.empty()) return {};
  try {
    return dem::sampled_heights(info, posts);
  } catch (const DataError& error) {
    spdlog::warn("heights of {}", error.what());  // the rest of the list is not affected
    return {};
  }
}

// Returns the measured borders; nothing, with a warning in the log, if a file cannot be read.
std::vector<dem::LayerBorder> borders_of(const dem::Catalogue& catalogue, int max_layers) {
  try {
    return dem::measure_borders(catalogue, static_cast<std::size_t>(max_layers));
  } catch (const DataError& error) {
    spdlog::warn("borders of layers: {}", error.what());
    return {};
  }
}

// Returns the part of a file's line about its heights: ", -1200.0 to 3400.0 m".
std::string heights_text(const std::optional<dem::HeightRange>& range) {
  if (!range) return {};
  if (range->low > range->high) return ", no valid posts";  // an empty range: no post has narrowed it
  const bool has_voids = range->low < dem::kLowestRelief_m || range->high > dem::kHighestRelief_m;
  return fmt::format(", {:.1f} to {:.1f} m", range->low, range->high) +
         (has_voids ? fmt::format("; posts outside of {} .. {} m are taken as voids", dem::kLowestRelief_m,
                                  dem::kHighestRelief_m)
                    : "");
}

void print_table(const dem::Catalogue& catalogue, std::size_t posts) {
  fmt::print("{} DEM files, coarse to fine\n", catalogue.rasters().size());
  for (const dem::RasterInfo& r : catalogue.rasters()) {
    const bool projected = r.projection() != dem::Projection::geographic;
    fmt::print("  {:<32} {}  {:8.2f} m/post  {:>6} x {:<6} {}, {}{}{}{}\n", r.name, box(r.footprint), r.post_spacing_m,
               r.width, r.height, r.format, projected ? dem::name_of(r.projection()) + std::string(", ") : "", r.datum,
               r.lattice_level ? "" : ", resampled", heights_text(heights_of(catalogue, r, posts)));
  }
  const auto gaps = uncovered(catalogue);
  fmt::print("{} gaps within the covered area (whole degrees)\n", gaps.size());
  for (const dem::Footprint& gap : gaps) fmt::print("  {}\n", box(gap));
  if (!catalogue.problems().empty())
    fmt::print("{} files that cannot be used, or only in part\n", catalogue.problems().size());
  for (const dem::CatalogueProblem& problem : catalogue.problems())
    fmt::print("  {}: {}\n", problem.path, problem.what);
  for (const dem::SideLayer& side : catalogue.side_layers())
    fmt::print("side layer, not used as heights: {} ({})\n", side.path, side.kind);
}

nlohmann::ordered_json steps_json(const dem::Steps& s) {
  return {{"mean_m", s.mean_m}, {"rms_m", s.rms_m}, {"worst_m", s.worst_m}};
}

nlohmann::ordered_json borders_json(const dem::Catalogue& catalogue, const std::vector<dem::LayerBorder>& borders) {
  const auto name = [&](int i) { return catalogue.rasters()[static_cast<std::size_t>(i)].name; };
  auto list = nlohmann::ordered_json::array();
  for (const dem::LayerBorder& b : borders) {
    auto names = nlohmann::ordered_json::array();
    for (const int i : b.sources) names.push_back(name(i));
    list.push_back({{"names", std::move(names)},
                    {"beneath", name(b.beneath)},
                    {"posts", b.posts},
                    {"offset_m", b.offset_m},
                    {"band_m", b.band_m},
                    {"step_in_files", steps_json(b.in_files)},
                    {"bent_by", steps_json(b.bent)},
                    {"warning", b.is_displaced() ? nlohmann::ordered_json(displacement_text(catalogue, b)) : nullptr}});
  }
  return list;
}

// Error of the mesh at the posts of a file that is resampled.
struct Resampled {
  std::string name;
  dem::ResamplingError error;
};

std::vector<Resampled> measure_resampling(const InfoSettings& settings) {
  if (settings.resampling == 0) return {};
  const auto terrain = open_terrain(settings.terrain);
  const auto& rasters = terrain->catalogue().rasters();
  std::vector<Resampled> list;
  for (std::size_t i = 0; i < rasters.size(); ++i)
    if (!rasters[i].lattice_level)
      list.push_back({rasters[i].name, dem::resampling_error(*terrain, static_cast<int>(i), settings.resampling)});
  return list;
}

void print_resampling(const std::vector<Resampled>& files) {
  for (const auto& [name, e] : files)
    fmt::print("  {:<32} mesh against {} of its posts: rms {:.3f} m, worst {:.3f} m\n", name, e.posts, e.rms_m,
               e.worst_m);
}

nlohmann::ordered_json resampling_json(const std::vector<Resampled>& files) {
  auto list = nlohmann::ordered_json::array();
  for (const auto& [name, e] : files)
    list.push_back({{"name", name}, {"posts", e.posts}, {"rms_m", e.rms_m}, {"worst_m", e.worst_m}});
  return list;
}

// Adds the members of a file whose heights were read: null if no post is valid.
void add_heights(nlohmann::ordered_json& dataset, const std::optional<dem::HeightRange>& range) {
  if (!range) return;
  const bool valid = range->low <= range->high;
  dataset["lowest_m"] = valid ? nlohmann::ordered_json(range->low) : nullptr;
  dataset["highest_m"] = valid ? nlohmann::ordered_json(range->high) : nullptr;
}

// Prints the answer of /v1/datasets with the gaps and borders, and with heights and resampling if requested.
void print_json(const dem::Catalogue& catalogue, const std::vector<dem::LayerBorder>& borders,
                const InfoSettings& settings) {
  auto json = nlohmann::ordered_json::parse(api::datasets_text(catalogue));
  for (std::size_t i = 0; i < catalogue.rasters().size(); ++i)
    add_heights(json["datasets"][i], heights_of(catalogue, catalogue.rasters()[i], settings.heights.value_or(0)));
  auto gaps = nlohmann::ordered_json::array();
  for (const dem::Footprint& f : uncovered(catalogue)) {
    gaps.push_back(
        {{"south_deg", f.south_deg}, {"north_deg", f.north_deg}, {"west_deg", f.west_deg}, {"east_deg", f.east_deg}});
  }
  json["uncovered"] = std::move(gaps);
  json["borders"] = borders_json(catalogue, borders);
  if (settings.resampling > 0) json["resampling"] = resampling_json(measure_resampling(settings));
  fmt::print("{}\n", api::json_text(json, 2));
}

}  // namespace

int info(const InfoSettings& settings) {
  set_up_log(settings.terrain.log_level);
  const dem::Catalogue catalogue = open_catalogue(settings.terrain);
  const auto borders = borders_of(catalogue, settings.borders);
  if (settings.json) {
    print_json(catalogue, borders, settings);
  } else {
    print_table(catalogue, settings.heights.value_or(kHeightPosts));
    print_borders(catalogue, borders);
    print_resampling(measure_resampling(settings));
  }
  return 0;
}

int sample(const SampleSettings& settings) {
  const bool terminal = ::isatty(STDERR_FILENO) == 1;
  const auto labels = dem::write_sample_terrain(settings.folder, settings.options, [&](double share) {
    if (terminal) fmt::print(stderr, "\rwriting sample terrain {:3.0f}%{}", share * 100.0, share >= 1.0 ? "\n" : "");
  });
  for (const std::string& label : labels) fmt::print("{}\n", label);
  return 0;
}

}  // namespace selenograph::server
