function plan = simulink_plan(model)
% The order in which blocks are computed, where their states are, and what is known beforehand.
blocks = model.blocks;
n = numel(blocks);
plan = struct('states', {cell(1, n)}, 'size', 0, 'sources', [], 'sampled', [], 'kept', []);
plan.initial = zeros(0, 1);
plan.types = cellfun(@(b) b.type, blocks, 'UniformOutput', false);
% whose input is not needed for their output
plan.late = ismember(plan.types, {'Integrator', 'TransferFcn', 'MatlabFunction'});
plan.integrators = find(ismember(plan.types, {'Integrator', 'TransferFcn'}));
plan.demux = strcmp(plan.types, 'Demux');
plan.matrix = cellfun(@(b) strcmp(b.type, 'Gain') && strcmp(b.parameters.Multiplication, 'Matrix(K*u) (u vector)'), blocks);
plan.limited = cellfun(@(b) isfield(b.parameters, 'LimitOutput') && strcmp(b.parameters.LimitOutput, 'on'), blocks);
through = true(1, n);
for k = 1:n
    block = blocks{k};
    switch block.type
        case 'Integrator'
            start = block.values.InitialCondition(:);
            through(k) = false;
        case 'TransferFcn'
            start = 0;
            through(k) = false;
        case 'StateSpace'
            start = zeros(size(block.values.A, 1), 1);
        otherwise
            start = zeros(0, 1);
    end
    if any(strcmp(block.type, {'FromWorkspace', 'MatlabFunction', 'Constant', 'SineWave'}))
        through(k) = false;
    end
    if any(strcmp(block.type, {'FromWorkspace', 'MatlabFunction'}))
        plan.sources(end + 1) = k;
    elseif strcmp(block.type, 'ToWorkspace')
        plan.kept(end + 1) = k;
    end
    if strcmp(block.type, 'MatlabFunction')
        plan.sampled(end + 1) = block.sources(1);
    end
    plan.states{k} = plan.size + (1:numel(start));
    plan.size = plan.size + numel(start);
    plan.initial = [plan.initial; start];
end
% blocks that pass their input on come after those that feed them
plan.order = find(~through);
waiting = find(through);
done = ~through;
while ~isempty(waiting)
    ready = arrayfun(@(k) all(done(blocks{k}.sources)), waiting);
    if ~any(ready)
        error('stand_in:loop', 'blocks form an algebraic loop');
    end
    plan.order = [plan.order, waiting(ready)];
    done(waiting(ready)) = true;
    waiting = waiting(~ready);
end
end
