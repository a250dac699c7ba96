/* An instance, whatever the version of the interface. All variables lie in one array: PORTS ports, one behind
 * the other, of which the first is the state and the second its derivative where STATES > 0. */

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif
#if defined(__GNUC__) /* the interface gives more arguments than a model needs */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

/* Begins a function of the interface: its prototype, then its definition. */
#define EXPORT(...)                                                                                          \
    EXPORTED __VA_ARGS__;                                                                                    \
    EXPORTED __VA_ARGS__

enum { DERIVATIVE_AT = STATES, STEP_AT = NUMBERS - 1 };

/* Modes, one at a time (FMI 2.0.4, 3.2.3 and 4.2.4; FMI 3.0.2, 2.3.1). Only an instance for model exchange
 * has the modes EVENT and CONTINUOUS, only one for co-simulation has STEP. */
enum {
    INSTANTIATED = 1,
    INITIALIZATION = 2,
    EVENT = 4,
    CONTINUOUS = 8,
    STEP = 16,
    TERMINATED = 32,
    RUNNING = EVENT | CONTINUOUS | STEP,
    EVALUATED = INITIALIZATION | RUNNING | TERMINATED, /* results can be read */
    ANY = INSTANTIATED | EVALUATED,
    NEVER = 0,
    EXCHANGED = EVALUATED | 64 /* in model exchange only */
};

typedef struct memory {
    uint64_t mode;
    double time, values[NUMBERS];
} memory;

typedef struct instance {
    memory m;
    int exchange; /* for model exchange, not for co-simulation */
    int stale;    /* derivatives and outputs do not belong to the other values yet */
    void *environment;
    void (*logger)(void); /* of the version's type; NULL: none */
    double seeds[NUMBERS], results[NUMBERS], room[NUMBERS], work[WORK];
} instance;

static void reset(instance *i) {
    memset(&i->m, 0, sizeof i->m);
    memcpy(i->m.values, start_values, sizeof start_values);
    i->m.mode = INSTANTIATED;
    i->stale = 1;
}

static instance *create(int exchange, void *environment, void (*logger)(void)) {
    instance *i = (instance *)calloc(1, sizeof *i);
    if (i == NULL) return NULL;
    i->exchange = exchange;
    i->environment = environment;
    i->logger = logger;
    reset(i);
    return i;
}

/* Whether the mode of the instance is in the set `modes`. If the set contains EXCHANGED, only an instance for
 * model exchange may call the function. */
static int allowed(const instance *i, uint64_t modes) {
    if (i == NULL || (!i->exchange && (modes & EXCHANGED) == EXCHANGED)) return 0;
    return (i->m.mode & modes) != 0;
}

/* Changes the mode to `to`. Returns 0, and changes nothing, if the instance is in no mode of the set `from`.
 * If `to` is RUNNING, the new mode is the first mode after the initialization. */
static int take_mode(instance *i, uint64_t from, uint64_t to) {
    if (!allowed(i, from)) return 0;
    i->m.mode = to != RUNNING ? to : i->exchange ? EVENT : STEP;
    return 1;
}

static const char misplaced[] = "the instance's mode does not allow this call",
                  unfitting[] = "the arguments are not references and numbers of variables of this use";

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

static int is_finite(double x) {
    return fabs(x) <= DBL_MAX;
}

/* Whether both arrays are there. An array of 0 elements may be NULL. */
static int is_given(size_t n, const void *a, const void *b) {
    return n == 0 || (a != NULL && b != NULL);
}

/* The count of the numbers of reference `vr`, and their place in the array; 0: there is no such variable.
 * Each version defines it. */
static int span(unsigned int vr, int *at);

/* Whether the references have `count` numbers in all. With `known`, all must be states, inputs or
 * parameters. */
static int fits(const unsigned int vr[], size_t n, int known, size_t count) {
    size_t k, sum = 0;
    for (k = 0; k < n; k++) {
        int at = 0;
        const int size = span(vr[k], &at);
        if (size == 0 || (known && !is_known(at))) return 0;
        sum += (size_t)size;
    }
    return sum == count;
}

/* Copies numbers to the places of the references in `array`, or from these places. */
static void scatter(const unsigned int vr[], size_t n, const double *from, double *array) {
    size_t k;
    for (k = 0; k < n; k++) {
        int at = 0;
        const int size = span(vr[k], &at);
        memcpy(array + at, from, (size_t)size * sizeof *array);
        from += size;
    }
}
static void gather(const unsigned int vr[], size_t n, const double *array, double *to) {
    size_t k;
    for (k = 0; k < n; k++) {
        int at = 0;
        const int size = span(vr[k], &at);
        memcpy(to, array + at, (size_t)size * sizeof *to);
        to += size;
    }
}

/* ---- the memory as bytes ---- */

/* Whether `mode` is a single mode, and one that the instance can have. */
static int is_mode(const instance *i, uint64_t mode) {
    const uint64_t others = i->exchange ? STEP : EVENT | CONTINUOUS;
    return mode != 0 && (mode & (mode - 1)) == 0 && mode <= TERMINATED && (mode & others) == 0;
}

/* Copies the kept memory into the instance. Returns 0 if an instance of the other interface kept the
 * memory. */
static int restore(instance *i, const memory *m) {
    if (m == NULL || !is_mode(i, m->mode)) return 0;
    memcpy(&i->m, m, sizeof *m);
    i->stale = 1;
    return 1;
}

