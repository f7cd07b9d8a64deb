
function g = flow(g, v, A, rate, p)
% g after a distance v, where dg/dv = A - rate g^n. With x = g/G, G = (A/|rate|)^(1/n), and
% z = x^n, the distance from x = 0 is a series in z for small z, in ln z about z = 1, and in 1/z
% for large z; the three meet at |ln z| = 1.1. Where x is asked for a distance, Newton's method
% inverts it.
G = scale(A, rate, p.n);
if ~(G < 1e150)
    g = max(g + A * v, 0);
    return
end
x = g / G;
tau = A * v / G;
if rate > 0 && x == 1
    return
elseif rate > 0
    g = G * flow_n(x, tau, 1, p);
else
    g = G * flow_n(x, tau, -1, p);
end
end

function v = time_to_zero(w, A, rate, p)
% The distance in which w falls to zero, where dw/dv = -(A - rate w^n).
G = scale(A, rate, p.n);
if ~(G < 1e150)
    v = w / A;
    return
end
x = w / G;
if rate > 0 && x >= 1
    v = Inf;
elseif rate > 0
    v = G / A * (elapsed(x, 1, p) / p.n);
else
    v = G / A * (elapsed(x, -1, p) / p.n);
end
end

function G = scale(A, rate, n)
% The value at which both terms are of one size.
if rate == 0
    G = Inf;
else
    G = (A / abs(rate))^(1 / n);
end
end

function x = flow_n(x, tau, sigma, p)
n = p.n;
above = sigma > 0 && x > 1;
power = 0;
if x > 0
    q = n * log(x);
    power = exp(q);
    if q > 1.1
        move = -sigma * n * tau;
        if move >= -beyond(1.1, q, sigma, p)
            x = reached_high(q, move, sigma, p);
            return
        end
    end
end
target = elapsed(x, sigma, p) + n * tau;
if target <= 0 && ~above
    x = 0;
    return
end
x = reached(target, sigma, above, max(x + tau * (1 - sigma * power), 0), p);
end

function t = elapsed(x, sigma, p)
% n times the distance at x; from x = 0, but above saturation only differences count.
if x == 0
    t = 0;
    return
end
side = 1 + (sigma < 0);
q = p.n * log(x);
if q <= -1.1
    t = x * series(p.low, sigma * x^p.n);
elseif q < 1.1
    t = p.at_zero(side) + middle(q, sigma, p);
else
    t = p.at_high(side) - sigma * beyond(1.1, q, sigma, p);
end
end

function t = middle(q, sigma, p)
% Between the edges, counted from z = 1.
if sigma < 0
    t = series(p.middle(2, :), q);
else
    t = series(p.middle(1, :), q) - log(abs(expm1(q)));
end
end

function t = beyond(start, q, sigma, p)
% The integral of exp(b r)/(exp(r) - sigma) from start to q, beyond the upper edge.
a = 1 - 1 / p.n;
before = exp(-a * start);
first = before * (q - start) * relative(a * (q - start));
before = before * series(p.high, sigma * exp(-start));
after = exp(-a * q) * series(p.high, sigma * exp(-q));
t = first + (before - after);
end

function x = reached(target, sigma, above, guess, p)
% x where n times the distance has the target value; infinity where it has run away before.
side = 1 + (sigma < 0);
if ~above && target <= p.at_low(side)
    x = reached_low(target, sigma, guess, p);
elseif sigma > 0 && above && target < p.at_high(1)
    x = reached_high(1.1, p.at_high(1) - target, sigma, p);
elseif sigma > 0
    x = reached_saturation(target, 1 - 2 * above, guess, p);
elseif target >= p.at_high(2)
    x = reached_high(1.1, target - p.at_high(2), sigma, p);
else
    x = reached_middle(target, guess, p);
end
end

function x = reached_low(target, sigma, guess, p)
tau = target / p.n;
x = tau;
if guess >= 0.7 * tau && guess <= 1.4 * tau
    x = guess;
end
for k = 1:30
    z = x^p.n;
    slope = 1 / (1 - sigma * z);
    newton = (x * series(p.low, sigma * z) / p.n - tau) / slope;
    correction = newton / (1 - 0.5 * newton * p.n * sigma * z * slope / x);
    x = x - correction;
    if abs(correction) <= 1e-6 * x
        break
    end
end
end

function x = reached_saturation(target, side, guess, p)
% Near saturation, on L = -ln|1 - z|; side is -1 above it.
a = 1 - 1 / p.n;
remaining = target - p.at_zero(1);
gap = side * (1 - guess^p.n);
L = remaining;
if gap > 0 && gap < 0.9
    L = -log(gap);
end
for k = 1:30
    if side > 0
        L = max(L, 0.2);
    else
        L = max(L, -1.2);
    end
    q = log1p(-side * exp(-L));
    correction = (L + series(p.middle(1, :), q) - remaining) * exp(a * q);
    L = L - correction;
    if abs(correction) <= 2e-9
        break
    end
end
x = exp(log1p(-side * exp(-L)) / p.n);
end

function x = reached_middle(target, guess, p)
q = 0;
if guess > 0
    q = min(max(p.n * log(guess), -1.1), 1.1);
end
for k = 1:30
    miss = p.at_zero(2) + series(p.middle(2, :), q) - target;
    correction = miss * (1 + exp(q)) * exp(-q / p.n);
    q = min(max(q - correction, -1.111), 1.111);
    if abs(correction) <= 2e-9
        break
    end
end
x = exp(q / p.n);
end

function x = reached_high(start, target, sigma, p)
% The unknown is E = (1 - exp(-a (q - start)))/a, in which the integral is nearly linear.
a = 1 - 1 / p.n;
size_here = exp(-a * start);
E = 0;
q = start;
for k = 1:30
    miss = beyond(start, q, sigma, p) - target;
    correction = miss / size_here * (1 - sigma * exp(-q));
    if a * (E - correction) >= 1
        whole = size_here * (1 / a + series(p.high, sigma * exp(-start)));
        if target >= whole
            x = Inf;
            return
        end
        correction = 0.5 * (E - 1 / a);
    end
    E = E - correction;
    if E == 0
        q = max(start, 0.99);
    else
        q = max(start - log1p(-a * E) / a, 0.99);
    end
    if abs(correction) <= 2e-9 * (1 - a * E)
        break
    end
end
x = exp(q / p.n);
end

function r = relative(x)
% (1 - exp(-x))/x.
if x == 0
    r = 1;
else
    r = -expm1(-x) / x;
end
end

function total = series(c, x)
% c(1) + c(2) x + c(3) x^2 + ...
total = 0;
for k = numel(c):-1:1
    total = total * x + c(k);
end
end
