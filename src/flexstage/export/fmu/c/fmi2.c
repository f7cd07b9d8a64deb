/* The calls of FMI 2.0, model exchange and co-simulation. The stage itself is in fmu_body.h. */
#include "fmi2_types.h"
#include "fmu_body.h"

typedef struct {
    fmu_instance base;
    const fmi2CallbackFunctions *callbacks;
    char *name;
} instance;

static void report(const instance *c, int status, const char *message)
{
    const char *category = status == FMU_DISCARD ? "logStatusDiscard" : "logStatusError";
    const fmi2CallbackFunctions *callbacks = c->callbacks;
    if (callbacks && callbacks->logger)
        callbacks->logger(callbacks->componentEnvironment, c->name, (fmi2Status)status, category,
                          "%s", message);
}

static fmi2Status answer(instance *c, int status)
{
    if (status != FMU_OK) report(c, status, c->base.text);
    return (fmi2Status)status;
}

static fmi2Status refuse(instance *c, const char *message)
{
    snprintf(c->base.text, sizeof c->base.text, "%s", message);
    return answer(c, FMU_ERROR);
}

/* Leave with an error where the instance is missing or in another phase. */
#define NEED(phases, call)                                                                         \
    do {                                                                                           \
        if (!component) return fmi2Error;                                                          \
        if (!fmu_allowed(&((instance *)component)->base, phases, call))                            \
            return answer((instance *)component, FMU_ERROR);                                       \
    } while (0)
#define INSTANCE ((instance *)component)
#define BASE (&INSTANCE->base)
#define BODY (&BASE->body)

/* ---- about the library ---- */

FMU_EXPORT const char *FMI2(GetTypesPlatform)(void) { return "default"; }

FMU_EXPORT const char *FMI2(GetVersion)(void) { return "2.0"; }

FMU_EXPORT fmi2Status FMI2(SetDebugLogging)(fmi2Component component, fmi2Boolean on, size_t count,
                                            const fmi2String categories[])
{
    /* errors are always reported, and there is nothing else to say */
    (void)on;
    (void)count;
    (void)categories;
    NEED(FMU_ALIVE | FMU_FAILED, "fmi2SetDebugLogging");
    return fmi2OK;
}

/* ---- life of an instance ---- */

FMU_EXPORT fmi2Component FMI2(Instantiate)(fmi2String name, fmi2Type type, fmi2String guid,
                                           fmi2String resources,
                                           const fmi2CallbackFunctions *callbacks,
                                           fmi2Boolean visible, fmi2Boolean logging)
{
    instance *c = (instance *)calloc(1, sizeof *c);
    size_t length = name ? strlen(name) : 0;
    (void)resources;
    (void)visible;
    (void)logging;
    if (!c) return NULL;
    c->callbacks = callbacks;
    c->name = (char *)calloc(length + 1, 1);
    if (!c->name) {
        free(c);
        return NULL;
    }
    if (length) memcpy(c->name, name, length);
    if (!guid || strcmp(guid, FMU_TOKEN) != 0) {
        report(c, FMU_ERROR, "the guid is not that of this library: modelDescription.xml and the "
                             "binary are of different models or builds");
        free(c->name);
        free(c);
        return NULL;
    }
    fmu_begin(&c->base.body, type == fmi2CoSimulation ? FMU_CO_SIMULATION : FMU_MODEL_EXCHANGE);
    return c;
}

FMU_EXPORT void FMI2(FreeInstance)(fmi2Component component)
{
    if (!component) return;
    free(INSTANCE->name);
    free(component);
}

