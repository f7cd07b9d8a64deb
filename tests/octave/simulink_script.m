function simulink_script(path, text)
% Keep the text of a MATLAB Function block.
store = simulink_store('get');
block = store.blocks.(path);
block.script = text;
store.blocks.(path) = block;
simulink_store('set', store);
end
