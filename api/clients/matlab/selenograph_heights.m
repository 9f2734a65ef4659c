function heights = selenograph_heights(service, lat_deg, lon_deg)
% SELENOGRAPH_HEIGHTS  The terrain's height at places: POST /v1/heights.
%   heights.height_m (above the sphere of 1 737 400 m), post_spacing_m: N x 1, NaN without data; filled: N x 1 logical,
%   interpolated across no-data; blended: N x 1 logical, a mean of two layers; source: N x 1 cell, the tile that it came from ('' without data).
  list = post_in_pieces(service, '/v1/heights', 'points', struct(), places(lat_deg, lon_deg, NaN(size(lat_deg))));
  heights = struct('height_m', column(list, 'height_m', NaN), 'post_spacing_m', column(list, 'post_spacing_m', NaN), ...
                   'filled', column(list, 'filled', false), ...
                   'blended', column(list, 'blended', false));
  heights.source = repmat({''}, numel(list), 1);
  for i = 1:numel(list)
    if isfield(list{i}, 'source'), heights.source{i} = list{i}.source; end
  end
end
