/* Attacks of proofs: states of {V <= c} at which V does not fall, and motions that leave it, do not end at
 * the goal, or become undefined. */
#ifndef LG_LOOP_ATTACK_H
#define LG_LOOP_ATTACK_H

#include "loop_support.h"

enum { ATTACK_SAMPLES = 20000, ATTACK_STARTS = 50, ATTACK_BEST = 8, ATTACK_TEXT = 512 };

typedef long double attack_state[LOOP_STATES];

typedef struct attack {
    const loop *l;
    lg_certify_result r; /* what is claimed */
    lg_rng rng;
    long double L[LOOP_SQUARE], T[LOOP_SQUARE]; /* P = L L^T; T = L^-T: V = |y|^2 with z = T y */
    attack_state best[ATTACK_BEST];             /* y of the states that were nearest to a refutation */
    long double score[ATTACK_BEST];
    size_t undecided, endless, slow;
    uint32_t parts;          /* a motion has at least as many steps */
    char found[ATTACK_TEXT]; /* what refutes the claim; "": nothing */
} attack;

/* ---- V ---- */

static inline void attack_begin(attack *a, const loop *l, uint64_t number) {
    const size_t n = l->n;
    *a = (attack){.l = l, .rng = test_rng(6402, number), .parts = 1};
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j <= i; j++) {
            long double rest = l->P[i * n + j];
            for (size_t k = 0; k < j; k++) rest -= a->L[i * n + k] * a->L[j * n + k];
            a->L[i * n + j] = i == j ? sqrtl(rest) : rest / a->L[j * n + j];
        }
    for (size_t j = 0; j < n; j++)
        for (size_t i = j + 1; i-- > 0;) {
            long double rest = i == j;
            for (size_t k = i + 1; k <= j; k++) rest -= a->L[k * n + i] * a->T[k * n + j];
            a->T[i * n + j] = rest / a->L[i * n + i];
        }
    for (size_t k = 0; k < ATTACK_BEST; k++) a->score[k] = -INFINITY;
}

static inline long double attack_value(const attack *a, const long double *z) {
    const size_t n = a->l->n;
    long double sum = 0;
    for (size_t i = 0; i < n; i++) {
        long double y = 0;
        for (size_t k = i; k < n; k++) y += a->L[k * n + i] * z[k];
        sum += y * y;
    }
    return sum;
}

/* The largest sqrt(V) of |z_i| <= e_i is not above this. */
static inline long double attack_size(const attack *a, const long double *e) {
    long double sum = 0;
    for (size_t i = 0; i < a->l->n; i++) sum += sqrtl((long double)a->l->P[i * (a->l->n + 1)]) * fabsl(e[i]);
    return sum;
}

static inline void attack_states(const attack *a, const long double *y, long double *z) {
    const size_t n = a->l->n;
    for (size_t i = 0; i < n; i++) {
        z[i] = 0;
        for (size_t j = i; j < n; j++) z[i] += a->T[i * n + j] * y[j];
    }
}

static inline long double attack_norm(const attack *a, const long double *y) {
    long double sum = 0;
    for (size_t i = 0; i < a->l->n; i++) sum += y[i] * y[i];
    return sum;
}

static inline void attack_says(attack *a, const long double *z, const char *what, long double before,
                               long double after) {
    size_t at = 0;
    if (a->found[0] != '\0') return;
    at += (size_t)snprintf(a->found, ATTACK_TEXT, "%s: %.18Lg, %.18Lg at (", what, before, after);
    for (size_t i = 0; i < a->l->n; i++)
        at += (size_t)snprintf(a->found + at, ATTACK_TEXT - at, "%s%.18Lg", i == 0 ? "" : ", ", z[i]);
    (void)snprintf(a->found + at, ATTACK_TEXT - at, ") from the goal");
}

/* ---- motions: Gragg's midpoint rule, extrapolated up to order 16, with steps of its own ---- */

