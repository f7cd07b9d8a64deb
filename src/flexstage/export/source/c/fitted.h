/* Hysteresis without a closed form between the samples, in fitted pieces.
 *
 * A piece, constant plus slope plus exponential, equals the output at its ends and thirds, and is
 * compared with it at sixths. Pieces that are not accurate enough, for example where the
 * hysteretic displacement passes zero, are halved.
 */
#ifndef FS_FITTED_H
#define FS_FITTED_H

#include "instance.h"
#include "lags.h"
#include "model_data.h"
#include "model_hysteresis.h"
#include "modes.h"
#include "real.h"

#if FS_HAS_FITTED

/* Relative tolerance of a piece; deepest halving; largest amplitude of an exponential over the
 * output, since a larger one would cancel with the constant and leave rounding errors. */
#ifdef FS_SINGLE
#define FS_GOOD 2e-6f
#define FS_DEEPEST 16
#define FS_LARGEST 2.0f
#else
#define FS_GOOD 1e-10
#define FS_DEEPEST 40
#define FS_LARGEST 1e3
#endif
/* Largest exponent over a third of a piece. */
#define FS_STEEPEST FS_R(3.0)
/* Largest number of halvings in a step, so that its time is bounded; remaining errors are accepted.
 * A kink in the output needs about 40. */
#ifndef FS_HALVINGS_MAX
#define FS_HALVINGS_MAX 2000
#endif

/* Piece of a length, in steps, through outputs at its sixths; returns its largest error. */
static inline fs_real fs_fitted_piece(const fs_real *y, fs_real length, fs_real size,
                                      fs_piece *piece)
{
    const fs_real first = y[4] - FS_R(2.0) * y[2] + y[0];
    const fs_real last = y[6] - FS_R(2.0) * y[4] + y[2];
    fs_real r = FS_R(2.0), amplitude = FS_R(0.0), slope, root, power = FS_R(1.0), off = FS_R(0.0);
    int k;
    /* a straight line where the output has a point of inflection, or is straight */
    if (first != FS_R(0.0) && last / first > FS_R(1.0) / FS_STEEPEST
        && last / first < FS_STEEPEST) {
        const fs_real least = FS_SQRT(FS_ABS(first) / (FS_LARGEST * size));
        r = last / first;
        if (FS_ABS(r - FS_R(1.0)) < least)
            r = FS_R(1.0) + (r < FS_R(1.0) ? -least : least);
        amplitude = (first + last)
                    / ((FS_R(1.0) + r) * ((FS_R(1.0) - r) * (FS_R(1.0) - r)));
    }
    slope = y[6] - y[0] - amplitude * (r * r * r - FS_R(1.0));
    piece->start = FS_R(0.0);
    piece->constant = y[0] - amplitude;
    piece->slope = slope / length;
    piece->amplitude = amplitude;
    piece->rate = -FS_R(3.0) * FS_LOG(r) / length;
    root = FS_SQRT(r);
    for (k = 1; k < 6; k++) {
        fs_real miss;
        power *= root;
        miss = piece->constant + slope * ((fs_real)k / FS_R(6.0)) + amplitude * power - y[k];
        off = FS_ABS(miss) > off ? FS_ABS(miss) : off;
    }
    return off;
}

/* One step of a drive from its last voltage to u1: modes, lags, memory and free displacement. */
static inline const char *fs_fitted_step(fs_stage *s, int d, fs_real u1, fs_real *v)
{
    fs_drive *drive = &s->drive[d];
    const int lags = fs_data_lags[d];
    const fs_real u0 = drive->memory[0], rise = u1 - u0;
    fs_real now[FS_MEMORY_MAX], trial[FS_MEMORY_MAX], y[7];
    fs_real begins[FS_DEEPEST + 2], size = FS_R(0.0), off;
    fs_piece piece;
    int depths[FS_DEEPEST + 2], waiting = 1, halvings = 0, i;
    for (i = 0; i < FS_MEMORY_MAX; i++)
        now[i] = drive->memory[i];
    y[0] = fs_hysteresis_move(d, drive->parameters, now, u0);
    begins[0] = FS_R(0.0);
    depths[0] = 0;
    while (waiting > 0) {
        const int depth = depths[--waiting];
        const fs_real at = begins[waiting];
        fs_real length = FS_R(1.0);
        for (i = 0; i < depth; i++)
            length *= FS_R(0.5);
        for (i = 0; i < FS_MEMORY_MAX; i++)
            trial[i] = now[i];
        for (i = 1; i < 7; i++) {
            const fs_real share = at + length * ((fs_real)i / FS_R(6.0));
            y[i] = fs_hysteresis_move(d, drive->parameters, trial,
                                      share < FS_R(1.0) ? u0 + rise * share : u1);
        }
        if (!FS_FINITE(y[0]) || !FS_FINITE(y[6]))
            return "the hysteresis is no longer finite: its parameters are unstable";
        for (i = 0; depth == 0 && i < 7; i++)
            size = FS_ABS(y[i]) > size ? FS_ABS(y[i]) : size;
        off = fs_fitted_piece(y, length, size, &piece);
        if (off > FS_GOOD * size && depth < FS_DEEPEST && halvings < FS_HALVINGS_MAX) {
            halvings++;
            begins[waiting] = at + FS_R(0.5) * length;
            depths[waiting++] = depth + 1;
            begins[waiting] = at;
            depths[waiting++] = depth + 1;
            continue;
        }
        if (depth == 0) {
            fs_modes_through(&s->modes, drive->z, v, &piece, 1);
            fs_lags_through(&drive->lags, lags, drive->lag, drive->lag_rest, &piece, 1);
        } else {
            fs_modes_piece(&s->modes, drive->z, v, length, piece.constant, piece.slope,
                           piece.amplitude, piece.rate);
            for (i = 0; i < lags; i++)
                drive->lag[i] = fs_lag_piece(drive->lag[i], drive->lags.ratio[i], length,
                                             piece.constant, piece.slope, piece.amplitude,
                                             piece.rate);
        }
        for (i = 0; i < FS_MEMORY_MAX; i++)
            now[i] = trial[i];
        y[0] = y[6];
    }
    for (i = 0; i < FS_MEMORY_MAX; i++)
        drive->memory[i] = now[i];
    drive->free = y[6];
    return 0;
}

#endif
#endif
