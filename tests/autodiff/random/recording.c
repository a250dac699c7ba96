/* Draws recordings, records them on a tape, adds them to a program, shrinks and prints them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "autodiff/ops/op_table.h"
#include "autodiff/random/random.h"

#define LARGEST_NUMBER 1e3 /* largest absolute value of a variable while a recording is drawn */
/* distance of operands from a piece's valid values, relative to the largest of these */
#define ANCHORED 0.01

enum {
    COSTLIEST = 20000
}; /* most elements per row, of a function whose derivative is taken, times the number of directions */
size_t operations_recorded[LG_OPS_MOST];

/* ---- parameters of all recordings ---- */

static const double weights[12] = {0.5, -1.25, 0.75, 1.5, -0.25, 1.0, -0.5, 0.375, 2.0, -1.0, 0.625, -0.125};
static const lg_parameter_spec parameters[PARAMETERS] = {{"theta", {2, {4, 3}}, weights},
                                                         {"beta", {1, {3}}, weights + 5}};

lg_program *empty_program(void) {
    lg_program *program = NULL;
    if (lg_program_create(NULL, &program) != LG_OK) stop("no memory");
    for (size_t i = 0; i < PARAMETERS; i++)
        if (lg_program_add_parameter(program, &parameters[i], NULL) != LG_OK) stop("parameters");
    return program;
}

/* ---- slots ---- */

static slot slot_of(const body *f, uint32_t at) {
    if (at < PARAMETERS) return (slot){false, parameters[at].shape};
    at -= PARAMETERS;
    return at < f->inputs ? f->input[at] : f->step[at - f->inputs].made;
}

static uint32_t slots_of(const body *f) {
    return PARAMETERS + f->inputs + f->steps;
}

/* The slot that is used for slot `at`: a step that is left out is replaced by its first operand. */
static uint32_t resolved(const body *f, uint32_t at) {
    while (at >= PARAMETERS + f->inputs && f->step[at - PARAMETERS - f->inputs].left_out)
        at = f->step[at - PARAMETERS - f->inputs].operand[0];
    return at;
}

static lg_shape with_rows(bool batched, uint32_t rows, lg_shape shape) {
    const lg_port port = {.shape = shape, .shared = !batched};
    return lg_port_shape(&port, rows);
}

/* ---- conversion of operands to other shapes ---- */

static lg_var flat(lg_tape *tape, lg_var v, bool batched, uint32_t rows, lg_shape shape) {
    const uint32_t count = (uint32_t)lg_shape_count(shape);
    return lg_reshape(tape, v, with_rows(batched, rows, lg_shape1(count)));
}

/* Makes `m` numbers (per row) out of `n`: a part of them, repetitions of all, or all with zeros added. */
static lg_var counted_out(lg_tape *tape, lg_var v, int axis, uint32_t n, uint32_t m, uint32_t how) {
    lg_var parts[4] = {v, v, v, v};
    if (n > m) return lg_slice(tape, v, axis, how % (n - m + 1), m);
    if (n == 1) {
        lg_shape shape = lg_var_shape(tape, v);
        shape.dims[axis] = m;
        return lg_broadcast_to(tape, v, shape);
    }
    if (4 * n < m) return lg_pad(tape, v, axis, how % (m - n + 1), m - n - how % (m - n + 1));
    const uint32_t copies = (m + n - 1) / n;
    return lg_slice(tape, lg_concat(tape, parts, copies, axis), axis, 0, m);
}

/* Converts v from `from` to `to`. `how` chooses between the possible ways. */
static lg_var fit(lg_tape *tape, uint32_t rows, lg_var v, slot from, slot to, uint32_t how) {
    const uint32_t n = (uint32_t)lg_shape_count(from.shape), m = (uint32_t)lg_shape_count(to.shape);
    if (from.batched && !to.batched)
        v = how % 2 == 0 ? lg_mean_axis(tape, v, 0, false)
                         : lg_reshape(tape, lg_slice(tape, v, 0, 0, 1), from.shape);
    if (!from.batched && to.batched) {
        v = flat(tape, v, false, rows, from.shape);
        v = lg_broadcast_to(tape, v, lg_shape2(rows, n));
    } else if (lg_same_shape(&from.shape, &to.shape)) {
        return v;
    } else {
        v = flat(tape, v, to.batched, rows, from.shape);
    }
    if (n != m) v = counted_out(tape, v, to.batched ? 1 : 0, n, m, how / 2);
    return lg_reshape(tape, v, with_rows(to.batched, rows, to.shape));
}

