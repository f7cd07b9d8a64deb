function save_system(name, file)
store = simulink_store('get');
if ~store.open || ~strcmp(store.model, name)
    error('stand_in:system', 'there is no system %s', name);
end
store.saved = [file '.slx'];
simulink_store('set', store);
written = fopen(store.saved, 'w');
fclose(written);
end
