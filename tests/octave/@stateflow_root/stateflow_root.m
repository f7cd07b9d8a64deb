function root = stateflow_root()
root = class(struct('nothing', 0), 'stateflow_root');
end
