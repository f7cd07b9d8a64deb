function types = simulink_types()
% Blocks of the library of Simulink: type, number of ports, parameters, values that are allowed.
% A number of ports of -1 depends on the parameters.
persistent known
if ~isempty(known)
    types = known;
    return
end
rows = {
    'simulink/Sources/In1', 'Inport', 0, 1, {'Port', 'PortDimensions'}
    'simulink/Sinks/Out1', 'Outport', 1, 0, {'Port', 'PortDimensions'}
    'simulink/Math Operations/Gain', 'Gain', 1, 1, {'Gain', 'Multiplication'}
    'simulink/Math Operations/Sum', 'Sum', -1, 1, {'Inputs', 'IconShape'}
    'simulink/Sources/Constant', 'Constant', 0, 1, {'Value', 'VectorParams1D'}
    'simulink/Sources/Sine Wave', 'SineWave', 0, 1, {'Amplitude', 'Bias', 'Frequency', 'Phase', 'SampleTime'}
    'simulink/Sources/From Workspace', 'FromWorkspace', 0, 1, {'VariableName', 'SampleTime', 'Interpolate', 'OutputAfterFinalValue'}
    'simulink/Sinks/To Workspace', 'ToWorkspace', 1, 0, {'VariableName', 'SaveFormat', 'MaxDataPoints', 'SampleTime'}
    'simulink/Sinks/Scope', 'Scope', 1, 0, {'NumInputPorts'}
    'simulink/Continuous/Integrator', 'Integrator', 1, 1, {'InitialCondition', 'LimitOutput', 'UpperSaturationLimit', 'LowerSaturationLimit'}
    'simulink/Continuous/Transfer Fcn', 'TransferFcn', 1, 1, {'Numerator', 'Denominator'}
    'simulink/Continuous/State-Space', 'StateSpace', 1, 1, {'A', 'B', 'C', 'D'}
    'simulink/Discrete/Zero-Order Hold', 'ZeroOrderHold', 1, 1, {'SampleTime'}
    'simulink/Discontinuities/Saturation', 'Saturate', 1, 1, {'UpperLimit', 'LowerLimit'}
    'simulink/Discontinuities/Quantizer', 'Quantizer', 1, 1, {'QuantizationInterval'}
    'simulink/Signal Routing/Mux', 'Mux', -1, 1, {'Inputs'}
    'simulink/Signal Routing/Demux', 'Demux', 1, -1, {'Outputs'}
    'simulink/User-Defined Functions/MATLAB Function', 'MatlabFunction', 1, 1, {}
    'built-in/Subsystem', 'SubSystem', -1, -1, {}
    };
known = struct();
known.paths = rows(:, 1);
known.types = rows(:, 2);
known.inputs = cell2mat(rows(:, 3));
known.outputs = cell2mat(rows(:, 4));
known.parameters = rows(:, 5);
known.common = {'Position', 'Description', 'AttributesFormatString'};
known.allowed = struct( ...
    'Multiplication', {{'Element-wise(K.*u)', 'Matrix(K*u)', 'Matrix(u*K)', 'Matrix(K*u) (u vector)'}}, ...
    'IconShape', {{'round', 'rectangular'}}, ...
    'Interpolate', {{'on', 'off'}}, ...
    'LimitOutput', {{'on', 'off'}}, ...
    'OutputAfterFinalValue', {{'Extrapolation', 'Setting to zero', 'Holding final value', 'Cyclic repetition'}}, ...
    'SaveFormat', {{'Timeseries', 'Structure With Time', 'Structure', 'Array'}});
types = known;
end
