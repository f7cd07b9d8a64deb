/* Sums of functions of plays, gain x + sum_i f_i(play_i(x)), with f_i piecewise linear on common
 * knots: f_i(p) = offset[i][j] + slope[i][j] p between knots j - 1 and j. A Preisach operator, a
 * Prandtl-Ishlinskii operator, and a straight line with one play of weight zero are such sums.
 *
 * Parameters: number of plays m, number of knots c, gain, m thresholds (rising), c knots (rising),
 * m (c + 1) slopes, m (c + 1) offsets. Plays start to move in the order of their thresholds.
 *
 * Time of a step: a move takes m binary searches among the knots; a walk along the pieces passes
 * each knot at most once with each play, so it ends after at most m (c + 1) + 1 pieces, and takes
 * at most m for each.
 */
#ifndef FS_PLAYS_H
#define FS_PLAYS_H

#include "decay.h"
#include "piece.h"

/* The largest number of plays, for which walks keep room; FS_MEMORY_MAX numbers of memory, where
 * that is known, hold no more. */
#ifndef FS_PLAYS_MAX
#ifdef FS_MEMORY_MAX
#define FS_PLAYS_MAX (FS_MEMORY_MAX)
#else
#define FS_PLAYS_MAX 256
#endif
#endif

/* Some units in the last digit, as a part of a number. */
#ifdef FS_SINGLE
#define FS_PLAYS_ROUNDING 5e-7f
#else
#define FS_PLAYS_ROUNDING 1e-15
#endif

typedef struct {
    int count, knots;
    fs_real gain;
    const fs_real *threshold, *knot, *slope, *offset;
} fs_plays;

static inline fs_plays fs_plays_of(const fs_real *p)
{
    fs_plays plays;
    plays.count = (int)p[0];
    plays.knots = (int)p[1];
    plays.gain = p[2];
    plays.threshold = p + 3;
    plays.knot = plays.threshold + plays.count;
    plays.slope = plays.knot + plays.knots;
    plays.offset = plays.slope + plays.count * (plays.knots + 1);
    return plays;
}

/* Where the parameters of the plays end. */
static inline const fs_real *fs_plays_end(const fs_plays *plays)
{
    return plays->offset + plays->count * (plays->knots + 1);
}

/* The number of knots below x; those at x are counted as well if they are asked for. */
static inline int fs_knots_below(const fs_real *knot, int count, fs_real x, int with_equal)
{
    int low = 0;
    while (count > 0) {
        int half = count / 2;
        if (knot[low + half] < x || (with_equal && knot[low + half] == x)) {
            low += half + 1;
            count -= half + 1;
        } else {
            count = half;
        }
    }
    return low;
}

/* The function of one play at p on interval j of the knots. */
static inline fs_real fs_play_function(const fs_plays *plays, int i, int j, fs_real p)
{
    int at = i * (plays->knots + 1) + j;
    return plays->offset[at] + plays->slope[at] * p;
}

/* How many plays leave their place when the input goes to x, in the direction of sign. */
static inline int fs_plays_moved(const fs_plays *plays, const fs_real *p, fs_real x, fs_real sign)
{
    int moved = 0;
    while (moved < plays->count && sign * (x - p[moved]) > plays->threshold[moved])
        moved++;
    return moved;
}

