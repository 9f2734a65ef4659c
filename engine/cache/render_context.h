// Surroundings of a request's work, which every stage may use besides its arguments.
#pragma once

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/cache/render_cache.h"

namespace selenograph::engine {

struct RenderContext {
  const dem::Terrain& terrain;  // with the request's detail
  RenderCache& cache;           // no pixel depends on what it holds
  StopToken stop;               // deadline, and whether the client has left
};

// Returns the same surroundings, with terrain down to the posts only.
inline RenderContext without_detail(const RenderContext& context) {
  return {context.terrain.plain(), context.cache, context.stop};
}

}  // namespace selenograph::engine
