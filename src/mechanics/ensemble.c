/* Ensembles: threads take blocks of members. A block is integrated on lanes, or one member at a time. */
#include "liegrad/ensemble.h"

#include <float.h>
#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "core/portions.h"
#include "integrators/groups.h"
#include "integrators/stepper.h"
#include "mechanics/ensemble_member.h"

/* Memory of one thread. */
typedef struct worker {
    lg_system *system; /* has the parameters of the current member */
    lg_lane_block block;
    double *own_start, *own_parameter; /* of the current member */
    double *projected;                 /* (dim) */
    size_t groups, *group_end;         /* groups of the state (integrators/groups.h) */
    unsigned char *refused;            /* (room): whether a start or its parameters are rejected */
    void *memory;
    lg_one_by_one one; /* used if lanes are not */
    uint64_t attempts, vectors, failed, steps, rejected;
} worker;

typedef struct ensemble {
    const lg_context *context;
    const lg_system *system;
    lg_lane_plan plan;
    const lg_lane_table *lanes; /* NULL: one member at a time */
    lg_ensemble_start draw;
    lg_ensemble_keep keep;
    void *draw_user, *keep_user;
    size_t room;
    uint64_t blocks;
    worker *workers;
    atomic_ullong next;
    atomic_int status; /* the first status of a block that is not LG_OK */
} ensemble;

/* ---- options ---- */

void lg_ensemble_options_init(lg_ensemble_options *options) {
    *options = (lg_ensemble_options){.size = sizeof(lg_ensemble_options), .threads = 1};
    lg_step_controller_init(&options->control);
}

static lg_status check_times(const lg_ensemble_options *o, lg_error *error) {
    if (!o->times || o->count < 1 || !(o->times[0] >= 0.0) || !(o->times[o->count - 1] > 0.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "an ensemble needs times that are 0 or later, and a last time above 0");
    for (size_t i = 0; i < o->count; i++)
        if (!isfinite(o->times[i]) || (i > 0 && !(o->times[i] > o->times[i - 1])))
            return lg_fail(error, LG_INVALID_ARGUMENT, "the times of an ensemble do not ascend at index %zu",
                           i);
    return LG_OK;
}

static lg_status check_events(const lg_ensemble_options *o, size_t dim, lg_error *error) {
    if (o->event_count > LG_EVENTS_MAX || (o->event_count > 0 && !o->events))
        return lg_fail(error, LG_INVALID_ARGUMENT, "event_count is above %d, or `events` is NULL",
                       LG_EVENTS_MAX);
    for (size_t e = 0; e < o->event_count; e++) {
        const lg_ensemble_event *event = &o->events[e];
        bool sound = event->terms >= 1 && event->terms <= LG_EVENT_TERMS && isfinite(event->level) &&
                     event->direction >= -1 && event->direction <= 1;
        for (size_t i = 0; sound && i < event->terms; i++)
            sound = event->index[i] < dim && isfinite(event->weight[i]);
        if (!sound)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "event %zu has a wrong number of terms, an index outside the state, a number that "
                           "is not finite, or a wrong direction",
                           e);
    }
    return LG_OK;
}

/* With equal steps and no dense output, all times must be multiples of the step. */
static lg_status check_steps(const lg_ensemble_options *o, lg_error *error) {
    const double h = o->times[o->count - 1] / (double)o->steps;
    if (o->steps == 0 || o->scheme->dense_order > 0) return LG_OK;
    for (size_t i = 0; i < o->count; i++) {
        const double n = o->times[i] / h;
        if (fabs(n - round(n)) > 1e-9 + 4.0 * DBL_EPSILON * n)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "the time %.17g is not a multiple of the step %.17g, and '%s' has no dense output",
                           o->times[i], h, o->scheme->name);
    }
    return LG_OK;
}

size_t lg_ensemble_block_size(const lg_ensemble_options *o, size_t dim) {
    const size_t bytes = o->count * dim * sizeof(double);
    size_t room = 1024;
    if (o->block > 0) return o->block;
    while (room > 16 && room * bytes > (size_t)4 << 20) room /= 2;
    return room;
}

#define DECLARE(NAME, name) extern const lg_lane_table lg_lanes_##name;
DECLARE(BASELINE, baseline)
LG_FASTER_SETS(DECLARE)

/* The table of lanes for the instruction set in use. */
static const lg_lane_table *table_of_lanes(void) {
#define ROW(NAME, name) [LG_ISA_##NAME] = &lg_lanes_##name,
    static const lg_lane_table *const tables[LG_ISA_COUNT] = {ROW(BASELINE, baseline) LG_FASTER_SETS(ROW)};
    return tables[lg_isa_in_use()];
}

