persistent plays
p = parameters();
if isempty(plays)
    plays = zeros(1, numel(p.thresholds));
end
% each play follows the input like a slider with a gap of its threshold to each side
plays = max(u - p.thresholds, min(u + p.thresholds, plays));
y = p.gain * u + total(plays, p);
if numel(p.line_slopes) > 1
    % and then the line with kinks
    j = 1 + sum(y > p.line_knots);
    y = p.line_offsets(j) + p.line_slopes(j) * y;
end
end

function y = total(plays, p)
% The sum of the functions of the plays, each straight between the knots.
y = 0;
for i = numel(plays):-1:1
    j = 1 + sum(plays(i) > p.knots);
    y = y + (p.offsets(i, j) + p.slopes(i, j) * plays(i));
end
end
