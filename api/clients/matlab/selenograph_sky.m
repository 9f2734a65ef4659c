function objects = selenograph_sky(service, request)
% SELENOGRAPH_SKY  Stars, Sun, Earth and planets in view: POST /v1/sky. A row of cells, one struct each.
  objects = as_cells(getfield(read_json(selenograph_call(service, 'POST', '/v1/sky', request)), 'objects'));
end
