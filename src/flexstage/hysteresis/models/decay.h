/* The exponential approach to a limit, dg/dv = slope - rate g.
 *
 * The same operations as flexstage itself, in the same order: results are the same bits in double
 * precision. Single precision: to some units in the last place of the larger of value and limit.
 */
#ifndef FS_DECAY_H
#define FS_DECAY_H

#include "real.h"

/* Comparisons keep the first number where one of the two is not a number. */
static inline fs_real fs_max(fs_real a, fs_real b) { return b > a ? b : a; }
static inline fs_real fs_min(fs_real a, fs_real b) { return b < a ? b : a; }

/* A number, and not infinite. */
static inline int fs_finite(fs_real x) { return x - x == FS_R(0.0); }

/* g after a distance. */
static inline fs_real fs_saturating(fs_real start, fs_real slope, fs_real rate, fs_real distance)
{
    fs_real x = rate * distance;
    if (x == FS_R(0.0))
        return start + slope * distance;
    return start + (slope - rate * start) * (distance * (-FS_EXPM1(-x) / x));
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
