function [t, y, names] = simulink_run(model, stop, parts, folder)
% Run a model. With parts = 0 its blocks are linear but for its functions, and steps between
% samples are exact for commands that are straight between them; else each step is cut into as
% many parts, each of the fourth order of Runge and Kutta.
plan = simulink_plan(model);
h = model.numbers.sample_time;
t = (0:round(stop / h))' * h;
handles = simulink_functions(model, plan, folder);
is_function = arrayfun(@(k) strcmp(model.blocks{k}.type, 'MatlabFunction'), plan.sources);
m = numel(plan.sources);
commands = zeros(m, numel(t));
tables = cell(1, m);
for j = find(~is_function)
    tables{j} = model.blocks{plan.sources(j)}.values.VariableName;
    commands(j, :) = interp1(tables{j}(:, 1), tables{j}(:, 2), min(t, tables{j}(end, 1)))';
end
names = arrayfun(@(k) model.blocks{k}.parameters.VariableName, plan.kept, 'UniformOutput', false);
y = zeros(numel(t), numel(names));
x = plan.initial;
known = zeros(m, 1);
if parts == 0
    [A, B, C, D] = simulink_linear(model, plan);
    n = plan.size;
    block = expm([A, B, zeros(n, m); zeros(m, n + m), eye(m); zeros(m, n + 2 * m)] .* h);
    step = block(1:n, 1:n);
    held = block(1:n, n + (1:m));
    rising = block(1:n, n + m + (1:m)) / h;
end
for i = 1:numel(t)
    known(~is_function) = commands(~is_function, i);
    if parts == 0
        all_out = C * x + D * known;
        seen = all_out(numel(names) + 1:end);
    else
        [~, signals] = simulink_evaluate(model, plan, x, known, t(i));
        seen = cellfun(@(s) s(1), signals(plan.sampled));
    end
    values = zeros(numel(handles), 1);
    for j = 1:numel(handles)
        values(j) = handles{j}(seen(j));
    end
    known(is_function) = values;
    if parts == 0
        all_out = C * x + D * known;
        y(i, :) = all_out(1:numel(names));
    else
        [~, signals] = simulink_evaluate(model, plan, x, known, t(i));
        y(i, :) = cellfun(@(s) s(1), signals(plan.kept));
    end
    if i == numel(t)
        break
    end
    rise = zeros(m, 1);
    rise(~is_function) = commands(~is_function, i + 1) - commands(~is_function, i);
    if parts == 0
        x = step * x + held * known + rising * rise;
    else
        x = runge_kutta(model, plan, x, known, rise, t(i), h, parts);
    end
end
end

function x = runge_kutta(model, plan, x, known, rise, t, h, parts)
d = h / parts;
at = @(s) known + rise * (s / h);
for k = 1:parts
    s = (k - 1) * d;
    a = simulink_evaluate(model, plan, x, at(s), t + s);
    b = simulink_evaluate(model, plan, x + 0.5 * d * a, at(s + 0.5 * d), t + s + 0.5 * d);
    c = simulink_evaluate(model, plan, x + 0.5 * d * b, at(s + 0.5 * d), t + s + 0.5 * d);
    e = simulink_evaluate(model, plan, x + d * c, at(s + d), t + s + d);
    x = x + d / 6 * (a + 2 * b + 2 * c + e);
    for j = find(plan.limited)
        own = plan.states{j};
        limits = model.blocks{j}.values;
        x(own) = min(max(x(own), limits.LowerSaturationLimit), limits.UpperSaturationLimit);
    end
end
end
