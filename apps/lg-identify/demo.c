/* lg-identify demo: a body from its log to a controller, by the commands in demo/demo.sh. */
#include "lg-identify/identify.h"

typedef struct demo_values {
    const char *out;
    double seconds;
    uint64_t epochs;
} demo_values;

static const lg_field options[] = {
    LG_OPTION(demo_values, out, STRING, "DIR", "Folder for files and plots", .value = "liegrad-machine"),
    LG_OPTION(demo_values, seconds, REAL, "S", "Time for the fit", LG_POSITIVE, .value = "20"),
    LG_OPTION(demo_values, epochs, U64, "E", "Evaluations of the loss, if the time allows (default 300)",
              .low = 1, .high = 1e6),
    LG_FIELD_END};

static demo_values values;

static int run(app *self) {
    return app_demo(self, values.out, app_demo_texts);
}

const app_command demo_command = {
    .name = "demo",
    .summary = "A driven, damped rigid body from its log to a controller",
    .details =
        "Makes a log of a body whose masses, damping and potential are known, learns them from it, and "
        "controls the true body with the learned one. Every command is shown before it runs.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
