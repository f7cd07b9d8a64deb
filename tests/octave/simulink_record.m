function simulink_record(file)
% Write down what was built, for another program to read.
store = simulink_store('get');
paths = fieldnames(store.blocks);
all_blocks = {};
for k = 1:numel(paths)
    block = store.blocks.(paths{k});
    if ~strcmp(block.type, 'Model')
        all_blocks{end + 1} = struct('path', block.path, 'type', block.type, 'parameters', block.parameters, 'script', block.script);
    end
end
lines = store.lines;
model = simulink_compile();
blocks = model.blocks;
settings = model.settings;
settings.saved = model.saved;
save('-v7', file, 'all_blocks', 'lines', 'blocks', 'settings');
end
