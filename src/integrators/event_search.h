/* The search for the time at which a number g changes its sign inside of a step, by steps of a fraction of
 * it. Where g has the same sign at both ends, the search begins at the extremum of g nearest to 0. */
#ifndef LG_EVENT_SEARCH_H
#define LG_EVENT_SEARCH_H

#include <math.h>
#include <stdbool.h>

/* Times are parts of the step: [low, high] brackets the change or the extremum, `fraction` is where to look
 * next. Slopes are dg/d(this time). */
typedef struct lg_event_search {
    int event, looks;
    int direction; /* 1: g rises; -1: g falls; 0: either */
    int side;      /* which end moved last: -1, 1 */
    bool dips;     /* no change of sign is known yet: the search is for the extremum */
    double low, high, g_low, g_high, slope_low, slope_high, fraction;
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

/* A cubic lies between the least and the largest of its end values and of g_low + slope_low/3,
 * g_high - slope_high/3. So where neither g_low + REACH slope_low nor g_high - REACH slope_high changes its
 * sign, the cubic nowhere comes to half of the distance from 0 of the nearer end. */
#define LG_EVENT_REACH (2.0 / 3.0)

/* Looks next at the extremum toward 0 of the cubic with the values and slopes of both ends. False: there is
 * no such extremum, or it is not half as far from 0 as the nearer end. */
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

/* s has the values and slopes of the step's ends. Whether there is something to look for. */
static inline bool lg_event_begin(lg_event_search *s) {
    s->low = 0.0, s->high = 1.0;
    if (lg_event_counts(s->direction, s->g_low, s->g_high)) {
        lg_event_guess(s);
        return true;
    }
    s->dips = s->g_low * s->g_high > 0.0;
    return s->dips && lg_event_dip(s);
}

/* As lg_event_narrow, with the slope at `fraction`. When it is over and s->dips holds, there is no event. */
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
