/* Calls CasADi externals as CasADi does, and compares values and all derivatives with the program. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apps/random/exports.h"
#include "liegrad/program.h"

enum { SLOTS = 96, POINTS = 2, MOST_SECOND = 512 };

/* ---- what an external has to have ---- */

/* Arguments or results in CasADi's order; `like` is the port whose size a column has. */
typedef struct slots {
    size_t count;
    char name[SLOTS][160];
    size_t rows[SLOTS], columns[SLOTS];
} slots;

typedef struct ports {
    const lg_port *in, *out;
    size_t ins, outs;
} ports;

static void add_slot(slots *s, const char *name, size_t rows, size_t columns) {
    if (s->count == SLOTS) stop("too many arguments of an external");
    (void)snprintf(s->name[s->count], sizeof s->name[0], "%s", name);
    s->rows[s->count] = rows;
    s->columns[s->count++] = columns;
}

static void add_columns(slots *s, const char *begin, const lg_port *like, size_t count) {
    char name[64];
    for (size_t i = 0; i < count; i++) {
        (void)snprintf(name, sizeof name, "%s%s", begin, like[i].name);
        add_slot(s, name, lg_shape_count(like[i].shape), 1);
    }
}

/* Blocks jac_<row>_<column>, rows in the outer loop. */
static void add_blocks(slots *s, const slots *rows, const slots *columns) {
    char name[160];
    for (size_t r = 0; r < rows->count; r++)
        for (size_t c = 0; c < columns->count; c++) {
            (void)snprintf(name, sizeof name, "jac_%s_%s", rows->name[r], columns->name[c]);
            add_slot(s, name, rows->rows[r], columns->rows[c]);
        }
}

static void expect_value(const ports *f, slots *in, slots *out) {
    add_columns(in, "", f->in, f->ins);
    add_columns(out, "", f->out, f->outs);
}

static void expect_forward(const ports *f, slots *in, slots *out) {
    add_columns(in, "", f->in, f->ins);
    add_columns(in, "out_", f->out, f->outs);
    add_columns(in, "fwd_", f->in, f->ins);
    add_columns(out, "fwd_", f->out, f->outs);
}

static void expect_adjoint(const ports *f, slots *in, slots *out) {
    add_columns(in, "", f->in, f->ins);
    add_columns(in, "out_", f->out, f->outs);
    add_columns(in, "adj_", f->out, f->outs);
    add_columns(out, "adj_", f->in, f->ins);
}

static void expect_jacobian(const ports *f, slots *in, slots *out) {
    static slots y;
    y.count = 0;
    add_columns(in, "", f->in, f->ins);
    add_columns(&y, "", f->out, f->outs);
    add_blocks(out, &y, in);
    add_columns(in, "out_", f->out, f->outs);
}

static void expect_second(const ports *f, slots *in, slots *out) {
    static slots adjoints;
    adjoints.count = 0;
    add_columns(in, "", f->in, f->ins);
    add_columns(in, "out_", f->out, f->outs);
    add_columns(in, "adj_", f->out, f->outs);
    add_columns(&adjoints, "adj_", f->in, f->ins);
    add_blocks(out, &adjoints, in);
    add_columns(in, "out_adj_", f->in, f->ins);
}

static const struct {
    const char *begin;
    lg_derivative_kind kind; /* of all but the first */
    void (*expect)(const ports *f, slots *in, slots *out);
} kinds[] = {{"", LG_DERIVATIVE_KIND_COUNT, expect_value},
             {"fwd1_", LG_DERIVATIVE_FORWARD, expect_forward},
             {"adj1_", LG_DERIVATIVE_ADJOINT, expect_adjoint},
             {"jac_", LG_DERIVATIVE_JACOBIAN, expect_jacobian},
             {"jac_adj1_", LG_DERIVATIVE_JACOBIAN_OF_ADJOINT, expect_second}};
enum { VALUE, FORWARD, ADJOINT, JACOBIAN, SECOND };

/* ---- the external ---- */

typedef struct external {
    int (*call)(const double **arg, double **res, long long *iw, double *w, int mem);
    long long (*n_in)(void), (*n_out)(void);
    const char *(*name_in)(long long), *(*name_out)(long long);
    const long long *(*sparsity_in)(long long), *(*sparsity_out)(long long);
    int (*work)(long long *, long long *, long long *, long long *);
    int (*checkout)(void);
    void (*release)(int);
} external;

