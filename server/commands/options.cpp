// The options of the commands. (CLI11 takes seconds to compile, so that the commands' own files do not include it.)
#include <CLI/CLI.hpp>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <string>

#include "server/campaign/campaign.h"
#include "server/commands/commands.h"
#include "server/commands/place.h"

namespace selenograph::server {
namespace {

// Adds an option for a place, and refuses other text.
CLI::Option* add_place(CLI::App& command, const std::string& name, std::string& text, const std::string& help) {
  return command.add_option(name, text, help)->type_name("LAT,LON")->check([](const std::string& value) {
    return place_of(value) ? std::string() : std::string("must be latitude and longitude: 26.1,3.6 or 26:06N,3:36E");
  });
}

// Returns the error of a seed; empty: none. CLI11 silently changes numbers above 64 bits, and reads empty text as 0.
std::string refusal_of_seed(const std::string& text) {
  errno = 0;
  std::strtoull(text.c_str(), nullptr, 0);
  const bool is_number = text.find_first_of("0123456789") != std::string::npos;
  return errno == ERANGE || !is_number || text.find('-') != std::string::npos
             ? "'" + text + "' is not from 0 to 18446744073709551615"
             : std::string();
}

}  // namespace

void add_options(CLI::App& command, AskSettings& s) {
  command.add_option("call", s.call, "Answer POST /v1/CALL")
      ->required()
      ->type_name("CALL")
      ->check(CLI::IsMember(ask_calls()));
  command
      .add_option("request", s.request, "Read the request's JSON, or arrays as .npz, from this file; -: standard input")
      ->required()
      ->type_name("REQUEST.json");
  command
      .add_option("-o,--output", s.output,
                  "Write the answer to this file, whose suffix is one of the call's formats, such as .npz; -: standard "
                  "output")
      ->required()
      ->type_name("OUT");
  auto* tiles =
      command
          .add_option("--tile-px", s.tile_px,
                      "Write the request's map as tiles of this side into the folder OUT, and map.vrt once all exist. "
                      "Tiles that exist are not made again")
          ->check(CLI::Range(16, 4096));
  command.add_option("--shard", s.shard, "Make part I (from 0) of N of the tiles")->type_name("I/N")->needs(tiles);
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, BatchSettings& s) {
  // Not `required`, because `batch verify` has its own.
  command
      .add_option("manifest", s.manifest,
                  "Render the requests of this file: one per line, as for POST /v1/frames, with an optional \"name\"")
      ->type_name("MANIFEST.jsonl");
  command.add_option("-o,--output", s.output, "Write frames to this folder")->type_name("DIR");
  command
      .add_option("--shard", s.shard,
                  "Render part I (from 0) of N of the manifest; parts have the same number of lines, or of tars")
      ->type_name("I/N");
  command
      .add_option("--format", s.format,
                  "Write frames as DIR/NAME.FORMAT or, for webdataset, as tars of .npz (DIR/frames-000000.tar)")
      ->check(CLI::IsMember({"npz", "exr", "tiff", "png", kWebDataset}));
  command
      .add_option("--frames-per-tar", s.frames_per_tar,
                  "Put at most this many frames into a tar of --format webdataset")
      ->check(CLI::Range(std::size_t{1}, std::size_t{1} << 20));
  command.add_flag("--resume", s.resume,
                   "Replace files under the manifest's names in DIR that are not its frames with this software and "
                   "this terrain; they are refused otherwise. Finished frames are never rendered again");
  command.add_option("--in-work", s.in_work, "Render this many frames at once; 0: two, or one on a single core")
      ->check(CLI::Range(0, 1024));
  add_options(command, s.terrain);
  // A campaign may wait longer for a frame than a client of the service.
  s.limits.default_deadline = std::chrono::hours(1);
  add_options(command, s.limits);
}

void add_options(CLI::App& command, BatchVerifySettings& s) {
  command.add_option("manifest", s.manifest, "Check the frames of this manifest")
      ->required()
      ->type_name("MANIFEST.jsonl");
  command.add_option("-o,--output", s.output, "Check the frames in this folder")->required()->type_name("DIR");
  command
      .add_option("--rerun,--missing", s.rerun,
                  "Write a manifest of the lines to run again, whose frames are missing or damaged, and rename damaged "
                  "files to FILE.damaged")
      ->type_name("FILE");
}

void add_options(CLI::App& command, InfoSettings& s) {
  add_options(command, s.terrain);
  command
      .add_option("--resampling", s.resampling,
                  "Compare this many posts of each resampled file with the mesh (builds the pyramid)")
      ->check(CLI::Range(0, 1000000));
  command
      .add_option("--heights", s.heights,
                  "Read about this many posts of each file for its lowest and highest height; default: 1048576, with "
                  "--json none")
      ->check(CLI::Range(0, 1 << 30));
  command
      .add_option("--borders", s.borders,
                  "Measure the steps along the borders of this many layers (reads their files); 0: none")
      ->check(CLI::Range(0, 1000000));
  command.add_flag("--json", s.json, "Print JSON");
}

void add_options(CLI::App& command, SampleSettings& s) {
  command.add_option("folder", s.folder, "Write to this folder; created if missing")->required()->type_name("DIR");
  command.add_option("--seed", s.options.seed, "Seed the random landscape")->check(refusal_of_seed);
  command.add_option("--south-deg", s.options.south_deg, "Set the southern border")->check(CLI::Range(-90, 89));
  command.add_option("--west-deg", s.options.west_deg, "Set the western border")->check(CLI::Range(-180, 359));
  command.add_option("--rows", s.options.rows, "Write this many tiles from south to north")->check(CLI::Range(1, 180));
  command.add_option("--columns", s.options.columns, "Write this many tiles from west to east")
      ->check(CLI::Range(1, 360));
  command.add_option("--ppd", s.options.posts_per_degree, "Write this many posts per degree, a power of two")
      ->check(CLI::Range(16, 8192))
      ->check([](const std::string& text) {
        const long ppd = std::stol(text);
        return (ppd & (ppd - 1)) == 0 ? std::string() : std::string("must be a power of two");
      });
  command.add_flag("--date-line", s.options.date_line, "Write tiles on both sides of the 180th meridian, too");
}

void add_options(CLI::App& command, VerifyRoundTripSettings& s) {
  add_place(command, "--center", s.center, "Compare the finest tile at this place")->required();
  command.add_option("--height-m", s.request.height_m, "Put the cameras at this height above the ground")
      ->check(number_in(1.0, 1e9));
  command.add_option("--mode", s.mode, "Use rays through the posts, ordinary frames resampled to them, or both")
      ->check(CLI::IsMember({"exact", "camera", "both"}));
  command
      .add_option("--posts", s.request.posts,
                  "Compare this many posts along each side of the window; 0: the entire tile")
      ->check(CLI::Range(0, 1 << 20));
  command.add_option("--footprint", s.request.footprint_ratio, "Set pixel footprint over post spacing, in mode camera")
      ->check(number_in(0.01, 100.0));
  command.add_option("-o,--output", s.output, "Write a folder per mode to this folder; created if missing")
      ->required()
      ->type_name("DIR");
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, VerifyAccuracySettings& s) {
  CLI::Option* request = command.add_option(
      "--request", s.request,
      "Measure this frame, a request as for POST /v1/frames, instead of the scenes; -: read it from standard input");
  request->type_name("REQUEST.json");
  add_place(command, "--center", s.center, "Put the scenes at this place; default: the middle of the finest DEM file");
  add_place(command, "--polar-center", s.polar_center,
            "Add a polar scene at this place, with a low Sun; default: no such scene");
  command.add_option("--detail", s.detail, "Add a scene with this detail of the assets folder; default: no such scene")
      ->type_name("NAME");
  command.add_option("--scenes", s.scenes, "Measure these scenes; default: all")
      ->delimiter(',')
      ->check(CLI::IsMember({"nadir", "oblique", "limb", "polar", "descent", "touchdown"}));
  command.add_option("--height-m", s.height_m, "Put the camera at this height above ground, except in descents")
      ->check(number_in(1.0, 1e9));
  command.add_option("--size-px", s.size_px, "Render frames of this side")->check(CLI::Range(32, 4096));
  command.add_option("--repetitions", s.repetitions, "Repeat each timing this often; the median is reported")
      ->check(CLI::Range(1, 1000));
  command
      .add_option("--reference-samples", s.reference_samples,
                  "Render the reference with this many samples per pixel, a square")
      ->check(CLI::IsMember({1, 4, 16, 64, 256, 1024}));
  for (const char* of_scenes : {"--center", "--polar-center", "--detail", "--scenes", "--height-m", "--size-px"})
    request->excludes(command.get_option(of_scenes));
  command.add_option("-o,--output", s.output, "Write to this folder; created if missing")->required()->type_name("DIR");
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, VerifyMertisSettings& s) {
  command
      .add_option("--instrument", s.instrument,
                  "Read JSON as for POST /v1/verify/mertis from this file; default: MERTIS")
      ->type_name("FILE");
  command.add_option("-o,--output", s.output, "Write to this folder; created if missing")->required()->type_name("DIR");
}

}  // namespace selenograph::server
