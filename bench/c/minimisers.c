/* A shared library for bench/minimisers: the functions of the problem collections in
 * tests/nn/minimise_problems.h, and runs of the library's minimisers with default options. */
#include "liegrad/minimise.h"
#include "nn/minimise_problems.h"

size_t problem_count(void);
size_t problem_count(void) {
    return MINIMISE_PROBLEMS;
}

/* Describes a problem and returns its name. sizes (4): n, m, number of starts, 1 if it is from NIST.
 * certified (n): NIST's certified parameters, for problems from NIST only. */
const char *problem_describe(size_t number, size_t *sizes, double *least, double *certified);
const char *problem_describe(size_t number, size_t *sizes, double *least, double *certified) {
    const minimise_problem p = minimise_problem_at(number);
    sizes[0] = p.n, sizes[1] = p.m, sizes[2] = minimise_problem_starts(&p), sizes[3] = p.nist != NULL;
    *least = p.least;
    for (size_t i = 0; p.nist != NULL && i < p.n; i++) certified[i] = p.start[2 * p.n + i];
    return p.name;
}

void problem_start(size_t number, size_t start, double *x);
void problem_start(size_t number, size_t start, double *x) {
    const minimise_problem p = minimise_problem_at(number);
    minimise_problem_start(&p, start, x);
}

void problem_jacobian(size_t number, const double *x, double *r, double *jacobian);
void problem_jacobian(size_t number, const double *x, double *r, double *jacobian) {
    const minimise_problem p = minimise_problem_at(number);
    minimise_problem_jacobian(&p, x, r, jacobian);
}

/* A run: f of each evaluation goes to `values`, which has room for `most`. */
typedef struct recorded {
    minimise_problem of;
    size_t count, most;
    double *values;
} recorded;

static void record(recorded *p, double f) {
    if (p->count < p->most) p->values[p->count] = f;
    p->count++;
}

static lg_status value(void *user, const double *x, double *f, double *gradient) {
    recorded *p = user;
    minimise_problem_value(&p->of, x, f, gradient);
    record(p, *f);
    return LG_OK;
}

static lg_status residuals(void *user, const double *x, double *r, double *jacobian) {
    recorded *p = user;
    double f = 0;
    minimise_problem_jacobian(&p->of, x, r, jacobian);
    for (size_t i = 0; i < p->of.m; i++) f += r[i] * r[i];
    record(p, f);
    return LG_OK;
}

/* Runs a minimiser and returns its status. x is the start and becomes the result. values (most): f of each
 * evaluation. */
int problem_run(size_t number, int method, double *x, double *f, size_t *evaluations, size_t most,
                double *values);
int problem_run(size_t number, int method, double *x, double *f, size_t *evaluations, size_t most,
                double *values) {
    recorded p = {minimise_problem_at(number), 0, most, values};
    lg_minimise_options options;
    lg_minimise_result result;
    lg_minimise_options_init(&options);
    options.method = (lg_minimise_method)method;
    const lg_status status =
        method == LG_MINIMISE_LM
            ? lg_least_squares(NULL, p.of.n, p.of.m, residuals, &p, &options, x, NULL, &result, NULL)
            : lg_minimise(NULL, p.of.n, value, &p, &options, x, &result, NULL);
    *f = result.value;
    *evaluations = (size_t)result.evaluations;
    return status;
}
