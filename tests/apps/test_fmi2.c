/* Every function of an FMU 2.0 in every mode, with missing pointers and with values that do not fit.
 * ctest-labels: apps/lg-export */
#define FUZZ_FMI 2
#include "fuzz/fmu_model.h"

enum { OK = fmi2OK, ERROR = fmi2Error, DISCARD = fmi2Discard };
static void count_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                          fmi2String category, fmi2String message, ...);
#define log_call ((void (*)(void))count_message)
#include "apps/fmi_calls.h"

static void count_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                          fmi2String category, fmi2String message, ...) {
    (void)environment, (void)name, (void)category;
    messages += status == fmi2Error && message != NULL;
}

static double x[NUMBERS + 1] = {0.5, 0.25};
static const double not_a_number = (double)NAN, infinite = (double)INFINITY;
static const unsigned vr[] = {0, 4}, absent = NUMBERS, output = 5;
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
static int whole;

TEST("an FMU 2.0 is made only for its guid and a known kind") {
    const fmi2CallbackFunctions callbacks = {.logger = count_message}, silent = {0};
    const fmi2CallbackFunctions *const all[] = {NULL, &silent, &callbacks};
    assert_string_equal(fmi2GetVersion(), "2.0");
    assert_string_equal(fmi2GetTypesPlatform(), "default");
    for (size_t i = 0; i < LG_COUNT(all); i++) {
        messages = 0;
        for (int type = 0; type < 2; type++) {
            fmi2Component c = fmi2Instantiate("a", (fmi2Type)type, TOKEN, "", all[i], 0, 0);
            assert_non_null(c);
            assert_int_equal(fmi2DoStep(c, 0, 1, 1), ERROR);
            fmi2FreeInstance(c);
            assert_null(fmi2Instantiate("a", (fmi2Type)type, type == 0 ? NULL : "other", "", all[i], 0, 0));
        }
        assert_int_equal(messages, all[i] == &callbacks ? 4 : 0);
        assert_null(fmi2Instantiate("a", (fmi2Type)2, TOKEN, "", all[i], 0, 0));
    }
}

TEST("modes of an FMU 2.0") {
    fmi2EventInfo info;
    int flags[2];
    ALLOWED(ALL, 1, 0, fmi2SetDebugLogging(c, 1, 0, P(0, &text)));
    ALLOWED(NEW, 0, 0, fmi2SetupExperiment(c, 0, 0, 1.5, 0, 0));
    REFUSED(fmi2SetupExperiment(c, 0, 0, not_a_number, 0, 0));
    ALLOWED(NEW, 0, 0, fmi2EnterInitializationMode(c));
    ALLOWED(INITIALIZING, 0, 0, fmi2ExitInitializationMode(c));
    ALLOWED(RUNS, 0, 0, fmi2Terminate(c));
    ALLOWED(ALL, 0, 0, fmi2Reset(c));
    ALLOWED(MOVES, 0, 0, fmi2EnterEventMode(c));
    ALLOWED(AT_EVENT, 0, 0, fmi2EnterContinuousTimeMode(c));
    ALLOWED(AT_EVENT, 1, 1, fmi2NewDiscreteStates(c, P(0, &info)));
    ALLOWED(MOVING, 2, 3, fmi2CompletedIntegratorStep(c, 1, P(0, flags), P(1, flags + 1)));
    ALLOWED(MOVES, 0, 0, fmi2SetTime(c, 2.0));
    REFUSED(fmi2SetTime(c, infinite));
}