/* A constant input u, or NULL: the controller's at every time; and a disturbance of the rate, or NULL */
typedef struct attack_field {
    const long double *u, *disturbance;
} attack_field;

static inline bool attack_rate(const attack *a, const attack_field *f, const long double *z,
                               long double *out) {
    long double u[LOOP_STATES];
    bool defined = f->u != NULL || loop_evaluate(a->l, &a->l->control, z, NULL, u, NULL);
    defined = loop_evaluate(a->l, &a->l->rate, z, f->u != NULL ? f->u : u, out, NULL) && defined;
    for (size_t i = 0; f->disturbance != NULL && i < a->l->n; i++) out[i] += f->disturbance[i];
    return defined;
}

/* One step of length H to z; returns the error in sqrt(V), or infinity. `levels`: how many were needed */
static inline long double attack_step(const attack *a, const attack_field *f, long double *z, long double H,
                                      long double wanted, int *levels) {
    enum { LEVELS = 8 };
    const size_t n = a->l->n;
    attack_state table[LEVELS], first, before, now, rate, change;
    long double error = INFINITY;
    if (!attack_rate(a, f, z, first)) return INFINITY;
    for (int l = 0; l < LEVELS; l++) {
        const int steps = 2 * (l + 1);
        const long double h = H / steps;
        for (size_t i = 0; i < n; i++) before[i] = z[i], now[i] = z[i] + h * first[i];
        for (int k = 1; k <= steps; k++) {
            if (!attack_rate(a, f, now, rate)) return INFINITY;
            for (size_t i = 0; i < n && k < steps; i++) {
                const long double next = before[i] + 2 * h * rate[i];
                before[i] = now[i];
                now[i] = next;
            }
        }
        for (size_t i = 0; i < n; i++) table[l][i] = (now[i] + before[i] + h * rate[i]) / 2;
        for (int k = l - 1; k >= 0; k--) { /* row l, from the right: table[k] is the entry (l, l - k) */
            const long double ratio = (long double)(l + 1) / (k + 1);
            for (size_t i = 0; i < n; i++) {
                change[i] = (table[k + 1][i] - table[k][i]) / (ratio * ratio - 1);
                table[k][i] = table[k + 1][i] + change[i];
            }
        }
        *levels = l + 1;
        if (l < 2) continue;
        error = attack_size(a, change);
        if (error <= wanted) break;
    }
    memcpy(z, table[0], n * sizeof *z);
    return error;
}

/* Moves z for `time`; steps have errors of at most `wanted` in sqrt(V), or are as short as 2^-34 of the
 * time. Returns the sum of errors; infinity: the motion is undefined, or needs too many steps (*endless). */
static inline long double attack_motion(const attack *a, const attack_field *f, long double *z,
                                        long double time, long double wanted, bool *endless) {
    const long double shortest = ldexpl(time, -34);
    long double done = 0, H = time / a->parts, sum = 0;
    *endless = false;
    for (int k = 0; done < time; k++) {
        attack_state next;
        int levels = 0;
        memcpy(next, z, sizeof next);
        if (k > 3000) {
            *endless = true;
            return INFINITY;
        }
        H = fminl(fminl(H, time / a->parts), time - done);
        const long double error = attack_step(a, f, next, H, wanted, &levels);
        if (!(error <= wanted) && H > shortest) {
            H /= isfinite(error) ? 4 : 2;
            continue;
        }
        if (!(error < INFINITY)) return INFINITY;
        memcpy(z, next, a->l->n * sizeof *z);
        sum += error;
        done += H;
        H *= levels < 6 ? 4 : levels < 8 ? 1.5L : 1;
    }
    return sum;
}

