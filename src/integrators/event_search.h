/* The search for the time at which a number g changes its sign inside of a step, by steps of a fraction of
 * it. */
#ifndef LG_EVENT_SEARCH_H
#define LG_EVENT_SEARCH_H

#include <stdbool.h>

/* [low, high] of the step brackets it; `fraction` is where to look next. */
typedef struct lg_event_search {
    int event, looks;
    int side; /* which end moved last: -1, 1 */
    double low, high, g_low, g_high, fraction;
} lg_event_search;

enum { LG_EVENT_LOOKS = 60 };

/* Whether the change from `before` to `after` is one: direction 1 rises, -1 falls, 0 either. */
static inline bool lg_event_counts(int direction, double before, double after) {
    const bool rises = before < 0.0 && after >= 0.0, falls = before > 0.0 && after <= 0.0;
    return (rises && direction >= 0) || (falls && direction <= 0);
}

/* False position, kept inside of the bracket. */
static inline void lg_event_guess(lg_event_search *s) {
    s->fraction = s->low + (s->high - s->low) * (s->g_low / (s->g_low - s->g_high));
    if (!(s->fraction > s->low && s->fraction < s->high)) s->fraction = 0.5 * (s->low + s->high);
}

/* The step of `fraction` ended with g. An end that stays twice loses half of its weight (the Illinois rule).
 * True: the time is known to `close` of the step, and is `fraction`. */
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

#endif
