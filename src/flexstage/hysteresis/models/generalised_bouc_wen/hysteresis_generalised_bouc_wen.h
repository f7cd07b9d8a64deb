/* Generalised Bouc-Wen hysteresis, y = d u - h, h' = u' (A - |h|^n psi), where psi =
 * b1 sgn(u' h) + b2 sgn(x u') + b3 sgn(x h) + b4 sgn(u') + b5 sgn(h) + b6 sgn(x), x = u - centre
 * (Song, Der Kiureghian 2006).
 *
 * Parameters: gain d, hysteresis_gain A, b1 to b6, centre, exponent n. Memory: last input, h.
 */
#ifndef FS_HYSTERESIS_GENERALISED_BOUC_WEN_H
#define FS_HYSTERESIS_GENERALISED_BOUC_WEN_H

#include "shape_law.h"

static inline fs_law fs_generalised_bouc_wen_law(const fs_real *p)
{
    fs_law law;
    int k;
    law.A = p[1];
    law.centre = p[8];
    law.n = p[9];
    for (k = 0; k < 8; k++) {
        fs_real rate = k & 4 ? FS_R(1.0) : -FS_R(1.0);
        fs_real loaded = k & 2 ? FS_R(1.0) : -FS_R(1.0);
        fs_real side = k & 1 ? FS_R(1.0) : -FS_R(1.0);
        fs_real h = rate * loaded;
        law.psi[k] = p[2] * loaded + p[3] * side * rate + p[4] * side * h + p[5] * rate + p[6] * h
                     + p[7] * side;
    }
    return law;
}

/* Pieces of the output along the line from memory[0] to u1, for exponent 1, at most four; -1,
 * with memory unchanged, if the output is not finite or the room is too small. */
static inline int fs_generalised_bouc_wen_line(const fs_real *p, fs_real *memory, fs_real u1,
                                               fs_piece *pieces, int room, fs_real *value)
{
    fs_law law = fs_generalised_bouc_wen_law(p);
    return fs_law_line(&law, p[0], memory, u1, pieces, room, value);
}

/* The output at u1; memory is updated. Not finite if h grows without limit. */
static inline fs_real fs_generalised_bouc_wen_move(const fs_real *p, fs_real *memory, fs_real u1)
{
    fs_law law = fs_generalised_bouc_wen_law(p);
    return fs_law_move(&law, p[0], FS_R(0.0), FS_R(0.0), memory, u1);
}

#endif
