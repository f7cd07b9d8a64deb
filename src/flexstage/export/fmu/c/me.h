/* The stage as differential equations, for the solver of an importer (model exchange).
 *
 * States: the voltage of each amplifier, the lags of the creep of each drive, deflection and rate
 * of each mode (scaled to a modal mass of 1 kg) under all drives together, the lag of each sensor.
 * With the free displacement w of a drive, and its creep, total = w + a sum(lag):
 *
 *   q'' + 2 zeta omega q' + omega^2 q = omega^2 sum_d gain_d (total_d + t_d total_d')
 *
 * t_d = 2 zeta/omega where a displacement is imposed, else 0. The state of the rate is
 * q' - omega^2 sum_d gain_d t_d total_d, so that no rate of an input is needed.
 *
 * The hysteresis does not depend on rate: its output follows from its state at the end of the last
 * integrator step, which is exact unless the voltage reverses within a step. Each reversal of an
 * amplifier's voltage is an event, so that steps end there.
 */
#ifndef FMU_ME_H
#define FMU_ME_H

#include <string.h>

#include "fmu_data.h"
#include "stage.h"

enum { ME_FOLLOWS, ME_SLEWS_UP, ME_SLEWS_DOWN, ME_AT_TOP, ME_AT_BOTTOM };

/* Shares of the usual voltage: reversals below the first, and excess over the range below the
 * second, are not events, else rounding in the solver would cause endless events. */
#define ME_TURN 1e-5
#define ME_PASS 1e-7

typedef struct {
    double x[FMU_STATES], rate[FMU_STATES]; /* states, and their derivatives */
    double away[FS_DRIVES];                 /* target of the amplifier less its output [V] */
    double total[FS_DRIVES];                /* free displacement with its creep */
    int32_t mode[FS_DRIVES], direction[FS_DRIVES];
    int32_t fresh;                          /* derivatives and readings belong to the states */
} fmu_me;

static double me_state(const fmu_me *me, unsigned k) { return me->x[k]; }

static double me_derivative(const fmu_me *me, unsigned k) { return me->rate[k]; }

static void me_set_state(fmu_me *me, unsigned k, double value) { me->x[k] = value; }

static double me_omega(const fs_stage *s, int m)
{
    return 6.283185307179586 * (double)s->modes.frequency_hz[m];
}

/* Time t_d of a mode under an imposed displacement. */
static double me_rate_time(const fs_stage *s, int d, int m)
{
    return fs_data_imposed[d] ? 2.0 * (double)s->modes.damping_ratio[m] / me_omega(s, m) : 0.0;
}

/* Weight a of a lag of the creep. */
static double me_lag_gain(const fs_stage *s, int d, int l)
{
#if FS_HAS_CREEP
    return (double)(s->drive[d].creep_rate * fs_data_lag_share[d][l]);
#else
    (void)s;
    (void)d;
    (void)l;
    return 0.0;
#endif
}

static double me_lag_rate(int d, int l)
{
#if FS_HAS_CREEP
    return (double)fs_data_lag_rate[d][l];
#else
    (void)d;
    (void)l;
    return 0.0;
#endif
}

static double me_clamped(const fs_drive *drive, double u)
{
    u = u < (double)drive->highest ? u : (double)drive->highest;
    return u > (double)drive->lowest ? u : (double)drive->lowest;
}

/* Voltage of a drive now. */
static double me_voltage(const fmu_me *me, const fs_stage *s, const double *command, int d)
{
    return fmu_voltage_at[d] < 0 ? command[d] : me_clamped(&s->drive[d], me->x[fmu_voltage_at[d]]);
}

/* Free displacement at a voltage; the memory moves there. */
static double me_through(const fs_stage *s, int d, fs_real *memory, double voltage)
{
    const fs_drive *drive = &s->drive[d];
    if (fs_data_form[d] == FS_FORM_LINE) {
        memory[0] = (fs_real)voltage;
        return (double)(drive->gain * (fs_real)voltage);
    }
    return (double)fs_hysteresis_move(d, drive->parameters, memory, (fs_real)voltage);
}

