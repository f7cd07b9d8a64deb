/* One running stage for FMI 2 and FMI 3: phases, variables, steps, saved states.
 *
 * All variable data are in fmu_body, which has no pointer: a byte copy is a saved state.
 */
#ifndef FMU_BODY_H
#define FMU_BODY_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu_data.h"
#include "me.h"
#include "stage.h"

/* Values as in FMI 2 and FMI 3. */
enum { FMU_OK, FMU_WARNING, FMU_DISCARD, FMU_ERROR };
enum { FMU_MODEL_EXCHANGE, FMU_CO_SIMULATION };
enum { FMU_HOLD, FMU_LINE };
enum {
    FMU_INSTANTIATED = 1,
    FMU_INITIALIZATION = 2,
    FMU_STEPPING = 4,
    FMU_EVENT = 8,
    FMU_CONTINUOUS = 16,
    FMU_TERMINATED = 32,
    FMU_FAILED = 64
};
#define FMU_RUNNING (FMU_STEPPING | FMU_EVENT | FMU_CONTINUOUS)
#define FMU_STARTING (FMU_INSTANTIATED | FMU_INITIALIZATION)
#define FMU_ALIVE (FMU_STARTING | FMU_RUNNING | FMU_TERMINATED)

typedef struct {
    fs_stage stage;
    fmu_me me;
    double start;               /* start time of the simulation [s] */
    double time;                /* now [s] */
    double steps;               /* steps done since the start, a whole number */
    double command[FS_DRIVES];  /* as set by the importer */
    double last[FS_DRIVES];     /* command at the end of the last step */
    double slope[FS_DRIVES];    /* rate of the command in the next step, if set */
    fs_real reading[FS_PROBES];
    int32_t sloped[FS_DRIVES];
    int32_t kind, phase, interpolation;
    int32_t untuned;            /* parameters changed, derived values outdated */
    int32_t unsettled;          /* start values changed, state outdated */
} fmu_body;

typedef struct {
    fmu_body body;
    char text[512];             /* the last message */
} fmu_instance;

static const char *fmu_phase_name(int phase)
{
    switch (phase) {
    case FMU_INSTANTIATED: return "instantiated";
    case FMU_INITIALIZATION: return "initialization mode";
    case FMU_STEPPING: return "step mode";
    case FMU_EVENT: return "event mode";
    case FMU_CONTINUOUS: return "continuous-time mode";
    case FMU_TERMINATED: return "terminated";
    default: return "failed";
    }
}

static void fmu_begin(fmu_body *b, int kind)
{
    memset(b, 0, sizeof *b);
    fs_init(&b->stage);
    b->kind = kind;
    b->phase = FMU_INSTANTIATED;
    b->interpolation = FMU_INTERPOLATION_START;
    b->unsettled = 1;
}

/* 1 if the call is allowed now; else 0, with a message. */
static int fmu_allowed(fmu_instance *c, int phases, const char *call)
{
    if (c->body.phase & phases) return 1;
    snprintf(c->text, sizeof c->text, "%s cannot be called now: the instance is in phase '%s'",
             call, fmu_phase_name(c->body.phase));
    return 0;
}

static int fmu_fail(fmu_instance *c, const char *message)
{
    snprintf(c->text, sizeof c->text, "%s", message);
    c->body.phase = FMU_FAILED;
    return FMU_ERROR;
}

/* Update derived values and state after changes. */
static int fmu_refresh(fmu_instance *c)
{
    fmu_body *b = &c->body;
    if (b->untuned) {
        const char *message = fs_prepare(&b->stage);
        /* not fatal: another value may be set */
        if (message) {
            snprintf(c->text, sizeof c->text, "a parameter cannot be used: %s", message);
            return FMU_ERROR;
        }
        b->untuned = 0;
        b->me.fresh = 0;
    }
    if (b->unsettled && (b->phase & FMU_STARTING)) {
        fs_real commands[FS_DRIVES];
        int d;
        for (d = 0; d < FS_DRIVES; d++) {
            commands[d] = (fs_real)b->command[d];
            b->last[d] = b->command[d];
        }
        fs_settle(&b->stage, commands);
        fs_readings(&b->stage, b->reading);
        me_begin(&b->me, &b->stage);
        b->unsettled = 0;
    }
    if (b->kind == FMU_MODEL_EXCHANGE && !b->me.fresh)
        me_evaluate(&b->me, &b->stage, b->command, b->time - b->start, b->reading);
    return FMU_OK;
}

