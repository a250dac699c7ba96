/* Random calls of an FMU. A driver knows the mode of its instance, its time and the values of states, inputs
 * and parameters. Most calls are allowed in this mode and must succeed. Other calls are not allowed, or have
 * wrong arguments: they must return an error and change nothing. States are kept, serialised and put back,
 * also in another instance: a step from there must give the same bits. Six drivers run at the same time. Then
 * each driver runs again alone, and must read the same numbers. */
#include <inttypes.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apps/random/fmu.h"

enum { THREADS = 6, CALLS = 120, KEPT = 3, ERROR = 3 };

/* Modes in which calls are allowed (FMI 2.0.4, 3.2.3 and 4.2.4; FMI 3.0.2, 2.3.1). */
enum {
    INSTANTIATED = 1,
    INITIALIZATION = 2,
    EVENT = 4,
    CONTINUOUS = 8,
    STEP = 16,
    TERMINATED = 32,
    ANY = 63,
    EVALUATED = ANY & ~INSTANTIATED
};

/* What the driver knows of its instance. `numbers` has the numbers of all variables; the results among them
 * are valid only if `read`. */
typedef struct contents {
    unsigned mode;
    double time;
    bool read;
    double *numbers;
} contents;

typedef struct kept {
    void *state; /* NULL: nothing is kept */
    contents of;
} kept;

typedef struct driver {
    const fmu *f;
    bool exchange;
    uint64_t seed, digest;
    size_t calls, illegal, states;
    void *c, *twin;
    contents now;
    kept kept[KEPT];
    lg_rng rng;
    bool good;
    finding why;
} driver;

static bool fail(driver *d, const char *what) {
    if (d->good) (void)found(&d->why, false, "%s, driver %" PRIu64 ", call %zu", what, d->seed, d->calls);
    d->good = false;
    return false;
}

/* Every call goes through here: `status` must be OK, or an error if the call is wrong. */
static bool expect(driver *d, int status, bool right, const char *what) {
    d->calls++;
    d->illegal += !right;
    if (right == (status == 0) && (right || status == ERROR)) return right;
    char words[128];
    (void)snprintf(words, sizeof words, "%s in mode %u gives %d", what, d->now.mode, status);
    return fail(d, words);
}

static void digest(driver *d, const void *bytes, size_t size) {
    for (const unsigned char *at = bytes; size > 0; size--) d->digest = (d->digest ^ *at++) * 1099511628211u;
}

/* ---- what an instance holds ---- */

static size_t bytes_of(const driver *d) {
    return d->f->numbers * sizeof(double);
}

/* Whether chosen variables have the same bits. */
static bool same(const driver *d, bool known, const double *a, const double *b) {
    for (size_t v = 0; v < d->f->count; v++) {
        const variable *of = &d->f->variables[v];
        if (of->known == known && memcmp(a + of->at, b + of->at, of->count * sizeof *a) != 0) return false;
    }
    return true;
}

static bool is_readable(const driver *d) {
    return (d->now.mode & EVALUATED) != 0;
}

/* Reads everything and compares it with what is known. */
static void look(driver *d) {
    double *got = room(d->f->numbers, sizeof *got);
    if (expect(d, fmu_get(d->f, d->c, ~UINT64_C(0), got), is_readable(d), "get")) {
        if (!same(d, true, got, d->now.numbers)) (void)fail(d, "a value is another one");
        if (d->now.read && !same(d, false, got, d->now.numbers)) (void)fail(d, "a result is another one");
        memcpy(d->now.numbers, got, bytes_of(d));
        d->now.read = true;
        digest(d, got, bytes_of(d));
    }
    free(got);
}

static void copy(const driver *d, const contents *from, contents *to) {
    double *numbers = to->numbers != NULL ? to->numbers : room(d->f->numbers, sizeof *numbers);
    *to = *from;
    to->numbers = numbers;
    memcpy(numbers, from->numbers, bytes_of(d));
}

/* Version 2 has a function that tells the time in co-simulation. In version 3 the time is a variable; its
 * reference follows the last reference of the model. */
