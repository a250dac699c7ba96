/* Certificates: what a caller sees. */
#include "liegrad/certify.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "certify/certify.h"

void lg_certify_spec_init(lg_certify_spec *spec) {
    if (spec != NULL) *spec = (lg_certify_spec){.size = sizeof *spec, .resolution = 1.0 / 512, .threads = 1};
}

void lg_certify_destroy(lg_certify *c) {
    if (c == NULL) return;
    lg_certify_forget(c);
    lg_thread_pool_destroy(c->pool);
    LG_FREE_ALL(c->context, c->stack, c->work, c->batch, c->found, c);
}

static lg_status check_spec(const lg_certify_spec *spec, lg_error *error) {
    if (spec->size != sizeof *spec)
        return lg_fail(error, LG_INVALID_ARGUMENT, "lg_certify_spec.size is not the size of the struct");
    if ((spec->P == NULL) == (spec->lyapunov == NULL))
        return lg_fail(error, LG_INVALID_ARGUMENT, "give either P or the name of V, not both");
    if (spec->control != NULL && !(spec->period > 0 && isfinite(spec->period) && !spec->step))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a held loop (`control`) needs a period above 0, and is no `step`");
    if (spec->unit != 0 && (spec->control == NULL || (spec->unit != 0x1p-53 && spec->unit != 0x1p-24)))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the unit of rounding is 0, or for a held loop 2^-53 or 2^-24");
    if (!(spec->level >= 0 && isfinite(spec->level) && spec->eps >= 0 && isfinite(spec->eps) &&
          spec->most >= 0) ||
        !(spec->resolution > 0 && spec->resolution <= 0.5) || spec->threads < 1 ||
        (spec->level > 0 && spec->eps >= spec->level))
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "level and eps must be 0 or positive, eps below level, resolution in (0, 0.5], threads at "
            "least 1");
    return LG_OK;
}

static lg_status take_box(lg_certify *c, const lg_certify_spec *spec, lg_error *error) {
    for (size_t i = 0; i < c->n; i++) {
        const double goal = spec->goal != NULL ? spec->goal[i] : 0.0, low = spec->low[i],
                     high = spec->high[i];
        const double e = c->errors ? spec->model_error[i] : 0.0;
        if (!(low < goal && goal < high) || (!c->quadratic && !(isfinite(low) && isfinite(high))))
            return lg_fail(error, LG_INVALID_ARGUMENT, "state %zu: the box [%g, %g] %s", i, low, high,
                           low < goal && goal < high ? "must be finite, because V is no quadratic form"
                                                     : "does not hold the goal");
        if (!(e >= 0 && isfinite(e)))
            return lg_fail(error, LG_INVALID_ARGUMENT, "state %zu: the model error %g is no bound", i, e);
        c->goal[i] = goal;
        c->low[i] = low;
        c->high[i] = high;
        c->error[i] = e;
        /* Rounding keeps the domain in y inside of the box. */
        c->from[i] = nextafter(low - goal, DBL_MAX);
        c->to[i] = nextafter(high - goal, -DBL_MAX);
    }
    return LG_OK;
}

/* A quadratic V: the box decides the largest level. */
static lg_status begin_quadratic(lg_certify *c, lg_error *error) {
    const double reach = lg_certify_reach(c);
    if (c->automatic) c->level = fmin(c->level, reach);
    if (!(c->level < DBL_MAX))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the box is unbounded in all states: give a level");
    if (c->level > reach) {
        c->failed = true;
        c->phase = LG_CERTIFY_DONE;
        memcpy(c->failed_low, c->low, sizeof c->low);
        memcpy(c->failed_high, c->high, sizeof c->high);
        (void)lg_format(c->reason, sizeof c->reason,
                        "{V <= %.6g} is not inside of the box; it is up to the level %s", c->level,
                        LG_DIGITS(reach, -1));
        return LG_OK;
    }
    return lg_certify_begin(c, LG_CERTIFY_FALL);
}

