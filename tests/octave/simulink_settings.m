function block = simulink_settings(block, pairs)
% Set parameters of a block after checking their names and values.
types = simulink_types();
at = find(strcmp(types.types, block.type));
allowed = [types.parameters{at}, types.common];
if mod(numel(pairs), 2) ~= 0
    error('stand_in:pairs', 'parameters of %s come in pairs', block.path);
end
for k = 1:2:numel(pairs)
    name = pairs{k};
    value = pairs{k + 1};
    if ~any(strcmp(allowed, name))
        error('stand_in:parameter', '%s block does not have a parameter named ''%s''', block.type, name);
    end
    if strcmp(name, 'Position')
        if ~isnumeric(value) || numel(value) ~= 4 || value(3) <= value(1) || value(4) <= value(2) || any(abs(value) > 32767)
            error('stand_in:position', 'invalid position of %s', block.path);
        end
    elseif ~ischar(value) || (size(value, 1) > 1)
        error('stand_in:value', 'parameter %s of %s must be a text', name, block.path);
    elseif isfield(types.allowed, name) && ~any(strcmp(types.allowed.(name), value))
        error('stand_in:value', '%s is no value of parameter %s', value, name);
    end
    block.parameters.(name) = value;
end
end
