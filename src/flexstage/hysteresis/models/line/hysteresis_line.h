/* Straight line, y = gain u: one play, of threshold and weight zero.
 *
 * Parameters: those of plays.h. Memory: last input, twice.
 */
#ifndef FS_HYSTERESIS_LINE_H
#define FS_HYSTERESIS_LINE_H

#include "plays.h"

/* Pieces of the output along the line from memory[0] to u1; -1, with memory unchanged, if
 * the input is not finite or the room is too small. */
static inline int fs_line_line(const fs_real *p, fs_real *memory, fs_real u1,
                               fs_piece *pieces, int room, fs_real *value)
{
    fs_plays plays = fs_plays_of(p);
    return fs_plays_line(&plays, memory, u1, pieces, room, value);
}

/* The output at u1; memory is updated. */
static inline fs_real fs_line_move(const fs_real *p, fs_real *memory, fs_real u1)
{
    fs_plays plays = fs_plays_of(p);
    return fs_plays_move(&plays, memory, u1);
}

#endif
