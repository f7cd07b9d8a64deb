/* Motions dg/dv = A - psi |g|^n, for any exponent n of at least 1.
 *
 * For n = 1 an exponential. For other n a motion is summed as power series, each as far as it
 * converges to rounding: in the distance from where g is, or, as |g|^n has no such series at g = 0,
 * in the power n of the distance from zero. The same operations as flexstage itself, in the same
 * order.
 *
 * At most FS_POWER_STEPS series: the time of a call is bounded. Single precision: A/|psi| must be
 * within its range, so exponents of at most about 6 for lengths in metres.
 */
#ifndef FS_POWER_LAW_H
#define FS_POWER_LAW_H

#include "decay.h"

#define FS_POWER_TERMS 24
#define FS_POWER_STEPS 20000
/* psi |g|^n/A up to which the series from zero is taken, and to which it leads. */
#define FS_POWER_LOW FS_R(0.1)
#define FS_POWER_LOW_END FS_R(0.2)

#ifdef FS_SINGLE
#define FS_POWER_HUGE 1e15f
#define FS_POWER_ROUNDING 1e-8f
#define FS_POWER_SATURATED 3e-4f
#else
#define FS_POWER_HUGE 1e150      /* a scale beyond which saturation is not felt */
#define FS_POWER_ROUNDING 1e-17  /* a term, as part of the first, that is below its rounding */
#define FS_POWER_SATURATED 1e-9  /* of A, a slope that falls exponentially */
#endif

/* The terms at x = 1 of the solution u of first (u - 1) + step x u' = slope x - factor x u^n, u = 1
 * at x = 0; how many there are: FS_POWER_TERMS where they do not converge. Those of the power are
 * q_k = sum of ((n + 1) j/k - 1) a_j q_(k-j) over j = 1..k (J. C. P. Miller). */
static inline int fs_power_coefficients(fs_real slope, fs_real factor, fs_real first, fs_real step,
                                        fs_real n, fs_real *a)
{
    fs_real q[FS_POWER_TERMS + 1];
    int k, j;
    a[0] = q[0] = FS_R(1.0);
    for (k = 1; k <= FS_POWER_TERMS; k++) {
        fs_real total = FS_R(0.0);
        a[k] = ((k == 1 ? slope : FS_R(0.0)) - factor * q[k - 1]) / (first + step * (fs_real)k);
        if (FS_ABS(a[k]) < FS_POWER_ROUNDING && FS_ABS(a[k - 1]) < FS_POWER_ROUNDING)
            return k;
        for (j = 1; j <= k; j++)
            total += ((n + FS_R(1.0)) / (fs_real)k * (fs_real)j - FS_R(1.0)) * a[j] * q[k - j];
        q[k] = total;
    }
    return FS_POWER_TERMS;
}

/* The x of at most one up to which the last two terms are below rounding. */
static inline fs_real fs_power_converged(const fs_real *a, int terms)
{
    const fs_real count = (fs_real)terms;
    const fs_real before = FS_POW(FS_ABS(a[terms - 1]), count / (count - FS_R(1.0)));
    const fs_real last = FS_ABS(a[terms]) > before ? FS_ABS(a[terms]) : before;
    return last > FS_POWER_ROUNDING ? FS_POW(FS_POWER_ROUNDING / last, FS_R(1.0) / count)
                                    : FS_R(1.0);
}

/* The sum of all terms but the first at x. */
static inline fs_real fs_power_tail(const fs_real *a, int terms, fs_real x)
{
    fs_real total = FS_R(0.0);
    int k;
    for (k = terms; k > 0; k--)
        total = (total + a[k]) * x;
    return total;
}

/* g after a distance near zero, and what is left of the distance. With t the distance from zero,
 * times A, |g| = t f(psi t^n/A). */
static inline fs_real fs_power_from_zero(fs_real s, fs_real w, fs_real *v, fs_real A, fs_real psi,
                                         fs_real n, fs_real power)
{
    fs_real a[FS_POWER_TERMS + 1], share = FS_R(1.0), term = FS_R(1.0);
    fs_real t, end, reach, left = FS_R(0.0);
    int k, terms;
    for (k = 1; FS_ABS(term) > FS_POWER_ROUNDING; k++) {
        term *= power;
        share += term / (FS_R(1.0) + n * (fs_real)k);
    }
    t = w * share;
    if (s < FS_R(0.0) && A * *v >= t) {
        *v = fs_max(*v - t / A, FS_R(0.0));
        return FS_R(0.0);
    }
    end = t + s * A * *v;
    reach = FS_POW(FS_POWER_LOW_END * A / FS_ABS(psi), FS_R(1.0) / n);
    if (end > reach) {
        end = reach;
        left = fs_max(*v - (reach - t) / A, FS_R(0.0));
    }
    *v = left;
    terms = fs_power_coefficients(FS_R(0.0), psi * FS_POW(end, n) / A, FS_R(1.0), n, n, a);
    return s * (end + end * fs_power_tail(a, terms, FS_R(1.0)));
}

/* g after a distance v, with psi of unloading where g is below zero and of loading where it is not;
 * infinite if it diverges before. */
static inline fs_real fs_power_moved(fs_real g, fs_real v, fs_real A, fs_real unloaded,
                                     fs_real loaded, fs_real n)
{
    fs_real a[FS_POWER_TERMS + 1], s = FS_R(1.0);
    int step;
    if (n == FS_R(1.0)) {
        fs_real zero = g < FS_R(0.0) ? fs_distance_to_zero(-g, A, unloaded) : FS_R(0.0);
        /* Unloading is loading, with the rate of unloading, followed back. */
        if (v < zero)
            return -fs_max(fs_saturating(-g, A, unloaded, -v), FS_R(0.0));
        return fs_saturating(fs_max(g, FS_R(0.0)), A, loaded, v - zero);
    }
    for (step = 0; step < FS_POWER_STEPS; step++) {
        fs_real psi = g < FS_R(0.0) ? unloaded : loaded, w = FS_ABS(g), power;
        if (v == FS_R(0.0))
            return g;
        s = g < FS_R(0.0) ? -FS_R(1.0) : FS_R(1.0);
        power = psi * FS_POW(w, n) / A;
        if (!(FS_ABS(power) < FS_POWER_HUGE))
            break;
        if (FS_ABS(power) < FS_POWER_LOW && A * v >= FS_R(0.1) * w) {
            g = fs_power_from_zero(s, w, &v, A, psi, n, power);
        } else if (s > FS_R(0.0) && FS_ABS(FS_R(1.0) - power) < FS_POWER_SATURATED) {
            return g - w * (FS_R(1.0) - power) / n * FS_EXPM1(-n * A * v / w);
        } else if (power == FS_R(1.0)) {
            return g;
        } else {
            /* An unloading step stays short of zero. */
            const fs_real reach = s > FS_R(0.0) ? FS_R(4.0) : FS_R(0.5);
            const fs_real h = fs_min(v, reach * w / (A * (FS_R(1.0) + FS_ABS(power))));
            const fs_real across = s * A * h / w;
            const int terms =
                fs_power_coefficients(across, across * power, FS_R(0.0), FS_R(1.0), n, a);
            const fs_real share = fs_power_converged(a, terms);
            g += g * fs_power_tail(a, terms, share);
            v = h < v || share < FS_R(1.0) ? v - share * h : FS_R(0.0);
        }
    }
    return s * (fs_real)INFINITY;
}

#endif
