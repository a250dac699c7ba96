/* Saving and loading the state of a training run. One list names what is stored, for both. */
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "core/stored.h"
#include "nn/fit_internal.h"

/* ---- hyperparameters ---- */

static lg_stored row_of(const char *path, lg_element type, void *number) {
    return (lg_stored){path, type, .data = number};
}

#define WHOLE(name, x) row_of("train/options/" name, LG_ELEMENT_U64, &(uint64_t){(uint64_t)(x)})
#define REAL(name, x)  row_of("train/options/" name, LG_ELEMENT_F64, &(double){x})
#define PHASE(i)                                                                                             \
    WHOLE("phase_" #i "/method", o->plan.phase[i].method),                                                   \
        WHOLE("phase_" #i "/epochs", o->plan.phase[i].epochs)
_Static_assert(LG_FIT_MAX_PHASES == 4, "the list has a row for each phase");

/* Saves the hyperparameters or, with `to` NULL, compares those in `from` with them. */
static lg_status move_hyperparameters(const lg_fit *fit, const lg_archive_writer *to,
                                      const lg_archive_reader *from, lg_error *error) {
    const lg_fit_options *o = &fit->options;
    const lg_stored list[] = {
        WHOLE("parameters", fit->problem.parameters),
        WHOLE("samples", fit->problem.samples),
        WHOLE("dtype", o->dtype),
        WHOLE("epochs", o->epochs),
        WHOLE("batch", fit->batch),
        WHOLE("shards", o->shards),
        WHOLE("seed", o->seed),
        WHOLE("shuffle", o->shuffle),
        WHOLE("keep_best", o->keep_best),
        WHOLE("patience", o->patience),
        WHOLE("decoupled", o->adam.decoupled),
        WHOLE("schedule", o->schedule.kind),
        WHOLE("schedule_every", o->schedule.every),
        REAL("schedule_gamma", o->schedule.gamma),
        REAL("schedule_floor", o->schedule.floor),
        REAL("lr", o->adam.lr),
        REAL("beta1", o->adam.beta1),
        REAL("beta2", o->adam.beta2),
        REAL("eps", o->adam.eps),
        REAL("weight_decay", o->adam.weight_decay),
        REAL("clip_norm", o->clip_norm),
        REAL("validation", o->validation),
        WHOLE("validation_samples", fit->problem.validation),
        REAL("prior", o->prior),
        WHOLE("restarts", o->restarts),
        WHOLE("shards_by_work", fit->by_work),
        WHOLE("plans", fit->plans),
        WHOLE("phases", o->plan.phases),
        PHASE(0),
        PHASE(1),
        PHASE(2),
        PHASE(3),
    };
    return to != NULL ? lg_stored_save(to, list, LG_COUNT(list), error)
                      : lg_stored_compare(from, list, LG_COUNT(list), error);
}

/* A run goes on as it began, by plans or on the tape, so that a resumed run has the same bits. */
static lg_status load_plans(lg_fit *fit, const lg_archive_reader *reader, lg_error *error) {
    uint64_t stored = 0;
    LG_TRY(lg_stored_load(reader, &(lg_stored){"train/options/plans", LG_ELEMENT_U64, .data = &stored}, 1,
                          error));
    fit->plans = stored == 1 && fit->problem.repeats;
    return LG_OK;
}

/* ---- the state as a list of arrays ---- */

enum { SCALARS = 15, ARRAYS = 10 };

/* The scalars, which are read before the arrays, since they say how long the arrays are. `open` stands for
 * s->open as a number. A plan of Adam alone has no phases. */
static void list_scalars(const lg_fit *fit, lg_fit_state *s, uint64_t *open, lg_stored out[SCALARS]) {
    const bool phases = fit->options.plan.phases > 0, restarts = fit->options.restarts > 0;
    const lg_stored list[SCALARS] = {
        {"train/epoch", LG_ELEMENT_U64, .data = &s->epoch},
        {"train/position", LG_ELEMENT_U64, .data = &s->position},
        {"train/open", LG_ELEMENT_U64, .data = open},
        {"train/best_epoch", LG_ELEMENT_U64, .data = &s->best_epoch},
        {"train/running_loss", LG_ELEMENT_F64, .data = &s->running_loss},
        {"train/running_seconds", LG_ELEMENT_F64, .data = &s->running_seconds},
        {"optimizer/adam/step", LG_ELEMENT_U64, .data = &s->step},
        {"train/adam_epochs", LG_ELEMENT_U64, .data = phases ? &s->adam_epochs : NULL},
        {"train/phase", LG_ELEMENT_U64, .data = phases ? &s->phase : NULL},
        {"train/phase_start", LG_ELEMENT_U64, .data = phases ? &s->phase_start : NULL},
        {"train/noise", LG_ELEMENT_F64, .data = phases ? &s->noise : NULL},
        {"train/plateau", LG_ELEMENT_F64, .data = phases ? &s->plateau : NULL},
        {"train/plateau_start", LG_ELEMENT_U64, .data = phases ? &s->plateau_start : NULL},
        {"train/restarts", LG_ELEMENT_U64, .data = restarts ? &s->restarts : NULL},
        {"train/restart_seconds", LG_ELEMENT_F64, .data = restarts ? &s->lost_seconds : NULL},
    };
    memcpy(out, list, sizeof list);
}

/* Whether the current phase has a minimiser that has made an evaluation. */
static bool has_minimiser(const lg_fit *fit, const lg_fit_state *s) {
    return !lg_fit_method_batches(lg_fit_method_of(fit, s->phase)) && s->epoch > s->phase_start;
}

#define SERIES(path, i)                                                                                      \
    { path, LG_ELEMENT_F64, 1, {epochs}, .data = epochs > 0 ? s->history[i] : NULL }
static void list_arrays(const lg_fit *fit, lg_fit_state *s, lg_stored out[ARRAYS]) {
    const lg_element type = fit->options.dtype == LG_F64 ? LG_ELEMENT_F64 : LG_ELEMENT_F32;
    const uint64_t n = fit->problem.parameters, epochs = s->epoch;
    const lg_stored list[ARRAYS] = {
        {"optimizer/parameters", type, 1, {n}, .data = s->theta},
        {"optimizer/adam/m", type, 1, {n}, .data = s->m},
        {"optimizer/adam/v", type, 1, {n}, .data = s->v},
        {"rng", LG_ELEMENT_U64, 1, {4}, .data = s->rng.s},
        {"train/permutation", LG_ELEMENT_U32, 1, {fit->problem.samples}, .data = s->order},
        {"optimizer/best", type, 1, {n}, .data = epochs > 0 ? s->best : NULL},
        SERIES("train/history/loss", LG_FIT_LOSS),
        SERIES("train/history/validation", LG_FIT_VALIDATION),
        SERIES("train/history/seconds", LG_FIT_SECONDS),
        SERIES("train/history/rate", LG_FIT_RATE),
    };
    memcpy(out, list, sizeof list);
}

lg_status lg_fit_save(const lg_fit *fit, const lg_archive_writer *writer, lg_error *error) {
    LG_NEEDS(error, fit, writer);
    lg_fit_state copy = fit->state; /* shares the arrays with fit->state, which are only read */
    uint64_t open = copy.open;
    lg_stored items[SCALARS + ARRAYS];
    list_scalars(fit, &copy, &open, items);
    list_arrays(fit, &copy, items + SCALARS);
    LG_TRY(move_hyperparameters(fit, writer, NULL, error));
    LG_TRY(lg_stored_save(writer, items, LG_COUNT(items), error));
    return has_minimiser(fit, &copy) ? lg_minimiser_save(copy.minimiser, writer, error) : LG_OK;
}

/* ---- what a state must satisfy ---- */

static lg_status check_scalars(const lg_fit *fit, const lg_fit_state *s, uint64_t open, lg_error *error) {
    const uint64_t batches = lg_fit_batches(fit, fit->training);
    const uint32_t phases = fit->options.plan.phases;
    if (!(s->phase < (phases > 0 ? phases : 1) && s->phase_start <= s->epoch && s->adam_epochs <= s->epoch))
        return lg_fail(error, LG_FORMAT, "train/phase does not fit the plan of methods");
    const bool cut = lg_fit_method_batches(lg_fit_method_of(fit, s->phase));
    const lg_rule rules[] = {
        {s->epoch <= fit->options.epochs, "train/epoch is larger than the planned epochs"},
        {s->position <= fit->training, "train/position is larger than the training part"},
        {s->position % fit->batch == 0 || s->position == fit->training,
         "train/position is not at the end of a batch"},
        {open <= 1 && (open == 1 || s->position == 0), "train/open does not fit train/position"},
        {s->epoch < fit->options.epochs || open == 0, "train/open is set after the last epoch"},
        {s->best_epoch <= s->epoch && (s->best_epoch > 0) == (s->epoch > 0),
         "train/best_epoch does not fit train/epoch"},
        {cut || (s->position == 0 && open == 0), "train/position is set in a phase without batches"},
        {isfinite(s->noise) && s->noise >= 0.0, "train/noise is negative or not finite"},
        {isfinite(s->running_loss), "train/running_loss is not finite"},
        {isfinite(s->running_seconds), "train/running_seconds is not finite"},
        {s->restarts <= fit->options.restarts, "train/restarts is larger than the option restarts"},
        {isfinite(s->lost_seconds) && s->lost_seconds >= 0.0,
         "train/restart_seconds is negative or not finite"},
    };
    LG_TRY(lg_check_rules(rules, LG_COUNT(rules), LG_FORMAT, error));
    if (s->step != s->adam_epochs * batches + lg_fit_batches(fit, s->position))
        return lg_fail(error, LG_FORMAT,
                       "optimizer/adam/step is %" PRIu64 ", which does not fit train/epoch and "
                       "train/position",
                       s->step);
    return LG_OK;
}

static lg_status check_permutation(const lg_fit *fit, const uint32_t *order, lg_error *error) {
    const size_t n = fit->problem.samples;
    bool *seen = lg_alloc(fit->context, n, sizeof *seen);
    if (seen == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory to check train/permutation");
    size_t i = 0;
    while (i < n && order[i] < n && !seen[order[i]]) seen[order[i++]] = true;
    lg_free(fit->context, seen);
    if (i < n)
        return lg_fail(error, LG_FORMAT, "train/permutation is not a permutation: entry %zu is %" PRIu32, i,
                       order[i]);
    for (i = n - fit->problem.validation; i < n; i++)
        if (order[i] != i)
            return lg_fail(
                error, LG_FORMAT,
                "train/permutation moves sample %zu of the validation part, which must stay in place", i);
    return LG_OK;
}

static bool all_not_negative(const lg_fit *fit, const void *x) {
    for (size_t i = 0; i < fit->problem.parameters; i++) {
        double value = 0.0;
        fit->k->convert_out(1, (const char *)x + i * fit->k->size, &value);
        if (!(value >= 0.0)) return false;
    }
    return true;
}

static lg_status check_arrays(const lg_fit *fit, const lg_fit_state *s, lg_error *error) {
    const size_t n = fit->problem.parameters, epochs = (size_t)s->epoch;
    const lg_kernels *real = lg_kernels_for(LG_F64);
    const bool validated = fit->training < fit->problem.samples;
    const lg_rule rules[] = {
        {fit->k->all_finite(n, s->theta), "optimizer/parameters is not finite"},
        {fit->k->all_finite(n, s->m), "optimizer/adam/m is not finite"},
        {fit->k->all_finite(n, s->v) && all_not_negative(fit, s->v),
         "optimizer/adam/v is not finite or negative"},
        {fit->k->all_finite(n, s->best), "optimizer/best is not finite"},
        {(s->rng.s[0] | s->rng.s[1] | s->rng.s[2] | s->rng.s[3]) != 0, "rng is all zeros"},
        {real->all_finite(epochs, s->history[LG_FIT_LOSS]), "train/history/loss is not finite"},
        {!validated || real->all_finite(epochs, s->history[LG_FIT_VALIDATION]),
         "train/history/validation is not finite"},
    };
    LG_TRY(lg_check_rules(rules, LG_COUNT(rules), LG_FORMAT, error));
    return check_permutation(fit, s->order, error);
}

static lg_status load_minimiser(const lg_fit *fit, const lg_archive_reader *reader, lg_fit_state *s,
                                lg_error *error) {
    const lg_minimise_options options = lg_fit_minimise_options(fit, s->phase);
    LG_TRY(
        lg_minimiser_create(fit->context, fit->problem.parameters, &options, s->theta, &s->minimiser, error));
    return lg_minimiser_load(s->minimiser, reader, error);
}

static lg_status load_state(const lg_fit *fit, const lg_archive_reader *reader, lg_fit_state *s,
                            lg_error *error) {
    uint64_t open = 0;
    lg_stored scalars[SCALARS], arrays[ARRAYS];
    list_scalars(fit, s, &open, scalars);
    LG_TRY(lg_stored_load(reader, scalars, SCALARS, error));
    if (fit->options.plan.phases == 0) s->adam_epochs = s->epoch;
    LG_TRY(check_scalars(fit, s, open, error));
    s->open = open == 1;
    list_arrays(fit, s, arrays);
    LG_TRY(lg_stored_load(reader, arrays, ARRAYS, error));
    LG_TRY(check_arrays(fit, s, error));
    return has_minimiser(fit, s) ? load_minimiser(fit, reader, s, error) : LG_OK;
}

lg_status lg_fit_load(lg_fit *fit, const lg_archive_reader *reader, lg_error *error) {
    LG_NEEDS(error, fit, reader);
    lg_fit_state loaded = {0};
    lg_status made = load_plans(fit, reader, error);
    if (made == LG_OK) made = move_hyperparameters(fit, NULL, reader, error);
    if (made == LG_OK && lg_fit_state_create(fit, &loaded) != LG_OK)
        made = lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the saved state");
    LG_TRY(lg_fit_agree(fit, made, error));
    const lg_status status = lg_fit_agree(fit, load_state(fit, reader, &loaded, error), error);
    if (status != LG_OK) {
        lg_fit_state_destroy(fit, &loaded);
        return status;
    }
    lg_fit_state_destroy(fit, &fit->state);
    fit->state = loaded;
    fit->spent = loaded.lost_seconds;
    for (uint64_t i = 0; i < loaded.epoch; i++) fit->spent += loaded.history[LG_FIT_SECONDS][i];
    return LG_OK;
}
