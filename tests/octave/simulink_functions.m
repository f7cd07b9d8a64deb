function handles = simulink_functions(model, plan, folder)
% A function for each MATLAB Function block, each with a memory of its own.
handles = {};
for k = plan.sources
    block = model.blocks{k};
    if ~strcmp(block.type, 'MatlabFunction')
        continue
    end
    name = regexp(block.script, '^function y = (\w+)\(u\)', 'tokens', 'once'){1};
    own = sprintf('block_%d', k);
    file = fopen(fullfile(folder, [own '.m']), 'w');
    fputs(file, strrep(block.script, ['y = ' name '(u)'], ['y = ' own '(u)']));
    fclose(file);
    handles{end + 1} = own;
end
addpath(folder);
handles = cellfun(@str2func, handles, 'UniformOutput', false);
end
