function new_system(name)
store = simulink_store('get');
if store.open
    error('stand_in:open', 'a system named %s is open', store.model);
end
if ~isvarname(name) || numel(name) > 63
    error('stand_in:name', '%s is no name of a model', name);
end
simulink_store('reset');
store = simulink_store('get');
store.model = name;
store.open = true;
top = struct('path', name, 'type', 'Model', 'parameters', struct(), 'script', '', 'order', 0);
top.inports = {};
top.outports = {};
store.blocks.(name) = top;
simulink_store('set', store);
end