/* Whether lane_project covers all factors of the space: it projects T*S^2, but not SO(3) and SE(3). */
static bool projects(const lg_space *space) {
    for (size_t i = 0; i < space->factors; i++)
        if (space->factor[i].kind == LG_SPACE_SO3 || space->factor[i].kind == LG_SPACE_SE3) return false;
    return true;
}

/* Whether lanes support the plan's system and scheme. */
static bool fits_lanes(const lg_lane_plan *plan) {
    const lg_scheme *scheme = plan->run.scheme;
    if (!table_of_lanes()->knows(plan) || (scheme->project && !projects(&plan->space))) return false;
    if (scheme->kind == LG_SCHEME_COMMUTATOR_FREE) return true;
    return scheme->kind == LG_SCHEME_RKMK && scheme->commutator_count == 0;
}

static lg_status prepare(ensemble *all, lg_error *error) {
    lg_ensemble_options *o = &all->plan.run;
    const lg_system *system = all->system;
    if (!o->scheme) o->scheme = lg_scheme_find(lg_space_is_abelian(&system->space) ? "dp54" : "rkmk54");
    LG_TRY(lg_scheme_check(o->scheme, error));
    LG_TRY(check_times(o, error));
    LG_TRY(check_events(o, system->space.dim, error));
    LG_TRY(check_steps(o, error));
    if (o->threads < 1 || o->threads > 1024)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the number of threads is %d, expected 1 to 1024",
                       o->threads);
    if (o->steps == 0 && o->scheme->embedded_order < 1)
        return lg_fail(error, LG_UNSUPPORTED,
                       "'%s' does not estimate its error, so it needs a number of equal steps",
                       o->scheme->name);
    if (o->steps == 0 && !lg_step_controller_valid(&o->control))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the step control of the ensemble is not valid: start from lg_step_controller_init");
    o->control.observe = NULL;
    o->control.dense = true;
    all->plan.t_end = o->times[o->count - 1];
    all->plan.ambient = lg_system_coordinates_for(o->scheme) == LG_COORDINATES_AMBIENT;
    if (!o->one_by_one && fits_lanes(&all->plan)) all->lanes = table_of_lanes();
    all->room = lg_ensemble_block_size(o, system->space.dim);
    all->blocks = o->members / all->room + (o->members % all->room > 0);
    return LG_OK;
}

/* ---- memory ---- */

static void free_worker(const ensemble *all, worker *w) {
    lg_free(all->context, w->memory);
    lg_one_by_one_end(&w->one);
    lg_system_destroy(w->system);
}

/* Lays the arrays out in w->memory; without it only returns their size, bytes. */
static size_t lay_out(const ensemble *all, worker *w) {
    const lg_lane_plan *plan = &all->plan;
    const size_t room = all->room, dim = plan->space.dim, own = plan->run.varied ? room : 1,
                 number = sizeof(double);
    lg_portions from = {w->memory, 0};
    w->block.memory = lg_portion(&from, all->lanes ? all->lanes->memory(plan, room) : 0, 1);
    w->block.states = lg_portion(&from, room, plan->run.count * dim * number);
    w->block.events = lg_portion(&from, room, plan->run.event_count * number);
    w->block.outcome = lg_portion(&from, room, sizeof(*w->block.outcome));
    w->block.start = lg_portion(&from, room, dim * number);
    w->block.parameter = lg_portion(&from, own, plan->parameters * number);
    w->block.constant = lg_portion(&from, own, plan->constants * number);
    w->own_start = lg_portion(&from, dim, number);
    w->own_parameter = lg_portion(&from, plan->parameters, number);
    w->projected = lg_portion(&from, dim, number);
    w->group_end = lg_portion(&from, dim, sizeof(*w->group_end));
    w->refused = lg_portion(&from, room, 1);
    return from.used;
}

static lg_status make_worker(const ensemble *all, worker *w) {
    const lg_lane_plan *plan = &all->plan;
    LG_TRY(lg_system_copy(all->context, all->system, &w->system));
    w->memory = lg_alloc(all->context, lay_out(all, w), 1);
    if (!w->memory) return LG_OUT_OF_MEMORY;
    (void)lay_out(all, w);
    w->groups = lg_space_groups(&plan->space, w->group_end);
    w->block.room = all->room;
    w->block.attempts = &w->vectors;
    memcpy(w->block.parameter, all->system->parameters,
           (plan->run.varied ? 0 : plan->parameters) * sizeof(double));
    memcpy(w->block.constant, all->system->constants,
           (plan->run.varied ? 0 : plan->constants) * sizeof(double));
    return all->lanes ? LG_OK : lg_one_by_one_begin(all->context, plan, w->system, &w->one);
}

