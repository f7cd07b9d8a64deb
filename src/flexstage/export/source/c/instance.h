/* An instance of the stage: parameters, derived values, state. */
#ifndef FS_INSTANCE_H
#define FS_INSTANCE_H

#include "lags.h"
#include "model_data.h"
#include "modes.h"
#include "real.h"
#include "sensor.h"

#define FS_FINITE(x) ((x) - (x) == FS_R(0.0))

/* One drive: amplifier, hysteresis or gain, creep, and modes under this drive. */
typedef struct {
    /* parameters: */
    fs_real gain;                          /* free displacement over voltage, without hysteresis */
    fs_real parameters[FS_PARAMETERS_MAX]; /* of the hysteresis */
    fs_real bandwidth_hz;                  /* of the amplifier; unused without one, as the next four */
    fs_real amplifier_gain;
    fs_real largest_rate;                  /* [V/s] */
    fs_real lowest, highest;               /* [V] */
    fs_real creep_rate;                    /* rise in a decade of time over the step */
    /* computed by fs_prepare: */
    fs_real amplifier_step, threshold;     /* step over time constant; rate times time constant */
    fs_real by_rate[FS_MODES];             /* rate time over the step */
    fs_real reader_z[FS_PROBES][FS_MODES]; /* weights of the deflections */
    fs_real reader_v[FS_PROBES][FS_MODES]; /* of their rates [per sample] */
    fs_real reader_lag[FS_PROBES][FS_LAGS_MAX];
    fs_lags lags;
    /* state: */
    fs_real command;                       /* the last one */
    fs_real voltage;                       /* behind the amplifier */
    fs_real free;                          /* free displacement [m], or force [N] */
    fs_real memory[FS_MEMORY_MAX];         /* of the hysteresis; the first is its last input */
    fs_real lag[FS_LAGS_MAX];              /* lags of the creep */
    fs_real lag_rest[FS_LAGS_MAX];         /* carried rounding errors, in single precision */
    fs_real z[FS_MODES], rate[FS_MODES];   /* deflections and their rates [per second] */
} fs_drive;

typedef struct fs_stage fs_stage;
struct fs_stage {
    fs_real step; /* [s] */
    fs_modes modes;
    fs_drive drive[FS_DRIVES];
    fs_sensor sensor[FS_PROBES];
    fs_real motion[FS_PROBES]; /* at the probes, before their sensors */
};

#endif