/* A type of which there are no variables. */
#define NONE(name, v)                                                                                        \
    ALLOWED(ALL, 2, 0, fmi2Get##name(c, P(0, vr), 0, P(1, v)));                                              \
    ALLOWED(ALL, 2, 0, fmi2Set##name(c, P(0, vr), 0, P(1, v)));                                              \
    REFUSED(fmi2Get##name(c, vr, 1, v));                                                                     \
    REFUSED(fmi2Set##name(c, vr, 1, v));

TEST("values and derivatives of an FMU 2.0") {
    ALLOWED(READING, 2, 3, fmi2GetReal(c, P(0, vr), 2, P(1, x)));
    ALLOWED(READING, 2, 0, fmi2GetReal(c, P(0, vr), 0, P(1, x)));
    REFUSED(fmi2GetReal(c, &absent, 1, x));
    ALLOWED(SETTING, 2, 3, fmi2SetReal(c, P(0, vr), 2, P(1, x)));
    REFUSED(fmi2SetReal(c, &absent, 1, x));
    REFUSED(fmi2SetReal(c, &output, 1, x));
    NONE(Integer, &whole);
    NONE(Boolean, &whole);
    NONE(String, &text);
    ALLOWED(READING, 4, 15, fmi2GetDirectionalDerivative(c, P(0, vr), 2, P(1, vr), 2, P(2, x), P(3, x)));
    REFUSED(fmi2GetDirectionalDerivative(c, &absent, 1, vr, 1, x, x));
    REFUSED(fmi2GetDirectionalDerivative(c, vr, 1, &absent, 1, x, x));
    REFUSED(fmi2GetDirectionalDerivative(c, vr, 1, &output, 1, x, x));
    ALLOWED(MOVING, 1, 1, fmi2SetContinuousStates(c, P(0, x), STATES));
    REFUSED(fmi2SetContinuousStates(c, x, STATES + 1));
    ALLOWED(EXCHANGE, 1, 1, fmi2GetContinuousStates(c, P(0, x), STATES));
    REFUSED(fmi2GetContinuousStates(c, x, STATES - 1));
    ALLOWED(EXCHANGE, 1, 1, fmi2GetDerivatives(c, P(0, x), STATES));
    REFUSED(fmi2GetDerivatives(c, x, STATES + 1));
    ALLOWED(EXCHANGE, 1, 0, fmi2GetEventIndicators(c, P(0, x), 0));
    REFUSED(fmi2GetEventIndicators(c, x, 1));
    ALLOWED(NEW_OR_CHANGED, 1, 1, fmi2GetNominalsOfContinuousStates(c, P(0, x), STATES));
    REFUSED(fmi2GetNominalsOfContinuousStates(c, x, STATES + 1));
}

TEST("states of an FMU 2.0 that are kept") {
    fmi2Byte *const at = (fmi2Byte *)&bytes;
    ALLOWED(ALL, 1, 1, fmi2GetFMUstate(c, P(0, no_state())));
    ALLOWED(ALL, 0, 0, fmi2GetFMUstate(c, kept != NULL ? &kept : no_state()));
    ALLOWED(ALL, 1, 1, fmi2SetFMUstate(c, P(0, &some)));
    ALLOWED(ALL, 2, 3, fmi2SerializedFMUstateSize(c, P(0, &some), P(1, &size)));
    assert_int_equal(size, sizeof bytes);
    ALLOWED(ALL, 2, 3, fmi2SerializeFMUstate(c, P(0, &some), P(1, at), sizeof bytes));
    REFUSED(fmi2SerializeFMUstate(c, &some, at, 8));
    ALLOWED(ALL, 2, 3, fmi2DeSerializeFMUstate(c, P(0, at), sizeof bytes, P(1, no_state())));
    ALLOWED(ALL, 0, 0, fmi2DeSerializeFMUstate(c, at, sizeof bytes, &kept));
    REFUSED(fmi2DeSerializeFMUstate(c, at, 8, &kept));
    ALLOWED(ALL, 1, 0, fmi2FreeFMUstate(c, P(0, &kept)));
    (void)no_state();
}

TEST("steps of an FMU 2.0") {
    fmi2Status status;
    ANSWERED(ERROR, fmi2SetRealInputDerivatives(c, vr, 1, &whole, x));
    ANSWERED(ERROR, fmi2GetRealOutputDerivatives(c, vr, 1, &whole, x));
    ALLOWED(STEPPING, 0, 0, fmi2DoStep(c, 0.0, 0.5, 1));
    REFUSED(fmi2DoStep(c, not_a_number, 0.5, 1));
    REFUSED(fmi2DoStep(c, 0.0, 0.0, 1));
    REFUSED(fmi2DoStep(c, 0.0, infinite, 1));
    REFUSED(fmi2DoStep(c, DBL_MAX, DBL_MAX, 1));
    ANSWERED(ERROR, fmi2CancelStep(c));
    ANSWERED(DISCARD, fmi2GetStatus(c, 0, &status));
    ANSWERED(DISCARD, fmi2GetIntegerStatus(c, 0, &whole));
    ANSWERED(DISCARD, fmi2GetBooleanStatus(c, 0, &whole));
    ANSWERED(DISCARD, fmi2GetStringStatus(c, 0, &text));
#define STEPPED "T", "ST"
    ALLOWED(STEPPED, 1, 1, fmi2GetRealStatus(c, 2, P(0, x)));
    TRY("other statuses", fmi2GetRealStatus(c, 1, P(0, x)), STEPPED, 1, 1, DISCARD, ERROR);
}
