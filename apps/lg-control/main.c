/* lg-control: controllers that are learned through a machine. */
#include "lg-control/control_app.h"

int main(int argc, char **argv) {
    const app_command commands[] = {train_command,  evaluate_command, certify_command,
                                    verify_command, demo_command,     {.run = NULL}};
    return app_main(
        argc, argv, "lg-control",
        "Controllers of machines: TASK.yaml names the machine, the goal, limits, cost and starts; train "
        "learns a policy through the machine, evaluate judges it, certify proves where it works, verify "
        "checks such a proof "
        "again. "
        "docs/control.md is the guide.",
        commands);
}
