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

#define FMI3(name, ...)                                                                                      \
    EXPORTED fmi3Status fmi3##name(__VA_ARGS__);                                                             \
    EXPORTED fmi3Status fmi3##name(__VA_ARGS__)

EXPORTED const char *fmi3GetVersion(void);
EXPORTED const char *fmi3GetVersion(void) {
    return "3.0";
}

FMI3(SetDebugLogging, fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[]) {
    (void)c, (void)on, (void)n, (void)names;
    return fmi3OK;
}

static fmi3Instance instantiate(fmi3String token, fmi3InstanceEnvironment environment,
                                fmi3LogMessageCallback log) {
    if (token != NULL && strcmp(token, TOKEN) == 0) return create(environment, (void (*)(void))log);
    if (log != NULL)
        log(environment, fmi3Error, "error", "the instantiation token is not that of this model: " TOKEN);
    return NULL;
}

EXPORTED fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                                   fmi3Boolean visible, fmi3Boolean logging,
                                                   fmi3InstanceEnvironment environment,
                                                   fmi3LogMessageCallback log);
EXPORTED fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                                   fmi3Boolean visible, fmi3Boolean logging,
                                                   fmi3InstanceEnvironment environment,
                                                   fmi3LogMessageCallback log) {
    (void)name, (void)resources, (void)visible, (void)logging;
    return instantiate(token, environment, log);
}
EXPORTED fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                                  fmi3Boolean visible, fmi3Boolean logging,
                                                  fmi3Boolean events, fmi3Boolean early,
                                                  const fmi3ValueReference required[], size_t n,
                                                  fmi3InstanceEnvironment environment,
                                                  fmi3LogMessageCallback log, fmi3Callback update);
EXPORTED fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                                  fmi3Boolean visible, fmi3Boolean logging,
                                                  fmi3Boolean events, fmi3Boolean early,
                                                  const fmi3ValueReference required[], size_t n,
                                                  fmi3InstanceEnvironment environment,
                                                  fmi3LogMessageCallback log, fmi3Callback update) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required,
        (void)n;
    (void)update;
    return instantiate(token, environment, log);
}
EXPORTED fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token,
                                                        fmi3String resources, fmi3Boolean visible,
                                                        fmi3Boolean logging,
                                                        fmi3InstanceEnvironment environment,
                                                        fmi3LogMessageCallback log, fmi3Callback update,
                                                        fmi3Callback lock, fmi3Callback unlock);
EXPORTED fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token,
                                                        fmi3String resources, fmi3Boolean visible,
                                                        fmi3Boolean logging,
                                                        fmi3InstanceEnvironment environment,
                                                        fmi3LogMessageCallback log, fmi3Callback update,
                                                        fmi3Callback lock, fmi3Callback unlock) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)log;
    (void)update, (void)lock, (void)unlock;
    return NULL;
}
EXPORTED void fmi3FreeInstance(fmi3Instance c);
EXPORTED void fmi3FreeInstance(fmi3Instance c) {
    free(c);
}

FMI3(EnterInitializationMode, fmi3Instance c, fmi3Boolean tolerance, fmi3Float64 t, fmi3Float64 start,
     fmi3Boolean stops, fmi3Float64 stop) {
    (void)tolerance, (void)t, (void)stops, (void)stop;
    ((instance *)c)->m.time = start;
    return fmi3OK;
}
#define FMI3_MODE(name)                                                                                      \
    FMI3(name, fmi3Instance c) {                                                                             \
        (void)c;                                                                                             \
        return fmi3OK;                                                                                       \
    }
FMI3_MODE(ExitInitializationMode)
FMI3_MODE(EnterEventMode)
FMI3_MODE(Terminate)
FMI3_MODE(EnterConfigurationMode)
FMI3_MODE(ExitConfigurationMode)
FMI3_MODE(EnterContinuousTimeMode)
FMI3_MODE(EnterStepMode)
FMI3_MODE(EvaluateDiscreteStates)
FMI3(Reset, fmi3Instance c) {
    reset((instance *)c);
    return fmi3OK;
}

