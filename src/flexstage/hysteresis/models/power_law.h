/* The exact solution of dg/dv = A - rate g^n, for any exponent n of at least 1.
 *
 * Scaled by G = (A/|rate|)^(1/n) and tau = A v/G it is dx/dtau = 1 - sigma x^n, sigma the sign of
 * the rate: a straight line, an exponential (n = 1), tanh or tan (n = 2), or the inverse of an
 * incomplete beta function, in three series that meet at x^n = exp(-1.1) and exp(1.1). Their
 * coefficients depend on n alone and are tabulated: four rows of FS_POWER_TERMS (powers of z, of
 * p = ln z for sigma = 1 and -1, of 1/z), then FS_POWER_CONSTANTS constants.
 *
 * At most FS_POWER_ROUNDS rounds of an iteration: the time of a call is bounded. Single precision:
 * A/|rate| must be within its range, so exponents of at most about 6 for lengths in metres.
 */
#ifndef FS_POWER_LAW_H
#define FS_POWER_LAW_H

#include "decay.h"

#define FS_POWER_TERMS 38
#define FS_POWER_CONSTANTS 7
#define FS_POWER_TABLE (4 * FS_POWER_TERMS + FS_POWER_CONSTANTS)
#define FS_POWER_ROUNDS 30
#define FS_POWER_EDGE FS_R(1.1)

#ifdef FS_SINGLE
#define FS_TAN tanf
#define FS_TANH tanhf
#define FS_ATAN atanf
#define FS_ATANH atanhf
#define FS_POWER_HUGE 1e15f
#define FS_POWER_CLOSE 1e-4f
#define FS_POWER_CLOSE_LOW 4e-3f
#else
#define FS_TAN tan
#define FS_TANH tanh
#define FS_ATAN atan
#define FS_ATANH atanh
#define FS_POWER_HUGE 1e150     /* a scale beyond which saturation is not felt */
#define FS_POWER_CLOSE 2e-9     /* a correction of Newton after which rounding is left */
#define FS_POWER_CLOSE_LOW 1e-6 /* one of Halley, whose next error is of the third order */
#endif

/* Rows of the table, and its constants: n; n tau at p = 0, -1.1 and 1.1, for each sigma. */
#define FS_POWER_LOW(table) (table)
#define FS_POWER_MIDDLE(table, side) ((table) + (1 + (side)) * FS_POWER_TERMS)
#define FS_POWER_HIGH(table) ((table) + 3 * FS_POWER_TERMS)
#define FS_POWER_N(table) ((table)[4 * FS_POWER_TERMS])
#define FS_POWER_AT_ZERO(table, side) ((table)[4 * FS_POWER_TERMS + 1 + (side)])
#define FS_POWER_AT_LOW(table, side) ((table)[4 * FS_POWER_TERMS + 3 + (side)])
#define FS_POWER_AT_HIGH(table, side) ((table)[4 * FS_POWER_TERMS + 5 + (side)])

/* A power series, odd and even terms apart. */
static inline fs_real fs_power_series(const fs_real *coefficients, fs_real x)
{
    fs_real square = x * x, even = FS_R(0.0), odd = FS_R(0.0);
    int k;
    for (k = FS_POWER_TERMS - 2; k >= 0; k -= 2) {
        even = even * square + coefficients[k];
        odd = odd * square + coefficients[k + 1];
    }
    return even + x * odd;
}

/* n tau between the edges, counted from p = 0. */
static inline fs_real fs_power_middle(fs_real p, fs_real sigma, const fs_real *coefficients)
{
    fs_real smooth = fs_power_series(coefficients, p);
    return sigma < FS_R(0.0) ? smooth : smooth - FS_LOG(FS_ABS(FS_EXPM1(p)));
}

/* (1 - exp(-x))/x and -ln(1 - x)/x. */
static inline fs_real fs_power_relative(fs_real x)
{
    return x != FS_R(0.0) ? fs_grown(x) / x : FS_R(1.0);
}