/* The sum at x; memory, the last input and the plays, is updated. */
static inline fs_real fs_plays_move(const fs_real *parameters, fs_real *memory, fs_real x)
{
    const fs_plays of = fs_plays_of(parameters), *plays = &of;
    fs_real *p = memory + 1, sum = FS_R(0.0);
    fs_real sign = x > memory[0] ? FS_R(1.0) : -FS_R(1.0);
    int moved = 0, i;
    if (!fs_finite(x))
        return x - x;
    if (x != memory[0])
        moved = fs_plays_moved(plays, p, x, sign);
    memory[0] = x;
    for (i = plays->count - 1; i >= moved; i--)
        sum += fs_play_function(plays, i, fs_knots_below(plays->knot, plays->knots, p[i], 0),
                                p[i]);
    for (; i >= 0; i--) {
        int from = fs_knots_below(plays->knot, plays->knots, p[i], 0), j;
        p[i] = x - sign * plays->threshold[i];
        /* On a knot, the interval is that from which the play has come. */
        if (sign > FS_R(0.0)) {
            j = fs_knots_below(plays->knot, plays->knots, p[i], 0);
        } else {
            j = fs_knots_below(plays->knot, plays->knots, p[i], 1);
            j = j < from ? j : from;
        }
        sum += fs_play_function(plays, i, j, p[i]);
    }
    return plays->gain * x + sum;
}

/* A walk along the straight pieces that the sum has while the input goes one way: where it is, how
 * many plays move, the interval of each; slope of the piece, where it ends and what ends it. */
typedef struct {
    fs_real x, sum, sign, slope, reach;
    int moving, cause;
    int where[FS_PLAYS_MAX];
} fs_walk;

/* Begin a walk from the memory; its direction is not known yet. */
static inline void fs_walk_begin(fs_walk *walk, const fs_plays *plays, const fs_real *p, fs_real x)
{
    fs_real sum = FS_R(0.0);
    int i;
    for (i = plays->count - 1; i >= 0; i--) {
        walk->where[i] = fs_knots_below(plays->knot, plays->knots, p[i], 0);
        sum += fs_play_function(plays, i, walk->where[i], p[i]);
    }
    walk->x = x;
    walk->sum = plays->gain * x + sum;
}

/* Set out: the plays that move as soon as the input does. */
static inline void fs_walk_turn(fs_walk *walk, const fs_plays *plays, const fs_real *p,
                                fs_real sign)
{
    walk->sign = sign;
    walk->moving = 0;
    /* A play that was moved last is off its threshold by the rounding of a subtraction. */
    while (walk->moving < plays->count
           && sign * (walk->x - p[walk->moving])
                  >= plays->threshold[walk->moving]
                         - FS_PLAYS_ROUNDING
                               * (FS_ABS(walk->x) + plays->threshold[walk->moving]))
        walk->moving++;
}

/* The slope of the piece here, and its end: where a moving play passes a knot or the next play
 * starts to move; cause is that play, -1 if the slope no longer changes. */
static inline void fs_walk_look(fs_walk *walk, const fs_plays *plays, const fs_real *p)
{
    fs_real end = (fs_real)INFINITY;
    int i;
    walk->slope = plays->gain;
    walk->cause = -1;
    if (walk->moving < plays->count) {
        end = walk->sign * p[walk->moving] + plays->threshold[walk->moving];
        walk->cause = walk->moving;
    }
    for (i = 0; i < walk->moving; i++) {
        int knot = walk->sign > FS_R(0.0) ? walk->where[i] : walk->where[i] - 1;
        walk->slope += plays->slope[i * (plays->knots + 1) + walk->where[i]];
        if (knot >= 0 && knot < plays->knots) {
            fs_real passing = walk->sign * plays->knot[knot] + plays->threshold[i];
            if (passing < end) {
                end = passing;
                walk->cause = i;
            }
        }
    }
    /* Rounding can put the end of a piece a last digit behind its start. */
    walk->reach = fs_max(FS_R(0.0), walk->sign * (walk->sign * end - walk->x));
}

/* Go to the end of the piece. */
static inline void fs_walk_on(fs_walk *walk)
{
    walk->sum += walk->sign * walk->slope * walk->reach;
    walk->x += walk->sign * walk->reach;
    if (walk->cause == walk->moving)
        walk->moving++;
    else
        walk->where[walk->cause] += walk->sign > FS_R(0.0) ? 1 : -1;
}

