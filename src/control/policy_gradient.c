/* Policies: the cost of a batch of runs and its gradient. The states of a piece of LG_POLICY_ROWS starts
 * are kept, and the adjoint of a period goes back over them: lambda_k = dJ/ds_k. */
#include <math.h>
#include <string.h>

#include "control/policy_gradient.h"
#include "core/numbers.h"
#include "core/portions.h"

enum { ROWS = LG_POLICY_ROWS };

/* Arrays of a piece, in the type of the batch; path (most + 1, ROWS, state). The last ones are doubles. */
typedef struct piece {
    char *path, *cost, *theta, *weight, *lambda, *before, *gradient, *noise, *late;
    double *total, *copy, *mean, *spread; /* spread (state): standard deviations over the runs */
    lg_plan *const *plan;
    void *work;
    size_t steps;
} piece;

static size_t width(const lg_policy_batch *b) {
    return b->dtype == LG_F64 ? sizeof(double) : sizeof(float);
}

static size_t lay_out(const lg_policy_batch *b, char *memory, piece *out) {
    const lg_policy *p = b->policy;
    char **const arrays[] = {&out->path,   &out->cost,     &out->theta, &out->weight, &out->lambda,
                             &out->before, &out->gradient, &out->noise, &out->late};
    const size_t x = ROWS * b->state, n = p->parameters, late = b->disturbed ? ROWS : 0,
                 noise = late * b->most * p->layout.noise,
                 counts[] = {(b->most + 1) * x, ROWS, n, ROWS, x, x, n, noise, late};
    lg_portions from = {memory, 0};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) *arrays[i] = lg_portion(&from, counts[i], width(b));
    double **const doubles[] = {&out->total, &out->copy, &out->mean, &out->spread};
    const size_t most = n > noise + late ? n : noise + late;
    const size_t of_doubles[] = {ROWS, most > ROWS ? most : ROWS, b->state, b->state};
    for (size_t i = 0; i < LG_COUNT(doubles); i++)
        *doubles[i] = lg_portion(&from, of_doubles[i], sizeof(double));
    out->work = lg_portion(&from, b->plans.work, 1);
    return from.used;
}

/* ---- numbers of the batch's type ---- */

/* The numbers as doubles, which may lie in `copy`. */
static const double *fetch(const lg_policy_batch *b, const void *from, size_t n, double *copy) {
    if (b->dtype == LG_F64) return from;
    lg_get_numbers(b->dtype, from, 0, copy, n);
    return copy;
}

/* Multiplies row r of (ROWS, state); 0 also removes what is not finite. */
static void scale_row(const lg_policy_batch *b, char *x, size_t r, double by) {
    const size_t n = b->state;
    for (size_t i = r * n; i < (r + 1) * n; i++) {
        const double to = by > 0.0 ? by * lg_number_at(b->dtype, x, i) : 0.0;
        lg_put_numbers(b->dtype, x, i, &to, 1);
    }
}

/* ---- */

static void add_costs(const lg_policy_batch *b, piece *w) {
    const double *cost = fetch(b, w->cost, ROWS, w->copy);
    for (size_t i = 0; i < ROWS; i++) w->total[i] += cost[i];
}

/* The disturbances of period k. */
static const char *noise_of(const lg_policy_batch *b, const piece *w, size_t k) {
    return b->disturbed ? w->noise + k * ROWS * b->policy->layout.noise * width(b) : NULL;
}

static void forward(const lg_policy_batch *b, piece *w) {
    const size_t x = ROWS * b->state * width(b);
    memset(w->total, 0, ROWS * sizeof *w->total);
    for (size_t k = 0; k < w->steps; k++) {
        lg_plan_eval(w->plan[LG_POLICY_CLOSED],
                     (const void *[]){w->path + k * x, w->theta, noise_of(b, w, k), w->late},
                     (void *[]){w->path + (k + 1) * x, w->cost, NULL}, w->work);
        add_costs(b, w);
    }
    lg_plan_eval(w->plan[LG_POLICY_TERMINAL], (const void *[]){w->path + w->steps * x}, (void *[]){w->cost},
                 w->work);
    add_costs(b, w);
}

