function open_system(name)
store = simulink_store('get');
if ~store.open || ~strcmp(store.model, name)
    error('stand_in:system', 'there is no system %s', name);
end
end
