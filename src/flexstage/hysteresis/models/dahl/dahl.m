persistent last F
if isempty(last)
    last = 0;
    F = 0;
end
p = parameters();
du = u - last;
last = u;
s = sign(du);
e = 1 - s * F / p.limit;
if du ~= 0 && e ~= 0
    % the gap e closes as |e|' = -(stiffness/limit) |e|^exponent
    x = p.stiffness / p.limit * abs(du);
    m = p.exponent - 1;
    if m == 0
        closed = -expm1(-x);
    else
        q = m * x * abs(e)^m;
        closed = 1;
        if q > -1
            closed = -expm1(-log1p(q) / m);
        end
    end
    F = F + s * p.limit * e * closed;
end
y = p.gain * u - F;
end
