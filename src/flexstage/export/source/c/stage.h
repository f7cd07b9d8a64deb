/* A stage with its drives, stepped in time: commands in, readings out.
 *
 * No library but libm, no allocation, nothing global that changes, no pointer in an instance: a
 * copy of its bytes is a saved state. Include this one file.
 *
 *   fs_stage s;
 *   fs_init(&s);                                at rest at zero commands
 *   fs_step(&s, commands, readings);            once every FS_STEP seconds
 *
 * In double precision, compiled without contraction of products and sums, the readings are those of
 * flexstage stepped one sample at a time.
 */
#ifndef FS_STAGE_H
#define FS_STAGE_H

#include "amplifier.h"
#include "fitted.h"
#include "instance.h"
#include "lags.h"
#include "model_data.h"
#include "model_hysteresis.h"
#include "modes.h"
#include "piece.h"
#include "prepare.h"
#include "real.h"
#include "sensor.h"

/* Interface. The message is NULL on success; after an error, settle or restore a copy. */

/* Parameters as exported; at rest, settled at zero commands. */
static inline void fs_init(fs_stage *s);
/* Call after a change of parameters: computes derived values. The state does not change. */
static inline const char *fs_prepare(fs_stage *s);
/* Settle at these commands, reached from zero. */
static inline void fs_settle(fs_stage *s, const fs_real *commands);
/* One step of s->step seconds; commands move on straight lines from the last ones to these. */
static inline const char *fs_step(fs_stage *s, const fs_real *commands, fs_real *readings);
/* Commands jump without time passing: the hysteresis follows, the modes do not change. */
static inline void fs_jump(fs_stage *s, const fs_real *commands);
/* Current readings. */
static inline void fs_readings(const fs_stage *s, fs_real *readings);

/* Add the motion by one drive to y: modes, lags of the creep, feedthrough. */
static inline void fs_drive_read(const fs_drive *drive, int d, const fs_real *v, fs_real *y)
{
    const int lags = fs_data_lags[d];
    fs_real part[FS_PROBES][FS_MODES];
    fs_real total[FS_PROBES];
    int m, p;
    /* products first: only the sums, in fixed order, are sequential */
    for (p = 0; p < FS_PROBES; p++)
        for (m = 0; m < FS_MODES; m++)
            part[p][m] = drive->reader_z[p][m] * drive->z[m] + drive->reader_v[p][m] * v[m];
    for (p = 0; p < FS_PROBES; p++)
        total[p] = y[p];
    for (m = 0; m < FS_MODES; m++)
        for (p = 0; p < FS_PROBES; p++)
            total[p] += part[p][m];
    for (m = 0; m < lags; m++)
        for (p = 0; p < FS_PROBES; p++)
            total[p] += drive->reader_lag[p][m] * drive->lag[m];
    for (p = 0; p < FS_PROBES; p++)
        y[p] = total[p] + fs_data_feedthrough[d][p] * drive->free;
}

/* Motion at the probes now, from the state alone. */
static inline void fs_observe(fs_stage *s)
{
    fs_real v[FS_MODES];
    int d, m, p;
    for (p = 0; p < FS_PROBES; p++)
        s->motion[p] = FS_R(0.0);
    for (d = 0; d < FS_DRIVES; d++) {
        for (m = 0; m < FS_MODES; m++)
            v[m] = s->drive[d].rate[m] * s->step;
        fs_drive_read(&s->drive[d], d, v, s->motion);
    }
}

static inline void fs_readings(const fs_stage *s, fs_real *readings)
{
    int p;
    for (p = 0; p < FS_PROBES; p++)
        readings[p] = fs_data_has_sensor[p] ? fs_sensor_reading(&s->sensor[p], s->step)
                                            : s->motion[p];
}

static inline void fs_settle(fs_stage *s, const fs_real *commands)
{
    int d, m, p;
    for (d = 0; d < FS_DRIVES; d++) {
        fs_drive *drive = &s->drive[d];
        fs_real u = commands[d], w;
        drive->command = u;
        if (fs_data_has_amplifier[d]) {
            u = drive->amplifier_gain * u;
            u = u > drive->lowest ? u : drive->lowest;
            u = u < drive->highest ? u : drive->highest;
        }
        for (m = 0; m < FS_MEMORY_MAX; m++)
            drive->memory[m] = fs_data_rest[d][m];
        if (fs_data_form[d] == FS_FORM_LINE) {
            w = drive->gain * u;
            drive->memory[0] = u;
        } else {
            w = fs_hysteresis_move(d, drive->parameters, drive->memory, u);
        }
        drive->voltage = u;
        drive->free = w;
        for (m = 0; m < FS_LAGS_MAX; m++) {
            drive->lag[m] = w;
            drive->lag_rest[m] = FS_R(0.0);
        }
        for (m = 0; m < FS_MODES; m++) {
            drive->z[m] = w;
            drive->rate[m] = FS_R(0.0);
        }
    }
    fs_observe(s);
    for (p = 0; p < FS_PROBES; p++)
        fs_sensor_settle(&s->sensor[p], s->motion[p]);
}

