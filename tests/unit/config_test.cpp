#include "server/commands/config.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>

#include "server/commands/commands.h"

namespace selenograph::server {
namespace {

class Config : public ::testing::Test {
 protected:
  Config() {
    path_ = (std::filesystem::temp_directory_path() / ("selenograph-config-" + std::to_string(::getpid()) + ".toml"))
                .string();
    serve_ = app_.add_subcommand("serve");
    add_options(*serve_, settings_);
    complete_options(*serve_);
  }
  ~Config() override {
    std::remove(path_.c_str());
    for (const auto& [name, value] : environment_) ::unsetenv(name.c_str());
  }

  void file(const std::string& text) { std::ofstream(path_) << text; }

  // With --config when the test wrote a file.
  void parse(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "serve");
    if (std::filesystem::exists(path_)) arguments.insert(arguments.end(), {"--config", path_});
    std::reverse(arguments.begin(), arguments.end());  // as CLI11 wants it
    for (const auto& [name, value] : environment_) ::setenv(name.c_str(), value.c_str(), 1);
    app_.parse(arguments);
    std::set<std::string> known = option_names(*serve_);
    known.insert("seed");  // an option of another command
    complete_settings(*serve_, known);
  }

  std::string failure(const std::vector<std::string>& arguments) {
    try {
      parse(arguments);
    } catch (const CLI::ParseError& e) {
      return e.what();
    }
    return {};
  }

