// The commands of the executable. Each returns the exit status, and throws errors that run_command_line() prints.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "dem/sample/sample_terrain.h"
#include "engine/verify/round_trip.h"
#include "server/commands/config.h"

namespace selenograph::server {

struct AskSettings {
  TerrainSettings terrain;
  std::string call;           // one of ask_calls()
  std::string request;        // path, "-": stdin
  std::string output;         // path whose suffix is the format, or a folder of tiles; "-": stdout
  int tile_px = 0;            // side of a map's tiles; 0: no tiles
  std::string shard = "0/1";  // I/N of the tiles, I from 0
};
// Returns the calls of the API that have a body: "frames" for POST /v1/frames.
std::vector<std::string> ask_calls();

struct BatchSettings {
  TerrainSettings terrain;
  api::Limits limits;
  std::string manifest, output;  // output: folder
  std::string shard = "0/1";     // I/N, I from 0
  std::string format = "npz";
  std::size_t frames_per_tar = 1000;
  bool resume = false;
  int in_work = 0;  // 0: two, or one on a single core
};

struct BatchVerifySettings {
  std::string manifest, output;
  std::string rerun;  // manifest to write; empty: none
};

struct InfoSettings {
  TerrainSettings terrain;
  bool json = false;
  int resampling = 0;                  // posts of each resampled file to compare with the mesh
  int borders = 64;                    // layers whose borders are measured
  std::optional<std::size_t> heights;  // posts of each file, for its lowest and highest height; empty: see the option
};

struct SampleSettings {
  dem::SampleOptions options;
  std::string folder;
};

struct VerifyRoundTripSettings {
  TerrainSettings terrain;
  std::string center;                // "LAT,LON", degrees; copied into `request`
  std::string mode = "both";         // or "exact", "camera"
  engine::RoundTripRequest request;  // run once for each mode
  std::string output;                // folder
};

struct VerifyAccuracySettings {
  TerrainSettings terrain;
  std::string request;               // file with a frame's request, "-": stdin; empty: the scenes
  std::string center, polar_center;  // "LAT,LON", degrees; empty: see the options
  std::string detail;                // name in the assets folder; empty: no scene with detail
  std::vector<std::string> scenes;   // names of the scenes to measure; empty: all
  double height_m = 20e3;            // for all scenes but the descents
  int size_px = 256;
  int repetitions = 5;
  int reference_samples = 256;
  std::string output;  // folder
};

struct VerifyMertisSettings {
  std::string instrument;  // JSON file; empty: MERTIS with the paper's and assumed values
  std::string output;      // folder
};

void add_options(CLI::App& command, AskSettings& settings);
void add_options(CLI::App& command, BatchSettings& settings);
void add_options(CLI::App& command, BatchVerifySettings& settings);
void add_options(CLI::App& command, InfoSettings& settings);
void add_options(CLI::App& command, SampleSettings& settings);
void add_options(CLI::App& command, VerifyRoundTripSettings& settings);
void add_options(CLI::App& command, VerifyAccuracySettings& settings);
void add_options(CLI::App& command, VerifyMertisSettings& settings);

int serve(const ServeSettings& settings);
int ask(const AskSettings& settings);
int batch(const BatchSettings& settings);
int batch_verify(const BatchVerifySettings& settings);
int ingest(const TerrainSettings& settings);
int info(const InfoSettings& settings);
int sample(const SampleSettings& settings);
int verify_round_trip(const VerifyRoundTripSettings& settings);
int verify_accuracy(const VerifyAccuracySettings& settings);
int verify_mertis(const VerifyMertisSettings& settings);

}  // namespace selenograph::server
