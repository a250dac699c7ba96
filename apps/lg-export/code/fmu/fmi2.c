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

FMI2(SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    (void)c, (void)on, (void)n, (void)names;
    return fmi2OK;
}

EXPORTED fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                       const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                       fmi2Boolean log);
EXPORTED fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                       const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                       fmi2Boolean log) {
    (void)type, (void)resources, (void)visible, (void)log;
    if (guid == NULL || strcmp(guid, TOKEN) != 0) {
        if (callbacks != NULL && callbacks->logger != NULL)
            callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "error",
                              "the guid is not that of this model: %s", TOKEN);
        return NULL;
    }
    return callbacks == NULL ? create(NULL, NULL)
                             : create(callbacks->componentEnvironment, (void (*)(void))callbacks->logger);
}

EXPORTED void fmi2FreeInstance(fmi2Component c);
EXPORTED void fmi2FreeInstance(fmi2Component c) {
    free(c);
}

FMI2(SetupExperiment, fmi2Component c, fmi2Boolean tolerance, fmi2Real t, fmi2Real start, fmi2Boolean stops,
     fmi2Real stop) {
    (void)tolerance, (void)t, (void)stops, (void)stop;
    ((instance *)c)->m.time = start;
    return fmi2OK;
}
FMI2(EnterInitializationMode, fmi2Component c) {
    (void)c;
    return fmi2OK;
}
FMI2(ExitInitializationMode, fmi2Component c) {
    (void)c;
    return fmi2OK;
}
FMI2(Terminate, fmi2Component c) {
    (void)c;
    return fmi2OK;
}
FMI2(Reset, fmi2Component c) {
    reset((instance *)c);
    return fmi2OK;
}

/* ---- values ---- */

FMI2(GetReal, fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    instance *i = (instance *)c;
    size_t k;
    refresh(i);
    for (k = 0; k < n; k++) {
        if (vr[k] >= NUMBERS) return fmi2Error;
        value[k] = i->m.values[vr[k]];
    }
    return fmi2OK;
}
FMI2(SetReal, fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    instance *i = (instance *)c;
    size_t k;
    for (k = 0; k < n; k++) {
        if (vr[k] >= NUMBERS || !is_known((int)vr[k])) return fmi2Error;
        i->m.values[vr[k]] = value[k];
    }
    i->stale = 1;
    return fmi2OK;
}

/* There are no variables of other types. */
#define FMI2_NONE(name, type)                                                                                \
    FMI2(Get##name, fmi2Component c, const fmi2ValueReference vr[], size_t n, type v[]) {                    \
        (void)c, (void)vr, (void)v;                                                                          \
        return n == 0 ? fmi2OK : fmi2Error;                                                                  \
    }                                                                                                        \
    FMI2(Set##name, fmi2Component c, const fmi2ValueReference vr[], size_t n, const type v[]) {              \
        (void)c, (void)vr, (void)v;                                                                          \
        return n == 0 ? fmi2OK : fmi2Error;                                                                  \
    }
FMI2_NONE(Integer, fmi2Integer)
FMI2_NONE(Boolean, fmi2Boolean)
FMI2_NONE(String, fmi2String)

/* ---- states of the instance ---- */

FMI2(GetFMUstate, fmi2Component c, fmi2FMUstate *state) {
    if (*state == NULL) *state = malloc(sizeof(memory));
    if (*state == NULL) return fmi2Error;
    memcpy(*state, &((instance *)c)->m, sizeof(memory));
    return fmi2OK;
}
FMI2(SetFMUstate, fmi2Component c, fmi2FMUstate state) {
    memcpy(&((instance *)c)->m, state, sizeof(memory));
    ((instance *)c)->stale = 1;
    return fmi2OK;
}
FMI2(FreeFMUstate, fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}
FMI2(SerializedFMUstateSize, fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(image);
    return fmi2OK;
}
FMI2(SerializeFMUstate, fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    (void)c;
    if (size < sizeof(image)) return fmi2Error;
    write_image((const memory *)state, bytes);
    return fmi2OK;
}
FMI2(DeSerializeFMUstate, fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    memory m;
    (void)c;
    if (!read_image(bytes, size, &m)) return fmi2Error;
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
    memset(i->seeds, 0, sizeof i->seeds);
    for (k = 0; k < knowns; k++) {
        if (known[k] >= NUMBERS || !is_known((int)known[k])) return fmi2Error;
        i->seeds[known[k]] = seed[k];
    }
    if (!forward(i->m.values, i->seeds, i->results, i->work)) return fmi2Error;
    for (k = 0; k < unknowns; k++) {
        if (unknown[k] >= NUMBERS) return fmi2Error;
        sensitivity[k] = i->results[unknown[k]];
    }
    return fmi2OK;
}

/* ---- model exchange ---- */

FMI2(EnterEventMode, fmi2Component c) {
    (void)c;
    return fmi2OK;
}
FMI2(NewDiscreteStates, fmi2Component c, fmi2EventInfo *info) {
    (void)c;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}
FMI2(EnterContinuousTimeMode, fmi2Component c) {
    (void)c;
    return fmi2OK;
}
FMI2(CompletedIntegratorStep, fmi2Component c, fmi2Boolean final, fmi2Boolean *event,
     fmi2Boolean *terminate) {
    (void)c, (void) final;
    *event = *terminate = 0;
    return fmi2OK;
}
FMI2(SetTime, fmi2Component c, fmi2Real time) {
    ((instance *)c)->m.time = time;
    return fmi2OK;
}
FMI2(SetContinuousStates, fmi2Component c, const fmi2Real x[], size_t n) {
    if (n != STATES) return fmi2Error;
    memcpy(((instance *)c)->m.values, x, n * sizeof *x);
    ((instance *)c)->stale = 1;
    return fmi2OK;
}
FMI2(GetContinuousStates, fmi2Component c, fmi2Real x[], size_t n) {
    if (n != STATES) return fmi2Error;
    memcpy(x, ((instance *)c)->m.values, n * sizeof *x);
    return fmi2OK;
}
FMI2(GetDerivatives, fmi2Component c, fmi2Real x[], size_t n) {
    if (n != STATES) return fmi2Error;
    refresh((instance *)c);
    memcpy(x, ((instance *)c)->m.values + DERIVATIVE_AT, n * sizeof *x);
    return fmi2OK;
}
FMI2(GetEventIndicators, fmi2Component c, fmi2Real x[], size_t n) {
    (void)c, (void)x;
    return n == 0 ? fmi2OK : fmi2Error;
}
FMI2(GetNominalsOfContinuousStates, fmi2Component c, fmi2Real x[], size_t n) {
    size_t k;
    (void)c;
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
    if (!is_step(step)) return fmi2Error;
    i->m.time = now;
    failure = advance(i, step);
    if (failure == NULL) return fmi2OK;
    if (i->logger != NULL)
        ((fmi2CallbackLogger)i->logger)(i->environment, "", fmi2Error, "error", "%s", failure);
    return fmi2Error;
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
