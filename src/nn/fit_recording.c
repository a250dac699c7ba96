/* Losses as plans: the loss of a chunk and its gradient are recorded once for each number of samples, and
 * made a plan. For further chunks the loss is recorded again on the same tape, which computes nothing and
 * only brings the new samples' data, and the plan runs. Chunks whose recordings differ have plans of their
 * own, so that the bits of a chunk do not depend on which chunks came before. */
#include "autodiff/program/program_tape.h"
#include "autodiff/tape/tape_internal.h"
#include "nn/fit_internal.h"

enum { LOSS, GRADIENT, OUTPUTS };

struct lg_fit_recording {
    size_t count; /* samples; 0: free */
    lg_tape *tape;
    lg_var loss;
    lg_plan *plan;
    void *data, *work;
};

static void clear(const lg_fit *fit, lg_fit_recording *r) {
    lg_plan_destroy(r->plan);
    lg_tape_destroy(r->tape);
    lg_free(fit->context, r->work);
    *r = (lg_fit_recording){0};
}

void lg_fit_recordings_destroy(const lg_fit *fit, lg_shard *shard) {
    for (size_t i = 0; shard->recordings != NULL && i < LG_FIT_RECORDINGS; i++)
        clear(fit, &shard->recordings[i]);
    LG_FREE_ALL(fit->context, shard->recordings, shard->part);
}

size_t lg_fit_recordings_size(const lg_shard *shard, size_t *plans) {
    size_t bytes = 0;
    *plans = 0;
    for (size_t i = 0; shard->recordings != NULL && i < LG_FIT_RECORDINGS; i++) {
        const lg_fit_recording *r = &shard->recordings[i];
        if (r->count == 0) continue;
        bytes += lg_tape_size(r->tape) + lg_plan_work_size(r->plan);
        ++*plans;
    }
    return bytes;
}

lg_status lg_fit_record(const lg_fit_problem *problem, lg_tape *tape, const void *point, bool residuals,
                        const uint32_t *samples, size_t count, size_t batch, lg_var *theta, lg_var *out) {
    const bool loss = problem->loss != NULL && !residuals;
    *theta = lg_parameter(tape, lg_shape1((uint32_t)problem->parameters), point);
    const lg_status status =
        (loss ? problem->loss : problem->residuals)(problem->user, tape, *theta, samples, count, batch, out);
    if (status == LG_OK && !loss && !residuals) *out = lg_sum(tape, lg_square(tape, *out));
    LG_TRY(lg_tape_status(tape));
    return status;
}

static lg_status record(const lg_fit *fit, lg_tape *tape, const uint32_t *samples, size_t count,
                        lg_var *theta, lg_var *loss) {
    return lg_fit_record(&fit->problem, tape, fit->point, false, samples, count, fit->batch_samples, theta,
                         loss);
}

static lg_status make(const lg_fit *fit, lg_fit_recording *r, const uint32_t *samples, size_t count) {
    lg_tape_options options;
    lg_tape_options_init(&options);
    options.dtype = fit->options.dtype;
    options.max_size = fit->options.max_tape_size;
    LG_TRY(lg_tape_create(fit->context, &options, &r->tape));
    lg_tape_set_dry(r->tape);
    lg_var theta, out[OUTPUTS];
    LG_TRY(record(fit, r->tape, samples, count, &theta, &r->loss));
    LG_TRY(lg_grad(r->tape, r->loss, &theta, 1, &out[GRADIENT]));
    out[LOSS] = r->loss;
    LG_TRY(lg_plan_of_tape(r->tape, theta, out, OUTPUTS, count, &r->plan, &r->data, NULL));
    r->work = lg_alloc(fit->context, lg_plan_work_size(r->plan), 1);
    r->count = count;
    return r->work != NULL ? LG_OK : LG_OUT_OF_MEMORY;
}

/* Records the samples' loss on r's tape again, which writes their data to r->data. Returns true if the
 * recording is the same as r's recording. */
static bool repeats(const lg_fit *fit, lg_fit_recording *r, const uint32_t *samples) {
    lg_var theta, loss = LG_NONE;
    lg_tape_repeat(r->tape);
    return record(fit, r->tape, samples, r->count, &theta, &loss) == LG_OK && loss.index == r->loss.index;
}

/* Sets *out to the recording of these samples' loss, and writes their data to (*out)->data. Sets *out to NULL
 * if no plan can compute the loss. */
static lg_status bring(const lg_fit *fit, lg_shard *shard, const uint32_t *samples, size_t count,
                       lg_fit_recording **out) {
    *out = NULL;
    if (shard->part == NULL)
        LG_TRY(LG_ALLOC_ALL(fit->context, {&shard->part, fit->problem.parameters, fit->k->size}));
    if (shard->recordings == NULL)
        LG_TRY(LG_ALLOC_ALL(fit->context, LG_ARRAY(shard->recordings, LG_FIT_RECORDINGS)));
    for (size_t i = 0; i < LG_FIT_RECORDINGS; i++) {
        lg_fit_recording *r = &shard->recordings[i];
        if (r->count != count || !repeats(fit, r, samples)) continue;
        *out = r;
        return LG_OK;
    }
    lg_fit_recording *r = &shard->recordings[shard->next++ % LG_FIT_RECORDINGS];
    clear(fit, r);
    const lg_status status = make(fit, r, samples, count);
    if (status == LG_OK)
        *out = r;
    else
        clear(fit, r);
    return status == LG_OUT_OF_MEMORY ? status : LG_OK;
}

lg_status lg_fit_run_recording(const lg_fit *fit, lg_shard *shard, const uint32_t *samples, size_t count,
                               bool *done) {
    lg_fit_recording *r;
    LG_TRY(bring(fit, shard, samples, count, &r));
    *done = r != NULL;
    if (r == NULL) return LG_OK;
    const bool first = samples == shard->samples;
    double loss, value; /* loss: of the fit's type */
    const void *const in[] = {fit->point, r->data};
    void *const out[OUTPUTS] = {&loss, first ? shard->gradient : shard->part};
    lg_plan_eval(r->plan, in, out, r->work);
    if (!first) fit->k->axpy(fit->problem.parameters, 1.0, shard->part, shard->gradient);
    fit->k->convert_out(1, &loss, &value);
    shard->loss += value;
    return LG_OK;
}