/* States and derivatives at the end of the last step, without effect on the steps. */
static void fmu_look(fmu_body *b)
{
    fs_real unused[FS_PROBES], voltage[FS_DRIVES], w[FS_DRIVES];
    int d;
    for (d = 0; d < FS_DRIVES; d++) {
        voltage[d] = b->stage.drive[d].voltage;
        w[d] = b->stage.drive[d].free;
    }
    me_begin(&b->me, &b->stage);
    me_evaluate(&b->me, &b->stage, b->last, b->time - b->start, unused);
    for (d = 0; d < FS_DRIVES; d++) {
        b->stage.drive[d].voltage = voltage[d];
        b->stage.drive[d].free = w[d];
    }
}

static int fmu_get(fmu_instance *c, unsigned reference, double *value)
{
    fmu_body *b = &c->body;
    unsigned k = reference;
    if (k == FMU_TIME) {
        *value = b->time;
        return FMU_OK;
    }
    if (k - FMU_FIRST_PARAMETER < FMU_PARAMETERS) {
        *value = (double)*fmu_parameter(&b->stage, k);
        return FMU_OK;
    }
    if (k - FMU_FIRST_INPUT < FS_DRIVES) {
        *value = b->command[k - FMU_FIRST_INPUT];
        return FMU_OK;
    }
    if (fmu_refresh(c) != FMU_OK) return FMU_ERROR;
    if (k - FMU_FIRST_OUTPUT < FS_PROBES) {
        *value = (double)b->reading[k - FMU_FIRST_OUTPUT];
    } else if (k - FMU_FIRST_LOCAL < FMU_LOCALS) {
        *value = (double)fmu_local(&b->stage, k);
    } else if (k - FMU_FIRST_STATE < 2 * FMU_STATES + FMU_INDICATORS) {
        /* under co-simulation the states follow from those of the steps */
        if (b->kind == FMU_CO_SIMULATION && !b->me.fresh) fmu_look(b);
        if (k - FMU_FIRST_STATE < FMU_STATES)
            *value = me_state(&b->me, k - FMU_FIRST_STATE);
        else if (k - FMU_FIRST_DERIVATIVE < FMU_STATES)
            *value = me_derivative(&b->me, k - FMU_FIRST_DERIVATIVE);
        else
            *value = me_indicator(&b->me, &b->stage, k - FMU_FIRST_INDICATOR);
    } else {
        snprintf(c->text, sizeof c->text,
                 "there is no floating-point variable of value reference %u: see "
                 "modelDescription.xml", k);
        return FMU_ERROR;
    }
    return FMU_OK;
}

static int fmu_set(fmu_instance *c, unsigned reference, double value)
{
    fmu_body *b = &c->body;
    unsigned k = reference;
    if (!(value - value == 0.0)) {
        snprintf(c->text, sizeof c->text,
                 "the variable of value reference %u must be a finite number, got %g", k, value);
        return FMU_ERROR;
    }
    if (k - FMU_FIRST_PARAMETER < FMU_PARAMETERS) {
        *fmu_parameter(&b->stage, k) = (fs_real)value;
        b->untuned = 1;
        b->unsettled = 1;
    } else if (k - FMU_FIRST_INPUT < FS_DRIVES) {
        b->command[k - FMU_FIRST_INPUT] = value;
        b->unsettled = 1;
    } else {
        snprintf(c->text, sizeof c->text,
                 "the variable of value reference %u cannot be set: only inputs and parameters "
                 "can", k);
        return FMU_ERROR;
    }
    b->me.fresh = 0;
    return FMU_OK;
}

static int fmu_set_interpolation(fmu_instance *c, int value)
{
    if (!fmu_allowed(c, FMU_STARTING, "setting interpolation")) return FMU_ERROR;
    if (value != FMU_HOLD && value != FMU_LINE) {
        snprintf(c->text, sizeof c->text, "interpolation must be 0 (hold) or 1 (line), got %d",
                 value);
        return FMU_ERROR;
    }
    c->body.interpolation = value;
    return FMU_OK;
}

