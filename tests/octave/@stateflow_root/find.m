function chart = find(root, varargin)
if numel(varargin) ~= 4 || ~strcmp(varargin{1}, '-isa') || ~strcmp(varargin{2}, 'Stateflow.EMChart') || ~strcmp(varargin{3}, 'Path')
    error('stand_in:find', 'the stand-in knows find(sfroot, ''-isa'', ''Stateflow.EMChart'', ''Path'', path)');
end
chart = simulink_chart(varargin{4});
end
