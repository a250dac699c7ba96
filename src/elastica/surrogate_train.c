/* Training problems of the surrogates. Mirroring and normalisation are applied to the numbers of a batch
 * before they enter the tape. */
#include "core/core.h"
#include "liegrad/ops.h"
#include "elastica/surrogate_loss.h"

typedef lg_loss_part part;

/* The loss of each kind of network. The number of points that are on a tape at once is small enough that the
 * values stay in the L2 cache. */
static const struct learned {
    lg_var (*loss)(const part *b, lg_var theta);
    size_t places; /* number of points of a network of s that are on a tape at once */
} learned[LG_SURROGATE_KIND_COUNT] = {
    [LG_SURROGATE_DISCRETE] = {lg_loss_discrete, 0},
    [LG_SURROGATE_CONTINUOUS] = {lg_loss_continuous, 128},
    [LG_SURROGATE_ANGLE] = {lg_loss_angle, 402},
};

/* Number of samples with so many points; 0, the default, for the discrete network. */
static size_t chunk_of(const lg_surrogate_problem *problem) {
    const lg_surrogate *model = problem->model;
    const size_t n = problem->curves->intervals, places = learned[model->options.kind].places;
    const size_t each = lg_loss_samples_are_points(model)                ? 1
                        : model->options.kind == LG_SURROGATE_CONTINUOUS ? n + 1
                                                                         : 4 * n + 1;
    return places == 0 ? 0 : places < each ? 1 : places / each;
}

/* Records the share of these samples in the loss of the batch: their mean times count/batch. */
static lg_status shard_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                            size_t batch, lg_var *loss) {
    const lg_surrogate_problem *problem = user;
    const part b = {problem, tape, samples, count};
    lg_var mean = learned[problem->model->options.kind].loss(&b, theta);
    *loss = count == batch ? mean : lg_scale(tape, mean, (double)count / (double)batch);
    return lg_tape_status(tape);
}

static size_t sample_count(const lg_surrogate_problem *problem) {
    return problem->training_count *
           (lg_loss_samples_are_points(problem->model) ? (size_t)problem->curves->intervals + 1 : 1);
}

lg_status lg_surrogate_problem_check(const lg_surrogate_problem *problem, lg_error *error) {
    LG_NEEDS(error, problem);
    const lg_elastica_curves *curves = problem->curves;
    if (problem->model == NULL || curves == NULL || problem->training == NULL ||
        problem->training_count == 0 || curves->boundary == NULL || curves->q == NULL || curves->v == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the problem has no model, no curves, or nothing to learn from");
    if (curves->intervals < LG_ELASTICA_MIN_INTERVALS || curves->intervals > LG_ELASTICA_MAX_INTERVALS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the curves have %u intervals; %d to %d are possible",
                       curves->intervals, LG_ELASTICA_MIN_INTERVALS, LG_ELASTICA_MAX_INTERVALS);
    LG_TRY(lg_surrogate_check_curves(problem->model, curves, error));
    LG_TRY(lg_surrogate_check_modes(problem->model, error));
    if (problem->model->options.modes > 0 && problem->model->options.gamma == 0.0 &&
        problem->coefficients == NULL)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "a network of modes learns coefficients: compute them first with lg_surrogate_coefficients");
    for (size_t i = 0; i < problem->training_count; i++)
        if (problem->training[i] >= curves->count)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "there is no curve %u (counted from 0) to learn: there are %zu curves",
                           problem->training[i], curves->count);
    const uint64_t per_curve = sample_count(problem) / problem->training_count;
    if (problem->training_count > UINT32_MAX / per_curve)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%zu curves of %llu samples are 2^32 samples or more",
                       problem->training_count, (unsigned long long)per_curve);
    return LG_OK;
}

void lg_surrogate_fit_problem(const lg_surrogate_problem *problem, lg_fit_problem *out) {
    *out = (lg_fit_problem){.parameters = lg_surrogate_parameters(problem->model),
                            .samples = sample_count(problem),
                            .loss = shard_loss,
                            .user = (void *)(uintptr_t)problem, /* never written */
                            .chunk = chunk_of(problem)};
}
