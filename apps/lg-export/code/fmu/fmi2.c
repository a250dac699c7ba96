/* FMI 2.0 (fmi-standard.org), model exchange and co-simulation. A value reference is a place in the array. */

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Byte;
typedef const char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef int fmi2StatusKind;
typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String,
                                   ...);
typedef struct {
    fmi2CallbackLogger logger;
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
typedef struct {
    fmi2Boolean newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged,
        valuesOfContinuousStatesChanged, nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

#define FMI2(name, ...)                                                                                      \
    EXPORTED fmi2Status fmi2##name(__VA_ARGS__);                                                             \
    EXPORTED fmi2Status fmi2##name(__VA_ARGS__)

EXPORTED const char *fmi2GetTypesPlatform(void);
EXPORTED const char *fmi2GetTypesPlatform(void) {
    return "default";
}
EXPORTED const char *fmi2GetVersion(void);
EXPORTED const char *fmi2GetVersion(void) {
    return "2.0";
}

static fmi2Status refuse(fmi2Component c, const char *why) {
    const instance *i = (const instance *)c;
    if (i != NULL && i->logger != NULL)
        ((fmi2CallbackLogger)i->logger)(i->environment, "", fmi2Error, "error", "%s", why);
    return fmi2Error;
}

/* Ends a function that the instance's mode does not allow, or that has wrong arguments. */
#define ALLOW(modes)                                                                                         \
    do {                                                                                                     \
        if (!allowed((instance *)c, modes)) return refuse(c, misplaced);                                     \
    } while (0)
#define NEED(fits)                                                                                           \
    do {                                                                                                     \
        if (!(fits)) return refuse(c, unfitting);                                                            \
    } while (0)

FMI2(SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    (void)on, (void)n, (void)names;
    ALLOW(ANY);
    return fmi2OK;
}

EXPORTED fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                       const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                       fmi2Boolean log);
EXPORTED fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                       const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                       fmi2Boolean log) {
    (void)resources, (void)visible, (void)log;
    if (type != fmi2ModelExchange && type != fmi2CoSimulation) return NULL;
    if (guid == NULL || strcmp(guid, TOKEN) != 0) {
        if (callbacks != NULL && callbacks->logger != NULL)
            callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "error",
                              "the guid is not that of this model: %s", TOKEN);
        return NULL;
    }
    return callbacks == NULL ? create(type == fmi2ModelExchange, NULL, NULL)
                             : create(type == fmi2ModelExchange, callbacks->componentEnvironment,
                                      (void (*)(void))callbacks->logger);
}

EXPORTED void fmi2FreeInstance(fmi2Component c);
EXPORTED void fmi2FreeInstance(fmi2Component c) {
    free(c);
}

FMI2(SetupExperiment, fmi2Component c, fmi2Boolean tolerance, fmi2Real t, fmi2Real start, fmi2Boolean stops,
     fmi2Real stop) {
    (void)tolerance, (void)t, (void)stops, (void)stop;
    ALLOW(INSTANTIATED);
    NEED(is_finite(start));
    ((instance *)c)->m.time = start;
    return fmi2OK;
}
#define FMI2_MODE(name, from, to)                                                                            \
    FMI2(name, fmi2Component c) {                                                                            \
        return take_mode((instance *)c, from, to) ? fmi2OK : refuse(c, misplaced);                           \
    }
FMI2_MODE(EnterInitializationMode, INSTANTIATED, INITIALIZATION)
FMI2_MODE(ExitInitializationMode, INITIALIZATION, RUNNING)
FMI2_MODE(Terminate, RUNNING, TERMINATED)
FMI2(Reset, fmi2Component c) {
    ALLOW(ANY);
    reset((instance *)c);
    return fmi2OK;
}

/* ---- values ---- */

