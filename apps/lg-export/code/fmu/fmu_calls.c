/* Functions that FMI 2.0 and 3.0 share. fmi2.c and fmi3.c define the status (FMU_OK, FMU_ERROR), the types
 * and the names that differ; FMI(name, ...) begins the function `name` of their version. */

FMI(SetDebugLogging, void *c, fmuBoolean on, size_t n, const char *const names[]) {
    ALLOW(ANY);
    return FMU_OK;
}
FMI(Reset, void *c) {
    ALLOW(ANY);
    reset((instance *)c);
    return FMU_OK;
}

MODE(ExitInitializationMode, INITIALIZATION, RUNNING)
MODE(EnterEventMode, EVENT | CONTINUOUS, EVENT)
MODE(EnterContinuousTimeMode, EVENT, CONTINUOUS)
MODE(Terminate, RUNNING, TERMINATED)

/* ---- values and derivatives ---- */

FMI(SET_VALUES, void *c, const unsigned int vr[], size_t n, const double value[] COUNT(count)) {
    instance *i = (instance *)c;
    ALLOW(INSTANTIATED | INITIALIZATION | RUNNING);
    NEED(is_given(n, vr, value) && fits(vr, n, 1, COUNT_OF(count, n)));
    scatter(vr, n, value, i->m.values);
    i->stale = 1;
    return FMU_OK;
}
FMI(GetDirectionalDerivative, void *c, const unsigned int unknown[], size_t unknowns,
    const unsigned int known[], size_t knowns, const double seed[] COUNT(seeds),
    double sensitivity[] COUNT(sensitivities)) {
    instance *i = (instance *)c;
    ALLOW(EVALUATED);
    NEED(is_given(knowns, known, seed) && is_given(unknowns, unknown, sensitivity));
    NEED(fits(known, knowns, 1, COUNT_OF(seeds, knowns)) &&
         fits(unknown, unknowns, 0, COUNT_OF(sensitivities, unknowns)));
    memset(i->seeds, 0, sizeof i->seeds);
    scatter(known, knowns, seed, i->seeds);
    if (!forward(i->m.values, i->seeds, i->results, i->work)) return FMU_ERROR;
    gather(unknown, unknowns, i->results, sensitivity);
    return FMU_OK;
}

/* ---- states of the instance ---- */

FMI(GET_STATE, void *c, void **state) {
    ALLOW(ANY);
    NEED(state != NULL);
    if (*state == NULL) *state = malloc(sizeof(memory));
    if (*state == NULL) return FMU_ERROR;
    memcpy(*state, &((instance *)c)->m, sizeof(memory));
    return FMU_OK;
}
FMI(SET_STATE, void *c, void *state) {
    ALLOW(ANY);
    NEED(restore((instance *)c, (const memory *)state));
    return FMU_OK;
}
FMI(FREE_STATE, void *c, void **state) {
    ALLOW(ANY);
    if (state == NULL) return FMU_OK;
    free(*state);
    *state = NULL;
    return FMU_OK;
}
FMI(STATE_SIZE, void *c, void *state, size_t *size) {
    ALLOW(ANY);
    NEED(state != NULL && size != NULL);
    *size = sizeof(image);
    return FMU_OK;
}
FMI(WRITE_STATE, void *c, void *state, fmuByte bytes[], size_t size) {
    ALLOW(ANY);
    NEED(state != NULL && bytes != NULL && size >= sizeof(image));
    write_image((const memory *)state, bytes);
    return FMU_OK;
}
FMI(READ_STATE, void *c, const fmuByte bytes[], size_t size, void **state) {
    memory m;
    ALLOW(ANY);
    NEED(state != NULL && read_image((const instance *)c, bytes, size, &m));
    if (*state == NULL) *state = malloc(sizeof m);
    if (*state == NULL) return FMU_ERROR;
    memcpy(*state, &m, sizeof m);
    return FMU_OK;
}

/* ---- model exchange ---- */

FMI(CompletedIntegratorStep, void *c, fmuBoolean final, fmuBoolean *event, fmuBoolean *terminate) {
    ALLOW(CONTINUOUS);
    NEED(event != NULL && terminate != NULL);
    *event = *terminate = 0;
    return FMU_OK;
}
FMI(SetTime, void *c, double time) {
    ALLOW(EVENT | CONTINUOUS);
    NEED(is_finite(time));
    ((instance *)c)->m.time = time;
    return FMU_OK;
}
FMI(SetContinuousStates, void *c, const double x[], size_t n) {
    ALLOW(CONTINUOUS);
    NEED(n == STATES && is_given(n, x, x));
    memcpy(((instance *)c)->m.values, x, n * sizeof *x);
    ((instance *)c)->stale = 1;
    return FMU_OK;
}
FMI(GetContinuousStates, void *c, double x[], size_t n) {
    ALLOW(EXCHANGED);
    NEED(n == STATES && is_given(n, x, x));
    memcpy(x, ((instance *)c)->m.values, n * sizeof *x);
    return FMU_OK;
}
FMI(GET_DERIVATIVES, void *c, double x[], size_t n) {
    ALLOW(EXCHANGED);
    NEED(n == STATES && is_given(n, x, x));
    refresh((instance *)c);
    memcpy(x, ((instance *)c)->m.values + DERIVATIVE_AT, n * sizeof *x);
    return FMU_OK;
}
FMI(GetEventIndicators, void *c, double x[], size_t n) {
    ALLOW(EXCHANGED);
    return n == 0 ? FMU_OK : FMU_ERROR;
}
FMI(GetNominalsOfContinuousStates, void *c, double x[], size_t n) {
    size_t k;
    ALLOW(INSTANTIATED | EXCHANGED);
    NEED(n == STATES && is_given(n, x, x));
    for (k = 0; k < n; k++) x[k] = 1.0;
    return FMU_OK;
}
