function problem = selenograph_problem(last)
% SELENOGRAPH_PROBLEM  The document (RFC 9457) of the last refusal: status, title, detail, errors (pointer, detail).
  persistent kept
  if nargin > 0, kept = last; end
  problem = kept;
end