/* ---- a block ---- */

#define START_TOLERANCE                                                                                      \
    1e-6 /* a start may be this far from the manifold, relative to the sizes of its groups */

/* Whether, in each group, the projected start differs from the start by at most START_TOLERANCE times the
 * size of the group. */
static bool is_near(const worker *w) {
    for (size_t g = 0, i = 0; g < w->groups; g++) {
        double size = 0.0, moved = 0.0;
        for (; i < w->group_end[g]; i++) {
            size = fmax(size, fabs(w->own_start[i]));
            const double by = fabs(w->projected[i] - w->own_start[i]);
            moved = by <= moved ? moved : by; /* may lose a NaN, for which allowed() checks again */
        }
        if (!(moved <= START_TOLERANCE * size)) return false;
    }
    return true;
}

/* Checks the current member's start and parameters, and projects the start. False if they are not allowed. */
static bool allowed(const ensemble *all, worker *w) {
    if (all->plan.run.varied && lg_system_set_parameters(w->system, w->own_parameter) != LG_OK) return false;
    const size_t bytes = all->plan.space.dim * sizeof(double);
    memcpy(w->projected, w->own_start, bytes);
    lg_space_project(&all->plan.space, w->projected);
    if (!is_near(w)) return false;
    memcpy(w->own_start, w->projected, bytes);
    return lg_all_finite(all->plan.space.dim, w->own_start);
}

static void put_column(size_t n, size_t room, size_t member, const double *from, double *to) {
    for (size_t i = 0; i < n; i++) to[i * room + member] = from[i];
}

static lg_status draw_members(const ensemble *all, worker *w, uint64_t first, size_t members) {
    const lg_lane_plan *plan = &all->plan;
    const size_t dim = plan->space.dim, room = all->room;
    for (size_t m = 0; m < members; m++) {
        memset(w->own_start, 0, dim * sizeof(double));
        if (all->plan.run.start) memcpy(w->own_start, all->plan.run.start, dim * sizeof(double));
        memcpy(w->own_parameter, all->system->parameters, plan->parameters * sizeof(double));
        if (all->draw) LG_TRY(all->draw(all->draw_user, first + m, w->own_start, w->own_parameter));
        w->refused[m] = !allowed(all, w);
        if (w->refused[m]) {
            for (size_t c = 0; c < dim; c++) w->own_start[c] = NAN;
            memcpy(w->own_parameter, all->system->parameters, plan->parameters * sizeof(double));
            LG_TRY(lg_system_set_parameters(w->system, w->own_parameter));
        }
        put_column(dim, room, m, w->own_start, w->block.start);
        if (!plan->run.varied) continue;
        put_column(plan->parameters, room, m, w->own_parameter, w->block.parameter);
        put_column(plan->constants, room, m, w->system->constants, w->block.constant);
    }
    return LG_OK;
}

static void run_one_by_one(const ensemble *all, worker *w, size_t members) {
    const size_t room = all->room;
    for (size_t m = 0; m < members; m++) {
        for (size_t c = 0; c < all->plan.space.dim; c++) w->own_start[c] = w->block.start[c * room + m];
        for (size_t i = 0; all->plan.run.varied && i < all->plan.parameters; i++)
            w->own_parameter[i] = w->block.parameter[i * room + m];
        if (all->plan.run.varied) (void)lg_system_set_parameters(w->system, w->own_parameter);
        lg_one_by_one_run(&w->one, w->own_start, m, &w->block);
    }
}

/* Counts steps and failures, and sets the states that failed members did not reach to NaN. */
static void settle_failures(const ensemble *all, worker *w, size_t members) {
    const lg_lane_plan *plan = &all->plan;
    const size_t dim = plan->space.dim, room = all->room;
    for (size_t m = 0; m < members; m++) {
        lg_ensemble_member *outcome = &w->block.outcome[m];
        if (w->refused[m]) *outcome = (lg_ensemble_member){.status = LG_INVALID_ARGUMENT};
        w->steps += outcome->steps;
        w->rejected += outcome->rejected;
        if (outcome->status == LG_OK) continue;
        w->failed++;
        for (size_t i = 0; i < plan->run.count; i++)
            for (size_t c = 0; c < dim && (w->refused[m] || plan->run.times[i] > outcome->reached); c++)
                w->block.states[(i * dim + c) * room + m] = NAN;
    }
}

