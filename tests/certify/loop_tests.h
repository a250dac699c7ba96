/* Loops are drawn, proved, attacked and counted. LG_LOOP=NUMBER: that one alone. LG_SAY=1: a line for each
 * loop. */
#ifndef LG_LOOP_TESTS_H
#define LG_LOOP_TESTS_H

#include <inttypes.h>
#include <time.h>

#include "loop_attack.h"

typedef struct loop_counts {
    size_t loops, proved, converge, refuted, undecided, rejected, ties, endless, slow;
    double proof, attack;
} loop_counts;

static inline double loop_seconds(void) {
    return (double)clock() / CLOCKS_PER_SEC;
}

static inline void print_counts(const char *name, const loop_counts *c) {
    print_message("%-16s %6zu %7zu %9zu %8zu %10zu %9zu %6zu %8zu %5zu %7.1f %7.1f\n", name, c->loops,
                  c->proved, c->converge, c->refuted, c->undecided, c->rejected, c->ties, c->endless, c->slow,
                  c->proof, c->attack);
}

/* Proves and attacks the loop of a number; false if a false proof was found. */
static inline bool attack_loop(uint64_t number, size_t samples, size_t starts, loop_counts *c) {
    static const size_t boxes[] = {2000, 3000, 3000, 3000};
    loop *l = TEST_ARRAY(loop, 1);
    attack *a = TEST_ARRAY(attack, 1);
    lg_certify *certify = NULL;
    lg_certify_result r;
    lg_error error;
    const double start = loop_seconds();
    loop_draw(number, l);
    attack_begin(a, l, number);
    if (l->level > 0) { /* just above the truth, or below it */
        const double level = attack_level(a, l->level, 2000), by = loop_log(&a->rng, 1e-7, 0.1);
        if (level > 0 && (level < 0.99 * l->level || loop_chance(&a->rng, 0.7)))
            l->level = level * (loop_chance(&a->rng, 0.5) ? 1 + by : 1 - by);
        if (l->eps >= l->level) l->eps = 0;
    }
    const double search = loop_seconds() - start;
    const lg_certify_spec spec = loop_spec(l);
    c->loops++;
    c->attack += search;
    if (lg_certify_create(NULL, &spec, &certify, &error) != LG_OK) {
        c->rejected++;
        if (getenv("LG_SAY"))
            print_message("%" PRIu64 " %s: %s\n", number, loop_kinds[l->kind].name, error.message);
        c->proof += loop_seconds() - start - search;
        return true;
    }
    lg_test_owns(certify, release_certify);
    assert_told(lg_certify_run(certify, boxes[l->n - 1], 60, &r, &told));
    c->proof += loop_seconds() - start - search;
    if (getenv("LG_SAY"))
        print_message("%" PRIu64 " %s n %zu m %zu mode %d code %u %u: %d %d %d, %zu boxes %.3f s (%.3f)\n",
                      number, loop_kinds[l->kind].name, l->n, l->m, (int)l->mode, l->rate.length,
                      l->control.length, r.verified, r.converges, r.finished, r.boxes, r.seconds, c->proof);
    c->proved += r.verified;
    c->converge += r.converges;
    c->refuted += r.finished && !r.verified;
    c->undecided += !r.finished;
    if (!r.verified) return true;
    const char *eps = strstr(r.claim, "eps = "), *level = strstr(r.claim, "c = ");
    assert_true(strtod(eps + 6, NULL) >= r.eps && strtod(level + 4, NULL) <= r.level);
    const double proved = loop_seconds();
    a->r = r;
    const bool holds = attack_proof(a, samples, starts);
    if (!holds)
        print_message("FALSE: loop %" PRIu64 ", %s, mode %d, %zu states: %s\n  %s\n", number,
                      loop_kinds[l->kind].name, (int)l->mode, l->n, a->found, r.claim);
    c->ties += a->undecided;
    c->endless += a->endless;
    c->slow += a->slow;
    c->attack += loop_seconds() - proved;
    return holds;
}

static inline void attack_loops_from(size_t first, size_t count, size_t samples, size_t starts) {
    loop_counts counts[LG_COUNT(loop_kinds)] = {{0}}, modes[LOOP_MODES] = {{0}}, all = {0};
    static const char *const names[LOOP_MODES] = {"continuous", "held", "steps"};
    size_t found = 0, coarse = 0;
    const char *only = getenv("LG_LOOP");
    for (size_t k = only != NULL ? strtoul(only, NULL, 10) : first; k < first + count; k++) {
        const size_t mark = lg_test_owned();
        loop_counts one = {0};
        loop *l = TEST_ARRAY(loop, 1);
        loop_draw(k, l);
        found += !attack_loop(k, samples, starts, &one);
        loop_counts *const to[] = {&counts[l->kind], &modes[l->mode], &all};
        for (size_t i = 0; i < LG_COUNT(to); i++) {
            to[i]->loops += one.loops, to[i]->proved += one.proved, to[i]->converge += one.converge;
            to[i]->refuted += one.refuted, to[i]->undecided += one.undecided;
            to[i]->rejected += one.rejected, to[i]->ties += one.ties, to[i]->endless += one.endless;
            to[i]->slow += one.slow, to[i]->proof += one.proof, to[i]->attack += one.attack;
        }
        coarse += l->mode == LOOP_HELD;
        lg_test_give_back(mark);
        if (k % 1000 == 999) print_counts("so far", &all);
        if (only != NULL) break;
    }
    print_message("%-16s %6s %7s %9s %8s %10s %9s %6s %8s %5s %7s %7s\n", "kind", "loops", "proved",
                  "converge", "refuted", "undecided", "rejected", "ties", "endless", "slow", "s proof",
                  "attack");
    for (size_t i = 0; i < LG_COUNT(loop_kinds); i++) print_counts(loop_kinds[i].name, &counts[i]);
    for (size_t i = 0; i < LOOP_MODES; i++) print_counts(names[i], &modes[i]);
    print_counts("all", &all);
    assert_int_equal(found, 0);
    if (only == NULL) assert_true(4 * all.proved >= all.loops && 5 * coarse >= all.loops);
}

static inline void attack_loops(size_t count, size_t samples, size_t starts) {
    attack_loops_from(0, count, samples, starts);
}

#endif
