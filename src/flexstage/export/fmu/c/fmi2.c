/* Functions of FMI 2.0, model exchange and co-simulation; functions common with FMI 3.0 are in
 * fmi_calls.h, the stage is in fmu_body.h. */
#include "fmi2_types.h"
#include "fmu_body.h"

typedef struct {
    fmu_instance base;
    const fmi2CallbackFunctions *callbacks;
    char *name;
} fmi_stage;

static void report(const fmi_stage *c, int status, const char *message)
{
    const char *category = status == FMU_DISCARD ? "logStatusDiscard" : "logStatusError";
    const fmi2CallbackFunctions *callbacks = c->callbacks;
    if (callbacks && callbacks->logger)
        callbacks->logger(callbacks->componentEnvironment, c->name, (fmi2Status)status, category,
                          "%s", message);
}

typedef fmi2Component fmi_handle;
typedef fmi2ValueReference fmi_reference;
typedef fmi2Real fmi_real;
typedef fmi2Integer fmi_integer;
typedef fmi2Boolean fmi_boolean;
typedef fmi2String fmi_string;
typedef fmi2Byte fmi_byte;
typedef fmi2FMUstate fmi_state;
typedef fmi2Status fmi_status;
#define FMI_ERROR fmi2Error
#define FMI(name) FMI2(name)
#define FMI_TEXT(name) FMI_QUOTED(name)
#define FMI_QUOTED(name) "fmi2" #name
#define FMI_GET_STATE GetFMUstate
#define FMI_SET_STATE SetFMUstate
#define FMI_FREE_STATE FreeFMUstate
#define FMI_STATE_SIZE SerializedFMUstateSize
#define FMI_SERIALIZE SerializeFMUstate
#define FMI_DESERIALIZE DeSerializeFMUstate
#define FMI_GET_DERIVATIVES GetDerivatives

#include "fmi_calls.h"

/* ---- about the library ---- */

FMU_EXPORT const char *FMI2(GetTypesPlatform)(void) { return "default"; }

FMU_EXPORT const char *FMI2(GetVersion)(void) { return "2.0"; }

/* ---- life of an instance ---- */

FMU_EXPORT fmi2Component FMI2(Instantiate)(fmi2String name, fmi2Type type, fmi2String guid,
                                           fmi2String resources,
                                           const fmi2CallbackFunctions *callbacks,
                                           fmi2Boolean visible, fmi2Boolean logging)
{
    fmi_stage *c = (fmi_stage *)calloc(1, sizeof *c);
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
        report(c, FMU_ERROR, "the guid does not match this library: modelDescription.xml and the "
                             "binary are of different models or builds");
        free(c->name);
        free(c);
        return NULL;
    }
    fmu_begin(&c->base.body, type == fmi2CoSimulation ? FMU_CO_SIMULATION : FMU_MODEL_EXCHANGE);
    return c;
}

FMU_EXPORT void FMI2(FreeInstance)(fmi2Component handle)
{
    if (!handle) return;
    free(INSTANCE->name);
    free(handle);
}

