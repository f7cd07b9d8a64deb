
function g = moved(g, v, A, unloaded, loaded, p)
% g after a distance v, where dg/dv = A - psi |g|^n, psi by the sign of g. Unloading is loading,
% with the rate of unloading, followed back.
zero = 0;
if g < 0
    zero = time_to_zero(-g, A, unloaded, p);
end
if v < zero
    g = -flow(-g, -v, A, unloaded, p);
else
    g = flow(max(g, 0), v - zero, A, loaded, p);
end
end
