function hits = selenograph_rays(service, origins_m, directions, sun)
% SELENOGRAPH_RAYS  Where rays meet the terrain, an altimeter or lidar: POST /v1/rays. Any number, sent in pieces.
%   hits = selenograph_rays(service, origins_m, directions)
%   hits = selenograph_rays(service, origins_m, directions, sun)
%   origins_m, directions: N x 3, MOON_ME; directions of any length but zero. hits.hit: N x 1 logical; hits.range_m,
%   hits.lit: N x 1; hits.position_m, hits.normal: N x 3, MOON_ME. NaN without a hit, and lit without a Sun.
  if size(origins_m, 2) ~= 3 || ~isequal(size(origins_m), size(directions))
    error('selenograph:argument', 'origins_m and directions must both be N x 3');
  end
  request = struct();
  if nargin > 3 && ~isempty(sun), request.sun = sun; end
  rays = cell(1, size(origins_m, 1));
  for i = 1:numel(rays), rays{i} = struct('origin_m', origins_m(i, :), 'direction', directions(i, :)); end
  list = post_in_pieces(service, '/v1/rays', 'rays', request, rays);
  hits = struct('hit', column(list, 'hit', false), 'range_m', column(list, 'range_m', NaN), ...
                'position_m', column(list, 'position_m', NaN(1, 3)), 'normal', column(list, 'normal', NaN(1, 3)), ...
                'lit', column(list, 'lit', NaN));
end