/* The state after a period, or a step. Errors are in sqrt(V). */
static inline long double attack_next(attack *a, long double *z, long double part, long double wanted,
                                      bool *endless) {
    attack_state u;
    *endless = false;
    if (!loop_evaluate(a->l, &a->l->control, z, NULL, u, NULL)) return INFINITY;
    if (a->l->mode == LOOP_STEP) {
        attack_state next;
        if (!loop_evaluate(a->l, &a->l->rate, z, u, next, NULL)) return INFINITY;
        memcpy(z, next, a->l->n * sizeof *z);
        return 1e-17L * sqrtl(attack_value(a, z));
    }
    const attack_field f = {u, NULL};
    return attack_motion(a, &f, z, part * a->l->period, wanted, endless);
}

/* ---- one state ---- */

/* The largest V of states that differ from z by model errors */
static inline long double attack_worst(const attack *a, const long double *z) {
    const size_t n = a->l->n;
    long double most = 0;
    for (size_t corner = 0; corner < (a->l->errors ? (size_t)1 << n : 1); corner++) {
        attack_state moved;
        for (size_t i = 0; i < n; i++)
            moved[i] = z[i] + (a->l->errors ? (corner >> i & 1 ? 1 : -1) * (long double)a->l->error[i] : 0);
        most = fmaxl(most, attack_value(a, moved));
    }
    return most;
}

static inline void attack_scale(const attack *a, long double *y, long double V) {
    const long double by = sqrtl(V / attack_norm(a, y)) * (1 - 1e-18L);
    for (size_t i = 0; i < a->l->n; i++) y[i] *= by;
}

static inline bool attack_counts(const attack *a, long double V) {
    return V <= a->r.level && (V >= a->r.eps || a->r.converges);
}

/* (V after - V)/V; what refutes the claim is noted. */
static inline long double attack_held(attack *a, const long double *z) {
    static const long double wanted[] = {1e-3L, 1e-6L, 1e-10L, 1e-14L};
    const long double V = attack_value(a, z);
    long double change = -INFINITY;
    for (size_t k = 0; k < LG_COUNT(wanted); k++) {
        attack_state next;
        bool endless;
        memcpy(next, z, sizeof next);
        const long double error = 10 * attack_next(a, next, 1, wanted[k] * sqrtl(V), &endless);
        if (endless) {
            a->endless++;
            return -INFINITY;
        }
        if (!(error < INFINITY)) {
            attack_says(a, z, "the motion from here is undefined; V and the level are", V, a->r.level);
            return INFINITY;
        }
        const long double after = attack_worst(a, next),
                          around = error * (2 * sqrtl(after) + error) + 1e-15L * (V + after);
        change = (after - V) / V;
        if (!attack_counts(a, V) && after + around <= a->r.level) return -INFINITY;
        if (attack_counts(a, V) && after + around < V) return change;
        if (attack_counts(a, V) ? after - around > V : after - around > a->r.level) {
            attack_says(a, z, attack_counts(a, V) ? "V rises in a period" : "a step leaves the set", V,
                        after);
            return change;
        }
    }
    a->undecided++;
    return change;
}

/* V'/V, the same for continuous inputs */
static inline long double attack_falls(attack *a, const long double *z) {
    const size_t n = a->l->n;
    const long double V = attack_value(a, z);
    attack_state u, rate, size;
    long double sum = 0, sizes = 0, errors = 0;
    if (!loop_evaluate(a->l, &a->l->control, z, NULL, u, NULL) ||
        !loop_evaluate(a->l, &a->l->rate, z, u, rate, size)) {
        attack_says(a, z, "the loop is undefined here; V and the level are", V, a->r.level);
        return INFINITY;
    }
    if (!attack_counts(a, V)) return -INFINITY;
    for (size_t i = 0; i < n; i++) {
        long double slope = 0, slopes = 0;
        for (size_t j = 0; j < n; j++) {
            slope += 2 * (long double)a->l->P[i * n + j] * z[j];
            slopes += 2 * fabsl((long double)a->l->P[i * n + j] * z[j]);
        }
        sum += slope * rate[i];
        sizes += slopes * size[i];
        errors += fabsl(slope) * a->l->error[i];
    }
    if (sum + errors > 1e-15L * (sizes + errors)) attack_says(a, z, "V rises; V and V' are", V, sum + errors);
    return (sum + errors) * a->l->tau / V;
}