/* ---- values ---- */

FMI3(GetFloat64, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t count) {
    instance *i = (instance *)c;
    size_t k, at = 0;
    refresh(i);
    for (k = 0; k < n; k++) {
        const size_t size = vr[k] < PORTS ? (size_t)ports[vr[k]].count : 1;
        if (vr[k] > PORTS || at + size > count) return fmi3Error;
        memcpy(value + at, vr[k] < PORTS ? i->m.values + ports[vr[k]].at : &i->m.time, size * sizeof *value);
        at += size;
    }
    return at == count ? fmi3OK : fmi3Error;
}
FMI3(SetFloat64, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[],
     size_t count) {
    instance *i = (instance *)c;
    size_t k, at = 0;
    for (k = 0; k < n; k++) {
        if (vr[k] >= PORTS || !is_known(ports[vr[k]].at) || at + (size_t)ports[vr[k]].count > count)
            return fmi3Error;
        memcpy(i->m.values + ports[vr[k]].at, value + at, (size_t)ports[vr[k]].count * sizeof *value);
        at += (size_t)ports[vr[k]].count;
    }
    i->stale = 1;
    return at == count ? fmi3OK : fmi3Error;
}

/* There are no variables of other types. */
#define FMI3_NONE(name, type)                                                                                \
    FMI3(Get##name, fmi3Instance c, const fmi3ValueReference vr[], size_t n, type v[], size_t count) {       \
        (void)c, (void)vr, (void)v, (void)count;                                                             \
        return n == 0 ? fmi3OK : fmi3Error;                                                                  \
    }                                                                                                        \
    FMI3(Set##name, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const type v[], size_t count) { \
        (void)c, (void)vr, (void)v, (void)count;                                                             \
        return n == 0 ? fmi3OK : fmi3Error;                                                                  \
    }
FMI3_NONE(Float32, float)
FMI3_NONE(Int8, int8_t)
FMI3_NONE(UInt8, uint8_t)
FMI3_NONE(Int16, int16_t)
FMI3_NONE(UInt16, uint16_t)
FMI3_NONE(Int32, int32_t)
FMI3_NONE(UInt32, uint32_t)
FMI3_NONE(Int64, int64_t)
FMI3_NONE(UInt64, uint64_t)
FMI3_NONE(Boolean, fmi3Boolean)
FMI3_NONE(String, fmi3String)
FMI3(GetBinary, fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[], const fmi3Byte *v[],
     size_t k) {
    (void)c, (void)vr, (void)sizes, (void)v, (void)k;
    return n == 0 ? fmi3OK : fmi3Error;
}
FMI3(SetBinary, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
     const fmi3Byte *const v[], size_t k) {
    (void)c, (void)vr, (void)sizes, (void)v, (void)k;
    return n == 0 ? fmi3OK : fmi3Error;
}
FMI3(GetClock, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Boolean v[]) {
    (void)c, (void)vr, (void)v;
    return n == 0 ? fmi3OK : fmi3Error;
}
FMI3(SetClock, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Boolean v[]) {
    (void)c, (void)vr, (void)v;
    return n == 0 ? fmi3OK : fmi3Error;
}

FMI3(GetNumberOfVariableDependencies, fmi3Instance c, fmi3ValueReference vr, size_t *n) {
    (void)c, (void)vr, (void)n;
    return fmi3Error;
}
FMI3(GetVariableDependencies, fmi3Instance c, fmi3ValueReference dependent, size_t at[],
     fmi3ValueReference of[], size_t at_of[], fmi3DependencyKind kinds[], size_t n) {
    (void)c, (void)dependent, (void)at, (void)of, (void)at_of, (void)kinds, (void)n;
    return fmi3Error;
}

/* ---- states of the instance ---- */