static lg_status run_block(const ensemble *all, worker *w, uint64_t index) {
    const lg_lane_plan *plan = &all->plan;
    const uint64_t done = index * all->room, left = all->plan.run.members - done;
    const size_t members = left < all->room ? (size_t)left : all->room;
    w->block.members = members;
    LG_TRY(draw_members(all, w, all->plan.run.first + done, members));
    for (size_t i = 0; i < plan->run.event_count * all->room; i++) w->block.events[i] = NAN;
    if (all->lanes)
        all->lanes->run(plan, &w->block);
    else
        run_one_by_one(all, w, members);
    settle_failures(all, w, members);
    if (!all->keep) return LG_OK;
    const lg_ensemble_block kept = {.first = all->plan.run.first + done,
                                    .members = members,
                                    .room = all->room,
                                    .dim = plan->space.dim,
                                    .count = plan->run.count,
                                    .parameter_count = plan->parameters,
                                    .event_count = plan->run.event_count,
                                    .start = w->block.start,
                                    .parameter = plan->run.varied ? w->block.parameter : NULL,
                                    .states = w->block.states,
                                    .events = w->block.events,
                                    .member = w->block.outcome,
                                    .thread = (size_t)(w - all->workers)};
    return all->keep(all->keep_user, &kept);
}

/* The work of thread `index`: it takes blocks until none are left or a block has failed. */
static void work(void *user, size_t index) {
    ensemble *all = user;
    for (;;) {
        const uint64_t block = atomic_fetch_add(&all->next, 1);
        if (block >= all->blocks || atomic_load(&all->status) != LG_OK) return;
        lg_status status = lg_cancelled(all->context) ? LG_CANCELLED : LG_OK;
        if (status == LG_OK) status = run_block(all, &all->workers[index], block);
        int none = LG_OK;
        if (status != LG_OK) (void)atomic_compare_exchange_strong(&all->status, &none, (int)status);
    }
}

static lg_status run_threads(ensemble *all, size_t threads) {
    lg_thread_pool *pool = NULL;
    for (size_t i = 0; i < threads; i++) LG_TRY(make_worker(all, &all->workers[i]));
    LG_TRY(lg_thread_pool_create(all->context, (int)threads, &pool));
    lg_thread_pool_run(pool, threads, work, all);
    lg_thread_pool_destroy(pool);
    return (lg_status)atomic_load(&all->status);
}

static void sum_up(const ensemble *all, size_t threads, double seconds, lg_ensemble_stats *out) {
    uint64_t vectors = 0;
    *out = (lg_ensemble_stats){.lanes = all->lanes ? all->lanes->lanes : 1,
                               .block = all->room,
                               .occupancy = NAN,
                               .seconds = seconds};
    for (size_t i = 0; i < threads; i++) {
        const worker *w = &all->workers[i];
        out->failed += w->failed;
        out->steps += w->steps;
        out->rejected += w->rejected;
        vectors += w->vectors;
    }
    if (all->lanes && vectors > 0)
        out->occupancy = (double)(out->steps + out->rejected) / ((double)vectors * (double)out->lanes);
}

lg_status lg_ensemble_run(const lg_context *context, const lg_system *system,
                          const lg_ensemble_options *options, lg_ensemble_start start, void *start_user,
                          lg_ensemble_keep keep, void *keep_user, lg_ensemble_stats *stats, lg_error *error) {
    if (!system || !options || options->size != sizeof(*options) || options->members > SIZE_MAX / 2)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the system or the options are NULL, the options' size is wrong, or there are too many members");
    ensemble all = {.context = context,
                    .system = system,
                    .plan = {.run = *options,
                             .name = system->row->name,
                             .form = system->row->form,
                             .space = system->space,
                             .links = system->links,
                             .parameters = system->parameter_count,
                             .constants = lg_system_constants(system),
                             .work = lg_system_own_work(system)},
                    .draw = start,
                    .keep = keep,
                    .draw_user = start_user,
                    .keep_user = keep_user};
    const double begin = lg_seconds();
    LG_TRY(prepare(&all, error));
    const size_t most = (size_t)all.plan.run.threads;
    const size_t threads = all.blocks < most ? (all.blocks > 0 ? (size_t)all.blocks : 1) : most;
    all.workers = lg_alloc(context, threads, sizeof(*all.workers));
    lg_status status = all.workers ? run_threads(&all, threads) : LG_OUT_OF_MEMORY;
    if (status == LG_OK && stats) sum_up(&all, threads, lg_seconds() - begin, stats);
    for (size_t i = 0; all.workers && i < threads; i++) free_worker(&all, &all.workers[i]);
    lg_free(context, all.workers);
    return status == LG_OK ? LG_OK : lg_fail(error, status, "%s", lg_status_sentence(status));
}
