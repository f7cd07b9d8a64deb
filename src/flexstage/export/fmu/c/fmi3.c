/* Functions of FMI 3.0, model exchange and co-simulation; functions common with FMI 2.0 are in
 * fmi_calls.h, the stage is in fmu_body.h. */
#include "fmi3_types.h"
#include "fmu_body.h"

typedef struct {
    fmu_instance base;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} fmi_stage;

static void report(const fmi_stage *c, int status, const char *message)
{
    if (c->log)
        c->log(c->environment, (fmi3Status)status,
               status == FMU_DISCARD ? "logStatusDiscard" : "logStatusError", message);
}

typedef fmi3Instance fmi_handle;
typedef fmi3ValueReference fmi_reference;
typedef fmi3Float64 fmi_real;
typedef fmi3Int32 fmi_integer;
typedef fmi3Boolean fmi_boolean;
typedef fmi3String fmi_string;
typedef fmi3Byte fmi_byte;
typedef fmi3FMUState fmi_state;
typedef fmi3Status fmi_status;
#define FMI_ERROR fmi3Error
#define FMI(name) FMI3(name)
#define FMI_TEXT(name) FMI_QUOTED(name)
#define FMI_QUOTED(name) "fmi3" #name
#define FMI_GET_STATE GetFMUState
#define FMI_SET_STATE SetFMUState
#define FMI_FREE_STATE FreeFMUState
#define FMI_STATE_SIZE SerializedFMUStateSize
#define FMI_SERIALIZE SerializeFMUState
#define FMI_DESERIALIZE DeserializeFMUState
#define FMI_GET_DERIVATIVES GetContinuousStateDerivatives

#include "fmi_calls.h"

/* ---- about the library ---- */

FMU_EXPORT const char *FMI3(GetVersion)(void) { return "3.0"; }

/* ---- life of an instance ---- */

