function [y, s] = STAGE_NAME_step(S, s, u)
%STAGE_NAME_step  Readings after one step of S.step seconds.
%
%   STAGE_TITLE
%
%   S = load('STAGE_NAME.mat');
%   [y, s] = STAGE_NAME_step(S, [], u)   settles the stage at the commands u and reads it
%   [y, s] = STAGE_NAME_step(S, s, u)    moves the commands on straight lines to u in one step
%
%   u  commands in the order of S.drives [S.drives(j).unit], one column
%   y  readings in the order of S.probes [S.probes(i).unit], one column, through their sensors
%   s  state of the stage
%
%   The chain of each drive is exact: amplifier (bandwidth, largest rate, range), a gain or Bouc-Wen
%   hysteresis of exponent 1, creep, and all modes under the output of the hysteresis between two
%   samples. The voltage is a straight line between samples.
%   Validity: that of the model (S.notes); damping ratios below 1; sensors without noise.
%
%   Written by flexstage FLEXSTAGE_VERSION; for MATLAB and Octave, without toolboxes.

u = u(:);
if numel(u) ~= numel(S.drives) || ~all(isfinite(u))
    error('flexstage:commands', ...
        'the stage has %d drives: give a finite command for each, in the order of S.drives', ...
        numel(S.drives));
end
if any(S.zeta >= 1)
    error('flexstage:damping', 'this step is for modes that swing: a damping ratio is 1 or more');
end
begins = isempty(s);
if begins
    s = struct('drives', {cell(1, numel(S.drives))}, 'sensors', {cell(1, numel(S.probes))});
end
y = zeros(numel(S.probes), 1);
for j = 1:numel(S.drives)
    d = S.drives(j);
    if begins
        c = settled_drive(S, d, u(j));
    else
        c = step_drive(S, d, s.drives{j}, u(j));
    end
    y = y + d.mode_weights * [c.z; c.v] + d.feedthrough(:) * c.w;
    if ~isempty(c.lags)
        y = y + d.lag_weights * c.lags;
    end
    s.drives{j} = c;
end
for i = 1:numel(S.probes)
    p = S.probes(i).sensor;
    if p.present
        if begins
            s.sensors{i} = struct('input', y(i), 'lag', y(i), 'count', 0);
        end
        [y(i), s.sensors{i}] = step_sensor(p, s.sensors{i}, y(i), S.step);
    end
end
end

% ------------------------------------------------------------------------------------- one drive
function c = settled_drive(S, d, u)
%SETTLED_DRIVE  Settled at the command u, reached from zero.
c.command = u;
c.voltage = u;
if d.amplifier.present
    c.voltage = min(max(d.amplifier.gain * u, d.amplifier.voltage_range(1)), ...
        d.amplifier.voltage_range(2));
end
c.h = 0;
if strcmp(d.hysteresis.kind, 'none')
    c.w = d.gain * c.voltage;
else
    [pieces, c.h] = bouc_wen(d.hysteresis, 0, 0, c.voltage);
    c.w = d.hysteresis.gain * c.voltage - c.h;
end
c.lags = c.w * ones(size(d.creep.time_constants(:)));
c.z = c.w * ones(size(S.omega(:)));
c.v = zeros(size(c.z));
end

function c = step_drive(S, d, c, u)
%STEP_DRIVE  The command moves on a straight line to u.
before = c.voltage;
c.voltage = u;
if d.amplifier.present
    c.voltage = amplify(d.amplifier, c.command, before, u, S.step);
end
c.command = u;
if strcmp(d.hysteresis.kind, 'none')
    slope = d.gain * (c.voltage - before) / S.step;
    % an imposed displacement also acts through its rate
    pieces = struct('length', S.step, 'value', c.w + d.rate_time(:) * slope, ...
        'slope', slope, 'amplitude', 0, 'rate', 0);
    [c.z, c.v] = move_modes(S, c.z, c.v, pieces);
    c.w = d.gain * c.voltage;
    return
