
function g = flow(g, v, A, rate, p)
% g after a distance v, where dg/dv = A - rate g^2.
if rate == 0
    g = max(g + A * v, 0);
    return
end
G = sqrt(A / abs(rate));
x = g / G;
tau = A * v / G;
if rate > 0
    t = tanh(tau);
    below = 1 + x * t;
    if below > 0
        g = G * max((x + t) / below, 0);
    else
        g = Inf;
    end
elseif atan(x) + tau >= pi / 2
    g = Inf;
else
    t = tan(tau);
    below = 1 - x * t;
    if abs(tau) < 1 && below > 0
        g = G * max((x + t) / below, 0);
    else
        g = G * max(tan(atan(x) + tau), 0);
    end
end
end

function v = time_to_zero(w, A, rate, p)
% The distance in which w falls to zero, where dw/dv = -(A - rate w^2).
if rate == 0
    v = w / A;
    return
end
G = sqrt(A / abs(rate));
x = w / G;
if rate > 0 && x >= 1
    v = Inf;
elseif rate > 0
    v = G / A * atanh(x);
else
    v = G / A * atan(x);
end
end