static void look_at_time(driver *d) {
    const bool readable = (d->now.mode & (STEP | TERMINATED)) != 0 && !d->exchange;
    const unsigned reference = (unsigned)d->f->count;
    double time = NAN;
    if (d->f->version == 2) {
        int (*two)(void *, int, double *);
        *(void **)&two = symbol_in(d->f->m, "fmi2GetRealStatus");
        if (!readable || !expect(d, two(d->c, 2, &time), true, "time")) return;
    } else {
        int (*three)(void *, const unsigned *, size_t, double *, size_t);
        *(void **)&three = symbol_in(d->f->m, "fmi3GetFloat64");
        if (!expect(d, three(d->c, &reference, 1, &time, 1), is_readable(d), "time")) return;
    }
    if (time != d->now.time) (void)fail(d, "the time is another one");
}

/* ---- calls ---- */

static bool in(const driver *d, unsigned modes) {
    return (d->now.mode & modes) != 0;
}

static void change(driver *d, int status, unsigned from, unsigned to, const char *what) {
    if (expect(d, status, in(d, from), what)) d->now.mode = to;
}

static void begin(driver *d) {
    const double time = lg_rng_uniform(&d->rng);
    const bool right = in(d, INSTANTIATED);
    change(d, fmu_begin(d->f, d->c, time), INSTANTIATED, INITIALIZATION, "begin");
    if (right) d->now.time = time;
}

static void leave(driver *d) {
    change(d, d->f->leave(d->c), INITIALIZATION, d->exchange ? EVENT : STEP, "leave");
}

static void terminate_it(driver *d) {
    change(d, d->f->terminate(d->c), EVENT | CONTINUOUS | STEP, TERMINATED, "terminate");
}

static void enter_event(driver *d) {
    change(d, d->f->enter_event(d->c), EVENT | CONTINUOUS, EVENT, "enter event");
}

static void enter_continuous(driver *d) {
    change(d, d->f->enter_continuous(d->c), EVENT, CONTINUOUS, "enter continuous");
}

static void discrete(driver *d) {
    (void)expect(d, fmu_discrete(d->f, d->c), in(d, EVENT), "discrete states");
}

static void completed(driver *d) {
    (void)expect(d, fmu_completed(d->f, d->c), in(d, CONTINUOUS), "completed step");
}

/* The values of a new instance. */
static void begin_again(driver *d) {
    d->now.mode = INSTANTIATED;
    d->now.time = 0;
    d->now.read = false;
    memset(d->now.numbers, 0, bytes_of(d));
    d->now.numbers[d->f->numbers - 1] = 0.01; /* the longest step */
}

static void reset(driver *d) {
    if (expect(d, d->f->reset(d->c), true, "reset")) begin_again(d);
}

static void set_time(driver *d) {
    const double time = chance(&d->rng, 0.1) ? (double)NAN : lg_rng_uniform(&d->rng);
    if (expect(d, d->f->set_time(d->c, time), in(d, EVENT | CONTINUOUS) && !isnan(time), "set time"))
        d->now.time = time;
}

/* Draws values of some states, inputs and parameters. */
static void set(driver *d) {
    const uint64_t chosen = fmu_all(d->f, true) & lg_rng_next(&d->rng);
    double *numbers = room(d->f->numbers, sizeof *numbers);
    memcpy(numbers, d->now.numbers, bytes_of(d));
    for (size_t v = 0; v < d->f->count; v++)
        for (size_t k = 0; chosen >> v & 1 && k < d->f->variables[v].count; k++)
            numbers[d->f->variables[v].at + k] = v + 1 < d->f->count ? lg_rng_uniform_in(&d->rng, -1, 1)
                                                                     : lg_rng_uniform_in(&d->rng, 0.005, 0.1);
    if (expect(d, fmu_set(d->f, d->c, chosen, numbers), !in(d, TERMINATED), "set")) {
        memcpy(d->now.numbers, numbers, bytes_of(d));
        d->now.read = false;
    }
    free(numbers);
}

static void set_states(driver *d) {
    const size_t n = d->f->states;
    double *numbers = room(n, sizeof *numbers);
    for (size_t k = 0; k < n; k++) numbers[k] = lg_rng_uniform_in(&d->rng, -1, 1);
    if (expect(d, d->f->set_states(d->c, numbers, n), in(d, CONTINUOUS), "set states")) {
        memcpy(d->now.numbers, numbers, n * sizeof *numbers);
        d->now.read = false;
    }
    free(numbers);
}

