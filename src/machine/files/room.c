/* Whether a fit of long windows fits into memory. The bytes of a row are measured in a window of a few
 * thousand rows, with a context that counts. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "files/memory.h"
#include "machine/files/recipe.h"
#include "model/files/training.h"

/* Rows of the longest window that is measured. Windows of up to half as many are not checked. */
enum { MEASURED = 2048 };

/* ---- a context that counts ---- */

typedef struct count {
    size_t now, most; /* bytes */
} count;

/* The size of a block stands in front of it. */
static void *take(void *user, size_t bytes) {
    count *c = user;
    char *block = NULL;
    if (bytes > SIZE_MAX / 2 || posix_memalign((void **)&block, LG_ALIGNMENT, bytes + LG_ALIGNMENT) != 0)
        return NULL;
    memcpy(block, &bytes, sizeof bytes);
    c->now += bytes;
    if (c->now > c->most) c->most = c->now;
    return block + LG_ALIGNMENT;
}

static void give(void *user, void *memory) {
    char *block = (char *)memory - LG_ALIGNMENT;
    size_t bytes;
    memcpy(&bytes, block, sizeof bytes);
    ((count *)user)->now -= bytes;
    free(block);
}

/* ---- how many bytes a fit needs for each row of a window ---- */

/* Runs one epoch of the last phase of the fit. Whether the run is finite does not matter. */
static lg_status run_epoch(const lg_training *self, const lg_context *context,
                           const lg_machine_problem *problem, const double *theta) {
    const lg_machine_model_run *run = self->run;
    lg_fit_problem fit_problem;
    lg_fit_options options;
    lg_fit *fit = NULL;
    lg_machine_fit_problem(problem, &fit_problem);
    lg_fit_options_init(&options);
    lg_fit_settings_apply(&run->training, &options);
    const uint32_t phases = options.plan.phases;
    if (phases > 0) options.plan.phase[0] = options.plan.phase[phases - 1];
    options.plan.phases = phases > 0;
    options.epochs = options.shards = 1;
    options.threads = 1;
    options.validation = options.prior = 0;
    lg_status status = lg_fit_create(context, &fit_problem, &options, theta, &fit, NULL);
    if (status == LG_OK) status = lg_fit_run(fit, NULL);
    lg_fit_destroy(fit);
    return status;
}

/* Bytes while the fit runs, and while the loss is computed or the numbers are judged. */
typedef struct bytes {
    double fit, judge;
} bytes;

/* Bytes of one window of `window` rows. */
static lg_status measure(lg_training *self, uint32_t window, bytes *out, lg_error *error) {
    const lg_machine_model_run *run = self->run;
    lg_machine_problem problem = ((const lg_machine_state *)self->state)->problem;
    count c = {0, 0};
    lg_context_options options;
    lg_context *context = NULL;
    lg_fit_problem fit;
    lg_machine_missing missing;
    lg_rng rng;
    double *theta, loss, floor;
    problem.window = window;
    problem.windows = 1;
    problem.validation = 0;
    LG_TRAINING_ARRAY(self, theta, lg_machine_problem_parameters(&problem), error);
    lg_rng_seed(&rng, run->training.seed, 0);
    lg_machine_initialise(&run->machine, &rng, theta);
    lg_context_options_init(&options);
    options.allocate = take;
    options.release = give;
    options.allocator_user = &c;
    lg_status status = lg_context_create(&options, &context);
    if (status == LG_OK) status = run_epoch(self, context, &problem, theta);
    out->fit = (double)c.most;
    c.most = 0;
    if (status != LG_OUT_OF_MEMORY) status = lg_machine_loss(context, &problem, theta, &loss, &floor, NULL);
    if (status != LG_OUT_OF_MEMORY)
        status = lg_machine_find_missing(context, &problem, theta, &missing, NULL);
    /* The Jacobian, its transpose and the columns that become R (identify.c). */
    lg_machine_fit_problem(&problem, &fit);
    const double jacobian = 3.0 * (double)(run->machine.parameters * fit.rows);
    out->judge = fmax((double)c.most, jacobian * sizeof(double));
    lg_context_destroy(context);
    if (status != LG_OUT_OF_MEMORY) return LG_OK;
    return lg_fail(error, status, "--window %u: there is not even memory for one window of %u rows",
                   run->window, window);
}

/* Bytes of a row, from two windows. */
static lg_status measure_row(lg_training *self, bytes *out, lg_error *error) {
    const lg_machine_model_run *run = self->run;
    const uint32_t rows = run->window < MEASURED ? run->window : MEASURED;
    bytes all, half;
    LG_TRY(measure(self, rows / 2, &half, error));
    LG_TRY(measure(self, rows, &all, error));
    out->fit = (all.fit - half.fit) / (rows - rows / 2);
    out->judge = (all.judge - half.judge) / (rows - rows / 2);
    return LG_OK;
}

/* ---- windows ---- */

/* Bytes of a fit of windows of `window` rows: each shard has a tape with as many windows as are on it at
 * once. */
static double bytes_of(const lg_training *self, bytes row, uint32_t window) {
    enum { SHARDS = 4 };              /* without --shards */
    static const double margin = 1.3; /* the parts of blocks that are not used */
    lg_machine_problem problem = ((const lg_machine_state *)self->state)->problem;
    lg_fit_problem fit;
    const size_t used = problem.windows - problem.validation; /* shorter windows are more */
    const double windows = fmax((double)used, (double)problem.log.rows / window),
                 shards = fmin(windows, self->options.shards > 0 ? self->options.shards : SHARDS);
    problem.window = window;
    lg_machine_fit_problem(&problem, &fit);
    return margin * window * fmin((double)fit.chunk, windows / shards) * (shards * row.fit + row.judge);
}

lg_status lg_machine_check_room(lg_training *self, lg_error *error) {
    const lg_machine_model_run *run = self->run;
    static const double mebibyte = 1 << 20;
    const double left = (double)lg_memory_left();
    uint32_t fits = run->window;
    bytes row;
    if (run->window <= MEASURED / 2) return LG_OK;
    LG_TRY(measure_row(self, &row, error));
    const double needed = bytes_of(self, row, run->window);
    while (fits > 2 && bytes_of(self, row, fits) > left) fits -= fits / 20 + 1;
    if (fits == run->window) return LG_OK;
    return lg_fail(
        error, LG_OUT_OF_MEMORY,
        "--window %u: a fit of windows as long as this needs about %.0f MiB of memory, and %.0f MiB "
        "are left: windows of up to %u rows fit",
        run->window, needed / mebibyte, left / mebibyte, fits);
}
