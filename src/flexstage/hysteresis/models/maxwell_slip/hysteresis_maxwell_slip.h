/* Generalised Maxwell-slip model: the displacement for a voltage, the exact inverse of
 * u = gain y + sum_i f_i(play_i(y)), of springs and sliders that the displacement drives.
 *
 * Parameters: those of plays.h, the first play with threshold zero. Memory: last voltage,
 * displacement, sliders; displacement and sliders are the plays.
 */
#ifndef FS_HYSTERESIS_MAXWELL_SLIP_H
#define FS_HYSTERESIS_MAXWELL_SLIP_H

#include "plays.h"

/* The output at u1; memory is updated. */
static inline fs_real fs_maxwell_slip_move(const fs_real *p, fs_real *memory, fs_real u1)
{
    fs_plays plays = fs_plays_of(p);
    fs_real y = fs_plays_invert(&plays, memory + 1, memory[1], u1);
    if (fs_finite(y))
        memory[0] = u1;
    return y;
}

/* Pieces of the output along the line from memory[0] to u1; -1, with memory unchanged, if the
 * input is not finite, or, but for the rounding of its output, if the room is too small. */
static inline int fs_maxwell_slip_line(const fs_real *p, fs_real *memory, fs_real u1,
                                       fs_piece *pieces, int room, fs_real *value)
{
    fs_plays plays = fs_plays_of(p);
    fs_real y;
    int count;
    if (!fs_finite(u1))
        return -1;
    /* The displacement is that of the last voltage, to the last digit. */
    y = fs_maxwell_slip_move(p, memory, memory[0]);
    count = fs_plays_pieces(&plays, memory + 1, &y, memory[0], u1, 1, pieces, room);
    if (count > 0) {
        *value = fs_straight_value_at_end(pieces, count);
        memory[0] = u1;
    }
    return count;
}

#endif
