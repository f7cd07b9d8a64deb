/* The equation of the Bouc-Wen family, dh/du = A - psi |h|^n, along straight lines of the input.
 *
 * psi depends on the direction of u, on whether h is loaded (of the sign of u') and on which side
 * of a centre u lies. Between the changes of sign the motion is a flow of the power law; lines are
 * split exactly where h passes zero and where u passes the centre.
 *
 * Single precision: each step rounds h, so small steps du in a row, all one way, may put the slope
 * dh/du off by up to 3e-8 |h|/(A du) of itself; steps of 1e-5 of the range of u keep it within 1 %.
 */
#ifndef FS_SHAPE_LAW_H
#define FS_SHAPE_LAW_H

#include "piece.h"
#include "power_law.h"

#ifdef FS_SINGLE
#define FS_LEAST_RATE 5e-3f
#else
#define FS_LEAST_RATE 1e-5
#endif

/* psi for (u falls, rises) by (h unloaded, loaded) by (u below, above the centre). */
typedef struct {
    fs_real A, n, centre, psi[8];
} fs_law;

/* The law psi = gamma + beta sign(u' h), which has no centre. */
static inline fs_law fs_classical_law(fs_real A, fs_real beta, fs_real gamma, fs_real n)
{
    fs_law law;
    int k;
    law.A = A;
    law.n = n;
    law.centre = -(fs_real)INFINITY;
    for (k = 0; k < 8; k++)
        law.psi[k] = k & 2 ? gamma + beta : gamma - beta;
    return law;
}

/* Where psi stands for unloading; that for loading is two places further. */
static inline int fs_law_branch(fs_real s, int upper)
{
    return (s > FS_R(0.0) ? 4 : 0) + (upper ? 1 : 0);
}

/* On which side of the centre a motion from u begins. */
static inline int fs_law_upper(const fs_law *law, fs_real u, fs_real s)
{
    return s > FS_R(0.0) ? u >= law->centre : u > law->centre;
}

/* h after a distance on one side of the centre. */
static inline fs_real fs_law_one_side(const fs_law *law, fs_real h, fs_real s, fs_real v, int upper)
{
    int at = fs_law_branch(s, upper);
    return s * fs_power_moved(s * h, v, law->A, law->psi[at], law->psi[at + 2], law->n);
}

/* h after the input has gone from u by du; not finite if it grows without limit. */
static inline fs_real fs_law_advance(const fs_law *law, fs_real h, fs_real u, fs_real du)
{
    fs_real s, v, until, stretch;
    int upper;
    if (du == FS_R(0.0))
        return h;
    s = du > FS_R(0.0) ? FS_R(1.0) : -FS_R(1.0);
    v = s * du;
    upper = fs_law_upper(law, u, s);
    until = s * (law->centre - u);
    if (!(FS_R(0.0) < until && until < v))
        return fs_law_one_side(law, h, s, v, upper);
    stretch = until;
    h = fs_law_one_side(law, h, s, stretch, upper);
    v -= stretch;
    return v > FS_R(0.0) ? fs_law_one_side(law, h, s, v, !upper) : h;
}

/* A straight line of the input: its start, direction and length, and the gain of the output. */
typedef struct {
    fs_real u, s, v, gain;
} fs_line;

/* One piece, g = g0 + G (1 - exp(-x s))/x. Where x is small, a larger rate with a slope beside it
 * follows the piece as closely, by its first two derivatives, and nothing cancels. */
static inline fs_piece fs_law_piece(const fs_line *line, fs_real begin, fs_real g, fs_real A,
                                    fs_real rate)
{
    fs_real s = line->s, v = line->v;
    fs_real x = rate * v, rise = v * (A - rate * g);
    fs_real r = FS_ABS(x) >= FS_LEAST_RATE ? x : FS_LEAST_RATE;
    fs_real amplitude = -rise * (x / r) / r;
    fs_piece piece;
    piece.start = v > FS_R(0.0) ? begin / v : FS_R(0.0);
    piece.constant = line->gain * (line->u + s * begin) - s * (g - amplitude);
    piece.slope = s * (v * line->gain - rise * (FS_R(1.0) - x / r));
    piece.amplitude = -s * amplitude;
    piece.rate = amplitude != FS_R(0.0) ? r : FS_R(0.0);
    return piece;
}

/* The value at the end of the line, which its last piece has there. */
static inline fs_real fs_value_at_end(const fs_piece *pieces, int count)
{
    const fs_piece *last = pieces + count - 1;
    fs_real since = FS_R(1.0) - last->start;
    fs_real value = last->constant + last->slope * since;
    if (last->amplitude != FS_R(0.0))
        value += last->amplitude * FS_EXP(-last->rate * since);
    return value;
}

/* The pieces of gain u - h along the line from memory[0] to u1, for exponent 1: at most two, or four
 * where the line passes the centre; as much room is needed. memory is the input and h, unchanged if
 * -1 is returned. */
static inline int fs_law_line(const fs_law *law, fs_real gain, fs_real *memory, fs_real u1,
                              fs_piece *pieces, int room, fs_real *value)
{
    fs_real u = memory[0], h = memory[1], du = u1 - u, until, begin = FS_R(0.0), end;
    fs_line line;
    int upper, count = 0;
    if (!fs_finite(du))
        return -1;
    line.u = u;
    line.s = du >= FS_R(0.0) ? FS_R(1.0) : -FS_R(1.0);
    line.v = line.s * du;
    line.gain = gain;
    upper = fs_law_upper(law, u, line.s);
    until = line.s * (law->centre - u);
    end = FS_R(0.0) < until && until < line.v ? until : line.v;
    if (room < (end < line.v ? 4 : 2))
        return -1;
    for (;;) {
        int at = fs_law_branch(line.s, upper);
        fs_real g = line.s * h, start = begin;
        if (g < FS_R(0.0)) {
            start += fs_distance_to_zero(-g, law->A, law->psi[at]);
            pieces[count++] = fs_law_piece(&line, begin, g, law->A, -law->psi[at]);
        }
        if (start < end || g >= FS_R(0.0))
            pieces[count++] =
                fs_law_piece(&line, start, fs_max(g, FS_R(0.0)), law->A, law->psi[at + 2]);
        h = fs_law_one_side(law, h, line.s, end - begin, upper);
        if (!(end < line.v))
            break;
        begin = end;
        end = line.v;
        upper = !upper;
    }
    if (!fs_finite(h))
        return -1;
    *value = fs_value_at_end(pieces, count);
    memory[0] = u1;
    memory[1] = h;
    return count;
}

/* The value of u (d + u (d2 + u d3)) - h at u1, for any exponent. */
static inline fs_real fs_law_move(const fs_law *law, fs_real d, fs_real d2, fs_real d3,
                                  fs_real *memory, fs_real u1)
{
    if (!fs_finite(u1))
        return u1 - u1;
    memory[1] = fs_law_advance(law, memory[1], memory[0], u1 - memory[0]);
    memory[0] = u1;
    return u1 * (d + u1 * (d2 + u1 * d3)) - memory[1];
}

#endif
