/* Policies: runs from random starts, and what they show. */
#include <math.h>
#include <string.h>

#include "control/policy.h"
#include "core/median.h"

/* Wilson's interval for k of n, 95 %. */
static void interval(uint64_t k, uint64_t n, double *low, double *high) {
    static const double z = 1.959963984540054;
    const double share = (double)k / (double)n, N = (double)n, by = 1.0 + z * z / N;
    const double centre = share + z * z / (2.0 * N),
                 half = z * sqrt(share * (1.0 - share) / N + z * z / (4.0 * N * N));
    *low = fmax((centre - half) / by, 0.0), *high = fmin((centre + half) / by, 1.0); /* but for rounding */
}

static void summarise(const lg_policy_runs *runs, double *sorted, lg_policy_outcome *out) {
    const size_t n = runs->count;
    *out = (lg_policy_outcome){.starts = n, .worst = -INFINITY};
    for (size_t i = 0; i < n; i++) {
        const double cost = isfinite(runs->cost[i]) ? runs->cost[i] : INFINITY;
        out->succeeded += runs->succeeded[i];
        out->cost_mean += cost / (double)n;
        out->saturated += runs->saturated[i] / (double)n;
        sorted[i] = cost;
        if (cost > out->worst) out->worst = cost, out->worst_start = i;
    }
    out->cost_median = lg_median(sorted, n);
    interval(out->succeeded, n, &out->success_low, &out->success_high);
}

lg_status lg_policy_try(const lg_policy *p, const lg_policy_trial *trial, const double *x, size_t n,
                        lg_policy_outcome *out, lg_policy_runs *wanted, lg_error *error) {
    LG_TRY_SCRATCH(double, memory, p->context, n *(p->state + 3), lg_no_memory(error));
    LG_TRY_SCRATCH(bool, held, p->context, n, lg_no_memory(error));
    lg_policy_runs runs = wanted != NULL ? *wanted : (lg_policy_runs){.count = 0};
    runs.count = n, runs.steps = lg_policy_periods(p, p->task.within);
    runs.x = memcpy(memory, x, n * p->state * sizeof *x);
    if (runs.cost == NULL) runs.cost = memory + n * p->state;
    if (runs.saturated == NULL) runs.saturated = memory + n * (p->state + 1);
    if (runs.succeeded == NULL) runs.succeeded = held;
    LG_TRY(lg_policy_run(p, trial, &runs, error));
    summarise(&runs, memory + n * (p->state + 2), out);
    if (wanted == NULL) return LG_OK;
    wanted->count = n, wanted->steps = runs.steps;
    if (wanted->x != NULL) memcpy(wanted->x, runs.x, n * p->state * sizeof *runs.x);
    return LG_OK;
}

lg_status lg_policy_evaluate(const lg_policy *p, lg_policy_test test, uint64_t starts, uint64_t seed,
                             int threads, lg_policy_outcome *out, lg_policy_runs *wanted, lg_error *error) {
    if (p == NULL || out == NULL || starts == 0 || starts > 10000000)
        return lg_fail(error, LG_INVALID_ARGUMENT, "an evaluation needs a policy and 1 to 10000000 starts");
    if (test == LG_POLICY_DISTURBED && !lg_policy_is_disturbed(&p->task))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the policy's task has no disturbances");
    const lg_policy_trial trial = {.gain = test == LG_POLICY_REGULATED ? p->regulator.K : NULL,
                                   .theta = p->theta,
                                   .disturbed = test == LG_POLICY_DISTURBED,
                                   .seed = seed,
                                   .threads = threads};
    lg_rng rng;
    LG_TRY_SCRATCH(double, x, p->context, (size_t)starts * p->state, lg_no_memory(error));
    lg_rng_seed(&rng, seed, 0);
    LG_TRY(lg_policy_starts(p, &rng, (size_t)starts, x, NULL, error));
    return lg_policy_try(p, &trial, x, (size_t)starts, out, wanted, error);
}
