/* Polynomial Lyapunov functions. The rows of the linear program are V at points of the boundary and -V' at
 * points within; their columns are made orthonormal before it is solved. */
#include "liegrad/lyapunov.h"

#include <cblas.h>
#include <math.h>
#include <string.h>

#include "certify/certify.h"
#include "certify/linear_program.h"
#include "autodiff/program/program.h"
#include "autodiff/tape/tape_internal.h"
#include "kernels/matrix.h"

enum { STATES = 6, DEGREE = 12, TERMS = 500 };

typedef struct fitting {
    const lg_context *context;
    lg_program *program;
    const lg_lyapunov_spec *spec;
    size_t n, rate, map, terms, points;
    uint8_t power[TERMS][STATES];
    double scale[STATES]; /* the largest |q| in the box */
    double *x, *q, *dq;   /* (points, n) */
    double *A, *b, *c;    /* (points, terms), (points), (terms) */
    double coefficient[TERMS];
} fitting;

void lg_lyapunov_spec_init(lg_lyapunov_spec *spec) {
    if (spec != NULL)
        *spec =
            (lg_lyapunov_spec){.size = sizeof *spec, .degree = 4, .points = 12000, .decay = 1e-3, .seed = 1};
}

/* ---- monomials ---- */

static bool list_terms(fitting *f, uint8_t *power, size_t k, int left) {
    if (k + 1 == f->n) {
        power[k] = (uint8_t)left;
        if (f->terms == TERMS) return false;
        memcpy(f->power[f->terms++], power, STATES);
        return true;
    }
    for (int p = left; p >= 0; p--) {
        power[k] = (uint8_t)p;
        if (!list_terms(f, power, k + 1, left - p)) return false;
    }
    return true;
}

/* The monomials at q, and their rates with q' = dq, in units of f->scale. */
static void monomials(const fitting *f, const double *q, const double *dq, double *value, double *rate) {
    double powers[STATES][DEGREE + 1];
    for (size_t k = 0; k < f->n; k++) {
        powers[k][0] = 1;
        for (int p = 1; p <= f->spec->degree; p++) powers[k][p] = powers[k][p - 1] * q[k] / f->scale[k];
    }
    for (size_t j = 0; j < f->terms; j++) {
        value[j] = 1;
        rate[j] = 0;
        for (size_t k = 0; k < f->n; k++) value[j] *= powers[k][f->power[j][k]];
        for (size_t k = 0; k < f->n; k++) {
            double part = f->power[j][k];
            for (size_t i = 0; i < f->n && part != 0; i++) part *= powers[i][f->power[j][i] - (i == k)];
            rate[j] += part * dq[k] / f->scale[k];
        }
    }
}

/* ---- points ---- */

/* q and q' */
static lg_status sample(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const fitting *f = user;
    lg_var rate, q = in[0];
    LG_TRY(lg_program_record(tape, f->program, f->rate, NULL, in, &rate));
    if (f->spec->map != NULL) LG_TRY(lg_program_record(tape, f->program, f->map, NULL, in, &q));
    if (f->spec->map == NULL && f->spec->goal != NULL)
        q = lg_sub(tape, q, lg_input_f64(tape, lg_shape1((uint32_t)f->n), f->spec->goal));
    out[0] = q;
    out[1] = rate;
    return q.index == in[0].index ? lg_tape_status(tape) : lg_jvp(tape, &q, 1, in, &rate, 1, &out[1]);
}

/* A third of the points lie on the boundary. The others lie in boxes that shrink to the goal. */
static void draw_points(fitting *f) {
    lg_rng rng;
    lg_rng_seed(&rng, f->spec->seed, 0);
    for (size_t i = 0; i < f->points; i++) {
        const bool edge = i % 3 == 0;
        const double size = edge ? 1 : lg_rng_below(&rng, 4) > 0 ? 1 : lg_rng_uniform(&rng);
        for (size_t k = 0; k < f->n; k++) {
            const double goal = f->spec->goal != NULL ? f->spec->goal[k] : 0;
            f->x[i * f->n + k] =
                goal + size * (lg_rng_uniform_in(&rng, f->spec->low[k], f->spec->high[k]) - goal);
        }
        const size_t side = (size_t)lg_rng_below(&rng, 2 * f->n);
        if (edge)
            f->x[i * f->n + side / 2] = side % 2 == 0 ? f->spec->low[side / 2] : f->spec->high[side / 2];
    }
}

