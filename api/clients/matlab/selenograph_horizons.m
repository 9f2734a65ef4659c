function horizons = selenograph_horizons(service, request)
% SELENOGRAPH_HORIZONS  Horizons of a map's pixels or of places: POST /v1/horizons.
%   horizons = selenograph_horizons(service, request)
%   horizons.elevation_deg: by azimuth and place, or by azimuth, row and column; horizons.azimuth_deg.
  horizons = read_arrays(service, '/v1/horizons', request);
end
