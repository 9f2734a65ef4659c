// The options of the commands. (CLI11 takes seconds to compile: the commands themselves do without.)
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

// An option that takes a place and refuses what is none.
CLI::Option* add_place(CLI::App& command, const std::string& name, std::string& text, const std::string& what) {
  return command.add_option(name, text, what)->type_name("LAT,LON")->check([](const std::string& given) {
    return place_of(given) ? std::string() : std::string("must be latitude and longitude in degrees: 26.1,3.6");
  });
}

// CLI11 takes another number for one that 64 bits don't hold, and 0 for nothing.
std::string refusal_of_seed(const std::string& text) {
  errno = 0;
  std::strtoull(text.c_str(), nullptr, 0);
  const bool is_number = text.find_first_of("0123456789") != std::string::npos;
  return errno == ERANGE || !is_number || text.find('-') != std::string::npos
             ? "'" + text + "' is not from 0 to 18446744073709551615"
             : std::string();
}

}  // namespace

void add_options(CLI::App& command, RenderSettings& s) {
  command.add_option("request", s.request, "JSON file as for POST /v1/frames; -: standard input")
      ->required()
      ->type_name("REQUEST.json");
  command.add_option("-o,--output", s.output, "Frame to write: .png .tiff .exr .npy .npz .raw")
      ->required()
      ->type_name("OUT");
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, LidarSettings& s) {
  command.add_option("request", s.request, "JSON file as for POST /v1/lidar; -: standard input")
      ->required()
      ->type_name("REQUEST.json");
  command.add_option("-o,--output", s.output, "Returns to write: .npz .json")->required()->type_name("OUT");
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, MapSettings& s) {
  command.add_option("request", s.request, "JSON file as for POST /v1/maps; -: standard input")
      ->required()
      ->type_name("REQUEST.json");
  command.add_option("-o,--output", s.output, "Map to write: .tif .npz .png")->required()->type_name("OUT");
  command
      .add_option("--utc", s.utc,
                  "A series: a map for each epoch from FROM to TO, named OUT with its time, and the mean of lit over "
                  "all of them, OUT-illumination.tif. Epochs like 2026-11-20T00:00:00Z, a step like 600s, 30m, 6h, 1d")
      ->type_name("FROM TO STEP")
      ->expected(3)
      ->allow_extra_args(false);
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, FeaturesSettings& s) {
  command.add_option("request", s.request, "JSON file as for POST /v1/features; -: standard input")
      ->type_name("REQUEST.json");
  command.add_option("--detail", s.detail, "Instead of a file: name of details/NAME.json in the assets folder")
      ->type_name("NAME");
  command.add_option("--region", s.region, "Instead of a file: degrees; EAST may be beyond 180")
      ->type_name("SOUTH NORTH WEST EAST")
      ->expected(4)
      ->allow_extra_args(false);
  command.add_option("--smallest-m", s.smallest_m, "Instead of a file: minimum diameter; left out: the preset's");
  command.add_option("-o,--output", s.output, "CSV to write; -: standard output")
      ->type_name("OUT.csv")
      ->capture_default_str();
  auto* coco = command.add_option("--coco", s.coco, "COCO file to write: the craters and rocks in a frame")
                   ->type_name("OUT.json");
  auto* frame = command.add_option("--frame", s.frame, "The frame: JSON file as for POST /v1/frames, with a detail")
                    ->type_name("REQUEST.json");
  coco->needs(frame), frame->needs(coco);
  command.add_option("--image", s.image, "The COCO file's name for the frame; left out: that of --frame with .png")
      ->type_name("NAME");
  command
      .add_option("--least-px", s.rims.least_px,
                  "If the frame's request has no \"craters\" and no \"labels\": minimum diameter of a circle of the "
                  "rim's, or the visible rock's, area")
      ->check(number_in(1.0, 1e4))
      ->capture_default_str();
  command
      .add_option("--least-depth", s.rims.least_depth,
                  "Minimum present depth over diameter of craters, unless a REQUEST.json or the frame's \"craters\" or "
                  "\"labels\" gives it; 0: all")
      ->check(number_in(0.0, 1.0))
      ->capture_default_str();
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, BatchSettings& s) {
  // Not `required`: `batch verify` has its own.
  command.add_option("manifest", s.manifest, "A request per line, as for POST /v1/frames, with an optional \"name\"")
      ->type_name("MANIFEST.jsonl");
  command.add_option("-o,--output", s.output, "Folder for frames and journals")->type_name("DIR");
  command
      .add_option("--shard", s.shard, "Part I (from 0) of N of the manifest; parts have about the same amount of work")
      ->type_name("I/N")
      ->capture_default_str();
  command
      .add_option("--format", s.format,
                  "Frame format: DIR/NAME.FORMAT, or for WebDataset tars of .npz (DIR/frames-000000.tar)")
      ->check(CLI::IsMember({"npz", "exr", "tiff", "png", kWebDataset}))
      ->capture_default_str();
  command.add_option("--frames-per-tar", s.frames_per_tar, "Maximum frames per tar of --format webdataset")
      ->check(CLI::Range(std::size_t{1}, std::size_t{1} << 20))
      ->capture_default_str();
  command.add_flag("--resume", s.resume,
                   "DIR may contain frames of other requests, software or terrain under the manifest's names: they are "
                   "replaced. Without it, they are refused. Finished frames of this manifest are never rendered again");
  command.add_flag("--coco", s.coco,
                   "Writes the craters and rocks of all frames whose requests have \"labels\", when the part is done, "
                   "as COCO to DIR/coco-00000-of-00001.json. Only with --format npz and webdataset");
  command.add_option("--in-work", s.in_work, "Frames rendered at once; 0: two, or one on a single core")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  add_options(command, s.terrain);
  // Whoever asks here waits as long as it takes.
  s.limits.default_deadline = std::chrono::hours(1);
  add_options(command, s.limits);
}

