function value = get_param(what, name)
store = simulink_store('get');
if ~strcmp(what, store.model) || ~strcmpi(name, 'ModelWorkspace')
    error('stand_in:parameter', '%s has no parameter %s here', what, name);
end
value = model_workspace();
end
