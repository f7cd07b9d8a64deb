function chart = stateflow_chart(path)
chart = class(struct('path', path), 'stateflow_chart');
end