static inline fs_real fs_power_relative_log(fs_real x)
{
    return x != FS_R(0.0) ? -FS_LOG1P(-x) / x : FS_R(1.0);
}

/* The integral of exp(b q)/(exp(q) - sigma) from start to p, beyond the upper edge. */
static inline fs_real fs_power_beyond(fs_real start, fs_real p, fs_real sigma, const fs_real *table)
{
    fs_real a = FS_R(1.0) - FS_R(1.0) / FS_POWER_N(table);
    fs_real before = FS_EXP(-a * start);
    fs_real first = before * (p - start) * fs_power_relative(a * (p - start));
    fs_real after;
    before *= fs_power_series(FS_POWER_HIGH(table), sigma * FS_EXP(-start));
    after = FS_EXP(-a * p) * fs_power_series(FS_POWER_HIGH(table), sigma * FS_EXP(-p));
    return first + (before - after);
}

/* n tau at x; from x = 0, except above saturation, where only differences count. */
static inline fs_real fs_power_elapsed(fs_real x, fs_real sigma, const fs_real *table)
{
    fs_real n = FS_POWER_N(table), p;
    int side = sigma > FS_R(0.0) ? 0 : 1;
    if (x == FS_R(0.0))
        return FS_R(0.0);
    p = n * FS_LOG(x);
    if (p <= -FS_POWER_EDGE)
        return x * fs_power_series(FS_POWER_LOW(table), sigma * FS_POW(x, n));
    if (p < FS_POWER_EDGE)
        return FS_POWER_AT_ZERO(table, side)
               + fs_power_middle(p, sigma, FS_POWER_MIDDLE(table, side));
    return FS_POWER_AT_HIGH(table, side) - sigma * fs_power_beyond(FS_POWER_EDGE, p, sigma, table);
}

/* x below the lower edge, by Halley's method on x. */
static inline fs_real fs_power_reached_low(fs_real target, fs_real sigma, fs_real guess,
                                           const fs_real *table)
{
    fs_real n = FS_POWER_N(table), tau = target / n, x;
    int round;
    x = FS_R(0.7) * tau <= guess && guess <= FS_R(1.4) * tau ? guess : tau;
    for (round = 0; round < FS_POWER_ROUNDS; round++) {
        fs_real z = FS_POW(x, n);
        fs_real slope = FS_R(1.0) / (FS_R(1.0) - sigma * z);
        fs_real error = x * fs_power_series(FS_POWER_LOW(table), sigma * z) / n - tau;
        fs_real newton = error / slope;
        fs_real correction =
            newton / (FS_R(1.0) - FS_R(0.5) * newton * n * sigma * z * slope / x);
        x -= correction;
        if (FS_ABS(correction) <= FS_POWER_CLOSE_LOW * x)
            break;
    }
    return x;
}

/* x near saturation, by Newton's method on L = -ln|1 - z|; sign -1 above it. */
static inline fs_real fs_power_reached_saturation(fs_real target, fs_real sign, fs_real guess,
                                                  const fs_real *table)
{
    fs_real n = FS_POWER_N(table), a = FS_R(1.0) - FS_R(1.0) / n;
    fs_real remaining = target - FS_POWER_AT_ZERO(table, 0);
    fs_real z = FS_POW(guess, n), gap = sign * (FS_R(1.0) - z), L, p;
    int round;
    L = FS_R(0.0) < gap && gap < FS_R(0.9) ? -FS_LOG(gap) : remaining;
    for (round = 0; round < FS_POWER_ROUNDS; round++) {
        fs_real error, correction;
        L = fs_max(L, sign > FS_R(0.0) ? FS_R(0.2) : -FS_R(1.2));
        p = FS_LOG1P(-sign * FS_EXP(-L));
        error = L + fs_power_series(FS_POWER_MIDDLE(table, 0), p) - remaining;
        correction = error * FS_EXP(a * p);
        L -= correction;
        if (FS_ABS(correction) <= FS_POWER_CLOSE)
            break;
    }
    return FS_EXP(FS_LOG1P(-sign * FS_EXP(-L)) / n);
}

