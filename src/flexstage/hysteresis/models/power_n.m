
function g = moved(g, v, A, unloaded, loaded, p)
% g after a distance v, where dg/dv = A - psi |g|^n, psi by the sign of g. A motion is summed as
% power series, each as far as it converges to rounding: in the distance from where g is, or, as
% |g|^n has no such series at g = 0, in the power n of the distance from zero.
n = p.n;
for step = 1:20000
    if v == 0
        return
    end
    s = 1;
    psi = loaded;
    if g < 0
        s = -1;
        psi = unloaded;
    end
    w = abs(g);
    z = psi * w^n / A;
    if ~(abs(z) < 1e150)
        g = s * Inf;
        return
    elseif abs(z) < 0.1 && A * v >= 0.1 * w
        [g, v] = from_zero(s, w, v, A, psi, n, z);
    elseif s > 0 && abs(1 - z) < 1e-9
        g = g - w * (1 - z) / n * expm1(-n * A * v / w);
        return
    elseif z == 1
        return
    else
        % An unloading step stays short of zero.
        reach = 4;
        if s < 0
            reach = 0.5;
        end
        h = min(v, reach * w / (A * (1 + abs(z))));
        across = s * A * h / w;
        [a, terms] = coefficients(across, across * z, 0, 1, n);
        share = converged_share(a, terms);
        g = g + g * tail(a, terms, share);
        if h < v || share < 1
            v = v - share * h;
        else
            v = 0;
        end
    end
end
g = s * Inf;
end

function [g, v] = from_zero(s, w, v, A, psi, n, z)
% g after a distance near zero, and what is left of the distance. With t the distance from zero,
% times A, |g| = t f(psi t^n/A).
share = 1;
term = 1;
k = 1;
while abs(term) > 1e-17
    term = term * z;
    share = share + term / (1 + n * k);
    k = k + 1;
end
t = w * share;
if s < 0 && A * v >= t
    g = 0;
    v = max(v - t / A, 0);
    return
end
last = t + s * A * v;
left = 0;
reach = (0.2 * A / abs(psi))^(1 / n);
if last > reach
    last = reach;
    left = max(v - (reach - t) / A, 0);
end
v = left;
[a, terms] = coefficients(0, psi * last^n / A, 1, n, n);
g = s * (last + last * tail(a, terms, 1));
end

function [a, terms] = coefficients(slope, factor, first, step, n)
% The terms at x = 1 of the solution u of first (u - 1) + step x u' = slope x - factor x u^n, u = 1
% at x = 0; a(k + 1) is term k. Those of the power are q_k = sum of ((n + 1) j/k - 1) a_j q_(k-j)
% over j = 1..k (J. C. P. Miller).
a = zeros(1, 25);
q = zeros(1, 25);
a(1) = 1;
q(1) = 1;
terms = 24;
for k = 1:24
    a(k + 1) = -factor * q(k);
    if k == 1
        a(2) = slope + a(2);
    end
    a(k + 1) = a(k + 1) / (first + step * k);
    if abs(a(k + 1)) < 1e-17 && abs(a(k)) < 1e-17
        terms = k;
        return
    end
    total = 0;
    for j = 1:k
        total = total + ((n + 1) / k * j - 1) * a(j + 1) * q(k - j + 1);
    end
    q(k + 1) = total;
end
end

function share = converged_share(a, terms)
% The x of at most one up to which the last two terms are below rounding.
last = max(abs(a(terms + 1)), abs(a(terms))^(terms / (terms - 1)));
share = 1;
if last > 1e-17
    share = (1e-17 / last)^(1 / terms);
end
end

function total = tail(a, terms, x)
% The sum of all terms but the first at x.
total = 0;
for k = terms:-1:1
    total = (total + a(k + 1)) * x;
end
end
