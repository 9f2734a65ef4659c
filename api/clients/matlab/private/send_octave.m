function [answer, fault] = send_octave(method, url, fields, body, left_s)
% By the program curl: Octave 7's webread and webwrite send forms only, and give neither status nor headers.
  answer = [];
  fault = '';
  % Others on the machine must not read the token, neither in a file nor in the list of processes.
  mask = umask(77);
  folder = tempname();
  made = mkdir(folder);
  unwind_protect
    if ~made, error('selenograph:argument', 'no temporary folder: %s', folder); end
    file = @(name) [folder '/' name];
    write_bytes(file('body'), body);
    settings = {sprintf('url = "%s"', url), sprintf('request = "%s"', method), 'silent', 'show-error', 'globoff', ...
                sprintf('max-time = %.3f', left_s), sprintf('dump-header = "%s"', file('headers')), ...
                sprintf('output = "%s"', file('answer')), 'write-out = "%{http_code}"', 'header = "Expect:"'};
    if ~isempty(body), settings{end + 1} = sprintf('data-binary = "@%s"', file('body')); end
    for i = 1:rows(fields), settings{end + 1} = sprintf('header = "%s: %s"', fields{i, :}); end
    write_bytes(file('settings'), uint8(strjoin(settings, "\n")));
    [code, said] = system(sprintf('curl --disable --config "%s" 2>&1', file('settings')));
    if code == 127, error('selenograph:argument', 'the program curl isn''t installed'); end
    if code ~= 0
      fault = strtrim(regexprep(said, '\d{3}$', ''));  % the status is written all the same
    else
      answer = struct('status', str2double(said(end - 2:end)), 'headers', read_headers(file('headers')), ...
                      'body', read_bytes(file('answer')));
    end
  unwind_protect_cleanup
    umask(mask);
    delete([folder '/*']);
    rmdir(folder);
  end_unwind_protect
end

function write_bytes(name, bytes)
  f = fopen(name, 'w');
  fwrite(f, bytes, 'uint8');
  fclose(f);
end

function bytes = read_bytes(name)
  bytes = zeros(1, 0, 'uint8');
  f = fopen(name, 'r');
  if f < 0, return, end  % an answer without a body has no file
  bytes = fread(f, [1 Inf], '*uint8');
  fclose(f);
end

function headers = read_headers(name)
  headers = struct();
  for line = strsplit(char(read_bytes(name)), "\r\n")
    colon = find(line{1} == ':', 1);
    if isempty(colon), continue, end
    headers.(strrep(lower(line{1}(1:colon - 1)), '-', '_')) = strtrim(line{1}(colon + 1:end));
  end
end
