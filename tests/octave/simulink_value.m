function value__ = simulink_value(expression__, numbers__)
% What an expression of a parameter is in the workspace of the model.
names__ = fieldnames(numbers__);
used__ = regexp(expression__, '[A-Za-z]\w*', 'match');
for k__ = 1:numel(used__)
    if isfield(numbers__, used__{k__})
        eval([used__{k__} ' = numbers__.(used__{k__});']);
    end
end
value__ = eval(expression__);
end
