/* lg-elastica: computes equilibria of a clamped beam, and trains networks that compute them. */
#include "lg-elastica/beam.h"

int main(int argc, char **argv) {
    app_command commands[7] = {solve_command,   generate_command, train_command, evaluate_command,
                               predict_command, search_command,   {.run = NULL}};
    return app_main(
        argc, argv, "lg-elastica",
        "Euler's elastica: equilibria of a planar inextensible beam clamped at both ends, data sets of "
        "equilibria, and networks that compute the curve from the boundary conditions.",
        commands);
}