FMI2(GetReal, fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    instance *i = (instance *)c;
    size_t k;
    ALLOW(EVALUATED);
    NEED(is_given(n, vr, value));
    refresh(i);
    for (k = 0; k < n; k++) {
        NEED(vr[k] < NUMBERS);
        value[k] = i->m.values[vr[k]];
    }
    return fmi2OK;
}
FMI2(SetReal, fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    instance *i = (instance *)c;
    size_t k;
    ALLOW(INSTANTIATED | INITIALIZATION | RUNNING);
    NEED(is_given(n, vr, value));
    i->stale = 1;
    for (k = 0; k < n; k++) {
        NEED(vr[k] < NUMBERS && is_known((int)vr[k]));
        i->m.values[vr[k]] = value[k];
    }
    return fmi2OK;
}

/* There are no variables of other types. */
#define FMI2_NONE(name, type)                                                                                \
    FMI2(Get##name, fmi2Component c, const fmi2ValueReference vr[], size_t n, type v[]) {                    \
        (void)vr, (void)v;                                                                                   \
        return c != NULL && n == 0 ? fmi2OK : fmi2Error;                                                     \
    }                                                                                                        \
    FMI2(Set##name, fmi2Component c, const fmi2ValueReference vr[], size_t n, const type v[]) {              \
        (void)vr, (void)v;                                                                                   \
        return c != NULL && n == 0 ? fmi2OK : fmi2Error;                                                     \
    }
FMI2_NONE(Integer, fmi2Integer)
FMI2_NONE(Boolean, fmi2Boolean)
FMI2_NONE(String, fmi2String)

/* ---- states of the instance ---- */

FMI2(GetFMUstate, fmi2Component c, fmi2FMUstate *state) {
    ALLOW(ANY);
    NEED(state != NULL);
    if (*state == NULL) *state = malloc(sizeof(memory));
    if (*state == NULL) return fmi2Error;
    memcpy(*state, &((instance *)c)->m, sizeof(memory));
    return fmi2OK;
}
FMI2(SetFMUstate, fmi2Component c, fmi2FMUstate state) {
    ALLOW(ANY);
    NEED(restore((instance *)c, (const memory *)state));
    return fmi2OK;
}
FMI2(FreeFMUstate, fmi2Component c, fmi2FMUstate *state) {
    ALLOW(ANY);
    if (state == NULL) return fmi2OK;
    free(*state);
    *state = NULL;
    return fmi2OK;
}
FMI2(SerializedFMUstateSize, fmi2Component c, fmi2FMUstate state, size_t *size) {
    ALLOW(ANY);
    NEED(state != NULL && size != NULL);
    *size = sizeof(image);
    return fmi2OK;
}
FMI2(SerializeFMUstate, fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    ALLOW(ANY);
    NEED(state != NULL && bytes != NULL && size >= sizeof(image));
    write_image((const memory *)state, bytes);
    return fmi2OK;
}
FMI2(DeSerializeFMUstate, fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    memory m;
    ALLOW(ANY);
    NEED(state != NULL && read_image((const instance *)c, bytes, size, &m));
    if (*state == NULL) *state = malloc(sizeof m);
    if (*state == NULL) return fmi2Error;
    memcpy(*state, &m, sizeof m);
    return fmi2OK;
}

/* ---- derivatives ---- */

FMI2(GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
     const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[], fmi2Real sensitivity[]) {
    instance *i = (instance *)c;
    size_t k;
    ALLOW(EVALUATED);
    NEED(is_given(knowns, known, seed) && is_given(unknowns, unknown, sensitivity));
    memset(i->seeds, 0, sizeof i->seeds);
    for (k = 0; k < knowns; k++) {
        NEED(known[k] < NUMBERS && is_known((int)known[k]));
        i->seeds[known[k]] = seed[k];
    }
    if (!forward(i->m.values, i->seeds, i->results, i->work)) return fmi2Error;
    for (k = 0; k < unknowns; k++) {
        NEED(unknown[k] < NUMBERS);
        sensitivity[k] = i->results[unknown[k]];
    }
    return fmi2OK;
}

/* ---- model exchange ---- */

