function every_call(url, requests)
% Makes the calls that no example of api/clients/matlab makes and prints what came back as JSON: for every_call_test.py,
% which writes the file `requests`, requests by path.
  sun = struct('subsolar', struct('lat_deg', 0, 'lon_deg', 100));
  camera = struct('width', 320, 'height', 240, 'fov_deg', 50);
  said.heights = as_rows(selenograph_heights(url, [-6.5 30], [40 100]));
  above = selenograph_pose(struct('lat_deg', -6.5, 'lon_deg', 40, 'height_m', 30000), 'nadir', 0);
  said.project = as_rows(selenograph_project(url, camera, above, [-6.5 40 NaN; -6.6 40.1 500; 30 100 NaN], sun));
  said.rays = as_rows(selenograph_rays(url, [1345000 1130000 -200000; 1800000 0 0], [-1345 -1130 199; 1 0 0], sun));
  said.datasets = numel(selenograph_datasets(url).datasets);
  M = [0.36 -0.8 -0.48; 0.48 0.6 -0.64; 0.8 0 0.6];
  ways = {'camera_from_moon_wxyz', [0.8 0.2 -0.4 0.4]; 'camera_from_moon_xyzw', [0.2 -0.4 0.4 0.8]; ...
          'moon_from_camera_wxyz', [0.8 -0.2 0.4 -0.4]; 'moon_from_camera_xyzw', [-0.2 0.4 -0.4 0.8]; ...
          'camera_from_moon_matrix', M; 'moon_from_camera_matrix', M'; 'camera_from_moon_mrp', [-1 2 -2] / 9};
  for i = 1:size(ways, 1)
    pose = selenograph_pose([1800000 0 0], ways{i, :});
    frame = selenograph_frame(url, struct('camera', struct('width', 4, 'height', 4, 'fov_deg', 50), 'pose', pose, ...
                                          'products', {{'source'}}));
    said.attitudes.(ways{i, 1}) = frame.meta.request.pose.camera_from_moon;
  end
  picture = selenograph_call(url, 'POST', '/v1/frames', ...
                             struct('camera', camera, 'pose', above, 'sun', sun, 'products', {{'image'}}), 'image/png');
  said.picture = struct('type', picture.headers.content_type, 'bytes', numel(picture.body));
  bounds = struct('south_deg', -7, 'north_deg', -6, 'west_deg', 39.5, 'east_deg', 40.5);
  try
    map = selenograph_map(url, struct('map', struct('projection', 'equirectangular', 'bounds', bounds, 'gsd_m', 500), ...
                                      'sun', sun, 'products', {{'radiance', 'height'}}));
    said.map = struct('shape', size(map.height), 'height', map.height(4, 6), 'hash', map.meta.content_hash);
  catch
    said.map = struct('status', selenograph_problem().status);
  end
  by_path = calls_by_path(url, jsondecode(fileread(requests), 'makeValidName', false));
  texts = cellfun(@(path) sprintf('"%s": %s', path, jsonencode(by_path(path))), keys(by_path), 'UniformOutput', false);
  printf('%s, "by_path": {%s}}\n', jsonencode(said)(1:end - 1), strjoin(texts, ', '));
end

% Makes the calls whose requests are in the test's file. Paths are no names of fields, but in the file they are.
function answers = calls_by_path(url, requests)
  answers = containers.Map();
  frame = selenograph_call(url, 'POST', '/v1/frames', requests.('/v1/frames'), 'application/x-npy');
  answers('/v1/frames') = get(url, jsondecode(frame.headers.selenograph_meta).metadata_at);
  answers('/v1/lidar') = lists(selenograph_lidar(url, requests.('/v1/lidar')), ...
                               {'range_m', 'direction', 'count', 'false_alarm', 'rock'});
  answers('/v1/limb') = lists(selenograph_limb(url, requests.('/v1/limb')), {'x_px', 'position_m', 'terminator_visible'});
  answers('/v1/horizons') = lists(selenograph_horizons(url, requests.('/v1/horizons')), {'elevation_deg', 'azimuth_deg'});
  answers('/v1/illumination') = lists(selenograph_illumination(url, requests.('/v1/illumination')), {'sun_mean', 'sun'});
  answers('/v1/sky') = struct('objects', {selenograph_sky(url, requests.('/v1/sky'))});
  answers('/v1/features') = struct('craters', {selenograph_features(url, requests.('/v1/features'))});
  for path = {'/v1/verify/roundtrip', '/v1/verify/mertis'}
    answer = selenograph_call(url, 'POST', path{1}, requests.(path{1}));
    answers(path{1}) = jsondecode(char(answer.body));
  end
  for path = {'/v1/height?lat_deg=-6.5&lon_deg=40', '/openapi.json'}
    answers(path{1}) = get(url, path{1});
  end
end

function document = get(url, path)
  answer = selenograph_call(url, 'GET', path, []);
  document = jsondecode(char(answer.body));
end

% These arrays of an answer as rows in C order; whole numbers of 64 bits as text.
function listed = lists(answer, names)
  for i = 1:numel(names)
    values = answer.(names{i});
    values = reshape(permute(values, ndims(values):-1:1), 1, []);
    if isa(values, 'uint64')
      values = arrayfun(@(value) sprintf('%lu', value), values, 'UniformOutput', false);
    elseif islogical(values)
      values = double(values);
    end
    listed.(names{i}) = values;
  end
end

% A struct of columns as a cell of structs.
function list = as_rows(columns)
  names = fieldnames(columns);
  list = cell(1, size(columns.(names{1}), 1));
  for i = 1:numel(list)
    for j = 1:numel(names)
      values = columns.(names{j})(i, :);
      if iscell(values), values = values{1}; end
      list{i}.(names{j}) = values;
    end
  end
end
