function items = places(lat_deg, lon_deg, height_m)
% A row of cells, one struct each; a height of NaN is left out: on the terrain.
  if numel(lat_deg) ~= numel(lon_deg) || numel(lat_deg) ~= numel(height_m)
    error('selenograph:argument', 'latitudes, longitudes and heights must be as many');
  end
  items = cell(1, numel(lat_deg));
  for i = 1:numel(items)
    items{i} = struct('lat_deg', lat_deg(i), 'lon_deg', lon_deg(i));
    if ~isnan(height_m(i)), items{i}.height_m = height_m(i); end
  end
end