/* Deflection and rate of a mode that one drive of the step-by-step core gives, added to q. */
static void me_add_mode(const fs_stage *s, int d, int m, double *q, double *v)
{
    const fs_drive *drive = &s->drive[d];
    const double omega = me_omega(s, m), zeta = (double)s->modes.damping_ratio[m];
    const double w = (double)drive->free, z = (double)drive->z[m], dz = (double)drive->rate[m];
    const double ddz = omega * omega * (w - z) - 2.0 * zeta * omega * dz;
    double by_z = 1.0, by_v = 0.0, lags = 0.0, lag_rates = 0.0;
    int l;
    for (l = 0; l < fs_data_lags[d]; l++) {
        const double rate = me_lag_rate(d, l), x = rate / omega;
        const double c = 1.0 / (1.0 - 2.0 * zeta * x + x * x), gain = me_lag_gain(s, d, l);
        by_z += gain * (1.0 - c);
        by_v -= gain * c * rate / (omega * omega);
        lags += gain * c * (double)drive->lag[l];
        lag_rates += gain * c * rate * (w - (double)drive->lag[l]);
    }
    *q += fmu_gain[d][m] * (by_z * z + by_v * dz + lags);
    *v += fmu_gain[d][m] * (by_z * dz + by_v * ddz + lag_rates -
                            omega * omega * me_rate_time(s, d, m) * w);
}

/* States from those of the step-by-step core. */
static void me_begin(fmu_me *me, const fs_stage *s)
{
    int d, l, m, p;
    memset(me, 0, sizeof *me);
    for (m = 0; m < FS_MODES; m++)
        for (d = 0; d < FS_DRIVES; d++)
            me_add_mode(s, d, m, &me->x[FMU_DEFLECTION_AT + m], &me->x[FMU_RATE_AT + m]);
    for (d = 0; d < FS_DRIVES; d++) {
        me->direction[d] = 1;
        if (fmu_voltage_at[d] >= 0) me->x[fmu_voltage_at[d]] = (double)s->drive[d].voltage;
        for (l = 0; l < fs_data_lags[d]; l++)
            me->x[fmu_lag_at[d] + l] = (double)s->drive[d].lag[l];
    }
    for (p = 0; p < FS_PROBES; p++)
        if (fmu_seen_at[p] >= 0) me->x[fmu_seen_at[p]] = (double)s->sensor[p].seen;
}

/* Rate of the voltage of an amplifier. */
static double me_voltage_rate(const fmu_me *me, const fs_drive *drive, int d)
{
    switch (me->mode[d]) {
    case ME_SLEWS_UP: return (double)drive->largest_rate;
    case ME_SLEWS_DOWN: return -(double)drive->largest_rate;
    case ME_AT_TOP:
    case ME_AT_BOTTOM: return 0.0;
    default: return me->away[d] * 6.283185307179586 * (double)drive->bandwidth_hz;
    }
}

static double me_reading(const fs_stage *s, int p, double seen, double time)
{
    const fs_sensor *sensor = &s->sensor[p];
    double y = (double)sensor->gain * seen + (double)sensor->offset;
    if (sensor->mains_amplitude != 0) {
        /* the phase is that of the first sample, which is one step after the start */
        const double turn = 6.283185307179586 * (double)sensor->mains_frequency_hz *
                            (time - (double)s->step);
        y += (double)sensor->mains_amplitude * sin(turn + (double)sensor->mains_phase);
    }
    if (sensor->quantisation > 0)
        y = (double)sensor->quantisation * rint(y / (double)sensor->quantisation);
    return y;
}

/* Current values of the drives: voltage, free displacement, lags of the creep. */
static void me_drive(fmu_me *me, fs_stage *s, const double *command, int d)
{
    fs_drive *drive = &s->drive[d];
    fs_real memory[FS_MEMORY_MAX];
    const double voltage = me_voltage(me, s, command, d);
    double w;
    int l;
    memcpy(memory, drive->memory, sizeof memory);
    w = me_through(s, d, memory, voltage);
    drive->voltage = (fs_real)voltage;
    drive->free = (fs_real)w;
    me->total[d] = w;
    for (l = 0; l < fs_data_lags[d]; l++) {
        const double lag = me->x[fmu_lag_at[d] + l];
        me->total[d] += me_lag_gain(s, d, l) * lag;
        me->rate[fmu_lag_at[d] + l] = me_lag_rate(d, l) * (w - lag);
    }
    me->away[d] = 0.0;
    if (fmu_voltage_at[d] >= 0) {
        me->away[d] = (double)drive->amplifier_gain * command[d] - voltage;
        me->rate[fmu_voltage_at[d]] = me_voltage_rate(me, drive, d);
    }
}