static lg_status sample_points(fitting *f, lg_error *error) {
    const lg_port in = {.name = "x", .shape = lg_shape1((uint32_t)f->n)},
                  out[2] = {{.name = "q"}, {.name = "dq"}};
    const lg_function_spec function = {"sample", &in, 1, out, 2, sample, f};
    LG_CLEAN(lg_program_destroy_at) lg_program *program = NULL;
    draw_points(f);
    LG_TRY(lg_program_of(f->context, &function, 1, &program, error));
    LG_TRY(lg_program_eval(f->context, program, "sample", f->points, (const double *[]){f->x},
                           (double *[]){f->q, f->dq}, error));
    for (size_t i = 0; i < f->points * f->n; i++) {
        if (!isfinite(f->q[i]) || !isfinite(f->dq[i]))
            return lg_fail(error, LG_NOT_FINITE, "the closed loop is not finite at a point of the box");
        f->scale[i % f->n] = fmax(f->scale[i % f->n], fabs(f->q[i]));
    }
    return LG_OK;
}

/* ---- the linear program ---- */

static void fill_rows(fitting *f) {
    double value[TERMS], rate[TERMS];
    for (size_t i = 0; i < f->points; i++) {
        double *row = f->A + i * f->terms, size = 0, norm = 0;
        monomials(f, f->q + i * f->n, f->dq + i * f->n, value, rate);
        for (size_t k = 0; k < f->n; k++) size += pow(f->q[i * f->n + k] / f->scale[k], 2);
        const bool edge = i % 3 == 0;
        for (size_t j = 0; j < f->terms; j++) {
            f->c[j] += value[j] / (double)f->points;
            row[j] = edge ? value[j] : -rate[j];
            norm += row[j] * row[j];
        }
        norm = sqrt(norm) + 1e-300;
        for (size_t j = 0; j < f->terms; j++) row[j] /= norm;
        f->b[i] = (edge ? 1 : f->spec->decay * size) / norm;
    }
}

/* A = Q R by Cholesky's factor of A^T A, twice, which is as accurate as Householder's method for conditions
 * up to 1e8. With y = R x the program is min (R^-T c)^T y with Q y >= b. A becomes Q; R (terms, terms) is
 * upper triangular. */
static bool orthonormalise(fitting *f, double *gram, double *L, double *R) {
    const int n = (int)f->terms, points = (int)f->points;
    for (size_t j = 0; j < f->terms; j++) R[j * f->terms + j] = 1;
    for (int round = 0; round < 2; round++) {
        double largest = 0;
        cblas_dgemm(CblasRowMajor, CblasTrans, CblasNoTrans, n, n, points, 1, f->A, n, f->A, n, 0, gram, n);
        for (size_t j = 0; j < f->terms; j++) largest = fmax(largest, gram[j * f->terms + j]);
        for (size_t j = 0; j < f->terms; j++) gram[j * f->terms + j] += 1e-15 * largest;
        if (!lg_matrix_cholesky(f->terms, gram, L)) return false;
        cblas_dtrsm(CblasRowMajor, CblasRight, CblasLower, CblasTrans, CblasNonUnit, points, n, 1, L, n, f->A,
                    n);
        cblas_dtrmm(CblasRowMajor, CblasLeft, CblasLower, CblasTrans, CblasNonUnit, n, n, 1, L, n, R, n);
    }
    return true;
}

static lg_status solve(fitting *f, double *matrices) {
    const size_t n = f->terms;
    double *R = matrices + 2 * n * n, y[TERMS];
    if (!orthonormalise(f, matrices, matrices + n * n, R)) return LG_NO_CONVERGENCE;
    for (size_t j = 0; j < n; j++) { /* R^T c' = c */
        for (size_t k = 0; k < j; k++) f->c[j] -= R[k * n + j] * f->c[k];
        f->c[j] /= R[j * n + j];
    }
    LG_TRY(lg_linear_program(f->context, f->points, n, f->A, f->b, f->c, y));
    for (size_t j = n; j-- > 0;) {
        for (size_t k = j + 1; k < n; k++) y[j] -= R[j * n + k] * f->coefficient[k];
        f->coefficient[j] = y[j] / R[j * n + j];
    }
    return LG_OK;
}