/* point + small sin v. A batched operand uses the first row of the point. */
static lg_var anchor(lg_tape *tape, const double *point, slot to, lg_var v) {
    const size_t count = lg_shape_count(to.shape);
    double size = 0.0;
    for (size_t i = 0; i < count; i++) size = fmax(size, fabs(point[i]));
    const lg_var moved = lg_scale(tape, lg_sin(tape, v), ANCHORED * (size > 0.0 ? size : 1.0));
    return lg_add(tape, lg_input(tape, to.shape, point), moved);
}

/* ---- recording on a tape ---- */

/* How a recording is recorded. calls: true while a program is being built; false: called functions are
 * recorded in place of the call. */
typedef struct putting {
    const recording *r;
    bool calls;
    const char *prefix;
} putting;

static lg_status put_function(const putting *p, const body *f, lg_tape *tape, const lg_var *theta,
                              const lg_var *x, lg_var *y);

static lg_shape without_first(lg_shape s) {
    lg_shape rest = {.rank = s.rank - 1};
    for (uint32_t i = 0; i < rest.rank; i++) rest.dims[i] = s.dims[i + 1];
    return rest;
}

/* The shape that the step takes as operand k. */
static slot wanted(const putting *p, const step *s, uint32_t k) {
    if (s->piece == NULL) return p->r->function[s->callee].input[k];
    if (s->piece->any_shape) return s->made;
    const bool batched = s->made.batched && s->piece->batched[k];
    return (slot){batched, batched ? without_first(s->piece->in[k]) : s->piece->in[k]};
}

/* Records the rounds of the loop one after the other. */
static lg_status put_loop(const putting *p, const body *f, lg_tape *tape, const lg_var *theta,
                          const lg_var *x, lg_var *y) {
    lg_var now[MOST_INPUTS];
    for (uint32_t i = 0; i < f->inputs; i++) now[i] = x[i];
    for (uint32_t n = 0; n < f->times; n++) {
        if (put_function(p, f, tape, theta, now, y) != LG_OK) break;
        for (uint32_t i = 0; i < f->inputs; i++)
            if (f->carry[i] > 0) now[i] = y[f->carry[i] - 1];
    }
    return lg_tape_status(tape);
}

static lg_var put_call(const putting *p, const step *s, lg_tape *tape, const lg_var *theta, const lg_var *x) {
    const body *f = &p->r->function[s->callee];
    char name[64];
    lg_var y[MOST_OUTPUTS];
    (void)snprintf(name, sizeof name, "%s%s%u", p->prefix, s->loop ? "loop" : "", s->callee);
    if (p->calls) return lg_program_call(tape, name, s->output, x);
    const lg_status status =
        s->loop ? put_loop(p, f, tape, theta, x, y) : put_function(p, f, tape, theta, x, y);
    return status == LG_OK ? y[s->output] : LG_NONE;
}

/* The piece's payload, rotated so that it begins at index `variant`. */
static const void *turned_payload(lg_tape *tape, const piece *p, uint32_t variant) {
    const bool reals = p->op->payload == LG_PAYLOAD_REALS;
    const uint32_t count = reals ? p->inputs : p->attr.i[0];
    const size_t size = reals ? sizeof(double) : sizeof(uint32_t);
    unsigned char *turned = lg_payload_allocate(tape, count * size);
    for (uint32_t i = 0; turned != NULL && i < count; i++)
        memcpy(turned + i * size, (const unsigned char *)p->attr.pointer + (i + variant) % count * size,
               size);
    return turned;
}

