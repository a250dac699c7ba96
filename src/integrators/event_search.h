/* Searches inside of a step for the time at which a function g of the state changes its sign. The caller
 * makes shorter steps, of a fraction of the step, and reports g at their ends. If g has the same sign at both
 * ends of the step, the search is first for the extremum of g on the side of 0. */
#ifndef LG_EVENT_SEARCH_H
#define LG_EVENT_SEARCH_H

#include <math.h>
#include <stdbool.h>

/* Times are fractions of the step, and slopes are derivatives of g with respect to this time. [low, high]
 * brackets the change of sign or the extremum. `fraction` is the time at which g is needed next. */
typedef struct lg_event_search {
    int event, looks; /* index of the event; number of times looked at */
    int direction;    /* counted changes: 1 g rises, -1 g falls, 0 either */
    int side;         /* end of the bracket that moved last: -1 low, 1 high */
    bool dips;        /* no change of sign is known yet: the search is for the extremum */
    double low, high, g_low, g_high, slope_low, slope_high, fraction;
} lg_event_search;

enum { LG_EVENT_LOOKS = 60 };

/* Whether g changes its sign from `before` to `after`; direction 1 counts rising g, -1 falling g, 0 both. */
static inline bool lg_event_counts(int direction, double before, double after) {
    const bool rises = before < 0.0 && after >= 0.0, falls = before > 0.0 && after <= 0.0;
    return (rises && direction >= 0) || (falls && direction <= 0);
}

/* Sets `fraction` by false position, or to the middle if that does not lie inside of the bracket. */
static inline void lg_event_guess(lg_event_search *s) {
    s->fraction = s->low + (s->high - s->low) * (s->g_low / (s->g_low - s->g_high));
    if (!(s->fraction > s->low && s->fraction < s->high)) s->fraction = 0.5 * (s->low + s->high);
}

/* Takes the value g at `fraction` and narrows the bracket. If the same end stays for the second time, its g
 * is halved (Illinois rule). Returns true when the search is over: `fraction` is then the time, to within
 * `close` (a fraction of the step), unless LG_EVENT_LOOKS were not enough for that. */
static inline bool lg_event_narrow(lg_event_search *s, double g, double close) {
    const double last = s->fraction;
    const int side = g != 0.0 && (g < 0.0) == (s->g_low < 0.0) ? -1 : 1;
    if (g == 0.0) return true;
    if (side < 0) {
        s->low = last, s->g_low = g;
        if (s->side == side) s->g_high *= 0.5;
    } else {
        s->high = last, s->g_high = g;
        if (s->side == side) s->g_low *= 0.5;
    }
    s->side = side;
    lg_event_guess(s);
    const double moved = s->fraction > last ? s->fraction - last : last - s->fraction;
    return ++s->looks >= LG_EVENT_LOOKS || moved <= close || s->high - s->low <= close;
}

/* On [0, 1] a cubic lies between the least and the largest of four numbers: its two end values,
 * g_low + slope_low/3 and g_high - slope_high/3. So if g_low, g_high, g_low + REACH slope_low and
 * g_high - REACH slope_high have the same sign, |cubic| >= min(|g_low|, |g_high|)/2 everywhere. */
#define LG_EVENT_REACH (2.0 / 3.0)

/* Sets `fraction` to the extremum on the side of 0 of the cubic that has the values and slopes of both ends
 * of the bracket. False if there is no such extremum inside of the bracket, or if the cubic there still has
 * the sign of g_low and at least half of min(|g_low|, |g_high|). */
static inline bool lg_event_dip(lg_event_search *s) {
    const double width = s->high - s->low, sign = s->g_low < 0.0 ? -1.0 : 1.0;
    const double g = sign * s->g_low, rise = sign * s->g_high - g;
    const double first = sign * width * s->slope_low, last = sign * width * s->slope_high;
    const double a = first + last - 2.0 * rise, b = 3.0 * rise - 2.0 * first - last;
    const double root = sqrt(b * b - 3.0 * a * first);
    const double x = b > 0.0 ? -first / (b + root) : (root - b) / (3.0 * a);
    s->fraction = s->low + x * width;
    return s->fraction > s->low && s->fraction < s->high &&
           g + x * (first + x * (b + x * a)) < 0.5 * fmin(g, g + rise);
}

/* Begins a search. The caller has set direction and the values and slopes of g at both ends of the step.
 * Returns false if there is nothing to search for in this step. */
static inline bool lg_event_begin(lg_event_search *s) {
    s->low = 0.0, s->high = 1.0;
    if (lg_event_counts(s->direction, s->g_low, s->g_high)) {
        lg_event_guess(s);
        return true;
    }
    s->dips = s->g_low * s->g_high > 0.0;
    return s->dips && lg_event_dip(s);
}

/* Takes the value g and the slope at `fraction`. Returns true when the search is over; if s->dips is then
 * still true, the step has no event. */
static inline bool lg_event_look(lg_event_search *s, double g, double slope, double close) {
    if (!s->dips) return lg_event_narrow(s, g, close);
    if (g * s->g_low > 0.0) {
        if ((slope < 0.0) == (g > 0.0))
            s->low = s->fraction, s->g_low = g, s->slope_low = slope;
        else
            s->high = s->fraction, s->g_high = g, s->slope_high = slope;
        return ++s->looks >= LG_EVENT_LOOKS || s->high - s->low <= close || !lg_event_dip(s);
    }
    const bool first = lg_event_counts(s->direction, s->g_low, g);
    s->dips = !first && !lg_event_counts(s->direction, g, s->g_high);
    if (s->dips || g == 0.0) return true;
    if (first)
        s->high = s->fraction, s->g_high = g;
    else
        s->low = s->fraction, s->g_low = g;
    lg_event_guess(s);
    return false;
}

#endif
