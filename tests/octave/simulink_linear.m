function [A, B, C, D] = simulink_linear(model, plan)
% Matrices of a model whose blocks are linear but for its functions: from all sources to what is
% kept, and then to what is sampled.
n = plan.size;
m = numel(plan.sources);
[rate, signals] = simulink_evaluate(model, plan, [eye(n), zeros(n, m)], [zeros(m, n), eye(m)], 0);
A = rate(:, 1:n);
B = rate(:, n + 1:end);
out = zeros(0, n + m);
for k = [plan.kept, plan.sampled]
    row = signals{k};
    if strcmp(model.blocks{k}.type, 'Demux')
        row = row(1, :);
    end
    out = [out; row];
end
C = out(:, 1:n);
D = out(:, n + 1:end);
end