/* Whether the shape rule of the operation accepts this payload. A table whose numbers were turned may be
 * invalid, because their order matters. */
static bool accepts(const piece *p, lg_attr attr, const void *payload) {
    const lg_shape *shapes[MOST_OPERANDS];
    lg_shape out = p->out;
    for (uint32_t k = 0; k < p->inputs; k++) shapes[k] = &p->in[k];
    attr.pointer = payload;
    return payload != NULL && p->op->shape(shapes, p->inputs, &attr, &out) == LG_OK;
}

static lg_var put_piece(const step *s, uint32_t rows, lg_tape *tape, const lg_var *x) {
    const piece *p = s->piece;
    lg_attr attr = p->attr;
    lg_shape shape = p->out;
    if (p->any_shape) shape = with_rows(s->made.batched, rows, s->made.shape);
    if (s->made.batched) shape.dims[0] = rows;
    if (p->op->payload == LG_PAYLOAD_REALS || p->op->payload == LG_PAYLOAD_INDICES)
        attr.pointer = turned_payload(tape, p, s->variant);
    if (p->op->payload == LG_PAYLOAD_INDICES && !accepts(p, attr, attr.pointer))
        attr.pointer = turned_payload(tape, p, 0);
    return p->op->record != NULL ? p->op->record(tape, x[0], &attr, shape)
                                 : lg_record_shaped(tape, p->op, x, p->inputs, &attr, shape);
}

static lg_var put_step(const putting *p, const body *f, const step *s, uint32_t rows, lg_tape *tape,
                       const lg_var *theta, const lg_var *v) {
    lg_var x[MOST_OPERANDS];
    for (uint32_t k = 0; k < s->inputs; k++) {
        const uint32_t from = resolved(f, s->operand[k]);
        const slot to = wanted(p, s, k);
        x[k] = fit(tape, rows, v[from], slot_of(f, from), to, s->how[k]);
        if (s->anchored && !s->piece->any_shape) x[k] = anchor(tape, s->piece->point[k], to, x[k]);
    }
    if (s->piece == NULL) return put_call(p, s, tape, theta, x);
    /* The solution is computed from the factor and differentiated by the matrix, so they belong together. */
    if (s->piece->op == &lg_op_spd_solve) x[2] = lg_record(tape, &lg_op_spd_factor, x, 1, NULL);
    if (p->calls) operations_recorded[lg_op_place(s->piece->op)]++;
    return put_piece(s, rows, tape, x);
}

static uint32_t rows_of(const body *f, const lg_tape *tape, const lg_var *x) {
    for (uint32_t i = 0; i < f->inputs; i++)
        if (f->input[i].batched) return lg_var_shape(tape, x[i]).dims[0];
    return 1;
}

static void put_slots(const putting *p, const body *f, lg_tape *tape, const lg_var *theta, const lg_var *x,
                      lg_var *v) {
    const uint32_t rows = rows_of(f, tape, x);
    for (uint32_t i = 0; i < PARAMETERS; i++) v[i] = theta[i];
    for (uint32_t i = 0; i < f->inputs; i++) v[PARAMETERS + i] = x[i];
    for (uint32_t i = 0; i < f->steps; i++)
        if (!f->step[i].left_out)
            v[PARAMETERS + f->inputs + i] = put_step(p, f, &f->step[i], rows, tape, theta, v);
}

static lg_status put_function(const putting *p, const body *f, lg_tape *tape, const lg_var *theta,
                              const lg_var *x, lg_var *y) {
    lg_var v[PARAMETERS + MOST_INPUTS + MOST_STEPS];
    put_slots(p, f, tape, theta, x, v);
    for (uint32_t j = 0; j < f->outputs; j++) y[j] = v[resolved(f, f->output[j])];
    return lg_tape_status(tape);
}

/* ---- drawing ---- */

static const lg_shape shapes[] = {{0, {0}},    {1, {1}},    {1, {3}}, {1, {3}},  {1, {6}},
                                  {2, {4, 3}}, {2, {3, 3}}, {1, {2}}, {1, {20}}, {3, {2, 3, 2}}};

