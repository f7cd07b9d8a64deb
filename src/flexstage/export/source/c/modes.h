/* Modes under a force that is known between the samples: exact for lines and exponentials.
 *
 * Time is in samples: a mode is z'' + 2 zeta W z' + W^2 z = W^2 f with W the angle
 * [rad] that the undamped mode turns in a step, so that z settles at f.
 */
#ifndef FS_MODES_H
#define FS_MODES_H

#include "model_data.h"
#include "piece.h"
#include "real.h"

/* Largest number of derivatives of an exponential in a full step, and the largest rate
 * [per sample] for which they suffice. */
#define FS_ORDERS 12
#define FS_LARGEST_RATE FS_R(0.5)
/* Modes with larger damping have no closed form over a piece of a step. */
#define FS_MUCH_DAMPED FS_R(0.9)
/* Fastest exponential [per sample] that is accepted, so that the time of a step is bounded. */
#define FS_FASTEST FS_R(2000.0)

typedef struct {
    fs_real frequency_hz[FS_MODES]; /* undamped, drives in place [Hz] */
    fs_real damping_ratio[FS_MODES];
    /* computed by fs_prepare: */
    fs_real angle[FS_MODES];                  /* W [rad] */
    fs_real own[FS_MODES], damped[FS_MODES];  /* W^2 (1 - zeta^2) and its root; 1 if overdamped */
    fs_real transition[4][FS_MODES];          /* from (z, z') to (z, z'): zz, zv, vz, vv */
    fs_real moments[FS_ORDERS + 1][FS_MODES]; /* row j: the force's derivative j to z' */
} fs_modes;

/* Values of each mode for pieces of a step. */
static inline void fs_modes_swing(fs_modes *modes)
{
    int m;
    for (m = 0; m < FS_MODES; m++) {
        const fs_real w = modes->angle[m], zeta = modes->damping_ratio[m];
        const int much = !(zeta <= FS_MUCH_DAMPED);
        modes->own[m] = much ? FS_R(1.0) : w * w * (FS_R(1.0) - zeta * zeta);
        modes->damped[m] = FS_SQRT(modes->own[m]);
    }
}

/* Number of derivatives that full steps need for the fastest exponential of the pieces. */
static inline int fs_terms_needed(const fs_piece *pieces, int count)
{
    fs_real fastest = FS_R(0.0), size = FS_R(1.0);
    int terms = 2, i;
    for (i = 0; i < count; i++) {
        const fs_real rate = FS_ABS(pieces[i].rate);
        if (pieces[i].amplitude != FS_R(0.0) && rate <= FS_LARGEST_RATE && rate > fastest)
            fastest = rate;
    }
    while (terms < FS_ORDERS && size > FS_R(1e-18)) {
        size *= fastest / ((fs_real)terms + FS_R(2.0));
        terms += 1;
    }
    return terms;
}

/* Power series in the share of a short piece d: force f0 + f1 x + c (exp(-mu x) - 1 + mu x). */
static inline void fs_mode_series(fs_real *z, fs_real *v, fs_real turn, fs_real zeta, fs_real d,
                                  fs_real f0, fs_real f1, fs_real c, fs_real mu)
{
    fs_real low = *z, high = *v * d;
    fs_real at = low + high, speed = high, term = c;
    int j;
    for (j = 0; j < 18; j++) {
        const fs_real n = (fs_real)j;
        const fs_real force = j == 0 ? f0 : j == 1 ? f1 : term;
        const fs_real following =
            (turn * turn * (force - low) - FS_R(2.0) * zeta * turn * (n + FS_R(1.0)) * high) /
            ((n + FS_R(1.0)) * (n + FS_R(2.0)));
        at += following;
        speed += (n + FS_R(2.0)) * following;
        low = high;
        high = following;
        term *= -mu / (n + FS_R(1.0));
    }
    *z = at;
    *v = speed / d;
}

/* One mode after a piece h of a step, under the force a + b s + c exp(-mu s), by power series. */
static inline void fs_mode_short(fs_real *z, fs_real *v, fs_real w, fs_real zeta, fs_real h,
                                 fs_real a, fs_real b, fs_real c, fs_real mu)
{
    const fs_real stiff = w * (FS_R(2.0) * zeta > FS_R(1.0) ? FS_R(2.0) * zeta : FS_R(1.0));
    const fs_real fast = FS_ABS(mu);
    int parts = (int)FS_CEIL((fast > stiff ? fast : stiff) * h / FS_R(0.5)), i;
    fs_real d;
    if (parts < 1)
        parts = 1;
    d = h / (fs_real)parts;
    for (i = 0; i < parts; i++) {
        fs_mode_series(z, v, w * d, zeta, d, a + c, (b - mu * c) * d, c, mu * d);
        a += b * d;
        c *= FS_EXP(-mu * d);
    }
}

/* Whether a mode turns enough in a piece h of a step for the closed form, and is not damped much. */
static inline int fs_mode_swings(const fs_modes *modes, int m, fs_real h)
{
    return modes->damping_ratio[m] <= FS_MUCH_DAMPED && modes->angle[m] * h >= FS_R(0.5);
}