FMI3(GetFMUState, fmi3Instance c, fmi3FMUState *state) {
    if (*state == NULL) *state = malloc(sizeof(memory));
    if (*state == NULL) return fmi3Error;
    memcpy(*state, &((instance *)c)->m, sizeof(memory));
    return fmi3OK;
}
FMI3(SetFMUState, fmi3Instance c, fmi3FMUState state) {
    memcpy(&((instance *)c)->m, state, sizeof(memory));
    ((instance *)c)->stale = 1;
    return fmi3OK;
}
FMI3(FreeFMUState, fmi3Instance c, fmi3FMUState *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}
FMI3(SerializedFMUStateSize, fmi3Instance c, fmi3FMUState state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(image);
    return fmi3OK;
}
FMI3(SerializeFMUState, fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    (void)c;
    if (size < sizeof(image)) return fmi3Error;
    write_image((const memory *)state, bytes);
    return fmi3OK;
}
FMI3(DeserializeFMUState, fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    memory m;
    (void)c;
    if (!read_image(bytes, size, &m)) return fmi3Error;
    if (*state == NULL) *state = malloc(sizeof m);
    if (*state == NULL) return fmi3Error;
    memcpy(*state, &m, sizeof m);
    return fmi3OK;
}

/* ---- derivatives ---- */

/* Numbers of the ports into, or out of, an array with their places; 0: not that many, or no port. */
static int scatter(const fmi3ValueReference vr[], size_t n, const double *from, size_t count, double *to) {
    size_t k, at = 0;
    memset(to, 0, NUMBERS * sizeof *to);
    for (k = 0; k < n; k++) {
        if (vr[k] >= PORTS || at + (size_t)ports[vr[k]].count > count) return 0;
        memcpy(to + ports[vr[k]].at, from + at, (size_t)ports[vr[k]].count * sizeof *to);
        at += (size_t)ports[vr[k]].count;
    }
    return at == count;
}
static int gather(const fmi3ValueReference vr[], size_t n, const double *from, double *to, size_t count) {
    size_t k, at = 0;
    for (k = 0; k < n; k++) {
        if (vr[k] >= PORTS || at + (size_t)ports[vr[k]].count > count) return 0;
        memcpy(to + at, from + ports[vr[k]].at, (size_t)ports[vr[k]].count * sizeof *to);
        at += (size_t)ports[vr[k]].count;
    }
    return at == count;
}
FMI3(GetDirectionalDerivative, fmi3Instance c, const fmi3ValueReference unknown[], size_t unknowns,
     const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[], size_t seeds,
     fmi3Float64 sensitivity[], size_t sensitivities) {
    instance *i = (instance *)c;
    return scatter(known, knowns, seed, seeds, i->seeds) &&
                   forward(i->m.values, i->seeds, i->results, i->work) &&
                   gather(unknown, unknowns, i->results, sensitivity, sensitivities)
               ? fmi3OK
               : fmi3Error;
}
FMI3(GetAdjointDerivative, fmi3Instance c, const fmi3ValueReference unknown[], size_t unknowns,
     const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[], size_t seeds,
     fmi3Float64 sensitivity[], size_t sensitivities) {
    instance *i = (instance *)c;
    return scatter(unknown, unknowns, seed, seeds, i->seeds) &&
                   adjoint(i->m.values, i->seeds, i->results, i->room, i->work) &&
                   gather(known, knowns, i->results, sensitivity, sensitivities)
               ? fmi3OK
               : fmi3Error;
}

/* ---- clocks, of which there are none ---- */