FMI2_MODE(EnterEventMode, EVENT | CONTINUOUS, EVENT)
FMI2_MODE(EnterContinuousTimeMode, EVENT, CONTINUOUS)
FMI2(NewDiscreteStates, fmi2Component c, fmi2EventInfo *info) {
    ALLOW(EVENT);
    NEED(info != NULL);
    memset(info, 0, sizeof *info);
    return fmi2OK;
}
FMI2(CompletedIntegratorStep, fmi2Component c, fmi2Boolean final, fmi2Boolean *event,
     fmi2Boolean *terminate) {
    (void) final;
    ALLOW(CONTINUOUS);
    NEED(event != NULL && terminate != NULL);
    *event = *terminate = 0;
    return fmi2OK;
}
FMI2(SetTime, fmi2Component c, fmi2Real time) {
    ALLOW(EVENT | CONTINUOUS);
    NEED(is_finite(time));
    ((instance *)c)->m.time = time;
    return fmi2OK;
}
FMI2(SetContinuousStates, fmi2Component c, const fmi2Real x[], size_t n) {
    ALLOW(CONTINUOUS);
    NEED(n == STATES && is_given(n, x, x));
    memcpy(((instance *)c)->m.values, x, n * sizeof *x);
    ((instance *)c)->stale = 1;
    return fmi2OK;
}
FMI2(GetContinuousStates, fmi2Component c, fmi2Real x[], size_t n) {
    ALLOW(EXCHANGED);
    NEED(n == STATES && is_given(n, x, x));
    memcpy(x, ((instance *)c)->m.values, n * sizeof *x);
    return fmi2OK;
}
FMI2(GetDerivatives, fmi2Component c, fmi2Real x[], size_t n) {
    ALLOW(EXCHANGED);
    NEED(n == STATES && is_given(n, x, x));
    refresh((instance *)c);
    memcpy(x, ((instance *)c)->m.values + DERIVATIVE_AT, n * sizeof *x);
    return fmi2OK;
}
FMI2(GetEventIndicators, fmi2Component c, fmi2Real x[], size_t n) {
    (void)x;
    ALLOW(EXCHANGED);
    return n == 0 ? fmi2OK : fmi2Error;
}
FMI2(GetNominalsOfContinuousStates, fmi2Component c, fmi2Real x[], size_t n) {
    size_t k;
    ALLOW(INSTANTIATED | EXCHANGED);
    NEED(n == STATES && is_given(n, x, x));
    for (k = 0; k < n; k++) x[k] = 1.0;
    return fmi2OK;
}

/* ---- co-simulation ---- */

FMI2(SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference vr[], size_t n,
     const fmi2Integer order[], const fmi2Real value[]) {
    (void)c, (void)vr, (void)n, (void)order, (void)value;
    return fmi2Error;
}
FMI2(GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference vr[], size_t n,
     const fmi2Integer order[], fmi2Real value[]) {
    (void)c, (void)vr, (void)n, (void)order, (void)value;
    return fmi2Error;
}
FMI2(DoStep, fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean final) {
    instance *i = (instance *)c;
    const char *failure;
    (void) final;
    ALLOW(STEP);
    NEED(is_finite(now) && is_step(step) && is_finite(now + step));
    i->m.time = now;
    failure = advance(i, step);
    return failure == NULL ? fmi2OK : refuse(c, failure);
}
FMI2(CancelStep, fmi2Component c) {
    (void)c;
    return fmi2Error;
}
FMI2(GetStatus, fmi2Component c, fmi2StatusKind kind, fmi2Status *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
FMI2(GetRealStatus, fmi2Component c, fmi2StatusKind kind, fmi2Real *value) {
    ALLOW(STEP | TERMINATED);
    NEED(value != NULL);
    if (kind != 2) return fmi2Discard; /* fmi2LastSuccessfulTime */
    *value = ((instance *)c)->m.time;
    return fmi2OK;
}
FMI2(GetIntegerStatus, fmi2Component c, fmi2StatusKind kind, fmi2Integer *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
FMI2(GetBooleanStatus, fmi2Component c, fmi2StatusKind kind, fmi2Boolean *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
FMI2(GetStringStatus, fmi2Component c, fmi2StatusKind kind, fmi2String *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
