function lidar_line(url, token)
% A lidar's ranges along a ground track at a height of 15 km.
  if nargin < 2, token = ''; end
  service = selenograph_service(url, token);
  lat = (-7 + 0.02 * (0:49)') * pi / 180;
  lon = 40 * pi / 180;
  up = [cos(lat) * cos(lon), cos(lat) * sin(lon), sin(lat)];
  hits = selenograph_rays(service, (1737400 + 15000) * up, -up);
  for i = 1:numel(hits.hit)
    if hits.hit(i)
      fprintf('shot %d: range %.17g m\n', i - 1, hits.range_m(i));
    else
      fprintf('shot %d: no echo\n', i - 1);
    end
  end
end
