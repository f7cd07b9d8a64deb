/* Exact steps of an amplifier with one pole, limited slew rate and limited range.
 *
 * Time is in time constants, so that u' = c - u, limited to a threshold. Between two samples the
 * command c is a straight line; the transitions between following, slewing and saturation are
 * solved for.
 */
#ifndef FS_AMPLIFIER_H
#define FS_AMPLIFIER_H

#include "real.h"

enum { FS_FOLLOWING, FS_SLEWING, FS_AT_END };

/* 1/4! - t/5! + t^2/6! - ... */
static inline fs_real fs_amplifier_tail(fs_real t)
{
    fs_real total = FS_R(0.0);
    int k;
    for (k = 12; k > 4; k--)
        total = (FS_R(1.0) - total * t) / (fs_real)k;
    return (FS_R(1.0) - total * t) / FS_R(24.0);
}

/* Output after following a line for a time t, with initial error e. */
static inline fs_real fs_amplifier_follow(fs_real u, fs_real e, fs_real slope, fs_real t)
{
    const fs_real gone = -FS_EXPM1(-t);
    /* slope (t - gone) + e gone, by a series where t - gone would cancel */
    const fs_real ramp =
        t > FS_R(0.1)
            ? t - gone
            : t * t * (FS_R(0.5) - t * (FS_R(1.0) / FS_R(6.0) - t * fs_amplifier_tail(t)));
    return u + e * gone + slope * ramp;
}

/* Time at which the output reaches the end of its range, by bisection. */
static inline fs_real fs_amplifier_meet(fs_real u, fs_real e, fs_real slope, fs_real start,
                                        fs_real end, fs_real rail)
{
    const int rising = fs_amplifier_follow(u, e, slope, end) > rail;
    int i;
    for (i = 0; i < 200; i++) {
        const fs_real middle = FS_R(0.5) * (start + end);
        if (middle == start || middle == end)
            break;
        if ((fs_amplifier_follow(u, e, slope, middle) > rail) == rising)
            end = middle;
        else
            start = middle;
    }
    return end;
}

/* Output after a time h; c is command times gain, u the output before. */
static inline fs_real fs_amplifier_step(fs_real c, fs_real slope, fs_real u, fs_real h,
                                        fs_real threshold, fs_real low, fs_real high)
{
    const fs_real never = (fs_real)INFINITY;
    fs_real e = c - u;
    int mode, following, change;
    if ((u >= high && e > FS_R(0.0)) || (u <= low && e < FS_R(0.0)))
        mode = FS_AT_END;
    else
        mode = FS_ABS(e) > threshold ? FS_SLEWING : FS_FOLLOWING;
    /* within a step no mode is entered twice from the same one */
    for (change = 0; change < 16; change++) {
        fs_real s, t, rail;
        e = c - u;
        s = e > FS_R(0.0) || (e == FS_R(0.0) && slope > FS_R(0.0)) ? FS_R(1.0) : FS_R(-1.0);
        if (mode == FS_AT_END) {
            t = s * slope >= FS_R(0.0) ? never : FS_ABS(e / slope);
            following = FS_FOLLOWING;
            if (t >= h)
                return u;
            c = u;
        } else if (mode == FS_SLEWING) {
            const fs_real closing = threshold - s * slope;
            t = closing > FS_R(0.0) ? (FS_ABS(e) - threshold) / closing : never;
            rail = (s > FS_R(0.0) ? high - u : u - low) / threshold;
            following = t <= rail ? FS_FOLLOWING : FS_AT_END;
            t = rail < t ? rail : t;
            if (t >= h)
                return u + s * threshold * h;
            c += slope * t;
            u = following == FS_AT_END ? (s > FS_R(0.0) ? high : low) : c - s * threshold;
        } else {
            const fs_real side = slope > FS_R(0.0) ? FS_R(1.0) : FS_R(-1.0);
            fs_real end, turn, early;
            t = never;
            if (FS_ABS(slope) > threshold) {
                t = FS_LOG((slope - e) / (slope - side * threshold));
                t = t > FS_R(0.0) ? t : FS_R(0.0);
            }
            t = h < t ? h : t;
            following = FS_SLEWING;
            end = fs_amplifier_follow(u, e, slope, t);
            /* the output turns at most once, and may reach an end of the range before */
            turn = e * slope < FS_R(0.0) ? FS_LOG1P(-e / slope) : never;
            early = turn < t ? fs_amplifier_follow(u, e, slope, turn) : end;
            if (early > high || early < low) {
                rail = early > high ? high : low;
                t = fs_amplifier_meet(u, e, slope, FS_R(0.0), t < turn ? t : turn, rail);
                following = FS_AT_END;
                u = rail;
            } else if (end > high || end < low) {
                rail = end > high ? high : low;
                t = fs_amplifier_meet(u, e, slope, turn < t ? turn : FS_R(0.0), t, rail);
                following = FS_AT_END;
                u = rail;
            } else if (t >= h) {
                return end;
            } else {
                u = end;
            }
            c += slope * t;
            if (following == FS_AT_END && t >= h)
                return u;
        }
        h -= t;
        mode = following;
    }
    return u;
}

#endif
