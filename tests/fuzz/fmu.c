/* Harness of an FMU: the fragments of C that lg-export writes into each one, with a small model in place of a
 * program. It is compiled once for each version of the interface (FUZZ_FMI is 2 or 3). The input is a list of
 * calls, in any order. */
#include <string.h>

#include "fuzz.h"

#include "fmu_model.h"

#if FUZZ_FMI == 2
#define NAMED(name) fmi2##name
#else
#define NAMED(name) fmi3##name
#endif
#define CALL(name) NAMED(name)
typedef fmuByte byte;

/* ---- calls ---- */

typedef struct input {
    const uint8_t *at, *end;
} input;

static uint8_t take(input *in) {
    return in->at < in->end ? *in->at++ : 0;
}

static double take_real(input *in) {
    double x = 0;
    if ((size_t)(in->end - in->at) < sizeof x) return 0.25 * take(in);
    memcpy(&x, in->at, sizeof x);
    in->at += sizeof x;
    return x;
}

/* Deserialises a state from bytes of the input. With `repaired`, the bytes get a right checksum. */
static void restore_bytes(void *c, input *in, bool repaired, void **state) {
    image bytes;
    const size_t have = (size_t)(in->end - in->at), size = have < sizeof bytes ? have : sizeof bytes;
    if (!repaired) {
        (void)CALL(READ_STATE)(c, (const byte *)in->at, size, state);
        in->at += size;
        return;
    }
    memset(&bytes, 0, sizeof bytes);
    memcpy(&bytes.m, in->at, have < sizeof bytes.m ? have : sizeof bytes.m);
    in->at += have < sizeof bytes.m ? have : sizeof bytes.m;
    const uint64_t model = sum_of(TOKEN, sizeof TOKEN), sum = sum_of(bytes.m, sizeof bytes.m);
    put_words(bytes.model, &model, sizeof model);
    put_words(bytes.sum, &sum, sizeof sum);
    (void)CALL(READ_STATE)(c, (const byte *)&bytes, sizeof bytes, state);
}

/* A state that was serialised must be restored as the same bytes, or be refused because it is not finite. */
static void there_and_back(void *c, void *state) {
    image bytes, again;
    size_t size = 0;
    void *copy = NULL;
    (void)CALL(STATE_SIZE)(c, state, &size);
    if (size != sizeof bytes || (int)CALL(WRITE_STATE)(c, state, (byte *)&bytes, sizeof bytes) != 0) abort();
    if ((int)CALL(READ_STATE)(c, (const byte *)&bytes, size, &copy) != 0) return;
    (void)CALL(WRITE_STATE)(c, copy, (byte *)&again, sizeof again);
    if (memcmp(&bytes, &again, sizeof bytes) != 0) abort();
    (void)CALL(FREE_STATE)(c, &copy);
}

/* Steps of co-simulation are bounded, so that no input takes a second. */
static void step(void *c, input *in) {
    const double now = take_real(in), length = take_real(in);
    instance *i = c;
    if (i->m.values[STEP_AT] > 0 && length / i->m.values[STEP_AT] > 1000) return;
#if FUZZ_FMI == 2
    (void)fmi2DoStep(c, now, length, 0);
#else
    bool event, terminate, early;
    double last;
    (void)fmi3DoStep(c, now, length, false, &event, &terminate, &early, &last);
#endif
}

/* Reads or writes with up to three references. Some references do not exist. */
static void access(void *c, input *in, uint8_t what) {
    unsigned vr[3], known[3];
    double value[8] = {0}, seed[8];
    const size_t n = take(in) % 4, count = take(in) % 8;
    for (size_t k = 0; k < 3; k++) vr[k] = take(in) % 12, known[k] = take(in) % 12;
    for (size_t k = 0; k < 8; k++) seed[k] = k < n ? take_real(in) : 1;
#if FUZZ_FMI == 2
    (void)count;
    if (what == 0) (void)fmi2GetReal(c, vr, n, value);
    if (what == 1) (void)fmi2SetReal(c, vr, n, seed);
    if (what == 2) (void)fmi2GetDirectionalDerivative(c, vr, n, known, n, seed, value);
#else
    if (what == 0) (void)fmi3GetFloat64(c, vr, n, value, count);
    if (what == 1) (void)fmi3SetFloat64(c, vr, n, seed, count);
    if (what == 2) (void)fmi3GetDirectionalDerivative(c, vr, n, known, n, seed, count, value, count);
    if (what == 3) (void)fmi3GetAdjointDerivative(c, vr, n, known, n, seed, count, value, count);
#endif
}