/* Returns how many of the symbols there are. */
static size_t open_external(const model *m, const char *begin, external *e) {
    static const char *const ends[] = {"",          "_n_in",        "_n_out",        "_name_in",
                                       "_name_out", "_sparsity_in", "_sparsity_out", "_work",
                                       "_checkout", "_release"};
    size_t all = 0;
    for (size_t i = 0; i < LG_COUNT(ends); i++) {
        void *symbol = symbol_in(m, "%s%s_%s%s", begin, m->name, m->function, ends[i]);
        ((void **)(void *)e)[i] = symbol;
        all += symbol != NULL;
    }
    return all;
}

static size_t nonzeros(const long long *s) {
    return (size_t)(s[2] == 1 ? s[0] * s[1] : s[2 + s[1]]);
}

/* Checks a pattern in CasADi's form: {rows, columns, 1}, or columns of ascending rows. */
static bool is_pattern(const long long *s, size_t rows, size_t columns) {
    if (s[0] != (long long)rows || s[1] != (long long)columns) return false;
    if (s[2] == 1) return true;
    const long long *from = s + 2, *row = from + columns + 1;
    bool good = from[0] == 0;
    for (size_t c = 0; good && c < columns; c++) {
        good = from[c + 1] >= from[c];
        for (long long k = from[c]; good && k < from[c + 1]; k++)
            good = row[k] >= 0 && row[k] < (long long)rows && (k == from[c] || row[k] > row[k - 1]);
    }
    return good;
}

/* The nonzeros as a full row-major matrix. */
static void spread(const long long *s, const double *from, double *to) {
    const bool dense = s[2] == 1;
    for (long long i = 0; i < s[0] * s[1]; i++) to[i] = 0;
    for (long long c = 0, k = 0; c < s[1]; c++) {
        const long long end = dense ? (c + 1) * s[0] : s[2 + c + 1];
        for (; k < end; k++) to[(dense ? k - c * s[0] : s[2 + s[1] + 1 + k]) * s[1] + c] = from[k];
    }
}

/* ---- comparisons ---- */

typedef struct comparison {
    const external *e;
    const slots *in, *out;
    const truth *t;
    const lg_port *in_port, *out_port; /* of the function that computes the result */
    double *work;
    long long work_size;
    const double *arg[SLOTS];
    double *res[SLOTS];
} comparison;

static bool check_form(const comparison *c, finding *f) {
    const external *e = c->e;
    if (e->n_in() != (long long)c->in->count || e->n_out() != (long long)c->out->count)
        return found(f, false, "%lld arguments and %lld results", e->n_in(), e->n_out());
    if (e->name_in(e->n_in()) != NULL || e->name_out(-1) != NULL)
        return found(f, false, "names beyond the last");
    for (size_t i = 0; i < c->in->count; i++) {
        const long long *s = e->sparsity_in((long long)i);
        const bool port = port_named(c->in_port, c->t->inputs, c->in->name[i]) != SIZE_MAX;
        if (strcmp(e->name_in((long long)i), c->in->name[i]) != 0 || !is_pattern(s, c->in->rows[i], 1) ||
            nonzeros(s) != (port ? c->in->rows[i] : 0))
            return found(f, false, "argument %zu is not %s", i, c->in->name[i]);
    }
    size_t used = 0;
    for (size_t o = 0; o < c->out->count; o++) {
        const long long *s = e->sparsity_out((long long)o);
        const bool port = port_named(c->out_port, c->t->outputs, c->out->name[o]) != SIZE_MAX;
        used += port;
        if (strcmp(e->name_out((long long)o), c->out->name[o]) != 0 ||
            !is_pattern(s, c->out->rows[o], c->out->columns[o]) || (!port && nonzeros(s) > 0))
            return found(f, false, "result %zu is not %s", o, c->out->name[o]);
    }
    return used == c->t->outputs || found(f, false, "a result is missing");
}

static bool call(comparison *c, double **res, finding *f) {
    for (long long i = 0; i < c->work_size + 1; i++) c->work[i] = NAN;
    const int memory = c->e->checkout();
    if (c->e->call(c->arg, res, NULL, c->work, memory) != 0) return found(f, false, "the call fails");
    c->e->release(memory);
    return isnan(c->work[c->work_size]) || found(f, false, "numbers behind the work memory are written");
}

/* Result `o`, requested alone, has the same bits. */
static bool same_alone(comparison *c, size_t o, finding *f) {
    double *res[SLOTS] = {NULL};
    const size_t count = nonzeros(c->e->sparsity_out((long long)o));
    res[o] = room(count, sizeof(double));
    bool same = call(c, res, f);
    if (same && memcmp(res[o], c->res[o], count * sizeof(double)) != 0)
        same = found(f, false, "%s alone has other bits", c->out->name[o]);
    free(res[o]);
    return same;
}

