/* The output of a hysteresis along one straight line of its input.
 *
 * With x the share of the line, from 0 to 1, the output from `start` to the start of the next piece
 * is constant + slope s + amplitude exp(-rate s), s = x - start.
 */
#ifndef FS_PIECE_H
#define FS_PIECE_H

#include "real.h"

typedef struct {
    fs_real start, constant, slope, amplitude, rate;
} fs_piece;

#endif
