function set_param(what, varargin)
store = simulink_store('get');
if isnumeric(what)
    if what < 1 || what > numel(store.lines) || ~strcmp(varargin{1}, 'Name') || ~ischar(varargin{2})
        error('stand_in:line', 'there is no such line, or it has no such parameter');
    end
    if ~strcmp(varargin{2}, strtrim(varargin{2}))
        error('stand_in:line', 'the name of a signal begins or ends with a space');
    end
    store.lines{what}.name = varargin{2};
elseif strcmp(what, store.model)
    allowed = {'Description', 'Solver', 'StopTime', 'RelTol', 'AbsTol', 'MaxStep'};
    for k = 1:2:numel(varargin)
        if ~any(strcmp(allowed, varargin{k})) || ~ischar(varargin{k + 1}) || size(varargin{k + 1}, 1) > 1
            error('stand_in:parameter', 'a model has no parameter %s of this kind', varargin{k});
        end
        store.settings.(varargin{k}) = varargin{k + 1};
    end
elseif simulink_has(store.blocks, what)
    store.blocks.(what) = simulink_settings(store.blocks.(what), varargin);
else
    error('stand_in:block', 'there is no block %s', what);
end
simulink_store('set', store);
end
