/* An instance, whatever the version of the interface. All variables lie in one array: PORTS ports, one behind
 * the other, of which the first is the state and the second its derivative where STATES > 0. */

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif

enum { DERIVATIVE_AT = STATES, STEP_AT = NUMBERS - 1 };

typedef struct memory {
    double time, values[NUMBERS];
} memory;

typedef struct instance {
    memory m;
    int stale; /* derivatives and outputs do not belong to the other values yet */
    void *environment, *logger;
    double seeds[NUMBERS], results[NUMBERS], room[NUMBERS], work[WORK];
} instance;

static void reset(instance *i) {
    memset(&i->m, 0, sizeof i->m);
    memcpy(i->m.values, start_values, sizeof start_values);
    i->stale = 1;
}

static instance *create(void *environment, void *logger) {
    instance *i = (instance *)calloc(1, sizeof *i);
    if (i == NULL) return NULL;
    i->environment = environment;
    i->logger = logger;
    reset(i);
    return i;
}

/* Brings derivatives and outputs up to date. */
static void refresh(instance *i) {
    if (i->stale) evaluate(i->m.values, i->m.values, i->work);
    i->stale = 0;
}

/* Number k of the array may be set: states, inputs and parameters. */
static int is_known(int k) {
    int p = 0;
    while (p + 1 < PORTS && ports[p + 1].at <= k) p++;
    return ports[p].causality == CAUSALITY_STATE || ports[p].causality == CAUSALITY_INPUT ||
           ports[p].causality == CAUSALITY_PARAMETER;
}

/* A step of co-simulation goes forward. */
static int is_step(double length) {
    return length > 0 && length <= DBL_MAX;
}

#if HAS_STATES
/* From `time` by `length`: equal steps no longer than the parameter. 0: a number became not finite. */
static int advance(instance *i, double length) {
    const double longest = i->m.values[STEP_AT];
    const double wanted = longest > 0 ? ceil(length / longest - 1e-9) : 1;
    const long count = wanted < 1 ? 1 : wanted > 1e9 ? 1000000000L : (long)wanted;
    const double start = i->m.time;
    long n;
    int k;
    for (n = 0; n < count; n++) {
        take_step(i->m.values, length / (double)count, i->room, i->work);
        memcpy(i->m.values, i->room, STATES * sizeof(double));
    }
    i->m.time = start + length;
    i->stale = 1;
    for (k = 0; k < STATES; k++)
        if (!(fabs(i->m.values[k]) <= DBL_MAX)) return 0;
    return 1;
}
#else
static int advance(instance *i, double length) {
    i->m.time += length;
    return 1;
}
#endif
