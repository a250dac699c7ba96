/* Every function of an FMU 3.0 in every mode, with missing pointers and with values that do not fit.
 * ctest-labels: apps/lg-export */
#define FUZZ_FMI 3
#include "fuzz/fmu_model.h"

enum { OK = fmi3OK, ERROR = fmi3Error };
static void count_message(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                          fmi3String message);
#define log_call ((void (*)(void))count_message)
#include "apps/fmi_calls.h"

static void count_message(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                          fmi3String message) {
    (void)environment, (void)category;
    messages += status == fmi3Error && message != NULL;
}

static double x[NUMBERS + 1] = {0.5, 0.25};
static const double not_a_number = (double)NAN, infinite = (double)INFINITY;
static const unsigned vr[] = {0, 4}, absent = PORTS + 1, output = 3;
static const char *text = "";
static void *kept; /* a state, or NULL */
static memory some = {.mode = INSTANTIATED};
static image bytes;
static size_t size;
/* Frees the kept state. Returns its place. */
static void **no_state(void) {
    free(kept);
    kept = NULL;
    return &kept;
}
static bool flags[5];

TEST("an FMU 3.0 is made only for its token, and not for scheduled execution") {
    assert_string_equal(fmi3GetVersion(), "3.0");
    for (int told = 0; told < 2; told++)
        for (int kind = 0; kind < 2; kind++) {
            const fmi3LogMessageCallback log = told ? count_message : NULL;
            const char *const tokens[] = {TOKEN, "other", NULL};
            messages = 0;
            for (size_t i = 0; i < LG_COUNT(tokens); i++) {
                fmi3Instance c = kind == 0 ? fmi3InstantiateModelExchange("a", tokens[i], "", 0, 0, NULL, log)
                                           : fmi3InstantiateCoSimulation("a", tokens[i], "", 0, 0, 0, 0, NULL,
                                                                         0, NULL, log, NULL);
                assert_int_equal(c != NULL, i == 0);
                if (c != NULL) fmi3FreeInstance(c);
            }
            assert_int_equal(messages, told ? 2 : 0);
            assert_null(fmi3InstantiateScheduledExecution("a", TOKEN, "", 0, 0, NULL, log, NULL, NULL, NULL));
        }
}

TEST("modes of an FMU 3.0") {
    ALLOWED(ALL, 1, 0, fmi3SetDebugLogging(c, 1, 0, P(0, &text)));
    ALLOWED(NEW, 0, 0, fmi3EnterInitializationMode(c, 0, 0, 1.5, 0, 0));
    REFUSED(fmi3EnterInitializationMode(c, 0, 0, not_a_number, 0, 0));
    ALLOWED(INITIALIZING, 0, 0, fmi3ExitInitializationMode(c));
    ALLOWED(RUNS, 0, 0, fmi3Terminate(c));
    ALLOWED(ALL, 0, 0, fmi3Reset(c));
    ALLOWED(MOVES, 0, 0, fmi3EnterEventMode(c));
    ALLOWED(AT_EVENT, 0, 0, fmi3EnterContinuousTimeMode(c));
    REFUSED(fmi3EnterConfigurationMode(c));
    REFUSED(fmi3ExitConfigurationMode(c));
    REFUSED(fmi3EnterStepMode(c));
#define EVALUATING "IE", "I"
    ALLOWED(EVALUATING, 0, 0, fmi3EvaluateDiscreteStates(c));
    ALLOWED(AT_EVENT, 5, 31,
            fmi3UpdateDiscreteStates(c, P(0, flags), P(1, flags + 1), P(2, flags + 2), P(3, flags + 3),
                                     P(4, flags + 4), x));
    ALLOWED(MOVING, 2, 3, fmi3CompletedIntegratorStep(c, 1, P(0, flags), P(1, flags + 1)));
    ALLOWED(MOVES, 0, 0, fmi3SetTime(c, 2.0));
    REFUSED(fmi3SetTime(c, infinite));
}

