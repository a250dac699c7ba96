/* Decides which differences rounding explains.
 *
 * A plan computes what the tape computes, but in another order: sums are split, products are regrouped, equal
 * rows are computed once, and small tensors become scalar code. This changes a result as much as a few
 * roundings of the intermediate numbers. So the tape's nodes are evaluated again several times, and each
 * number that an operation reads is multiplied by 1 + u, where u is uniform in [-4, 4] eps and drawn anew for
 * each reading. The distance by which an element of the output moves from the tape's element is its width. It
 * contains the condition of the element, and it contains both sides of a kink (a maximum, a comparison, a
 * pivot of zero) that lies within rounding. Every second evaluation uses the scalar code of the operations
 * that have it, and changes the result of each instruction in this way. Its distance is measured from the
 * same code without changes, so that wrong code does not explain itself. The evaluations have the plan's
 * type, so that roundings inside an operation count too. The tape is in double precision for both types, and
 * its inputs are numbers that a float represents exactly.
 *
 * An element is explained if it differs by at most 2 widths of one or of four evaluations, or by 4 widths of
 * 400. If half of the evaluations move an element by more than half of its size, it has no correct digit: it
 * is a quotient of rounding errors. The tail of its distribution falls like 1/x, and one element in 4000 lies
 * beyond 10 times the largest of 400. Such an element may differ by 10 widths. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "autodiff/random/random.h"
#include "autodiff/program/scalars.h"

#define UNITS      4.0  /* eps */
#define AT_ONCE    8.0  /* eps: a relative difference that is accepted without computing a width */
#define VERY_LARGE 1e15 /* numbers on the tape beyond which a recording is not compared */
enum { MOST_CODE = 1024 };
typedef struct stage {
    int evaluations;
    double widths, of_no_digit;
} stage;
static const stage stages[] = {{1, 2.0, 2.0}, {4, 2.0, 2.0}, {400, 4.0, 10.0}};

/* ---- numbers of the tape ---- */

void find_truth(lg_tape *tape, const lg_program *program, size_t function, size_t rows, lg_rng *rng,
                truth *out) {
    truth *t = out;
    *t = (truth){.tape = tape, .rows = rows, .seed = lg_rng_next(rng)};
    lg_tape_reset(tape);
    const lg_port *in = lg_program_inputs(program, function, &t->inputs);
    const lg_port *to = lg_program_outputs(program, function, &t->outputs);
    for (size_t i = 0; i < t->inputs; i++) {
        const lg_shape shape = lg_port_shape(&in[i], rows);
        void *values = NULL;
        t->in_count[i] = lg_shape_count(shape);
        t->in[i] = lg_input_buffer(tape, shape, &values);
        for (size_t e = 0; values != NULL && e < t->in_count[i]; e++)
            ((double *)values)[e] = (double)(float)lg_rng_uniform_in(rng, -1.0, 1.0);
    }
    for (size_t j = 0; j < t->outputs; j++) t->out_count[j] = lg_shape_count(lg_port_shape(&to[j], rows));
    if (lg_program_record(tape, program, function, NULL, t->in, t->out) != LG_OK)
        stop("function %s with %zu rows: %s", lg_program_function_name(program, function), rows,
             lg_tape_message(tape));
    t->finite = true;
    for (uint32_t n = 0; t->finite && n < tape->count; n++)
        for (size_t i = 0; i < tape->nodes[n].count; i++)
            t->finite = t->finite && fabs(((const double *)tape->nodes[n].value)[i]) <= VERY_LARGE;
}

/* ---- evaluating the tape with other roundings ---- */

static double eps_of(lg_dtype dtype) {
    return dtype == LG_F64 ? DBL_EPSILON : (double)FLT_EPSILON;
}

static double least_of(lg_dtype dtype) {
    return dtype == LG_F64 ? DBL_MIN : (double)FLT_MIN;
}

typedef struct shaking {
    const lg_tape *tape;
    lg_rng rng;
    const lg_kernels *k; /* of the plan's type */
    double eps, least;   /* units of relative and absolute rounding of the type */
    void **value;        /* of each node */
    unsigned char *memory, *inputs;
    bool code;    /* use scalar code where an operation has it */
    double units; /* largest change in eps; 0: no change */
} shaking;

static double number_at(const lg_kernels *k, const void *values, size_t i) {
    return k->size == sizeof(double) ? ((const double *)values)[i] : (double)((const float *)values)[i];
}

