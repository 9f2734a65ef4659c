function map = selenograph_map(service, request)
% SELENOGRAPH_MAP  A map: POST /v1/maps. Arrays by product, north on top.
%   map = selenograph_map(service, request)
%   map.meta has the geotransform and the coordinate system; the rest is as in selenograph_frame.
  map = read_arrays(service, '/v1/maps', request);
end