static void get_states(driver *d) {
    const size_t n = d->f->states;
    double *numbers = room(n + 1, sizeof *numbers);
    const bool right = d->exchange && is_readable(d);
    if (expect(d, d->f->get_states(d->c, numbers, n), right, "get states") &&
        memcmp(numbers, d->now.numbers, n * sizeof *numbers) != 0)
        (void)fail(d, "a state is another one");
    (void)expect(d, d->f->get_states(d->c, numbers, n + 1), false, "get too many states");
    if (expect(d, d->f->get_rates(d->c, numbers, n), right, "get rates") && n > 0) {
        look(d);
        if (memcmp(numbers, d->now.numbers + d->f->variables[1].at, n * sizeof *numbers) != 0)
            (void)fail(d, "a rate is another one");
    }
    (void)expect(d, d->f->get_nominals(d->c, numbers, n), d->exchange, "get nominals");
    free(numbers);
}

/* The same derivative again must have the same bits. */
static void derivative(driver *d) {
    const bool back = d->f->version == 3 && chance(&d->rng, 0.5);
    const uint64_t known = fmu_all(d->f, true), unknown = fmu_all(d->f, false);
    double *seed = room(d->f->numbers, sizeof *seed), *out[2];
    for (size_t k = 0; k < d->f->numbers; k++) seed[k] = lg_rng_uniform_in(&d->rng, -1, 1);
    const bool right = is_readable(d) && (back ? d->f->adjoint : d->f->forward);
    for (size_t i = 0; i < 2; i++) {
        out[i] = room(d->f->numbers, sizeof *seed);
        (void)expect(d, (back ? fmu_adjoint : fmu_forward)(d->f, d->c, unknown, known, seed, out[i]), right,
                     "derivative");
    }
    if (right && memcmp(out[0], out[1], bytes_of(d)) != 0) (void)fail(d, "a derivative is another one");
    digest(d, out[0], bytes_of(d));
    /* A result is not an argument. */
    (void)expect(d, (back ? fmu_adjoint : fmu_forward)(d->f, d->c, unknown, unknown, seed, out[0]), false,
                 "derivative by a result");
    for (size_t i = 0; i < 2; i++) free(out[i]);
    free(seed);
}

/* ---- steps and kept states ---- */

/* If a step ends in a state that is not finite, the status must be an error, and no state may have
 * changed. */
static bool take(driver *d, double length, double *after) {
    const int status = fmu_step(d->f, d->c, d->now.time, length);
    if (!in(d, STEP)) return expect(d, status, false, "step");
    d->calls++;
    if (status != 0 && (status != ERROR || d->f->states == 0)) return fail(d, "a step fails");
    if (fmu_get(d->f, d->c, ~UINT64_C(0), after) != 0) return fail(d, "get after a step");
    if (status == 0) return true;
    if (!same(d, true, after, d->now.numbers)) return fail(d, "a step that fails has moved");
    return false;
}

static void *kept_state(driver *d, void *c) {
    void *state = NULL;
    (void)expect(d, d->f->keep(c, &state), true, "keep");
    return state;
}

/* The state as bytes, read by another instance. */
static void *read_again(driver *d, void *state, void *into) {
    size_t size = 0;
    void *again = NULL;
    (void)expect(d, d->f->size_of(d->c, state, &size), true, "size");
    char *bytes = room(size, 1);
    (void)expect(d, d->f->write(d->c, state, bytes, size - 1), false, "write into too few bytes");
    (void)expect(d, d->f->write(d->c, state, bytes, size), true, "write");
    (void)expect(d, d->f->read(into, bytes, size, &again), true, "read");
    bytes[lg_rng_below(&d->rng, size)] ^= 16;
    void *damaged = NULL;
    (void)expect(d, d->f->read(into, bytes, size, &damaged), false, "read damaged bytes");
    free(bytes);
    return again;
}

