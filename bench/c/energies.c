/* energies MODEL.h5 POSITIONS VELOCITIES < ROWS: the learned energy of a machine of lg-identify, one line per
 * row. A row has the positions of all coordinates, then their velocities; POSITIONS and VELOCITIES say how
 * many numbers these are. */
#include <stdio.h>
#include <stdlib.h>

#include "liegrad/core.h"
#include "liegrad/machine.h"
#include "liegrad/model.h"

enum { MOST = LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES };

int main(int argc, char **argv) {
    lg_model_file file;
    lg_error error;
    if (argc != 4) return 2;
    const size_t positions = (size_t)atoi(argv[2]);
    if (lg_model_load(NULL, argv[1], NULL, &file, &error) != LG_OK)
        return fprintf(stderr, "%s\n", error.message), 3;
    const size_t velocities = (size_t)atoi(argv[3]);
    double row[MOST], state[2 * MOST], energy;
    void *work = aligned_alloc(64, (lg_model_work_size(file.model) + 63) / 64 * 64);
    if (work == NULL || positions + velocities > MOST) return 3;
    for (size_t read = 0; scanf("%lf", &row[read]) == 1;) {
        if (++read < positions + velocities) continue;
        read = 0;
        if (lg_model_machine_state(file.model, row, row + positions, state, work) != LG_OK) return 4;
        lg_model_eval(file.model, state, &energy, work);
        printf("%.17g\n", energy);
    }
    free(work);
    lg_model_file_destroy(&file);
    return 0;
}
