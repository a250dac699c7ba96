/* lg-control demo: from a log to a controller in C, by the commands in demo/demo.sh. */
#include "lg-control/control_app.h"

typedef struct demo_values {
    const char *out;
    double seconds;
} demo_values;

static const lg_field options[] = {
    LG_OPTION(demo_values, out, STRING, "FOLDER", "Folder for all files", .value = "liegrad-control"),
    LG_OPTION(demo_values, seconds, REAL, "s", "Shorten the phases to this time", .high = 1e9, .above = true,
              .value = "20"),
    LG_FIELD_END};

static demo_values values;

static int run(app *self) {
    return app_demo(self, values.out, app_demo_texts);
}

const app_command demo_command = {.name = "demo",
                                  .summary = "From a log to a controller in C, by the commands that do it",
                                  .details = "Writes a machine and a task into the folder and runs there: "
                                             "lg-identify generate and fit, train, evaluate "
                                             "on the true machine, lg-export, and the self-test of the C.",
                                  .settings = APP_SETTINGS(APP_GIVEN(options, values)),
                                  .run = run};