static int fmu_enter_initialization(fmu_instance *c, double start)
{
    c->body.start = c->body.time = start;
    c->body.phase = FMU_INITIALIZATION;
    c->body.unsettled = 1;
    return FMU_OK;
}

static int fmu_exit_initialization(fmu_instance *c)
{
    fmu_body *b = &c->body;
    if (fmu_refresh(c) != FMU_OK) return FMU_ERROR;
    b->phase = b->kind == FMU_CO_SIMULATION ? FMU_STEPPING : FMU_EVENT;
    return FMU_OK;
}

/* Whether a communication step is possible; else with a message. */
static int fmu_check_step(fmu_instance *c, double from, double size, double *count)
{
    fmu_body *b = &c->body;
    double step = (double)b->stage.step, ratio = size / step, whole = floor(ratio + 0.5);
    if (!(whole >= 1.0 && fabs(ratio - whole) <= 1e-9 * whole)) {
        double near = whole >= 1.0 && whole < 1e15 ? whole : 1.0;
        snprintf(c->text, sizeof c->text,
                 "the communication step must be a whole multiple of the step of the model, "
                 "%.10g s, got %.10g s: use %.10g s, or export the model with another step",
                 step, size, near * step);
        return FMU_DISCARD;
    }
    /* tolerance for an importer that accumulates rounding errors: a tenth of a step */
    if (!(fabs(from - b->time) <= 0.1 * step)) {
        snprintf(c->text, sizeof c->text,
                 "the step must start where the last one ended, at %.10g s, got %.10g s: restore "
                 "a state that was saved there, or reset", b->time, from);
        return FMU_DISCARD;
    }
    *count = whole;
    return FMU_OK;
}

static int fmu_do_step(fmu_instance *c, double from, double size)
{
    fmu_body *b = &c->body;
    double from_command[FS_DRIVES], rise[FS_DRIVES], count = 0.0, k;
    fs_real now[FS_DRIVES];
    int d, jumps = 0, status = fmu_check_step(c, from, size, &count);
    if (status != FMU_OK) return status;
    if (fmu_refresh(c) != FMU_OK) return FMU_ERROR;
    for (d = 0; d < FS_DRIVES; d++) {
        double set = b->command[d], last = b->last[d];
        if (b->sloped[d]) {
            /* a continuous command within rounding is not a jump */
            from_command[d] = fabs(set - last) <= 1e-12 * fabs(last) ? last : set;
            rise[d] = b->slope[d] * count * (double)b->stage.step;
        } else {
            from_command[d] = b->interpolation == FMU_LINE ? last : set;
            rise[d] = set - from_command[d];
        }
        jumps |= from_command[d] != last;
        now[d] = (fs_real)from_command[d];
    }
    if (jumps) fs_jump(&b->stage, now);
    for (k = 1.0; k <= count; k += 1.0) {
        const char *message;
        for (d = 0; d < FS_DRIVES; d++) {
            double at = k < count ? from_command[d] + rise[d] * (k / count)
                                  : from_command[d] + rise[d];
            /* the end of a line is exact */
            if (k == count && !b->sloped[d]) at = b->command[d];
            now[d] = (fs_real)at;
            b->last[d] = at;
        }
        message = fs_step(&b->stage, now, b->reading);
        if (message) return fmu_fail(c, message);
        b->steps += 1.0;
    }
    b->time = b->start + b->steps * (double)b->stage.step;
    for (d = 0; d < FS_DRIVES; d++) b->sloped[d] = 0;
    b->me.fresh = 0;
    return FMU_OK;
}

/* End of an integrator step or event: the hysteresis is committed. */
static int fmu_commit(fmu_instance *c)
{
    fmu_body *b = &c->body;
    if (fmu_refresh(c) != FMU_OK) return FMU_ERROR;
    me_commit(&b->me, &b->stage, b->command);
    return FMU_OK;
}

static int fmu_update_events(fmu_instance *c)
{
    if (fmu_commit(c) != FMU_OK) return FMU_ERROR;
    me_update(&c->body.me, &c->body.stage, c->body.command);
    return FMU_OK;
}

