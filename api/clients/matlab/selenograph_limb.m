function outline = selenograph_limb(service, request)
% SELENOGRAPH_LIMB  The Moon's limb and, with a Sun, its terminator: POST /v1/limb. Arrays with one row per azimuth.
%   outline = selenograph_limb(service, request)
%   outline.azimuth_deg, x_px, y_px, position_m, ...: the limb of the terrain and of a sphere; terminator_x_px, ...
  outline = read_arrays(service, '/v1/limb', request);
end