static fmi3Instance made(int kind, fmi3String token, fmi3InstanceEnvironment environment,
                         fmi3LogMessageCallback log)
{
    fmi_stage *c = (fmi_stage *)calloc(1, sizeof *c);
    if (!c) return NULL;
    c->environment = environment;
    c->log = log;
    if (!token || strcmp(token, FMU_TOKEN) != 0) {
        report(c, FMU_ERROR, "the instantiation token does not match this library: "
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

FMU_EXPORT void FMI3(FreeInstance)(fmi3Instance handle) { free(handle); }

FMU_EXPORT fmi3Status FMI3(EnterInitializationMode)(fmi3Instance handle,
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

/* ---- variables ---- */

FMU_EXPORT fmi3Status FMI3(GetFloat64)(fmi3Instance handle, const fmi3ValueReference vr[],
                                       size_t count, fmi3Float64 value[], size_t values)
{
    NEED(FMU_ALIVE, "fmi3GetFloat64");
    if (values != count) return refuse(INSTANCE, "fmi3GetFloat64: every variable is one number");
    return get_reals(INSTANCE, vr, count, value);
}

FMU_EXPORT fmi3Status FMI3(SetFloat64)(fmi3Instance handle, const fmi3ValueReference vr[],
                                       size_t count, const fmi3Float64 value[], size_t values)
{
    NEED(FMU_STARTING | FMU_RUNNING, "fmi3SetFloat64");
    if (values != count) return refuse(INSTANCE, "fmi3SetFloat64: every variable is one number");
    return set_reals(INSTANCE, vr, count, value);
}

FMU_EXPORT fmi3Status FMI3(GetInt32)(fmi3Instance handle, const fmi3ValueReference vr[],
                                     size_t count, fmi3Int32 value[], size_t values)
{
    NEED(FMU_ALIVE, "fmi3GetInt32");
    if (count && values != count)
        return refuse(INSTANCE, "the only integer variable is interpolation");
    return get_integers(INSTANCE, vr, count, value);
}

FMU_EXPORT fmi3Status FMI3(SetInt32)(fmi3Instance handle, const fmi3ValueReference vr[],
                                     size_t count, const fmi3Int32 value[], size_t values)
{
    NEED(FMU_STARTING | FMU_RUNNING, "fmi3SetInt32");
    if (count && values != count)
        return refuse(INSTANCE, "the only integer variable is interpolation");
    return set_integers(INSTANCE, vr, count, value);
}

/* There are no variables of these types: only an empty list is accepted. */
#define NONE_OF(call, type, constant)                                                              \
    FMU_EXPORT fmi3Status FMI3(call)(fmi3Instance handle, const fmi3ValueReference vr[],           \
                                     size_t count, constant type value[], size_t values)           \
    {                                                                                              \
        (void)vr;                                                                                  \
        (void)value;                                                                               \
        (void)values;                                                                              \
        NEED(FMU_ALIVE, "fmi3" #call);                                                             \
        return none_of(INSTANCE, "fmi3" #call ": there are no variables of this type", count);     \
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
    FMU_EXPORT fmi3Status FMI3(call)(fmi3Instance handle, const fmi3ValueReference vr[],           \
                                     size_t count, sizes_type sizes[], constant fmi3Binary value[],\
                                     size_t values)                                                \
    {                                                                                              \
        (void)vr;                                                                                  \
        (void)sizes;                                                                               \
        (void)value;                                                                               \
        (void)values;                                                                              \
        NEED(FMU_ALIVE, "fmi3" #call);                                                             \
        return none_of(INSTANCE, "fmi3" #call ": there are no variables of this type", count);     \
    }
NO_BINARY(GetBinary, size_t, EITHER)
NO_BINARY(SetBinary, const size_t, const)

/* ---- clocks: none ---- */

static fmi3Status no_clocks(fmi_stage *c, const char *call, size_t count)
{
    if (!c) return fmi3Error;
    if (!count) return fmi3OK;
    snprintf(c->base.text, sizeof c->base.text, "%s: this model has no clocks", call);
    return answer(c, FMU_ERROR);
}

#define NO_CLOCK_1(call, type)                                                                     \
    FMU_EXPORT fmi3Status FMI3(call)(fmi3Instance handle, const fmi3ValueReference vr[],           \
                                     size_t count, type value[])                                   \
    {                                                                                              \
        (void)vr;                                                                                  \
        (void)value;                                                                               \
        return no_clocks(INSTANCE, "fmi3" #call, count);                                           \
    }
#define NO_CLOCK_2(call, first_type, second_type)                                                  \
    FMU_EXPORT fmi3Status FMI3(call)(fmi3Instance handle, const fmi3ValueReference vr[],           \
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

FMU_EXPORT fmi3Status FMI3(GetIntervalFraction)(fmi3Instance handle,
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

FMU_EXPORT fmi3Status FMI3(ActivateModelPartition)(fmi3Instance handle, fmi3ValueReference clock,
                                                   fmi3Float64 time)
{
    (void)clock;
    (void)time;
    return no_clocks(INSTANCE, "fmi3ActivateModelPartition", 1);
}

/* ---- dependencies, in modelDescription.xml, and derivatives: none ---- */

FMU_EXPORT fmi3Status FMI3(GetNumberOfVariableDependencies)(fmi3Instance handle,
                                                            fmi3ValueReference vr, size_t *count)
{
    (void)vr;
    (void)count;
    NEED(FMU_ALIVE, "fmi3GetNumberOfVariableDependencies");
    return refuse(INSTANCE, "dependencies are in modelDescription.xml");
}

FMU_EXPORT fmi3Status FMI3(GetVariableDependencies)(
    fmi3Instance handle, fmi3ValueReference dependent, size_t dependent_elements[],
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
    return refuse(INSTANCE, "dependencies are in modelDescription.xml");
}

#define NO_DERIVATIVE(call)                                                                        \
    FMU_EXPORT fmi3Status FMI3(call)(                                                              \
        fmi3Instance handle, const fmi3ValueReference unknown[], size_t unknowns,                  \
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
        return refuse(INSTANCE, "fmi3" #call ": this model has no such derivatives");            \
    }
NO_DERIVATIVE(GetDirectionalDerivative)
NO_DERIVATIVE(GetAdjointDerivative)

FMU_EXPORT fmi3Status FMI3(GetOutputDerivatives)(fmi3Instance handle,
                                                 const fmi3ValueReference vr[], size_t count,
                                                 const fmi3Int32 orders[], fmi3Float64 value[],
                                                 size_t values)
{
    (void)vr;
    (void)orders;
    (void)value;
    (void)values;
    NEED(FMU_ALIVE, "fmi3GetOutputDerivatives");
    return none_of(INSTANCE, "this model has no derivatives of outputs", count);
}

/* ---- modes without effect in this model ---- */

FMU_EXPORT fmi3Status FMI3(EnterConfigurationMode)(fmi3Instance handle)
{
    NEED(FMU_ALIVE, "fmi3EnterConfigurationMode");
    return refuse(INSTANCE, "this model has no structural parameters to configure");
}

FMU_EXPORT fmi3Status FMI3(ExitConfigurationMode)(fmi3Instance handle)
{
    NEED(FMU_ALIVE, "fmi3ExitConfigurationMode");
    return refuse(INSTANCE, "this model has no structural parameters to configure");
}

FMU_EXPORT fmi3Status FMI3(EnterStepMode)(fmi3Instance handle)
{
    NEED(FMU_ALIVE, "fmi3EnterStepMode");
    return refuse(INSTANCE, "co-simulation of this model has no event mode");
}

FMU_EXPORT fmi3Status FMI3(EvaluateDiscreteStates)(fmi3Instance handle)
{
    NEED(FMU_INITIALIZATION | FMU_EVENT, "fmi3EvaluateDiscreteStates");
    return fmi3OK;
}

/* ---- co-simulation ---- */

FMU_EXPORT fmi3Status FMI3(DoStep)(fmi3Instance handle, fmi3Float64 from, fmi3Float64 size,
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

FMU_EXPORT fmi3Status FMI3(UpdateDiscreteStates)(fmi3Instance handle, fmi3Boolean *again,
                                                 fmi3Boolean *terminate, fmi3Boolean *nominals,
                                                 fmi3Boolean *values, fmi3Boolean *next_defined,
                                                 fmi3Float64 *next)
{
    NEED(FMU_EVENT, "fmi3UpdateDiscreteStates");
    *again = *terminate = *nominals = *values = *next_defined = false;
    *next = 0.0;
    return answer(INSTANCE, fmu_update_events(BASE));
}

FMU_EXPORT fmi3Status FMI3(GetNumberOfEventIndicators)(fmi3Instance handle, size_t *count)
{
    NEED(FMU_ALIVE, "fmi3GetNumberOfEventIndicators");
    *count = FMU_INDICATORS;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(GetNumberOfContinuousStates)(fmi3Instance handle, size_t *count)
{
    NEED(FMU_ALIVE, "fmi3GetNumberOfContinuousStates");
    *count = FMU_STATES;
    return fmi3OK;
}
