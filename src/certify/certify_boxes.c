/* Branch and bound on a stack of boxes. Boxes are taken from the top in batches, and what is found is used
 * in their order, so the result does not depend on threads. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "certify/certify.h"
#include "core/widen.h"

static lg_status push(lg_certify *c, const double *low, const double *high) {
    const size_t n = c->n;
    if (c->stacked == c->capacity) {
        const size_t capacity = c->capacity == 0 ? 4096 : 2 * c->capacity;
        double *grown = lg_widen(c->context, c->stack, c->stacked, capacity, 2 * n * sizeof *grown);
        if (grown == NULL) return LG_OUT_OF_MEMORY;
        c->stack = grown;
        c->capacity = capacity;
    }
    double *to = c->stack + c->stacked++ * 2 * n;
    memcpy(to, low, n * sizeof *to);
    memcpy(to + n, high, n * sizeof *to);
    return LG_OK;
}

/* The claim does not hold where V is v. If v is small, if motions need not converge, and if eps may be
 * chosen, eps is raised: V may rise there because of an error of the model, or because the equilibrium is
 * not exactly at the goal. Otherwise the level is lowered below v, if it may be chosen. */
static void refuse(lg_certify *c, const double *box, double v, const char *reason) {
    const double level = v * (1 - 1e-9), eps = 1.5 * fmax(v, c->eps);
    if (c->phase == LG_CERTIFY_FALL && c->raises && !c->converges && v < 0.5 * c->level && eps < c->level) {
        c->raised = fmax(c->raised, eps);
        return;
    }
    if (!c->automatic || !(level > 0) || (c->phase == LG_CERTIFY_FALL && level < c->eps && !c->converges) ||
        (c->converges && level < 1e-3 * c->eps))
        lg_certify_fail(c, box, reason);
    else if (level < c->level) {
        c->level = level;
        c->again = c->step && !c->converges; /* what steps from {V < eps} must not leave is smaller now */
    }
}

/* The same, where the middle of the box is the proof. */
static void refute(lg_certify *c, const lg_certify_box *f, const char *reason) {
    double point[2 * LG_CERTIFY_STATES];
    memcpy(point, f->at, c->n * sizeof *point);
    memcpy(point + c->n, f->at, c->n * sizeof *point);
    refuse(c, point, f->at_v_low, reason);
}

/* Whether a box is too small to be halved. With a level that may be chosen: if V hardly changes over the
 * box. */
static bool is_tiny(const lg_certify *c, const double *box, const lg_certify_box *f) {
    if (c->automatic && c->phase != LG_CERTIFY_VOLUME && f->v_high - f->v_low <= c->resolution * f->v_high)
        return true;
    const double part = c->phase == LG_CERTIFY_VOLUME ? 1e-3 : 1e-7;
    for (size_t i = 0; i < c->n; i++)
        if (box[c->n + i] - box[i] > part * (c->to[i] - c->from[i])) return false;
    return true;
}

/* Whether V, its gradient and the rate may have no slopes on the box. Such a box is halved; one that is too
 * small for that may hold a state where motions jump or end, so the level is lowered, or the proof fails. */
static bool is_lost(lg_certify *c, const double *box, const lg_certify_box *f, bool *done) {
    static const char *const lost[LG_INTERVAL_LIPSCHITZ] = {
        "be undefined there, or a motion has no bound over a period", "jump there",
        "have an infinite slope there, or a derivative that lg_stop_gradient or a custom operation hides"};
    const bool raises = c->raises;
    char reason[192];
    if (f->flag >= LG_INTERVAL_LIPSCHITZ) return false;
    *done = is_tiny(c, box, f);
    if (!*done) return true;
    (void)snprintf(reason, sizeof reason, "the loop, V or its gradient may %s", lost[f->flag]);
    c->raises = false; /* a larger eps does not help */
    refuse(c, box, f->v_low, reason);
    c->raises = raises;
    return true;
}

/* ---- what becomes of a box: true if it is done with ---- */