end
[pieces, c.h] = bouc_wen(d.hysteresis, c.h, before, c.voltage);
tau = d.creep.time_constants(:);
for i = 1:numel(pieces)
    p = pieces(i);
    % from shares of the step to seconds
    p.length = p.length * S.step;
    p.slope = p.slope / S.step;
    p.rate = p.rate / S.step;
    [c.z, c.v] = move_modes(S, c.z, c.v, p);
    if ~isempty(tau)
        c.lags = move_lags(tau, c.lags, p);
    end
end
c.w = d.hysteresis.gain * c.voltage - c.h;
end

% ------------------------------------------------------------------------------------ hysteresis
function [pieces, h] = bouc_wen(m, h, before, after)
%BOUC_WEN  y = d u - h, dh/du = A - (beta sign(du) + gamma sign(h)) h, along a straight line.
%   y = value + slope x + amplitude exp(-rate x) in each piece, x the share of the line.
if ~strcmp(m.kind, 'bouc-wen') || m.exponent ~= 1
    error('flexstage:hysteresis', ...
        ['this file has no exact step of hysteresis of kind %s (only Bouc-Wen of exponent 1): ' ...
        'use the exported C code or FMU'], m.kind);
end
du = after - before;
way = sign(du);
A = m.hysteresis_gain;
pieces = struct('length', {}, 'value', {}, 'slope', {}, 'amplitude', {}, 'rate', {});
at = 0;
while at < 1
    left = 1 - at;
    side = sign(h);
    if side == 0
        side = way;
    end
    % h' = A - k h for the part of the line on which h keeps its sign, per unit of u
    k = m.beta * way + m.gamma * side;
    share = left;
    crossed = false;
    if h * way < 0
        % h moves towards zero; the point where it is zero
        if k == 0
            crossing = -h / A;
        else
            crossing = log1p(-k * h / A) / k;
        end
        if isreal(crossing) && crossing / du > 0 && crossing / du < left
            share = crossing / du;
            crossed = true;
        end
    end
    p.length = share;
    start = m.gain * (before + at * du);
    if abs(k * du) < 1e-9
        p.value = start - h;
        p.slope = m.gain * du - (A - k * h) * du;
        p.amplitude = 0;
        p.rate = 0;
        h = h + (A - k * h) * du * share;
    else
        limit = A / k;
        p.value = start - limit;
        p.slope = m.gain * du;
        p.amplitude = limit - h;
        p.rate = k * du;
        h = h + (h - limit) * expm1(-p.rate * share);
    end
    if crossed
        h = 0;
    end
    pieces(end + 1) = p; %#ok<AGROW>
    at = at + share;
    if ~crossed
        at = 1;
    end
end
end

% ------------------------------------------------------------------------- modes, lags, sensors
function [z, v] = move_modes(S, z, v, p)
%MOVE_MODES  z'' + 2 zeta omega z' + omega^2 z = omega^2 (value + slope t + amplitude exp(-rate t)).
w = S.omega(:);
decay = S.zeta(:) .* w;
own = w.^2 .* (1 - S.zeta(:).^2);
damped = sqrt(own);
% particular solution, and oscillation about it
offset = p.value - 2 * S.zeta(:) .* p.slope ./ w;
held = p.amplitude * w.^2 ./ ((p.rate - decay).^2 + own);
away = z - offset - held;
speed = v - p.slope + p.rate * held;
fall = exp(-decay * p.length);
c = fall .* cos(damped * p.length);
g = fall .* sin(damped * p.length) ./ damped;
held = held * exp(-p.rate * p.length);
z = offset + p.slope * p.length + held + (c + decay .* g) .* away + g .* speed;
v = p.slope - p.rate * held - w.^2 .* g .* away + (c - decay .* g) .* speed;
end

function lags = move_lags(tau, lags, p)
%MOVE_LAGS  tau l' + l = value + slope t + amplitude exp(-rate t).
x = p.length ./ tau;
gone = -expm1(-x);
apart = (1 ./ tau - p.rate) * p.length;
ratio = ones(size(apart));
ratio(apart ~= 0) = -expm1(-apart(apart ~= 0)) ./ apart(apart ~= 0);
lags = (1 - gone) .* lags + p.value * gone + p.slope * p.length * followed(x) ...
    + p.amplitude * x .* exp(-p.rate * p.length) .* ratio;
end

