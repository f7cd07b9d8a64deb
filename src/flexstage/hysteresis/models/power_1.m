
function g = flow(g, v, A, rate, p)
% g after a distance v, where dg/dv = A - rate g.
x = rate * v;
if x == 0
    g = max(g + A * v, 0);
else
    g = max(g + (A - rate * g) * (v * (-expm1(-x) / x)), 0);
end
end

function v = time_to_zero(w, A, rate, p)
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