static inline void fs_init(fs_stage *s)
{
    fs_real none[FS_DRIVES];
    int d;
    for (d = 0; d < FS_DRIVES; d++)
        none[d] = FS_R(0.0);
    fs_init_parameters(s);
    fs_settle(s, none);
}

static inline const char *fs_prepare(fs_stage *s)
{
    const char *message = fs_prepare_all(s);
    if (!message)
        fs_observe(s);
    return message;
}

static inline void fs_jump(fs_stage *s, const fs_real *commands)
{
    int d, m, p;
    for (d = 0; d < FS_DRIVES; d++) {
        fs_drive *drive = &s->drive[d];
        const fs_real u = commands[d];
        fs_real w, leap;
        drive->command = u;
        if (fs_data_has_amplifier[d])
            continue; /* its output follows in time */
        if (fs_data_form[d] == FS_FORM_LINE) {
            w = drive->gain * u;
            drive->memory[0] = u;
        } else {
            w = fs_hysteresis_move(d, drive->parameters, drive->memory, u);
        }
        leap = w - drive->free;
        drive->voltage = u;
        drive->free = w;
        /* a jump of an imposed displacement is an impulse */
        for (m = 0; m < FS_MODES; m++)
            drive->rate[m] += s->modes.angle[m] * s->modes.angle[m] * drive->by_rate[m] * leap /
                              s->step;
    }
    fs_observe(s);
    for (p = 0; p < FS_PROBES; p++)
        fs_sensor_jump(&s->sensor[p], s->motion[p]);
}

/* One step of one drive; its motion at the probes is added to y. */
static inline const char *fs_drive_step(fs_stage *s, int d, fs_real command, fs_real *y)
{
    fs_drive *drive = &s->drive[d];
    const fs_real h = s->step;
    fs_real v[FS_MODES];
    fs_real u = command;
    int m;
    if (fs_data_has_amplifier[d]) {
        const fs_real last = drive->amplifier_gain * drive->command;
        const fs_real target = drive->amplifier_gain * command;
        fs_real from = drive->voltage;
        from = from > drive->lowest ? from : drive->lowest;
        from = from < drive->highest ? from : drive->highest;
        u = fs_amplifier_step(last, (target - last) / drive->amplifier_step, from,
                              drive->amplifier_step, drive->threshold, drive->lowest,
                              drive->highest);
    }
    for (m = 0; m < FS_MODES; m++)
        v[m] = drive->rate[m] * h;
    if (fs_data_form[d] == FS_FORM_LINE) {
        const fs_real w = drive->gain * drive->memory[0];
        drive->free = drive->gain * u;
        drive->memory[0] = u;
        fs_modes_along_line(&s->modes, drive->z, v, drive->by_rate, w, drive->free - w);
    }
#if FS_HAS_PIECES
    if (fs_data_form[d] == FS_FORM_PIECES) {
        fs_piece pieces[FS_PIECES_MAX];
        fs_real ignored;
        const fs_piece *last;
        const int count =
            fs_hysteresis_line(d, drive->parameters, drive->memory, u, pieces, &ignored);
        if (count < 1)
            return "the hysteresis is no longer finite: its parameters are unstable";
        for (m = 0; m < count; m++)
            if (pieces[m].amplitude != FS_R(0.0) && !(FS_ABS(pieces[m].rate) <= FS_FASTEST))
                return "the voltage changes too much in one step: use several steps, or jump";
        fs_modes_through(&s->modes, drive->z, v, pieces, count);
        fs_lags_through(&drive->lags, fs_data_lags[d], drive->lag, drive->lag_rest, pieces,
                        count);
        last = &pieces[count - 1];
        drive->free = last->constant + last->slope * (FS_R(1.0) - last->start);
        if (last->amplitude != FS_R(0.0))
            drive->free += last->amplitude * FS_EXP(-last->rate * (FS_R(1.0) - last->start));
    }
#endif
#if FS_HAS_FITTED
    if (fs_data_form[d] == FS_FORM_FITTED) {
        const char *message = fs_fitted_step(s, d, u, v);
        if (message)
            return message;
    }
#endif
    drive->command = command;
    drive->voltage = u;
    fs_drive_read(drive, d, v, y);
    for (m = 0; m < FS_MODES; m++)
        drive->rate[m] = v[m] / h;
    return 0;
}

static inline const char *fs_step(fs_stage *s, const fs_real *commands, fs_real *readings)
{
    fs_real y[FS_PROBES];
    int d, p;
    for (d = 0; d < FS_DRIVES; d++)
        if (!FS_FINITE(commands[d]))
            return "a command is not finite: the stage has not moved";
    for (p = 0; p < FS_PROBES; p++)
        y[p] = FS_R(0.0);
    for (d = 0; d < FS_DRIVES; d++) {
        const char *message = fs_drive_step(s, d, commands[d], y);
        if (message)
            return message;
    }
    for (p = 0; p < FS_PROBES; p++) {
        if (!FS_FINITE(y[p]))
            return "a reading is no longer finite: settle the stage and check its parameters";
        s->motion[p] = y[p];
        if (fs_data_has_sensor[p])
            fs_sensor_step(&s->sensor[p], y[p]);
    }
    fs_readings(s, readings);
    return 0;
}

#endif
