function frames = selenograph_frames(service, requests, take, ahead)
% SELENOGRAPH_FRAMES  A sequence of frames, in order.
%   selenograph_frames(service, requests, @(index, frame) ...)   calls the function for each frame
%   frames = selenograph_frames(service, requests)               a cell of all frames
%   requests: a cell of structs. Each is sent with the poses of the `ahead` (4) that follow it, so that the service
%   loads terrain in idle time; one with an "ahead" of its own keeps that. One frame is under way at a time.
  if nargin < 3, take = []; end
  if nargin < 4, ahead = 4; end
  frames = cell(1, 0);
  for i = 1:numel(requests)
    request = requests{i};
    poses = cell(1, 0);
    for j = i + 1:min(i + ahead, numel(requests))
      if isfield(requests{j}, 'pose'), poses{end + 1} = requests{j}.pose; end %#ok<AGROW>
    end
    if isfield(request, 'pose') && ~isfield(request, 'ahead') && ~isempty(poses), request.ahead = poses; end
    frame = selenograph_frame(service, request);
    if isempty(take)
      frames{i} = frame;
    else
      take(i, frame);
    end
  end
end
