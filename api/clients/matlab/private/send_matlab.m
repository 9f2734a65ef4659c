function [answer, fault] = send_matlab(method, url, fields, body, left_s)
% By matlab.net.http (MATLAB R2019b or later). The payload is taken as it came: no conversion by its media type.
  answer = [];
  fault = '';
  headers = matlab.net.http.HeaderField.empty;
  for i = 1:size(fields, 1), headers(end + 1) = matlab.net.http.HeaderField(fields{i, 1}, fields{i, 2}); end %#ok<AGROW>
  request = matlab.net.http.RequestMessage(method, headers);
  if ~isempty(body)
    request.Body = matlab.net.http.MessageBody();
    request.Body.Payload = uint8(body);
  end
  options = matlab.net.http.HTTPOptions('ConnectTimeout', left_s, 'ResponseTimeout', left_s, ...
                                        'ConvertResponse', false, 'SavePayload', true);
  try
    response = request.send(matlab.net.URI(url), options);
  catch e
    fault = e.message;
    return
  end
  answer = struct('status', double(response.StatusCode), 'headers', struct(), 'body', uint8(response.Body.Payload(:)'));
  for h = response.Header
    answer.headers.(matlab.lang.makeValidName(strrep(lower(char(h.Name)), '-', '_'))) = char(h.Value);
  end
end