/* Derivatives and readings for the current states and commands; time is from the start. */
static void me_evaluate(fmu_me *me, fs_stage *s, const double *command, double time,
                        fs_real *reading)
{
    const double *q = &me->x[FMU_DEFLECTION_AT];
    int d, m, p;
    for (d = 0; d < FS_DRIVES; d++) me_drive(me, s, command, d);
    for (m = 0; m < FS_MODES; m++) {
        const double omega = me_omega(s, m), zeta = (double)s->modes.damping_ratio[m];
        double target = 0.0, v = me->x[FMU_RATE_AT + m];
        for (d = 0; d < FS_DRIVES; d++) {
            target += fmu_gain[d][m] * me->total[d];
            v += omega * omega * fmu_gain[d][m] * me_rate_time(s, d, m) * me->total[d];
        }
        me->rate[FMU_DEFLECTION_AT + m] = v;
        me->rate[FMU_RATE_AT + m] = omega * omega * (target - q[m]) - 2.0 * zeta * omega * v;
    }
    for (p = 0; p < FS_PROBES; p++) {
        double motion = 0.0;
        for (m = 0; m < FS_MODES; m++) motion += fmu_shape[p][m] * q[m];
        for (d = 0; d < FS_DRIVES; d++)
            motion += (double)fs_data_feedthrough[d][p] * me->total[d];
        if (fs_data_has_sensor[p]) {
            double seen = motion;
            if (fmu_seen_at[p] >= 0) {
                const double rate = 6.283185307179586 * (double)s->sensor[p].bandwidth_hz;
                if (rate > 0.0) seen = me->x[fmu_seen_at[p]];
                me->rate[fmu_seen_at[p]] = rate * (motion - seen);
            }
            motion = me_reading(s, p, seen, time);
        }
        reading[p] = (fs_real)motion;
    }
    me->fresh = 1;
}

/* Commit the hysteresis at the current voltages. */
static void me_commit(fmu_me *me, fs_stage *s, const double *command)
{
    int d;
    for (d = 0; d < FS_DRIVES; d++)
        me_through(s, d, s->drive[d].memory, me_voltage(me, s, command, d));
}

/* At an event: direction of each voltage, and active limit of its amplifier. */
static void me_update(fmu_me *me, fs_stage *s, const double *command)
{
    int d;
    for (d = 0; d < FS_DRIVES; d++) {
        const fs_drive *drive = &s->drive[d];
        const double u = me_voltage(me, s, command, d), pass = ME_PASS * fmu_usual_voltage[d];
        double e;
        if (fmu_voltage_at[d] < 0) continue;
        e = (double)drive->amplifier_gain * command[d] - u;
        me->direction[d] = e >= 0.0 ? 1 : -1;
        if (u >= (double)drive->highest - pass && e > 0.0)
            me->mode[d] = ME_AT_TOP;
        else if (u <= (double)drive->lowest + pass && e < 0.0)
            me->mode[d] = ME_AT_BOTTOM;
        else if (fabs(e) > (double)drive->threshold)
            me->mode[d] = e > 0.0 ? ME_SLEWS_UP : ME_SLEWS_DOWN;
        else
            me->mode[d] = ME_FOLLOWS;
    }
    me->fresh = 0;
}

/* Event indicators of an amplifier: reversal of its voltage, start and end of slewing, saturation.
 * Only a reversal ends saturation. */
static double me_indicator_of(const fmu_me *me, const fs_stage *s, int d, int which)
{
    const fs_drive *drive = &s->drive[d];
    const double pass = ME_PASS * fmu_usual_voltage[d], u = me->x[fmu_voltage_at[d]];
    double z;
    switch (which) {
    case 0: return me->direction[d] * me->away[d] + ME_TURN * fmu_usual_voltage[d];
    case 1: z = (double)drive->threshold - fabs(me->away[d]); break;
    case 2: z = (double)drive->highest + pass - u; break;
    default: z = u - (double)drive->lowest + pass; break;
    }
    if (me->mode[d] == ME_AT_TOP || me->mode[d] == ME_AT_BOTTOM) return 1.0;
    /* without a limit there is no event */
    return z - z == 0.0 ? z : 1.0;
}

static double me_indicator(const fmu_me *me, const fs_stage *s, unsigned k)
{
    return me_indicator_of(me, s, fmu_amplified[k / 4], (int)(k % 4));
}

#endif
