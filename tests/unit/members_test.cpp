// One row of a table is a member's reader, its text in the resolved request, its schema and its line in requests.md.
#include "api/schema/members.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <set>
#include <sstream>

#include "api/document/openapi.h"
#include "api/document/requests.h"
#include "api/schema/member_kinds.h"

namespace selenograph::api {
namespace {

enum class Colour { white, red };
constexpr std::pair<std::string_view, Colour> kColours[] = {{"white", Colour::white}, {"red", Colour::red}};

struct Beam {
  double angle_deg = 30;
};
struct Lamp {
  Colour colour = Colour::white;
  double power_w = 5;
  std::optional<double> wavelength_um{};
  int count = 0;
  bool on = true;
  std::optional<Beam> beam{};
};

const Members<Beam>& beam_members() {
  static const auto table = make_table<Members<Beam>>("Beam", "Where it shines.", [](auto& m) {
    m.add("angle_deg", &Beam::angle_deg, Number{above(0).to(180), "deg"}, "full angle");
  });
  return *table;
}

std::int64_t most_lamps(const Limits& limits) { return limits.max_rays; }

// A lamp with the members that every test needs, and what `more` adds.
template <typename More>
std::unique_ptr<const Members<Lamp>> lamp_members(More&& more) {
  return make_table<Members<Lamp>>("Lamp", "A light.", [&](auto& m) {
    m.add("colour", &Lamp::colour, Word{kColours}, "of the light");
    m.set_model("colour");
    m.add("count", &Lamp::count, Integer{1, most_lamps}, "how many").required();
    more(m);
  });
}

struct Read {
  std::optional<Lamp> lamp;
  std::string findings;  // "pointer: detail\n" each
};

Read read(const Members<Lamp>& members, const char* text) {
  const Json json = Json::parse(text);
  const Limits limits;
  const Assets assets;
  Findings findings;
  Read out{members.read(JsonReader(json, findings), {limits, assets}), {}};
  for (const Finding& f : findings.entries()) out.findings += f.pointer + ": " + f.detail + "\n";
  EXPECT_EQ(out.lamp.has_value(), out.findings.empty());
  return out;
}

TEST(Members, ARowIsReaderResolvedTextSchemaAndLineOfTheDocument) {
  const auto without = lamp_members([](auto&) {});
  const auto with = lamp_members([](auto& m) {
    m.add("power_w", &Lamp::power_w, Number{above(0).to(100), "W"}, "radiant flux");
  });

  EXPECT_EQ(read(*without, R"({"count": 1, "power_w": 7})").findings,
            "/power_w: unknown member; known here: \"colour\", \"count\"\n");
  EXPECT_EQ(read(*with, R"({"count": 1, "power_w": 7})").lamp->power_w, 7);
  EXPECT_EQ(read(*with, R"({"count": 1})").lamp->power_w, 5);
  EXPECT_EQ(read(*with, R"({"count": 1, "power_w": 0})").findings,
            "/power_w: must be greater than 0 and at most 100\n");

  const Lamp lamp{.power_w = 7, .count = 2};
  EXPECT_EQ(without->write(lamp).dump(), R"({"colour":"white","count":2})");
  EXPECT_EQ(with->write(lamp).dump(), R"({"colour":"white","count":2,"power_w":7.0})");

  EXPECT_FALSE(without->schema(Limits{})["properties"].contains("power_w"));
  EXPECT_EQ(
      with->schema(Limits{})["properties"]["power_w"].dump(),
      R"json({"type":"number","exclusiveMinimum":0.0,"maximum":100.0,"description":"radiant flux (W)","x-unit":"W","default":5.0})json");

  EXPECT_EQ(without->markdown(Limits{}).find("power_w"), std::string::npos);
  EXPECT_NE(with->markdown(Limits{}).find("\n| `power_w` | number > 0, ≤ 100 | W | `5.0` | radiant flux |\n"),
            std::string::npos)
      << with->markdown(Limits{});
}

TEST(Members, RequiredAndLimitsOfTheService) {
  const auto members = lamp_members([](auto&) {});
  EXPECT_EQ(read(*members, "{}").findings, "/count: is required\n");
  EXPECT_EQ(read(*members, R"({"count": 100001})").findings, "/count: must be at least 1 and at most 100000\n");
  EXPECT_EQ(members->schema(Limits{})["required"], OrderedJson({"count"}));
  Limits few;
  few.max_rays = 3;
  EXPECT_EQ(members->schema(few)["properties"]["count"]["maximum"], 3);
}

TEST(Members, OptionalsAreLeftOutAndObjectsAreReferredTo) {
  const auto members = lamp_members([](auto& m) {
    m.add("wavelength_um", &Lamp::wavelength_um, Number{{0, 10}, "um"}, "of a laser");
    m.add("beam", &Lamp::beam, Object{beam_members()}, "left out: all around");
    m.add("on", &Lamp::on, Flag{}, "whether it shines").written_if([](const Lamp& lamp) { return !lamp.on; });
  });
  const Read plain = read(*members, R"({"count": 1})");
  EXPECT_EQ(members->write(*plain.lamp).dump(), R"({"colour":"white","count":1})");
  const Read full = read(*members, R"({"count": 1, "beam": {}, "on": false, "wavelength_um": 1})");
  EXPECT_EQ(members->write(*full.lamp).dump(),
            R"({"colour":"white","count":1,"wavelength_um":1.0,"beam":{"angle_deg":30.0},"on":false})");
  EXPECT_EQ(read(*members, R"({"count": 1, "beam": {"angle_deg": 200}})").findings,
            "/beam/angle_deg: must be greater than 0 and at most 180\n");
  const OrderedJson properties = members->schema(Limits{})["properties"];
  EXPECT_EQ(properties["beam"]["$ref"], "#/components/schemas/Beam");
  EXPECT_FALSE(properties["wavelength_um"].contains("default"));
  EXPECT_EQ(properties["on"]["default"], true);
}

TEST(Members, MembersOfAModelAreRefusedByTheOthers) {
  const auto members = lamp_members([](auto& m) {
    m.add("power_w", &Lamp::power_w, Number{{0, 100}, "W"}, "radiant flux").required().only_for({"red"});
  });
  EXPECT_EQ(read(*members, R"({"count": 1, "power_w": 1})").findings,
            "/power_w: belongs to \"red\", not to \"white\"\n");
  EXPECT_EQ(read(*members, R"({"count": 1, "colour": "red"})").findings, "/power_w: is required for \"red\"\n");
  EXPECT_EQ(members->write({.colour = Colour::white}).dump(), R"({"colour":"white","count":0})");
  EXPECT_EQ(members->write({.colour = Colour::red}).dump(), R"({"colour":"red","count":0,"power_w":5.0})");
  EXPECT_EQ(
      members->schema(Limits{})["allOf"].dump(),
      R"([{"if":{"properties":{"colour":{"const":"white"}}},"then":{"not":{"anyOf":[{"required":["power_w"]}]}}},)"
      R"({"if":{"properties":{"colour":{"const":"red"}},"required":["colour"]},"then":{"required":["power_w"]}}])");
}

TEST(Members, AModelThatIsNoneIsReportedOnce) {
  const auto members = lamp_members([](auto& m) {
    m.add("power_w", &Lamp::power_w, Number{{0, 100}, "W"}, "radiant flux").required().only_for({"red"});
  });
  EXPECT_EQ(read(*members, R"({"count": 1, "colour": "blue"})").findings, "/colour: must be \"white\" or \"red\"\n");
  EXPECT_EQ(read(*members, R"({"count": 1, "colour": 3, "power_w": 1})").findings, "/colour: must be a string\n");
}

TEST(Members, ReadingBuildsNoSchema) {
  struct CountedWord : Word<Colour> {
    int* schemas;
    OrderedJson schema(const Limits& limits) const {
      ++*schemas;
      return Word::schema(limits);
    }
  };
  int schemas = 0;
  const auto members = make_table<Members<Lamp>>("Lamp", "A light.", [&](auto& m) {
    m.add("colour", &Lamp::colour, CountedWord{{kColours}, &schemas}, "of the light");
    m.set_model("colour");
    m.add("power_w", &Lamp::power_w, Number{{0, 100}, "W"}, "radiant flux").only_for({"red"});
  });
  const int schemas_of_table = schemas;
  read(*members, R"({"colour": "red", "power_w": 1})");
  read(*members, "{}");
  EXPECT_EQ(schemas, schemas_of_table);
}

TEST(Members, RulesAreReportedAndInTheSchema) {
  const auto members = lamp_members([](auto& m) {
    m.add("power_w", &Lamp::power_w, Number{{0, 100}, "W"}, "radiant flux");
    m.add("wavelength_um", &Lamp::wavelength_um, Number{{0, 10}, "um"}, "of a laser");
    m.add("on", &Lamp::on, Flag{}, "whether it shines");
    m.exactly_one({"power_w", "wavelength_um"});
    m.excludes("power_w", {"on"}, "power says it");
    m.needs("wavelength_um", {"on"});
  });
  EXPECT_EQ(read(*members, R"({"count": 1})").findings, ": needs one of \"power_w\" or \"wavelength_um\"\n");
  EXPECT_EQ(read(*members, R"({"count": 1, "power_w": 1, "wavelength_um": 1, "on": true})").findings,
            "/wavelength_um: \"power_w\" and \"wavelength_um\" exclude each other: give one of them\n");
  EXPECT_EQ(read(*members, R"({"count": 1, "power_w": 1, "on": true})").findings,
            "/on: \"on\" cannot be combined with \"power_w\": power says it\n");
  EXPECT_EQ(read(*members, R"({"count": 1, "wavelength_um": 1})").findings,
            "/on: is required with \"wavelength_um\"\n");
  EXPECT_EQ(members->schema(Limits{})["allOf"][0].dump(),
            R"({"oneOf":[{"required":["power_w"]},{"required":["wavelength_um"]}]})");
  EXPECT_EQ(members->schema(Limits{})["allOf"].size(), 3U);
  const std::string document = members->markdown(Limits{});
  EXPECT_NE(
      document.find("\n\nRules: exactly one of `power_w`, `wavelength_um` is required; `power_w` cannot be combined "
                    "with `on`; `wavelength_um` needs `on`.\n\n| member |"),
      std::string::npos)
      << document;
}

// --- the service's own tables

TEST(Members, EveryTableIsAComponentOfTheDocument) {
  const OrderedJson document = openapi_document(Limits{});
  const OrderedJson& schemas = document["components"]["schemas"];
  std::set<std::string> names;
  for (const MemberTable* table : request_tables()) {
    const std::string name(table->name());
    EXPECT_TRUE(names.insert(name).second) << name << " is the name of two tables";
    ASSERT_TRUE(schemas.contains(name)) << name;
    EXPECT_EQ(schemas[name]["additionalProperties"], false) << name;
    OrderedJson members = OrderedJson::array(), properties = OrderedJson::array();
    for (const MemberRow& row : table->rows()) members.push_back(row.name);
    for (const auto& [property, schema] : schemas[name]["properties"].items()) {
      properties.push_back(property);
      EXPECT_FALSE(schema["description"].get<std::string>().empty()) << name << "." << property;
    }
    EXPECT_EQ(members, properties) << name;
  }
  // And no closed schema that no table made.
  for (const auto& [name, schema] : schemas.items())
    EXPECT_EQ(schema.contains("additionalProperties"), names.contains(name)) << name;
}

TEST(Members, TheDocumentIsWhatTheTablesSay) {
  const std::string path = SELENOGRAPH_SOURCE_DIR "/api/requests.md", made = requests_markdown();
  if (std::getenv("SELENOGRAPH_WRITE_DOCUMENTS")) std::ofstream(path) << made;
  std::stringstream committed;
  committed << std::ifstream(path).rdbuf();
  EXPECT_EQ(committed.str(), made) << "write it again: SELENOGRAPH_WRITE_DOCUMENTS=1 with this test";
}

}  // namespace
}  // namespace selenograph::api
