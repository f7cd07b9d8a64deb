/* Values derived from the parameters, as exported and after changes.
 */
#ifndef FS_PREPARE_H
#define FS_PREPARE_H

#include "instance.h"
#include "model_data.h"
#include "modes.h"
#include "real.h"

/* The response g to an impulse after a time h, its rate, and its integrals
 * I[j] = int_0^h g(h - s) s^(j-1)/(j-1)! ds, I[0] = g, by power series; w h max(1, 2 zeta) <= 1. */
static inline void fs_impulse_series(fs_real w, fs_real zeta, fs_real h, fs_real *rate, fs_real *I)
{
    const fs_real x = w * h;
    fs_real power = h, factorial = FS_R(1.0);
    int j, n;
    *rate = FS_R(0.0);
    for (j = 0; j <= FS_ORDERS; j++) {
        fs_real low = FS_R(0.0), high = FS_R(1.0), sum = FS_R(0.0), slope = FS_R(0.0);
        fs_real term = FS_R(1.0) / factorial;
        for (n = 1; n < 24; n++) {
            const fs_real following = -FS_R(2.0) * zeta * x * high - x * x * low;
            slope += high * term;
            term /= (fs_real)(n + j);
            sum += high * term;
            low = high;
            high = following;
        }
        if (j == 0)
            *rate = slope;
        I[j] = power * sum;
        power *= h;
        factorial *= (fs_real)(j + 1);
    }
}

/* The same for a step of one sample, by that of a short one, doubled; and the transition. */
static inline void fs_impulse_doubled(fs_real w, fs_real zeta, fs_real *transition, fs_real *I)
{
    const fs_real size = w * (FS_R(2.0) * zeta > FS_R(1.0) ? FS_R(2.0) * zeta : FS_R(1.0));
    fs_real h = FS_R(1.0), rate, zz, zv, vz, vv;
    int doublings = 0, i, j, k;
    while (size * h > FS_R(1.0) && doublings < 60) {
        h *= FS_R(0.5);
        doublings++;
    }
    fs_impulse_series(w, zeta, h, &rate, I);
    zz = rate + FS_R(2.0) * zeta * w * I[0];
    zv = I[0];
    vz = -w * w * I[0];
    vv = rate;
    for (i = 0; i < doublings; i++) {
        fs_real doubled[FS_ORDERS + 1];
        fs_real a, b, c, d;
        for (k = 0; k < FS_ORDERS; k++) {
            /* the first half continues, the second has (s + h)^k/k! */
            fs_real share = FS_R(1.0);
            doubled[k + 1] = zz * I[k + 1] + zv * I[k];
            for (j = k; j >= 0; j--) {
                doubled[k + 1] += share * I[j + 1];
                share *= h / (fs_real)(k - j + 1);
            }
        }
        a = zz * zz + zv * vz;
        b = zz * zv + zv * vv;
        c = vz * zz + vv * vz;
        d = vz * zv + vv * vv;
        zz = a;
        zv = b;
        vz = c;
        vv = d;
        doubled[0] = zv;
        for (k = 0; k <= FS_ORDERS; k++)
            I[k] = doubled[k];
        h *= FS_R(2.0);
    }
    transition[0] = zz;
    transition[1] = zv;
    transition[2] = vz;
    transition[3] = vv;
}

/* Transition of a mode over one sample, in which it turns by w. */
static inline void fs_unit_step(fs_real w, fs_real zeta, fs_real *transition, fs_real *moments)
{
    fs_real I[FS_ORDERS + 1];
    int j;
    fs_impulse_doubled(w, zeta, transition, I);
    for (j = 0; j <= FS_ORDERS; j++)
        moments[j] = w * w * I[j];
}

/* Ramp share of a lag in a step; r is the step over the time constant. */
static inline fs_real fs_ramp_share(fs_real r)
{
    fs_real share = FS_R(0.0);
    int k;
    if (!(r < FS_R(1.0)))
        return FS_R(1.0) + FS_EXPM1(-r) / r;
    for (k = 18; k > 0; k--)
        share = r / ((fs_real)k + FS_R(1.0)) * (FS_R(1.0) - share);
    return share;
}

static inline int fs_positive(fs_real x)
{
    return x > FS_R(0.0) && FS_FINITE(x);
}

