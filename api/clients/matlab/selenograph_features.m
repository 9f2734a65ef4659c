function found = selenograph_features(service, request)
% SELENOGRAPH_FEATURES  Craters or rocks of a detail in a region: POST /v1/features. A row of cells, one struct each.
  answer = read_json(selenograph_call(service, 'POST', '/v1/features', request));
  kind = 'craters';
  if isfield(request, 'kind'), kind = request.kind; end
  found = as_cells(answer.(kind));
end
