/* lg-hamiltonian: learns the Hamiltonian of a mechanical system from trajectories. */
#include "lg-hamiltonian/training.h"

#include <stdlib.h>

/* The program's summary, with a line for each family of Hamiltonians. */
static char *summary(void) {
    char *text =
        app_format("Learns the Hamiltonian of a mechanical system from sampled trajectories. The system's "
                   "family says what is learned, and the default integrator:\n");
    for (size_t i = 0; i < lg_hamiltonian_family_count(); i++) {
        const lg_hamiltonian_family *family = lg_hamiltonian_family_at(i);
        char *longer = app_format("%s\n  %-12s %s (%s)", text, family->name, family->formula, family->scheme);
        free(text);
        text = longer;
    }
    return text;
}

static const lg_field demo_options[] = {
    LG_OPTION(app_demo_values, out, STRING, "DIR", "Folder for data, model and plots",
              .value = "liegrad-demo"),
    LG_OPTION(app_demo_values, epochs, U64, "E", "Evaluations of the loss (default 2000)", .low = 1,
              .high = 1e6),
    LG_OPTION(app_demo_values, t_end, REAL, "T", "Length of the long prediction", LG_POSITIVE,
              .value = "100"),
    LG_FIELD_END};

static const app_command demo_command = {APP_DEMO(demo_options),
                                         .summary = "Learn, test and draw the spherical pendulum"};

int main(int argc, char **argv) {
    app_command commands[7] = {generate_command, train_command, evaluate_command, predict_command,
                               study_command,    demo_command,  {.run = NULL}};
    char *text = summary();
    const int code = app_main(argc, argv, "lg-hamiltonian", text, commands);
    free(text);
    return code;
}
