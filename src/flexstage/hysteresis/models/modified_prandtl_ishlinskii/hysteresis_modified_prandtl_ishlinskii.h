/* Modified Prandtl-Ishlinskii operator, y = S(H(u)): plays, then a line with kinks (Kuhnen 2003).
 *
 * Parameters: those of plays.h for H, then the number l of knots of S, the knots (rising), l + 1
 * slopes, l + 1 offsets. Memory: last input, plays.
 */
#ifndef FS_HYSTERESIS_MODIFIED_PRANDTL_ISHLINSKII_H
#define FS_HYSTERESIS_MODIFIED_PRANDTL_ISHLINSKII_H

#include "plays.h"

typedef struct {
    int knots;
    const fs_real *knot, *slope, *offset;
} fs_kinked_line;

static inline fs_kinked_line fs_kinked_line_of(const fs_real *p)
{
    fs_kinked_line line;
    line.knots = (int)p[0];
    line.knot = p + 1;
    line.slope = line.knot + line.knots;
    line.offset = line.slope + line.knots + 1;
    return line;
}

static inline fs_real fs_kinked_line_at(const fs_kinked_line *line, fs_real x)
{
    int j = fs_knots_below(line->knot, line->knots, x, 0);
    return line->offset[j] + line->slope[j] * x;
}

/* A straight piece after S, from a start to an end within it. */
static inline fs_piece fs_kinked_piece(const fs_kinked_line *line, const fs_piece *of,
                                       fs_real start, fs_real end)
{
    fs_piece piece = *of;
    fs_real constant = of->constant + of->slope * (start - of->start);
    /* The slope is that in the middle of a piece, since its ends lie on the knots. */
    fs_real middle = constant + FS_R(0.5) * of->slope * (end - start);
    piece.start = start;
    piece.constant = fs_kinked_line_at(line, constant);
    piece.slope = of->slope * line->slope[fs_knots_below(line->knot, line->knots, middle, 0)];
    return piece;
}

/* Pieces of the output along the line from memory[0] to u1: one for each play that starts and one
 * before, each split at most at each knot. -1, with memory unchanged, if the input is not finite or
 * the room is too small. */
static inline int fs_modified_prandtl_ishlinskii_line(const fs_real *p, fs_real *memory,
                                                      fs_real u1, fs_piece *pieces, int room,
                                                      fs_real *value)
{
    fs_plays plays = fs_plays_of(p);
    fs_kinked_line line = fs_kinked_line_of(fs_plays_end(&plays));
    int straight, count = 0, free, i, k;
    if (room < (plays.count + 1) * (line.knots + 1))
        return -1;
    straight = fs_plays_line(p, memory, u1, pieces, room, value);
    if (straight < 0)
        return -1;
    free = room - straight;
    /* From the far end of the room each piece comes to its place, with those it falls into. */
    for (i = straight - 1; i >= 0; i--)
        pieces[free + i] = pieces[i];
    for (i = 0; i < straight; i++) {
        fs_piece of = pieces[free + i];
        fs_real end = i + 1 < straight ? pieces[free + i + 1].start : FS_R(1.0);
        fs_real start = of.start;
        for (k = 0; k < line.knots && of.slope != FS_R(0.0); k++) {
            int knot = of.slope > FS_R(0.0) ? k : line.knots - 1 - k;
            fs_real time = of.start + (line.knot[knot] - of.constant) / of.slope;
            if (!(time > of.start && time < end))
                continue;
            pieces[count++] = fs_kinked_piece(&line, &of, start, time);
            start = time;
        }
        pieces[count++] = fs_kinked_piece(&line, &of, start, end);
    }
    *value = fs_straight_value_at_end(pieces, count);
    return count;
}

/* The output at u1; memory is updated. */
static inline fs_real fs_modified_prandtl_ishlinskii_move(const fs_real *p, fs_real *memory,
                                                          fs_real u1)
{
    fs_plays plays = fs_plays_of(p);
    fs_kinked_line line = fs_kinked_line_of(fs_plays_end(&plays));
    return fs_kinked_line_at(&line, fs_plays_move(p, memory, u1));
}

#endif