void add_options(CLI::App& command, BatchVerifySettings& s) {
  command.add_option("manifest", s.manifest, "The campaign's manifest")->required()->type_name("MANIFEST.jsonl");
  command.add_option("-o,--output", s.output, "Its folder")->required()->type_name("DIR");
  command
      .add_option("--rerun,--missing", s.rerun,
                  "Manifest to write: lines whose frames are missing, damaged or duplicated, to run again. Damaged and "
                  "duplicated files are renamed FILE.damaged")
      ->type_name("FILE");
}

void add_options(CLI::App& command, InfoSettings& s) {
  add_options(command, s.terrain);
  command
      .add_option("--resampling", s.resampling,
                  "Compare this many posts of each resampled file with the mesh (builds the pyramid)")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  command
      .add_option("--heights", s.heights,
                  "Read about this many posts of each file for its lowest and highest height; default: 1048576, with "
                  "--json none")
      ->check(CLI::Range(0, 1 << 30));
  command
      .add_option("--borders", s.borders,
                  "Measure the steps along the borders of this many layers (reads their files); 0: none")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  command.add_flag("--json", s.json, "Print JSON");
}

void add_options(CLI::App& command, SampleSettings& s) {
  command.add_option("folder", s.folder, "Folder to write to; created if missing")->required()->type_name("DIR");
  command.add_option("--seed", s.options.seed, "Seed of the random landscape")
      ->check(refusal_of_seed)
      ->capture_default_str();
  command.add_option("--south-deg", s.options.south_deg, "Southern border")
      ->check(CLI::Range(-90, 89))
      ->capture_default_str();
  command.add_option("--west-deg", s.options.west_deg, "Western border")
      ->check(CLI::Range(-180, 359))
      ->capture_default_str();
  command.add_option("--rows", s.options.rows, "Tiles from south to north")
      ->check(CLI::Range(1, 180))
      ->capture_default_str();
  command.add_option("--columns", s.options.columns, "Tiles from west to east")
      ->check(CLI::Range(1, 360))
      ->capture_default_str();
  command.add_option("--ppd", s.options.posts_per_degree, "Posts per degree, a power of two")
      ->check(CLI::Range(16, 8192))
      ->check([](const std::string& text) {
        const long ppd = std::stol(text);
        return (ppd & (ppd - 1)) == 0 ? std::string() : std::string("must be a power of two");
      })
      ->capture_default_str();
  command.add_flag("--date-line", s.options.date_line, "Also tiles on both sides of the 180th meridian");
}