static inline long double attack_at(attack *a, const long double *z) {
    return a->l->mode == LOOP_CONTINUOUS ? attack_falls(a, z) : attack_held(a, z);
}

/* ---- states of {V <= c} ---- */

/* y with |y|^2 = V */
static inline void attack_on_sphere(attack *a, long double V, long double *y) {
    long double norm = 0;
    while (!(norm > 0)) {
        for (size_t i = 0; i < a->l->n; i++) y[i] = lg_rng_normal(&a->rng);
        norm = attack_norm(a, y);
    }
    attack_scale(a, y, V);
}

/* y near the zero of a guard, with |y|^2 <= c; false: it does not meet the set */
static inline bool attack_on_guard(attack *a, long double c, long double *y) {
    static const long double distances[] = {0, 1e-12L, -1e-12L, 1e-9L, -1e-9L, 1e-5L, -1e-5L};
    const loop *l = a->l;
    const size_t n = l->n, pick = lg_rng_below(&a->rng, LG_COUNT(distances) + 4);
    if (l->guards == 0) return false;
    const loop_guard *g = &l->guard[lg_rng_below(&a->rng, l->guards)];
    const long double by =
        pick < LG_COUNT(distances) ? distances[pick] : g->strip * lg_rng_uniform_in(&a->rng, -2, 2);
    attack_state normal, along;
    long double size = 0, offset = g->a[0] - by, dot = 0;
    for (size_t j = 0; j < n; j++) {
        normal[j] = 0;
        for (size_t i = 0; i <= j; i++) normal[j] += a->T[i * n + j] * g->a[1 + i] / l->size[i];
        size += normal[j] * normal[j];
    }
    const long double nearest = offset * offset / size;
    if (!(nearest <= c)) return false;
    attack_on_sphere(a, 1, along);
    for (size_t j = 0; j < n; j++) dot += along[j] * normal[j] / size;
    for (size_t j = 0; j < n; j++) along[j] -= dot * normal[j];
    const long double room = c - nearest, norm = attack_norm(a, along), share = lg_rng_uniform(&a->rng),
                      scale = n > 1 && norm > 1e-9L
                                  ? sqrtl(room / norm) * (lg_rng_below(&a->rng, 4) == 0 ? 1 : share)
                                  : 0;
    for (size_t j = 0; j < n; j++) y[j] = scale * along[j] - offset * normal[j] / size;
    return true;
}

static inline void attack_draw(attack *a, long double *y) {
    const size_t n = a->l->n;
    const long double c = a->r.level * (1 - 1e-12L), eps = a->r.eps;
    lg_rng *const r = &a->rng;
    const size_t pick = lg_rng_below(r, 16);
    if (pick < 4 && attack_on_guard(a, c, y)) {
        /* on it */
    } else if (pick < 10 && a->score[0] > -INFINITY) { /* about one of the best */
        const long double by = expl(lg_rng_uniform_in(r, -14, 0)) * sqrtl(c);
        memcpy(y, a->best[lg_rng_below(r, ATTACK_BEST)], n * sizeof *y);
        for (size_t i = 0; i < n; i++) y[i] += by * lg_rng_normal(r) / sqrtl((long double)n);
    } else if (pick < 12)
        attack_on_sphere(a, c, y);
    else if (pick < 13)
        attack_on_sphere(a, fminl(c, eps * (1 + 1e-12L)), y);
    else if (pick < 14)
        attack_on_sphere(
            a, c * expl(lg_rng_uniform_in(r, a->r.converges ? -20 : logl(fmaxl(eps, 1e-9L * c) / c), 0)), y);
    else
        attack_on_sphere(a, c * powl(lg_rng_uniform(r), 2 / (long double)n), y);
    if (attack_norm(a, y) > c) attack_scale(a, y, c);
}

