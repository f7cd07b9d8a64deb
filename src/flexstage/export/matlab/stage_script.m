%STAGE_NAME  Matrices, Bode diagram and time response of a flexure stage.
%
%   STAGE_TITLE
%
%   Loads STAGE_NAME.mat into S; S.notes describes its matrices and their validity. Results:
%     plant      state space from free displacements [m] or forces [N] to readings, and
%     plant_d    its discrete form; both need the control toolbox or package
%     f, H       frequencies [Hz] and responses, H(i, j, :) from drive j to probe i
%     t, u, y    time response: commands and readings, with amplifier, hysteresis and creep
%
%   Written by flexstage FLEXSTAGE_VERSION; for MATLAB and Octave, without toolboxes.

S = load(fullfile(fileparts(mfilename('fullpath')), 'STAGE_NAME.mat'));
fprintf('%s: %s (%s)\n', S.name, S.title, S.version);
for j = 1:numel(S.drives)
    fprintf('  command  %s [%s], hysteresis: %s\n', S.drives(j).name, S.drives(j).unit, ...
        S.drives(j).hysteresis.kind);
end
for i = 1:numel(S.probes)
    fprintf('  reading  %s [%s]\n', S.probes(i).name, S.probes(i).unit);
end
listed = min(6, numel(S.frequency_hz));
fprintf('  modes    %s Hz\n', sprintf('%.5g ', S.frequency_hz(1:listed)));
fprintf('  S.notes  %d notes: matrices and their validity\n', numel(S.notes));

% ----------------------------------------------------------------------------------- state space
if exist('OCTAVE_VERSION', 'builtin')
    try
        pkg('load', 'control');
    catch
        % without the package, use the matrices of S
    end
end
if ~isempty(which('ss'))
    plant = ss(S.A, S.B, S.C, S.D, 'InputName', S.inputs, 'OutputName', S.outputs);
    plant_d = ss(S.Ad, S.Bd, S.Cd, S.Dd, S.step, 'InputName', S.inputs, 'OutputName', S.outputs);
else
    fprintf('  no control toolbox or package: no plant and plant_d, use the matrices of S\n');
end

% ----------------------------------------------------------------------------------------- Bode
near = S.frequency_hz(1:listed) * ones(1, 41) ...
    .* (1 + max(S.zeta(1:listed), 1e-4) * linspace(-6, 6, 41));
f = unique([logspace(log10(S.frequency_hz(1) / 30), log10(1.5 * S.frequency_hz(listed)), 300), ...
    near(near > 0)']);
H = zeros(numel(S.probes), numel(S.drives), numel(f));
one = eye(size(S.A));
for n = 1:numel(f)
    H(:, :, n) = S.C * ((2i * pi * f(n) * one - S.A) \ S.B) + S.D;
end

% ----------------------------------------------------------------------------------- time response
t = (0:1999)' * S.step;
u = zeros(numel(t), numel(S.drives));
can = true;
for j = 1:numel(S.drives)
    d = S.drives(j);
    if all(isfinite(d.input_range))
        size_of = 0.45 * diff(d.input_range);
        middle = mean(d.input_range);
    elseif isfinite(d.stroke) && d.stroke > 0
        size_of = 0.45 * d.stroke;
        middle = 0;
    else
        size_of = 1e-5;
        middle = 0;
    end
    % three cycles of the first drive, four of the next ...
    u(:, j) = middle - size_of * cos(2 * pi * (j + 2) * (0:numel(t) - 1)' / numel(t));
    h = d.hysteresis;
    can = can && (strcmp(h.kind, 'none') || (strcmp(h.kind, 'bouc-wen') && h.exponent == 1));
end
y = nan(numel(t), numel(S.probes));
if can
    s = [];
    for n = 1:numel(t)
        [y(n, :), s] = STAGE_NAME_step(S, s, u(n, :));
    end
else
    fprintf('  no exact step for this hysteresis: no time response, use the C code or the FMU\n');
end

% ---------------------------------------------------------------------------------------- figures
try
    names = strcat({'drive '}, {S.drives.name});
    stiffness = [S.drives.stiffness];
    per = 'm';
    if any(stiffness == 0)
        per = 'N';
        if any(stiffness > 0)
            per = 'm or N';
        end
    end
    figure('Name', [S.name ': Bode']);
    for i = 1:numel(S.probes)
        subplot(2, numel(S.probes), i);
        size_of = abs(reshape(H(i, :, :), numel(S.drives), []));
        loglog(f, size_of);
        % a millionth of the maximum is rounding
        ylim(max(size_of(:)) * [1e-6, 3]);
        title(['reading ' S.probes(i).name]);
        ylabel(['magnitude [' S.probes(i).unit ' per ' per ']']);
        legend(names, 'Location', 'southwest');
        grid on
        subplot(2, numel(S.probes), numel(S.probes) + i);
        semilogx(f, 180 / pi * unwrap(angle(reshape(H(i, :, :), numel(S.drives), [])), [], 2));
        xlabel('frequency [Hz]');
        ylabel('phase [deg]');
        grid on
    end
    if can
        figure('Name', [S.name ': time response']);
        for i = 1:numel(S.probes)
            subplot(numel(S.probes), 2, 2 * i - 1);
            plot(t, 1e6 * y(:, i));
            xlabel('time [s]');
            ylabel([S.probes(i).name ' [1e-6 ' S.probes(i).unit ']']);
            grid on
            subplot(numel(S.probes), 2, 2 * i);
            j = min(i, numel(S.drives));
            plot(u(:, j), 1e6 * y(:, i));
            xlabel(['command ' S.drives(j).name ' [' S.drives(j).unit ']']);
            ylabel([S.probes(i).name ' [1e-6 ' S.probes(i).unit ']']);
            grid on
        end
    end
catch failure
    fprintf('  no figures: %s\n', failure.message);
end
