function frame = selenograph_frame(service, request)
% SELENOGRAPH_FRAME  One frame: POST /v1/frames.
%   frame = selenograph_frame(service, request)
%   frame.radiance, frame.range, ...: an array for each of the request's products, height x width or height x width x 3,
%   row 1 on top, in the product's own type (float16 as single). frame.meta: the resolved request, DEM tiles, error
%   bounds, ...; frame.timing_ms: stages of the service's work; frame.etag: the header ETag; frame.echo where the
%   request has one.
%
%   request = struct('camera', struct('width', 320, 'height', 240, 'fov_deg', 50), 'products', {{'range', 'lit'}}, ...
%                    'pose', selenograph_pose(place, 'nadir', 0), 'sun', struct('direction', [0 1 0.2]));
  frame = read_arrays(service, '/v1/frames', request);
end