static void exchange(void *c, input *in) {
    double x[STATES] = {take_real(in), take_real(in)}, d[STATES];
    (void)CALL(SetTime)(c, take_real(in));
    (void)CALL(SetContinuousStates)(c, x, STATES);
#if FUZZ_FMI == 2
    (void)fmi2GetDerivatives(c, d, STATES);
#else
    (void)fmi3GetContinuousStateDerivatives(c, d, STATES);
#endif
    (void)CALL(GetContinuousStates)(c, x, STATES);
    (void)CALL(GetNominalsOfContinuousStates)(c, d, STATES);
}

#if FUZZ_FMI == 2
static void log_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                        fmi2String category, fmi2String message, ...) {
    (void)environment, (void)name, (void)status, (void)category;
    if (message == NULL || message[0] == '\0') abort();
}
static void *begin(bool exchanged) {
    static const fmi2CallbackFunctions callbacks = {.logger = log_message};
    return fmi2Instantiate("fuzz", exchanged ? fmi2ModelExchange : fmi2CoSimulation, TOKEN, "", &callbacks, 0,
                           0);
}
#else
static void log_message(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                        fmi3String message) {
    (void)environment, (void)status, (void)category;
    if (message == NULL || message[0] == '\0') abort();
}
static void *begin(bool exchanged) {
    if (exchanged) return fmi3InstantiateModelExchange("fuzz", TOKEN, "", false, false, NULL, log_message);
    return fmi3InstantiateCoSimulation("fuzz", TOKEN, "", false, false, false, false, NULL, 0, NULL,
                                       log_message, NULL);
}
#endif

enum { ENTER, EXIT, EVENTS, CONTINUES, TERMINATES, MODES };

static void change_mode(void *c, uint8_t to) {
#if FUZZ_FMI == 2
    if (to == ENTER) (void)fmi2EnterInitializationMode(c);
#else
    if (to == ENTER) (void)fmi3EnterInitializationMode(c, false, 0, 0, false, 0);
#endif
    if (to == EXIT) (void)CALL(ExitInitializationMode)(c);
    if (to == EVENTS) (void)CALL(EnterEventMode)(c);
    if (to == CONTINUES) (void)CALL(EnterContinuousTimeMode)(c);
    if (to == TERMINATES) (void)CALL(Terminate)(c);
}

#if FUZZ_FMI == 2
#define fuzz_fmu fuzz_fmu2
#else
#define fuzz_fmu fuzz_fmu3
#endif

void fuzz_fmu(const uint8_t *data, size_t size) {
    enum { SLOTS = 2 };
    input in = {data, data + size};
    /* The first byte chooses model exchange or co-simulation, and whether the instance is initialised. */
    const uint8_t how = take(&in);
    void *c = begin((how & 1) != 0), *slot[SLOTS] = {NULL, NULL};
    if (c == NULL) abort();
    for (uint8_t to = ENTER; (how & 2) != 0 && to <= ((how & 1) != 0 ? CONTINUES : EXIT); to++)
        if (to != EVENTS) change_mode(c, to);
    while (in.at < in.end) {
        const uint8_t call = take(&in);
        void **state = &slot[call >> 7];
        switch (call % 16) {
        case 0:
            (void)CALL(GET_STATE)(c, state);
            break;
        case 1:
            if (*state != NULL) (void)CALL(SET_STATE)(c, *state);
            break;
        case 2:
            (void)CALL(FREE_STATE)(c, state);
            break;
        case 3:
            restore_bytes(c, &in, false, state);
            break;
        case 4:
        case 5:
            restore_bytes(c, &in, true, state);
            break;
        case 6:
            if (*state != NULL) there_and_back(c, *state);
            break;
        case 7:
            (void)CALL(Reset)(c);
            break;
        case 8:
        case 9:
            step(c, &in);
            break;
        case 10:
            exchange(c, &in);
            break;
        case 11:
            change_mode(c, take(&in) % MODES);
            break;
        default:
            access(c, &in, call % 4);
        }
    }
    for (int i = 0; i < SLOTS; i++) (void)CALL(FREE_STATE)(c, &slot[i]);
    CALL(FreeInstance)(c);
}
