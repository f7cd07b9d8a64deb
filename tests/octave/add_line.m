function handle = add_line(parent, from, to, varargin)
store = simulink_store('get');
if numel(varargin) ~= 2 || ~strcmpi(varargin{1}, 'autorouting') || ~any(strcmp(varargin{2}, {'on', 'off', 'smart'}))
    error('stand_in:line', 'unknown options of a line');
end
[source, output] = simulink_end(store, parent, from, 'outputs');
[target, input] = simulink_end(store, parent, to, 'inputs');
at = sprintf('%s>%d', target, input);
if simulink_has(store.taken, at)
    error('stand_in:taken', 'the destination port %s has already a line connection', at);
end
store.taken.(at) = true;
handle = numel(store.lines) + 1;
store.lines{handle} = struct('source', source, 'output', output, 'target', target, 'input', input, 'name', '');
simulink_store('set', store);
end