FMU_EXPORT fmi2Status FMI2(SetupExperiment)(fmi2Component handle, fmi2Boolean tolerance_defined,
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

FMU_EXPORT fmi2Status FMI2(EnterInitializationMode)(fmi2Component handle)
{
    NEED(FMU_INSTANTIATED, "fmi2EnterInitializationMode");
    return answer(INSTANCE, fmu_enter_initialization(BASE, BODY->start));
}

/* ---- variables ---- */

FMU_EXPORT fmi2Status FMI2(GetReal)(fmi2Component handle, const fmi2ValueReference vr[],
                                    size_t count, fmi2Real value[])
{
    NEED(FMU_ALIVE, "fmi2GetReal");
    return get_reals(INSTANCE, vr, count, value);
}

FMU_EXPORT fmi2Status FMI2(SetReal)(fmi2Component handle, const fmi2ValueReference vr[],
                                    size_t count, const fmi2Real value[])
{
    NEED(FMU_STARTING | FMU_RUNNING, "fmi2SetReal");
    return set_reals(INSTANCE, vr, count, value);
}

FMU_EXPORT fmi2Status FMI2(GetInteger)(fmi2Component handle, const fmi2ValueReference vr[],
                                       size_t count, fmi2Integer value[])
{
    NEED(FMU_ALIVE, "fmi2GetInteger");
    return get_integers(INSTANCE, vr, count, value);
}

FMU_EXPORT fmi2Status FMI2(SetInteger)(fmi2Component handle, const fmi2ValueReference vr[],
                                       size_t count, const fmi2Integer value[])
{
    NEED(FMU_STARTING | FMU_RUNNING, "fmi2SetInteger");
    return set_integers(INSTANCE, vr, count, value);
}

/* There are no variables of these types: only an empty list is accepted. */
#define NONE_OF(call, type, constant)                                                              \
    FMU_EXPORT fmi2Status FMI2(call)(fmi2Component handle, const fmi2ValueReference vr[],          \
                                     size_t count, constant type value[])                          \
    {                                                                                              \
        (void)vr;                                                                                  \
        (void)value;                                                                               \
        NEED(FMU_ALIVE, "fmi2" #call);                                                             \
        return none_of(INSTANCE, "fmi2" #call ": there are no variables of this type", count);     \
    }
#define EITHER
NONE_OF(GetBoolean, fmi2Boolean, EITHER)
NONE_OF(GetString, fmi2String, EITHER)
NONE_OF(SetBoolean, fmi2Boolean, const)
NONE_OF(SetString, fmi2String, const)

FMU_EXPORT fmi2Status FMI2(GetDirectionalDerivative)(
    fmi2Component handle, const fmi2ValueReference unknown[], size_t unknowns,
    const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[], fmi2Real sensitivity[])
{
    (void)unknown;
    (void)unknowns;
    (void)known;
    (void)knowns;
    (void)seed;
    (void)sensitivity;
    NEED(FMU_ALIVE, "fmi2GetDirectionalDerivative");
    return refuse(INSTANCE, "this model has no directional derivatives");
}

/* ---- co-simulation ---- */

static int set_slope(fmu_instance *c, unsigned reference, int order, double value)
{
    unsigned d = reference - FMU_FIRST_INPUT;
    if (d >= FS_DRIVES || order != 1 || !(value - value == 0.0)) {
        snprintf(c->text, sizeof c->text,
                 "only finite derivatives of order 1 of inputs are accepted; got value reference "
                 "%u, order %d, value %g", reference, order, value);
        return FMU_ERROR;
    }
    c->body.slope[d] = value;
    c->body.sloped[d] = 1;
    return FMU_OK;
}

FMU_EXPORT fmi2Status FMI2(SetRealInputDerivatives)(fmi2Component handle,
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

FMU_EXPORT fmi2Status FMI2(GetRealOutputDerivatives)(fmi2Component handle,
                                                     const fmi2ValueReference vr[], size_t count,
                                                     const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    NEED(FMU_ALIVE, "fmi2GetRealOutputDerivatives");
    return none_of(INSTANCE, "this model has no derivatives of outputs", count);
}

FMU_EXPORT fmi2Status FMI2(DoStep)(fmi2Component handle, fmi2Real from, fmi2Real size,
                                   fmi2Boolean no_return)
{
    (void)no_return;
    NEED(FMU_STEPPING, "fmi2DoStep");
    return answer(INSTANCE, fmu_do_step(BASE, from, size));
}

FMU_EXPORT fmi2Status FMI2(CancelStep)(fmi2Component handle)
{
    NEED(FMU_ALIVE, "fmi2CancelStep");
    return refuse(INSTANCE, "steps are synchronous: there is none to cancel");
}

FMU_EXPORT fmi2Status FMI2(GetStatus)(fmi2Component handle, const fmi2StatusKind kind,
                                      fmi2Status *value)
{
    NEED(FMU_ALIVE, "fmi2GetStatus");
    if (kind != fmi2DoStepStatus) return refuse(INSTANCE, "fmi2GetStatus: no such status");
    *value = fmi2OK;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(GetRealStatus)(fmi2Component handle, const fmi2StatusKind kind,
                                          fmi2Real *value)
{
    NEED(FMU_ALIVE, "fmi2GetRealStatus");
    if (kind != fmi2LastSuccessfulTime)
        return refuse(INSTANCE, "fmi2GetRealStatus: no such status");
    *value = BODY->time;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(GetIntegerStatus)(fmi2Component handle, const fmi2StatusKind kind,
                                             fmi2Integer *value)
{
    (void)kind;
    (void)value;
    NEED(FMU_ALIVE, "fmi2GetIntegerStatus");
    return refuse(INSTANCE, "fmi2GetIntegerStatus: no such status");
}

FMU_EXPORT fmi2Status FMI2(GetBooleanStatus)(fmi2Component handle, const fmi2StatusKind kind,
                                             fmi2Boolean *value)
{
    NEED(FMU_ALIVE, "fmi2GetBooleanStatus");
    if (kind != fmi2Terminated) return refuse(INSTANCE, "fmi2GetBooleanStatus: no such status");
    *value = 0;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(GetStringStatus)(fmi2Component handle, const fmi2StatusKind kind,
                                            fmi2String *value)
{
    NEED(FMU_ALIVE, "fmi2GetStringStatus");
    if (kind != fmi2PendingStatus) return refuse(INSTANCE, "fmi2GetStringStatus: no such status");
    *value = "";
    return fmi2OK;
}

/* ---- model exchange ---- */

FMU_EXPORT fmi2Status FMI2(NewDiscreteStates)(fmi2Component handle, fmi2EventInfo *info)
{
    NEED(FMU_EVENT, "fmi2NewDiscreteStates");
    memset(info, 0, sizeof *info);
    return answer(INSTANCE, fmu_update_events(BASE));
}