static lg_status begin(lg_certify *c, const lg_certify_spec *spec, lg_error *error) {
    c->step = spec->step || spec->control != NULL;
    c->quadratic = spec->P != NULL;
    if (c->step && !c->quadratic)
        return lg_fail(error, LG_UNSUPPORTED,
                       "steps need a quadratic V, P: with another V a step could leave the box unnoticed");
    c->automatic = spec->level == 0;
    c->level = !c->automatic ? spec->level : spec->most > 0 ? spec->most : DBL_MAX;
    c->asked_eps = spec->eps;
    c->raises = spec->eps == 0;
    c->resolution = spec->resolution;
    c->determinant = 1;
    c->period = spec->period;
    size_t function;
    LG_TRY(lg_certify_function(spec->program, spec->rate, LG_CERTIFY_STATES, false, spec->control != NULL,
                               &function, &c->n, error));
    for (size_t i = 0; spec->model_error != NULL && i < c->n; i++) c->errors |= spec->model_error[i] != 0.0;
    LG_TRY(take_box(c, spec, error));
    if (c->quadratic) {
        for (size_t i = 0; i < c->n * c->n; i++)
            c->P[i] = 0.5 * spec->P[i] + 0.5 * spec->P[i % c->n * c->n + i / c->n];
        LG_TRY(lg_certify_whiten(c, error));
    }
    LG_TRY(lg_certify_record(c, spec, error));
    if (c->quadratic) {
        LG_TRY((c->file != NULL && c->made == NULL ? lg_certify_coordinates : lg_certify_turn)(c, error));
        LG_TRY(lg_certify_record(c, spec, error));
        LG_TRY(lg_certify_round(c, spec, error));
    }
    LG_TRY(lg_thread_pool_create(c->context, spec->threads, &c->pool));
    LG_TRY(lg_certify_memory(c));
    return c->quadratic ? begin_quadratic(c, error) : lg_certify_begin(c, LG_CERTIFY_FACES);
}

lg_status lg_certify_create(const lg_context *context, const lg_certify_spec *spec, lg_certify **out,
                            lg_error *error) {
    return lg_certify_create_for(context, spec, NULL, NULL, out, error);
}

lg_status lg_certify_create_for(const lg_context *context, const lg_certify_spec *spec,
                                const lg_certificate *file, lg_certificate *made, lg_certify **out,
                                lg_error *error) {
    LG_NEEDS(error, spec, out);
    LG_NEEDS(error, spec->program, spec->rate, spec->low, spec->high);
    LG_TRY(check_spec(spec, error));
    LG_CLEAN(lg_certify_destroy_at) lg_certify *c = lg_alloc(context, 1, sizeof *c);
    if (c == NULL) return lg_no_memory(error);
    c->context = context;
    c->file = file;
    c->made = made;
    const lg_status status = begin(c, spec, error);
    if (status == LG_OUT_OF_MEMORY) return lg_no_memory(error);
    return status == LG_OK ? LG_MOVE(out, c) : status;
}

/* ---- the sentence ---- */

const char *lg_digits(char text[LG_DIGITS_MOST], double x, int side) {
    static const struct {
        int digits;
        double more;
    } tries[] = {{6, 0}, {9, 1e-8}, {17, 0}};
    for (size_t i = 0; i < LG_COUNT(tries); i++) {
        (void)lg_format(text, LG_DIGITS_MOST, "%.*g", tries[i].digits, x + side * tries[i].more * fabs(x));
        const double read = lg_real(text, NULL);
        if (side < 0 ? read <= x : side > 0 ? read >= x : read == x) break;
    }
    return text;
}

enum { BOX = LG_CERTIFY_STATES * (2 * LG_DIGITS_MOST + sizeof " x [, ]") };

static void write_box(const lg_certify *c, char text[BOX]) {
    size_t at = 0;
    for (size_t i = 0; i < c->n; i++)
        if (isfinite(c->low[i]))
            at += (size_t)lg_format(text + at, BOX - at, "%s[%s, %s]", i == 0 ? "" : " x ",
                                    LG_DIGITS(c->low[i], 1), LG_DIGITS(c->high[i], -1));
        else
            at += (size_t)lg_format(text + at, BOX - at, "%s(-inf, inf)", i == 0 ? "" : " x ");
}

enum { ERROR = 64 + LG_CERTIFY_STATES * (2 + LG_DIGITS_MOST) };

/* One bound where all components have the same. */
static void write_error(const lg_certify *c, char text[ERROR]) {
    bool equal = true;
    for (size_t i = 1; i < c->n; i++) equal = equal && c->error[i] == c->error[0];
    if (!c->errors) {
        (void)snprintf(text, ERROR, "no model error is allowed for");
        return;
    }
    size_t at = (size_t)snprintf(text, ERROR, "the %s may err by up to %s", c->step ? "next state" : "rate",
                                 equal ? "" : "(");
    for (size_t i = 0; i < (equal ? 1 : c->n); i++)
        at += (size_t)lg_format(text + at, ERROR - at, "%s%s", i > 0 ? ", " : "", LG_DIGITS(c->error[i], -1));
    (void)snprintf(text + at, ERROR - at, equal ? " per component" : ")");
}

