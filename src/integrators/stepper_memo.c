/* Shared by steps of all kinds: evaluations of the field, memos of its values, and rotation angles. */
#include "integrators/stepper.h"

#include <float.h>
#include <math.h>
#include <string.h>

bool lg_memo_holds(const lg_memo *memo, size_t n, double t, double h, const double *y) {
    /* times that differ only by rounding count as equal */
    const bool same = memo->t == t || fabs(memo->t - t) <= 4.0 * DBL_EPSILON * fmax(fabs(t), fabs(h));
    return memo->valid && same && memcmp(memo->y, y, n * sizeof(*y)) == 0;
}

void lg_memo_keep(lg_memo *memo, size_t n, double t, const double *y) {
    memo->valid = true;
    memo->is_packed = false;
    memo->t = t;
    memcpy(memo->y, y, n * sizeof(*y));
}

lg_status lg_stepper_evaluate(lg_stepper *s, double t, const double *y, const double *input, double *out) {
    s->evaluations++;
    return s->ode.field(s->ode.user, t, y, input, out);
}

/* On entry memo[0] belongs to the start of the previous step (which may have been rejected), memo[1] to its
 * end. On return memo[0] belongs to the start of this step; dense output reads the start from memo[0].y. */
lg_status lg_stepper_first(lg_stepper *s, double t, double h, const double *y, const double *input,
                           const double **f) {
    const size_t n = s->ode.space.dim;
    const bool keeps = s->memoises && !input;
    lg_memo *start = &s->memo[0], *end = &s->memo[1];
    if (keeps && !lg_memo_holds(start, n, t, h, y) && lg_memo_holds(end, n, t, h, y)) {
        const lg_memo kept = *start;
        *start = *end;
        *end = kept;
    } else if (!keeps || !lg_memo_holds(start, n, t, h, y)) {
        start->valid = false;
        LG_TRY(lg_stepper_evaluate(s, t, y, input, start->value));
        lg_memo_keep(start, n, t, y);
        start->valid = keeps;
    }
    end->valid = false;
    *f = start->value;
    return LG_OK;
}

/* With an FSAL scheme memo[1] must not be overwritten, because dense output needs its value; a value that is
 * not known yet then goes to s->bracket. */
lg_status lg_stepper_last(lg_stepper *s, double t, double h, const double *y, const double **f) {
    const size_t n = s->ode.space.dim;
    lg_memo *end = &s->memo[1];
    const bool known = lg_memo_holds(end, n, t, h, y);
    double *value = known || !s->scheme->fsal ? end->value : s->bracket;
    *f = value;
    if (known) return LG_OK;
    LG_TRY(lg_stepper_evaluate(s, t, y, NULL, value));
    if (value == end->value) lg_memo_keep(end, n, t, y);
    return LG_OK;
}

void lg_stepper_reset(lg_stepper *stepper) {
    for (int i = 0; i < 2; i++) stepper->memo[i].valid = stepper->memo[i].is_packed = false;
}

void lg_stepper_turn(lg_stepper *s, const double *a) {
    if (s->abelian) return;
    const double angle = lg_space_angle(&s->ode.space, a);
    if (angle > s->angle || isnan(angle)) s->angle = angle;
}

/* 0 x is 0 if x is finite, else NaN. Eight independent sums shorten the chain of dependent additions. */
bool lg_all_finite(size_t n, const double *x) {
    double zero[8] = {0.0}, sum = 0.0;
    size_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (int j = 0; j < 8; j++) zero[j] += 0.0 * x[i + j];
    for (; i < n; i++) sum += 0.0 * x[i];
    for (int j = 0; j < 8; j++) sum += zero[j];
    return sum == 0.0;
}
