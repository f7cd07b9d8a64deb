persistent x plays
p = parameters();
if isempty(x)
    x = 0;
    plays = zeros(1, numel(p.thresholds));
end
% the voltage is a sum of functions of plays of the displacement, which is followed, piece
% by straight piece, up to the requested one
[x, plays] = walk(u, x, plays, p);
y = x;
end

function [x, plays] = walk(u, x, plays, p)
m = numel(plays);
c = numel(p.knots);
where = ones(1, m);
here = p.gain * x;
for i = m:-1:1
    where(i) = 1 + sum(plays(i) > p.knots);
    here = here + (p.offsets(i, where(i)) + p.slopes(i, where(i)) * plays(i));
end
if u == here
    return
end
s = sign(u - here);
% how many plays move as soon as the displacement does, but for rounding
moving = 0;
while moving < m && s * (x - plays(moving + 1)) >= p.thresholds(moving + 1) - 1e-15 * (abs(x) + p.thresholds(moving + 1))
    moving = moving + 1;
end
for count = 1:(m * (c + 2) + 2)
    % the slope here, where it changes, and the play that makes it change
    slope = p.gain;
    far = Inf;
    cause = 0;
    if moving < m
        far = s * plays(moving + 1) + p.thresholds(moving + 1);
        cause = moving + 1;
    end
    for i = 1:moving
        slope = slope + p.slopes(i, where(i));
        knot = where(i) - (s < 0);
        if knot >= 1 && knot <= c
            passing = s * p.knots(knot) + p.thresholds(i);
            if passing < far
                far = passing;
                cause = i;
            end
        end
    end
    reach = max(0, far - s * x);
    if cause == 0 || s * (u - here) <= slope * reach
        x = x + (u - here) / slope;
        break
    end
    here = here + s * slope * reach;
    x = x + s * reach;
    if cause == moving + 1
        moving = moving + 1;
    else
        where(cause) = where(cause) + s;
    end
end
plays = max(x - p.thresholds, min(x + p.thresholds, plays));
end
