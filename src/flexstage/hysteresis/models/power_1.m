
function g = moved(g, v, A, unloaded, loaded, p)
% g after a distance v, where dg/dv = A - psi |g|, psi by the sign of g. Unloading is loading, with
% the rate of unloading, followed back.
zero = 0;
if g < 0
    zero = time_to_zero(-g, A, unloaded);
end
if v < zero
    g = -max(flow(-g, -v, A, unloaded), 0);
else
    g = flow(max(g, 0), v - zero, A, loaded);
end
end

function g = flow(g, v, A, rate)
% g after a distance v, where dg/dv = A - rate g.
x = rate * v;
if x == 0
    g = g + A * v;
else
    g = g + (A - rate * g) * (v * (-expm1(-x) / x));
end
end

function v = time_to_zero(w, A, rate)
% The distance in which w falls to zero, where dw/dv = -(A - rate w).
x = -rate * w / A;
if x <= -1
    v = Inf;
elseif x == 0
    v = w / A;
else
    v = w / A * (log1p(x) / x);
end
end