/* ---- all states at once, for a solver ---- */

static int fmu_set_states(fmu_instance *c, const double *x)
{
    int k;
    for (k = 0; k < FMU_STATES; k++) me_set_state(&c->body.me, k, x[k]);
    c->body.me.fresh = 0;
    return FMU_OK;
}

static int fmu_states(fmu_instance *c, double *x)
{
    int k;
    if (fmu_refresh(c) != FMU_OK) return FMU_ERROR;
    for (k = 0; k < FMU_STATES; k++) x[k] = me_state(&c->body.me, k);
    return FMU_OK;
}

static int fmu_derivatives(fmu_instance *c, double *x)
{
    int k;
    if (fmu_refresh(c) != FMU_OK) return FMU_ERROR;
    for (k = 0; k < FMU_STATES; k++) x[k] = me_derivative(&c->body.me, k);
    return FMU_OK;
}

static int fmu_indicators(fmu_instance *c, double *z)
{
    int k;
    if (fmu_refresh(c) != FMU_OK) return FMU_ERROR;
    for (k = 0; k < FMU_INDICATORS; k++) z[k] = me_indicator(&c->body.me, &c->body.stage, k);
    return FMU_OK;
}

/* ---- saved states: a header with the model, then the bytes ---- */

typedef struct {
    char token[48];
    uint64_t size, sum;
} fmu_head;

typedef struct {
    fmu_head head;
    fmu_body body;
} fmu_saved;

static uint64_t fmu_sum(const void *data, size_t size)
{
    const unsigned char *byte = (const unsigned char *)data;
    uint64_t sum = UINT64_C(14695981039346656037);
    size_t k;
    for (k = 0; k < size; k++) sum = (sum ^ byte[k]) * UINT64_C(1099511628211);
    return sum;
}

/* Save into *kept, which is allocated if it is NULL. */
static int fmu_save(fmu_instance *c, void **kept)
{
    fmu_saved *saved = (fmu_saved *)*kept;
    if (!saved) saved = (fmu_saved *)calloc(1, sizeof *saved);
    if (!saved) {
        snprintf(c->text, sizeof c->text, "no memory for a saved state of %lu bytes",
                 (unsigned long)sizeof *saved);
        return FMU_ERROR;
    }
    memset(saved, 0, sizeof *saved);
    memcpy(saved->head.token, FMU_TOKEN, sizeof FMU_TOKEN);
    saved->head.size = sizeof *saved;
    memcpy(&saved->body, &c->body, sizeof c->body);
    saved->head.sum = fmu_sum(&saved->body, sizeof saved->body);
    *kept = saved;
    return FMU_OK;
}

/* Whether bytes are an undamaged state of this model. */
static int fmu_is_state(fmu_instance *c, const void *data, size_t size)
{
    fmu_head head;
    if (data && size >= sizeof head) {
        memcpy(&head, data, sizeof head);
        if (memcmp(head.token, FMU_TOKEN, sizeof FMU_TOKEN) != 0) {
            snprintf(c->text, sizeof c->text,
                     "the state was saved by another model, or by another build of this one");
            return 0;
        }
        if (size == sizeof(fmu_saved) && head.size == size &&
            head.sum == fmu_sum((const char *)data + sizeof head, size - sizeof head))
            return 1;
    }
    snprintf(c->text, sizeof c->text,
             "the state is damaged: %lu bytes are needed as they were saved, got %lu",
             (unsigned long)sizeof(fmu_saved), (unsigned long)size);
    return 0;
}

static int fmu_restore(fmu_instance *c, const void *kept)
{
    const fmu_saved *saved = (const fmu_saved *)kept;
    if (!fmu_is_state(c, kept, kept ? sizeof(fmu_saved) : 0)) return FMU_ERROR;
    if (saved->body.kind != c->body.kind) {
        snprintf(c->text, sizeof c->text,
                 "the state was saved under %s: it cannot continue under the other kind",
                 saved->body.kind == FMU_CO_SIMULATION ? "co-simulation" : "model exchange");
        return FMU_ERROR;
    }
    memcpy(&c->body, &saved->body, sizeof c->body);
    return FMU_OK;
}

#endif