static void draw_inputs(lg_rng *rng, body *f) {
    f->apart = chance(rng, 0.6);
    f->inputs = 1 + (uint32_t)lg_rng_below(rng, MOST_INPUTS);
    for (uint32_t i = 0; i < f->inputs; i++)
        f->input[i] = (slot){i == 0 || chance(rng, 0.7), shapes[lg_rng_below(rng, LG_COUNT(shapes))]};
}

/* Late slots are more likely. Operands that the step has already are drawn often, so that operands are
 * shared. */
static uint32_t draw_operand(lg_rng *rng, const body *f, const step *s, uint32_t k) {
    const uint32_t all = slots_of(f), late = all < 4 ? all : 4;
    if (k > 0 && chance(rng, 0.4)) return s->operand[lg_rng_below(rng, k)];
    return chance(rng, 0.6) ? all - 1 - (uint32_t)lg_rng_below(rng, late) : (uint32_t)lg_rng_below(rng, all);
}

static void draw_operands(lg_rng *rng, const body *f, step *s) {
    for (uint32_t k = 0; k < s->inputs; k++) {
        s->operand[k] = draw_operand(rng, f, s, k);
        s->how[k] = chance(rng, 0.5) ? 0 : (uint32_t)lg_rng_below(rng, 64);
    }
}

/* If rows must not affect each other, an operand that is not batched is drawn again until its slot is not
 * batched either. */
static void keep_apart(lg_rng *rng, const putting *p, const body *f, step *s) {
    for (uint32_t k = 0; f->apart && k < s->inputs; k++)
        for (uint32_t tries = 0; !wanted(p, s, k).batched && slot_of(f, s->operand[k]).batched; tries++)
            s->operand[k] = (uint32_t)lg_rng_below(rng, tries < 4 ? slots_of(f) : PARAMETERS);
}

static step draw_call(lg_rng *rng, const recording *r, const body *f) {
    const body *callee = &r->function[0];
    const uint32_t output = (uint32_t)lg_rng_below(rng, callee->outputs);
    step s = {.output = output,
              .inputs = callee->inputs,
              .made = slot_of(callee, callee->output[output]),
              .loop = callee->times > 0 && chance(rng, 0.6)};
    draw_operands(rng, f, &s);
    return s;
}

static step draw_step(lg_rng *rng, const recording *r, const body *f) {
    if (f != r->function && chance(rng, 0.25)) return draw_call(rng, r, f);
    const piece *before = f->steps > 0 ? f->step[f->steps - 1].piece : NULL;
    const bool layer = before != NULL && before->op->begins_layer != NULL && chance(rng, 0.5);
    step s = {.piece = layer ? draw_layer_end(rng) : draw_piece(rng)};
    s.inputs = s.piece->inputs;
    draw_operands(rng, f, &s);
    if (layer) s.operand[0] = slots_of(f) - 1;
    const bool batched = s.piece->batches && chance(rng, 0.85);
    s.made = (slot){batched, batched ? without_first(s.piece->out) : s.piece->out};
    if (s.piece->any_shape) s.made = slot_of(f, s.operand[0]);
    s.anchored = chance(rng, 0.3);
    return s;
}

static bool sizes_are_usual(const lg_tape *tape, uint32_t from) {
    for (uint32_t n = from; n < tape->count; n++)
        for (size_t i = 0; i < tape->nodes[n].count; i++)
            if (!(fabs(((const double *)tape->nodes[n].value)[i]) <= LARGEST_NUMBER)) return false;
    return true;
}

/* Adds the step if it can be recorded and its numbers are not too large. */
static bool try_step(const putting *p, body *f, const step *s, uint32_t rows, lg_tape *tape, lg_var *v) {
    const uint32_t at = slots_of(f), before = tape->count;
    v[at] = put_step(p, f, s, rows, tape, v, v);
    if (lg_tape_status(tape) != LG_OK)
        stop("recording %llu: %s", (unsigned long long)p->r->number, lg_tape_message(tape));
    if (!sizes_are_usual(tape, before)) return false;
    f->step[f->steps++] = *s;
    return true;
}

