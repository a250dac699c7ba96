/* lg-control: controllers that are learned through a machine. */
#include "lg-control/control_app.h"

static const lg_field demo_options[] = {
    APP_OUT(app_common, "FOLDER", "Folder for all files", .value = "liegrad-control"),
    APP_BOUND(app_common, "Shorten the phases to this time", .value = "20"), LG_FIELD_END};

static const app_command demo_command = {
    APP_DEMO(demo_options, lg_control_demo),
    .summary = "From a log to a controller in C, by the commands that do it",
    .details = "Writes a machine and a task into the folder and runs there: lg-identify generate and fit, "
               "train, evaluate on the true machine, lg-export, and the self-test of the C."};

APP_PROGRAM(lg_control) {
    const app_command commands[] = {control_train_command,
                                    control_evaluate_command,
                                    control_certify_command,
                                    control_verify_command,
                                    demo_command,
                                    {.run = NULL}};
    return app_main(
        argc, argv, "lg-control",
        "Controllers of machines: TASK.yaml names the machine, the goal, limits, cost and starts; train "
        "learns a policy through the machine, evaluate scores it, certify proves where it works, verify "
        "checks such a proof again. docs/control.md is the guide.",
        commands);
}
