function tank()
% The water tank of ../python/tank.py: octave-cli --eval tank, in this folder.
  hello.name = 'tank';
  hello.version = '1.0';
  hello.control_dt = 0.1;
  hello.steps = 300;
  hello.axes = {
    struct('name', 'level', 'unit', 'm', 'low', 0.1, 'high', 0.9, 'nominal', 0.5, 'kind', 'start')
    struct('name', 'demand', 'unit', 'm²/s', 'low', 0.02, 'high', 0.1, 'nominal', 0.06, 'kind', 'model')
    struct('name', 'lag', 'unit', 's', 'low', 0.5, 'high', 2.0, 'nominal', 1.0, 'kind', 'model')
  };
  hello.signals = {struct('name', 'level', 'unit', 'm'), struct('name', 'valve', 'unit', '')};
  hello.formulas = {
    struct('name', 'no_overflow', 'text', 'always(level <= 1)')
    struct('name', 'success', 'text', 'always[20s:30s](level >= 0.5 and level <= 0.9)')
  };
  hello.files = {'tank.m'};
  mishandle_serve(hello, @(scenario, seed) simulate(scenario, hello.control_dt, hello.steps));
end

function answer = simulate(scenario, dt, steps)
  level = zeros(1, steps + 1);
  valve = zeros(1, steps + 1);
  level(1) = scenario.level;
  integral = 0;
  for k = 1:steps
    error_now = 0.7 - level(k);
    integral = integral + 0.4 * error_now * dt;  % without anti-windup: the mistake
    command = min(1, max(0, error_now + integral));
    valve(k + 1) = valve(k) + dt / scenario.lag * (command - valve(k));
    inflow = 0.12 * valve(k + 1);
    level(k + 1) = max(0, level(k) + dt * (inflow - scenario.demand * sqrt(level(k))));
  end
  answer.trace = struct('level', level, 'valve', valve);
end
