/* lg-hamiltonian demo: learns the spherical pendulum from data and predicts its motion; demo/demo.sh has the
 * commands. */
#include "lg-hamiltonian/training.h"

typedef struct demo_values {
    const char *out;
    uint64_t epochs;
    double t_end;
} demo_values;

static const lg_field demo_options[] = {
    LG_OPTION(demo_values, out, STRING, "DIR", "Folder for data, model and plots", .value = "liegrad-demo"),
    LG_OPTION(demo_values, epochs, U64, "E", "Evaluations of the loss (default 2000)", .low = 1, .high = 1e6),
    LG_OPTION(demo_values, t_end, REAL, "T", "Length of the long prediction", LG_POSITIVE, .value = "100"),
    LG_FIELD_END};

static demo_values values;

static int run(app *self) {
    return app_demo(self, values.out, app_demo_texts);
}

const app_command demo_command = {.name = "demo",
                                  .summary = "Learn, test and draw the spherical pendulum",
                                  .settings = APP_SETTINGS(APP_GIVEN(demo_options, values)),
                                  .run = run};
