function descent(url, token)
% A descent of 20 frames towards a landing site; each request says where the next ones will be.
  if nargin < 2, token = ''; end
  service = selenograph_service(url, token);
  site = struct('lat_deg', -6.5, 'lon_deg', 40);
  requests = cell(1, 20);
  for i = 1:20
    left = 1 - (i - 1) / 20;  % of the way: half a degree north, from 30 km to 2 km
    place = struct('lat_deg', site.lat_deg - 0.5 * left, 'lon_deg', site.lon_deg, 'height_m', 2000 + 28000 * left);
    requests{i} = struct('camera', struct('width', 160, 'height', 120, 'fov_deg', 60), ...
                         'pose', selenograph_pose(place, 'look_at', site), ...
                         'sun', struct('subsolar', struct('lat_deg', 0, 'lon_deg', 100)), ...
                         'products', {{'radiance', 'range'}});
  end
  selenograph_frames(service, requests, @(i, frame) fprintf('frame %d: nearest ground %.17g m, etag %s\n', i - 1, ...
                                                            min(frame.range(:)), frame.etag));
end