/* A step, then the same step from the kept state: in this instance, or in the twin from bytes. */
static void step_twice(driver *d) {
    const double length = lg_rng_uniform_in(&d->rng, 0.001, 0.05);
    double *first = room(d->f->numbers, sizeof *first), *second = room(d->f->numbers, sizeof *first);
    void *state = in(d, STEP) ? kept_state(d, d->c) : NULL, *own = d->c;
    const bool elsewhere = chance(&d->rng, 0.5);
    if (take(d, length, first)) {
        if (elsewhere) {
            void *again = read_again(d, state, d->twin);
            (void)d->f->drop(d->c, &state);
            state = again;
            d->c = d->twin;
        }
        (void)expect(d, d->f->put_back(d->c, state), true, "put back");
        d->states++;
        look(d);
        look_at_time(d);
        if (!take(d, length, second) || memcmp(first, second, bytes_of(d)) != 0)
            (void)fail(d, "a step from a state that was put back differs");
        d->c = own;
        memcpy(d->now.numbers, first, bytes_of(d));
        d->now.time += length;
        d->now.read = true;
        digest(d, first, bytes_of(d));
    }
    if (state != NULL) (void)expect(d, d->f->drop(d->c, &state), true, "drop");
    free(second);
    free(first);
}

static void keep(driver *d) {
    kept *k = &d->kept[lg_rng_below(&d->rng, KEPT)];
    if (chance(&d->rng, 0.5) && is_readable(d)) look(d);
    (void)expect(d, d->f->keep(d->c, &k->state), true, "keep"); /* a kept state is written over */
    copy(d, &d->now, &k->of);
}

static void put_back(driver *d) {
    const kept *k = &d->kept[lg_rng_below(&d->rng, KEPT)];
    void *state = k->state;
    if (!expect(d, d->f->put_back(d->c, state), state != NULL, "put back")) return;
    copy(d, &k->of, &d->now);
    d->states++;
    if (is_readable(d)) look(d);
    look_at_time(d);
}

static void put_back_bytes(driver *d) {
    const kept *k = &d->kept[lg_rng_below(&d->rng, KEPT)];
    if (k->state == NULL) return;
    void *again = read_again(d, k->state, d->c);
    (void)expect(d, d->f->put_back(d->c, again), true, "put back");
    (void)expect(d, d->f->drop(d->c, &again), true, "drop");
    copy(d, &k->of, &d->now);
    d->states++;
    if (is_readable(d)) look(d);
    look_at_time(d);
}

/* ---- calls with wrong arguments ---- */

static void wrong(driver *d) {
    const fmu *f = d->f;
    void *state = NULL;
    const double at = d->now.time;
    static const double lengths[] = {0.0, -0.01, NAN, INFINITY};
    for (size_t i = 0; i < LG_COUNT(lengths); i++)
        (void)expect(d, fmu_step(f, d->c, at, lengths[i]), false, "a step of a wrong length");
    (void)expect(d, fmu_step(f, d->c, NAN, 0.01), false, "a step from no time");
    (void)expect(d, fmu_raw(f, d->c, false, SIZE_MAX, false), false, "get of no variable");
    (void)expect(d, fmu_raw(f, d->c, true, SIZE_MAX, false), false, "set of no variable");
    (void)expect(d, fmu_raw(f, d->c, false, 0, true), false, "get without an array");
    (void)expect(d, fmu_raw(f, d->c, true, 0, true), false, "set without an array");
    for (size_t v = 0; v < f->count; v++)
        if (!f->variables[v].known)
            (void)expect(d, fmu_raw(f, d->c, true, v, false), false, "set of a result");
    (void)expect(d, f->put_back(d->c, NULL), false, "put back nothing");
    (void)expect(d, f->keep(d->c, NULL), false, "keep nowhere");
    (void)expect(d, f->read(d->c, NULL, 8, &state), false, "read nothing");
    (void)expect(d, f->set_states(d->c, d->now.numbers, f->states + 1), false, "set too many states");
}

