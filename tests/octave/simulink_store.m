function out = simulink_store(what, value)
% What the stand-ins for the calls of Simulink remember.
persistent store
if isempty(store) || strcmp(what, 'reset')
    store = struct('model', '', 'open', false, 'saved', '', 'numbers', struct());
    store.blocks = struct();
    store.lines = {};
    store.taken = struct();
    store.calls = 0;
    store.settings = struct();
end
if strcmp(what, 'set')
    store = value;
end
out = store;
end
