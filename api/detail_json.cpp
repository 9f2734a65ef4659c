#include "api/detail_json.h"

#include <fmt/format.h>

#include "api/assets.h"

namespace selenograph::api {

std::optional<DetailName::Value> DetailName::read(const JsonReader& in, const ReadContext& context) const {
  if (in.value().is_null()) return Value{};
  return Asset{&Assets::detail, "detail", "details"}.read(in, context);
}

OrderedJson DetailName::write(const Value& value) const { return value.content ? OrderedJson(value.name) : nullptr; }

OrderedJson detail_metadata(const std::string& name, const dem::Detail& detail) {
  return {{"name", name},
          {"version", fmt::format("{:016x}", detail.preset().fingerprint)},
          {"synthetic", "craters and relief below the posts: where `gsd` is finer than the source's posts"}};
}

}  // namespace selenograph::api
