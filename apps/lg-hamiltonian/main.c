/* lg-hamiltonian: learn the Hamiltonian of a mechanical system from trajectories. */
#include "lg-hamiltonian/learning.h"

int main(int argc, char **argv) {
    app_command commands[7] = {generate_command, train_command, evaluate_command, predict_command,
                               study_command,    demo_command,  {.run = NULL}};
    return app_main(
        argc, argv, "lg-hamiltonian",
        "Learns the Hamiltonian of a mechanical system from sampled trajectories, on R^2n and on the "
        "constrained (T*S^2)^k of pendulum chains.",
        commands);
}