/* A type of which there are no variables. */
#define NONE(name, type)                                                                                     \
    do {                                                                                                     \
        type v[1] = {0};                                                                                     \
        ALLOWED(ALL, 2, 0, fmi3Get##name(c, P(0, vr), 0, P(1, v), 0));                                       \
        ALLOWED(ALL, 2, 0, fmi3Set##name(c, P(0, vr), 0, P(1, v), 0));                                       \
        REFUSED(fmi3Get##name(c, vr, 1, v, 1));                                                              \
        REFUSED(fmi3Set##name(c, vr, 1, v, 1));                                                              \
    } while (0)

TEST("numbers of several ports are set, read and differentiated in one call") {
    const fmi3ValueReference given_of[] = {0, 2}, results_of[] = {1, 3};
    const double numbers[3] = {3, 5, 7}, seeds[3] = {1, 10, 100}, slopes[3] = {10, 96, 35};
    double got[3];
    fmi3Instance own = fmi3InstantiateModelExchange("m", TOKEN, NULL, false, false, NULL, NULL);
    assert_int_equal(fmi3SetFloat64(own, given_of, 2, numbers, 3), fmi3OK);
    assert_int_equal(fmi3EnterInitializationMode(own, false, 0, 0, false, 0), fmi3OK);
    assert_int_equal(fmi3GetFloat64(own, given_of, 2, got, 3), fmi3OK);
    assert_memory_equal(got, numbers, sizeof got);
    assert_int_equal(fmi3GetDirectionalDerivative(own, results_of, 2, given_of, 2, seeds, 3, got, 3), fmi3OK);
    assert_memory_equal(got, slopes, sizeof got);
    fmi3FreeInstance(own);
}

TEST("values of an FMU 3.0") {
    const fmi3Byte *binary = NULL;
    ALLOWED(READING, 2, 3, fmi3GetFloat64(c, P(0, vr), 2, P(1, x), 3));
    ALLOWED(READING, 2, 0, fmi3GetFloat64(c, P(0, vr), 0, P(1, x), 0));
    REFUSED(fmi3GetFloat64(c, &absent, 1, x, 1));
    REFUSED(fmi3GetFloat64(c, vr, 2, x, 2));
    REFUSED(fmi3GetFloat64(c, vr, 2, x, 4));
    ALLOWED(SETTING, 2, 3, fmi3SetFloat64(c, P(0, vr), 2, P(1, x), 3));
    REFUSED(fmi3SetFloat64(c, &absent, 1, x, 1));
    REFUSED(fmi3SetFloat64(c, &output, 1, x, 1));
    REFUSED(fmi3SetFloat64(c, vr, 1, x, 1));
    REFUSED(fmi3SetFloat64(c, vr, 1, x, 3));
    NONE(Float32, float);
    NONE(Int8, int8_t);
    NONE(UInt8, uint8_t);
    NONE(Int16, int16_t);
    NONE(UInt16, uint16_t);
    NONE(Int32, int32_t);
    NONE(UInt32, uint32_t);
    NONE(Int64, int64_t);
    NONE(UInt64, uint64_t);
    NONE(Boolean, bool);
    NONE(String, fmi3String);
    for (size_t n = 0; n < 2; n++) {
        const int answer = n == 0 ? OK : ERROR;
        ANSWERED(answer, fmi3GetBinary(c, vr, n, &size, &binary, n));
        ANSWERED(answer, fmi3SetBinary(c, vr, n, &size, &binary, n));
        ANSWERED(answer, fmi3GetClock(c, vr, n, flags));
        ANSWERED(answer, fmi3SetClock(c, vr, n, flags));
    }
}

TEST("derivatives and numbers of an FMU 3.0") {
    const unsigned state = 0;
    ALLOWED(READING, 4, 15,
            fmi3GetDirectionalDerivative(c, P(0, &output), 1, P(1, vr), 2, P(2, x), 3, P(3, x), 1));
    ALLOWED(READING, 4, 15,
            fmi3GetAdjointDerivative(c, P(0, &output), 1, P(1, vr), 2, P(2, x), 1, P(3, x), 3));
    REFUSED(fmi3GetDirectionalDerivative(c, &absent, 1, vr, 2, x, 3, x, 1));
    REFUSED(fmi3GetDirectionalDerivative(c, &output, 1, &absent, 1, x, 1, x, 1));
    REFUSED(fmi3GetDirectionalDerivative(c, &output, 1, &output, 1, x, 1, x, 1));
    REFUSED(fmi3GetAdjointDerivative(c, &absent, 1, vr, 2, x, 1, x, 3));
    REFUSED(fmi3GetAdjointDerivative(c, &output, 1, &output, 1, x, 1, x, 1));
    for (size_t wrong = 1; wrong < 4; wrong++) {
        REFUSED(fmi3GetDirectionalDerivative(c, &output, 1, &state, 1, x, wrong == 2 ? 3 : wrong, x, 1));
        REFUSED(fmi3GetDirectionalDerivative(c, &state, 1, vr, 2, x, 3, x, wrong == 2 ? 0 : wrong));
        REFUSED(fmi3GetAdjointDerivative(c, &state, 1, vr, 2, x, wrong == 2 ? 0 : wrong, x, 3));
        REFUSED(fmi3GetAdjointDerivative(c, &output, 1, &state, 1, x, 1, x, wrong == 2 ? 0 : wrong));
    }
    ALLOWED(MOVING, 1, 1, fmi3SetContinuousStates(c, P(0, x), STATES));
    REFUSED(fmi3SetContinuousStates(c, x, STATES + 1));
    ALLOWED(EXCHANGE, 1, 1, fmi3GetContinuousStates(c, P(0, x), STATES));
    REFUSED(fmi3GetContinuousStates(c, x, STATES - 1));
    ALLOWED(EXCHANGE, 1, 1, fmi3GetContinuousStateDerivatives(c, P(0, x), STATES));
    REFUSED(fmi3GetContinuousStateDerivatives(c, x, STATES + 1));
    ALLOWED(EXCHANGE, 1, 0, fmi3GetEventIndicators(c, P(0, x), 0));
    REFUSED(fmi3GetEventIndicators(c, x, 1));
    ALLOWED(NEW_OR_CHANGED, 1, 1, fmi3GetNominalsOfContinuousStates(c, P(0, x), STATES));
    REFUSED(fmi3GetNominalsOfContinuousStates(c, x, STATES + 1));
    ALLOWED(ALL, 1, 1, fmi3GetNumberOfEventIndicators(c, P(0, &size)));
    ALLOWED(ALL, 1, 1, fmi3GetNumberOfContinuousStates(c, P(0, &size)));
    assert_int_equal(size, STATES);
}

TEST("states of an FMU 3.0 that are kept") {
    fmi3Byte *const at = (fmi3Byte *)&bytes;
    ALLOWED(ALL, 1, 1, fmi3GetFMUState(c, P(0, no_state())));
    ALLOWED(ALL, 0, 0, fmi3GetFMUState(c, kept != NULL ? &kept : no_state()));
    ALLOWED(ALL, 1, 1, fmi3SetFMUState(c, P(0, &some)));
    ALLOWED(ALL, 2, 3, fmi3SerializedFMUStateSize(c, P(0, &some), P(1, &size)));
    assert_int_equal(size, sizeof bytes);
    ALLOWED(ALL, 2, 3, fmi3SerializeFMUState(c, P(0, &some), P(1, at), sizeof bytes));
    REFUSED(fmi3SerializeFMUState(c, &some, at, 8));
    ALLOWED(ALL, 2, 3, fmi3DeserializeFMUState(c, P(0, at), sizeof bytes, P(1, no_state())));
    ALLOWED(ALL, 0, 0, fmi3DeserializeFMUState(c, at, sizeof bytes, &kept));
    REFUSED(fmi3DeserializeFMUState(c, at, 8, &kept));
    ALLOWED(ALL, 1, 0, fmi3FreeFMUState(c, P(0, &kept)));
    (void)no_state();
}

TEST("steps and clocks of an FMU 3.0") {
    fmi3IntervalQualifier qualifier;
    fmi3DependencyKind kind;
    uint64_t counter;
    unsigned of;
    int32_t order = 1;
    ALLOWED(STEPPING, 4, 15,
            fmi3DoStep(c, 0.0, 0.5, 1, P(0, flags), P(1, flags + 1), P(2, flags + 2), P(3, x)));
    REFUSED(fmi3DoStep(c, not_a_number, 0.5, 1, flags, flags, flags, x));
    REFUSED(fmi3DoStep(c, 0.0, 0.0, 1, flags, flags, flags, x));
    REFUSED(fmi3DoStep(c, 0.0, infinite, 1, flags, flags, flags, x));
    REFUSED(fmi3DoStep(c, DBL_MAX, DBL_MAX, 1, flags, flags, flags, x));
    REFUSED(fmi3GetOutputDerivatives(c, vr, 1, &order, x, 1));
    REFUSED(fmi3GetNumberOfVariableDependencies(c, 0, &size));
    REFUSED(fmi3GetVariableDependencies(c, 0, &size, &of, &size, &kind, 1));
    REFUSED(fmi3GetIntervalDecimal(c, vr, 1, x, &qualifier));
    REFUSED(fmi3GetIntervalFraction(c, vr, 1, &counter, &counter, &qualifier));
    REFUSED(fmi3GetShiftDecimal(c, vr, 1, x));
    REFUSED(fmi3GetShiftFraction(c, vr, 1, &counter, &counter));
    REFUSED(fmi3SetIntervalDecimal(c, vr, 1, x));
    REFUSED(fmi3SetIntervalFraction(c, vr, 1, &counter, &counter));
    REFUSED(fmi3SetShiftDecimal(c, vr, 1, x));
    REFUSED(fmi3SetShiftFraction(c, vr, 1, &counter, &counter));
    REFUSED(fmi3ActivateModelPartition(c, 0, 1.0));
}
