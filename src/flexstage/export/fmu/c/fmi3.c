/* The calls of FMI 3.0, model exchange and co-simulation. The stage itself is in fmu_body.h. */
#include "fmi3_types.h"
#include "fmu_body.h"

typedef struct {
    fmu_instance base;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} stage_instance;

static void report(const stage_instance *c, int status, const char *message)
{
    if (c->log)
        c->log(c->environment, (fmi3Status)status,
               status == FMU_DISCARD ? "logStatusDiscard" : "logStatusError", message);
}

static fmi3Status answer(stage_instance *c, int status)
{
    if (status != FMU_OK) report(c, status, c->base.text);
    return (fmi3Status)status;
}

static fmi3Status refuse(stage_instance *c, const char *message)
{
    snprintf(c->base.text, sizeof c->base.text, "%s", message);
    return answer(c, FMU_ERROR);
}

/* Leave with an error where the instance is missing or in another phase. */
#define NEED(phases, call)                                                                         \
    do {                                                                                           \
        if (!instance) return fmi3Error;                                                           \
        if (!fmu_allowed(&((stage_instance *)instance)->base, phases, call))                       \
            return answer((stage_instance *)instance, FMU_ERROR);                                  \
    } while (0)
#define INSTANCE ((stage_instance *)instance)
#define BASE (&INSTANCE->base)
#define BODY (&BASE->body)

/* ---- about the library ---- */

FMU_EXPORT const char *FMI3(GetVersion)(void) { return "3.0"; }

FMU_EXPORT fmi3Status FMI3(SetDebugLogging)(fmi3Instance instance, fmi3Boolean on, size_t count,
                                            const fmi3String categories[])
{
    /* errors are always reported, and there is nothing else to say */
    (void)on;
    (void)count;
    (void)categories;
    NEED(FMU_ALIVE | FMU_FAILED, "fmi3SetDebugLogging");
    return fmi3OK;
}

/* ---- life of an instance ---- */

static fmi3Instance made(int kind, fmi3String token, fmi3InstanceEnvironment environment,
                         fmi3LogMessageCallback log)
{
    stage_instance *c = (stage_instance *)calloc(1, sizeof *c);
    if (!c) return NULL;
    c->environment = environment;
    c->log = log;
    if (!token || strcmp(token, FMU_TOKEN) != 0) {
        report(c, FMU_ERROR, "the instantiation token is not that of this library: "
                             "modelDescription.xml and the binary are of different models or "
                             "builds");
        free(c);
        return NULL;
    }
    fmu_begin(&c->base.body, kind);
    return c;
}

FMU_EXPORT fmi3Instance FMI3(InstantiateModelExchange)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    return made(FMU_MODEL_EXCHANGE, token, environment, log);
}

FMU_EXPORT fmi3Instance FMI3(InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference required[], size_t required_count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update)
{
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)early_return;
    (void)required;
    (void)update;
    if (event_mode || required_count) {
        if (log)
            log(environment, fmi3Error, "logStatusError",
                "co-simulation of this model has neither event mode nor intermediate variables: "
                "see its capability flags");
        return NULL;
    }
    return made(FMU_CO_SIMULATION, token, environment, log);
}

FMU_EXPORT fmi3Instance FMI3(InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)clock;
    (void)lock;
    (void)unlock;
    if (log)
        log(environment, fmi3Error, "logStatusError",
            "this model has no scheduled execution: use co-simulation or model exchange");
    return NULL;
}

FMU_EXPORT void FMI3(FreeInstance)(fmi3Instance instance) { free(instance); }

FMU_EXPORT fmi3Status FMI3(EnterInitializationMode)(fmi3Instance instance,
                                                    fmi3Boolean tolerance_defined,
                                                    fmi3Float64 tolerance, fmi3Float64 start,
                                                    fmi3Boolean stop_defined, fmi3Float64 stop)
{
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    NEED(FMU_INSTANTIATED, "fmi3EnterInitializationMode");
    return answer(INSTANCE, fmu_enter_initialization(BASE, start));
}