static inline const char *fs_prepare_modes(fs_stage *s)
{
    fs_modes *modes = &s->modes;
    int m, j;
    for (m = 0; m < FS_MODES; m++) {
        const fs_real zeta = modes->damping_ratio[m];
        fs_real transition[4], moments[FS_ORDERS + 1];
        if (!fs_positive(modes->frequency_hz[m]))
            return "the frequency of a mode must be positive and finite";
        if (!(zeta >= FS_R(0.0) && FS_FINITE(zeta)))
            return "the damping ratio of a mode must be finite and not negative";
        modes->angle[m] = FS_TWO_PI * modes->frequency_hz[m] * s->step;
        fs_unit_step(modes->angle[m], zeta, transition, moments);
        for (j = 0; j < 4; j++)
            modes->transition[j][m] = transition[j];
        for (j = 0; j <= FS_ORDERS; j++)
            modes->moments[j][m] = moments[j];
    }
    fs_modes_swing(modes);
    return 0;
}

#if FS_HAS_CREEP
/* Weights of a drive with creep: a mode behind a lag is (1 - c) z - c z'/(tau omega^2) + c l. */
static inline const char *fs_prepare_creep(fs_stage *s, int d)
{
    fs_drive *drive = &s->drive[d];
    const int lags = fs_data_lags[d];
    const fs_real rise = drive->creep_rate;
    int m, l, p;
    if (!(drive->creep_rate >= FS_R(0.0) && FS_FINITE(drive->creep_rate)))
        return "the rate of the creep must be finite and not negative";
    for (p = 0; p < FS_PROBES; p++)
        for (l = 0; l < lags; l++)
            drive->reader_lag[p][l] = fs_data_feedthrough[d][p] * rise * fs_data_lag_share[d][l];
    for (m = 0; m < FS_MODES; m++) {
        const fs_real omega = FS_TWO_PI * s->modes.frequency_hz[m];
        const fs_real zeta = s->modes.damping_ratio[m];
        fs_real apart = FS_R(0.0), lost = FS_R(0.0);
        for (l = 0; l < lags; l++) {
            const fs_real rate = fs_data_lag_rate[d][l], x = rate / omega;
            const fs_real below = FS_R(1.0) - FS_R(2.0) * zeta * x + x * x;
            const fs_real c = FS_R(1.0) / below, gain = rise * fs_data_lag_share[d][l];
            if (!(FS_ABS(below) >= FS_R(1e-6)))
                return "an overdamped mode coincides with a lag of the creep: change its damping "
                       "or its frequency";
            /* 1 - c, without cancellation */
            apart += gain * (x * x - FS_R(2.0) * zeta * x) * c;
            lost += gain * c * rate;
            for (p = 0; p < FS_PROBES; p++)
                drive->reader_lag[p][l] += gain * fs_data_reach[d][p][m] * c;
        }
        for (p = 0; p < FS_PROBES; p++) {
            drive->reader_z[p][m] = fs_data_reach[d][p][m] * (FS_R(1.0) + apart);
            drive->reader_v[p][m] =
                -fs_data_reach[d][p][m] * lost / (omega * omega) / s->step;
        }
    }
    return 0;
}
#endif

static inline const char *fs_prepare_drive(fs_stage *s, int d)
{
    fs_drive *drive = &s->drive[d];
    int m;
    for (m = 0; m < fs_data_parameters_used[d]; m++)
        if (!FS_FINITE(drive->parameters[m]))
            return "a parameter of the hysteresis must be finite";
    if (!FS_FINITE(drive->gain))
        return "the gain of a drive must be finite";
    if (fs_data_has_amplifier[d]) {
        if (!fs_positive(drive->bandwidth_hz))
            return "the bandwidth of an amplifier must be positive and finite";
        if (!FS_FINITE(drive->amplifier_gain) || drive->amplifier_gain == FS_R(0.0))
            return "the gain of an amplifier must be finite, not 0";
        if (!(drive->largest_rate > FS_R(0.0)))
            return "the largest rate of an amplifier must be positive";
        if (!(drive->lowest < drive->highest))
            return "the range of an amplifier must rise";
        drive->amplifier_step = s->step / (FS_R(1.0) / (FS_TWO_PI * drive->bandwidth_hz));
        drive->threshold = drive->largest_rate * (FS_R(1.0) / (FS_TWO_PI * drive->bandwidth_hz));
    }
    if (fs_data_imposed[d])
        for (m = 0; m < FS_MODES; m++)
            drive->by_rate[m] = FS_R(2.0) * s->modes.damping_ratio[m] / s->modes.angle[m];
#if FS_HAS_CREEP
    if (fs_data_lags[d] > 0)
        return fs_prepare_creep(s, d);
#endif
    return 0;
}

