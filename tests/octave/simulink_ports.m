function count = simulink_ports(block, side)
% The number of inputs or outputs that a block has now.
types = simulink_types();
at = find(strcmp(types.types, block.type));
count = types.(side)(at);
if count >= 0
    return
end
if strcmp(block.type, 'SubSystem')
    if strcmp(side, 'inputs')
        count = numel(block.inports);
    else
        count = numel(block.outports);
    end
elseif strcmp(block.type, 'Sum')
    count = sum(block.parameters.Inputs == '+' | block.parameters.Inputs == '-');
elseif strcmp(block.type, 'Mux')
    count = str2double(block.parameters.Inputs);
else
    count = str2double(block.parameters.Outputs);
end
end