static void write_claim(lg_certify *c) {
    char box[BOX], error[ERROR];
    const bool verified = c->phase == LG_CERTIFY_DONE && !c->failed;
    write_box(c, box);
    write_error(c, error);
    char falls[128] = "V' < 0 (continuous inputs)", between[96] = "", rounded[160] = "";
    const double more = 1.06; /* two digits of it are not below the bound */
    if (c->rounds && c->converges)
        (void)lg_format(
            rounded, sizeof rounded,
            "; with the controller's rounding, errors of inputs of up to %.2g, motions reach {V < "
            "%.2g} and stay there",
            c->input_error * more, c->eps_rounded * more);
    else if (c->rounds)
        (void)lg_format(rounded, sizeof rounded,
                        "; that includes the controller's rounding, errors of inputs of up to %.2g",
                        c->input_error * more);
    else if (c->input_error > 0)
        (void)snprintf(rounded, sizeof rounded,
                       "; the controller's rounding has no bound and is not covered");
    if (c->flow != NULL) {
        (void)lg_format(falls, sizeof falls,
                        "V falls in every period of the exact motion (inputs are held for %s)",
                        LG_DIGITS(c->period, 0));
        if (isfinite(c->between) && c->between > 0)
            (void)lg_format(between, sizeof between, " and V <= %s between the samples%s",
                            LG_DIGITS(c->between, 1), c->errors ? " (of the model)" : "");
        else
            (void)snprintf(between, sizeof between, "; V has no bound between the samples");
    } else if (c->step)
        (void)snprintf(falls, sizeof falls, "V falls in every step of this map");
    (void)lg_format(c->claim, sizeof c->claim,
                    "%s: in the box %s, %s for eps = %s <= V <= c = %s, {V <= c} does not leave the box, and "
                    "motions from it %s%s; %s%s; angles are counted, not wrapped.",
                    verified ? "Proved" : "Not proved", box, falls, LG_DIGITS(fmin(c->eps, c->level), 1),
                    LG_DIGITS(c->level, -1),
                    c->converges
                        ? c->rounds ? "converge to the goal in exact arithmetic" : "converge to the goal"
                    : c->step ? "reach {V < eps} again and again and stay in {V <= c}"
                              : "reach {V < eps} about the goal and stay there",
                    between, error, rounded);
}

static void fill(lg_certify *c, lg_certify_result *r) {
    write_claim(c);
    *r = (lg_certify_result){.finished = c->phase == LG_CERTIFY_DONE,
                             .level = c->level,
                             .eps = fmin(c->eps, c->level),
                             .boxes = c->boxes,
                             .seconds = c->seconds,
                             .claim = c->claim,
                             .reason = c->reason};
    r->between = c->between;
    r->input_error = c->input_error;
    r->eps_rounded = !c->rounds ? 0 : c->converges ? c->eps_rounded : r->eps;
    r->verified = r->finished && !c->failed;
    r->converges = r->verified && c->converges;
    r->volume = r->verified ? c->volume : 0;
    if (r->verified && c->quadratic) {
        for (size_t i = 0; i < c->n; i++) c->width[i] = sqrt(c->level) * lg_certify_width(c, i);
        r->width = c->width;
    }
    r->fraction = r->volume;
    for (size_t i = 0; i < c->n; i++) r->fraction /= c->high[i] - c->low[i];
    if (!r->verified) {
        r->failed_low = c->failed_low;
        r->failed_high = c->failed_high;
    }
}

lg_status lg_certify_run(lg_certify *c, size_t boxes, double seconds, lg_certify_result *result,
                         lg_error *error) {
    LG_NEEDS(error, c, result);
    LG_TRY(lg_interval_nearest(error));
    const double start = lg_seconds(), before = c->seconds;
    const size_t end = boxes > SIZE_MAX - c->boxes ? SIZE_MAX : c->boxes + boxes;
    while (c->phase != LG_CERTIFY_DONE && c->boxes < end && lg_seconds() - start < seconds) {
        if (lg_cancelled(c->context)) return lg_fail(error, LG_CANCELLED, "the proof was interrupted");
        if (lg_certify_work(c) != LG_OK) { /* boxes are lost */
            lg_certify_fail(c, c->batch, "there was no memory for more boxes");
            return lg_fail(error, LG_OUT_OF_MEMORY, "%s", c->reason);
        }
        c->seconds = before + lg_seconds() - start;
    }
    if (c->phase != LG_CERTIFY_DONE) { /* the box that would be next */
        const double *box = c->stack + (c->stacked - 1) * 2 * c->n;
        lg_certify_states(c, box, box + c->n, c->failed_low, c->failed_high);
        (void)snprintf(c->reason, sizeof c->reason, "the work budget ended; a further run continues");
    } else if (!c->failed)
        c->reason[0] = '\0';
    fill(c, result);
    return LG_OK;
}
