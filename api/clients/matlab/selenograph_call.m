function answer = selenograph_call(service, method, path, request, accept)
% SELENOGRAPH_CALL  Any call of the service, with members that the other functions don't have.
%   answer = selenograph_call(service, 'POST', '/v1/frames', request, 'image/png')
%   request: a struct for jsonencode ([] for none; a list of one element must be a cell). accept: the answer's form
%   ('application/json'). answer: status, body (uint8 row), headers (names in lower case, '-' as '_').
%
%   A refusal is the error selenograph:refused, whose message has status, title, detail and a line for each offending
%   member; selenograph_problem() then returns the service's document. 429 and 503 with Retry-After (in seconds) are
%   repeated after that time, a connection that breaks up to twice (no call changes anything in the service), all
%   within the timeout. What doesn't come then is selenograph:no_answer, and what can't be read selenograph:bad_answer.
%   A service of another major version is selenograph:version.
  if nargin < 5, accept = 'application/json'; end
  service = selenograph_service(service);
  body = '';
  if ~isempty(request), body = jsonencode(request); end
  start = tic;
  broken = 0;
  while true
    left_s = service.timeout_s - toc(start);
    if left_s <= 0, error('selenograph:no_answer', '%s%s: nothing within the timeout', service.url, path); end
    [answer, fault] = send(service, method, path, unicode2native(body, 'UTF-8'), accept, left_s);
    if ~isempty(fault)
      broken = broken + 1;
      if broken >= 3, error('selenograph:no_answer', '%s%s: %s', service.url, path, fault); end
    else
      check_version(service, answer);
      if answer.status >= 200 && answer.status < 300, return, end
      wait_s = NaN;
      if any(answer.status == [429 503]) && isfield(answer.headers, 'retry_after')
        wait_s = str2double(answer.headers.retry_after);
      end
      if ~(wait_s >= 0 && wait_s < service.timeout_s - toc(start)), refuse(answer); end
      pause(wait_s);
    end
  end
end

% Services say "Server: selenograph/1.2.3"; a proxy may hide it, and then nothing is checked.
function check_version(service, answer)
  MAJOR_VERSION = 1;  % of the services that this client works with: api/versions.md
  if ~isfield(answer.headers, 'server'), return, end
  major = regexp(answer.headers.server, '^selenograph/(\d+)\.', 'tokens', 'once');
  if isempty(major) || str2double(major{1}) == MAJOR_VERSION, return, end
  error('selenograph:version', '%s is %s, but this client works with services of version %d', service.url, ...
        answer.headers.server, MAJOR_VERSION);
end

% One request over HTTP: an answer, whatever its status, or why there is none.
function [answer, fault] = send(service, method, path, body, accept, left_s)
  fields = {'Accept', accept; 'Request-Timeout-Ms', sprintf('%.0f', ceil(1000 * left_s))};
  if ~isempty(body), fields(end + 1, :) = {'Content-Type', 'application/json'}; end
  if ~isempty(service.token), fields(end + 1, :) = {'Authorization', ['Bearer ' service.token]}; end
  if exist('OCTAVE_VERSION', 'builtin')
    [answer, fault] = send_octave(method, [service.url path], fields, body, left_s);
  else
    [answer, fault] = send_matlab(method, [service.url path], fields, body, left_s);
  end
end

function refuse(answer)
  message = sprintf('%d without a problem document', answer.status);
  problem = struct('status', answer.status);
  try
    problem = jsondecode(native2unicode(answer.body, 'UTF-8'));
    message = sprintf('%d %s: %s', answer.status, problem.title, problem.detail);
    if isfield(problem, 'errors')
      for e = as_cells(problem.errors), message = sprintf('%s\n  %s: %s', message, e{1}.pointer, e{1}.detail); end
    end
  catch
    % The message says that there was none.
  end
  selenograph_problem(problem);
  error('selenograph:refused', '%s', message);
end
