function document = read_json(answer)
  try
    document = jsondecode(native2unicode(answer.body, 'UTF-8'));
  catch e
    error('selenograph:bad_answer', 'the answer is no JSON: %s', e.message);
  end
end
