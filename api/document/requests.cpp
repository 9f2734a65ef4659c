#include "api/document/requests.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "api/encode/arrays.h"
#include "api/endpoints/routes.h"

namespace selenograph::api {
namespace {

// The body of a POST: its path, and the table of its members.
struct RequestBody {
  std::string_view path;
  const MemberTable& members;
};

// Returns the bodies of all calls that have one, in the order of kRoutes. Each endpoint's description names its table.
std::vector<RequestBody> bodies() {
  const Limits limits;
  std::vector<RequestBody> list;
  for (const Route& route : kRoutes) {
    Operation operation(limits);
    route.describe(operation);
    if (operation.request) list.push_back({route.path, *operation.request});
  }
  return list;
}

// Adds a table and, depth first, the tables of the objects in it that are not yet listed.
void add_with_objects(std::vector<const MemberTable*>& tables, const MemberTable& table) {
  if (std::find(tables.begin(), tables.end(), &table) != tables.end()) return;
  tables.push_back(&table);
  for (const MemberRow& row : table.rows())
    for (const MemberTable* object : row.objects) add_with_objects(tables, *object);
}

std::string products_markdown() {
  std::string out = "## Products\n\nArrays of height x width, row 0 on top.\n\n| name | type | |\n|---|---|---|\n";
  for (const ProductRow& row : products())
    out += fmt::format("| `{}` | {} | {} |\n", row.name, type_text(row), row.meaning);
  out += "\nFor maps, row 0 in the north; NaN where there is no data or no Moon.\n\n| name | type | |\n|---|---|---|\n";
  for (const ProductRow& row : map_products())
    out += fmt::format("| `{}` | {} | {} |\n", row.name, type_text(row), row.meaning);
  return out;
}

// Objects of nearly every request: their members are open to the reader, those of others are folded.
constexpr std::array<std::string_view, 4> kOpenObjects{"FrameRequest", "Camera", "Pose", "Sun"};

std::string object_markdown(const MemberTable& table) {
  std::string text = table.markdown(Limits{});
  if (std::find(kOpenObjects.begin(), kOpenObjects.end(), table.name()) != kOpenObjects.end()) return text;
  text.insert(text.find("| member |"), "<details><summary>members</summary>\n\n");
  return text + "\n</details>\n";
}

}  // namespace

std::vector<const MemberTable*> request_tables() {
  std::vector<const MemberTable*> tables;
  for (const RequestBody& body : bodies()) add_with_objects(tables, body.members);
  return tables;
}

std::string requests_markdown() {
  std::string out =
      "# Members of the requests\n\nGenerated from the tables that parse requests; a test compares this file with "
      "them. Limits are the defaults; those of a\nservice are in its `/openapi.json`. Unknown members are errors. "
      "Angles are in degrees, lengths in metres, positions in\nMOON_ME.\n\n| call | body |\n|---|---|\n";
  for (const RequestBody& body : bodies()) out += fmt::format("| `POST {}` | {} |\n", body.path, link_to(body.members));
  out += fmt::format("\n{}\n## Objects\n", products_markdown());
  for (const MemberTable* table : request_tables()) out += fmt::format("\n{}", object_markdown(*table));
  return out;
}

}  // namespace selenograph::api