/* Calls without an instance, and with a state of an instance of the other interface. */
static void wrong_instance(driver *d) {
    const fmu *f = d->f;
    double number = 0;
    void *state = NULL;
    size_t size;
    (void)expect(d, f->leave(NULL), false, "leave of nothing");
    (void)expect(d, f->reset(NULL), false, "reset of nothing");
    (void)expect(d, f->terminate(NULL), false, "terminate of nothing");
    (void)expect(d, f->keep(NULL, &state), false, "keep of nothing");
    (void)expect(d, f->size_of(NULL, NULL, &size), false, "size of nothing");
    (void)expect(d, f->get_states(NULL, &number, f->states), false, "states of nothing");
    (void)expect(d, fmu_begin(f, NULL, 0), false, "begin of nothing");
    (void)expect(d, fmu_get(f, NULL, 1, d->now.numbers), false, "get of nothing");
    (void)expect(d, fmu_step(f, NULL, 0, 0.01), false, "step of nothing");
    void *other = fmu_instantiate(f, !d->exchange);
    (void)expect(d, fmu_begin(f, other, 0), true, "begin of another instance");
    (void)expect(d, f->leave(other), true, "leave of another instance");
    state = kept_state(d, other);
    (void)expect(d, f->put_back(d->c, state), false, "put back a state of the other interface");
    (void)expect(d, f->drop(other, &state), true, "drop");
    fmu_free(f, other);
}

/* ---- a driver ---- */

static const struct {
    void (*call)(driver *d);
    unsigned right; /* modes in which the call is right */
} calls[] = {{begin, INSTANTIATED},    {leave, INITIALIZATION},   {terminate_it, EVENT | CONTINUOUS | STEP},
             {reset, TERMINATED},      {enter_event, CONTINUOUS}, {enter_continuous, EVENT},
             {discrete, EVENT},        {completed, CONTINUOUS},   {set_time, EVENT | CONTINUOUS},
             {set, ANY & ~TERMINATED}, {set_states, CONTINUOUS},  {get_states, EVALUATED},
             {look, EVALUATED},        {look_at_time, EVALUATED}, {derivative, EVALUATED},
             {step_twice, STEP},       {step_twice, STEP},        {keep, ANY},
             {put_back, ANY},          {put_back_bytes, ANY},     {wrong, ANY},
             {wrong_instance, ANY}};

static void *drive(void *user) {
    driver *d = user;
    lg_rng_seed(&d->rng, d->seed, 500);
    d->good = true;
    d->exchange = chance(&d->rng, 0.4);
    d->c = fmu_instantiate(d->f, d->exchange);
    d->twin = fmu_instantiate(d->f, d->exchange);
    d->now.numbers = room(d->f->numbers, sizeof(double));
    begin_again(d);
    for (size_t n = 0; d->good && n < CALLS; n++) {
        size_t at = lg_rng_below(&d->rng, LG_COUNT(calls));
        /* Most calls are right ones; the end of an instance is drawn less often. */
        for (int tries = 0; tries < 8 && (!in(d, calls[at].right) || chance(&d->rng, 0.1)); tries++)
            at = lg_rng_below(&d->rng, LG_COUNT(calls));
        if (calls[at].call == terminate_it && chance(&d->rng, 0.7)) continue;
        calls[at].call(d);
    }
    for (size_t k = 0; k < KEPT; k++) {
        if (d->kept[k].state != NULL) (void)d->f->drop(d->c, &d->kept[k].state);
        free(d->kept[k].of.numbers);
        d->kept[k].of.numbers = NULL;
    }
    free(d->now.numbers);
    fmu_free(d->f, d->twin);
    fmu_free(d->f, d->c);
    return NULL;
}

bool check_calls(const fmu *f, finding *out) {
    static driver together[THREADS], alone;
    pthread_t thread[THREADS];
    bool good = true;
    for (size_t i = 0; i < THREADS; i++) {
        together[i] = (driver){.f = f, .seed = THREADS * f->m->r->number + i};
        if (pthread_create(&thread[i], NULL, drive, &together[i]) != 0) stop("no thread");
    }
    for (size_t i = 0; i < THREADS; i++) (void)pthread_join(thread[i], NULL);
    for (size_t i = 0; good && i < THREADS; i++) {
        driver *d = &together[i];
        alone = (driver){.f = f, .seed = d->seed};
        if (d->good) (void)drive(&alone);
        if (d->good && alone.good && d->digest != alone.digest)
            (void)fail(d, "numbers differ when other threads run");
        good = d->good && alone.good;
        if (!good) *out = d->good ? alone.why : d->why;
        tallied.calls += d->calls + alone.calls;
        tallied.illegal += d->illegal + alone.illegal;
        tallied.states += d->states + alone.states;
    }
    return good;
}
