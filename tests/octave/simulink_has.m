function found = simulink_has(known, name)
% Whether a structure has a field; isfield takes longer the more fields there are.
found = true;
try
    known.(name);
catch
    found = false;
end
end