/* Standard deviations of the numbers of a state over the runs of a piece. */
static void find_spread(const lg_policy_batch *b, piece *w) {
    const size_t n = b->state, count = (w->steps + 1) * ROWS;
    memset(w->mean, 0, n * sizeof *w->mean);
    memset(w->spread, 0, n * sizeof *w->spread);
    for (size_t k = 0; k < count; k++)
        for (size_t i = 0; i < n; i++)
            w->mean[i] += lg_number_at(b->dtype, w->path, k * n + i) / (double)count;
    for (size_t k = 0; k < count; k++)
        for (size_t i = 0; i < n; i++) {
            const double from = lg_number_at(b->dtype, w->path, k * n + i) - w->mean[i];
            w->spread[i] += from * from / (double)count;
        }
    for (size_t i = 0; i < n; i++) w->spread[i] = sqrt(w->spread[i]);
}

/* Shortens the lambda of each run to b->bound times the weight of the run, in the norm |(lambda_i s_i)_i|, s
 * the spread of the states. A lambda that is not finite becomes 0. */
static void shorten(const lg_policy_batch *b, const piece *w, char *lambda) {
    const size_t n = b->state;
    for (size_t r = 0; r < ROWS; r++) {
        double sum = 0.0;
        for (size_t i = 0; i < n; i++) {
            const double change = lg_number_at(b->dtype, lambda, r * n + i) * w->spread[i];
            sum += change * change;
        }
        const double bound = b->bound * lg_number_at(b->dtype, w->weight, r), length = sqrt(sum);
        if (!(length <= bound)) scale_row(b, lambda, r, isfinite(length) ? bound / length : 0.0);
    }
}

static void backward(const lg_policy_batch *b, piece *w, double *gradient) {
    const size_t x = ROWS * b->state * width(b), n = b->policy->parameters;
    const bool bounded = isfinite(b->bound);
    if (bounded) find_spread(b, w);
    char *lambda = w->lambda, *next = w->before;
    lg_plan_eval(w->plan[LG_POLICY_ADJOINT_TERMINAL], (const void *[]){w->path + w->steps * x, w->weight},
                 (void *[]){lambda}, w->work);
    for (size_t k = w->steps; k-- > 0;) {
        const void *disturbed[] = {w->path + k * x, w->theta, noise_of(b, w, k), w->late, lambda, w->weight},
                   *plain[] = {w->path + k * x, w->theta, lambda, w->weight};
        lg_plan_eval(w->plan[LG_POLICY_ADJOINT_CLOSED], b->disturbed ? disturbed : plain,
                     (void *[]){next, w->gradient}, w->work);
        if (bounded) shorten(b, w, next);
        const double *own = fetch(b, w->gradient, n, w->copy);
        for (size_t i = 0; i < n; i++) gradient[i] += own[i];
        char *const swap = lambda;
        lambda = next, next = swap;
    }
}

/* The starts, with the input that holds the goal as the input before them. */
static void store_starts(const lg_policy_batch *b, const double *x, piece *w) {
    const lg_policy *p = b->policy;
    for (size_t i = 0; i < ROWS; i++) {
        const size_t to = i * b->state;
        lg_put_numbers(b->dtype, w->path, to, x + i * p->state, p->state);
        if (b->disturbed) lg_put_numbers(b->dtype, w->path, to + p->state, p->regulator.u0, p->inputs);
    }
}

static void disturb(const lg_policy_batch *b, uint64_t number, piece *w) {
    const size_t noise = w->steps * ROWS * b->policy->layout.noise;
    lg_policy_draw_noise(b->policy, b->seed, number, w->steps, w->copy, w->copy + noise);
    lg_put_numbers(b->dtype, w->noise, 0, w->copy, noise);
    lg_put_numbers(b->dtype, w->late, 0, w->copy + noise, ROWS);
}

