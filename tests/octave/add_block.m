function add_block(source, path, varargin)
types = simulink_types();
at = find(strcmp(types.paths, source));
if isempty(at)
    error('stand_in:library', 'there is no block %s', source);
end
store = simulink_store('get');
cut = find(path == '/', 1, 'last');
parent = path(1:cut - 1);
name = path(cut + 1:end);
if ~simulink_has(store.blocks, parent)
    error('stand_in:parent', 'there is no system %s', parent);
end
if simulink_has(store.blocks, path)
    error('stand_in:twice', 'a block named %s is there already', path);
end
if isempty(name) || numel(name) > 63 || any(name < ' ' | name > '~') || any(name == '/')
    error('stand_in:name', '''%s'' is no name of a block', name);
end
above = store.blocks.(parent);
if ~any(strcmp(above.type, {'Model', 'SubSystem'}))
    error('stand_in:parent', '%s is no system', parent);
end
store.calls = store.calls + 1;
block = struct('path', path, 'type', types.types{at}, 'parameters', struct(), 'script', '', 'order', store.calls);
block.inports = {};
block.outports = {};
block = simulink_settings(block, varargin);
store.blocks.(path) = block;
if strcmp(block.type, 'Inport') || strcmp(block.type, 'Outport')
    side = [lower(block.type) 's'];
    above.(side){end + 1} = path;
    if str2double(block.parameters.Port) ~= numel(above.(side))
        error('stand_in:port', 'port %s of %s does not come in order', block.parameters.Port, path);
    end
    store.blocks.(parent) = above;
end
simulink_store('set', store);
end
