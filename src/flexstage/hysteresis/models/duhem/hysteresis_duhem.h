/* Duhem model of Coleman and Hodgdon, y' = alpha |u'| (f(u) - y) + u' g(u), f and g cubics.
 *
 * Parameters: rate alpha, four coefficients of f from the constant up, four of g. Memory: last
 * input, output. Single precision: each step rounds the output, so small steps du in a row, all one
 * way, may put the slope dy/du off by up to 3e-8 |y|/du.
 */
#ifndef FS_HYSTERESIS_DUHEM_H
#define FS_HYSTERESIS_DUHEM_H

#include "decay.h"
#include "piece.h"

#ifdef FS_SINGLE
#define FS_DUHEM_LEAST_TERM 1e-9f
#else
#define FS_DUHEM_LEAST_TERM 1e-18
#endif

/* The output after the input has gone from u by sign v. */
static inline fs_real fs_duhem_step(const fs_real *p, fs_real u, fs_real y, fs_real v, fs_real sign)
{
    const fs_real *f = p + 1, *g = p + 5;
    const fs_real two = FS_R(2.0), three = FS_R(3.0), six = FS_R(6.0);
    fs_real alpha = p[0], x = -alpha * v, phi1, phi2, phi3, phi4;
    fs_real q0 = alpha * (f[0] + u * (f[1] + u * (f[2] + u * f[3])));
    fs_real q1 = alpha * (f[1] + u * (two * f[2] + three * u * f[3]));
    fs_real q2 = alpha * (two * f[2] + six * u * f[3]);
    fs_real q3 = alpha * six * f[3];
    q0 += sign * (g[0] + u * (g[1] + u * (g[2] + u * g[3])));
    q1 += sign * (g[1] + u * (two * g[2] + three * u * g[3]));
    q2 += sign * (two * g[2] + six * u * g[3]);
    q3 += sign * six * g[3];
    if (x > -FS_R(1.0)) {
        /* Upwards, the differences would lose digits; the series is short, and downwards is safe. */
        fs_real term = FS_R(1.0) / FS_R(24.0), k = FS_R(5.0);
        phi4 = term;
        while (FS_ABS(term) > FS_DUHEM_LEAST_TERM) {
            term *= x / k;
            phi4 += term;
            k += FS_R(1.0);
        }
        phi3 = x * phi4 + FS_R(1.0) / FS_R(6.0);
        phi2 = x * phi3 + FS_R(0.5);
        phi1 = x * phi2 + FS_R(1.0);
    } else {
        phi1 = FS_EXPM1(x) / x;
        phi2 = (phi1 - FS_R(1.0)) / x;
        phi3 = (phi2 - FS_R(0.5)) / x;
        phi4 = (phi3 - FS_R(1.0) / FS_R(6.0)) / x;
    }
    return y * FS_EXP(x)
           + v * (q0 * phi1 + v * (sign * q1 * phi2 + v * (q2 * phi3 + v * sign * q3 * phi4)));
}

/* The output at u1; memory is updated. */
static inline fs_real fs_duhem_move(const fs_real *p, fs_real *memory, fs_real u1)
{
    fs_real u = memory[0];
    if (!fs_finite(u1))
        return u1 - u1;
    if (u1 != u) {
        fs_real sign = u1 > u ? FS_R(1.0) : -FS_R(1.0);
        memory[1] = fs_duhem_step(p, u, memory[1], sign * (u1 - u), sign);
        memory[0] = u1;
    }
    return memory[1];
}

/* The one piece of the output along the line from memory[0] to u1, where f is straight and g is
 * constant; -1, with memory unchanged, if the output is not finite or the room is too small. */
static inline int fs_duhem_line(const fs_real *p, fs_real *memory, fs_real u1, fs_piece *pieces,
                                int room, fs_real *value)
{
    fs_real u = memory[0], before = memory[1], step = u1 - u, after[2], sign;
    after[0] = u;
    after[1] = before;
    if (room < 1 || !fs_finite(fs_duhem_move(p, after, u1)))
        return -1;
    sign = step > FS_R(0.0) ? FS_R(1.0) : -FS_R(1.0);
    pieces->start = FS_R(0.0);
    /* The output that would follow the curve without an exponential part. */
    pieces->constant =
        step == FS_R(0.0) ? before : p[1] + p[2] * u + sign * (p[5] - p[2]) / p[0];
    pieces->slope = p[2] * step;
    pieces->amplitude = before - pieces->constant;
    pieces->rate = p[0] * FS_ABS(step);
    *value = pieces->constant + pieces->slope;
    if (pieces->amplitude != FS_R(0.0))
        *value += pieces->amplitude * FS_EXP(-pieces->rate);
    memory[0] = after[0];
    memory[1] = after[1];
    return 1;
}

#endif