FMI3(GetIntervalDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 v[],
     fmi3IntervalQualifier q[]) {
    (void)c, (void)vr, (void)n, (void)v, (void)q;
    return fmi3Error;
}
FMI3(GetIntervalFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n, uint64_t v[], uint64_t w[],
     fmi3IntervalQualifier q[]) {
    (void)c, (void)vr, (void)n, (void)v, (void)w, (void)q;
    return fmi3Error;
}
FMI3(GetShiftDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 v[]) {
    (void)c, (void)vr, (void)n, (void)v;
    return fmi3Error;
}
FMI3(GetShiftFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n, uint64_t v[], uint64_t w[]) {
    (void)c, (void)vr, (void)n, (void)v, (void)w;
    return fmi3Error;
}
FMI3(SetIntervalDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 v[]) {
    (void)c, (void)vr, (void)n, (void)v;
    return fmi3Error;
}
FMI3(SetIntervalFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const uint64_t v[],
     const uint64_t w[]) {
    (void)c, (void)vr, (void)n, (void)v, (void)w;
    return fmi3Error;
}
FMI3(SetShiftDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 v[]) {
    (void)c, (void)vr, (void)n, (void)v;
    return fmi3Error;
}
FMI3(SetShiftFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const uint64_t v[],
     const uint64_t w[]) {
    (void)c, (void)vr, (void)n, (void)v, (void)w;
    return fmi3Error;
}
FMI3(ActivateModelPartition, fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time) {
    (void)c, (void)clock, (void)time;
    return fmi3Error;
}
FMI3(UpdateDiscreteStates, fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals,
     fmi3Boolean *values, fmi3Boolean *event, fmi3Float64 *time) {
    (void)c, (void)time;
    *again = *terminate = *nominals = *values = *event = false;
    return fmi3OK;
}

/* ---- model exchange ---- */

FMI3(CompletedIntegratorStep, fmi3Instance c, fmi3Boolean final, fmi3Boolean *event, fmi3Boolean *terminate) {
    (void)c, (void) final;
    *event = *terminate = false;
    return fmi3OK;
}
FMI3(SetTime, fmi3Instance c, fmi3Float64 time) {
    ((instance *)c)->m.time = time;
    return fmi3OK;
}
FMI3(SetContinuousStates, fmi3Instance c, const fmi3Float64 x[], size_t n) {
    if (n != STATES) return fmi3Error;
    memcpy(((instance *)c)->m.values, x, n * sizeof *x);
    ((instance *)c)->stale = 1;
    return fmi3OK;
}
FMI3(GetContinuousStates, fmi3Instance c, fmi3Float64 x[], size_t n) {
    if (n != STATES) return fmi3Error;
    memcpy(x, ((instance *)c)->m.values, n * sizeof *x);
    return fmi3OK;
}
FMI3(GetContinuousStateDerivatives, fmi3Instance c, fmi3Float64 x[], size_t n) {
    if (n != STATES) return fmi3Error;
    refresh((instance *)c);
    memcpy(x, ((instance *)c)->m.values + DERIVATIVE_AT, n * sizeof *x);
    return fmi3OK;
}
FMI3(GetEventIndicators, fmi3Instance c, fmi3Float64 x[], size_t n) {
    (void)c, (void)x;
    return n == 0 ? fmi3OK : fmi3Error;
}
FMI3(GetNominalsOfContinuousStates, fmi3Instance c, fmi3Float64 x[], size_t n) {
    size_t k;
    (void)c;
    for (k = 0; k < n; k++) x[k] = 1.0;
    return fmi3OK;
}
FMI3(GetNumberOfEventIndicators, fmi3Instance c, size_t *n) {
    (void)c;
    *n = 0;
    return fmi3OK;
}
FMI3(GetNumberOfContinuousStates, fmi3Instance c, size_t *n) {
    (void)c;
    *n = STATES;
    return fmi3OK;
}

/* ---- co-simulation ---- */

FMI3(GetOutputDerivatives, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const int32_t order[],
     fmi3Float64 v[], size_t count) {
    (void)c, (void)vr, (void)n, (void)order, (void)v, (void)count;
    return fmi3Error;
}
FMI3(DoStep, fmi3Instance c, fmi3Float64 now, fmi3Float64 step, fmi3Boolean final, fmi3Boolean *event,
     fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    instance *i = (instance *)c;
    const char *failure;
    (void) final;
    *event = *terminate = *early = false;
    if (!is_step(step)) return fmi3Error;
    i->m.time = now;
    failure = advance(i, step);
    *last = i->m.time;
    if (failure == NULL) return fmi3OK;
    if (i->logger != NULL) ((fmi3LogMessageCallback)i->logger)(i->environment, fmi3Error, "error", failure);
    return fmi3Error;
}