void add_options(CLI::App& command, VerifyRoundTripSettings& s) {
  add_place(command, "--center", s.center, "Place: the finest tile there is compared")->required();
  command.add_option("--height-m", s.request.height_m, "Height of the cameras above the ground")
      ->check(number_in(1.0, 1e9))
      ->capture_default_str();
  command.add_option("--mode", s.mode, "Rays through the posts, ordinary frames resampled to them, or both")
      ->check(CLI::IsMember({"exact", "camera", "both"}))
      ->capture_default_str();
  command.add_option("--posts", s.request.posts, "Posts along each side of the window; 0: the whole tile")
      ->check(CLI::Range(0, 1 << 20))
      ->capture_default_str();
  command.add_option("--footprint", s.request.footprint_ratio, "Pixel footprint over post spacing, mode camera")
      ->check(number_in(0.01, 100.0))
      ->capture_default_str();
  command.add_option("--max-error-px", s.request.max_error_px, "Level of detail of the frames; 0: the finest posts")
      ->check(number_in(0.0, 100.0))
      ->capture_default_str();
  command.add_option("-o,--output", s.output, "Folder for one folder per mode; created if missing")
      ->required()
      ->type_name("DIR");
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, VerifyAccuracySettings& s) {
  add_place(command, "--center", s.center, "Place of the scenes; default: the middle of the finest DEM file");
  add_place(command, "--polar-center", s.polar_center,
            "Place of the polar scene, with a low Sun; default: no such scene");
  command.add_option("--detail", s.detail, "Detail of the assets folder: adds a scene with it; default: no such scene")
      ->type_name("NAME");
  command.add_option("--scenes", s.scenes, "Default: all")
      ->delimiter(',')
      ->check(CLI::IsMember({"nadir", "oblique", "limb", "polar", "descent", "touchdown"}));
  command
      .add_option("--height-m", s.height_m,
                  "Camera height above ground, except in descents; default: 20000; with --indirect, the height where a "
                  "pixel is as large as a post")
      ->check(number_in(1.0, 1e9));
  command.add_option("--size-px", s.size_px, "Side of the frames")->check(CLI::Range(32, 4096))->capture_default_str();
  command.add_option("--repetitions", s.repetitions, "Runs of each timing; the median is reported")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command.add_option("--reference-samples", s.reference_samples, "Samples per pixel of the reference; square")
      ->check(CLI::IsMember({1, 4, 16, 64, 256, 1024}))
      ->capture_default_str();
  command.add_flag(
      "--indirect", s.indirect,
      "Instead of settings: error of light from terrain by the spacing of its posts, in scenes nadir and polar");
  command.add_option("-o,--output", s.output, "Folder; created if missing")->required()->type_name("DIR");
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, VerifyMoonSettings& s) {
  command
      .add_option("--albedo-maps", s.albedo_maps,
                  "Maps of radiance factors in the assets folder; the first that covers a point counts; needs --dem")
      ->delimiter(',')
      ->type_name("NAME");
  command
      .add_option("--images", s.images, "Folder with views.json and images, each compared with its frame; needs --dem")
      ->type_name("DIR");
  add_place(command, "--center", s.center,
            "Compare terrain there with smooth ground, by incidence, instead of the whole disc; needs --dem");
  command.add_option("--width-m", s.width_m, "Ground width at --center")
      ->check(number_in(1.0, 1e6))
      ->default_str("20000");
  command.add_option("--detail", s.detail, "Detail of the assets folder at --center; default: none")->type_name("NAME");
  command.add_option("--size-px", s.size_px, "Side of the frames")->check(CLI::Range(32, 4096))->capture_default_str();
  command.add_option("-o,--output", s.output, "Folder; created if missing")->required()->type_name("DIR");
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, VerifyGroundSettings& s) {
  command.add_option("--detail", s.detail, "Detail of the assets folder")->required()->type_name("NAME");
  command.add_option("--places", s.places, "Squares of 40 x 40 baselines for each baseline")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command.add_option("-o,--output", s.output, "Folder; created if missing")->required()->type_name("DIR");
  add_options(command, s.terrain);
}

void add_options(CLI::App& command, VerifyMertisSettings& s) {
  command.add_option("--instrument", s.instrument, "JSON as for POST /v1/verify/mertis; default: MERTIS")
      ->type_name("FILE");
  command.add_option("-o,--output", s.output, "Folder; created if missing")->required()->type_name("DIR");
}

}  // namespace selenograph::server