function share = followed(x)
%FOLLOWED  1 - (1 - exp(-x))/x, by its series where that would lose digits.
share = zeros(size(x));
small = x < 1;
r = x(small);
series = zeros(size(r));
for k = 18:-1:1
    series = r / (k + 1) .* (1 - series);
end
share(small) = series;
share(~small) = 1 + expm1(-x(~small)) ./ x(~small);
end

function [y, s] = step_sensor(p, s, input, h)
%STEP_SENSOR  Lag, gain, offset, mains pick-up, resolution.
if p.time_constant > 0
    x = h / p.time_constant;
    s.lag = s.lag - (s.input - s.lag) * expm1(-x) + (input - s.input) * followed(x);
else
    s.lag = input;
end
s.input = input;
y = p.gain * s.lag + p.offset;
y = y + p.mains_amplitude * sin(2 * pi * p.mains_frequency_hz * h * s.count + p.mains_phase);
s.count = s.count + 1;
if p.quantisation > 0
    y = p.quantisation * round(y / p.quantisation);
end
end

% ------------------------------------------------------------------------------------- amplifier
function v = amplify(a, before, v, command, step)
%AMPLIFY  T v' = c - v, no faster than the largest rate, within the range.
%   The step is divided at transitions between following, slewing and saturation.
%   Time is in time constants T.
h = step / a.time_constant;
c = a.gain * before;
slope = a.gain * (command - before) / h;
behind = a.largest_rate * a.time_constant;
low = a.voltage_range(1);
high = a.voltage_range(2);
v = min(max(v, low), high);
e = c - v;
if (v >= high && e > 0) || (v <= low && e < 0)
    mode = 'rests';
elseif abs(e) > behind
    mode = 'slews';
else
    mode = 'follows';
end
for turn = 1:16
    e = c - v;
    way = 2 * (e > 0 || (e == 0 && slope > 0)) - 1;
    switch mode
        case 'rests'
            following = 'follows';
            t = inf;
            if way * slope < 0
                t = abs(e / slope);
            end
            if t >= h
                return
            end
            c = v;
        case 'slews'
            t = inf;
            if behind - way * slope > 0
                t = (abs(e) - behind) / (behind - way * slope);
            end
            if way > 0
                rail = high;
            else
                rail = low;
            end
            reach = abs(rail - v) / behind;
            if t <= reach
                following = 'follows';
            else
                following = 'rests';
            end
            t = min(t, reach);
            if t >= h
                v = v + way * behind * h;
                return
            end
            c = c + slope * t;
            if strcmp(following, 'rests')
                v = rail;
            else
                v = c - way * behind;
            end
        otherwise
            following = 'slews';
            t = h;
            if abs(slope) > behind
                t = min(h, max(0, log((slope - e) / (slope - sign(slope) * behind))));
            end
            last = follow(v, e, slope, t);
            % the output turns at most once, and may reach an end of the range before
            bend = inf;
            if e * slope < 0
                bend = log1p(-e / slope);
            end
            early = last;
            if bend < t
                early = follow(v, e, slope, bend);
            end
            if early > high || early < low
                rail = high;
                if early < low
                    rail = low;
                end
                t = meet(v, e, slope, 0, min(bend, t), rail);
                following = 'rests';
                v = rail;
            elseif last > high || last < low
                rail = high;
                if last < low
                    rail = low;
                end
                from = 0;
                if bend < t
                    from = bend;
                end
                t = meet(v, e, slope, from, t, rail);
                following = 'rests';
                v = rail;
            elseif t >= h
                v = last;
                return
            else
                v = last;
            end
            c = c + slope * t;
            if strcmp(following, 'rests') && t >= h
                return
            end
    end
    h = h - t;
    mode = following;
end
end

function v = follow(v, e, slope, t)
%FOLLOW  Output after following a line for a time t, with initial error e.
v = v - e * expm1(-t) + slope * t * followed(t);
end

function last = meet(v, e, slope, first, last, rail)
%MEET  Time at which the output reaches an end of its range, by bisection.
rising = follow(v, e, slope, last) > rail;
for i = 1:200
    middle = 0.5 * (first + last);
    if middle == first || middle == last
        break
    end
    if (follow(v, e, slope, middle) > rail) == rising
        last = middle;
    else
        first = middle;
    end
end
end
