function loaded = bdIsLoaded(name)
store = simulink_store('get');
loaded = store.open && strcmp(store.model, name);
end
