/* momentum MODEL.h5 TEST.h5 T: integrates the learned flow of a chain from the starts of the test
 * trajectories to time T, and prints root mean squares over the trajectories: of the largest change of the
 * vertical momentum sum_i e3.(q_i x p_i), and of the largest change of the learned energy. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <liegrad/hamiltonian.h>

static double vertical(const double *y, size_t d) {
    double sum = 0;
    for (size_t i = 0; i < d; i += 6) sum += y[i] * y[i + 4] - y[i + 1] * y[i + 3];
    return sum;
}

int main(int argc, char **argv) {
    enum { POINTS = 101, STARTS = 20 };
    lg_model_file file;
    lg_trajectories data;
    lg_ode ode;
    lg_model_user user;
    lg_error error;
    if (argc != 4) return 2;
    if (lg_model_load(NULL, argv[1], NULL, &file, &error) != LG_OK ||
        lg_trajectories_read(NULL, argv[2], NULL, &data, &error) != LG_OK)
        return fprintf(stderr, "%s\n", error.message), 3;
    const size_t d = data.state_dim;
    double *path = malloc(POINTS * d * sizeof *path), t[POINTS], momentum = 0, energy = 0;
    void *work = aligned_alloc(64, (lg_model_work_size(file.model) + 63) / 64 * 64);
    char space[LG_SPACE_TEXT];
    lg_space_text(lg_model_space(file.model), space);
    if (lg_model_ode(file.model, &ode, &user, work) != LG_OK) return 3;
    for (size_t k = 0; k < POINTS; k++) t[k] = atof(argv[3]) * (double)k / (POINTS - 1);
    const size_t starts = data.count < STARTS ? data.count : STARTS;
    for (size_t i = 0; i < starts; i++) {
        const double *y = data.data + i * data.points * d;
        double most = 0, most_energy = 0, h0, h;
        if (lg_ode_solve(NULL, space, ode.field, ode.user, 1e-12, t, POINTS, y, path, &error) != LG_OK)
            return fprintf(stderr, "%s\n", error.message), 4;
        lg_model_eval(file.model, path, &h0, work);
        for (size_t k = 1; k < POINTS; k++) {
            lg_model_eval(file.model, path + k * d, &h, work);
            most = fmax(most, fabs(vertical(path + k * d, d) - vertical(path, d)));
            most_energy = fmax(most_energy, fabs(h - h0));
        }
        momentum += most * most / (double)starts, energy += most_energy * most_energy / (double)starts;
    }
    printf("%.3e,%.3e\n", sqrt(momentum), sqrt(energy));
    return 0;
}
