/* Bouc-Wen hysteresis, y = d u - h, h' = A u' - beta |u'| |h|^(n-1) h - gamma u' |h|^n.
 *
 * Parameters: gain d, hysteresis_gain A, beta, gamma, exponent n. Memory: last input, h.
 */
#ifndef FS_HYSTERESIS_BOUC_WEN_H
#define FS_HYSTERESIS_BOUC_WEN_H

#include "shape_law.h"

/* Pieces of the output along the line from memory[0] to u1, for exponent 1, at most two; -1,
 * with memory unchanged, if the output is not finite or the room is too small. */
static inline int fs_bouc_wen_line(const fs_real *p, fs_real *memory, fs_real u1, fs_piece *pieces,
                                   int room, fs_real *value)
{
    fs_law law = fs_classical_law(p[1], p[2], p[3], p[4]);
    return fs_law_line(&law, p[0], memory, u1, pieces, room, value);
}

/* The output at u1; memory is updated. Not finite if h grows without limit. */
static inline fs_real fs_bouc_wen_move(const fs_real *p, fs_real *memory, fs_real u1)
{
    fs_law law = fs_classical_law(p[1], p[2], p[3], p[4]);
    return fs_law_move(&law, p[0], FS_R(0.0), FS_R(0.0), memory, u1);
}

#endif
