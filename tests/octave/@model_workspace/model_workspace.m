function space = model_workspace()
space = class(struct('nothing', 0), 'model_workspace');
end