/* All modes after a piece h of a step, under the force a + b s + c exp(-mu s). */
static inline void fs_modes_piece(const fs_modes *modes, fs_real *z, fs_real *v, fs_real h,
                                  fs_real a, fs_real b, fs_real c, fs_real mu)
{
    const fs_real left = FS_EXP(-mu * h);
    fs_real fall[FS_MODES], cosine[FS_MODES], sine[FS_MODES];
    fs_real at[FS_MODES], rate[FS_MODES];
    int m;
    for (m = 0; m < FS_MODES; m++) {
        fall[m] = cosine[m] = sine[m] = FS_R(0.0);
        if (fs_mode_swings(modes, m, h)) {
            const fs_real decay = modes->damping_ratio[m] * modes->angle[m];
            const fs_real turn = modes->damped[m] * h;
            fall[m] = FS_EXP(-decay * h);
            cosine[m] = FS_COS(turn);
            sine[m] = FS_SIN(turn);
        }
    }
    /* closed form: particular solution, and oscillation about it */
    for (m = 0; m < FS_MODES; m++) {
        const fs_real w = modes->angle[m], zeta = modes->damping_ratio[m];
        const fs_real decay = zeta * w;
        const fs_real offset = a - FS_R(2.0) * zeta * b / w;
        const fs_real held = c * w * w / ((mu - decay) * (mu - decay) + modes->own[m]);
        const fs_real away = z[m] - offset - held, speed = v[m] - b + mu * held;
        const fs_real co = fall[m] * cosine[m], si = fall[m] * sine[m] / modes->damped[m];
        const fs_real later = held * left;
        at[m] = offset + b * h + later + (co + decay * si) * away + si * speed;
        rate[m] = b - mu * later - w * w * si * away + (co - decay * si) * speed;
    }
    for (m = 0; m < FS_MODES; m++) {
        if (fs_mode_swings(modes, m, h)) {
            z[m] = at[m];
            v[m] = rate[m];
        } else {
            fs_mode_short(&z[m], &v[m], modes->angle[m], modes->damping_ratio[m], h, a, b, c, mu);
        }
    }
}

/* All modes over a full step under the force a + b s + c exp(-mu s). */
static inline void fs_modes_whole(const fs_modes *modes, fs_real *z, fs_real *v, int terms,
                                  fs_real a, fs_real b, fs_real c, fs_real mu)
{
    fs_real by_z[FS_MODES];
    int m, j;
    if (c != FS_R(0.0)) {
        /* derivatives of the exponential, by Horner; highest first */
        for (m = 0; m < FS_MODES; m++)
            by_z[m] = modes->moments[terms][m];
        for (j = terms - 1; j > 2; j -= 3)
            for (m = 0; m < FS_MODES; m++)
                by_z[m] = modes->moments[j - 2][m] -
                          mu * (modes->moments[j - 1][m] -
                                mu * (modes->moments[j][m] - mu * by_z[m]));
        for (; j > 0; j--)
            for (m = 0; m < FS_MODES; m++)
                by_z[m] = modes->moments[j][m] - mu * by_z[m];
    } else {
        for (m = 0; m < FS_MODES; m++)
            by_z[m] = FS_R(0.0);
    }
    for (m = 0; m < FS_MODES; m++) {
        const fs_real by_v = modes->moments[0][m] - mu * by_z[m];
        const fs_real at = z[m], speed = v[m];
        z[m] = (modes->transition[0][m] * at + modes->transition[1][m] * speed) +
               (modes->moments[1][m] * a + modes->moments[2][m] * b + c * by_z[m]);
        v[m] = (modes->transition[2][m] * at + modes->transition[3][m] * speed) +
               (modes->moments[0][m] * a + modes->moments[1][m] * b + c * by_v);
    }
}

/* All modes over a step with a piecewise force. */
static inline void fs_modes_through(const fs_modes *modes, fs_real *z, fs_real *v,
                                    const fs_piece *pieces, int count)
{
    const int terms = fs_terms_needed(pieces, count);
    fs_real here = FS_R(0.0);
    int i = 0;
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
        if (end - here == FS_R(1.0) && (c == FS_R(0.0) || FS_ABS(mu) <= FS_LARGEST_RATE))
            fs_modes_whole(modes, z, v, terms, a, b, c, mu);
        else
            fs_modes_piece(modes, z, v, end - here, a, b, c, mu);
        here = end;
    }
}

/* All modes over a straight line from w to w + rise, with its rate. */
static inline void fs_modes_along_line(const fs_modes *modes, fs_real *z, fs_real *v,
                                       const fs_real *by_rate, fs_real w, fs_real rise)
{
    int m;
    for (m = 0; m < FS_MODES; m++) {
        /* the rate is constant within each step */
        const fs_real start = w + by_rate[m] * rise;
        const fs_real at = z[m], speed = v[m];
        z[m] = (modes->transition[0][m] * at + modes->transition[1][m] * speed) +
               (modes->moments[1][m] * start + modes->moments[2][m] * rise);
        v[m] = (modes->transition[2][m] * at + modes->transition[3][m] * speed) +
               (modes->moments[0][m] * start + modes->moments[1][m] * rise);
    }
}

#endif