static inline const char *fs_prepare_sensor(fs_stage *s, fs_sensor *sensor)
{
    if (!FS_FINITE(sensor->gain) || sensor->gain == FS_R(0.0))
        return "the gain of a sensor must be finite, not 0";
    if (!(sensor->quantisation >= FS_R(0.0)) || !(sensor->mains_frequency_hz >= FS_R(0.0)))
        return "the quantisation and the mains frequency of a sensor must not be negative";
    if (!(sensor->bandwidth_hz >= FS_R(0.0)))
        return "the bandwidth of a sensor must be positive, or 0 for no lag";
    sensor->decay = sensor->ramp = FS_R(1.0);
    if (sensor->bandwidth_hz > FS_R(0.0)) {
        const fs_real ratio = s->step / (FS_R(1.0) / (FS_TWO_PI * sensor->bandwidth_hz));
        sensor->decay = -FS_EXPM1(-ratio);
        sensor->ramp = fs_ramp_share(ratio);
    }
    return 0;
}

/* All values derived from the parameters. */
static inline const char *fs_prepare_all(fs_stage *s)
{
    const char *message = fs_prepare_modes(s);
    int d, p;
    for (d = 0; d < FS_DRIVES && !message; d++)
        message = fs_prepare_drive(s, d);
    for (p = 0; p < FS_PROBES && !message; p++)
        if (fs_data_has_sensor[p])
            message = fs_prepare_sensor(s, &s->sensor[p]);
    return message;
}

static inline void fs_init_drive(fs_drive *drive, int d)
{
    const fs_real *given = fs_data_drive[d];
    int i, j, p;
    drive->gain = given[0];
    drive->bandwidth_hz = given[1];
    drive->amplifier_gain = given[2];
    drive->largest_rate = given[3];
    drive->lowest = given[4];
    drive->highest = given[5];
    drive->creep_rate = given[6];
    drive->amplifier_step = given[7];
    drive->threshold = given[8];
    for (i = 0; i < FS_PARAMETERS_MAX; i++)
        drive->parameters[i] = fs_data_parameters[d][i];
    for (i = 0; i < FS_MODES; i++) {
        drive->by_rate[i] = fs_data_by_rate[d][i];
        for (p = 0; p < FS_PROBES; p++) {
            drive->reader_z[p][i] = fs_data_reader_z[d][p][i];
            drive->reader_v[p][i] = fs_data_reader_v[d][p][i];
        }
    }
    for (i = 0; i < FS_LAGS_MAX; i++) {
        drive->lags.ratio[i] = fs_data_lag_ratio[d][i];
        drive->lags.decay[i] = fs_data_lag_decay[d][i];
        for (j = 0; j < FS_ORDERS; j++)
            drive->lags.moments[j][i] = fs_data_lag_moments[d][j][i];
        for (p = 0; p < FS_PROBES; p++)
            drive->reader_lag[p][i] = fs_data_reader_lag[d][p][i];
    }
}

/* All parameters as exported; the state is not set. */
static inline void fs_init_parameters(fs_stage *s)
{
    int d, p, i, j;
    s->step = FS_STEP;
    for (i = 0; i < FS_MODES; i++) {
        s->modes.frequency_hz[i] = fs_data_frequency_hz[i];
        s->modes.damping_ratio[i] = fs_data_damping_ratio[i];
        s->modes.angle[i] = fs_data_angle[i];
        for (j = 0; j < 4; j++)
            s->modes.transition[j][i] = fs_data_transition[j][i];
        for (j = 0; j <= FS_ORDERS; j++)
            s->modes.moments[j][i] = fs_data_moments[j][i];
    }
    fs_modes_swing(&s->modes);
    for (d = 0; d < FS_DRIVES; d++)
        fs_init_drive(&s->drive[d], d);
    for (p = 0; p < FS_PROBES; p++) {
        const fs_real *given = fs_data_sensor[p];
        fs_sensor *sensor = &s->sensor[p];
        sensor->gain = given[0];
        sensor->offset = given[1];
        sensor->bandwidth_hz = given[2];
        sensor->quantisation = given[3];
        sensor->mains_amplitude = given[4];
        sensor->mains_frequency_hz = given[5];
        sensor->mains_phase = given[6];
        sensor->decay = given[7];
        sensor->ramp = given[8];
    }
}

#endif
