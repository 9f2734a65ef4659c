#include "api/document/openapi.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "api/encode/arrays.h"
#include "api/encode/negotiate.h"
#include "api/endpoints/routes.h"
#include "api/json/ranges.h"
#include "api/message/problem.h"
#include "api/requests/frame_json.h"

namespace selenograph::api {
namespace {

using OrderedJson = nlohmann::ordered_json;

const OrderedJson& document() {
  static const OrderedJson made = openapi_document(Limits{});
  return made;
}

std::string operation_key(std::string_view method) { return method == "GET" ? "get" : "post"; }

// Calls visit(key, value) for every member of every object in the document.
template <typename Visit>
void walk(const OrderedJson& json, Visit&& visit) {
  if (json.is_object()) {
    for (const auto& [key, value] : json.items()) visit(key, value);
  }
  if (json.is_structured()) {
    for (const auto& value : json) walk(value, visit);
  }
}

TEST(OpenApi, EveryReferenceResolves) {
  int references = 0;
  walk(document(), [&](const std::string& key, const OrderedJson& value) {
    if (key != "$ref") return;
    ++references;
    const std::string target = value.get<std::string>();
    ASSERT_EQ(target.substr(0, 2), "#/");
    EXPECT_TRUE(document().contains(OrderedJson::json_pointer(target.substr(1)))) << target;
  });
  EXPECT_GT(references, 50);
}

TEST(OpenApi, EveryComponentIsReferredTo) {
  const std::string text = document().dump();
  for (const auto& [kind, parts] : document().at("components").items()) {
    for (const auto& [name, part] : parts.items()) {
      const std::string target = "\"#/components/" + kind + "/" + name;
      const bool used = text.find(target + "\"") != std::string::npos || text.find(target + "/") != std::string::npos;
      EXPECT_TRUE(used) << kind << " " << name;
    }
  }
}

TEST(OpenApi, EveryRouteIsDocumentedWithItsProblems) {
  for (const Route& route : kRoutes) {
    const auto& path = document().at("paths").at(std::string(route.path));
    const auto& operation = path.at(operation_key(route.method));
    EXPECT_EQ(operation.at("operationId"), route.operation_id);
    EXPECT_EQ(operation.contains("requestBody"), route.has_body()) << route.path;
    for (const char* status : {"200", "400", "403", "406", "421", "503"}) {
      EXPECT_TRUE(operation.at("responses").contains(status)) << route.path << " " << status;
    }
    const bool remembered = route.path == "/v1/frames/{hash}/meta";
    const bool computes = route.path != "/v1/datasets" && route.path != "/openapi.json" && !remembered;
    EXPECT_EQ(operation.at("responses").contains("404"), remembered) << route.path;
    for (const char* status : {"422", "504"}) {
      EXPECT_EQ(operation.at("responses").contains(status), computes) << route.path << " " << status;
    }
    EXPECT_EQ(operation.at("responses").contains("500"), computes && route.path != "/v1/verify/mertis") << route.path;
    EXPECT_EQ(operation.at("responses").contains("415"), route.has_body()) << route.path;
  }
}

TEST(OpenApi, EveryPathIsARoute) {
  for (const auto& [path, operations] : document().at("paths").items()) {
    const bool route = std::ranges::any_of(kRoutes, [&, path = path](const Route& r) { return r.path == path; });
    const bool operators = path.starts_with("/health/") || path == "/metrics";
    EXPECT_TRUE(route || operators) << path;
  }
}

TEST(OpenApi, EveryErrorIsInTheTableAndItsResponse) {
  const std::string description = document().at("info").at("description");
  for (const ErrorRow& row : error_table()) {
    EXPECT_NE(description.find("| `" + std::string(row.code) + "` | " + std::to_string(row.status)), std::string::npos)
        << row.code;
    if (row.status == 404 || row.status == 499 || row.status == 501) continue;  // belong to no operation
    const auto& response = document().at("components").at("responses").at("Problem" + std::to_string(row.status));
    EXPECT_TRUE(response.at("content").at("application/problem+json").at("examples").contains(std::string(row.code)));
  }
}

TEST(OpenApi, ProductsAndRepresentationsAreThoseOfTheTables) {
  const auto& schema = document().at("components").at("schemas").at("FrameRequest").at("properties").at("products");
  OrderedJson names = OrderedJson::array();
  for (const ProductRow& row : products()) {
    names.push_back(row.name);
    EXPECT_NE(schema.at("description").get<std::string>().find(fmt::format("`{}` ", row.name)), std::string::npos);
  }
  EXPECT_EQ(schema.at("items").at("enum"), names);
  const auto& content = document().at("paths").at("/v1/frames").at("post").at("responses").at("200").at("content");
  EXPECT_EQ(content.size(), representations().size());
  for (const Representation& r : representations()) EXPECT_TRUE(content.contains(std::string(r.media_type)));
}

TEST(OpenApi, RangesAreTheParsers) {
  const auto& schemas = document().at("components").at("schemas");
  const auto& fov = schemas.at("Camera").at("properties").at("fov_deg");
  EXPECT_EQ(fov.at("exclusiveMinimum"), kFieldOfView_deg.min);
  EXPECT_EQ(fov.at("maximum"), kFisheyeFieldOfView_deg.max);
  EXPECT_EQ(fov.at("x-unit"), "deg");
  EXPECT_FALSE(schemas.at("Camera").at("properties").at("model").contains("x-unit"));
  const auto pinhole = std::ranges::find_if(schemas.at("Camera").at("allOf"), [](const auto& rule) {
    return rule.contains("if") && rule.at("if").at("properties").at("model").at("const") == "fisheye";
  });
  ASSERT_NE(pinhole, schemas.at("Camera").at("allOf").end());
  EXPECT_EQ(pinhole->at("else").at("properties").at("fov_deg").at("exclusiveMaximum"), kFieldOfView_deg.max);
  EXPECT_EQ(schemas.at("Camera").at("properties").at("width").at("maximum"), 65535) << "calls that draw nothing";
  EXPECT_NE(schemas.at("FrameRequest").dump().find(R"("camera":{"properties":{"width":{"maximum":8192})"),
            std::string::npos);
  EXPECT_EQ(schemas.at("Sun").at("properties").at("distance_au").at("maximum"), kDistance_au.max);
}

// Members of the closed request schemas must be exactly those that the parser knows: it names an unknown member of
// each.
TEST(OpenApi, RequestMembersAreTheParsers) {
  const auto& properties = document().at("components").at("schemas").at("FrameRequest").at("properties");
  for (const auto& [name, schema] : properties.items()) {
    Json body = examples().at("/v1/frames").at("nadir");
    body[name] = name == "detail" ? Json(true) : Json();  // of the wrong type, but known
    try {
      read_frame(body, Limits{});
      ADD_FAILURE() << name;
    } catch (const RequestError& e) {
      bool found = false;
      for (const Finding& f : e.findings()) {
        EXPECT_EQ(f.detail.find("unknown"), std::string::npos) << f.pointer;
        found |= f.pointer == "/" + name;
      }
      EXPECT_TRUE(found) << name;
    }
  }
}

}  // namespace
}  // namespace selenograph::api