/* x between the edges for sigma = -1, by Newton's method on p. */
static inline fs_real fs_power_reached_middle(fs_real target, fs_real guess, const fs_real *table)
{
    fs_real n = FS_POWER_N(table), p = FS_R(0.0);
    int round;
    if (guess > FS_R(0.0))
        p = fs_min(fs_max(n * FS_LOG(guess), -FS_POWER_EDGE), FS_POWER_EDGE);
    for (round = 0; round < FS_POWER_ROUNDS; round++) {
        fs_real error = FS_POWER_AT_ZERO(table, 1)
                        + fs_power_series(FS_POWER_MIDDLE(table, 1), p) - target;
        fs_real correction = error * (FS_R(1.0) + FS_EXP(p)) * FS_EXP(-p / n);
        p = fs_min(fs_max(p - correction, -FS_R(1.01) * FS_POWER_EDGE),
                   FS_R(1.01) * FS_POWER_EDGE);
        if (FS_ABS(correction) <= FS_POWER_CLOSE)
            break;
    }
    return FS_EXP(p / n);
}

/* x where the integral of fs_power_beyond has the target value; infinite if nowhere.
 * The unknown is E = (1 - exp(-a (p - start)))/a, in which the integral is nearly linear. */
static inline fs_real fs_power_reached_high(fs_real start, fs_real target, fs_real sigma,
                                            const fs_real *table)
{
    fs_real n = FS_POWER_N(table), a = FS_R(1.0) - FS_R(1.0) / n;
    fs_real scale = FS_EXP(-a * start), E = FS_R(0.0), p = start;
    int round;
    for (round = 0; round < FS_POWER_ROUNDS; round++) {
        fs_real error = fs_power_beyond(start, p, sigma, table) - target;
        fs_real correction = error / scale * (FS_R(1.0) - sigma * FS_EXP(-p));
        if (a * (E - correction) >= FS_R(1.0)) {
            /* At E = 1/a the integral has its greatest value; short of it this overshoots. */
            fs_real whole =
                scale
                * (FS_R(1.0) / a + fs_power_series(FS_POWER_HIGH(table), sigma * FS_EXP(-start)));
            if (target >= whole)
                return (fs_real)INFINITY;
            correction = FS_R(0.5) * (E - FS_R(1.0) / a);
        }
        E -= correction;
        p = fs_max(start + E * fs_power_relative_log(a * E), FS_R(0.9) * FS_POWER_EDGE);
        if (FS_ABS(correction) <= FS_POWER_CLOSE * (FS_R(1.0) - a * E))
            break;
    }
    return FS_EXP(p / n);
}

/* x at n tau = target; infinite where the solution has run away before. */
static inline fs_real fs_power_reached(fs_real target, fs_real sigma, int above, fs_real guess,
                                       const fs_real *table)
{
    int side = sigma > FS_R(0.0) ? 0 : 1;
    if (!above && target <= FS_POWER_AT_LOW(table, side))
        return fs_power_reached_low(target, sigma, guess, table);
    if (sigma > FS_R(0.0)) {
        if (above && target < FS_POWER_AT_HIGH(table, 0))
            return fs_power_reached_high(FS_POWER_EDGE, FS_POWER_AT_HIGH(table, 0) - target, sigma,
                                         table);
        return fs_power_reached_saturation(target, above ? -FS_R(1.0) : FS_R(1.0), guess, table);
    }
    if (target >= FS_POWER_AT_HIGH(table, 1))
        return fs_power_reached_high(FS_POWER_EDGE, target - FS_POWER_AT_HIGH(table, 1), sigma,
                                     table);
    return fs_power_reached_middle(target, guess, table);
}

