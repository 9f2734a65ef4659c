function scan = selenograph_lidar(service, request)
% SELENOGRAPH_LIDAR  A lidar's scan: POST /v1/lidar. Arrays with one row per pulse.
%   scan = selenograph_lidar(service, request)
%   scan.range_m, intensity, count, ...: measurements; scan.true_range_m, ...: ground truth; scan.false_alarm is
%   logical; scan.rock (uint64) and scan.object say what was hit; scan.meta has the resolved request.
  scan = read_arrays(service, '/v1/lidar', request);
end
