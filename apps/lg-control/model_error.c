/* What the covariance of a fit says about the error of a machine's rates. */
#include <math.h>

#include "lg-control/control_app.h"

enum { DRAWS = 40, PLACES = 1024 };

/* Rates (`held`: next states) at PLACES states z and inputs u */
static void evaluate(const app *self, lg_policy *policy, bool held, const double *z, const double *u,
                     double *out) {
    lg_program *program = NULL;
    APP_MUST(self, lg_policy_add_rate(policy, &program, &error));
    APP_MUST(self, lg_program_eval(self->context, program, held ? "advance_by_input" : "rate_by_input",
                                   PLACES, (const double *const[]){z, u}, (double *const[]){out}, &error));
}

/* Adds the squares of the differences that drawn machines make. */
static void add_squares(const app *self, const lg_policy *policy, lg_program *plant, bool held,
                        const double *z, const double *u, const double *first, double *other, size_t numbers,
                        double *square) {
    lg_policy *drawn = NULL;
    APP_MUST(self, lg_policy_transplant(policy, plant, NULL, &drawn, &error));
    evaluate(self, drawn, held, z, u, other);
    for (size_t i = 0; i < numbers; i++) square[i] += (other[i] - first[i]) * (other[i] - first[i]) / DRAWS;
    lg_policy_destroy(drawn);
}

void control_draw_error(const app *self, lg_policy *policy, const char *plant, bool held, const double *high,
                        double *out) {
    const lg_policy_task *task = lg_policy_task_of(policy);
    /* Behind the inputs, the rates of what the controller remembers: 0. */
    const size_t n = lg_policy_regulator_of(policy)->errors, numbers = PLACES * n,
                 m = task->input_count + control_count_lagged(task, true);
    APP_FREE double *z = app_alloc(4 * numbers + PLACES * m, sizeof *z);
    double *first = z + numbers, *other = first + numbers, *square = other + numbers, *u = square + numbers;
    lg_program *plants[DRAWS];
    lg_rng rng;
    lg_rng_seed(&rng, self->seed, 16);
    for (size_t i = 0; i < numbers; i++) z[i] = lg_rng_uniform_in(&rng, -high[i % n], high[i % n]);
    for (size_t i = 0; i < PLACES * m; i++)
        u[i] = i % m >= task->input_count
                   ? 0
                   : lg_rng_uniform_in(&rng, task->input[i % m].low, task->input[i % m].high);
    evaluate(self, policy, held, z, u, first);
    control_draw_plants(self, plant, 0, DRAWS, "--model-error auto", plants);
    for (size_t k = 0; k < DRAWS; k++)
        add_squares(self, policy, plants[k], held, z, u, first, other, numbers, square);
    for (size_t i = 0; i < n; i++) out[i] = 0;
    for (size_t i = 0; i < numbers; i++) out[i % n] = fmax(out[i % n], 3 * sqrt(square[i]));
}