static bool compare_result(const comparison *c, size_t o, finding *f) {
    char sentence[256];
    const size_t port = port_named(c->out_port, c->t->outputs, c->out->name[o]);
    if (port == SIZE_MAX) return true;
    double *full = room(c->out->rows[o] * c->out->columns[o], sizeof *full);
    spread(c->e->sparsity_out((long long)o), c->res[o], full);
    const bool good = explained(c->t, port, LG_F64, full, sentence, sizeof sentence);
    free(full);
    return good || found(f, false, "%s: %s", c->out->name[o], sentence);
}

static bool compare(comparison *c, finding *f) {
    long long sizes[4] = {0};
    if (!check_form(c, f)) return false;
    if (c->e->work(&sizes[0], &sizes[1], &sizes[2], &sizes[3]) != 0) return found(f, false, "no sizes");
    c->work_size = sizes[3];
    c->work = room((size_t)c->work_size, sizeof(double));
    for (size_t i = 0; i < c->in->count; i++) {
        const size_t port = port_named(c->in_port, c->t->inputs, c->in->name[i]);
        c->arg[i] = port == SIZE_MAX ? NULL : input_of(c->t, port);
    }
    for (size_t o = 0; o < c->out->count; o++)
        c->res[o] = room(nonzeros(c->e->sparsity_out((long long)o)), sizeof(double));
    bool good = call(c, c->res, f);
    for (size_t o = 0; good && o < c->out->count; o++) good = compare_result(c, o, f);
    if (good) good = same_alone(c, c->t->seed % c->out->count, f);
    for (size_t o = 0; o < c->out->count; o++) free(c->res[o]);
    free(c->work);
    return good;
}

/* ---- the functions of a model ---- */

static bool check_points(model *m, size_t function, const external *e, const slots *in, const slots *out,
                         finding *f) {
    lg_tape *tape = NULL;
    lg_rng rng;
    bool good = true;
    lg_rng_seed(&rng, m->r->number, 300);
    if (lg_tape_create(NULL, NULL, &tape) != LG_OK) stop("no memory");
    for (int p = 0; good && p < POINTS; p++) {
        truth t;
        static comparison c;
        size_t count;
        find_truth(tape, m->program, function, 1, &rng, &t);
        tallied.functions += p == 0;
        tallied.unfit += p == 0 && !t.finite;
        c = (comparison){.e = e, .in = in, .out = out, .t = &t};
        c.in_port = lg_program_inputs(m->program, function, &count);
        c.out_port = lg_program_outputs(m->program, function, &count);
        if (t.finite) good = compare(&c, f);
    }
    lg_tape_destroy(tape);
    return good;
}

/* Which derivatives lg-export has to write: none of functions with a port that all rows share, and no second
 * derivatives of functions with very many inputs. */
static size_t derivative_wanted(model *m, size_t kind, const ports *p, bool adjoint) {
    size_t numbers = 0;
    bool shared = false;
    for (size_t i = 0; i < p->ins; i++) {
        shared = shared || p->in[i].shared;
        numbers += lg_shape_count(p->in[i].shape);
    }
    for (size_t o = 0; o < p->outs; o++) shared = shared || p->out[o].shared;
    if (shared || (kind == SECOND && (numbers > MOST_SECOND || !adjoint))) return SIZE_MAX;
    return derivative_of(m, kinds[kind].kind, m->function);
}

static bool check(model *m, finding *f) {
    static slots in, out;
    finding own;
    bool adjoint = false;
    for (size_t k = 0; k < LG_COUNT(kinds); k++) {
        external e;
        ports p;
        const size_t base = function_named(m, m->function);
        p.in = lg_program_inputs(m->program, base, &p.ins);
        p.out = lg_program_outputs(m->program, base, &p.outs);
        const size_t function = k == VALUE ? base : derivative_wanted(m, k, &p, adjoint);
        const size_t symbols = open_external(m, kinds[k].begin, &e);
        if (k == ADJOINT) adjoint = function != SIZE_MAX;
        if (symbols != (function == SIZE_MAX ? 0 : sizeof e / sizeof(void *)))
            return found(f, false, "%s%s has %zu symbols", kinds[k].begin, m->function, symbols);
        if (function == SIZE_MAX) continue;
        in.count = out.count = 0;
        kinds[k].expect(&p, &in, &out);
        if (!check_points(m, function, &e, &in, &out, &own))
            return found(f, false, "%s%s: %.400s", kinds[k].begin, m->function, own.sentence);
    }
    return true;
}

const target target_casadi = {.name = "casadi", .built = "lib%s.so", .check = check};
