function members = read_npz(bytes)
% The arrays and the JSON documents of an npz as the service sends it: a zip (PKWARE's APPNOTE, 4.3) of members that are
% stored as they are. A struct; '/' in a name becomes '_'.
  bytes = bytes(:)';
  last = strfind(char(bytes), ['PK' char([5 6])]);
  if isempty(last) || numel(bytes) - last(end) + 1 < 22, bad('no npz'), end
  entries = number(bytes, last(end) + 10, 2);
  at = number(bytes, last(end) + 16, 4) + 1;
  members = struct();
  for i = 1:entries
    if ~strcmp(char(slice(bytes, at, 4)), ['PK' char([1 2])]), bad('no entry of a zip''s directory'), end
    name_size = number(bytes, at + 28, 2);
    name = char(slice(bytes, at + 46, name_size));
    stored = number(bytes, at + 20, 4);
    if number(bytes, at + 10, 2) ~= 0 || stored ~= number(bytes, at + 24, 4), bad([name ' is compressed']), end
    if stored == 2^32 - 1, bad([name ' is larger than 4 GiB']), end
    local = number(bytes, at + 42, 4) + 1;
    data = slice(bytes, local + 30 + number(bytes, local + 26, 2) + number(bytes, local + 28, 2), stored);
    parts = regexp(name, '^(.+)\.(npy|json)$', 'tokens', 'once');
    if ~isempty(parts)
      field = strrep(parts{1}, '/', '_');
      if strcmp(parts{2}, 'npy')
        members.(field) = read_npy(data);
      else
        members.(field) = read_json(struct('body', data));
      end
    end
    at = at + 46 + name_size + number(bytes, at + 30, 2) + number(bytes, at + 32, 2);
  end
end

% NumPy Enhancement Proposal 1 (Robert Kern, 2007), in C order: the last index varies fastest there, the first here.
function array = read_npy(bytes)
  if ~strcmp(char(slice(bytes, 2, 5)), 'NUMPY'), bad('an array that isn''t npy'), end
  length_size = 2 + 2 * (bytes(7) > 1);
  header_size = number(bytes, 9, length_size);
  header = char(slice(bytes, 9 + length_size, header_size));
  form = '''descr'': ''(..\d+)'', ''fortran_order'': False, ''shape'': \(([\d, ]*)\)';
  found = regexp(header, form, 'tokens', 'once');
  if isempty(found), bad('an npy header of another form'), end
  names = struct('b1', 'uint8', 'u1', 'uint8', 'u2', 'uint16', 'u4', 'uint32', 'u8', 'uint64', 'i4', 'int32', ...
                 'f2', 'uint16', 'f4', 'single', 'f8', 'double');
  descr = found{1};
  if ~isfield(names, descr(2:end)) || descr(1) == '>', bad(['elements of the type ' descr]), end
  shape = sscanf(strrep(found{2}, ',', ' '), '%d')';
  data = bytes(9 + length_size + header_size:end);
  if numel(data) ~= prod(shape) * str2double(descr(3:end)), bad('an array''s size isn''t that of its shape'), end
  array = typecast(data, names.(descr(2:end)));
  if strcmp(descr, '<f2'), array = halves(array); end
  if strcmp(descr, '|b1'), array = logical(array); end
  array = reshape(array, [fliplr(shape) 1]);
  if numel(shape) > 1, array = permute(array, numel(shape):-1:1); end
end

% IEEE 754's binary16 as single, which holds all its values.
function values = halves(bits)
  exponent = single(bitand(bitshift(bits, -10), 31));
  fraction = single(bitand(bits, 1023));
  values = (fraction + 1024 * (exponent > 0)) .* 2 .^ (max(exponent, 1) - 25);
  values(exponent == 31 & fraction == 0) = Inf;
  values(exponent == 31 & fraction > 0) = NaN;
  values(bits > 32767) = -values(bits > 32767);
end

function value = number(bytes, at, size)
  value = sum(double(slice(bytes, at, size)) .* 256 .^ (0:size - 1));
end

function part = slice(bytes, at, size)
  if at < 1 || at + size - 1 > numel(bytes), bad('it is cut off'), end
  part = bytes(at:at + size - 1);
end

function bad(what)
  error('selenograph:bad_answer', 'the answer can''t be read: %s', what);
end
