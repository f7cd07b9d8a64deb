function chart = simulink_chart(path)
% The chart of a MATLAB Function block; nothing where there is none.
store = simulink_store('get');
if ~simulink_has(store.blocks, path) || ~strcmp(store.blocks.(path).type, 'MatlabFunction')
    chart = [];
else
    chart = stateflow_chart(path);
end
end
