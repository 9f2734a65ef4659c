function landmarks = selenograph_project(service, camera, pose, points, sun)
% SELENOGRAPH_PROJECT  Where places appear in the image, and whether they are seen: POST /v1/project.
%   landmarks = selenograph_project(service, camera, pose, points, sun)
%   points: N x 2 (lat_deg, lon_deg) or N x 3 with height_m above the sphere of 1 737 400 m; NaN: on the terrain.
%   landmarks.x_px, y_px (the top-left pixel's centre is (0, 0)), range_m, height_m, lit: N x 1, NaN where there is
%   none; in_frame, visible: N x 1 logical.
  request = struct('camera', camera, 'pose', pose);
  if nargin > 4 && ~isempty(sun), request.sun = sun; end
  if size(points, 2) == 2, points(:, 3) = NaN; end
  if size(points, 2) ~= 3, error('selenograph:argument', 'points must be N x 2 or N x 3'); end
  list = post_in_pieces(service, '/v1/project', 'points', request, places(points(:, 1), points(:, 2), points(:, 3)));
  landmarks = struct('x_px', column(list, 'x_px', NaN), 'y_px', column(list, 'y_px', NaN), ...
                     'range_m', column(list, 'range_m', NaN), 'height_m', column(list, 'height_m', NaN), ...
                     'in_frame', column(list, 'in_frame', false), 'visible', column(list, 'visible', false), ...
                     'lit', column(list, 'lit', NaN));
end
