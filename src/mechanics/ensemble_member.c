#include "mechanics/ensemble_member.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "core/portions.h"
#include "integrators/event_search.h"
#include "integrators/stepper.h"

/* Lays the arrays out in the memory that begins with `rows`; without it only returns their size, bytes. */
static size_t lay_out(lg_one_by_one *one, const lg_lane_plan *plan, size_t work) {
    const size_t state = plan->space.dim * sizeof(double);
    lg_portions from = {(char *)one->rows, 0};
    one->rows = lg_portion(&from, plan->run.count, state);
    one->y = lg_portion(&from, 1, state);
    one->before = lg_portion(&from, 1, state);
    one->trial = lg_portion(&from, 1, state);
    one->velocity = lg_portion(&from, 1, state);
    one->work = lg_portion(&from, 1, work);
    return from.used;
}

lg_status lg_one_by_one_begin(const lg_context *context, const lg_lane_plan *plan, const lg_system *system,
                              lg_one_by_one *out) {
    const size_t work = lg_system_work_size(system);
    lg_ode ode;
    out->context = context;
    out->plan = plan;
    out->rows = lg_alloc(context, lay_out(out, plan, work), 1);
    if (!out->rows) return LG_OUT_OF_MEMORY;
    (void)lay_out(out, plan, work);
    LG_TRY(lg_system_ode(system, lg_system_coordinates_for(plan->run.scheme), &ode, &out->user, out->work));
    LG_TRY(lg_stepper_create(context, plan->run.scheme, &ode, &out->stepper));
    return lg_stepper_create(context, plan->run.scheme, &ode, &out->looker);
}

void lg_one_by_one_end(lg_one_by_one *one) {
    if (!one->plan) return;
    lg_free(one->context, one->rows);
    lg_stepper_destroy(one->stepper);
    lg_stepper_destroy(one->looker);
}

/* ---- events ---- */

static double event_of(const lg_ensemble_event *event, const double *y) {
    double sum = -event->level;
    for (size_t i = 0; i < event->terms; i++) sum += event->weight[i] * y[event->index[i]];
    return sum;
}

/* one->velocity = y' at (t, y), the end of a step of size about h that `stepper` has made. */
static lg_status find_velocity(lg_one_by_one *one, lg_stepper *stepper, double t, double h, const double *y) {
    const double *f;
    LG_TRY(lg_stepper_last(stepper, t, h, y, &f));
    lg_space_generator(&stepper->ode.space, f, y, one->velocity);
    return LG_OK;
}

static double slope_of(const lg_one_by_one *one, const lg_ensemble_event *event) {
    double sum = 0.0;
    for (size_t i = 0; i < event->terms; i++) sum += event->weight[i] * one->velocity[event->index[i]];
    return sum;
}

/* Searches the event's time in the step from t to t + h. *out is NaN if the step has no event. */
static lg_status find_time(lg_one_by_one *one, const lg_ensemble_event *event, lg_event_search *search,
                           double t, double h, double *out) {
    const double close = 4.0 * DBL_EPSILON * one->plan->t_end / h;
    for (bool done = false; !done;) {
        const double part = search->fraction * h;
        LG_TRY(lg_stepper_step(one->looker, t, part, one->before, NULL, one->trial));
        if (search->dips) LG_TRY(find_velocity(one, one->looker, t + part, part, one->trial));
        done = lg_event_look(search, event_of(event, one->trial), h * slope_of(one, event), close);
    }
    *out = search->dips ? NAN : t + search->fraction * h;
    return LG_OK;
}

/* For each event without a time yet, begins a search in the step from `before` to y if it may lie there;
 * search[e].event is -1 otherwise. Returns whether there is a search. */
static bool begin_searches(lg_one_by_one *one, double h, const double *y, lg_event_search *search) {
    bool any = false;
    for (size_t e = 0; e < one->plan->run.event_count; e++) {
        const lg_ensemble_event *event = &one->plan->run.events[e];
        const double slope = slope_of(one, event);
        search[e] = (lg_event_search){.event = -1,
                                      .direction = event->direction,
                                      .g_low = event_of(event, one->before),
                                      .g_high = event_of(event, y),
                                      .slope_low = h * one->slopes[e],
                                      .slope_high = h * slope};
        one->slopes[e] = slope;
        if (isnan(one->events[e]) && lg_event_begin(&search[e])) search[e].event = (int)e, any = true;
    }
    return any;
}

static bool awaits_event(const lg_one_by_one *one) {
    for (size_t e = 0; e < one->plan->run.event_count; e++)
        if (isnan(one->events[e])) return true;
    return false;
}

/* The step observer: looks for events in the step from `before` to y; h > 0. */
static lg_status look(void *user, double t, double h, const double *y) {
    lg_one_by_one *one = user;
    lg_event_search search[LG_EVENTS_MAX];
    if (awaits_event(one)) {
        LG_TRY(find_velocity(one, one->stepper, t + h, h, y));
        const bool any = begin_searches(one, h, y, search);
        for (size_t e = 0; any && e < one->plan->run.event_count; e++)
            if (search[e].event >= 0)
                LG_TRY(find_time(one, &one->plan->run.events[e], &search[e], t, h, &one->events[e]));
    }
    memcpy(one->before, y, one->plan->space.dim * sizeof(*y));
    one->reached = t + h;
    return LG_OK;
}

/* Computes the events' slopes at the start, which is in `before`. */
static lg_status begin_events(lg_one_by_one *one) {
    LG_TRY(find_velocity(one, one->stepper, 0.0, one->plan->t_end, one->before));
    for (size_t e = 0; e < one->plan->run.event_count; e++)
        one->slopes[e] = slope_of(one, &one->plan->run.events[e]);
    return LG_OK;
}

/* ---- integration ---- */

static lg_status run(lg_one_by_one *one, lg_ensemble_member *outcome) {
    const lg_lane_plan *plan = one->plan;
    lg_step_controller control = plan->run.control;
    lg_run_stats stats = {0};
    control.steps = plan->run.steps;
    control.observe = look;
    control.observer = one;
    const lg_status status = lg_integrate_adaptive(one->stepper, &control, 0.0, one->y, plan->run.times,
                                                   plan->run.count, one->rows, &stats);
    outcome->steps = stats.steps;
    outcome->rejected = stats.rejected;
    return status;
}

void lg_one_by_one_run(lg_one_by_one *one, const double *y0, size_t member, const lg_lane_block *block) {
    const lg_lane_plan *plan = one->plan;
    const size_t dim = plan->space.dim;
    lg_ensemble_member outcome = {.status = isfinite(y0[0]) ? LG_OK : LG_NOT_FINITE};
    memcpy(one->y, y0, dim * sizeof(*y0));
    memcpy(one->before, y0, dim * sizeof(*y0));
    for (size_t e = 0; e < LG_EVENTS_MAX; e++) one->events[e] = NAN;
    one->reached = 0.0;
    lg_stepper_reset(one->stepper);
    lg_stepper_reset(one->looker);
    if (outcome.status == LG_OK && plan->run.event_count > 0) outcome.status = begin_events(one);
    if (outcome.status == LG_OK) outcome.status = run(one, &outcome);
    outcome.reached = outcome.status == LG_OK ? plan->t_end : one->reached;
    for (size_t i = 0; i < plan->run.count * dim; i++) block->states[i * block->room + member] = one->rows[i];
    for (size_t e = 0; e < plan->run.event_count; e++)
        block->events[e * block->room + member] = one->events[e];
    block->outcome[member] = outcome;
}
