function values = column(list, name, missing)
% The member `name` of each struct in a row of cells, one row of `values` each; `missing` where it is left out or null.
  values = repmat(missing, numel(list), 1);
  for i = 1:numel(list)
    if isfield(list{i}, name) && ~isempty(list{i}.(name)), values(i, :) = list{i}.(name)(:)'; end
  end
end
