function assignin(space, name, value)
if ~isvarname(name)
    error('stand_in:variable', '''%s'' is no name of a variable', name);
end
store = simulink_store('get');
store.numbers.(name) = value;
simulink_store('set', store);
end
