function [rate, signals] = simulink_evaluate(model, plan, x, known, t)
% Rates of the states, and the outputs of all blocks. Columns of x and of known are computed side
% by side; known holds a row for each source, in the order of the plan.
blocks = model.blocks;
n = numel(blocks);
columns = size(x, 2);
signals = cell(1, n);
rate = zeros(plan.size, columns);
for k = plan.order
    block = blocks{k};
    v = block.values;
    in = cell(1, numel(block.sources));
    if ~plan.late(k)
        for j = 1:numel(in)
            in{j} = signals{block.sources(j)};
            if plan.demux(block.sources(j))
                in{j} = in{j}(block.outputs(j), :);
            end
        end
    end
    switch block.type
        case {'Integrator', 'TransferFcn'}
            out = x(plan.states{k}, :);
        case {'FromWorkspace', 'MatlabFunction'}
            out = known(plan.sources == k, :);
        case 'Constant'
            out = repmat(v.Value(:), 1, columns);
        case 'SineWave'
            out = repmat(v.Amplitude * sin(v.Frequency * t + v.Phase), 1, columns);
        case 'Gain'
            if plan.matrix(k)
                if size(v.Gain, 2) ~= size(in{1}, 1)
                    error('stand_in:width', '%s takes %d signals, gets %d', block.path, size(v.Gain, 2), size(in{1}, 1));
                end
                out = v.Gain * in{1};
            else
                out = v.Gain .* in{1};
            end
        case 'Sum'
            signs = block.parameters.Inputs;
            out = 0;
            for j = 1:numel(in)
                if size(in{j}, 1) ~= size(in{1}, 1)
                    error('stand_in:width', 'the inputs of %s differ in width', block.path);
                end
                if signs(j) == '+'
                    out = out + in{j};
                else
                    out = out - in{j};
                end
            end
        case 'Mux'
            out = vertcat(in{:});
        case 'StateSpace'
            at = plan.states{k};
            out = v.C * x(at, :) + v.D * in{1};
            rate(at, :) = v.A * x(at, :) + v.B * in{1};
        case 'Saturate'
            out = min(max(in{1}, v.LowerLimit), v.UpperLimit);
        case 'Quantizer'
            out = v.QuantizationInterval * round(in{1} / v.QuantizationInterval);
        otherwise
            % Demux, Zero-Order Hold and sinks hand on what they get
            out = in{1};
    end
    signals{k} = out;
end
for k = plan.integrators
    block = blocks{k};
    in = signals{block.sources(1)};
    if plan.demux(block.sources(1))
        in = in(block.outputs(1), :);
    end
    at = plan.states{k};
    if size(in, 1) ~= numel(at)
        error('stand_in:width', '%s integrates %d signals, gets %d', block.path, numel(at), size(in, 1));
    end
    if strcmp(block.type, 'TransferFcn')
        in = (in - x(at, :)) / block.values.Denominator(1);
    elseif plan.limited(k)
        in((x(at, :) >= block.values.UpperSaturationLimit & in > 0) | (x(at, :) <= block.values.LowerSaturationLimit & in < 0)) = 0;
    end
    rate(at, :) = in;
end
end