/* Some steps are recorded twice: as equal subexpressions, which plans compute once, or equal except for the
 * payload. */
static void draw_steps(lg_rng *rng, const putting *p, body *f, lg_tape *tape, lg_var *v, uint32_t rows) {
    const uint32_t steps = 2 + (uint32_t)lg_rng_below(rng, MOST_STEPS - 4);
    for (uint32_t tries = 0; f->steps < steps && tries < 4 * MOST_STEPS; tries++) {
        step s = draw_step(rng, p->r, f);
        keep_apart(rng, p, f, &s);
        bool taken = try_step(p, f, &s, rows, tape, v);
        if (!taken && !s.anchored && s.piece != NULL) {
            s.anchored = true;
            taken = try_step(p, f, &s, rows, tape, v);
        }
        s.variant = chance(rng, 0.3);
        if (taken && chance(rng, 0.25)) (void)try_step(p, f, &s, rows, tape, v);
    }
}

static void draw_outputs(lg_rng *rng, body *f) {
    f->outputs = 1 + (uint32_t)lg_rng_below(rng, 3);
    for (uint32_t j = 0; j < f->outputs; j++) {
        const uint32_t all = slots_of(f);
        f->output[j] = j == 0 || chance(rng, 0.5)
                           ? all - 1 - (uint32_t)lg_rng_below(rng, all < 2 ? all : 2)
                           : PARAMETERS + (uint32_t)lg_rng_below(rng, all - PARAMETERS);
    }
}

static bool same_slot(slot a, slot b) {
    return a.batched == b.batched && lg_same_shape(&a.shape, &b.shape);
}

/* Chooses something that the function has already as the next value of input i: another input, a step, or the
 * output that another input becomes. */
static bool carries_slot(lg_rng *rng, body *f, uint32_t i) {
    for (uint32_t tries = 0; tries < 6; tries++) {
        const uint32_t at = PARAMETERS + (uint32_t)lg_rng_below(rng, slots_of(f) - PARAMETERS);
        if (!same_slot(slot_of(f, at), f->input[i])) continue;
        for (uint32_t j = 0; j < f->outputs && f->carry[i] == 0; j++)
            if (f->output[j] == at) f->carry[i] = j + 1;
        if (f->carry[i] == 0) {
            f->output[f->outputs++] = at;
            f->carry[i] = f->outputs;
        }
        f->times = 1 + (uint32_t)lg_rng_below(rng, 5);
        return true;
    }
    return false;
}

/* Chooses outputs that become the inputs of the next round. */
static void draw_loop(lg_rng *rng, const putting *p, body *f, lg_tape *tape, lg_var *v, uint32_t rows) {
    const step sine = {.piece = piece_named("sin"), .inputs = 1};
    for (uint32_t i = 0; i < f->inputs && f->steps < MOST_STEPS && f->outputs < MOST_OUTPUTS; i++) {
        step s = sine;
        if (i > 0 && chance(rng, 0.3)) continue;
        if (chance(rng, 0.3) && carries_slot(rng, f, i)) continue;
        s.operand[0] = slots_of(f) - 1 - (uint32_t)lg_rng_below(rng, 3);
        s.how[0] = (uint32_t)lg_rng_below(rng, 64);
        s.made = f->input[i];
        keep_apart(rng, p, f, &s);
        if (!try_step(p, f, &s, rows, tape, v)) continue;
        f->output[f->outputs++] = slots_of(f) - 1;
        f->carry[i] = f->outputs;
        f->times = 1 + (uint32_t)lg_rng_below(rng, 5);
    }
}

