/* Whether a fit of long windows fits into memory. The bytes of a row are measured in windows of a hundred
 * rows or two, with a context that counts. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/memory.h"
#include "machine/files/recipe.h"

/* Rows of the longest window that is measured. Windows of up to as many are not checked. */
enum { MEASURED = 256 };

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

/* Runs one epoch of the last phase of the fit, by plans or on the tape. Whether the run is finite does not
 * matter. */
static lg_status run_epoch(const lg_training *self, const lg_context *context,
                           const lg_machine_problem *problem, bool plans, const double *theta) {
    const lg_machine_model_run *run = self->run;
    lg_fit_problem fit_problem;
    lg_fit_options options;
    LG_CLEAN(lg_fit_destroy_at) lg_fit *fit = NULL;
    lg_machine_fit_problem(problem, &fit_problem);
    fit_problem.repeats = plans;
    lg_fit_options_init(&options);
    lg_fit_settings_apply(&run->training, &options);
    const uint32_t phases = options.plan.phases;
    if (phases > 0) options.plan.phase[0] = options.plan.phase[phases - 1];
    options.plan.phases = phases > 0;
    options.epochs = options.shards = 1;
    options.threads = 1;
    options.validation = options.prior = 0;
    options.batch = 0;
    LG_TRY(lg_fit_create(context, &fit_problem, &options, theta, &fit, NULL));
    return lg_fit_run(fit, NULL);
}

/* Computes the loss and looks for missing forces, as after a fit. */
static lg_status judge(const lg_context *context, const lg_machine_problem *problem, const double *theta) {
    double loss, floor;
    lg_machine_missing missing;
    const lg_status status = lg_machine_loss(context, problem, theta, &loss, &floor, NULL);
    return status == LG_OUT_OF_MEMORY ? status
                                      : lg_machine_find_missing(context, problem, theta, &missing, NULL);
}

/* What is measured: a fit by plans, a fit on the tape, and what comes after a fit, of one window and of
 * several at once. */
enum { PLANNED, TAPED, JUDGED, TAPED_TOGETHER, JUDGED_TOGETHER, WAYS, TOGETHER = 16 };

/* Bytes of windows of `window` rows; several windows are the same one. */
static lg_status measure(lg_training *self, int way, uint32_t window, double *bytes, lg_error *error) {
    const lg_machine_model_run *run = self->run;
    lg_machine_problem problem = lg_machine_state_of(self)->problem;
    const bool judged = way == JUDGED || way == JUDGED_TOGETHER;
    size_t start[TOGETHER];
    count c = {0, 0};
    lg_fit_problem fit;
    lg_context_options options;
    lg_context *context = NULL;
    lg_rng rng;
    double *theta;
    problem.window = window;
    problem.windows = way >= TAPED_TOGETHER ? TOGETHER : 1;
    for (size_t i = 0; i < TOGETHER; i++) start[i] = problem.start[0];
    problem.start = start;
    problem.validation = 0;
    LG_TRAINING_ARRAY(self, theta, lg_machine_problem_parameters(&problem), error);
    lg_rng_seed(&rng, run->training.seed, 0);
    lg_machine_initialise(&run->machine, &rng, theta);
    lg_context_options_init(&options);
    options.allocate = take;
    options.release = give;
    options.allocator_user = &c;
    lg_status status = lg_context_create(&options, &context);
    if (status == LG_OK)
        status = judged ? judge(context, &problem, theta)
                        : run_epoch(self, context, &problem, way == PLANNED, theta);
    lg_context_destroy(context);
    /* The Jacobian, its transpose and the columns that become R (identify.c). */
    lg_machine_fit_problem(&problem, &fit);
    const double jacobian = 3.0 * (double)(problem.machine->parameters * fit.rows) * sizeof(double);
    *bytes = judged ? fmax((double)c.most, jacobian) : (double)c.most;
    if (status != LG_OUT_OF_MEMORY) return LG_OK;
    return lg_fail(error, status, "--window %u: there is not even memory for one window of %u rows",
                   run->window, window);
}

/* Bytes of a row, from windows of two lengths. The longer one is the window halved a few times: then arrays
 * that double are as full as they will be. */
static lg_status measure_row(lg_training *self, double row[WAYS], lg_error *error) {
    const lg_machine_model_run *run = self->run;
    uint32_t rows = run->window;
    while (rows > MEASURED) rows /= 2;
    for (int way = 0; way < WAYS; way++) {
        double all = 0, half = 0;
        LG_TRY(measure(self, way, rows / 2, &half, error));
        LG_TRY(measure(self, way, rows, &all, error));
        row[way] = fmax(all - half, 0.0) / (rows - rows / 2);
    }
    return LG_OK;
}

/* ---- windows ---- */

/* Returns the bytes of this many windows. One window takes `one` bytes and TOGETHER windows take `together`
 * bytes: windows share the operations, and each has its own values. */
static double bytes_together(double one, double together, double windows) {
    return one + fmax(together - one, 0.0) / (TOGETHER - 1) * (windows - 1.0);
}

/* Returns the bytes of a fit of windows of `window` rows. Each shard has a tape with as many windows as are
 * on it at once, and a plan if this has not too many operations. */
static double bytes_of(const lg_training *self, const double row[WAYS], uint32_t window) {
    enum {
        SHARDS = 4,           /* without --shards */
        PLAN_OPERATION = 512, /* most bytes of an operation of a plan */
    };
    static const double margin = 1.3; /* the parts of blocks that are not used */
    lg_machine_problem problem = lg_machine_state_of(self)->problem;
    lg_fit_problem fit;
    const size_t used = problem.windows - problem.validation; /* shorter windows are more */
    const double windows = fmax((double)used, (double)problem.log.rows / window),
                 shards = fmin(windows, self->options.shards > 0 ? self->options.shards : SHARDS);
    problem.window = window;
    lg_machine_fit_problem(&problem, &fit);
    const double together = fmin((double)fit.chunk, windows / shards),
                 taped = bytes_together(row[TAPED], row[TAPED_TOGETHER], together),
                 judged = bytes_together(row[JUDGED], row[JUDGED_TOGETHER], together),
                 plan = fmin(window * fmax(row[PLANNED] - row[TAPED], 0.0),
                             (double)LG_PROGRAM_MAX_NODES * PLAN_OPERATION);
    return margin * (shards * (window * taped + plan) + window * judged);
}

lg_status lg_machine_check_room(lg_training *self, lg_error *error) {
    const lg_machine_model_run *run = self->run;
    static const double mebibyte = 1 << 20;
    const double left = (double)lg_memory_left();
    uint32_t fits = run->window;
    double row[WAYS];
    if (run->window <= MEASURED) return LG_OK;
    LG_TRY(measure_row(self, row, error));
    const double needed = bytes_of(self, row, run->window);
    while (fits > 2 && bytes_of(self, row, fits) > left) fits -= fits / 20 + 1;
    if (fits == run->window) return LG_OK;
    return lg_fail(
        error, LG_OUT_OF_MEMORY,
        "--window %u: a fit of windows as long as this needs about %.0f MiB of memory, and %.0f MiB "
        "are left: windows of up to %u rows fit",
        run->window, needed / mebibyte, left / mebibyte, fits);
}
