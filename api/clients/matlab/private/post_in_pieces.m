function answers = post_in_pieces(service, path, member, request, items)
% Sends a row of cells as the list `member`, some at a time: within the service's limits. A row of cells, one per item.
  PIECE = 10000;
  answers = cell(1, 0);
  for first = 1:PIECE:numel(items)
    piece = items(first:min(first + PIECE - 1, end));
    request.(member) = piece;
    try
      answer = read_json(selenograph_call(service, 'POST', path, request));
    catch e
      if first == 1, rethrow(e), end
      error(e.identifier, '%s\n  /%s/0 is number %d of the list, counted from 1', e.message, member, first);
    end
    if ~isfield(answer, member) || numel(answer.(member)) ~= numel(piece)
      error('selenograph:bad_answer', 'no list of all %s', member);
    end
    answers = [answers, as_cells(answer.(member))]; %#ok<AGROW>
  end
end