/* Keeps the states with the largest scores. */
static inline void attack_keep(attack *a, const long double *y, long double score) {
    size_t least = 0;
    for (size_t k = 1; k < ATTACK_BEST; k++)
        if (a->score[k] < a->score[least]) least = k;
    if (!(score > a->score[least])) return;
    a->score[least] = score;
    memcpy(a->best[least], y, a->l->n * sizeof *y);
}

static inline void attack_sample(attack *a, size_t samples) {
    for (size_t k = 0; k < samples && a->found[0] == '\0'; k++) {
        attack_state y, z;
        attack_draw(a, y);
        attack_states(a, y, z);
        attack_keep(a, y, attack_at(a, z));
        for (size_t i = 0; i < a->l->n && a->r.width != NULL; i++)
            if (!(fabsl(z[i]) <= a->r.width[i]))
                attack_says(a, z, "a state is farther than the width", z[i], a->r.width[i]);
    }
}

/* The smallest V that is found where V rises, below `most`; it is among the best states then. 0: as small as
 * one likes. */
static inline double attack_level(attack *a, double most, size_t samples) {
    a->r = (lg_certify_result){.level = most, .eps = a->l->eps, .converges = !a->l->errors};
    for (size_t k = 0; k < samples && a->r.level > 1e-5 * most; k++) {
        attack_state y, z;
        attack_draw(a, y);
        attack_states(a, y, z);
        const long double score = attack_at(a, z);
        if (a->found[0] != '\0') {
            const double V = (double)attack_value(a, z);
            if (score > 0 && V > 0 && attack_counts(a, V)) {
                a->r.level = V * (1 - 1e-9);
                attack_scale(a, y, V * (1 - 2e-9L));
            }
            a->found[0] = '\0';
        }
        attack_keep(a, y, score < INFINITY ? score : 0);
    }
    for (size_t k = 0; k < ATTACK_BEST; k++) a->score[k] = fmaxl(a->score[k], -1e30L) - 1e30L;
    a->undecided = a->endless = 0;
    return a->r.level > 1e-5 * most ? a->r.level : 0;
}

/* ---- between the samples ---- */

static inline long double attack_peak(attack *a, const long double *from, long double wanted) {
    enum { PIECES = 6 };
    const long double V = attack_value(a, from);
    long double most = 0;
    attack_state z, u;
    if (!loop_evaluate(a->l, &a->l->control, from, NULL, u, NULL)) return 0; /* attack_held finds this */
    const attack_field f = {u, NULL};
    memcpy(z, from, sizeof z);
    for (int p = 0; p < PIECES; p++) {
        bool endless;
        const long double error = attack_motion(a, &f, z, a->l->period / PIECES, wanted * sqrtl(V), &endless),
                          now = attack_value(a, z), around = 10 * error * (2 * sqrtl(now) + 10 * error);
        if (!(error < INFINITY)) break;
        most = fmaxl(most, now);
        if (now - around > a->r.between * (1 + 1e-15L))
            attack_says(a, from, "V between the samples exceeds its bound", a->r.between, now);
    }
    return most;
}

static inline void attack_between(attack *a, size_t samples) {
    if (a->l->mode != LOOP_HELD) return;
    for (size_t k = 0; k < ATTACK_BEST; k++) a->score[k] = -INFINITY;
    for (size_t k = 0; k < samples && a->found[0] == '\0'; k++) {
        attack_state y, z;
        attack_draw(a, y);
        attack_states(a, y, z);
        attack_keep(a, y, attack_peak(a, z, 1e-6L));
    }
}

/* ---- motions from the boundary ---- */

