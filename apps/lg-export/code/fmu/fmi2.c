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

#define FMI2(name, ...)   EXPORT(fmi2Status fmi2##name(__VA_ARGS__))
#define FMI(name, ...)    FMI2(name, __VA_ARGS__) /* after the names below are replaced */
#define COUNT(name)                               /* the references give the count of numbers */
#define COUNT_OF(name, n) (n)
#define FMU_OK            fmi2OK
#define FMU_ERROR         fmi2Error
#define GET_STATE         GetFMUstate
#define SET_STATE         SetFMUstate
#define FREE_STATE        FreeFMUstate
#define STATE_SIZE        SerializedFMUstateSize
#define WRITE_STATE       SerializeFMUstate
#define READ_STATE        DeSerializeFMUstate
#define GET_DERIVATIVES   GetDerivatives
#define SET_VALUES        SetReal
typedef fmi2Boolean fmuBoolean;
typedef fmi2Byte fmuByte;

EXPORT(const char *fmi2GetTypesPlatform(void)) {
    return "default";
}
EXPORT(const char *fmi2GetVersion(void)) {
    return "2.0";
}

static int span(unsigned int vr, int *at) {
    *at = (int)vr;
    return vr < NUMBERS;
}

static fmi2Status refuse(fmi2Component c, const char *why) {
    const instance *i = (const instance *)c;
    if (i != NULL && i->logger != NULL)
        ((fmi2CallbackLogger)i->logger)(i->environment, "", fmi2Error, "error", "%s", why);
    return fmi2Error;
}

EXPORT(fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                     fmi2Boolean log)) {
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

EXPORT(void fmi2FreeInstance(fmi2Component c)) {
    free(c);
}

FMI(SetupExperiment, fmi2Component c, fmi2Boolean tolerance, fmi2Real t, fmi2Real start, fmi2Boolean stops,
    fmi2Real stop) {
    ALLOW(INSTANTIATED);
    NEED(is_finite(start));
    ((instance *)c)->m.time = start;
    return fmi2OK;
}
MODE(EnterInitializationMode, INSTANTIATED, INITIALIZATION)

/* ---- values ---- */

FMI(GetReal, fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    ALLOW(EVALUATED);
    NEED(is_given(n, vr, value) && fits(vr, n, 0, n));
    refresh((instance *)c);
    gather(vr, n, ((instance *)c)->m.values, value);
    return fmi2OK;
}
UNUSED_TYPE(Integer, fmi2Integer)
UNUSED_TYPE(Boolean, fmi2Boolean)
UNUSED_TYPE(String, fmi2String)

/* ---- model exchange ---- */

FMI(NewDiscreteStates, fmi2Component c, fmi2EventInfo *info) {
    ALLOW(EVENT);
    NEED(info != NULL);
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

/* ---- co-simulation ---- */

ALWAYS(fmi2Error, SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference vr[], size_t n,
       const fmi2Integer order[], const fmi2Real value[])
ALWAYS(fmi2Error, GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference vr[], size_t n,
       const fmi2Integer order[], fmi2Real value[])
FMI(DoStep, fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean final) {
    instance *i = (instance *)c;
    const char *failure;
    ALLOW(STEP);
    NEED(is_finite(now) && is_step(step) && is_finite(now + step));
    i->m.time = now;
    failure = advance(i, step);
    return failure == NULL ? fmi2OK : refuse(c, failure);
}
ALWAYS(fmi2Error, CancelStep, fmi2Component c)
ALWAYS(fmi2Discard, GetStatus, fmi2Component c, fmi2StatusKind kind, fmi2Status *value)
FMI(GetRealStatus, fmi2Component c, fmi2StatusKind kind, fmi2Real *value) {
    ALLOW(STEP | TERMINATED);
    NEED(value != NULL);
    if (kind != 2) return fmi2Discard; /* fmi2LastSuccessfulTime */
    *value = ((instance *)c)->m.time;
    return fmi2OK;
}
ALWAYS(fmi2Discard, GetIntegerStatus, fmi2Component c, fmi2StatusKind kind, fmi2Integer *value)
ALWAYS(fmi2Discard, GetBooleanStatus, fmi2Component c, fmi2StatusKind kind, fmi2Boolean *value)
ALWAYS(fmi2Discard, GetStringStatus, fmi2Component c, fmi2StatusKind kind, fmi2String *value)