/* Move the plays to x. */
static inline void fs_plays_follow(const fs_plays *plays, fs_real *p, fs_real x, fs_real sign)
{
    int moved = fs_plays_moved(plays, p, x, sign), i;
    for (i = 0; i < moved; i++)
        p[i] = x - sign * plays->threshold[i];
}

/* The input at which the sum is z; the plays move there from input x. Not a number where no input
 * gives that sum. */
static inline fs_real fs_plays_invert(const fs_plays *plays, fs_real *p, fs_real x, fs_real z)
{
    fs_walk walk;
    if (plays->count > FS_PLAYS_MAX || !fs_finite(z))
        return (fs_real)NAN;
    fs_walk_begin(&walk, plays, p, x);
    if (z == walk.sum)
        return x;
    fs_walk_turn(&walk, plays, p, z > walk.sum ? FS_R(1.0) : -FS_R(1.0));
    for (;;) {
        fs_walk_look(&walk, plays, p);
        if (walk.slope > FS_R(0.0)
            && (walk.cause < 0 || walk.sign * (z - walk.sum) <= walk.slope * walk.reach))
            break;
        if (walk.cause < 0)
            return (fs_real)NAN;
        fs_walk_on(&walk);
    }
    walk.x += (z - walk.sum) / walk.slope;
    fs_plays_follow(plays, p, walk.x, walk.sign);
    return walk.x;
}

/* The straight pieces between two values of the input, or of the sum where backward (then those of
 * the input, and every slope must be above zero). The plays move to the input at the end, *x.
 * Returns the number of pieces; -1, with nothing moved, if the room is too small. */
static inline int fs_plays_pieces(const fs_plays *plays, fs_real *p, fs_real *x, fs_real from,
                                  fs_real to, int backward, fs_piece *pieces, int room)
{
    fs_walk walk;
    fs_real step = to - from, start = FS_R(0.0), time;
    int count = 0;
    if (plays->count > FS_PLAYS_MAX || !fs_finite(step))
        return -1;
    fs_walk_begin(&walk, plays, p, *x);
    fs_walk_turn(&walk, plays, p, step >= FS_R(0.0) ? FS_R(1.0) : -FS_R(1.0));
    for (;;) {
        fs_walk_look(&walk, plays, p);
        time = (fs_real)INFINITY;
        if (step != FS_R(0.0) && backward)
            time = (walk.sum + walk.sign * walk.slope * walk.reach - from) / step;
        else if (step != FS_R(0.0))
            time = (walk.x + walk.sign * walk.reach - from) / step;
        if (time > start) {
            if (count >= room)
                return -1;
            pieces[count].start = start;
            pieces[count].constant = backward ? walk.x : walk.sum;
            pieces[count].slope = backward ? step / walk.slope : step * walk.slope;
            pieces[count].amplitude = FS_R(0.0);
            pieces[count].rate = FS_R(0.0);
            count++;
        }
        if (walk.cause < 0 || time >= FS_R(1.0))
            break;
        fs_walk_on(&walk);
        start = fs_max(start, time);
    }
    *x = backward ? walk.x + (to - walk.sum) / walk.slope : to;
    fs_plays_follow(plays, p, *x, walk.sign);
    return count;
}

/* The value at the end of the line, which its last piece has there. */
static inline fs_real fs_straight_value_at_end(const fs_piece *pieces, int count)
{
    const fs_piece *last = pieces + count - 1;
    return last->constant + last->slope * (FS_R(1.0) - last->start);
}

/* The pieces of the sum along the line from memory[0] to u1; -1, with memory unchanged, if the input
 * is not finite or the room is too small. */
static inline int fs_plays_line(const fs_real *p, fs_real *memory, fs_real u1, fs_piece *pieces,
                                int room, fs_real *value)
{
    fs_plays plays = fs_plays_of(p);
    int count = fs_plays_pieces(&plays, memory + 1, memory, memory[0], u1, 0, pieces, room);
    if (count > 0)
        *value = fs_straight_value_at_end(pieces, count);
    return count;
}

#endif