static bool face(lg_certify *c, const double *box, const lg_certify_box *f) {
    if (f->v_low > c->level) return true;
    if (f->at_v_high <= c->level) {
        refute(c, f, "V is not above the level on the boundary of the box");
        return c->failed || f->v_low > c->level;
    }
    if (!is_tiny(c, box, f)) return false;
    refuse(c, box, f->v_low, "V could not be shown to be above the level on the boundary of the box");
    return true;
}

static bool fall(lg_certify *c, const double *box, const lg_certify_box *f) {
    const bool near = lg_certify_is_near(c, box, box + c->n), at_near = lg_certify_is_near(c, f->at, f->at);
    const char *reason = c->step ? "V rises in a step" : "V does not fall";
    bool done;
    if (f->v_low > c->level) return true;
    if (is_lost(c, box, f, &done)) return done;
    /* From {V < eps}, a step must not leave {V <= c}. */
    const bool kept = !c->step || f->v_high + f->rise_high < c->level;
    if (near && (c->converges || (f->v_high < c->eps && kept))) return true;
    if (f->rise_inside < 0.0 && (near || f->v_low >= c->eps)) return true;
    if (f->at_v_high <= c->level && !(at_near && (c->converges || f->at_v_low < c->eps))) {
        const bool elsewhere = f->at_v_high < c->eps;
        if (elsewhere || f->at_rise_low >= 0.0) {
            refute(c, f, elsewhere ? "V is below eps away from the goal" : reason);
            return c->failed || f->v_low > c->level;
        }
    }
    if (c->step && !c->converges && f->at_v_high < c->eps && f->at_v_low + f->at_rise_low >= c->level) {
        lg_certify_fail(c, box, "a step from {V < eps} leaves {V <= c}");
        return true;
    }
    if (!is_tiny(c, box, f)) return false;
    refuse(c, box, f->v_low,
           c->step ? "V could not be shown to fall in a step" : "V could not be shown to fall");
    return true;
}

/* Held loops: how large V becomes between the samples. A box that cannot change the bound is done with; a
 * bound below `settled` times the level is not sought. */
static const double settled = 1.05;

static bool between(lg_certify *c, const double *box, const lg_certify_box *f) {
    const double narrow = f->gain <= 0.2 * c->level ? 0.2 : 0.05;
    const double top = fmin(f->v_high, c->level) + f->gain;
    if (f->v_low > c->level || top <= c->between) return true;
    if (!(f->v_high - f->v_low <= narrow * c->level) && !is_tiny(c, box, f)) return false;
    c->between = top;
    return true;
}

static bool volume(lg_certify *c, const double *box, const lg_certify_box *f) {
    double product = 1 - 1e-12;
    if (f->v_low > c->level) return true;
    if (f->v_high > c->level) return is_tiny(c, box, f);
    for (size_t i = 0; i < c->n; i++) product *= box[c->n + i] - box[i];
    c->volume += product;
    return true;
}

/* Halves a box. The half with the smaller V is examined first: there the level is decided. */
static lg_status halve(lg_certify *c, double *box, const lg_certify_box *f) {
    const double low = box[f->split], high = box[c->n + f->split], middle = 0.5 * low + 0.5 * high;
    for (int half = 0; half < 2; half++) {
        const bool upper = (half == 1) == (middle < 0);
        box[f->split] = upper ? middle : low;
        box[c->n + f->split] = upper ? high : middle;
        LG_TRY(push(c, box, box + c->n));
    }
    return LG_OK;
}

/* ---- phases ---- */

static lg_status push_faces(lg_certify *c) {
    double low[LG_CERTIFY_STATES], high[LG_CERTIFY_STATES];
    for (size_t i = 0; i < 2 * c->n; i++) {
        memcpy(low, c->from, sizeof low);
        memcpy(high, c->to, sizeof high);
        *(i % 2 == 0 ? &high[i / 2] : &low[i / 2]) = i % 2 == 0 ? low[i / 2] : high[i / 2];
        LG_TRY(push(c, low, high));
    }
    return LG_OK;
}

/* The domain; its upper half in y_0, where V and V' are even and the domain is as large on both sides.
 * Bounds of errors and N are even, too. */