/* ---- the function ---- */

static lg_status polynomial(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const fitting *f = user;
    lg_var powers[STATES][DEGREE + 1], term[TERMS], q = in[0];
    if (f->spec->map != NULL) LG_TRY(lg_program_record(tape, f->program, f->map, NULL, in, &q));
    if (f->spec->map == NULL && f->spec->goal != NULL)
        q = lg_sub(tape, q, lg_input_f64(tape, lg_shape1((uint32_t)f->n), f->spec->goal));
    for (size_t k = 0; k < f->n; k++) {
        powers[k][1] = lg_scale(tape, lg_slice(tape, q, 1, (uint32_t)k, 1), 1 / f->scale[k]);
        for (int p = 2; p <= f->spec->degree; p++) powers[k][p] = lg_pow(tape, powers[k][1], p);
    }
    for (size_t j = 0; j < f->terms; j++) {
        term[j] = LG_NONE;
        for (size_t k = 0; k < f->n; k++) {
            if (f->power[j][k] == 0) continue;
            const lg_var factor = powers[k][f->power[j][k]];
            term[j] = lg_is_none(term[j]) ? factor : lg_mul(tape, term[j], factor);
        }
    }
    out[0] = LG_NONE;
    for (size_t j = 0; j < f->terms; j += 64) {
        const size_t now = f->terms - j < 64 ? f->terms - j : 64;
        out[0] = lg_add_or(tape, out[0], lg_linear_combination(tape, term + j, f->coefficient + j, now));
    }
    return lg_tape_status(tape);
}

static lg_status fit(fitting *f, lg_error *error) {
    const lg_port in = {.name = "x", .shape = lg_shape1((uint32_t)f->n)}, out = {.name = "v"};
    const lg_function_spec function = {f->spec->name, &in, 1, &out, 1, polynomial, f};
    const size_t n = f->terms, numbers = 3 * f->points * f->n + f->points * (n + 1) + n + 3 * n * n;
    LG_TRY_SCRATCH(double, memory, f->context, numbers, lg_no_memory(error));
    f->x = memory;
    f->q = f->x + f->points * f->n;
    f->dq = f->q + f->points * f->n;
    f->A = f->dq + f->points * f->n;
    f->b = f->A + f->points * n;
    f->c = f->b + f->points;
    LG_TRY(sample_points(f, error));
    fill_rows(f);
    const lg_status status = solve(f, f->c + n);
    if (status == LG_NO_CONVERGENCE)
        return lg_fail(error, status,
                       "no polynomial of degree %d falls at all %zu points of the box: take a smaller box or "
                       "a higher degree",
                       f->spec->degree, f->points);
    return status == LG_OK ? lg_program_add_function(f->program, &function, error) : status;
}

lg_status lg_lyapunov_polynomial(lg_program *program, const lg_lyapunov_spec *spec, lg_error *error) {
    LG_NEEDS(error, program, spec);
    LG_NEEDS(error, spec->rate, spec->name, spec->low, spec->high);
    if (spec->size != sizeof *spec || spec->degree < 2 || spec->degree > DEGREE || spec->degree % 2 != 0 ||
        spec->points < 100 || spec->points > 1000000 || !(spec->decay > 0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the degree must be even, 2 to %d, the points 100 to 1e6, the decay positive", DEGREE);
    LG_TRY_SCRATCH(fitting, f, program->context, 1, lg_no_memory(error));
    *f = (fitting){.context = program->context, .program = program, .spec = spec, .points = spec->points};
    LG_TRY(lg_certify_function(program, spec->rate, STATES, false, false, &f->rate, &f->n, error));
    if (spec->map != NULL)
        LG_TRY(lg_certify_function(program, spec->map, STATES, false, false, &f->map, &f->n, error));
    for (int degree = 2; degree <= spec->degree; degree++)
        if (!list_terms(f, (uint8_t[STATES]){0}, 0, degree))
            return lg_fail(error, LG_INVALID_ARGUMENT, "more than %d monomials", TERMS);
    return fit(f, error);
}