/* The memory as bytes, which a process of another machine can read, too: a hash of the model's token, a
 * checksum of the memory (FNV-1a), and the memory. Each is a list of words of 8 bytes, the lowest byte
 * first. */
typedef struct image {
    unsigned char model[8], sum[8], m[sizeof(memory)];
} image;

static void put_words(unsigned char *to, const void *from, size_t bytes) {
    size_t i;
    uint64_t word = 0;
    for (i = 0; i < bytes; i++, word >>= 8) {
        if (i % 8 == 0) memcpy(&word, (const unsigned char *)from + i, 8);
        to[i] = (unsigned char)(word & 255);
    }
}

static void get_words(void *to, const unsigned char *from, size_t bytes) {
    size_t i;
    uint64_t word = 0;
    for (i = bytes; i-- > 0;) {
        word = word << 8 | from[i];
        if (i % 8 == 0) memcpy((unsigned char *)to + i, &word, 8);
    }
}

static uint64_t sum_of(const void *bytes, size_t size) {
    const unsigned char *at = (const unsigned char *)bytes;
    uint64_t sum = 14695981039346656037u;
    for (; size > 0; size--) sum = (sum ^ *at++) * 1099511628211u;
    return sum;
}

static void write_image(const memory *m, void *bytes) {
    image out;
    uint64_t sum = sum_of(TOKEN, sizeof TOKEN);
    put_words(out.model, &sum, sizeof sum);
    put_words(out.m, m, sizeof *m);
    sum = sum_of(out.m, sizeof out.m);
    put_words(out.sum, &sum, sizeof sum);
    memcpy(bytes, &out, sizeof out);
}

/* Returns 0 if write_image of this model did not write the bytes, if the instance cannot have the mode, or if
 * the time, a state, an input or a parameter is not finite. */
static int read_image(const instance *i, const void *bytes, size_t size, memory *m) {
    image in;
    memory found;
    uint64_t model, sum;
    int k;
    if (bytes == NULL || size != sizeof in) return 0;
    memcpy(&in, bytes, sizeof in);
    get_words(&model, in.model, sizeof model);
    get_words(&sum, in.sum, sizeof sum);
    if (model != sum_of(TOKEN, sizeof TOKEN) || sum != sum_of(in.m, sizeof in.m)) return 0;
    get_words(&found, in.m, sizeof found);
    if (!is_mode(i, found.mode) || !is_finite(found.time)) return 0;
    for (k = 0; k < NUMBERS; k++)
        if (is_known(k) && !is_finite(found.values[k])) return 0;
    *m = found;
    return 1;
}

/* ---- steps of co-simulation ---- */

/* From `time` by `length`: equal steps no longer than the parameter. NULL, or why not: nothing has moved. */
#if HAS_STATES
static const char *advance(instance *i, double length) {
    static const double MOST = 1e9;
    const double longest = i->m.values[STEP_AT];
    const double wanted = longest > 0 ? ceil(length / longest - 1e-9) : 1;
    double *before = i->results;
    long n, count;
    int k;
    if (!(longest >= 0)) return "the longest step is negative or not a number";
    if (wanted > MOST)
        return "the step takes more than 1e9 steps of the longest length: raise this parameter";
    count = wanted < 1 ? 1 : (long)wanted;
    memcpy(before, i->m.values, STATES * sizeof(double));
    for (n = 0; n < count; n++) {
        take_step(i->m.values, length / (double)count, i->room, i->work);
        memcpy(i->m.values, i->room, STATES * sizeof(double));
        for (k = 0; k < STATES; k++)
            if (!is_finite(i->room[k])) {
                memcpy(i->m.values, before, STATES * sizeof(double));
                return "a state has become not finite";
            }
    }
    i->m.time += length;
    i->stale = 1;
    return NULL;
}
#else
static const char *advance(instance *i, double length) {
    i->m.time += length;
    return NULL;
}
#endif

/* ---- for the functions of both versions ---- */

/* Ends a function that the instance's mode does not allow, or that has wrong arguments. */
#define ALLOW(modes)                                                                                         \
    do {                                                                                                     \
        if (!allowed((instance *)c, modes)) return refuse(c, misplaced);                                     \
    } while (0)
#define NEED(fits)                                                                                           \
    do {                                                                                                     \
        if (!(fits)) return refuse(c, unfitting);                                                            \
    } while (0)
#define MODE(name, from, to)                                                                                 \
    FMI(name, void *c) {                                                                                     \
        return take_mode((instance *)c, from, to) ? FMU_OK : refuse(c, misplaced);                           \
    }
/* A function that returns `status`, whatever its arguments are. */
#define ALWAYS(status, name, ...)                                                                            \
    FMI(name, __VA_ARGS__) {                                                                                 \
        return status;                                                                                       \
    }
/* A function of n values of a kind that no variable has. */
#define EMPTY(name, ...)                                                                                     \
    FMI(name, __VA_ARGS__) {                                                                                 \
        return n == 0 ? FMU_OK : FMU_ERROR;                                                                  \
    }
/* There are no variables of this type. */
#define UNUSED_TYPE(name, type)                                                                              \
    FMI(Get##name, void *c, const unsigned int vr[], size_t n, type v[] COUNT(count)) {                      \
        return c != NULL && n == 0 ? FMU_OK : FMU_ERROR;                                                     \
    }                                                                                                        \
    FMI(Set##name, void *c, const unsigned int vr[], size_t n, const type v[] COUNT(count)) {                \
        return c != NULL && n == 0 ? FMU_OK : FMU_ERROR;                                                     \
    }
