/* The exponential approach to a limit, dg/dv = slope - rate g.
 *
 * The same operations as flexstage itself, in the same order: results are the same bits in double
 * precision. Single precision: to some units in the last place of the larger of value and limit.
 */
#ifndef FS_DECAY_H
#define FS_DECAY_H

#include "real.h"

/* ln 2 in two parts, of which multiples of the first are exact (Cody, Waite 1980). */
#ifdef FS_SINGLE
#define FS_LN2_HIGH 0.693359375f
#define FS_LN2_LOW (-2.12194440e-4f)
#else
#define FS_LN2_HIGH 6.93147180369123816490e-01
#define FS_LN2_LOW 1.90821492927058770002e-10
#endif

/* Comparisons keep the first number where one of the two is not a number. */
static inline fs_real fs_max(fs_real a, fs_real b) { return b > a ? b : a; }
static inline fs_real fs_min(fs_real a, fs_real b) { return b < a ? b : a; }

/* A number, and not infinite. */
static inline int fs_finite(fs_real x) { return x - x == FS_R(0.0); }

/* 1 - exp(-x) for x at least zero: -x = -k ln 2 + r, and a polynomial for exp(r) - 1. */
static inline fs_real fs_decayed(fs_real x)
{
    fs_real k, r, p, scale;
    if (!(x == x))
        return x;
    x = fs_min(x, FS_R(1e3));
    k = FS_FLOOR(x * (FS_R(1.0) / FS_R(0.69314718055994530942)) + FS_R(0.5));
    k = fs_min(k, FS_R(62.0));
    r = fs_max((k * FS_LN2_HIGH - x) + k * FS_LN2_LOW, -FS_R(1.0));
    p = FS_R(1.0) / FS_R(479001600.0) + r * (FS_R(1.0) / FS_R(6227020800.0));
    p = FS_R(1.0) / FS_R(39916800.0) + r * p;
    p = FS_R(1.0) / FS_R(3628800.0) + r * p;
    p = FS_R(1.0) / FS_R(362880.0) + r * p;
    p = FS_R(1.0) / FS_R(40320.0) + r * p;
    p = FS_R(1.0) / FS_R(5040.0) + r * p;
    p = FS_R(1.0) / FS_R(720.0) + r * p;
    p = FS_R(1.0) / FS_R(120.0) + r * p;
    p = FS_R(1.0) / FS_R(24.0) + r * p;
    p = FS_R(1.0) / FS_R(6.0) + r * p;
    p = FS_R(0.5) + r * p;
    p = r + r * r * p;
    scale = FS_R(1.0) / (fs_real)(1LL << (int)k);
    return (FS_R(1.0) - scale) - scale * p;
}

/* 1 - exp(-x) for any x. */
static inline fs_real fs_grown(fs_real x)
{
    return x >= FS_R(0.0) ? fs_decayed(x) : -FS_EXPM1(-x);
}

/* g after a distance. */
static inline fs_real fs_saturating(fs_real start, fs_real slope, fs_real rate, fs_real distance)
{
    fs_real x = rate * distance;
    if (x == FS_R(0.0))
        return start + slope * distance;
    return start + (slope - rate * start) * (distance * (fs_grown(x) / x));
}

/* The distance in which w falls to zero, dw/dv = -(slope - rate w); infinite where it does not. */
static inline fs_real fs_distance_to_zero(fs_real start, fs_real slope, fs_real rate)
{
    fs_real x = -rate * start / slope;
    if (x <= -FS_R(1.0))
        return (fs_real)INFINITY;
    return start / slope * (x == FS_R(0.0) ? FS_R(1.0) : FS_LOG1P(x) / x);
}

#endif