FMU_EXPORT fmi2Status FMI2(SetupExperiment)(fmi2Component component, fmi2Boolean tolerance_defined,
                                            fmi2Real tolerance, fmi2Real start,
                                            fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    NEED(FMU_INSTANTIATED, "fmi2SetupExperiment");
    BODY->start = BODY->time = start;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(EnterInitializationMode)(fmi2Component component)
{
    NEED(FMU_INSTANTIATED, "fmi2EnterInitializationMode");
    return answer(INSTANCE, fmu_enter_initialization(BASE, BODY->start));
}

FMU_EXPORT fmi2Status FMI2(ExitInitializationMode)(fmi2Component component)
{
    NEED(FMU_INITIALIZATION, "fmi2ExitInitializationMode");
    return answer(INSTANCE, fmu_exit_initialization(BASE));
}

FMU_EXPORT fmi2Status FMI2(Terminate)(fmi2Component component)
{
    NEED(FMU_RUNNING, "fmi2Terminate");
    BODY->phase = FMU_TERMINATED;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(Reset)(fmi2Component component)
{
    NEED(FMU_ALIVE | FMU_FAILED, "fmi2Reset");
    fmu_begin(BODY, BODY->kind);
    return fmi2OK;
}

/* ---- variables ---- */

FMU_EXPORT fmi2Status FMI2(GetReal)(fmi2Component component, const fmi2ValueReference vr[],
                                    size_t count, fmi2Real value[])
{
    size_t k;
    NEED(FMU_ALIVE, "fmi2GetReal");
    for (k = 0; k < count; k++) {
        int status = fmu_get(BASE, vr[k], &value[k]);
        if (status != FMU_OK) return answer(INSTANCE, status);
    }
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(SetReal)(fmi2Component component, const fmi2ValueReference vr[],
                                    size_t count, const fmi2Real value[])
{
    size_t k;
    NEED(FMU_STARTING | FMU_RUNNING, "fmi2SetReal");
    for (k = 0; k < count; k++) {
        int status = fmu_set(BASE, vr[k], value[k]);
        if (status != FMU_OK) return answer(INSTANCE, status);
    }
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(GetInteger)(fmi2Component component, const fmi2ValueReference vr[],
                                       size_t count, fmi2Integer value[])
{
    size_t k;
    NEED(FMU_ALIVE, "fmi2GetInteger");
    for (k = 0; k < count; k++) {
        if (vr[k] != FMU_INTERPOLATION)
            return refuse(INSTANCE, "the only integer variable is interpolation");
        value[k] = BODY->interpolation;
    }
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(SetInteger)(fmi2Component component, const fmi2ValueReference vr[],
                                       size_t count, const fmi2Integer value[])
{
    size_t k;
    NEED(FMU_STARTING | FMU_RUNNING, "fmi2SetInteger");
    for (k = 0; k < count; k++) {
        int status;
        if (vr[k] != FMU_INTERPOLATION)
            return refuse(INSTANCE, "the only integer variable is interpolation");
        status = fmu_set_interpolation(BASE, value[k]);
        if (status != FMU_OK) return answer(INSTANCE, status);
    }
    return fmi2OK;
}

/* There are no variables of these types: only an empty list of them can be asked for. */
#define NONE_OF(call, type, constant)                                                              \
    FMU_EXPORT fmi2Status FMI2(call)(fmi2Component component, const fmi2ValueReference vr[],       \
                                     size_t count, constant type value[])                          \
    {                                                                                              \
        (void)vr;                                                                                  \
        (void)value;                                                                               \
        NEED(FMU_ALIVE, "fmi2" #call);                                                             \
        return count ? refuse(INSTANCE, "fmi2" #call ": there are no variables of this type")      \
                     : fmi2OK;                                                                     \
    }
#define EITHER
NONE_OF(GetBoolean, fmi2Boolean, EITHER)
NONE_OF(GetString, fmi2String, EITHER)
NONE_OF(SetBoolean, fmi2Boolean, const)
NONE_OF(SetString, fmi2String, const)

/* ---- saved states ---- */

FMU_EXPORT fmi2Status FMI2(GetFMUstate)(fmi2Component component, fmi2FMUstate *state)
{
    NEED(FMU_ALIVE, "fmi2GetFMUstate");
    return answer(INSTANCE, fmu_save(BASE, state));
}

FMU_EXPORT fmi2Status FMI2(SetFMUstate)(fmi2Component component, fmi2FMUstate state)
{
    NEED(FMU_ALIVE | FMU_FAILED, "fmi2SetFMUstate");
    return answer(INSTANCE, fmu_restore(BASE, state));
}

FMU_EXPORT fmi2Status FMI2(FreeFMUstate)(fmi2Component component, fmi2FMUstate *state)
{
    (void)component;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(SerializedFMUstateSize)(fmi2Component component, fmi2FMUstate state,
                                                   size_t *size)
{
    (void)state;
    NEED(FMU_ALIVE, "fmi2SerializedFMUstateSize");
    *size = sizeof(fmu_saved);
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(SerializeFMUstate)(fmi2Component component, fmi2FMUstate state,
                                              fmi2Byte bytes[], size_t size)
{
    NEED(FMU_ALIVE, "fmi2SerializeFMUstate");
    if (!state || size < sizeof(fmu_saved))
        return refuse(INSTANCE, "the buffer for the state is too small: ask "
                                "fmi2SerializedFMUstateSize for its size");
    memcpy(bytes, state, sizeof(fmu_saved));
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(DeSerializeFMUstate)(fmi2Component component, const fmi2Byte bytes[],
                                                size_t size, fmi2FMUstate *state)
{
    NEED(FMU_ALIVE, "fmi2DeSerializeFMUstate");
    if (!fmu_is_state(BASE, bytes, size)) return answer(INSTANCE, FMU_ERROR);
    if (!*state) *state = malloc(sizeof(fmu_saved));
    if (!*state) return refuse(INSTANCE, "no memory for the state");
    memcpy(*state, bytes, sizeof(fmu_saved));
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(GetDirectionalDerivative)(
    fmi2Component component, const fmi2ValueReference unknown[], size_t unknowns,
    const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[], fmi2Real sensitivity[])
{
    (void)unknown;
    (void)unknowns;
    (void)known;
    (void)knowns;
    (void)seed;
    (void)sensitivity;
    NEED(FMU_ALIVE, "fmi2GetDirectionalDerivative");
    return refuse(INSTANCE, "this model gives no directional derivatives");
}

/* ---- co-simulation ---- */

static int set_slope(fmu_instance *c, unsigned reference, int order, double value)
{
    unsigned d = reference - FMU_FIRST_INPUT;
    if (d >= FS_DRIVES || order != 1 || !(value - value == 0.0)) {
        snprintf(c->text, sizeof c->text,
                 "derivatives can be given of inputs, of order 1 and finite; got value reference "
                 "%u, order %d, value %g", reference, order, value);
        return FMU_ERROR;
    }
    c->body.slope[d] = value;
    c->body.sloped[d] = 1;
    return FMU_OK;
}

FMU_EXPORT fmi2Status FMI2(SetRealInputDerivatives)(fmi2Component component,
                                                    const fmi2ValueReference vr[], size_t count,
                                                    const fmi2Integer order[],
                                                    const fmi2Real value[])
{
    size_t k;
    NEED(FMU_STARTING | FMU_STEPPING, "fmi2SetRealInputDerivatives");
    for (k = 0; k < count; k++) {
        int status = set_slope(BASE, vr[k], order[k], value[k]);
        if (status != FMU_OK) return answer(INSTANCE, status);
    }
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(GetRealOutputDerivatives)(fmi2Component component,
                                                     const fmi2ValueReference vr[], size_t count,
                                                     const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    NEED(FMU_ALIVE, "fmi2GetRealOutputDerivatives");
    return count ? refuse(INSTANCE, "this model gives no derivatives of outputs") : fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(DoStep)(fmi2Component component, fmi2Real from, fmi2Real size,
                                   fmi2Boolean no_return)
{
    (void)no_return;
    NEED(FMU_STEPPING, "fmi2DoStep");
    return answer(INSTANCE, fmu_do_step(BASE, from, size));
}

FMU_EXPORT fmi2Status FMI2(CancelStep)(fmi2Component component)
{
    NEED(FMU_ALIVE, "fmi2CancelStep");
    return refuse(INSTANCE, "steps are done at once: there is none to cancel");
}

FMU_EXPORT fmi2Status FMI2(GetStatus)(fmi2Component component, const fmi2StatusKind kind,
                                      fmi2Status *value)
{
    NEED(FMU_ALIVE, "fmi2GetStatus");
    if (kind != fmi2DoStepStatus) return refuse(INSTANCE, "fmi2GetStatus: no such status");
    *value = fmi2OK;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(GetRealStatus)(fmi2Component component, const fmi2StatusKind kind,
                                          fmi2Real *value)
{
    NEED(FMU_ALIVE, "fmi2GetRealStatus");
    if (kind != fmi2LastSuccessfulTime)
        return refuse(INSTANCE, "fmi2GetRealStatus: no such status");
    *value = BODY->time;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(GetIntegerStatus)(fmi2Component component, const fmi2StatusKind kind,
                                             fmi2Integer *value)
{
    (void)kind;
    (void)value;
    NEED(FMU_ALIVE, "fmi2GetIntegerStatus");
    return refuse(INSTANCE, "fmi2GetIntegerStatus: no such status");
}

FMU_EXPORT fmi2Status FMI2(GetBooleanStatus)(fmi2Component component, const fmi2StatusKind kind,
                                             fmi2Boolean *value)
{
    NEED(FMU_ALIVE, "fmi2GetBooleanStatus");
    if (kind != fmi2Terminated) return refuse(INSTANCE, "fmi2GetBooleanStatus: no such status");
    *value = 0;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(GetStringStatus)(fmi2Component component, const fmi2StatusKind kind,
                                            fmi2String *value)
{
    NEED(FMU_ALIVE, "fmi2GetStringStatus");
    if (kind != fmi2PendingStatus) return refuse(INSTANCE, "fmi2GetStringStatus: no such status");
    *value = "";
    return fmi2OK;
}

/* ---- model exchange ---- */

FMU_EXPORT fmi2Status FMI2(EnterEventMode)(fmi2Component component)
{
    NEED(FMU_CONTINUOUS | FMU_EVENT, "fmi2EnterEventMode");
    BODY->phase = FMU_EVENT;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(NewDiscreteStates)(fmi2Component component, fmi2EventInfo *info)
{
    NEED(FMU_EVENT, "fmi2NewDiscreteStates");
    memset(info, 0, sizeof *info);
    return answer(INSTANCE, fmu_update_events(BASE));
}

FMU_EXPORT fmi2Status FMI2(EnterContinuousTimeMode)(fmi2Component component)
{
    NEED(FMU_EVENT, "fmi2EnterContinuousTimeMode");
    BODY->phase = FMU_CONTINUOUS;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(CompletedIntegratorStep)(fmi2Component component, fmi2Boolean no_return,
                                                    fmi2Boolean *enter_event_mode,
                                                    fmi2Boolean *terminate)
{
    (void)no_return;
    NEED(FMU_CONTINUOUS, "fmi2CompletedIntegratorStep");
    *enter_event_mode = *terminate = 0;
    return answer(INSTANCE, fmu_commit(BASE));
}

FMU_EXPORT fmi2Status FMI2(SetTime)(fmi2Component component, fmi2Real time)
{
    NEED(FMU_EVENT | FMU_CONTINUOUS, "fmi2SetTime");
    BODY->time = time;
    BODY->me.fresh = 0;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(SetContinuousStates)(fmi2Component component, const fmi2Real x[],
                                                size_t count)
{
    NEED(FMU_EVENT | FMU_CONTINUOUS, "fmi2SetContinuousStates");
    if (count != FMU_STATES) return refuse(INSTANCE, "fmi2SetContinuousStates: wrong number");
    return answer(INSTANCE, fmu_set_states(BASE, x));
}

FMU_EXPORT fmi2Status FMI2(GetContinuousStates)(fmi2Component component, fmi2Real x[],
                                                size_t count)
{
    NEED(FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED,
         "fmi2GetContinuousStates");
    if (count != FMU_STATES) return refuse(INSTANCE, "fmi2GetContinuousStates: wrong number");
    return answer(INSTANCE, fmu_states(BASE, x));
}

FMU_EXPORT fmi2Status FMI2(GetDerivatives)(fmi2Component component, fmi2Real x[], size_t count)
{
    NEED(FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED, "fmi2GetDerivatives");
    if (count != FMU_STATES) return refuse(INSTANCE, "fmi2GetDerivatives: wrong number");
    return answer(INSTANCE, fmu_derivatives(BASE, x));
}

FMU_EXPORT fmi2Status FMI2(GetEventIndicators)(fmi2Component component, fmi2Real z[], size_t count)
{
    NEED(FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED,
         "fmi2GetEventIndicators");
    if (count != FMU_INDICATORS) return refuse(INSTANCE, "fmi2GetEventIndicators: wrong number");
    return answer(INSTANCE, fmu_indicators(BASE, z));
}

FMU_EXPORT fmi2Status FMI2(GetNominalsOfContinuousStates)(fmi2Component component, fmi2Real x[],
                                                          size_t count)
{
    NEED(FMU_ALIVE, "fmi2GetNominalsOfContinuousStates");
    if (count != FMU_STATES)
        return refuse(INSTANCE, "fmi2GetNominalsOfContinuousStates: wrong number");
    memcpy(x, fmu_nominal, count * sizeof *x);
    return fmi2OK;
}
