function map = selenograph_map(service, request)
% SELENOGRAPH_MAP  A map: POST /v1/maps. Arrays by product, north on top; map.meta has geotransform and coordinate system.
  map = read_arrays(service, '/v1/maps', request);
end
