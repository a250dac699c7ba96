/* Saving and loading the state of a training run. One list names what is stored, for both. */
#include <inttypes.h>
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

/* ---- the state as a list of numbers and arrays ---- */

enum { SCALARS = 15, ITEMS = 25 };

/* The scalars are read before the arrays, since they say how long the arrays are. A plan of Adam alone has no
 * phases. */
static void list_state(const lg_fit *fit, lg_fit_state *s, lg_stored out[ITEMS]) {
    const bool phases = fit->options.plan.phases > 0, restarts = fit->options.restarts > 0,
               begun = s->epoch > 0, validated = fit->training < fit->problem.samples;
    const lg_element type = fit->options.dtype == LG_F64 ? LG_ELEMENT_F64 : LG_ELEMENT_F32;
    const uint64_t n = fit->problem.parameters;
#define SERIES(path, i, must)                                                                                \
    { path, LG_ELEMENT_F64, 1, {s->epoch}, begun ? s->history[i] : NULL, .finite = must }
    const lg_stored list[ITEMS] = {
        {"train/epoch", LG_ELEMENT_U64, .data = &s->epoch},
        {"train/position", LG_ELEMENT_U64, .data = &s->position},
        {"train/open", LG_ELEMENT_U64, .data = &s->open},
        {"train/best_epoch", LG_ELEMENT_U64, .data = &s->best_epoch},
        {"train/running_loss", LG_ELEMENT_F64, .data = &s->running_loss, .finite = true},
        {"train/running_seconds", LG_ELEMENT_F64, .data = &s->running_seconds, .finite = true},
        {"optimizer/adam/step", LG_ELEMENT_U64, .data = &s->step},
        {"train/adam_epochs", LG_ELEMENT_U64, .data = phases ? &s->adam_epochs : NULL},
        {"train/phase", LG_ELEMENT_U64, .data = phases ? &s->phase : NULL},
        {"train/phase_start", LG_ELEMENT_U64, .data = phases ? &s->phase_start : NULL},
        {"train/noise", LG_ELEMENT_F64, .data = phases ? &s->noise : NULL, .not_negative = true},
        {"train/plateau", LG_ELEMENT_F64, .data = phases ? &s->plateau : NULL},
        {"train/plateau_start", LG_ELEMENT_U64, .data = phases ? &s->plateau_start : NULL},
        {"train/restarts", LG_ELEMENT_U64, .data = restarts ? &s->restarts : NULL},
        {"train/restart_seconds", LG_ELEMENT_F64, .data = restarts ? &s->lost_seconds : NULL,
         .not_negative = true},
        {"optimizer/parameters", type, 1, {n}, s->theta, .finite = true},
        {"optimizer/adam/m", type, 1, {n}, s->m, .finite = true},
        {"optimizer/adam/v", type, 1, {n}, s->v, .not_negative = true},
        {"rng", LG_ELEMENT_U64, 1, {4}, .data = s->rng.s},
        {"train/permutation", LG_ELEMENT_U32, 1, {fit->problem.samples}, .data = s->order},
        {"optimizer/best", type, 1, {n}, begun ? s->best : NULL, .finite = true},
        SERIES("train/history/loss", LG_FIT_LOSS, true),
        SERIES("train/history/validation", LG_FIT_VALIDATION, validated),
        SERIES("train/history/seconds", LG_FIT_SECONDS, false),
        SERIES("train/history/rate", LG_FIT_RATE, false),
    };
#undef SERIES
    memcpy(out, list, sizeof list);
}

/* Whether the current phase has a minimiser that has made an evaluation. */
static bool has_minimiser(const lg_fit *fit, const lg_fit_state *s) {
    return !lg_fit_method_batches(lg_fit_method_of(fit, s->phase)) && s->epoch > s->phase_start;
}

lg_status lg_fit_save(const lg_fit *fit, const lg_archive_writer *writer, lg_error *error) {
    LG_NEEDS(error, fit, writer);
    lg_fit_state copy = fit->state; /* shares the arrays with fit->state, which are only read */
    lg_stored items[ITEMS];
    list_state(fit, &copy, items);
    LG_TRY(move_hyperparameters(fit, writer, NULL, error));
    LG_TRY(lg_stored_save(writer, items, ITEMS, error));
    return has_minimiser(fit, &copy) ? lg_minimiser_save(copy.minimiser, writer, error) : LG_OK;
}

/* ---- what a state must satisfy ---- */

static lg_status check_scalars(const lg_fit *fit, const lg_fit_state *s, lg_error *error) {
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
        {s->open <= 1 && (s->open == 1 || s->position == 0), "train/open does not fit train/position"},
        {s->epoch < fit->options.epochs || s->open == 0, "train/open is set after the last epoch"},
        {s->best_epoch <= s->epoch && (s->best_epoch > 0) == (s->epoch > 0),
         "train/best_epoch does not fit train/epoch"},
        {cut || (s->position == 0 && s->open == 0), "train/position is set in a phase without batches"},
        {s->restarts <= fit->options.restarts, "train/restarts is larger than the option restarts"},
        {s->step == s->adam_epochs * batches + lg_fit_batches(fit, s->position),
         "optimizer/adam/step does not fit train/epoch and train/position"},
    };
    return lg_check_rules(rules, LG_COUNT(rules), LG_FORMAT, error);
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

static lg_status load_state(const lg_fit *fit, const lg_archive_reader *reader, lg_fit_state *s,
                            lg_error *error) {
    lg_stored items[ITEMS];
    list_state(fit, s, items);
    LG_TRY(lg_stored_load(reader, items, SCALARS, error));
    if (fit->options.plan.phases == 0) s->adam_epochs = s->epoch;
    LG_TRY(check_scalars(fit, s, error));
    list_state(fit, s, items);
    LG_TRY(lg_stored_load(reader, items + SCALARS, ITEMS - SCALARS, error));
    if ((s->rng.s[0] | s->rng.s[1] | s->rng.s[2] | s->rng.s[3]) == 0)
        return lg_fail(error, LG_FORMAT, "rng is all zeros");
    LG_TRY(check_permutation(fit, s->order, error));
    if (!has_minimiser(fit, s)) return LG_OK;
    LG_TRY(lg_fit_create_minimiser(fit, s, error));
    return lg_minimiser_load(s->minimiser, reader, error);
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
