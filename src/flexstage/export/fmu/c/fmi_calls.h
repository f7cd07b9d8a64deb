/* Functions that FMI 2.0 and FMI 3.0 have in common, apart from the prefix of their names. The
 * stage is in fmu_body.h.
 *
 * The including file defines
 *   FMI(name), FMI_TEXT(name)      the name of a call, and the same as text
 *   fmi_status, fmi_handle, fmi_reference, fmi_real, fmi_integer, fmi_boolean, fmi_string,
 *   fmi_byte, fmi_state            its types
 *   fmi_stage                      its instance, which begins with an fmu_instance called base
 *   FMI_ERROR                      its error status
 *   FMI_GET_STATE and so on        names with another spelling
 *   report                         passes a message to the importer
 */
#ifndef FMU_FMI_CALLS_H
#define FMU_FMI_CALLS_H

static fmi_status answer(fmi_stage *c, int status)
{
    if (status != FMU_OK) report(c, status, c->base.text);
    return (fmi_status)status;
}

static fmi_status refuse(fmi_stage *c, const char *message)
{
    snprintf(c->base.text, sizeof c->base.text, "%s", message);
    return answer(c, FMU_ERROR);
}

/* Return with an error if the instance is missing or in another phase. */
#define NEED(phases, call)                                                                         \
    do {                                                                                           \
        if (!handle) return FMI_ERROR;                                                             \
        if (!fmu_allowed(&((fmi_stage *)handle)->base, phases, call))                              \
            return answer((fmi_stage *)handle, FMU_ERROR);                                         \
    } while (0)
#define INSTANCE ((fmi_stage *)handle)
#define BASE (&INSTANCE->base)
#define BODY (&BASE->body)
#define DONE ((fmi_status)FMU_OK)

FMU_EXPORT fmi_status FMI(SetDebugLogging)(fmi_handle handle, fmi_boolean on, size_t count,
                                           const fmi_string categories[])
{
    /* errors are always reported; there are no other messages */
    (void)on;
    (void)count;
    (void)categories;
    NEED(FMU_ALIVE | FMU_FAILED, FMI_TEXT(SetDebugLogging));
    return DONE;
}

/* ---- life of an instance ---- */

FMU_EXPORT fmi_status FMI(ExitInitializationMode)(fmi_handle handle)
{
    NEED(FMU_INITIALIZATION, FMI_TEXT(ExitInitializationMode));
    return answer(INSTANCE, fmu_exit_initialization(BASE));
}

FMU_EXPORT fmi_status FMI(Terminate)(fmi_handle handle)
{
    NEED(FMU_RUNNING, FMI_TEXT(Terminate));
    BODY->phase = FMU_TERMINATED;
    return DONE;
}

FMU_EXPORT fmi_status FMI(Reset)(fmi_handle handle)
{
    NEED(FMU_ALIVE | FMU_FAILED, FMI_TEXT(Reset));
    fmu_begin(BODY, BODY->kind);
    return DONE;
}

/* ---- variables ---- */

static fmi_status get_reals(fmi_stage *c, const fmi_reference vr[], size_t count, fmi_real value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        int status = fmu_get(&c->base, vr[k], &value[k]);
        if (status != FMU_OK) return answer(c, status);
    }
    return DONE;
}

static fmi_status set_reals(fmi_stage *c, const fmi_reference vr[], size_t count,
                            const fmi_real value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        int status = fmu_set(&c->base, vr[k], value[k]);
        if (status != FMU_OK) return answer(c, status);
    }
    return DONE;
}

static fmi_status get_integers(fmi_stage *c, const fmi_reference vr[], size_t count,
                               fmi_integer value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        if (vr[k] != FMU_INTERPOLATION)
            return refuse(c, "the only integer variable is interpolation");
        value[k] = c->base.body.interpolation;
    }
    return DONE;
}

static fmi_status set_integers(fmi_stage *c, const fmi_reference vr[], size_t count,
                               const fmi_integer value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        int status;
        if (vr[k] != FMU_INTERPOLATION)
            return refuse(c, "the only integer variable is interpolation");
        status = fmu_set_interpolation(&c->base, value[k]);
        if (status != FMU_OK) return answer(c, status);
    }
    return DONE;
}

static fmi_status none_of(fmi_stage *c, const char *message, size_t count)
{
    return count ? refuse(c, message) : DONE;
}

/* ---- saved states ---- */

FMU_EXPORT fmi_status FMI(FMI_GET_STATE)(fmi_handle handle, fmi_state *state)
{
    NEED(FMU_ALIVE, FMI_TEXT(FMI_GET_STATE));
    return answer(INSTANCE, fmu_save(BASE, state));
}

FMU_EXPORT fmi_status FMI(FMI_SET_STATE)(fmi_handle handle, fmi_state state)
{
    NEED(FMU_ALIVE | FMU_FAILED, FMI_TEXT(FMI_SET_STATE));
    return answer(INSTANCE, fmu_restore(BASE, state));
}

