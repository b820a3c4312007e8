function text = mishandle_json(value, key)
% Writes a value as JSON, for the protocol of simulators. Other than jsonencode, it keeps all digits of a number, and
% writes lists of one element as lists where the protocol has lists.
  if nargin < 2
    key = '';
  end
  lists = {'axes', 'signals', 'formulas', 'observation', 'action', 'files', 'values', 'trace', 'spaces'};
  is_list = any(strcmp(key, lists));
  if ischar(value)
    text = jsonencode(value);
  elseif iscell(value)
    parts = cellfun(@(each) mishandle_json(each), value(:)', 'UniformOutput', false);
    text = ['[', strjoin(parts, ','), ']'];
  elseif isstruct(value) && (numel(value) ~= 1 || (is_list && ~any(strcmp(key, {'trace', 'spaces'}))))
    text = mishandle_json(num2cell(value));
  elseif isstruct(value)
    names = fieldnames(value);
    % The fields of a trace are signals, those of `spaces` are lists of axes.
    inner = names;
    if any(strcmp(key, {'trace', 'spaces'}))
      inner(:) = {'signals'};
    end
    parts = cell(1, numel(names));
    for i = 1:numel(names)
      parts{i} = [jsonencode(names{i}), ':', mishandle_json(value.(names{i}), inner{i})];
    end
    text = ['{', strjoin(parts, ','), '}'];
  elseif islogical(value) && isscalar(value)
    words = {'false', 'true'};
    text = words{1 + value};
  elseif isnumeric(value) || islogical(value)
    text = numbers(double(value(:)'), is_list || numel(value) ~= 1);
  else
    error('a value of the class %s has no form in the protocol', class(value));
  end
end

function text = numbers(values, is_list)
  text = sprintf('%.17g,', values);
  if ~all(isfinite(values))
    text = regexprep(text, '-?(NaN|Inf)', 'null');
  end
  text = text(1:end-1);
  if is_list
    text = ['[', text, ']'];
  end
end