/* y = x with random changes. The sign of 0 is random, as plans do not keep it (scalars.h). */
static void copy_shaken(shaking *s, size_t count, const void *x, void *y) {
    for (size_t i = 0; i < count; i++) {
        const uint64_t bits = lg_rng_next(&s->rng);
        const double u = (double)(int32_t)(uint32_t)bits * 0x1p-31,
                     v = (double)(int32_t)(uint32_t)(bits >> 32) * 0x1p-31;
        const double from = number_at(s->k, x, i);
        double to = from + s->units * (from * s->eps * u + s->least * v);
        if (from == 0.0) to = s->units > 0.0 && bits % 2 == 0 ? -from : from;
        s->k->convert_in(1, &to, (unsigned char *)y + i * s->k->size);
    }
}

/* Operations that only move numbers do not round. */
static bool rounds(const lg_node *n, const lg_shape *const *shapes) {
    return n->op->terms == NULL || n->op->terms(shapes, &n->attr, &n->shape) > 0;
}

static void *of(const shaking *s, void *numbers, size_t i) {
    return (unsigned char *)numbers + i * s->k->size;
}

/* Runs one instruction. Its operands are results of earlier instructions, for some followed by an exponent or
 * an integer. */
static void run_instruction(shaking *s, const lg_scalar_code *c, uint32_t at, uint32_t spare, void *results) {
    uint32_t operands[4], count = 0;
    while (count < lg_scalar_instructions(c->op)) {
        operands[count] = c->in[count];
        count++;
    }
    operands[count] = c->op == LG_S_POW ? spare : c->n;
    s->k->convert_in(1, &c->p, of(s, results, spare));
    const lg_scalar_group group = {.op = (uint32_t)c->op, .count = 1, .result = at};
    s->k->scalars(1, &group, operands, results);
    copy_shaken(s, 1, of(s, results, at), of(s, results, at));
}

/* Evaluates the node by the operation's scalar code and changes every result. Returns false if the operation
 * has no scalar code. */
static bool evaluate_code(shaking *s, const lg_evaluation *e, const lg_op *op) {
    lg_scalar *x[LG_MAX_INPUTS], *y = room(e->count, sizeof *y);
    lg_scalars code;
    uint32_t inputs = 0;
    lg_scalars_init(&code, NULL);
    unsigned char *const first = s->inputs; /* the e->x[k] follow one another there */
    for (uint32_t k = 0; k < e->inputs; k++) {
        const size_t count = lg_shape_count(*e->in[k]);
        x[k] = room(count, sizeof *x[k]);
        for (size_t i = 0; i < count; i++) x[k][i] = lg_s_input(&code, inputs++);
    }
    const bool can = lg_scalars_expand(&code, op, e, (const lg_scalar *const *)x, y);
    void *results = room((size_t)code.count + 1, s->k->size);
    for (uint32_t i = 0; can && i < code.count; i++) {
        const lg_scalar_code *c = &code.code[i];
        if (c->op == LG_S_CONSTANT)
            s->k->convert_in(1, &c->p, of(s, results, i));
        else if (c->op == LG_S_INPUT)
            memcpy(of(s, results, i), of(s, first, c->n), s->k->size);
        else
            run_instruction(s, c, i, code.count, results);
    }
    for (size_t i = 0; can && i < e->count; i++) memcpy(of(s, e->y, i), of(s, results, y[i]), s->k->size);
    free(results);
    lg_scalars_destroy(&code);
    for (uint32_t k = 0; k < e->inputs; k++) free(x[k]);
    free(y);
    return can;
}

static void evaluate(shaking *s, const lg_node *n, void *y) {
    const lg_shape *shapes[LG_MAX_INPUTS];
    const void *x[LG_MAX_INPUTS];
    const uint32_t *parents = &s->tape->parents[n->parents];
    unsigned char *at = s->inputs;
    for (uint32_t k = 0; k < n->inputs; k++) shapes[k] = &s->tape->nodes[parents[k]].shape;
    const bool shake = rounds(n, shapes);
    for (uint32_t k = 0; k < n->inputs; k++) {
        const size_t count = s->tape->nodes[parents[k]].count;
        x[k] = shake ? at : s->value[parents[k]];
        if (shake) copy_shaken(s, count, s->value[parents[k]], at);
        at += count * s->k->size;
    }
    lg_evaluation e = {.k = s->k,
                       .attr = &n->attr,
                       .inputs = n->inputs,
                       .in = shapes,
                       .x = x,
                       .shape = &n->shape,
                       .count = n->count,
                       .y = y};
    if (s->code && shake && n->count <= MOST_CODE && evaluate_code(s, &e, n->op)) return;
    if (n->op->scratch != NULL) e.scratch = lg_alloc(NULL, n->op->scratch(&e) + 1, 1);
    (void)n->op->forward(&e);
    lg_free(NULL, e.scratch);
}

