/* How much of the loss could be explained by forces that a machine does not have.
 *
 * The machine gets further terms with parameters 0: constant forces, forces linear in all heights, velocities
 * and inputs, and polynomials of the height and velocity of each coordinate. J_1 are the Jacobian's columns
 * of their parameters at the fit, r the residuals. Starts and the machine's own parameters are eliminated
 * from both. r_1 is the projection of r onto the p columns J_1, and N residuals remain after all parameters
 * are subtracted. If the residuals are noise,
 *   F = (|r_1|^2/p) / (|r - r_1|^2/N)
 * is around 1 (Lagrange multiplier test; Engle 1984). Integration steps of another program, held inputs and
 * coarsely rounded logs leave residuals that are smooth in time but no function of the state. Therefore N is
 * multiplied by (1 - c)/(1 + c), where c is the correlation of r - r_1 between neighbouring rows. */
#include <math.h>
#include <string.h>

#include "kernels/kernels.h"
#include "machine/internal.h"

enum { MOST_COLUMNS = 128, HIGHEST = 3 };

/* ---- the further terms ---- */

static lg_machine_term *add(lg_machine *machine, lg_machine_part part, const char *kind, uint32_t degree) {
    lg_machine_term *term = &machine->terms[machine->term_count++];
    *term = (lg_machine_term){.kind = lg_term_kind_find(part, kind), .part = part, .degree = degree};
    return term;
}

static void see(lg_machine_term *term, lg_machine_sight kind, uint32_t first, uint32_t end) {
    for (uint32_t i = first; i < end && term->of_count < LG_MACHINE_FEATURES; i++)
        term->of[term->of_count++] = (lg_machine_feature){kind, i};
}

/* Copies the machine to `out` and adds the further terms. False: there are too many terms, monomials or
 * parameters. */
static bool extend(const lg_machine *machine, uint32_t degree, lg_machine *out) {
    const uint32_t n = machine->coordinate_count;
    *out = *machine;
    if (machine->term_count + n + 2 > LG_MACHINE_TERMS) return false;
    see(add(out, LG_MACHINE_POTENTIAL, "linear", 0), LG_FEATURE_HEIGHT, 0, n);
    lg_machine_term *all = add(out, LG_MACHINE_RESIDUAL, "polynomial", 1);
    see(all, LG_FEATURE_HEIGHT, 0, n);
    see(all, LG_FEATURE_VELOCITY, 0, n);
    see(all, LG_FEATURE_INPUT, 0, machine->input_count);
    for (uint32_t i = 0; i < n && degree > 1; i++) {
        lg_machine_term *own = add(out, LG_MACHINE_RESIDUAL, "polynomial", degree);
        see(own, LG_FEATURE_HEIGHT, i, i + 1);
        see(own, LG_FEATURE_VELOCITY, i, i + 1);
    }
    return lg_machine_init(out, NULL) == LG_OK && out->parameters <= machine->parameters + MOST_COLUMNS;
}

/* ---- explained loss ---- */

/* Orthonormalises the columns 0 .. n - 2 of the triangle (n, n) one after the other and removes each from the
 * last column, the residuals. `explained` gets the squares that columns from `own` on remove, `left` the
 * squares that remain. `taken` counts the independent columns before `own` and from `own` on. A column of
 * which little remains is a combination of earlier ones and becomes 0, as does one that is rounding error of
 * the largest. `columns` is (n, 2 n): below each column stand its coefficients in the triangle's columns. */
