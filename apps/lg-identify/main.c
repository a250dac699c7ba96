/* lg-identify: learns a forced, damped machine from its logs. */
#include "lg-identify/identify.h"

int main(int argc, char **argv) {
    const app_command commands[] = {check_command, fit_command,      evaluate_command, predict_command,
                                    adapt_command, generate_command, demo_command,     {.run = NULL}};
    return app_main(argc, argv, "lg-identify",
                    "Learns forced, damped mechanical systems from logs. MACHINE.yaml says what the columns "
                    "are, what is known and what is to be learned; docs/machines.md is the guide.",
                    commands);
}
