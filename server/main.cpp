// The executable: `selenograph serve | render | ingest | sample | info`.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <string>

#include "api/metadata.h"
#include "server/commands.h"
#include "server/config.h"

namespace {

using namespace selenograph::server;

struct Settings {
  ServeSettings serve;
  RenderSettings render;
  TerrainSettings ingest;
  InfoSettings info;
  SampleSettings sample;
};

std::set<std::string> options_of_all(const CLI::App& app) {
  std::set<std::string> names;
  for (const CLI::App* command : app.get_subcommands({})) names.merge(option_names(*command));
  return names;
}

int run(CLI::App& app, const Settings& s) {
  CLI::App& command = *app.get_subcommands().front();
  const std::string name = command.get_name();
  complete_from_environment_and_file(command, options_of_all(app), environment_variable);
  if (name == "serve") return serve(s.serve);
  if (name == "render") return render(s.render);
  if (name == "ingest") return ingest(s.ingest);
  if (name == "info") return info(s.info);
  return sample(s.sample);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Images of the Moon for navigation: frames with true shadows, and the truth behind each pixel.",
               "selenograph");
  app.set_version_flag("--version", std::string(selenograph::api::software_version()));
  app.require_subcommand(1);
  app.footer(
      "Every option is also a member of the TOML file given by --config, and SELENOGRAPH_<OPTION> in the environment:\n"
      "the command line wins over the environment, that over the file, that over the default.");
  Settings settings;
  add_options(*app.add_subcommand("serve", "Answers requests over HTTP"), settings.serve);
  add_options(*app.add_subcommand("render", "Renders one request to a file"), settings.render);
  add_options(*app.add_subcommand("ingest", "Builds the terrain pyramid ahead"), settings.ingest);
  add_options(*app.add_subcommand("sample", "Writes sample terrain"), settings.sample);
  add_options(*app.add_subcommand("info", "Lists the DEM files, their footprints and gaps"), settings.info);
  try {
    app.parse(argc, argv);
    return run(app, settings);
  } catch (const CLI::ParseError& e) {
    return app.exit(e);
  } catch (const std::exception& e) {
    fmt::print(stderr, "error: {}\n", e.what());
    return 1;
  }
}