static void explain(size_t n, size_t own, double *columns, double *explained, double *left, size_t *taken) {
    static const double combined = 1e-6, rounding = 1e-15;
    const lg_kernels *k = lg_kernels_for(LG_F64);
    double *last = columns + (n - 1) * 2 * n, largest = 0.0;
    for (size_t j = 0; j + 1 < n; j++)
        largest = fmax(largest, k->dot(n, columns + j * 2 * n, columns + j * 2 * n));
    taken[0] = taken[1] = 0;
    for (size_t j = 0; j + 1 < n; j++) {
        double *column = columns + j * 2 * n;
        const double before = k->dot(n, column, column);
        for (size_t i = 0; i < 2 * j; i++) { /* two passes, for rounding errors */
            const double *basis = columns + i % j * 2 * n;
            k->axpy(2 * n, -k->dot(n, basis, column), basis, column);
        }
        const double norm = k->dot(n, column, column);
        const bool adds = norm > combined * combined * before && before > rounding * rounding * largest;
        for (size_t i = 0; i < 2 * n; i++) column[i] = adds ? column[i] / sqrt(norm) : 0.0;
        const double part = k->dot(n, column, last);
        k->axpy(2 * n, -part, column, last);
        taken[j >= own] += adds;
        if (j >= own) *explained += part * part;
    }
    *left = k->dot(n, last, last);
}

/* How many residuals count as one independent residual, (1 + c)/(1 - c). `a`: the remaining residuals as a
 * combination of the columns. */
static double correlated(size_t n, const double *lagged, const double *a, double squares) {
    const lg_kernels *k = lg_kernels_for(LG_F64);
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) sum += a[i] * k->dot(n, lagged + i * n, a);
    const double c = fmin(fmax(sum / squares, 0.0), 0.999);
    return (1.0 + c) / (1.0 - c);
}

/* work: 4 n^2 numbers, zeros at the start. */
static lg_status look(const lg_context *context, const lg_machine_problem *problem, const double *theta,
                      size_t own, double *work, lg_machine_missing *out, lg_error *error) {
    const size_t n = problem->machine->parameters + 1;
    double left, *columns = work, *triangle = work + 2 * n * n, *lagged = triangle + n * n;
    size_t taken[2];
    lg_fit_errors s = lg_machine_errors(context, problem, theta, LG_MACHINE_MOST_WINDOWS);
    s.n = n;
    s.last = true;
    s.lagged = lagged;
    const lg_status status = lg_fit_errors_gather(&s, false);
    if (status == LG_OK) memcpy(triangle, s.triangle, n * n * sizeof *triangle);
    /* R comes as if from all windows; the others count only the used ones. */
    const double part = (double)s.used / (double)s.windows;
    double numbers = lg_fit_errors_count(&s);
    LG_TRY(lg_fit_errors_end(&s, status, error));
    for (size_t j = 0; j < n; j++) {
        memcpy(columns + 2 * j * n, triangle + j * n, n * sizeof *columns);
        columns[(2 * j + 1) * n + j] = 1.0;
    }
    explain(n, own, columns, &out->loss, &left, taken);
    numbers -= (double)(taken[0] + taken[1]);
    if (taken[1] > 0 && numbers >= 1.0 && left > 0.0)
        out->ratio = out->loss / (double)taken[1] / (left / numbers) /
                     correlated(n, lagged, columns + (2 * n - 1) * n, part * left);
    out->loss *= part;
    return LG_OK;
}

lg_status lg_machine_find_missing(const lg_context *context, const lg_machine_problem *problem,
                                  const double *theta, lg_machine_missing *out, lg_error *error) {
    const lg_machine *machine = problem->machine;
    const size_t own = machine->parameters, starts = lg_machine_problem_parameters(problem) - own;
    *out = (lg_machine_missing){.loss = 0.0};
    if (machine->weights > 0 || own > MOST_COLUMNS || problem->theta != NULL) return LG_OK;
    LG_TRY_SCRATCH(lg_machine, extended, context, 1, lg_no_memory(error));
    uint32_t degree = HIGHEST;
    while (degree > 0 && !extend(machine, degree, extended)) degree--;
    if (degree == 0) return LG_OK;
    const size_t n = extended->parameters + 1;
    LG_TRY_SCRATCH(double, at, context, n + starts + 4 * n * n,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu columns", n));
    lg_machine_problem more = *problem;
    more.machine = extended;
    memcpy(at, theta, own * sizeof *at);
    memcpy(at + n - 1, theta + own, starts * sizeof *at);
    return look(context, &more, at, own, at + n + starts, out, error);
}
