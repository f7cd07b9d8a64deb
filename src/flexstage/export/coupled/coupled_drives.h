/* State at the last sample. All zero: after a long rest at the operating point. A byte copy of it
 * is a saved state. */
typedef struct {
    double system[FS_POLES][2]; /* real and imaginary part */
    double modes[FS_MODES][2];
    double total[FS_INPUTS];
    double lags[FS_LAGS][FS_INPUTS];
    double lagged[FS_INPUTS];
    double force_square[FS_INPUTS];
    double voltage_square[FS_INPUTS];
} fs_state;

/* Solve a linear system that is near the identity, without pivots. */
static inline void fs_solve(double matrix[FS_INPUTS][FS_INPUTS], double values[FS_INPUTS])
{
    int i, c, row;
    for (i = 0; i < FS_INPUTS; i++)
        for (row = i + 1; row < FS_INPUTS; row++) {
            const double factor = matrix[row][i] / matrix[i][i];
            for (c = i; c < FS_INPUTS; c++)
                matrix[row][c] -= factor * matrix[i][c];
            values[row] -= factor * values[i];
        }
    for (i = FS_INPUTS - 1; i >= 0; i--) {
        for (c = i + 1; c < FS_INPUTS; c++)
            values[i] -= matrix[i][c] * values[c];
        values[i] /= matrix[i][i];
    }
}

/* Lags and modes up to the next sample, but for what its voltage does; the softening of its level.
 */
static inline void fs_begin(fs_state *s, double softening[FS_INPUTS], double level[FS_INPUTS],
                            double force[FS_INPUTS], double driven[FS_INPUTS])
{
    int a, i, q;
    for (a = 0; a < FS_INPUTS; a++) {
        softening[a] = fs_strength[a] * (pow(s->force_square[a], FS_FORCE_POWER) -
                                         fs_force_reference[a]);
        level[a] = pow(s->voltage_square[a], FS_VOLTAGE_POWER) - fs_voltage_reference[a];
        force[a] = 0.0;
        driven[a] = 0.0;
        for (q = 0; q < FS_LAGS; q++) {
            s->lags[q][a] = fs_lag_decay[q] * s->lags[q][a] + fs_lag_before[q] * s->lagged[a];
            driven[a] += fs_lag_gains[q] * s->lags[q][a];
        }
    }
    for (i = 0; i < FS_MODES; i++) {
        const double *e = fs_mode_decay[i];
        const double re = s->modes[i][0], im = s->modes[i][1];
        double projected = 0.0, free_part;
        for (a = 0; a < FS_INPUTS; a++)
            projected += fs_mode_shapes[i][a] * s->total[a];
        s->modes[i][0] = (e[0] * re - e[1] * im) + fs_mode_before[i][0] * projected;
        s->modes[i][1] = (e[0] * im + e[1] * re) + fs_mode_before[i][1] * projected;
        free_part = fs_mode_gains[i][0] * s->modes[i][0] - fs_mode_gains[i][1] * s->modes[i][1];
        for (a = 0; a < FS_INPUTS; a++)
            force[a] += free_part * fs_mode_shapes[i][a];
    }
}

static inline void fs_init(fs_state *s)
{
    memset(s, 0, sizeof *s);
}

/* The voltages at the next sample at which the drives give totals, the inputs of a linear
 * controller or of an inverse of the linear system. The state does not change. */
static inline void fs_voltages(const fs_state *s, const double totals[FS_INPUTS],
                               double voltages[FS_INPUTS])
{
    double softening[FS_INPUTS], level[FS_INPUTS], force[FS_INPUTS], driven[FS_INPUTS];
    double loop[FS_INPUTS][FS_INPUTS];
    fs_state next = *s;
    int a, c;
    fs_begin(&next, softening, level, force, driven);
    for (a = 0; a < FS_INPUTS; a++) {
        double value = force[a];
        for (c = 0; c < FS_INPUTS; c++) {
            value += fs_direct[a][c] * totals[c];
            loop[a][c] = softening[a] * fs_force_gains[a][c];
        }
        loop[a][a] += 1.0 + FS_MEMORY_AT_ONCE * level[a];
        voltages[a] = totals[a] - driven[a] - softening[a] * value;
    }
    fs_solve(loop, voltages);
}

/* One sample: voltages, deviations from the operating point, are straight since the last one. The
 * result is 0, or a message if a level is above those of the records; the readings are then an
 * extrapolation. */
static inline const char *fs_step(fs_state *s, const double voltages[FS_INPUTS],
                                  double readings[FS_OUTPUTS])
{
    double softening[FS_INPUTS], level[FS_INPUTS], force[FS_INPUTS], driven[FS_INPUTS];
    double loop[FS_INPUTS][FS_INPUTS];
    const char *message = 0;
    int a, c, i, q;
    fs_begin(s, softening, level, force, driven);
    for (a = 0; a < FS_INPUTS; a++) {
        s->lagged[a] = level[a] * voltages[a];
        driven[a] += voltages[a] + FS_MEMORY_AT_ONCE * s->lagged[a];
        for (q = 0; q < FS_LAGS; q++)
            s->lags[q][a] += fs_lag_after[q] * s->lagged[a];
    }
    for (a = 0; a < FS_INPUTS; a++)
        for (c = 0; c < FS_INPUTS; c++) {
            force[a] += fs_force_gains[a][c] * voltages[c] + fs_direct[a][c] * driven[c];
            loop[a][c] = (a == c ? 1.0 : 0.0) - fs_direct[a][c] * softening[c];
        }
    fs_solve(loop, force);
    for (a = 0; a < FS_INPUTS; a++) {
        s->total[a] = driven[a] + softening[a] * force[a];
        s->force_square[a] += FS_LEVEL_SHARE * (force[a] * force[a] - s->force_square[a]);
        s->voltage_square[a] += FS_LEVEL_SHARE * (voltages[a] * voltages[a] - s->voltage_square[a]);
        if (s->voltage_square[a] > fs_largest_square[a])
            message = "a level is above those of the records";
    }
    for (i = 0; i < FS_MODES; i++) {
        double projected = 0.0;
        for (a = 0; a < FS_INPUTS; a++)
            projected += fs_mode_shapes[i][a] * s->total[a];
        s->modes[i][0] += fs_mode_after[i][0] * projected;
        s->modes[i][1] += fs_mode_after[i][1] * projected;
    }
    for (a = 0; a < FS_OUTPUTS; a++) {
        double value = 0.0;
        for (c = 0; c < FS_INPUTS; c++)
            value += fs_feedthrough[a][c] * s->total[c];
        for (i = 0; i < FS_POLES; i++)
            value += fs_output_shapes[a][i][0] * s->system[i][0] -
                     fs_output_shapes[a][i][1] * s->system[i][1];
        readings[a] = value;
    }
    for (i = 0; i < FS_POLES; i++) {
        const double *e = fs_poles[i];
        const double re = s->system[i][0], im = s->system[i][1];
        double next_re = e[0] * re - e[1] * im, next_im = e[0] * im + e[1] * re;
        for (c = 0; c < FS_INPUTS; c++) {
            next_re += fs_input_shapes[i][c][0] * s->total[c];
            next_im += fs_input_shapes[i][c][1] * s->total[c];
        }
        s->system[i][0] = next_re;
        s->system[i][1] = next_im;
    }
    return message;
}
