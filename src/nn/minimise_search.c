/* The line search for the weak Wolfe conditions, by bracketing and cubic interpolation. */
#include <math.h>

#include "nn/minimise_internal.h"

enum { MOST_TRIALS = 20 };
static const double ARMIJO = 1e-4, WOLFE = 0.9, LEAST_GROWTH = 1.1, MOST_GROWTH = 10.0, NARROWEST = 0.1;

void lg_minimise_search_begin(lg_minimiser *m, double alpha) {
    lg_minimise_numbers *s = &m->numbers;
    m->counts.stage = LG_STAGE_SEARCH;
    m->counts.trials = 0;
    m->counts.bounded = 0;
    s->alpha = alpha;
    s->low = s->high = s->high_value = s->high_slope = 0.0;
    s->low_value = s->value;
    s->low_slope = s->slope;
}

/* Where the cubic that has f and its slope at both ends of the bracket has its minimum (Nocedal & Wright,
 * (3.59)). The result keeps NARROWEST of the width away from both ends. It is the middle of the bracket if
 * the cubic has no minimum. */
static double interpolate(const lg_minimise_numbers *s) {
    const double width = s->high - s->low;
    const double nearest = s->low + NARROWEST * width, farthest = s->high - NARROWEST * width;
    const double a = s->low_slope + s->high_slope - 3.0 * (s->low_value - s->high_value) / (s->low - s->high);
    const double b = sqrt(a * a - s->low_slope * s->high_slope);
    const double x = s->high - width * (s->high_slope + b - a) / (s->high_slope - s->low_slope + 2.0 * b);
    if (!isfinite(x)) return s->low + 0.5 * width;
    return x < nearest ? nearest : x > farthest ? farthest : x;
}

/* Where the slopes at the lower end and at the trial tell that the slope is zero. */
static double extrapolate(const lg_minimise_numbers *s, double slope) {
    const double x = s->alpha + (s->alpha - s->low) * slope / (s->low_slope - slope);
    const double most = MOST_GROWTH * s->alpha;
    return slope > s->low_slope ? fmin(fmax(x, LEAST_GROWTH * s->alpha), most) : most;
}

/* value is INFINITY and slope, g.d, is NaN if f or g is not finite. */
static lg_search_verdict tell(lg_minimiser *m, double value, double slope) {
    lg_minimise_numbers *s = &m->numbers;
    const bool falls = isfinite(slope) && value <= s->value + ARMIJO * s->alpha * s->slope;
    const bool last = ++m->counts.trials == MOST_TRIALS;
    if (falls && slope >= WOLFE * s->slope) {
        m->counts.endless = 0;
        return LG_SEARCH_ACCEPT;
    }
    if (falls && last && m->counts.bounded == 0) {
        m->counts.endless++;
        return LG_SEARCH_ACCEPT;
    }
    /* The slope predicts a fall of rounding size. Downhill from a saddle it predicts none. */
    const bool steep = m->counts.failures < 2 || lg_minimise_newton_shows(m);
    const bool rounding = steep && !falls && -s->alpha * s->slope <= 0.5 * lg_minimise_rounding(m);
    if (last || rounding) return LG_SEARCH_FAIL;
    const double farther = extrapolate(s, slope);
    if (falls) {
        s->low = s->alpha, s->low_value = value, s->low_slope = slope;
    } else {
        s->high = s->alpha, s->high_value = value, s->high_slope = slope;
        m->counts.bounded = 1;
    }
    const double next = m->counts.bounded != 0 ? interpolate(s) : farther;
    if (next == s->low || next == s->high || !isfinite(next)) return LG_SEARCH_FAIL;
    s->alpha = next;
    return LG_SEARCH_ON;
}

lg_search_verdict lg_minimise_search_tell(lg_minimiser *m, double value, const double *gradient,
                                          bool finite) {
    const lg_search_verdict verdict =
        tell(m, finite ? value : INFINITY, finite ? m->k->dot(m->n, gradient, m->d) : NAN);
    if (verdict == LG_SEARCH_ON) lg_minimise_set_point(m, m->numbers.alpha, m->d);
    return verdict;
}
