function catalogue = selenograph_datasets(service)
% SELENOGRAPH_DATASETS  The catalogue of terrain: GET /v1/datasets.
  catalogue = read_json(selenograph_call(service, 'GET', '/v1/datasets', []));
end
