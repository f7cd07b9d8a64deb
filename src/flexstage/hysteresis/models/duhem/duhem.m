persistent last out
if isempty(last)
    last = 0;
    out = 0;
end
p = parameters();
if u ~= last
    out = along(last, out, abs(u - last), sign(u - last), p);
    last = u;
end
y = out;
end

function y = along(u, y, v, s, p)
% The output after the input has gone from u by s v: an exponential and a cubic, exactly.
f = p.f;
g = p.g;
a = p.rate;
q0 = a * (f(1) + u * (f(2) + u * (f(3) + u * f(4)))) + s * (g(1) + u * (g(2) + u * (g(3) + u * g(4))));
q1 = a * (f(2) + u * (2 * f(3) + 3 * u * f(4))) + s * (g(2) + u * (2 * g(3) + 3 * u * g(4)));
q2 = a * (2 * f(3) + 6 * u * f(4)) + s * (2 * g(3) + 6 * u * g(4));
q3 = a * 6 * f(4) + s * 6 * g(4);
x = -a * v;
if x > -1
    % upwards the differences would lose digits; the series is short
    term = 1 / 24;
    phi4 = term;
    k = 5;
    while abs(term) > 1e-18
        term = term * x / k;
        phi4 = phi4 + term;
        k = k + 1;
    end
    phi3 = x * phi4 + 1 / 6;
    phi2 = x * phi3 + 0.5;
    phi1 = x * phi2 + 1;
else
    phi1 = expm1(x) / x;
    phi2 = (phi1 - 1) / x;
    phi3 = (phi2 - 0.5) / x;
    phi4 = (phi3 - 1 / 6) / x;
end
y = y * exp(x) + v * (q0 * phi1 + v * (s * q1 * phi2 + v * (q2 * phi3 + v * s * q3 * phi4)));
end