static void draw_function(lg_rng *rng, recording *r) {
    lg_tape *tape;
    lg_var v[PARAMETERS + MOST_INPUTS + MOST_STEPS];
    const uint32_t rows = 3;
    const putting p = {r, false, ""};
    body *f = &r->function[r->functions];
    if (lg_tape_create(NULL, NULL, &tape) != LG_OK) stop("no memory");
    draw_inputs(rng, f);
    for (uint32_t i = 0; i < PARAMETERS + f->inputs; i++) {
        const slot s = slot_of(f, i);
        const lg_shape shape = with_rows(s.batched, rows, s.shape);
        double values[256];
        for (size_t j = 0; j < lg_shape_count(shape); j++) values[j] = lg_rng_uniform_in(rng, -1.0, 1.0);
        v[i] = lg_input(tape, shape, i < PARAMETERS ? parameters[i].values : values);
    }
    draw_steps(rng, &p, f, tape, v, rows);
    draw_outputs(rng, f);
    if (chance(rng, 0.2)) draw_loop(rng, &p, f, tape, v, rows);
    lg_tape_destroy(tape);
    r->functions++;
}

void draw_recording(uint64_t number, recording *out) {
    lg_rng rng;
    lg_rng_seed(&rng, number, 2);
    memset(out, 0, sizeof *out);
    out->number = number;
    const uint32_t functions = chance(&rng, 0.3) ? 2 : 1;
    while (out->functions < functions) draw_function(&rng, out);
    out->derivations = chance(&rng, 0.5) ? 1 + (uint32_t)lg_rng_below(&rng, 3) : 0;
    for (uint32_t i = 0; i < out->derivations; i++)
        out->derivation[i] = (derivation){(uint32_t)lg_rng_below(&rng, functions + i),
                                          (lg_derivative_kind)lg_rng_below(&rng, LG_DERIVATIVE_KIND_COUNT)};
    const double scale = lg_rng_uniform(&rng); /* mostly few rows */
    out->rows = (uint32_t)(scale < 0.3    ? 1
                           : scale < 0.7  ? 2 + lg_rng_below(&rng, 7)
                           : scale < 0.98 ? 9 + lg_rng_below(&rng, 56)
                                          : 65 + lg_rng_below(&rng, 936));
}

/* ---- building a program ---- */

typedef struct recorded {
    putting p;
    const body *f;
} recorded;

static lg_status record(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recorded *of = user;
    return put_function(&of->p, of->f, tape, theta, x, y);
}

typedef struct names {
    char of[MOST_OUTPUTS][16];
} names;

static void name_ports(lg_port *ports, names *n, char letter, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        (void)snprintf(n->of[i], sizeof n->of[i], "%c%u", letter, i);
        ports[i].name = n->of[i];
    }
}

static lg_status add_function(lg_program *program, const recording *r, uint32_t at, const char *prefix,
                              lg_error *error) {
    const body *f = &r->function[at];
    lg_port in[MOST_INPUTS] = {{.name = NULL}}, out[MOST_OUTPUTS] = {{.name = NULL}};
    names in_names, out_names;
    char name[32];
    recorded of = {{r, true, prefix}, f};
    name_ports(in, &in_names, 'x', f->inputs);
    name_ports(out, &out_names, 'y', f->outputs);
    for (uint32_t i = 0; i < f->inputs; i++) {
        in[i].shape = f->input[i].shape;
        in[i].shared = !f->input[i].batched;
    }
    (void)snprintf(name, sizeof name, "%s%u", prefix, at);
    const lg_function_spec spec = {name, in, f->inputs, out, f->outputs, record, &of};
    return lg_program_record_function(program, &spec, false, error);
}

