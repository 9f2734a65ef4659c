function one_frame(url, token)
% One frame with ground truth.   one_frame('http://127.0.0.1:8080')
  if nargin < 2, token = ''; end
  service = selenograph_service(url, token);
  place = struct('lat_deg', -6.5, 'lon_deg', 40, 'height_m', 30000);
  frame = selenograph_frame(service, struct( ...
      'camera', struct('width', 320, 'height', 240, 'fov_deg', 50), ...
      'pose', selenograph_pose(place, 'nadir', 0), ...
      'sun', struct('subsolar', struct('lat_deg', 0, 'lon_deg', 100)), ...
      'products', {{'radiance', 'range', 'geodetic', 'lit'}}));
  for name = {'radiance', 'range', 'geodetic', 'lit'}
    array = frame.(name{1});
    fprintf('%s: %d x %d x %d %s\n', name{1}, size(array, 1), size(array, 2), size(array, 3), class(array));
  end
  row = 121;  % counted from 1
  column = 161;
  fprintf('radiance %.17g W m-2 sr-1\n', frame.radiance(row, column));
  fprintf('range %.17g m\n', frame.range(row, column));
  fprintf('latitude %.17g deg\n', frame.geodetic(row, column, 1));
  fprintf('level of detail error %.17g m\n', frame.meta.lod_error_m);
  fprintf('etag %s\n', frame.etag);
end
