function cells = as_cells(list)
% A JSON list as jsondecode gives it, a struct array or a cell array, as a row of cells.
  if isstruct(list), list = num2cell(list); end
  if ~iscell(list), list = {}; end
  cells = list(:)';
end
