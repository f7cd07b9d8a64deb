function close_system(name, saving)
store = simulink_store('get');
if ~store.open || ~strcmp(store.model, name) || saving ~= 0
    error('stand_in:system', 'there is no system %s to be closed without saving', name);
end
simulink_store('reset');
end