/* The scaled solution for n = 2. */
static inline fs_real fs_power_flow_2(fs_real x, fs_real tau, fs_real sigma)
{
    const fs_real quarter = FS_R(0.5) * FS_R(3.14159265358979323846);
    fs_real t, below, angle;
    if (sigma > FS_R(0.0)) {
        t = FS_TANH(tau);
        below = FS_R(1.0) + x * t;
        return below > FS_R(0.0) ? fs_max((x + t) / below, FS_R(0.0)) : (fs_real)INFINITY;
    }
    angle = FS_ATAN(x) + tau;
    if (angle >= quarter)
        return (fs_real)INFINITY;
    /* The sum of tangents keeps the digits of a large x, which its angle loses. */
    t = FS_TAN(tau);
    below = FS_R(1.0) - x * t;
    if (FS_ABS(tau) < FS_R(1.0) && below > FS_R(0.0))
        return fs_max((x + t) / below, FS_R(0.0));
    return fs_max(FS_TAN(angle), FS_R(0.0));
}

/* The scaled solution for other n. */
static inline fs_real fs_power_flow_n(fs_real x, fs_real tau, fs_real sigma, const fs_real *table)
{
    fs_real n = FS_POWER_N(table), power = FS_R(0.0), target, guess;
    int above = sigma > FS_R(0.0) && x > FS_R(1.0);
    if (x > FS_R(0.0)) {
        fs_real p = n * FS_LOG(x);
        power = FS_EXP(p);
        if (p > FS_POWER_EDGE) {
            /* High up, a distance from 0 or from 1 would drown that from here. */
            fs_real move = -sigma * n * tau;
            if (move >= -fs_power_beyond(FS_POWER_EDGE, p, sigma, table))
                return fs_power_reached_high(p, move, sigma, table);
        }
    }
    target = fs_power_elapsed(x, sigma, table) + n * tau;
    if (target <= FS_R(0.0) && !above)
        return FS_R(0.0);
    guess = fs_max(x + tau * (FS_R(1.0) - sigma * power), FS_R(0.0));
    return fs_power_reached(target, sigma, above, guess, table);
}

/* G, the value at which both terms are of one size. */
static inline fs_real fs_power_scale(fs_real A, fs_real rate, fs_real n)
{
    return rate != FS_R(0.0) ? FS_POW(A / FS_ABS(rate), FS_R(1.0) / n) : (fs_real)INFINITY;
}

/* g after a distance v (below zero: followed back, at most to g = 0), from g at least zero;
 * infinite where it has run away before. The table is not read for n = 1 and n = 2. */
static inline fs_real fs_power_flow(fs_real g, fs_real v, fs_real A, fs_real rate, fs_real n,
                                    const fs_real *table)
{
    fs_real G, x, tau, sigma;
    if (n == FS_R(1.0))
        return fs_max(fs_saturating(g, A, rate, v), FS_R(0.0));
    G = fs_power_scale(A, rate, n);
    if (!(G < FS_POWER_HUGE))
        return fs_max(g + A * v, FS_R(0.0));
    x = g / G;
    tau = A * v / G;
    sigma = rate > FS_R(0.0) ? FS_R(1.0) : -FS_R(1.0);
    if (n == FS_R(2.0))
        return G * fs_power_flow_2(x, tau, sigma);
    if (sigma > FS_R(0.0) && x == FS_R(1.0))
        return g;
    return G * fs_power_flow_n(x, tau, sigma, table);
}

/* The distance in which w falls to zero, dw/dv = -(A - rate w^n); infinite where it does not. */
static inline fs_real fs_power_time_to_zero(fs_real w, fs_real A, fs_real rate, fs_real n,
                                            const fs_real *table)
{
    fs_real G, x;
    if (n == FS_R(1.0))
        return fs_distance_to_zero(w, A, rate);
    G = fs_power_scale(A, rate, n);
    if (!(G < FS_POWER_HUGE))
        return w / A;
    x = w / G;
    if (rate > FS_R(0.0) && x >= FS_R(1.0))
        return (fs_real)INFINITY;
    if (n == FS_R(2.0))
        return G / A * (rate > FS_R(0.0) ? FS_ATANH(x) : FS_ATAN(x));
    return G / A
           * (fs_power_elapsed(x, rate > FS_R(0.0) ? FS_R(1.0) : -FS_R(1.0), table) / n);
}

#endif