FMU_EXPORT fmi_status FMI(FMI_FREE_STATE)(fmi_handle handle, fmi_state *state)
{
    (void)handle;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return DONE;
}

FMU_EXPORT fmi_status FMI(FMI_STATE_SIZE)(fmi_handle handle, fmi_state state, size_t *size)
{
    (void)state;
    NEED(FMU_ALIVE, FMI_TEXT(FMI_STATE_SIZE));
    *size = sizeof(fmu_saved);
    return DONE;
}

FMU_EXPORT fmi_status FMI(FMI_SERIALIZE)(fmi_handle handle, fmi_state state, fmi_byte bytes[],
                                         size_t size)
{
    NEED(FMU_ALIVE, FMI_TEXT(FMI_SERIALIZE));
    if (!state || size < sizeof(fmu_saved))
        return refuse(INSTANCE, "the buffer for the state is too small: see "
                                FMI_TEXT(FMI_STATE_SIZE) " for its size");
    memcpy(bytes, state, sizeof(fmu_saved));
    return DONE;
}

FMU_EXPORT fmi_status FMI(FMI_DESERIALIZE)(fmi_handle handle, const fmi_byte bytes[], size_t size,
                                           fmi_state *state)
{
    NEED(FMU_ALIVE, FMI_TEXT(FMI_DESERIALIZE));
    if (!fmu_is_state(BASE, bytes, size)) return answer(INSTANCE, FMU_ERROR);
    if (!*state) *state = malloc(sizeof(fmu_saved));
    if (!*state) return refuse(INSTANCE, "no memory for the state");
    memcpy(*state, bytes, sizeof(fmu_saved));
    return DONE;
}

/* ---- model exchange ---- */

FMU_EXPORT fmi_status FMI(EnterEventMode)(fmi_handle handle)
{
    NEED(FMU_CONTINUOUS | FMU_EVENT, FMI_TEXT(EnterEventMode));
    BODY->phase = FMU_EVENT;
    return DONE;
}

FMU_EXPORT fmi_status FMI(EnterContinuousTimeMode)(fmi_handle handle)
{
    NEED(FMU_EVENT, FMI_TEXT(EnterContinuousTimeMode));
    BODY->phase = FMU_CONTINUOUS;
    return DONE;
}

FMU_EXPORT fmi_status FMI(CompletedIntegratorStep)(fmi_handle handle, fmi_boolean no_return,
                                                   fmi_boolean *enter_event_mode,
                                                   fmi_boolean *terminate)
{
    (void)no_return;
    NEED(FMU_CONTINUOUS, FMI_TEXT(CompletedIntegratorStep));
    *enter_event_mode = *terminate = 0;
    return answer(INSTANCE, fmu_commit(BASE));
}

FMU_EXPORT fmi_status FMI(SetTime)(fmi_handle handle, fmi_real time)
{
    NEED(FMU_EVENT | FMU_CONTINUOUS, FMI_TEXT(SetTime));
    BODY->time = time;
    BODY->me.fresh = 0;
    return DONE;
}

FMU_EXPORT fmi_status FMI(SetContinuousStates)(fmi_handle handle, const fmi_real x[], size_t count)
{
    NEED(FMU_EVENT | FMU_CONTINUOUS, FMI_TEXT(SetContinuousStates));
    if (count != FMU_STATES)
        return refuse(INSTANCE, FMI_TEXT(SetContinuousStates) ": wrong number");
    return answer(INSTANCE, fmu_set_states(BASE, x));
}

/* Read all values of a kind: their number, and the function that writes them. */
#define READS(call, number, fill)                                                                  \
    FMU_EXPORT fmi_status FMI(call)(fmi_handle handle, fmi_real x[], size_t count)                 \
    {                                                                                              \
        NEED(FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED, FMI_TEXT(call));    \
        if (count != (number)) return refuse(INSTANCE, FMI_TEXT(call) ": wrong number");           \
        return answer(INSTANCE, fill(BASE, x));                                                    \
    }
READS(GetContinuousStates, FMU_STATES, fmu_states)
READS(FMI_GET_DERIVATIVES, FMU_STATES, fmu_derivatives)
READS(GetEventIndicators, FMU_INDICATORS, fmu_indicators)

FMU_EXPORT fmi_status FMI(GetNominalsOfContinuousStates)(fmi_handle handle, fmi_real x[],
                                                         size_t count)
{
    NEED(FMU_ALIVE, FMI_TEXT(GetNominalsOfContinuousStates));
    if (count != FMU_STATES)
        return refuse(INSTANCE, FMI_TEXT(GetNominalsOfContinuousStates) ": wrong number");
    memcpy(x, fmu_nominal, count * sizeof *x);
    return DONE;
}

#endif