static lg_status add_loop(lg_program *program, const recording *r, uint32_t at, const char *prefix,
                          lg_error *error) {
    const body *f = &r->function[at];
    lg_carry carry[MOST_INPUTS];
    names in, out;
    lg_port ports[MOST_OUTPUTS];
    char name[32], of[32];
    size_t carries = 0;
    name_ports(ports, &in, 'x', f->inputs);
    name_ports(ports, &out, 'y', f->outputs);
    for (uint32_t i = 0; i < f->inputs; i++)
        if (f->carry[i] > 0) carry[carries++] = (lg_carry){out.of[f->carry[i] - 1], in.of[i]};
    (void)snprintf(of, sizeof of, "%s%u", prefix, at);
    (void)snprintf(name, sizeof name, "%sloop%u", prefix, at);
    /* Every other loop gives the paths of the outputs whose rank leaves room for one more axis. */
    const char *path[MOST_OUTPUTS];
    size_t paths = 0, count;
    const lg_port *output = lg_program_outputs(program, lg_program_functions(program) - 1, &count);
    for (size_t j = 0; j < count && r->number % 2 == 1; j++)
        if (output[j].shape.rank + !output[j].shared < LG_MAX_RANK) path[paths++] = output[j].name;
    const lg_loop_spec loop = {.size = sizeof loop,
                               .name = name,
                               .function = of,
                               .times = f->times,
                               .carry = carry,
                               .carry_count = carries,
                               .path = path,
                               .path_count = paths};
    return lg_program_add_loop(program, &loop, error);
}

/* Whether a derivative is impossible for an accepted reason: an order that an operation does not have, rows
 * that affect each other, no input or output to derive by. */
static bool refused(lg_status status) {
    return status == LG_UNSUPPORTED || status == LG_NOT_DIFFERENTIABLE || status == LG_INVALID_ARGUMENT;
}

size_t numbers_of(const lg_program *program, size_t at, size_t rows) {
    const lg_function *f = &program->function[at];
    size_t all = 0;
    lg_shape shape;
    if (f->times > 0) return f->times * numbers_of(program, f->callee, rows);
    for (uint32_t i = 0; i < f->nodes; i++)
        if (lg_node_shape_at(&f->node[i], rows, &shape)) all += lg_shape_count(shape);
    return all;
}

/* A Jacobian has one direction per number of a row of the inputs. */
static size_t directions_of(const lg_program *program, size_t at, lg_derivative_kind kind) {
    const lg_function *f = &program->function[at];
    size_t all = 0;
    for (size_t i = 0; i < f->inputs; i++) all += f->input[i].shared ? 0 : lg_shape_count(f->input[i].shape);
    return kind == LG_DERIVATIVE_FORWARD || kind == LG_DERIVATIVE_ADJOINT ? 1 : all;
}

static lg_status add_derivative(lg_program *program, size_t of, lg_derivative_kind kind, const char *prefix,
                                uint32_t at, lg_error *error) {
    lg_derivative what;
    char name[64];
    if (directions_of(program, of, kind) * numbers_of(program, of, 1) > COSTLIEST) return LG_UNSUPPORTED;
    lg_derivative_init(&what);
    what.function = lg_program_function_name(program, of);
    what.kind = kind;
    what.name = name;
    (void)snprintf(name, sizeof name, "%sd%u", prefix, at);
    return lg_program_derive(program, &what, error);
}

bool add_recording(lg_program *program, const recording *r, size_t *number, size_t *count, lg_error *error) {
    char prefix[24];
    *count = 0;
    (void)snprintf(prefix, sizeof prefix, "f%llu_", (unsigned long long)r->number);
    for (uint32_t i = 0; i < r->functions; i++) {
        if (add_function(program, r, i, prefix, error) != LG_OK) return false;
        number[(*count)++] = lg_program_functions(program) - 1;
        if (r->function[i].times == 0) continue;
        if (add_loop(program, r, i, prefix, error) != LG_OK) return false;
        number[(*count)++] = lg_program_functions(program) - 1;
        counted.loops++;
    }
    for (uint32_t i = 0; i < r->derivations; i++) {
        const derivation *d = &r->derivation[i];
        if (d->of >= *count) continue;
        const lg_status status = add_derivative(program, number[d->of], d->kind, prefix, i, error);
        if (refused(status)) continue;
        if (status != LG_OK) return false;
        number[(*count)++] = lg_program_functions(program) - 1;
        counted.derivatives++;
    }
    return true;
}

/* ---- shrinking ---- */

typedef struct shrinking {
    bool (*fails)(void *user, const recording *r);
    void *user;
    recording *r;
    bool shrunk;
} shrinking;

