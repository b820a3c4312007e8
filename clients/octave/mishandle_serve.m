function mishandle_serve(hello, varargin)
% Serves a simulator in Octave or MATLAB to Mishandle: docs/guide/simulator_clients.md.
%
%   mishandle_serve(hello, @simulate)       answer = simulate(scenario, seed), with the field `trace`
%   mishandle_serve(hello, @reset, @step)   answer = reset(scenario, seed), answer = step(action), with `signals`
%
% `hello` and the answers are structures with the fields of the protocol, without `id`. Signals are numeric
% vectors, `scenario` is a structure with a field for each axis, and `seed` is text, because 64 bits do not fit a
% double. What the functions print goes to standard error.
  if ~any(numel(varargin) == [1, 2])
    error('mishandle_serve needs a function, or reset and step');
  end
  is_step = numel(varargin) == 2;
  hello.protocol = 1;
  modes = {'trace', 'step'};
  hello.mode = modes{1 + is_step};
  is_octave = exist('OCTAVE_VERSION', 'builtin') ~= 0;
  answers = 1;
  if is_octave
    % Whatever prints from here on, also a child or a library, goes to standard error.
    answers = fopen('/proc/self/fd/1', 'w');
    dup2(stderr, stdout);
  end
  while true
    line = next_line(is_octave);
    if isempty(line)
      return
    end
    question = jsondecode(line);
    try
      switch [question.type, ' ', hello.mode]
        case {'hello trace', 'hello step'}
          answer = hello;
        case {'simulate trace', 'reset step'}
          answer = call(varargin{1}, question.scenario, question.seed);
        case 'step step'
          if ~isfield(question, 'action')
            question.action = [];  % a simulator without a policy
          end
          answer = call(varargin{2}, question.action);
        otherwise
          error('unknown type of question: %s', question.type);
      end
      text = mishandle_json(answer);
      % The fields of an object, without its first brace.
      text = sprintf('{"id":%d,%s', question.id, text(2:end));
    catch problem
      fprintf(2, '%s\n', problem.message);
      text = sprintf('{"id":%d,"error":%s}', question.id, mishandle_json(problem.message));
    end
    fprintf(answers, '%s\n', text);
    if is_octave
      fflush(stdout);
      fflush(answers);
    end
  end
end

function line = next_line(is_octave)
  if is_octave
    % fgetl would wait for the first character of the next line.
    line = fscanf(stdin, '%[^\n]', 1);
    fscanf(stdin, '%c', 1);
  else
    line = input('', 's');
  end
end

function answer = call(simulate, varargin)
  if exist('OCTAVE_VERSION', 'builtin')
    answer = simulate(varargin{:});
  else
    % A missing semicolon prints to standard output, where only answers may be.
    fprintf(2, '%s', evalc('answer = simulate(varargin{:});'));
  end
  if ~isstruct(answer) || numel(answer) ~= 1
    error('expected a structure with the field `trace` or `signals`, found a value of the class %s', class(answer));
  end
end
