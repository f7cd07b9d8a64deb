persistent last h
if isempty(last)
    last = 0;
    h = 0;
end
p = parameters();
h = advance(h, last, u - last, p);
last = u;
y = u * (p.cubic(1) + u * (p.cubic(2) + u * p.cubic(3))) - h;
end

function h = advance(h, u, du, p)
% The hysteretic displacement after one straight line of the input. The line is cut where the
% input passes the centre, beyond which the shape function may have other values.
if du == 0
    return
end
s = sign(du);
v = s * du;
if s > 0
    upper = u >= p.centre;
else
    upper = u > p.centre;
end
first = s * (p.centre - u);
if ~(first > 0 && first < v)
    first = v;
end
h = one_side(h, s, first, upper, p);
if v > first
    h = one_side(h, s, v - first, ~upper, p);
end
end

function h = one_side(h, s, v, upper, p)
% On one side of the centre h unloads to zero, and is loaded from there on.
k = 1 + (s > 0) * 2 + upper;
h = s * moved(s * h, v, p.A, p.unloaded(k), p.loaded(k), p);
end
