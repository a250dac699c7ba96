/* FMI 3.0 (fmi-standard.org), model exchange and co-simulation. A value reference is the number of a port;
 * time has the number behind the last one. */

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef unsigned int fmi3ValueReference;
typedef double fmi3Float64;
typedef bool fmi3Boolean;
typedef uint8_t fmi3Byte;
typedef const char *fmi3String;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef int fmi3DependencyKind, fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3Callback)(void);

#define FMI3(name, ...)   EXPORT(fmi3Status fmi3##name(__VA_ARGS__))
#define FMI(name, ...)    FMI3(name, __VA_ARGS__) /* after the names below are replaced */
#define COUNT(name)       , size_t name
#define COUNT_OF(name, n) (name)
#define FMU_OK            fmi3OK
#define FMU_ERROR         fmi3Error
#define GET_STATE         GetFMUState
#define SET_STATE         SetFMUState
#define FREE_STATE        FreeFMUState
#define STATE_SIZE        SerializedFMUStateSize
#define WRITE_STATE       SerializeFMUState
#define READ_STATE        DeserializeFMUState
#define GET_DERIVATIVES   GetContinuousStateDerivatives
#define SET_VALUES        SetFloat64
typedef fmi3Boolean fmuBoolean;
typedef fmi3Byte fmuByte;

EXPORT(const char *fmi3GetVersion(void)) {
    return "3.0";
}

static int span(unsigned int vr, int *at) {
    *at = vr < PORTS ? ports[vr].at : 0;
    return vr < PORTS ? ports[vr].count : 0;
}

static fmi3Status refuse(fmi3Instance c, const char *why) {
    const instance *i = (const instance *)c;
    if (i != NULL && i->logger != NULL)
        ((fmi3LogMessageCallback)i->logger)(i->environment, fmi3Error, "error", why);
    return fmi3Error;
}

static fmi3Instance instantiate(int exchange, fmi3String token, fmi3InstanceEnvironment environment,
                                fmi3LogMessageCallback log) {
    if (token != NULL && strcmp(token, TOKEN) == 0) return create(exchange, environment, (void (*)(void))log);
    if (log != NULL)
        log(environment, fmi3Error, "error", "the instantiation token is not that of this model: " TOKEN);
    return NULL;
}

EXPORT(fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                                 fmi3Boolean visible, fmi3Boolean logging,
                                                 fmi3InstanceEnvironment environment,
                                                 fmi3LogMessageCallback log)) {
    return instantiate(1, token, environment, log);
}
EXPORT(fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                                fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
                                                fmi3Boolean early, const fmi3ValueReference required[],
                                                size_t n, fmi3InstanceEnvironment environment,
                                                fmi3LogMessageCallback log, fmi3Callback update)) {
    return instantiate(0, token, environment, log);
}
EXPORT(fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                                      fmi3Boolean visible, fmi3Boolean logging,
                                                      fmi3InstanceEnvironment environment,
                                                      fmi3LogMessageCallback log, fmi3Callback update,
                                                      fmi3Callback lock, fmi3Callback unlock)) {
    return NULL;
}
EXPORT(void fmi3FreeInstance(fmi3Instance c)) {
    free(c);
}

FMI(EnterInitializationMode, fmi3Instance c, fmi3Boolean tolerance, fmi3Float64 t, fmi3Float64 start,
    fmi3Boolean stops, fmi3Float64 stop) {
    ALLOW(INSTANTIATED);
    NEED(is_finite(start));
    ((instance *)c)->m.time = start;
    ((instance *)c)->m.mode = INITIALIZATION;
    return fmi3OK;
}
/* There are no structural parameters to configure, and no events in co-simulation. */
MODE(EnterConfigurationMode, NEVER, ANY)
MODE(ExitConfigurationMode, NEVER, ANY)
MODE(EnterStepMode, NEVER, ANY)
FMI(EvaluateDiscreteStates, fmi3Instance c) {
    ALLOW(INITIALIZATION | EVENT);
    return fmi3OK;
}

/* ---- values ---- */

