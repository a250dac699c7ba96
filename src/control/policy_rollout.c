/* Policies: runs of a piece of starts, and the gradient of their cost by the adjoint method. All states are
 * kept; the periods are then passed backwards with lambda_k = dJ/ds_k. */
#include "control/policy_rollout.h"

#include <math.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "core/portions.h"

lg_status lg_policy_plans_create(const lg_policy *p, bool drawn, const char *const *functions, size_t count,
                                 lg_dtype dtype, size_t rows, lg_policy_plans *out, lg_error *error) {
    const size_t machines = drawn && p->draw_count > 0 ? p->draw_count : 1, all = machines * count;
    *out = (lg_policy_plans){.context = p->context, .machines = machines, .count = count};
    out->plan = lg_alloc(p->context, all, sizeof(lg_plan *));
    if (out->plan == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for plans of a policy");
    for (size_t i = 0; i < all; i++) {
        const lg_policy *of = drawn && p->draw_count > 0 ? p->draws[i / count % p->draw_count] : p;
        LG_TRY(lg_program_plan(of->program, functions[i % count], dtype, rows, &out->plan[i], error));
        const size_t own = lg_plan_work_size(out->plan[i]);
        out->work = own > out->work ? own : out->work;
    }
    return LG_OK;
}

void lg_policy_plans_destroy(lg_policy_plans *plans) {
    for (size_t i = 0; plans->plan != NULL && i < plans->machines * plans->count; i++)
        lg_plan_destroy(plans->plan[i]);
    lg_free(plans->context, plans->plan);
}

void lg_policy_draw_noise(const lg_policy *p, uint64_t seed, uint64_t piece, size_t periods, lg_dtype dtype,
                          void *noise, void *late) {
    double sizes[LG_POLICY_NOISE];
    const size_t n = p->layout.noise;
    lg_rng rng;
    lg_policy_noise_sizes(&p->task, sizes);
    lg_rng_seed(&rng, seed ^ UINT64_C(0xd1b54a32d192ed03), piece);
    for (size_t i = 0; i < LG_POLICY_ROWS; i++)
        lg_put_numbers(dtype, late, i, &(double){lg_rng_uniform(&rng) < p->task.delay ? 1.0 : 0.0}, 1);
    for (size_t i = 0; i < periods * LG_POLICY_ROWS * n; i++) {
        const double size = sizes[i % n];
        lg_put_numbers(dtype, noise, i, &(double){size > 0.0 ? size * lg_rng_normal(&rng) : 0.0}, 1);
    }
}

static size_t width(const lg_policy_rollout *r) {
    return r->dtype == LG_F64 ? sizeof(double) : sizeof(float);
}

/* Number of values of given[i] in all periods. */
static size_t given(const lg_policy_rollout *r, size_t i) {
    return r->given[i] * (r->varies[i] ? r->most : 1);
}

static size_t lay_out(const lg_policy_rollout *r, char *memory, lg_policy_piece *out) {
    const size_t x = r->rows * r->state, size = width(r), back = r->plans.count == LG_POLICY_PLANS;
    lg_portions from = {memory, 0};
    out->path = lg_portion(&from, (r->most + 1) * x, size);
    out->cost = lg_portion(&from, (r->most + 1) * r->rows, size);
    out->u = back ? NULL : lg_portion(&from, r->most * r->rows * r->policy->inputs, size);
    for (size_t i = 0; i < LG_POLICY_GIVEN; i++) out->given[i] = lg_portion(&from, given(r, i), size);
    for (size_t i = 0; i < 2; i++) out->lambda[i] = lg_portion(&from, back * x, size);
    out->weight = lg_portion(&from, r->rows, size);
    out->slope = lg_portion(&from, back * given(r, 0), size);
    out->total = lg_portion(&from, r->rows, sizeof(double));
    out->spread = lg_portion(&from, r->state, sizeof(double));
    out->work = lg_portion(&from, r->plans.work, 1);
    return from.used;
}

lg_status lg_policy_rollout_create(lg_policy_rollout *r, const char *const *functions, size_t count,
                                   lg_error *error) {
    const lg_policy *p = r->policy;
    size_t number, inputs;
    r->disturbed = strncmp(functions[LG_POLICY_STEP], "disturbed", 9) == 0;
    LG_TRY(lg_policy_plans_create(p, r->disturbed, functions, count, r->dtype, r->rows, &r->plans, error));
    LG_TRY(lg_program_find(p->program, functions[LG_POLICY_STEP], &number, error));
    const lg_port *ports = lg_program_inputs(p->program, number, &inputs);
    for (size_t i = 0; i + 1 < inputs; i++) {
        r->given[i] = lg_plan_input_count(r->plans.plan[LG_POLICY_STEP], i + 1);
        r->varies[i] = strcmp(ports[i + 1].name, "noise") == 0 || strcmp(ports[i + 1].name, "y") == 0;
    }
    r->state = lg_plan_input_count(r->plans.plan[LG_POLICY_STEP], 0) / r->rows;
    r->bytes = lay_out(r, NULL, &(lg_policy_piece){0});
    return LG_OK;
}

void lg_policy_piece_at(const lg_policy_rollout *r, char *memory, uint64_t number, lg_policy_piece *out) {
    (void)lay_out(r, memory, out);
    out->plan = r->plans.plan + number % r->plans.machines * r->plans.count;
    out->steps = r->most;
}

/* The input before a disturbed run is the one that holds the goal. */
void lg_policy_begin_runs(const lg_policy_rollout *r, const double *x, size_t count, uint64_t seed,
                          uint64_t number, lg_policy_piece *w) {
    const lg_policy *p = r->policy;
    for (size_t i = 0; i < r->rows; i++) {
        const size_t to = i * r->state;
        lg_put_numbers(r->dtype, w->path, to, x + (i < count ? i : 0) * p->state, p->state);
        if (r->disturbed) lg_put_numbers(r->dtype, w->path, to + p->state, p->regulator.u0, p->inputs);
    }
    for (size_t i = 0; i < LG_POLICY_GIVEN; i++)
        if (r->varies[i])
            lg_policy_draw_noise(p, seed, number, w->steps, r->dtype, w->given[i], w->given[i + 1]);
}

/* Lists the input arrays of period k, and returns their number. */
static size_t take(const lg_policy_rollout *r, const lg_policy_piece *w, size_t k, const void **in) {
    size_t n = 0;
    in[n++] = w->path + k * r->rows * r->state * width(r);
    for (size_t i = 0; i < LG_POLICY_GIVEN && r->given[i] > 0; i++)
        in[n++] = w->given[i] + (r->varies[i] ? k * r->given[i] * width(r) : 0);
    return n;
}

void lg_policy_forward(const lg_policy_rollout *r, lg_policy_piece *w) {
    const size_t row = r->rows * width(r);
    for (size_t k = 0; k < w->steps; k++) {
        const void *in[1 + LG_POLICY_GIVEN];
        (void)take(r, w, k, in);
        lg_plan_eval(w->plan[LG_POLICY_STEP], in,
                     (void *[]){w->path + (k + 1) * row * r->state, w->cost + k * row,
                                w->u != NULL ? w->u + k * row * r->policy->inputs : NULL},
                     w->work);
    }
}

void lg_policy_cost(const lg_policy_rollout *r, lg_policy_piece *w) {
    const size_t row = r->rows * width(r);
    lg_policy_forward(r, w);
    lg_plan_eval(w->plan[LG_POLICY_END], (const void *[]){w->path + w->steps * row * r->state},
                 (void *[]){w->cost + w->steps * row}, w->work);
    memset(w->total, 0, r->rows * sizeof *w->total);
    for (size_t k = 0; k <= w->steps; k++)
        for (size_t i = 0; i < r->rows; i++) w->total[i] += lg_number_at(r->dtype, w->cost, k * r->rows + i);
}

/* Standard deviations of the numbers of a state over the runs of a piece. */
static void find_spread(const lg_policy_rollout *r, lg_policy_piece *w) {
    const size_t n = r->state, count = (w->steps + 1) * r->rows;
    for (size_t i = 0; i < n; i++) {
        double mean = 0.0, square = 0.0;
        for (size_t k = i; k < count * n; k += n) mean += lg_number_at(r->dtype, w->path, k) / (double)count;
        for (size_t k = i; k < count * n; k += n)
            square += pow(lg_number_at(r->dtype, w->path, k) - mean, 2) / (double)count;
        w->spread[i] = sqrt(square);
    }
}

/* Shortens the lambda of each run to at most `bound` times the weight of the run, in the norm
 * |(lambda_i s_i)_i|, where s is the spread of the states. A lambda that is not finite becomes 0. */
static void shorten(const lg_policy_rollout *r, const lg_policy_piece *w, double bound, char *lambda) {
    const size_t n = r->state;
    for (size_t row = 0; row < r->rows; row++) {
        double length = 0.0;
        for (size_t i = 0; i < n; i++)
            length += pow(lg_number_at(r->dtype, lambda, row * n + i) * w->spread[i], 2);
        length = sqrt(length);
        const double most = bound * lg_number_at(r->dtype, w->weight, row), by = most / length;
        if (length <= most) continue;
        for (size_t i = row * n; i < (row + 1) * n; i++) {
            const double to = isfinite(length) ? by * lg_number_at(r->dtype, lambda, i) : 0.0;
            lg_put_numbers(r->dtype, lambda, i, &to, 1);
        }
    }
}

void lg_policy_backward(const lg_policy_rollout *r, lg_policy_piece *w, double bound, double *sum) {
    const size_t x = r->rows * r->state * width(r), n = r->given[0];
    if (isfinite(bound)) find_spread(r, w);
    lg_plan_eval(w->plan[LG_POLICY_ADJOINT_END], (const void *[]){w->path + w->steps * x, w->weight},
                 (void *[]){w->lambda[w->steps % 2]}, w->work);
    for (size_t k = w->steps; k-- > 0;) {
        const void *in[3 + LG_POLICY_GIVEN];
        const size_t taken = take(r, w, k, in);
        char *slope = w->slope + (r->varies[0] ? k * n * width(r) : 0);
        in[taken] = w->lambda[(k + 1) % 2], in[taken + 1] = w->weight;
        lg_plan_eval(w->plan[LG_POLICY_ADJOINT_STEP], in, (void *[]){w->lambda[k % 2], slope}, w->work);
        if (isfinite(bound)) shorten(r, w, bound, w->lambda[k % 2]);
        for (size_t i = 0; !r->varies[0] && i < n; i++) sum[i] += lg_number_at(r->dtype, slope, i);
    }
}

double lg_policy_gradient(const lg_policy_rollout *r, lg_policy_piece *w, double C, double bound,
                          double *sum) {
    double mean = 0.0;
    lg_policy_cost(r, w);
    for (size_t i = 0; i < r->rows; i++) {
        const double J = w->total[i], left = isfinite(C) ? exp(-J / C) : 1.0, n = (double)r->rows;
        mean += (isfinite(C) ? C * (1.0 - left) : J) / n;
        lg_put_numbers(r->dtype, w->weight, i, &(double){left / n}, 1);
    }
    lg_policy_backward(r, w, bound, sum);
    return mean;
}
