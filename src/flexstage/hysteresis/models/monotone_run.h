/* The Bouc-Wen equation with exponent 1 along one straight line, in its explicit form.
 *
 * Single precision: as in shape_law.h, small steps in a row lose digits of h.
 */
#ifndef FS_MONOTONE_RUN_H
#define FS_MONOTONE_RUN_H

#include "decay.h"

/* The output gain u - h after a distance from the origin of an exponential, where g is given. */
static inline fs_real fs_run_output(fs_real u, fs_real origin, fs_real s, fs_real gain, fs_real g,
                                    fs_real A, fs_real rate)
{
    /* Rounding may put the input before the origin by one unit in the last place. */
    fs_real v = fs_max(s * (u - origin), FS_R(0.0));
    if (rate > FS_R(0.0)) {
        fs_real span = s * ((A - rate * g) / rate);
        return gain * u - (s * g + span * fs_decayed(rate * v));
    }
    return gain * u - s * fs_saturating(g, A, rate, v);
}

/* The output at u1; memory, the input and h, is updated. */
static inline fs_real fs_run_move(fs_real gain, fs_real A, fs_real beta, fs_real gamma,
                                  fs_real *memory, fs_real u1)
{
    fs_real u = memory[0], h = memory[1], s, g, length, zero = FS_R(0.0), value;
    if (!fs_finite(u1))
        return u1 - u1;
    if (u1 == u)
        return gain * u1 - h;
    s = u1 > u ? FS_R(1.0) : -FS_R(1.0);
    g = s * h;
    length = s * (u1 - u);
    if (g < FS_R(0.0))
        zero = fs_distance_to_zero(-g, A, gamma - beta);
    if (g < FS_R(0.0) && length < zero) {
        value = fs_run_output(u1, u, s, gain, g, A, beta - gamma);
        h = s * fs_saturating(g, A, beta - gamma, length);
    } else {
        g = fs_max(g, FS_R(0.0));
        value = fs_run_output(u1, u + s * zero, s, gain, g, A, beta + gamma);
        h = s * fs_saturating(g, A, beta + gamma, length - zero);
    }
    memory[0] = u1;
    memory[1] = h;
    return value;
}

#endif