/* Sums over a piece: cut costs, and their gradient. A cut of C makes C (1 - exp(-J/C)) of a cost J. */
static void run_piece(void *user, size_t own) {
    const lg_policy_batch *b = user;
    const lg_policy *p = b->policy;
    const size_t index = b->first + own, point = index / b->pieces, first = index % b->pieces * ROWS,
                 n = p->parameters;
    double *sum = b->sums + index * (n + 1), weight[ROWS];
    piece w = {0};
    (void)lay_out(b, b->memory + index * b->piece_bytes, &w);
    w.steps = b->steps[point];
    const uint64_t number = b->draw * b->pieces + index % b->pieces;
    w.plan = b->plans.plan + number % b->plans.machines * LG_POLICY_PLANS;
    store_starts(b, b->starts[point] + first * p->state, &w);
    if (b->disturbed) disturb(b, number, &w);
    lg_put_numbers(b->dtype, w.theta, 0, b->theta[point], n);
    memset(sum, 0, (n + 1) * sizeof *sum);
    forward(b, &w);
    for (size_t i = 0; i < ROWS; i++) {
        const double J = w.total[i], left = isfinite(b->cut) ? exp(-J / b->cut) : 1.0;
        sum[n] += isfinite(b->cut) ? b->cut * (1.0 - left) : J;
        weight[i] = left / (double)b->count;
    }
    sum[n] /= (double)b->count;
    lg_put_numbers(b->dtype, w.weight, 0, weight, ROWS);
    backward(b, &w, sum);
}

static lg_status allocate(lg_policy_batch *b, int threads, lg_error *error) {
    static const char *const names[2][LG_POLICY_PLANS] = {
        {"closed", "terminal", "adj1_closed", "adj1_terminal"},
        {"disturbed", "disturbed_end", "adj1_disturbed", "adj1_disturbed_end"}};
    const lg_policy *p = b->policy;
    const size_t points = b->points;
    LG_TRY(lg_policy_plans_create(p, b->disturbed, names[b->disturbed], LG_POLICY_PLANS, b->dtype, ROWS,
                                  &b->plans, error));
    LG_TRY(lg_thread_pool_create(p->context, threads, &b->pool));
    b->piece_bytes = lay_out(b, NULL, &(piece){0});
    if (LG_ALLOC_ALL(p->context, {&b->memory, points * b->pieces, b->piece_bytes},
                     LG_ARRAY(b->sums, points * b->pieces * (p->parameters + 1)),
                     LG_ARRAY(b->starts, 2 * points), LG_ARRAY(b->steps, points)) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the runs of a batch");
    b->theta = b->starts + points;
    for (size_t k = 0; k < points; k++) b->steps[k] = b->most;
    return LG_OK;
}

lg_status lg_policy_batch_create(const lg_policy *policy, lg_dtype dtype, size_t points, size_t count,
                                 int threads, lg_policy_batch *b, lg_error *error) {
    memset(b, 0, sizeof *b);
    b->policy = policy, b->dtype = dtype, b->count = count, b->points = points, b->pieces = count / ROWS;
    b->most = lg_policy_periods(policy, policy->task.horizon);
    b->cut = b->bound = INFINITY;
    b->disturbed = lg_policy_is_disturbed(&policy->task);
    b->state = policy->state + (b->disturbed ? policy->inputs : 0);
    const lg_status status = allocate(b, threads, error);
    if (status != LG_OK) lg_policy_batch_destroy(b);
    return status;
}

void lg_policy_batch_destroy(lg_policy_batch *b) {
    if (b->policy == NULL) return;
    const lg_context *context = b->policy->context;
    lg_policy_plans_destroy(&b->plans);
    lg_thread_pool_destroy(b->pool);
    LG_FREE_ALL(context, b->memory, b->sums, b->starts, b->steps);
    memset(b, 0, sizeof *b);
}

lg_status lg_policy_batch_run(lg_policy_batch *b, double *cost, double *const *gradient) {
    const size_t n = b->policy->parameters, pieces = b->points * b->pieces;
    size_t end = pieces;
    b->first = 0;
    if (b->ranks != NULL) lg_ranks_part(b->ranks->rank, b->ranks->count, pieces, &b->first, &end);
    lg_thread_pool_run(b->pool, end - b->first, run_piece, b);
    if (b->ranks != NULL) LG_TRY(lg_ranks_gather_parts(b->ranks, pieces, (n + 1) * sizeof *b->sums, b->sums));
    for (size_t point = 0; point < b->points; point++) {
        cost[point] = 0.0;
        memset(gradient[point], 0, n * sizeof **gradient);
        for (size_t k = 0; k < b->pieces; k++) {
            const double *sum = b->sums + (point * b->pieces + k) * (n + 1);
            cost[point] += sum[n];
            for (size_t i = 0; i < n; i++) gradient[point][i] += sum[i];
        }
    }
    return LG_OK;
}
