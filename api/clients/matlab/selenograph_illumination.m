function light = selenograph_illumination(service, request)
% SELENOGRAPH_ILLUMINATION  Light of Sun and Earth over a time span: POST /v1/illumination.
%   light = selenograph_illumination(service, request)
%   light.sun_mean, earth_mean, longest_night_h, ...: by pixel or place; of places also light.sun, light.earth, the
%   visible share of the disc by epoch and place.
  light = read_arrays(service, '/v1/illumination', request);
end
