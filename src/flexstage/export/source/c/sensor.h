/* A sensor: gain, offset, first-order lag, mains pick-up, resolution. No noise. */
#ifndef FS_SENSOR_H
#define FS_SENSOR_H

#include "real.h"

#define FS_TWO_PI FS_R(6.283185307179586)

typedef struct {
    fs_real gain, offset;
    fs_real bandwidth_hz; /* 0: no lag */
    fs_real quantisation; /* 0: none */
    fs_real mains_amplitude, mains_frequency_hz, mains_phase;
    /* computed by fs_prepare: */
    fs_real decay, ramp;
    /* state: */
    fs_real last, lag;        /* the motion at the last sample, and the lag behind it */
    fs_real seen;             /* output of the lag at the last sample */
    unsigned long long count; /* number of the next sample */
} fs_sensor;

/* After a constant motion for a long time. */
static inline void fs_sensor_settle(fs_sensor *sensor, fs_real motion)
{
    sensor->last = sensor->lag = sensor->seen = motion;
    sensor->count = 0;
}

/* The motion jumps; the lag does not change. */
static inline void fs_sensor_jump(fs_sensor *sensor, fs_real motion)
{
    sensor->last = motion;
    if (!(sensor->bandwidth_hz > FS_R(0.0)))
        sensor->lag = sensor->seen = motion;
}

/* One sample on a straight line of the motion. */
static inline void fs_sensor_step(fs_sensor *sensor, fs_real motion)
{
    const fs_real rise = motion - sensor->last;
    const fs_real away = sensor->last - sensor->lag;
    sensor->seen = sensor->lag + away * sensor->decay + rise * sensor->ramp;
    sensor->lag += away * sensor->decay + rise * sensor->ramp;
    sensor->last = motion;
    sensor->count += 1;
}

/* Reading at the last sample. */
static inline fs_real fs_sensor_reading(const fs_sensor *sensor, fs_real step)
{
    fs_real y = sensor->gain * sensor->seen + sensor->offset;
    if (sensor->mains_amplitude != FS_R(0.0)) {
        const fs_real t = step * ((fs_real)sensor->count - FS_R(1.0));
        const fs_real turn = FS_TWO_PI * sensor->mains_frequency_hz * t + sensor->mains_phase;
        y += sensor->mains_amplitude * FS_SIN(turn);
    }
    if (sensor->quantisation > FS_R(0.0))
        y = sensor->quantisation * FS_RINT(y / sensor->quantisation);
    return y;
}

#endif
