function model = simulink_compile()
% The model as a flat list of blocks, each with the blocks that feed it, as it is before a run.
store = simulink_store('get');
paths = fieldnames(store.blocks);
feeds = struct();
for k = 1:numel(store.lines)
    line = store.lines{k};
    feeds.(sprintf('%s>%d', line.target, line.input)) = line;
end
flat = {};
for k = 1:numel(paths)
    block = store.blocks.(paths{k});
    for port = 1:simulink_count(block)
        if ~simulink_has(feeds, sprintf('%s>%d', block.path, port))
            error('stand_in:open', 'input %d of %s is not connected', port, block.path);
        end
    end
    if ~any(strcmp(block.type, {'Model', 'SubSystem', 'Inport', 'Outport'}))
        flat{end + 1} = block;
    end
end
orders = cellfun(@(b) b.order, flat);
[~, by] = sort(orders);
flat = flat(by);
number = struct();
for k = 1:numel(flat)
    number.(flat{k}.path) = k;
end
expressions = {'Gain', 'Value', 'Amplitude', 'Frequency', 'Phase', 'VariableName', 'InitialCondition', ...
    'UpperSaturationLimit', 'LowerSaturationLimit', 'Numerator', 'Denominator', 'A', 'B', 'C', 'D', ...
    'SampleTime', 'UpperLimit', 'LowerLimit', 'QuantizationInterval'};
for k = 1:numel(flat)
    block = flat{k};
    block.values = struct();
    given = fieldnames(block.parameters);
    for j = 1:numel(given)
        if any(strcmp(expressions, given{j})) && ~(strcmp(block.type, 'ToWorkspace'))
            block.values.(given{j}) = simulink_value(block.parameters.(given{j}), store.numbers);
        end
    end
    count = simulink_ports(block, 'inputs');
    block.sources = zeros(1, count);
    block.outputs = ones(1, count);
    for port = 1:count
        [path, output] = simulink_source(store, feeds, block.path, port);
        block.sources(port) = number.(path);
        block.outputs(port) = output;
    end
    flat{k} = block;
end
model = struct('name', store.model, 'saved', store.saved, 'settings', store.settings, 'numbers', store.numbers);
model.blocks = flat;
model.systems = sum(cellfun(@(p) strcmp(store.blocks.(p).type, 'SubSystem'), paths));
model.lines = numel(store.lines);
end

function count = simulink_count(block)
if strcmp(block.type, 'Model')
    count = 0;
else
    count = simulink_ports(block, 'inputs');
end
end

function [path, output] = simulink_source(store, feeds, path, port)
% Follow a line back through the ports of systems to the block that it comes from.
line = feeds.(sprintf('%s>%d', path, port));
while true
    block = store.blocks.(line.source);
    if strcmp(block.type, 'SubSystem')
        line = feeds.(sprintf('%s>1', block.outports{line.output}));
    elseif strcmp(block.type, 'Inport')
        parent = block.path(1:find(block.path == '/', 1, 'last') - 1);
        line = feeds.(sprintf('%s>%s', parent, block.parameters.Port));
    else
        path = block.path;
        output = line.output;
        return
    end
end
end
