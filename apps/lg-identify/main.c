/* lg-identify: learns a forced, damped machine from its logs. */
#include "lg-identify/identify.h"

static const lg_field demo_options[] = {
    APP_OUT(app_common, "DIR", "Folder for files and plots", .value = "liegrad-machine"),
    APP_BOUND(app_common, "Time for the fit", .value = "20"),
    APP_DEMO_EPOCHS("Evaluations of the loss, if the time allows (default 300)"), LG_FIELD_END};

static const app_command demo_command = {
    APP_DEMO(demo_options, lg_identify_demo),
    .summary = "A driven, damped rigid body from its log to a controller",
    .details =
        "Makes a log of a body whose masses, damping and potential are known, learns them from it, and "
        "controls the true body with the learned one. Every command is shown before it runs."};

APP_PROGRAM(lg_identify) {
    const app_command commands[] = {identify_check_command,
                                    identify_fit_command,
                                    identify_evaluate_command,
                                    identify_predict_command,
                                    identify_adapt_command,
                                    identify_generate_command,
                                    demo_command,
                                    {.run = NULL}};
    return app_main(argc, argv, "lg-identify",
                    "Learns forced, damped mechanical systems from logs. MACHINE.yaml says what the columns "
                    "are, what is known and what is to be learned; docs/machines.md is the guide.",
                    commands);
}