static void shake(shaking *s) {
    unsigned char *at = s->memory;
    for (uint32_t i = 0; i < s->tape->count; i++) {
        const lg_node *n = &s->tape->nodes[i];
        if (n->flags & LG_NODE_VIEW && n->inputs > 0) {
            s->value[i] = (unsigned char *)s->value[s->tape->parents[n->parents]] + n->attr.i[3] * s->k->size;
            continue;
        }
        s->value[i] = at;
        at += n->count * s->k->size;
        if (n->op->forward != NULL)
            evaluate(s, n, s->value[i]);
        else
            s->k->convert_in(n->count, n->value, s->value[i]);
    }
}

static void open_shaking(shaking *s, const truth *t, lg_dtype dtype) {
    size_t all = 1, most = 1;
    *s = (shaking){
        .tape = t->tape, .k = lg_kernels_for(dtype), .eps = eps_of(dtype), .least = least_of(dtype)};
    lg_rng_seed(&s->rng, t->seed, 4);
    for (uint32_t i = 0; i < s->tape->count; i++) {
        const lg_node *n = &s->tape->nodes[i];
        size_t own = 0;
        for (uint32_t k = 0; k < n->inputs; k++)
            own += s->tape->nodes[s->tape->parents[n->parents + k]].count;
        if (own > most) most = own;
        all += n->count;
    }
    s->value = room(s->tape->count, sizeof *s->value);
    s->memory = room(all, sizeof(double));
    s->inputs = room(most, sizeof(double));
}

static void close_shaking(shaking *s) {
    free(s->value);
    free(s->memory);
    free(s->inputs);
}

/* ---- checking an output ---- */

static const double *truth_of(const truth *t, size_t j) {
    return lg_node_at(t->tape, t->out[j])->value;
}

static bool all_at_once(const truth *t, size_t j, lg_dtype dtype, const void *got, double eps) {
    const double *want = truth_of(t, j);
    for (size_t i = 0; i < t->out_count[j]; i++)
        if (!(fabs(number_at(lg_kernels_for(dtype), got, i) - want[i]) <= AT_ONCE * eps * fabs(want[i])))
            return false;
    return true;
}

/* Index of the first element that the evaluations of `in` do not explain, or SIZE_MAX. *width gets its
 * width. */
static size_t unexplained(const truth *t, size_t j, lg_dtype dtype, const void *got, const stage *in,
                          double *width) {
    const double *want = truth_of(t, j);
    const size_t count = t->out_count[j];
    double *spread = room(count, sizeof *spread), *plain = room(count, sizeof *plain);
    int *lost = room(count, sizeof *lost);
    size_t found = SIZE_MAX;
    shaking s;
    open_shaking(&s, t, dtype);
    s.code = true;
    if (in->evaluations > 1) shake(&s);
    if (in->evaluations > 1) s.k->convert_out(count, s.value[t->out[j].index], plain);
    s.units = UNITS;
    for (int n = 0; n < in->evaluations; n++) {
        s.code = n % 2 == 1;
        shake(&s);
        const void *moved = s.value[t->out[j].index];
        for (size_t i = 0; i < count; i++) {
            const double by = fabs(number_at(s.k, moved, i) - (s.code ? plain[i] : want[i]));
            lost[i] += by > 0.5 * fabs(want[i]);
            /* NaN is kept: then the true result is not a number */
            if (by > spread[i] || isnan(by)) spread[i] = by;
        }
    }
    for (size_t i = 0; found == SIZE_MAX && i < count; i++) {
        const double widths = 2 * lost[i] > in->evaluations ? in->of_no_digit : in->widths;
        const double bound = widths * spread[i] + AT_ONCE * s.eps * fabs(want[i]) + s.least;
        *width = spread[i];
        if (fabs(number_at(lg_kernels_for(dtype), got, i) - want[i]) > bound ||
            (isnan(number_at(lg_kernels_for(dtype), got, i)) && !isnan(bound)))
            found = i;
    }
    close_shaking(&s);
    free(spread);
    free(plain);
    free(lost);
    return found;
}

bool explained(const truth *t, size_t j, lg_dtype dtype, const void *got, char *sentence, size_t size) {
    double width;
    if (all_at_once(t, j, dtype, got, eps_of(dtype))) return true;
    size_t i = 0;
    for (size_t n = 0; n < LG_COUNT(stages) && i != SIZE_MAX; n++)
        i = unexplained(t, j, dtype, got, &stages[n], &width);
    if (i == SIZE_MAX) return true;
    (void)snprintf(sentence, size,
                   "output %zu, element %zu: %.17g, not %.17g; rounding gives it a width of %.2g", j, i,
                   number_at(lg_kernels_for(dtype), got, i), truth_of(t, j)[i], width);
    return false;
}