static inline void attack_simulate(attack *a, size_t starts) {
    enum { PERIODS = 200, MORE = 4000, PEAKS = 4 };
    const loop *l = a->l;
    const long double c = a->r.level, goal = a->r.converges ? fminl(a->r.eps, 1e-4L * c) : a->r.eps;
    for (size_t s = 0; s < starts && a->found[0] == '\0'; s++) {
        attack_state y, z, disturbance = {0};
        if (s % 4 == 1)
            memcpy(y, a->best[s / 4 % ATTACK_BEST], sizeof y);
        else if (s % 4 != 0 || !attack_on_guard(a, c * (1 - 1e-12L), y))
            attack_on_sphere(a, c * (1 - 1e-12L), y);
        const long double norm = attack_norm(a, y);
        if (!(norm > 0) || !(norm < INFINITY)) attack_on_sphere(a, c * (1 - 1e-12L), y);
        attack_states(a, y, z);
        for (size_t i = 0; i < l->n && l->errors; i++)
            disturbance[i] = l->error[i] * (lg_rng_below(&a->rng, 3) == 0 ? lg_rng_uniform_in(&a->rng, -1, 1)
                                                                          : loop_sign(&a->rng));
        const long double start = attack_value(a, z);
        long double V = start;
        int k = 0;
        for (; k < (a->slow == 0 ? MORE : PERIODS + 1) && V >= goal && a->found[0] == '\0'; k++) {
            bool endless;
            attack_state before;
            memcpy(before, z, sizeof before);
            if (l->mode == LOOP_HELD && k < PEAKS) (void)attack_peak(a, z, 1e-12L);
            const attack_field f = {NULL, disturbance};
            const long double wanted = 1e-12L * sqrtl(V);
            long double error = INFINITY, after = 0;
            for (a->parts = 1; a->parts <= 64; a->parts *= 64) { /* where V rises, again with short steps */
                memcpy(z, before, sizeof before);
                error = l->mode == LOOP_CONTINUOUS ? attack_motion(a, &f, z, 0.5L * l->tau, wanted, &endless)
                                                   : attack_next(a, z, 1, wanted, &endless);
                after = attack_value(a, z);
                if (!endless && error < INFINITY && after <= V) break;
            }
            a->parts = 1;
            if (endless) {
                a->endless++;
                break;
            }
            if (!(error < INFINITY)) {
                attack_says(a, before, "a motion becomes undefined after here; V and the level are", V, c);
                break;
            }
            for (size_t i = 0; i < l->n && l->mode != LOOP_CONTINUOUS; i++) z[i] += disturbance[i];
            after = attack_value(a, z);
            const long double around = 10 * error * (2 * sqrtl(after) + 10 * error) + 1e-15L * V;
            if (after - around > (V >= a->r.eps || a->r.converges ? V : c))
                attack_says(a, before, "V rises along a motion", V, after);
            V = after;
            if (k == PERIODS && V >= start * (1 - 1e-10L))
                attack_says(a, z, "V does not fall along a motion", start, V);
        }
        a->slow += k == MORE; /* one is enough */
    }
}

static inline void attack_volume(attack *a) {
    const size_t n = a->l->n;
    long double volume =
        powl(3.14159265358979323846L, n / 2.0L) / tgammal(n / 2.0L + 1) * powl(a->r.level, n / 2.0L);
    const attack_state nowhere = {0};
    for (size_t i = 0; i < n; i++) volume *= a->T[i * (n + 1)];
    if (!(a->r.volume <= volume * (1 + 1e-9L)))
        attack_says(a, nowhere, "the volume is too large", volume, a->r.volume);
}

/* Whether nothing was found */
static inline bool attack_proof(attack *a, size_t samples, size_t starts) {
    attack_sample(a, samples);
    attack_simulate(a, starts);
    attack_between(a, samples / 20);
    attack_volume(a);
    return a->found[0] == '\0';
}

#endif