static bool keep_if_fails(shrinking *s, const recording *tried) {
    if (!s->fails(s->user, tried)) return false;
    *s->r = *tried;
    s->shrunk = true;
    return true;
}

static void shrink_function(shrinking *s, uint32_t at) {
    for (uint32_t i = s->r->function[at].steps; i-- > 0;) {
        recording tried = *s->r;
        if (tried.function[at].step[i].left_out) continue;
        tried.function[at].step[i].left_out = true;
        (void)keep_if_fails(s, &tried);
    }
    const bool called = at + 1 < s->r->functions;
    for (uint32_t j = s->r->function[at].outputs; j-- > 0 && s->r->function[at].times == 0 && !called;) {
        recording tried = *s->r;
        body *f = &tried.function[at];
        if (f->outputs == 1) break;
        f->output[j] = f->output[--f->outputs];
        (void)keep_if_fails(s, &tried);
    }
    recording tried = *s->r;
    tried.function[at].times = 0;
    if (s->r->function[at].times > 0 && !called) (void)keep_if_fails(s, &tried);
}

void shrink(recording *r, bool (*fails)(void *user, const recording *r), void *user) {
    shrinking s = {fails, user, r, true};
    while (s.shrunk) {
        s.shrunk = false;
        for (uint32_t rows = 1; rows < r->rows; rows += 1 + rows / 2) {
            recording tried = *r;
            tried.rows = rows;
            if (keep_if_fails(&s, &tried)) break;
        }
        while (r->functions > 1) {
            recording tried = *r;
            tried.functions--;
            if (!keep_if_fails(&s, &tried)) break;
        }
        while (r->derivations > 0) {
            recording tried = *r;
            tried.derivations--;
            if (!keep_if_fails(&s, &tried)) break;
        }
        for (uint32_t at = r->functions; at-- > 0;) shrink_function(&s, at);
    }
}

/* ---- printing ---- */

static void print_slot(slot s) {
    printf("(%s", s.batched ? "B" : "");
    for (uint32_t i = 0; i < s.shape.rank; i++)
        printf("%s%u", i > 0 || s.batched ? ", " : "", s.shape.dims[i]);
    printf(")");
}

static void print_function(const body *f) {
    printf("  s0 (4, 3) and s1 (3): parameters");
    for (uint32_t i = 0; i < f->inputs; i++) {
        printf(", s%u ", PARAMETERS + i);
        print_slot(f->input[i]);
    }
    printf("\n");
    for (uint32_t i = 0; i < f->steps; i++) {
        const step *s = &f->step[i];
        if (s->left_out) continue;
        printf("  s%u ", PARAMETERS + f->inputs + i);
        print_slot(s->made);
        if (s->piece != NULL)
            printf(" = %s[%u %u %u %u; %g](", s->piece->op->name, s->piece->attr.i[0], s->piece->attr.i[1],
                   s->piece->attr.i[2], s->piece->attr.i[3], s->piece->attr.c);
        else
            printf(" = output %u of %s %u(", s->output, s->loop ? "the loop over" : "function", s->callee);
        for (uint32_t k = 0; k < s->inputs; k++)
            printf("%ss%u/%u", k > 0 ? ", " : "", resolved(f, s->operand[k]), s->how[k]);
        printf(")%s\n", s->anchored ? " near its point" : "");
    }
    printf("  outputs:");
    for (uint32_t j = 0; j < f->outputs; j++) printf(" s%u", resolved(f, f->output[j]));
    printf("\n");
    if (f->times > 0) printf("  a loop of %u\n", f->times);
}

void print_recording(const recording *r) {
    printf("recording %llu, %u rows\n", (unsigned long long)r->number, r->rows);
    for (uint32_t i = 0; i < r->functions; i++) {
        printf(" function %u\n", i);
        print_function(&r->function[i]);
    }
    for (uint32_t i = 0; i < r->derivations; i++)
        printf(" derivative %d of %u\n", (int)r->derivation[i].kind, r->derivation[i].of);
}
