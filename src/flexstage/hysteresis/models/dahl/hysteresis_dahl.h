/* Dahl's friction, y = d u - F, dF/du = sigma |1 - r|^i sgn(1 - r), r = (F/F_c) sgn(u').
 *
 * Parameters: gain d, stiffness sigma, limit F_c, exponent i. Memory: last input, F.
 */
#ifndef FS_HYSTERESIS_DAHL_H
#define FS_HYSTERESIS_DAHL_H

#include "shape_law.h"

/* Pieces of the output along the line from memory[0] to u1, for exponent 1, at most two; -1,
 * with memory unchanged, if the output is not finite or the room is too small. */
static inline int fs_dahl_line(const fs_real *p, fs_real *memory, fs_real u1, fs_piece *pieces,
                               int room, fs_real *value)
{
    fs_law law = fs_classical_law(p[1], p[1] / p[2], FS_R(0.0), FS_R(1.0));
    return fs_law_line(&law, p[0], memory, u1, pieces, room, value);
}

/* The output at u1; memory is updated. */
static inline fs_real fs_dahl_move(const fs_real *p, fs_real *memory, fs_real u1)
{
    fs_real sigma = p[1], limit = p[2], i = p[3], F = memory[1], du = u1 - memory[0];
    if (i == FS_R(1.0)) {
        fs_law law = fs_classical_law(sigma, sigma / limit, FS_R(0.0), i);
        return fs_law_move(&law, p[0], FS_R(0.0), FS_R(0.0), memory, u1);
    }
    if (!fs_finite(u1))
        return u1 - u1;
    if (du != FS_R(0.0)) {
        fs_real s = du > FS_R(0.0) ? FS_R(1.0) : -FS_R(1.0);
        fs_real e = FS_R(1.0) - s * F / limit;
        if (e != FS_R(0.0)) {
            /* The gap e closes by |e|' = -(sigma/F_c) |e|^i. */
            fs_real m = i - FS_R(1.0);
            fs_real q = m * (sigma / limit * FS_ABS(du)) * FS_POW(FS_ABS(e), m);
            fs_real closed =
                q > -FS_R(1.0) ? -FS_EXPM1(-FS_LOG1P(q) / m) : FS_R(1.0);
            F = F + s * limit * e * closed;
        }
    }
    memory[0] = u1;
    memory[1] = F;
    return p[0] * u1 - F;
}

#endif
