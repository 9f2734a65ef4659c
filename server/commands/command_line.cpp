#include "server/commands/command_line.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "api/answers/metadata.h"
#include "api/assets/sight_file.h"
#include "api/json/json_reader.h"
#include "api/message/version.h"
#include "engine/visibility/meshes/mesh_reader.h"
#include "server/commands/commands.h"
#include "server/commands/config.h"

namespace selenograph::server {
namespace {

struct Settings {
  ServeSettings serve;
  AskSettings ask;
  BatchSettings batch;
  BatchVerifySettings batch_verify;
  TerrainSettings ingest;
  InfoSettings info;
  SampleSettings sample;
  VerifyRoundTripSettings verify_round_trip;
  VerifyAccuracySettings verify_accuracy;
  VerifyMertisSettings verify_mertis;
};

// Maps each command to a function that runs it with its complete settings.
using Work = std::map<const CLI::App*, std::function<int()>>;

// Adds a command to `parent`, and the call that runs it to `work`.
template <typename SettingsOfCommand>
CLI::App& add(CLI::App& parent, Work& work, const char* name, const char* purpose, SettingsOfCommand& settings,
              int (*command)(const SettingsOfCommand&)) {
  CLI::App* app = parent.add_subcommand(name, purpose);
  add_options(*app, settings);
  complete_options(*app);
  work[app] = [&settings, command] { return command(settings); };
  return *app;
}

// Prints the request file before the options: behind an option with several values, it would be taken as one of them.
struct RequestFirst : CLI::Formatter {
  std::string make_usage(const CLI::App* command, std::string name) const override {
    std::string usage = CLI::Formatter::make_usage(command, std::move(name)), files;
    for (const CLI::Option* file : command->get_options([](const CLI::Option* o) { return o->get_positional(); }))
      files += " " + make_option_usage(file);
    const std::string options = " [" + get_label("OPTIONS") + "]";
    const std::size_t at = usage.find(options + files);
    return at == std::string::npos ? usage : usage.replace(at, options.size() + files.size(), files + options);
  }
};

// Adds all commands, which write into the settings, and returns what runs them.
Work add_commands(CLI::App& app, Settings& s) {
  Work work;
  add(app, work, "serve", "Answer requests over HTTP", s.serve, serve);
  add(app, work, "ask", "Write the answer to one request to a file", s.ask, ask);
  CLI::App& campaign = add(app, work, "batch", "Render a manifest's frames to a folder", s.batch, batch);
  add(campaign, work, "verify", "Check that every frame of a manifest exists and is undamaged", s.batch_verify,
      batch_verify);
  add(app, work, "ingest", "Build the terrain pyramid in advance", s.ingest, ingest);
  add(app, work, "sample", "Write sample terrain", s.sample, sample);
  add(app, work, "info", "List the DEM files, their footprints and gaps", s.info, info);
  CLI::App& verify = *app.add_subcommand("verify", "Measure the accuracy of the answers");
  verify.require_subcommand(1);
  verify.footer("Photographs and the Moon's brightness: tests/verify/photographs.py and tests/verify/moon.py.");
  add(verify, work, "roundtrip", "Extract a DEM from camera views and compare it with the original",
      s.verify_round_trip, verify_round_trip);
  add(verify, work, "accuracy", "Measure speed against error on named scenes or a frame of your own, for every setting",
      s.verify_accuracy, verify_accuracy);
  add(verify, work, "mertis", "Compute flux and SNR of a thermal imaging spectrometer", s.verify_mertis, verify_mertis);
  return work;
}

std::set<std::string> all_option_names(const Work& work) {
  std::set<std::string> names;
  for (const auto& [command, unused] : work) names.merge(option_names(*command));
  return names;
}

// Uses std::fputs, because fmt::print throws if standard error cannot be written.
void print_error(const std::string& text) { std::fputs(text.c_str(), stderr); }

// Prints the candidate nearest to a misspelt word, if one is near enough.
void print_nearest(const std::string& word, const std::vector<std::string>& candidates) {
  const std::vector<std::string_view> names(candidates.begin(), candidates.end());
  if (const auto nearest = api::did_you_mean(word, names))
    print_error(fmt::format("{}: did you mean {}?\n", word, *nearest));
}

// After a parse error, prints the command or option nearest to the first word that names none.
void suggest(const CLI::App& app, int argc, char** argv) {
  const CLI::App* command = &app;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    std::vector<std::string> candidates;
    if (word.starts_with("--")) {
      for (const CLI::Option* option : command->get_options())
        for (const std::string& name : option->get_lnames()) candidates.push_back("--" + name);
      const std::string name = word.substr(0, word.find('='));
      if (std::ranges::find(candidates, name) != candidates.end()) continue;
      if (const CLI::App* parent = command->get_parent(); parent && parent->get_option_no_throw(name))
        return print_error(
            fmt::format("{} is an option of {}, not of {}\n", name, parent->get_name(), command->get_name()));
      return print_nearest(name, candidates);
    }
    // Follow the command's name. A word that names no command is a file, unless a command must follow here.
    const auto commands = command->get_subcommands([](const CLI::App*) { return true; });
    const auto next = std::ranges::find(commands, word, [](const CLI::App* c) { return c->get_name(); });
    if (next == commands.end() && command->get_require_subcommand_min() == 0) continue;
    for (const CLI::App* candidate : commands) candidates.push_back(candidate->get_name());
    if (next == commands.end()) return print_nearest(word, candidates);
    command = *next;
  }
}

// Prints the usage of the command that was parsed.
void print_usage(const CLI::App& app) {
  const CLI::App* command = &app;
  std::string name = app.get_name();
  while (!command->get_subcommands().empty()) {
    command = command->get_subcommands().front();
    name += " " + command->get_name();
  }
  print_error(RequestFirst().make_usage(command, name));
}

// Completes the settings of the command that was parsed, and runs it. Returns its exit status.
int run(CLI::App& app, const Work& work) {
  CLI::App* command = &app;
  while (!command->get_subcommands().empty()) command = command->get_subcommands().front();
  complete_settings(*command, all_option_names(work));
  return work.at(command)();
}

// Former commands, each with a further word where that alone is gone, and what takes their place.
struct Former {
  std::string_view command, word, successor;
};
constexpr Former kFormer[] = {
    {"render", "", "selenograph ask frames REQUEST.json -o OUT"},
    {"map", "", "selenograph ask maps REQUEST.json -o OUT"},
    {"lidar", "", "selenograph ask lidar REQUEST.json -o OUT"},
    {"horizons", "", "selenograph ask horizons REQUEST.json -o OUT"},
    {"features", "", "selenograph ask features REQUEST.json -o OUT"},
    {"illumination", "", "selenograph ask illumination REQUEST.json -o OUT"},
    {"verify", "photographs", "tests/verify/photographs.py"},
    {"verify", "moon", "tests/verify/moon.py"},
    {"verify", "ground", "selenograph_unit_tests --gtest_filter='Ground.*'"},
    {"verify", "--indirect", "selenograph_hard_tests --gtest_filter='IndirectLight.*'"},
    {"batch", "--coco", "python3 -m selenograph coco DIR -o coco.json"},
};

bool uses(std::span<char*> arguments, const Former& former) {
  if (arguments.size() < 2 || arguments[1] != former.command) return false;
  if (former.word.starts_with("--")) return std::ranges::find(arguments, former.word) != arguments.end();
  return former.word.empty() || (arguments.size() > 2 && arguments[2] == former.word);
}

// Prints what takes the place of a former command. Returns false if the arguments use none.
bool print_successor(std::span<char*> arguments) {
  const auto former = std::ranges::find_if(kFormer, [&](const Former& f) { return uses(arguments, f); });
  if (former == std::end(kFormer)) return false;
  const auto& [command, word, successor] = *former;
  print_error(fmt::format("selenograph {}{}{} is now: {}\n", command, word.empty() ? "" : " ", word, successor));
  return true;
}

// Returns the status, or 1 if standard output cannot be written: stdio buffers short output until here.
int with_output_written(int status) {
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return status;
  print_error("error: standard output cannot be written\n");
  return status != 0 ? status : 1;
}

// Opens standard streams that are closed at the start: otherwise the next opened file would get their number, and then
// messages. Standard output is opened for reading only, so that writing to it still fails.
void open_standard_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (::fcntl(stream, F_GETFD) == -1) ::open("/dev/null", stream == STDOUT_FILENO ? O_RDONLY : O_RDWR);
}

}  // namespace

