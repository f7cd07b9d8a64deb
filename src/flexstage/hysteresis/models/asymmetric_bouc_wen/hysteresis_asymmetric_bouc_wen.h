/* Bouc-Wen hysteresis on a cubic, y = d u + d2 u^2 + d3 u^3 - h.
 *
 * Parameters: gain d, quadratic d2, cubic d3, hysteresis_gain A, beta, gamma, exponent n.
 * Memory: last input, h.
 */
#ifndef FS_HYSTERESIS_ASYMMETRIC_BOUC_WEN_H
#define FS_HYSTERESIS_ASYMMETRIC_BOUC_WEN_H

#include "shape_law.h"

/* The output at u1; memory is updated. Not finite if h grows without limit. */
static inline fs_real fs_asymmetric_bouc_wen_move(const fs_real *p, fs_real *memory, fs_real u1)
{
    fs_law law = fs_classical_law(p[3], p[4], p[5], p[6]);
    return fs_law_move(&law, p[0], p[1], p[2], memory, u1);
}

#endif