FMI(GetFloat64, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t count) {
    instance *i = (instance *)c;
    size_t k, at = 0;
    ALLOW(EVALUATED);
    NEED(is_given(n, vr, value));
    refresh(i);
    for (k = 0; k < n; k++) {
        const size_t size = vr[k] < PORTS ? (size_t)ports[vr[k]].count : 1;
        NEED(vr[k] <= PORTS && size <= count - at);
        memcpy(value + at, vr[k] < PORTS ? i->m.values + ports[vr[k]].at : &i->m.time, size * sizeof *value);
        at += size;
    }
    NEED(at == count);
    return fmi3OK;
}
UNUSED_TYPE(Float32, float)
UNUSED_TYPE(Int8, int8_t)
UNUSED_TYPE(UInt8, uint8_t)
UNUSED_TYPE(Int16, int16_t)
UNUSED_TYPE(UInt16, uint16_t)
UNUSED_TYPE(Int32, int32_t)
UNUSED_TYPE(UInt32, uint32_t)
UNUSED_TYPE(Int64, int64_t)
UNUSED_TYPE(UInt64, uint64_t)
UNUSED_TYPE(Boolean, fmi3Boolean)
UNUSED_TYPE(String, fmi3String)
EMPTY(GetBinary, fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[], const fmi3Byte *v[],
      size_t k)
EMPTY(SetBinary, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
      const fmi3Byte *const v[], size_t k)
EMPTY(GetClock, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Boolean v[])
EMPTY(SetClock, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Boolean v[])
ALWAYS(fmi3Error, GetNumberOfVariableDependencies, fmi3Instance c, fmi3ValueReference vr, size_t *n)
ALWAYS(fmi3Error, GetVariableDependencies, fmi3Instance c, fmi3ValueReference dependent, size_t at[],
       fmi3ValueReference of[], size_t at_of[], fmi3DependencyKind kinds[], size_t n)

/* ---- derivatives ---- */

FMI(GetAdjointDerivative, fmi3Instance c, const fmi3ValueReference unknown[], size_t unknowns,
    const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[], size_t seeds,
    fmi3Float64 sensitivity[], size_t sensitivities) {
    instance *i = (instance *)c;
    ALLOW(EVALUATED);
    NEED(is_given(unknowns, unknown, seed) && is_given(knowns, known, sensitivity));
    NEED(fits(unknown, unknowns, 0, seeds) && fits(known, knowns, 1, sensitivities));
    memset(i->seeds, 0, sizeof i->seeds);
    scatter(unknown, unknowns, seed, i->seeds);
    if (!adjoint(i->m.values, i->seeds, i->results, i->room, i->work)) return fmi3Error;
    gather(known, knowns, i->results, sensitivity);
    return fmi3OK;
}

/* ---- clocks, of which there are none ---- */

ALWAYS(fmi3Error, GetIntervalDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
       fmi3Float64 v[], fmi3IntervalQualifier q[])
ALWAYS(fmi3Error, GetIntervalFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n, uint64_t v[],
       uint64_t w[], fmi3IntervalQualifier q[])
ALWAYS(fmi3Error, GetShiftDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 v[])
ALWAYS(fmi3Error, GetShiftFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n, uint64_t v[],
       uint64_t w[])
ALWAYS(fmi3Error, SetIntervalDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
       const fmi3Float64 v[])
ALWAYS(fmi3Error, SetIntervalFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
       const uint64_t v[], const uint64_t w[])
ALWAYS(fmi3Error, SetShiftDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
       const fmi3Float64 v[])
ALWAYS(fmi3Error, SetShiftFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
       const uint64_t v[], const uint64_t w[])
ALWAYS(fmi3Error, ActivateModelPartition, fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
FMI(UpdateDiscreteStates, fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals,
    fmi3Boolean *values, fmi3Boolean *event, fmi3Float64 *time) {
    ALLOW(EVENT);
    NEED(again != NULL && terminate != NULL && nominals != NULL && values != NULL && event != NULL);
    *again = *terminate = *nominals = *values = *event = false;
    return fmi3OK;
}

/* ---- model exchange ---- */

FMI(GetNumberOfEventIndicators, fmi3Instance c, size_t *n) {
    ALLOW(ANY);
    NEED(n != NULL);
    *n = 0;
    return fmi3OK;
}
FMI(GetNumberOfContinuousStates, fmi3Instance c, size_t *n) {
    ALLOW(ANY);
    NEED(n != NULL);
    *n = STATES;
    return fmi3OK;
}

/* ---- co-simulation ---- */

ALWAYS(fmi3Error, GetOutputDerivatives, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
       const int32_t order[], fmi3Float64 v[], size_t count)
FMI(DoStep, fmi3Instance c, fmi3Float64 now, fmi3Float64 step, fmi3Boolean final, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    instance *i = (instance *)c;
    const char *failure;
    ALLOW(STEP);
    NEED(event != NULL && terminate != NULL && early != NULL && last != NULL);
    *event = *terminate = *early = false;
    NEED(is_finite(now) && is_step(step) && is_finite(now + step));
    i->m.time = now;
    failure = advance(i, step);
    *last = i->m.time;
    return failure == NULL ? fmi3OK : refuse(c, failure);
}
