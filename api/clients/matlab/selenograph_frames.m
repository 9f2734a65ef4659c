function frames = selenograph_frames(service, requests, take, ahead)
% SELENOGRAPH_FRAMES  A sequence of frames, in order.
%   selenograph_frames(service, requests, @(index, frame) ...)   calls the function for each frame
%   frames = selenograph_frames(service, requests)               a cell of all frames
%   requests: a cell of structs. Each is sent with the poses of the `ahead` (4) that follow it, so that the service
%   loads terrain in idle time; one with an "ahead" of its own keeps that, and one is sent again without these poses
%   where the service refuses only them. One frame is under way at a time.
  if nargin < 3, take = []; end
  if nargin < 4, ahead = 4; end
  frames = cell(1, 0);
  for i = 1:numel(requests)
    request = requests{i};
    poses = cell(1, 0);
    for j = i + 1:min(i + ahead, numel(requests))
      if isfield(requests{j}, 'pose'), poses{end + 1} = requests{j}.pose; end %#ok<AGROW>
    end
    if ~isfield(request, 'pose') || isfield(request, 'ahead'), poses = cell(1, 0); end
    frame = frame_with_ahead(service, request, poses);
    if isempty(take)
      frames{i} = frame;
    else
      take(i, frame);
    end
  end
end

% A fault of the poses ahead is that of the requests they come from, not of this one: without them it is asked again.
function frame = frame_with_ahead(service, request, poses)
  if ~isempty(poses)
    try
      frame = selenograph_frame(service, setfield(request, 'ahead', poses));
      return
    catch e
      if ~strcmp(e.identifier, 'selenograph:refused') || ~only_of_ahead(selenograph_problem()), rethrow(e), end
    end
  end
  frame = selenograph_frame(service, request);
end

function only = only_of_ahead(problem)
  only = isfield(problem, 'errors') && ~isempty(problem.errors);
  if ~only, return, end
  for e = as_cells(problem.errors)
    only = only && isfield(e{1}, 'pointer') && ~isempty(regexp(e{1}.pointer, '^/ahead(/|$)', 'once'));
  end
end