static lg_status push_domain(lg_certify *c) {
    double low[LG_CERTIFY_STATES];
    bool half = c->even && c->phase != LG_CERTIFY_VOLUME;
    memcpy(low, c->from, sizeof low);
    for (size_t i = 0; i < c->n; i++) half = half && c->from[i] == -c->to[i];
    if (half) low[0] = 0;
    return push(c, low, c->to);
}

lg_status lg_certify_begin(lg_certify *c, lg_certify_phase phase) {
    c->phase = phase;
    c->stacked = 0;
    if (phase == LG_CERTIFY_FACES) return push_faces(c);
    if (phase == LG_CERTIFY_FALL) {
        LG_TRY(lg_certify_near(c));
        for (size_t i = 0; c->quadratic && i < c->n; i++)
            c->from[i] = -(c->to[i] = sqrt(c->level) * (1 + 1e-6));
    }
    LG_TRY(push_domain(c));
    return c->file != NULL && phase == LG_CERTIFY_FALL ? lg_certify_root(c) : LG_OK;
}

/* A lower bound of the volume of an ellipsoid: pi^(n/2)/Gamma(n/2 + 1) c^(n/2) |det T|, as T^T P T is 1 to
 * 1e-7. */
static double ellipsoid(const lg_certify *c) {
    const double half = 0.5 * (double)c->n;
    return pow(3.14159265358979, half) / tgamma(half + 1) * pow(c->level, half) * fabs(c->determinant) *
           (1 - 1e-6 * half);
}

enum { VOLUME_BOXES = 1 << 16 };

static lg_status next_phase(lg_certify *c) {
    if (c->phase == LG_CERTIFY_FACES) return lg_certify_begin(c, LG_CERTIFY_FALL);
    if (c->phase == LG_CERTIFY_FALL && c->again) {
        c->again = false;
        c->asked_eps = c->eps;
        return lg_certify_begin(c, LG_CERTIFY_FALL);
    }
    if (c->phase == LG_CERTIFY_FALL && !c->quadratic) return lg_certify_begin(c, LG_CERTIFY_VOLUME);
    if (c->phase == LG_CERTIFY_FALL && c->flow != NULL) {
        c->between = c->file != NULL ? c->file->between : c->level * settled;
        return lg_certify_begin(c, LG_CERTIFY_BETWEEN);
    }
    if (c->quadratic) c->volume = ellipsoid(c);
    c->phase = LG_CERTIFY_DONE;
    if (c->file != NULL) lg_certify_close(c);
    return LG_OK;
}

lg_status lg_certify_work(lg_certify *c) {
    static bool (*const judge[])(lg_certify *, const double *, const lg_certify_box *) = {face, fall, between,
                                                                                          volume};
    const size_t n = c->n;
    const bool tree = c->file != NULL && c->phase == LG_CERTIFY_FALL;
    c->batched = c->stacked < LG_CERTIFY_BATCH ? c->stacked : LG_CERTIFY_BATCH;
    for (size_t i = 0; i < c->batched; i++) /* from the top downward */
        memcpy(c->batch + i * 2 * n, c->stack + (c->stacked - 1 - i) * 2 * n, 2 * n * sizeof(double));
    c->stacked -= c->batched;
    lg_certify_bounds(c);
    c->boxes += c->batched;
    if (c->phase == LG_CERTIFY_VOLUME) c->volume_boxes += c->batched;
    /* In the opposite order, so that the children of the box that was on top are on top. */
    for (size_t i = c->batched; i-- > 0 && !c->failed;) {
        double *box = c->batch + i * 2 * n;
        if (!(tree ? lg_certify_leaf : judge[c->phase])(c, box, &c->found[i]))
            LG_TRY(halve(c, box, &c->found[i]));
    }
    if (c->failed) return LG_OK;
    if (c->raised > 0) { /* N is larger then: all boxes are examined again */
        c->asked_eps = c->raised;
        c->raised = 0;
        return lg_certify_begin(c, LG_CERTIFY_FALL);
    }
    if (c->stacked == 0 && tree) LG_TRY(lg_certify_deeper(c));
    return c->failed ? LG_OK : c->stacked == 0 || c->volume_boxes > VOLUME_BOXES ? next_phase(c) : LG_OK;
}
