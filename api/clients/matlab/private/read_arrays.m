function arrays = read_arrays(service, path, request)
  if deflated(request)
    error('selenograph:argument', '"compression": "deflate" can''t be read: leave it out');
  end
  answer = selenograph_call(service, 'POST', path, request, 'application/x-npz');
  arrays = read_npz(answer.body);
  arrays.timing_ms = struct();
  arrays.etag = '';
  if isfield(answer.headers, 'etag'), arrays.etag = answer.headers.etag; end
  if isfield(answer.headers, 'selenograph_echo'), arrays.echo = jsondecode(answer.headers.selenograph_echo); end
  if isfield(answer.headers, 'server_timing')
    for stage = regexp(answer.headers.server_timing, '(\w+);dur=([\d.]+)', 'tokens')
      arrays.timing_ms.(stage{1}{1}) = str2double(stage{1}{2});
    end
  end
end

function is = deflated(request)
  is = isfield(request, 'compression') && strcmp(request.compression, 'deflate');
  if isfield(request, 'cameras') && isstruct(request.cameras)
    for camera = struct2cell(request.cameras)', is = is || deflated(camera{1}); end
  end
end
