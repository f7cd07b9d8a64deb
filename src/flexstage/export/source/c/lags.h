/* First-order lags of the creep for an input that is known between the samples. */
#ifndef FS_LAGS_H
#define FS_LAGS_H

#include "modes.h"
#include "piece.h"
#include "real.h"

typedef struct {
    fs_real ratio[FS_LAGS_MAX];              /* step over time constant */
    fs_real decay[FS_LAGS_MAX];              /* decay over a step */
    fs_real moments[FS_ORDERS][FS_LAGS_MAX]; /* row j: the input's derivative j to the lag */
} fs_lags;

/* A piece h of a step, of one lag, under the input a + b s + c exp(-mu s). */
static inline fs_real fs_lag_piece(fs_real lag, fs_real r, fs_real h, fs_real a, fs_real b,
                                   fs_real c, fs_real mu)
{
    const fs_real x = r * h;
    const fs_real gone = -FS_EXPM1(-x);
    fs_real share, apart, ratio, by_c;
    int k;
    if (x < FS_R(1.0)) {
        share = FS_R(0.0);
        for (k = 18; k > 0; k--)
            share = x / ((fs_real)k + FS_R(1.0)) * (FS_R(1.0) - share);
    } else {
        share = FS_R(1.0) - gone / x;
    }
    /* exp(-mu h) - exp(-r h) over r - mu, which are equal now and then */
    apart = (r - mu) * h;
    ratio = apart != FS_R(0.0) ? -FS_EXPM1(-apart) / apart : FS_R(1.0);
    by_c = c * r * h * FS_EXP(-mu * h) * ratio;
    return (FS_R(1.0) - gone) * lag + a * gone + b * h * share + by_c;
}

/* A lag after a full step, with `by` as the contribution of the input. In single precision the step
 * of a slow lag is below its last digit: the rounding error is carried
 * (W. Kahan, Communications of the ACM 8 (1965) 40). */
static inline void fs_lag_add(const fs_lags *lags, int m, fs_real *lag, fs_real *rest, fs_real by)
{
#ifdef FS_SINGLE
    const fs_real change = (by - lags->moments[0][m] * *lag) - *rest;
    const fs_real sum = *lag + change;
    *rest = (sum - *lag) - change;
    *lag = sum;
#else
    (void)rest;
    *lag = lags->decay[m] * *lag + by;
#endif
}

/* All lags over a step with a piecewise input. */
static inline void fs_lags_through(const fs_lags *lags, int size, fs_real *lag, fs_real *rest,
                                   const fs_piece *pieces, int count)
{
    const int terms = fs_terms_needed(pieces, count);
    fs_real here = FS_R(0.0);
    int i = 0, m, j;
    while (here < FS_R(1.0)) {
        fs_real end = FS_R(1.0), since, a, b, c, mu;
        while (i < count - 1 && pieces[i + 1].start <= here)
            i++;
        if (i < count - 1 && pieces[i + 1].start < end)
            end = pieces[i + 1].start;
        since = here - pieces[i].start;
        a = pieces[i].constant + pieces[i].slope * since;
        b = pieces[i].slope;
        c = pieces[i].amplitude;
        mu = pieces[i].rate;
        if (since != FS_R(0.0) && c != FS_R(0.0))
            c *= FS_EXP(-mu * since);
        if (end - here == FS_R(1.0) && (c == FS_R(0.0) || FS_ABS(mu) <= FS_LARGEST_RATE)) {
            fs_real part[FS_LAGS_MAX];
            for (m = 0; m < size; m++)
                part[m] = FS_R(0.0);
            if (c != FS_R(0.0))
                for (j = terms - 1; j >= 0; j--)
                    for (m = 0; m < size; m++)
                        part[m] = lags->moments[j][m] - mu * part[m];
            for (m = 0; m < size; m++)
                fs_lag_add(lags, m, &lag[m], &rest[m],
                           lags->moments[0][m] * a + lags->moments[1][m] * b + c * part[m]);
        } else {
            for (m = 0; m < size; m++)
                lag[m] = fs_lag_piece(lag[m], lags->ratio[m], end - here, a, b, c, mu);
        }
        here = end;
    }
}

#endif
