function service = selenograph_service(url, token, timeout_s)
% SELENOGRAPH_SERVICE  Where the service is; the first argument of all other functions.
%   service = selenograph_service('http://127.0.0.1:8080')
%   service = selenograph_service(url, token, timeout_s)
%   token is sent as a bearer token ('': none). timeout_s (60) is for one call with all its repetitions. Instead of the
%   struct, the other functions also take the URL alone.
  if nargin < 2, token = ''; end
  if nargin < 3, timeout_s = 60; end
  if isstruct(url)
    service = url;
    return
  end
  if ~ischar(url) || isempty(regexp(url, '^https?://[^"\\\s]+$', 'once'))
    error('selenograph:argument', 'url must be like http://127.0.0.1:8080');
  end
  if ~isempty(regexp(token, '[^!#-\[\]-~]', 'once'))
    error('selenograph:argument', 'the token has a character that no token has');
  end
  service = struct('url', regexprep(url, '/+$', ''), 'token', token, 'timeout_s', timeout_s);
end