FMU_EXPORT fmi3Status FMI3(ExitInitializationMode)(fmi3Instance instance)
{
    NEED(FMU_INITIALIZATION, "fmi3ExitInitializationMode");
    return answer(INSTANCE, fmu_exit_initialization(BASE));
}

FMU_EXPORT fmi3Status FMI3(EnterEventMode)(fmi3Instance instance)
{
    NEED(FMU_CONTINUOUS | FMU_EVENT, "fmi3EnterEventMode");
    BODY->phase = FMU_EVENT;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(Terminate)(fmi3Instance instance)
{
    NEED(FMU_RUNNING, "fmi3Terminate");
    BODY->phase = FMU_TERMINATED;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(Reset)(fmi3Instance instance)
{
    NEED(FMU_ALIVE | FMU_FAILED, "fmi3Reset");
    fmu_begin(BODY, BODY->kind);
    return fmi3OK;
}

/* ---- variables ---- */

FMU_EXPORT fmi3Status FMI3(GetFloat64)(fmi3Instance instance, const fmi3ValueReference vr[],
                                       size_t count, fmi3Float64 value[], size_t values)
{
    size_t k;
    NEED(FMU_ALIVE, "fmi3GetFloat64");
    if (values != count) return refuse(INSTANCE, "fmi3GetFloat64: every variable is one number");
    for (k = 0; k < count; k++) {
        int status = fmu_get(BASE, vr[k], &value[k]);
        if (status != FMU_OK) return answer(INSTANCE, status);
    }
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(SetFloat64)(fmi3Instance instance, const fmi3ValueReference vr[],
                                       size_t count, const fmi3Float64 value[], size_t values)
{
    size_t k;
    NEED(FMU_STARTING | FMU_RUNNING, "fmi3SetFloat64");
    if (values != count) return refuse(INSTANCE, "fmi3SetFloat64: every variable is one number");
    for (k = 0; k < count; k++) {
        int status = fmu_set(BASE, vr[k], value[k]);
        if (status != FMU_OK) return answer(INSTANCE, status);
    }
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(GetInt32)(fmi3Instance instance, const fmi3ValueReference vr[],
                                     size_t count, fmi3Int32 value[], size_t values)
{
    size_t k;
    NEED(FMU_ALIVE, "fmi3GetInt32");
    for (k = 0; k < count; k++) {
        if (vr[k] != FMU_INTERPOLATION || values != count)
            return refuse(INSTANCE, "the only integer variable is interpolation");
        value[k] = BODY->interpolation;
    }
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(SetInt32)(fmi3Instance instance, const fmi3ValueReference vr[],
                                     size_t count, const fmi3Int32 value[], size_t values)
{
    size_t k;
    NEED(FMU_STARTING | FMU_RUNNING, "fmi3SetInt32");
    for (k = 0; k < count; k++) {
        int status;
        if (vr[k] != FMU_INTERPOLATION || values != count)
            return refuse(INSTANCE, "the only integer variable is interpolation");
        status = fmu_set_interpolation(BASE, value[k]);
        if (status != FMU_OK) return answer(INSTANCE, status);
    }
    return fmi3OK;
}

/* There are no variables of these types: only an empty list of them can be asked for. */
#define NONE_OF(call, type, constant)                                                              \
    FMU_EXPORT fmi3Status FMI3(call)(fmi3Instance instance, const fmi3ValueReference vr[],         \
                                     size_t count, constant type value[], size_t values)           \
    {                                                                                              \
        (void)vr;                                                                                  \
        (void)value;                                                                               \
        (void)values;                                                                              \
        NEED(FMU_ALIVE, "fmi3" #call);                                                             \
        return count ? refuse(INSTANCE, "fmi3" #call ": there are no variables of this type")      \
                     : fmi3OK;                                                                     \
    }
#define EITHER
NONE_OF(GetFloat32, fmi3Float32, EITHER)
NONE_OF(GetInt8, fmi3Int8, EITHER)
NONE_OF(GetUInt8, fmi3UInt8, EITHER)
NONE_OF(GetInt16, fmi3Int16, EITHER)
NONE_OF(GetUInt16, fmi3UInt16, EITHER)
NONE_OF(GetUInt32, fmi3UInt32, EITHER)
NONE_OF(GetInt64, fmi3Int64, EITHER)
NONE_OF(GetUInt64, fmi3UInt64, EITHER)
NONE_OF(GetBoolean, fmi3Boolean, EITHER)
NONE_OF(GetString, fmi3String, EITHER)
NONE_OF(SetFloat32, fmi3Float32, const)
NONE_OF(SetInt8, fmi3Int8, const)
NONE_OF(SetUInt8, fmi3UInt8, const)
NONE_OF(SetInt16, fmi3Int16, const)
NONE_OF(SetUInt16, fmi3UInt16, const)
NONE_OF(SetUInt32, fmi3UInt32, const)
NONE_OF(SetInt64, fmi3Int64, const)
NONE_OF(SetUInt64, fmi3UInt64, const)
NONE_OF(SetBoolean, fmi3Boolean, const)
NONE_OF(SetString, fmi3String, const)

#define NO_BINARY(call, sizes_type, constant)                                                      \
    FMU_EXPORT fmi3Status FMI3(call)(fmi3Instance instance, const fmi3ValueReference vr[],         \
                                     size_t count, sizes_type sizes[], constant fmi3Binary value[],\
                                     size_t values)                                                \
    {                                                                                              \
        (void)vr;                                                                                  \
        (void)sizes;                                                                               \
        (void)value;                                                                               \
        (void)values;                                                                              \
        NEED(FMU_ALIVE, "fmi3" #call);                                                             \
        return count ? refuse(INSTANCE, "fmi3" #call ": there are no variables of this type")      \
                     : fmi3OK;                                                                     \
    }
NO_BINARY(GetBinary, size_t, EITHER)
NO_BINARY(SetBinary, const size_t, const)

/* ---- clocks, of which there are none ---- */

static fmi3Status no_clocks(stage_instance *c, const char *call, size_t count)
{
    if (!c) return fmi3Error;
    if (!count) return fmi3OK;
    snprintf(c->base.text, sizeof c->base.text, "%s: this model has no clocks", call);
    return answer(c, FMU_ERROR);
}

#define NO_CLOCK_1(call, type)                                                                     \
    FMU_EXPORT fmi3Status FMI3(call)(fmi3Instance instance, const fmi3ValueReference vr[],         \
                                     size_t count, type value[])                                   \
    {                                                                                              \
        (void)vr;                                                                                  \
        (void)value;                                                                               \
        return no_clocks(INSTANCE, "fmi3" #call, count);                                           \
    }
#define NO_CLOCK_2(call, first_type, second_type)                                                  \
    FMU_EXPORT fmi3Status FMI3(call)(fmi3Instance instance, const fmi3ValueReference vr[],         \
                                     size_t count, first_type first[], second_type second[])       \
    {                                                                                              \
        (void)vr;                                                                                  \
        (void)first;                                                                               \
        (void)second;                                                                              \
        return no_clocks(INSTANCE, "fmi3" #call, count);                                           \
    }
NO_CLOCK_1(GetClock, fmi3Clock)
NO_CLOCK_1(SetClock, const fmi3Clock)
NO_CLOCK_1(GetShiftDecimal, fmi3Float64)
NO_CLOCK_1(SetShiftDecimal, const fmi3Float64)
NO_CLOCK_1(SetIntervalDecimal, const fmi3Float64)
NO_CLOCK_2(GetIntervalDecimal, fmi3Float64, fmi3IntervalQualifier)
NO_CLOCK_2(GetShiftFraction, fmi3UInt64, fmi3UInt64)
NO_CLOCK_2(SetShiftFraction, const fmi3UInt64, const fmi3UInt64)
NO_CLOCK_2(SetIntervalFraction, const fmi3UInt64, const fmi3UInt64)

FMU_EXPORT fmi3Status FMI3(GetIntervalFraction)(fmi3Instance instance,
                                                const fmi3ValueReference vr[], size_t count,
                                                fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                                fmi3IntervalQualifier qualifiers[])
{
    (void)vr;
    (void)counters;
    (void)resolutions;
    (void)qualifiers;
    return no_clocks(INSTANCE, "fmi3GetIntervalFraction", count);
}

FMU_EXPORT fmi3Status FMI3(ActivateModelPartition)(fmi3Instance instance, fmi3ValueReference clock,
                                                   fmi3Float64 time)
{
    (void)clock;
    (void)time;
    return no_clocks(INSTANCE, "fmi3ActivateModelPartition", 1);
}

/* ---- dependencies and derivatives, which are in modelDescription.xml or not given ---- */

FMU_EXPORT fmi3Status FMI3(GetNumberOfVariableDependencies)(fmi3Instance instance,
                                                            fmi3ValueReference vr, size_t *count)
{
    (void)vr;
    (void)count;
    NEED(FMU_ALIVE, "fmi3GetNumberOfVariableDependencies");
    return refuse(INSTANCE, "the dependencies are those of modelDescription.xml");
}

FMU_EXPORT fmi3Status FMI3(GetVariableDependencies)(
    fmi3Instance instance, fmi3ValueReference dependent, size_t dependent_elements[],
    fmi3ValueReference independents[], size_t independent_elements[], fmi3DependencyKind kinds[],
    size_t count)
{
    (void)dependent;
    (void)dependent_elements;
    (void)independents;
    (void)independent_elements;
    (void)kinds;
    (void)count;
    NEED(FMU_ALIVE, "fmi3GetVariableDependencies");
    return refuse(INSTANCE, "the dependencies are those of modelDescription.xml");
}

#define NO_DERIVATIVE(call)                                                                        \
    FMU_EXPORT fmi3Status FMI3(call)(                                                              \
        fmi3Instance instance, const fmi3ValueReference unknown[], size_t unknowns,                \
        const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[], size_t seeds,   \
        fmi3Float64 sensitivity[], size_t sensitivities)                                           \
    {                                                                                              \
        (void)unknown;                                                                             \
        (void)unknowns;                                                                            \
        (void)known;                                                                               \
        (void)knowns;                                                                              \
        (void)seed;                                                                                \
        (void)seeds;                                                                               \
        (void)sensitivity;                                                                         \
        (void)sensitivities;                                                                       \
        NEED(FMU_ALIVE, "fmi3" #call);                                                             \
        return refuse(INSTANCE, "fmi3" #call ": this model gives no such derivatives");            \
    }
NO_DERIVATIVE(GetDirectionalDerivative)
NO_DERIVATIVE(GetAdjointDerivative)

FMU_EXPORT fmi3Status FMI3(GetOutputDerivatives)(fmi3Instance instance,
                                                 const fmi3ValueReference vr[], size_t count,
                                                 const fmi3Int32 orders[], fmi3Float64 value[],
                                                 size_t values)
{
    (void)vr;
    (void)orders;
    (void)value;
    (void)values;
    NEED(FMU_ALIVE, "fmi3GetOutputDerivatives");
    return count ? refuse(INSTANCE, "this model gives no derivatives of outputs") : fmi3OK;
}

/* ---- saved states ---- */

FMU_EXPORT fmi3Status FMI3(GetFMUState)(fmi3Instance instance, fmi3FMUState *state)
{
    NEED(FMU_ALIVE, "fmi3GetFMUState");
    return answer(INSTANCE, fmu_save(BASE, state));
}

FMU_EXPORT fmi3Status FMI3(SetFMUState)(fmi3Instance instance, fmi3FMUState state)
{
    NEED(FMU_ALIVE | FMU_FAILED, "fmi3SetFMUState");
    return answer(INSTANCE, fmu_restore(BASE, state));
}

FMU_EXPORT fmi3Status FMI3(FreeFMUState)(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(SerializedFMUStateSize)(fmi3Instance instance, fmi3FMUState state,
                                                   size_t *size)
{
    (void)state;
    NEED(FMU_ALIVE, "fmi3SerializedFMUStateSize");
    *size = sizeof(fmu_saved);
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(SerializeFMUState)(fmi3Instance instance, fmi3FMUState state,
                                              fmi3Byte bytes[], size_t size)
{
    NEED(FMU_ALIVE, "fmi3SerializeFMUState");
    if (!state || size < sizeof(fmu_saved))
        return refuse(INSTANCE, "the buffer for the state is too small: ask "
                                "fmi3SerializedFMUStateSize for its size");
    memcpy(bytes, state, sizeof(fmu_saved));
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(DeserializeFMUState)(fmi3Instance instance, const fmi3Byte bytes[],
                                                size_t size, fmi3FMUState *state)
{
    NEED(FMU_ALIVE, "fmi3DeserializeFMUState");
    if (!fmu_is_state(BASE, bytes, size)) return answer(INSTANCE, FMU_ERROR);
    if (!*state) *state = malloc(sizeof(fmu_saved));
    if (!*state) return refuse(INSTANCE, "no memory for the state");
    memcpy(*state, bytes, sizeof(fmu_saved));
    return fmi3OK;
}

/* ---- modes that this model does not have or passes through ---- */

FMU_EXPORT fmi3Status FMI3(EnterConfigurationMode)(fmi3Instance instance)
{
    NEED(FMU_ALIVE, "fmi3EnterConfigurationMode");
    return refuse(INSTANCE, "this model has no structural parameters to configure");
}

FMU_EXPORT fmi3Status FMI3(ExitConfigurationMode)(fmi3Instance instance)
{
    NEED(FMU_ALIVE, "fmi3ExitConfigurationMode");
    return refuse(INSTANCE, "this model has no structural parameters to configure");
}

FMU_EXPORT fmi3Status FMI3(EnterStepMode)(fmi3Instance instance)
{
    NEED(FMU_ALIVE, "fmi3EnterStepMode");
    return refuse(INSTANCE, "co-simulation of this model has no event mode to come back from");
}

FMU_EXPORT fmi3Status FMI3(EvaluateDiscreteStates)(fmi3Instance instance)
{
    NEED(FMU_INITIALIZATION | FMU_EVENT, "fmi3EvaluateDiscreteStates");
    return fmi3OK;
}

/* ---- co-simulation ---- */

FMU_EXPORT fmi3Status FMI3(DoStep)(fmi3Instance instance, fmi3Float64 from, fmi3Float64 size,
                                   fmi3Boolean no_return, fmi3Boolean *event_needed,
                                   fmi3Boolean *terminate, fmi3Boolean *early_return,
                                   fmi3Float64 *last_time)
{
    int status;
    (void)no_return;
    NEED(FMU_STEPPING, "fmi3DoStep");
    status = fmu_do_step(BASE, from, size);
    *event_needed = *terminate = *early_return = false;
    *last_time = BODY->time;
    return answer(INSTANCE, status);
}

/* ---- model exchange ---- */

FMU_EXPORT fmi3Status FMI3(UpdateDiscreteStates)(fmi3Instance instance, fmi3Boolean *again,
                                                 fmi3Boolean *terminate, fmi3Boolean *nominals,
                                                 fmi3Boolean *values, fmi3Boolean *next_defined,
                                                 fmi3Float64 *next)
{
    NEED(FMU_EVENT, "fmi3UpdateDiscreteStates");
    *again = *terminate = *nominals = *values = *next_defined = false;
    *next = 0.0;
    return answer(INSTANCE, fmu_update_events(BASE));
}

FMU_EXPORT fmi3Status FMI3(EnterContinuousTimeMode)(fmi3Instance instance)
{
    NEED(FMU_EVENT, "fmi3EnterContinuousTimeMode");
    BODY->phase = FMU_CONTINUOUS;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(CompletedIntegratorStep)(fmi3Instance instance, fmi3Boolean no_return,
                                                    fmi3Boolean *enter_event_mode,
                                                    fmi3Boolean *terminate)
{
    (void)no_return;
    NEED(FMU_CONTINUOUS, "fmi3CompletedIntegratorStep");
    *enter_event_mode = *terminate = false;
    return answer(INSTANCE, fmu_commit(BASE));
}

FMU_EXPORT fmi3Status FMI3(SetTime)(fmi3Instance instance, fmi3Float64 time)
{
    NEED(FMU_EVENT | FMU_CONTINUOUS, "fmi3SetTime");
    BODY->time = time;
    BODY->me.fresh = 0;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(SetContinuousStates)(fmi3Instance instance, const fmi3Float64 x[],
                                                size_t count)
{
    NEED(FMU_EVENT | FMU_CONTINUOUS, "fmi3SetContinuousStates");
    if (count != FMU_STATES) return refuse(INSTANCE, "fmi3SetContinuousStates: wrong number");
    return answer(INSTANCE, fmu_set_states(BASE, x));
}

FMU_EXPORT fmi3Status FMI3(GetContinuousStates)(fmi3Instance instance, fmi3Float64 x[],
                                                size_t count)
{
    NEED(FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED,
         "fmi3GetContinuousStates");
    if (count != FMU_STATES) return refuse(INSTANCE, "fmi3GetContinuousStates: wrong number");
    return answer(INSTANCE, fmu_states(BASE, x));
}

FMU_EXPORT fmi3Status FMI3(GetContinuousStateDerivatives)(fmi3Instance instance, fmi3Float64 x[],
                                                          size_t count)
{
    NEED(FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED,
         "fmi3GetContinuousStateDerivatives");
    if (count != FMU_STATES)
        return refuse(INSTANCE, "fmi3GetContinuousStateDerivatives: wrong number");
    return answer(INSTANCE, fmu_derivatives(BASE, x));
}

FMU_EXPORT fmi3Status FMI3(GetEventIndicators)(fmi3Instance instance, fmi3Float64 z[],
                                               size_t count)
{
    NEED(FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED,
         "fmi3GetEventIndicators");
    if (count != FMU_INDICATORS) return refuse(INSTANCE, "fmi3GetEventIndicators: wrong number");
    return answer(INSTANCE, fmu_indicators(BASE, z));
}

FMU_EXPORT fmi3Status FMI3(GetNominalsOfContinuousStates)(fmi3Instance instance, fmi3Float64 x[],
                                                          size_t count)
{
    NEED(FMU_ALIVE, "fmi3GetNominalsOfContinuousStates");
    if (count != FMU_STATES)
        return refuse(INSTANCE, "fmi3GetNominalsOfContinuousStates: wrong number");
    memcpy(x, fmu_nominal, count * sizeof *x);
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(GetNumberOfEventIndicators)(fmi3Instance instance, size_t *count)
{
    NEED(FMU_ALIVE, "fmi3GetNumberOfEventIndicators");
    *count = FMU_INDICATORS;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(GetNumberOfContinuousStates)(fmi3Instance instance, size_t *count)
{
    NEED(FMU_ALIVE, "fmi3GetNumberOfContinuousStates");
    *count = FMU_STATES;
    return fmi3OK;
}