  CLI::App app_;
  CLI::App* serve_;
  ServeSettings settings_;
  std::string path_;
  std::map<std::string, std::string> environment_;
};

TEST_F(Config, DefaultsAreLoopbackAndBounded) {
  parse({});
  EXPECT_EQ(settings_.host, "127.0.0.1");
  EXPECT_EQ(settings_.port, 8080);
  EXPECT_EQ(settings_.max_waiting, 256);
  EXPECT_EQ(settings_.shutdown_s, 10);
  EXPECT_TRUE(settings_.terrain.dem.empty());
}

TEST_F(Config, FileBeatsDefault) {
  file("port = 1111\nhost = \"::1\"\ndeadline-s = 2.5\nstrict = true\n");
  parse({});
  EXPECT_EQ(settings_.port, 1111);
  EXPECT_EQ(settings_.host, "::1");
  EXPECT_EQ(settings_.limits.default_deadline, std::chrono::milliseconds(2500));
  EXPECT_TRUE(settings_.terrain.strict);
}

TEST_F(Config, EnvironmentBeatsFile) {
  file("port = 1111\ncache-mb = 100\n");
  environment_["SELENOGRAPH_PORT"] = "2222";
  parse({});
  EXPECT_EQ(settings_.port, 2222);
  EXPECT_EQ(settings_.terrain.memory.cache_mb, 100u);
}

TEST_F(Config, CommandLineBeatsEnvironmentAndFile) {
  file("port = 1111\n");
  environment_["SELENOGRAPH_PORT"] = "2222";
  parse({"--port", "3333"});
  EXPECT_EQ(settings_.port, 3333);
}

TEST_F(Config, CommandLineBeatsOthersEvenWithTheDefaultValue) {
  environment_["SELENOGRAPH_PORT"] = "2222";
  parse({"--port", "8080"});
  EXPECT_EQ(settings_.port, 8080);
}

TEST_F(Config, ListsComeWholeFromOnePlace) {
  file("dem = [\"a\", \"b\"]\n");
  parse({});
  EXPECT_EQ(settings_.terrain.dem, (std::vector<std::string>{"a", "b"}));
}

TEST_F(Config, ListsInTheEnvironmentAreInBrackets) {
  file("dem = [\"a\", \"b\"]\n");
  environment_["SELENOGRAPH_DEM"] = "[/x,/y y,/vsicurl/http://127.0.0.1:8000/a.tif]";
  environment_["SELENOGRAPH_REMOTE_PREFIX"] = "/vsicurl/http://127.0.0.1:8000/";
  parse({});
  EXPECT_EQ(settings_.terrain.dem, (std::vector<std::string>{"/x", "/y y", "/vsicurl/http://127.0.0.1:8000/a.tif"}));
  EXPECT_EQ(settings_.terrain.remote_prefix, (std::vector<std::string>{"/vsicurl/http://127.0.0.1:8000/"}));
}

TEST_F(Config, ListsOnTheCommandLineReplaceTheOthers) {
  file("dem = [\"a\", \"b\"]\n");
  parse({"--dem", "c"});
  EXPECT_EQ(settings_.terrain.dem, (std::vector<std::string>{"c"}));
}

TEST_F(Config, TheFileCanBeNamedInTheEnvironment) {
  const std::string other = path_ + ".other";
  std::ofstream(other) << "port = 4444\n";
  environment_["SELENOGRAPH_CONFIG"] = other;
  parse({});
  std::remove(other.c_str());
  EXPECT_EQ(settings_.port, 4444);
}

TEST_F(Config, UnknownMembersAreErrorsThatNameFileAndMember) {
  file("prot = 1111\n");
  const std::string what = failure({});
  EXPECT_NE(what.find("prot"), std::string::npos) << what;
  EXPECT_NE(what.find(path_), std::string::npos) << what;
}

TEST_F(Config, MembersOfOtherCommandsAreAllowed) {
  file("seed = 5\nport = 1111\n");
  parse({});
  EXPECT_EQ(settings_.port, 1111);
}

TEST_F(Config, ChecksValuesOfTheEnvironment) {
  environment_["SELENOGRAPH_PORT"] = "99999";
  EXPECT_NE(failure({}).find("--port: Value 99999 not in range"), std::string::npos);
}

TEST_F(Config, ChecksValuesOfTheFile) {
  file("on-data-error = \"ignore\"\n");
  EXPECT_NE(failure({}).find("on-data-error"), std::string::npos);
}

TEST_F(Config, RejectsValuesThatAreNotNumbers) {
  environment_["SELENOGRAPH_THREADS"] = "many";
  EXPECT_NE(failure({}).find("--threads"), std::string::npos);
}

TEST_F(Config, RejectsSections) {
  file("[serve]\nport = 1\n");
  EXPECT_NE(failure({}).find("serve"), std::string::npos);
}

TEST_F(Config, CommentsAndLists) {
  file("# comment\n\ndem = [\"a, b\", \"c\"]\nport = 1111  # a port\n# host = \"::1\"\n");
  EXPECT_EQ(failure({}), "");
  EXPECT_EQ(settings_.terrain.dem, (std::vector<std::string>{"a, b", "c"}));
  EXPECT_EQ(settings_.port, 1111);
  EXPECT_EQ(settings_.host, "127.0.0.1");
}

TEST_F(Config, TrustedProxiesAndLogFormat) {
  parse({"--trusted-proxy", "10.0.0.1", "fd00::1", "--log-format", "json"});
  EXPECT_EQ(settings_.trusted_proxy, (std::vector<std::string>{"10.0.0.1", "fd00::1"}));
  EXPECT_EQ(settings_.log_format, LogFormat::json);
  EXPECT_NE(failure({"--trusted-proxy", "proxy.example.org"}).find("proxy.example.org is not an IP address"),
            std::string::npos);
  EXPECT_NE(failure({"--log-format", "xml"}), "");
}

TEST_F(Config, AllowedHostsAreNamesAndAddresses) {
  parse({"--allowed-host", "moon.example", "--allowed-host", "::1", "b"});
  EXPECT_EQ(settings_.allowed_host, (std::vector<std::string>{"moon.example", "::1", "b"}));
  for (const char* text : {"http://moon.example", "moon.example/", ""})
    EXPECT_NE(failure({"--allowed-host", text}).find("is not a host name or address"), std::string::npos) << text;
}

TEST_F(Config, AddressesInLists) {
  environment_["SELENOGRAPH_ALLOWED_HOST"] = "[a,fd00::1,::1,b]";
  environment_["SELENOGRAPH_TRUSTED_PROXY"] = "[10.0.0.1,fd00::2]";
  parse({});
  EXPECT_EQ(settings_.allowed_host, (std::vector<std::string>{"a", "fd00::1", "::1", "b"}));
  EXPECT_EQ(settings_.trusted_proxy, (std::vector<std::string>{"10.0.0.1", "fd00::2"}));
}

TEST_F(Config, ListForASingleValueIsAnError) {
  file("port = [1, 2]\n");
  EXPECT_NE(failure({}).find("port"), std::string::npos);
}

TEST(ConfigNames, VariableNames) {
  EXPECT_EQ(variable_name("cache-mb"), "SELENOGRAPH_CACHE_MB");
  EXPECT_EQ(variable_name("dem"), "SELENOGRAPH_DEM");
}

TEST(ConfigLimits, DeadlineAndBody) {
  api::Limits limits;
  CLI::App command;
  add_options(command, limits);
  command.parse("--deadline-s 0.25 --max-body-kb 2");
  EXPECT_EQ(limits.default_deadline, std::chrono::milliseconds(250));
  EXPECT_EQ(limits.max_body_bytes, 2048u);
}

// What --help says is what the service does without options.
TEST(ConfigLimits, DefaultsAreTheServices) {
  const api::Limits untouched;
  api::Limits limits;
  CLI::App command;
  add_options(command, limits);
  complete_options(command);
  for (const auto& [option, value] :
       {std::pair<std::string, double>{"--deadline-s", 1e-3 * static_cast<double>(untouched.default_deadline.count())},
        {"--max-body-kb", static_cast<double>(untouched.max_body_bytes) / 1024},
        {"--max-image-pixels", static_cast<double>(untouched.max_image_pixels)},
        {"--max-map-pixels", static_cast<double>(untouched.max_map_pixels)},
        {"--max-image-side", untouched.max_image_side},
        {"--max-samples-per-pixel", untouched.max_samples_per_pixel},
        {"--max-rays", untouched.max_rays},
        {"--max-lidar-rays", static_cast<double>(untouched.max_lidar_rays)}})
    EXPECT_EQ(std::stod(command.get_option(option)->get_default_str()), value) << option;
}

// NaN is neither below nor above a border. The number of options with borders.
template <typename Settings>
int refuse_nan() {
  Settings settings;
  CLI::App command;
  add_options(command, settings);
  int options = 0;
  for (CLI::Option* option : command.get_options()) {
    if (option->get_type_name().find("FLOAT in [") == std::string::npos) continue;
    ++options;
    for (const char* text : {"nan", "-NaN", "inf", "x"}) {
      option->clear();
      option->add_result(text);
      EXPECT_THROW(option->run_callback(), CLI::ValidationError) << option->get_name() << ' ' << text;
    }
  }
  return options;
}

TEST(ConfigLimits, NoOptionTakesNan) {
  EXPECT_GT(refuse_nan<ServeSettings>(), 3);
  EXPECT_GT(refuse_nan<BatchSettings>(), 1);
  EXPECT_GT(refuse_nan<VerifyRoundTripSettings>(), 2);
  EXPECT_GT(refuse_nan<VerifyAccuracySettings>(), 1);
}

TEST_F(Config, NanIsNoNumberWhereverItComesFrom) {
  const auto expect_refused = [this](const std::vector<std::string>& arguments, const std::string& origin) {
    const std::string said = failure(arguments);
    EXPECT_TRUE(said.starts_with(origin)) << said;
    EXPECT_NE(said.find("nan is not a number"), std::string::npos) << said;
  };
  expect_refused({"--shutdown-s", "nan"}, "--shutdown-s: ");
  environment_["SELENOGRAPH_SHUTDOWN_S"] = "nan";
  expect_refused({}, "--shutdown-s: ");
  ::unsetenv("SELENOGRAPH_SHUTDOWN_S");
  environment_.clear();
  file("shutdown-s = nan\n");
  expect_refused({}, path_ + ": --shutdown-s: ");
  file("shutdown-s = 2.5\n");
  EXPECT_EQ(failure({}), "");
  EXPECT_EQ(settings_.shutdown_s, 2.5);
}

}  // namespace
}  // namespace selenograph::server