int run_command_line(int argc, char** argv) {
  open_standard_streams();
  // Hidden commands, for child processes of this executable.
  if (argc > 1 && std::string_view(argv[1]) == engine::kReadMeshCommand) return engine::read_mesh_in_child(argc, argv);
  if (argc > 1 && std::string_view(argv[1]) == api::kReadSightsCommand) return api::read_sights_in_child(argc, argv);
  if (print_successor({argv, static_cast<std::size_t>(argc)})) return 1;
  std::signal(SIGXFSZ, SIG_IGN);  // a file over the size limit then fails to be written, as on a full disk
  CLI::App app("Images of the Moon for navigation: frames with exact shadows, and ground truth for every pixel.",
               "selenograph");
  app.formatter(std::make_shared<RequestFirst>());
  app.set_version_flag("--version", std::string(api::software_version()));
  app.require_subcommand(1);
  app.footer(
      "Every option is also SELENOGRAPH_<OPTION> in the environment and, beside --config, a member of that file:\n"
      "precedence: command line, environment, file, default.");
  Settings settings;
  const Work work = add_commands(app, settings);
  try {
    app.parse(argc, argv);
    return with_output_written(run(app, work));
  } catch (const CLI::ParseError& e) {
    const int status = app.exit(e);
    if (status != 0) suggest(app, argc, argv);
    if (status == static_cast<int>(CLI::ExitCodes::RequiredError)) print_usage(app);
    return with_output_written(status);
  } catch (const std::exception& e) {
    print_error(fmt::format("error: {}\n", e.what()));
    return 1;
  }
}

}  // namespace selenograph::server
