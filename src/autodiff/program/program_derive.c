/* Derivatives of functions. A derivative is a further function of the program, recorded like any other.
 *
 * A Jacobian is computed for all directions at once. With N directions, each row of the inputs stands N times
 * in the batch, each time with another unit vector as direction (or as cotangent, if the outputs have fewer
 * elements). lg_plan computes once what the copies have in common. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "autodiff/tape/sweep.h"
#include "core/clean.h"
#include "liegrad/ops.h"

enum { PORTS = LG_PROGRAM_MAX_PORTS, NAME = LG_PROGRAM_MAX_NAME + 1 };

/* A function that can be recorded and differentiated: a function of the program, or the adjoint of one. */
typedef struct differentiable differentiable;
struct differentiable {
    lg_status (*record)(const differentiable *self, lg_tape *tape, const lg_var *parameters, const lg_var *in,
                        lg_var *out);
    const lg_program *program;
    size_t function;
    lg_port in[PORTS], out[PORTS];
    size_t inputs, outputs;
    size_t by[PORTS], of[PORTS]; /* inputs to differentiate by, outputs to differentiate */
    size_t by_count, of_count;
    const differentiable *inner; /* for an adjoint: the function it belongs to */
};

typedef struct deriving {
    differentiable f, adjoint;
    lg_derivative_kind kind;
    char names[2 * PORTS + PORTS * PORTS][3 * NAME];
    size_t named;
    lg_port in[PORTS], out[PORTS]; /* ports of the new function */
    size_t inputs, outputs;
} deriving;

/* ---- functions and adjoints ---- */

static lg_status record_function(const differentiable *f, lg_tape *tape, const lg_var *parameters,
                                 const lg_var *in, lg_var *out) {
    return lg_program_record(tape, f->program, f->function, parameters, in, out);
}

/* Records the function; the chosen outputs and inputs. */
static lg_status record_ends(const differentiable *f, lg_tape *tape, const lg_var *parameters,
                             const lg_var *in, lg_var *of, lg_var *by) {
    lg_var y[PORTS];
    LG_TRY(f->record(f, tape, parameters, in, y));
    for (size_t j = 0; j < f->of_count; j++) of[j] = y[f->of[j]];
    for (size_t i = 0; i < f->by_count; i++) by[i] = in[f->by[i]];
    return LG_OK;
}

/* in: the inputs, then one cotangent per chosen output. out: the cotangents of the chosen inputs. */
static lg_status record_adjoint(const differentiable *self, lg_tape *tape, const lg_var *parameters,
                                const lg_var *in, lg_var *out) {
    const differentiable *f = self->inner;
    lg_var of[PORTS], by[PORTS];
    LG_TRY(record_ends(f, tape, parameters, in, of, by));
    return lg_vjp(tape, of, in + f->inputs, f->of_count, by, f->by_count, out);
}

static lg_status record_forward(const differentiable *f, lg_tape *tape, const lg_var *parameters,
                                const lg_var *in, lg_var *out) {
    lg_var of[PORTS], by[PORTS];
    LG_TRY(record_ends(f, tape, parameters, in, of, by));
    return lg_jvp(tape, of, f->of_count, by, in + f->inputs, f->by_count, out);
}

/* ---- Jacobians ---- */

static uint32_t elements(const lg_port *port) {
    return (uint32_t)lg_shape_count(port->shape);
}

static uint32_t total(const lg_port *ports, const size_t *chosen, size_t count) {
    uint32_t sum = 0;
    for (size_t i = 0; i < count; i++) sum += elements(&ports[chosen[i]]);
    return sum;
}

/* The unit vectors for all chosen ports; each port has its own range of directions (or cotangents). */
static void unit_vectors(lg_tape *tape, const lg_port *ports, const size_t *chosen, size_t count,
                         uint32_t rows, uint32_t copies, lg_var *out) {
    uint32_t first = 0;
    for (size_t i = 0; i < count; i++) {
        const lg_port *port = &ports[chosen[i]];
        const lg_var units = lg_record_units(tape, rows, copies, -(ptrdiff_t)first, elements(port));
        out[i] = lg_reshape(tape, units, lg_port_shape(port, (size_t)rows * copies));
        first += elements(port);
    }
}

/* Cuts the derivatives (B, copies, n) into blocks: block[j by_count + i] is the Jacobian of output j by input
 * i. With directions, it is made of columns, with cotangents, of rows. */
static void cut_blocks(lg_tape *tape, const differentiable *f, bool forward, uint32_t rows, uint32_t copies,
                       const lg_var *derivative, lg_var *block) {
    for (size_t j = 0; j < f->of_count; j++) {
        uint32_t first = 0;
        for (size_t i = 0; i < f->by_count; i++) {
            const uint32_t nj = elements(&f->out[f->of[j]]), ni = elements(&f->in[f->by[i]]);
            lg_var all =
                lg_reshape(tape, derivative[forward ? j : i], lg_shape3(rows, copies, forward ? nj : ni));
            if (forward) {
                all = lg_transpose(tape, all);
                block[j * f->by_count + i] = lg_slice(tape, all, 2, first, ni);
                first += ni;
            } else {
                uint32_t above = 0;
                for (size_t k = 0; k < j; k++) above += elements(&f->out[f->of[k]]);
                block[j * f->by_count + i] = lg_slice(tape, all, 1, above, nj);
            }
        }
    }
}

static lg_status record_jacobian(const differentiable *f, lg_tape *tape, const lg_var *parameters,
                                 const lg_var *in, lg_var *block) {
    const uint32_t n_in = total(f->in, f->by, f->by_count), n_out = total(f->out, f->of, f->of_count);
    const bool forward = n_in <= n_out;
    const uint32_t copies = forward ? n_in : n_out, rows = lg_var_shape(tape, in[f->by[0]]).dims[0];
    lg_var tiled[PORTS], of[PORTS], by[PORTS], unit[PORTS], derivative[PORTS];
    for (size_t i = 0; i < f->inputs; i++)
        tiled[i] = f->in[i].shared ? in[i] : lg_record_copies(tape, in[i], copies);
    LG_TRY(lg_tape_status(tape));
    LG_TRY(record_ends(f, tape, parameters, tiled, of, by));
    if (forward) {
        unit_vectors(tape, f->in, f->by, f->by_count, rows, copies, unit);
        LG_TRY(lg_jvp(tape, of, f->of_count, by, unit, f->by_count, derivative));
    } else {
        unit_vectors(tape, f->out, f->of, f->of_count, rows, copies, unit);
        LG_TRY(lg_vjp(tape, of, unit, f->of_count, by, f->by_count, derivative));
    }
    cut_blocks(tape, f, forward, rows, copies, derivative, block);
    return lg_tape_status(tape);
}

static lg_status record(void *user, lg_tape *tape, const lg_var *parameters, const lg_var *in, lg_var *out) {
    const deriving *d = user;
    switch (d->kind) {
    case LG_DERIVATIVE_FORWARD:
        return record_forward(&d->f, tape, parameters, in, out);
    case LG_DERIVATIVE_ADJOINT:
        return record_adjoint(&d->adjoint, tape, parameters, in, out);
    case LG_DERIVATIVE_JACOBIAN:
        return record_jacobian(&d->f, tape, parameters, in, out);
    default: /* LG_DERIVATIVE_JACOBIAN_OF_ADJOINT */
        return record_jacobian(&d->adjoint, tape, parameters, in, out);
    }
}

/* ---- ports ---- */

static const char *name_of(deriving *d, const char *format, const char *a, const char *b) {
    char *name = d->names[d->named++];
    (void)snprintf(name, sizeof d->names[0], format, a, b);
    return name;
}

static bool begins_a_port(const lg_port *ports, size_t count, const char *prefix) {
    for (size_t i = 0; i < count; i++)
        if (strncmp(ports[i].name, prefix, strlen(prefix)) == 0) return true;
    return false;
}

/* The port of a direction or cotangent, such as fwd_x. If the function already has ports that begin with
 * fwd_, the name is fwd2_x, and so on. */
static lg_port seed_of(deriving *d, const char *word, const lg_port *port) {
    const differentiable *f = &d->f;
    char prefix[16];
    (void)snprintf(prefix, sizeof prefix, "%s_", word);
    for (int n = 2; begins_a_port(f->in, f->inputs, prefix) || begins_a_port(f->out, f->outputs, prefix); n++)
        (void)snprintf(prefix, sizeof prefix, "%s%d_", word, n);
    return (lg_port){
        .name = name_of(d, "%s%s", prefix, port->name), .shape = port->shape, .shared = port->shared};
}

static lg_status choose(const char *const *names, size_t count, const lg_port *ports, size_t there, bool all,
                        size_t *chosen, size_t *chosen_count, const char *what, lg_error *error) {
    *chosen_count = 0;
    for (size_t i = 0; names == NULL && i < there; i++)
        if (all || !ports[i].shared) chosen[(*chosen_count)++] = i;
    for (size_t c = 0; names != NULL && c < count; c++) {
        size_t i = 0;
        while (i < there && strcmp(ports[i].name, names[c]) != 0) i++;
        if (i == there) return lg_fail(error, LG_NOT_FOUND, "there is no %s '%s'", what, names[c]);
        if (!all && ports[i].shared)
            return lg_fail(error, LG_UNSUPPORTED,
                           "%s '%s' is shared by all rows, but a Jacobian needs one value per row", what,
                           names[c]);
        for (size_t k = 0; k < c; k++)
            if (chosen[k] == i)
                return lg_fail(error, LG_INVALID_ARGUMENT, "%s '%s' is named twice", what, names[c]);
        chosen[(*chosen_count)++] = i;
    }
    return *chosen_count > 0
               ? LG_OK
               : lg_fail(error, LG_INVALID_ARGUMENT, "the derivative has no %s: name at least one", what);
}

/* Makes the adjoint a function that can be differentiated: inputs and cotangents of outputs -> cotangents of
 * inputs. */
static void make_adjoint(deriving *d) {
    const differentiable *f = &d->f;
    differentiable *a = &d->adjoint;
    *a = (differentiable){.record = record_adjoint, .program = f->program, .inner = f};
    for (size_t i = 0; i < f->inputs; i++) a->in[a->inputs++] = f->in[i];
    for (size_t j = 0; j < f->of_count; j++) a->in[a->inputs++] = seed_of(d, "adj", &f->out[f->of[j]]);
    for (size_t i = 0; i < f->by_count; i++) a->out[a->outputs++] = seed_of(d, "adj", &f->in[f->by[i]]);
    for (size_t i = 0; i < f->by_count; i++) a->by[a->by_count++] = f->by[i];
    for (size_t j = 0; j < f->of_count; j++) a->by[a->by_count++] = f->inputs + j;
    for (size_t i = 0; i < f->by_count; i++) a->of[a->of_count++] = i;
}

static void jacobian_ports(deriving *d, const differentiable *f) {
    for (size_t j = 0; j < f->of_count; j++)
        for (size_t i = 0; i < f->by_count; i++)
            d->out[d->outputs++] =
                (lg_port){.name = name_of(d, "jac_%s_%s", f->out[f->of[j]].name, f->in[f->by[i]].name)};
}

static lg_status make_ports(deriving *d, lg_error *error) {
    const differentiable *f = &d->f;
    const bool adjoint = d->kind == LG_DERIVATIVE_ADJOINT || d->kind == LG_DERIVATIVE_JACOBIAN_OF_ADJOINT;
    const bool forward = d->kind == LG_DERIVATIVE_FORWARD;
    const size_t seeds = adjoint ? f->of_count : forward ? f->by_count : 0;
    if (f->inputs + seeds > PORTS || (!adjoint && !forward && f->by_count * f->of_count > PORTS) ||
        (d->kind == LG_DERIVATIVE_JACOBIAN_OF_ADJOINT && f->by_count * (f->by_count + f->of_count) > PORTS))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the derivative has more than %d inputs or outputs",
                       PORTS);
    if (adjoint) make_adjoint(d);
    const differentiable *from = adjoint ? &d->adjoint : f;
    for (size_t i = 0; i < from->inputs; i++) d->in[d->inputs++] = from->in[i];
    for (size_t i = 0; forward && i < f->by_count; i++)
        d->in[d->inputs++] = seed_of(d, "fwd", &f->in[f->by[i]]);
    for (size_t j = 0; forward && j < f->of_count; j++)
        d->out[d->outputs++] = seed_of(d, "fwd", &f->out[f->of[j]]);
    if (d->kind == LG_DERIVATIVE_ADJOINT)
        for (size_t i = 0; i < from->outputs; i++) d->out[d->outputs++] = from->out[i];
    if (d->kind == LG_DERIVATIVE_JACOBIAN) jacobian_ports(d, f);
    if (d->kind == LG_DERIVATIVE_JACOBIAN_OF_ADJOINT) jacobian_ports(d, &d->adjoint);
    return LG_OK;
}

/* ---- trial whether rows are independent: a batch is compared with its rows one by one ---- */

enum { ROWS = 3, TRIALS = 3 };

typedef struct row_trial {
    const differentiable *f;
    lg_plan *batch, *single;
    double *in[PORTS], *out[PORTS], *one[PORTS];
    void *work; /* work memory, large enough for both plans */
} row_trial;

static void *trial_memory(const row_trial *t, size_t bytes) {
    return lg_alloc(t->f->program->context, bytes + 1, 1);
}

static lg_status open_trial(row_trial *t, lg_error *error) {
    const differentiable *f = t->f;
    lg_plan_options options;
    lg_plan_options_init(&options);
    LG_TRY(lg_plan_create(f->program, f->function, &options, &t->single, error));
    options.rows = ROWS;
    LG_TRY(lg_plan_create(f->program, f->function, &options, &t->batch, error));
    const size_t small = lg_plan_work_size(t->single), large = lg_plan_work_size(t->batch);
    t->work = trial_memory(t, small > large ? small : large);
    bool failed = t->work == NULL;
    for (size_t i = 0; i < f->inputs; i++) {
        t->in[i] = trial_memory(t, lg_plan_input_count(t->batch, i) * sizeof(double));
        failed = failed || t->in[i] == NULL;
    }
    for (size_t j = 0; j < f->outputs; j++) {
        t->out[j] = trial_memory(t, lg_plan_output_count(t->batch, j) * sizeof(double));
        t->one[j] = trial_memory(t, lg_plan_output_count(t->single, j) * sizeof(double));
        failed = failed || t->out[j] == NULL || t->one[j] == NULL;
    }
    return failed ? lg_fail(error, LG_OUT_OF_MEMORY, "no memory to compare the rows") : LG_OK;
}

static void close_trial(row_trial *t) {
    const lg_context *context = t->f->program->context;
    for (size_t i = 0; i < t->f->inputs; i++) lg_free(context, t->in[i]);
    for (size_t j = 0; j < t->f->outputs; j++) {
        LG_FREE_ALL(context, t->out[j], t->one[j]);
    }
    lg_free(context, t->work);
    lg_plan_destroy(t->batch);
    lg_plan_destroy(t->single);
}

static void draw_inputs(row_trial *t, uint64_t trial) {
    lg_rng rng;
    lg_rng_seed(&rng, 22, trial);
    for (size_t i = 0; i < t->f->inputs; i++) {
        const lg_port *port = &t->f->in[i];
        const bool ranged = port->low != 0.0 || port->high != 0.0;
        for (size_t k = 0; k < lg_plan_input_count(t->batch, i); k++)
            t->in[i][k] = lg_rng_uniform_in(&rng, ranged ? port->low : -1.0, ranged ? port->high : 1.0);
    }
}

/* Compares a row, with errors relative to its largest number. A NaN never agrees. */
static bool row_agrees(const row_trial *t, size_t output, size_t row) {
    const size_t count = lg_plan_output_count(t->single, output);
    const double *batch = t->out[output] + row * count, *one = t->one[output];
    double size = 0.0;
    for (size_t k = 0; k < count; k++) size = fmax(size, fabs(one[k]));
    for (size_t k = 0; k < count; k++)
        if (!(fabs(batch[k] - one[k]) <= 1e-9 * size)) return false;
    return true;
}

static lg_status compare_rows(row_trial *t, lg_error *error) {
    const differentiable *f = t->f;
    lg_plan_eval(t->batch, (const void *const *)t->in, (void *const *)t->out, t->work);
    for (size_t r = 0; r < ROWS; r++) {
        const void *in[PORTS];
        for (size_t i = 0; i < f->inputs; i++)
            in[i] = t->in[i] + (f->in[i].shared ? 0 : r * lg_plan_input_count(t->single, i));
        lg_plan_eval(t->single, in, (void *const *)t->one, t->work);
        for (size_t j = 0; j < f->of_count; j++)
            if (!row_agrees(t, f->of[j], r))
                return lg_fail(error, LG_UNSUPPORTED,
                               "function '%s': a row of output '%s' depends on other rows of the batch, or "
                               "is NaN at random points between low and high of the inputs: a Jacobian needs "
                               "rows that depend on the same row of the inputs only",
                               f->program->function[f->function].name, f->out[f->of[j]].name);
    }
    return LG_OK;
}

static lg_status check_rows(const differentiable *f, lg_error *error) {
    row_trial t = {.f = f};
    lg_status status = open_trial(&t, error);
    for (uint64_t trial = 0; status == LG_OK && trial < TRIALS; trial++) {
        draw_inputs(&t, trial);
        status = compare_rows(&t, error);
    }
    close_trial(&t);
    return status;
}

/* ---- the derived function ---- */

void lg_derivative_init(lg_derivative *what) {
    *what = (lg_derivative){.size = sizeof *what};
}

static lg_status derive(deriving *d, lg_program *program, const lg_derivative *what, lg_error *error) {
    differentiable *f = &d->f;
    const bool rows = what->kind == LG_DERIVATIVE_JACOBIAN || what->kind == LG_DERIVATIVE_JACOBIAN_OF_ADJOINT;
    LG_TRY(lg_program_find(program, what->function, &f->function, error));
    const lg_function *of = &program->function[f->function];
    d->kind = what->kind;
    f->record = record_function;
    f->program = program;
    f->inputs = of->inputs;
    f->outputs = of->outputs;
    memcpy(f->in, of->input, of->inputs * sizeof *f->in);
    memcpy(f->out, of->output, of->outputs * sizeof *f->out);
    LG_TRY(choose(what->inputs, what->input_count, f->in, f->inputs, !rows, f->by, &f->by_count, "input",
                  error));
    LG_TRY(choose(what->outputs, what->output_count, f->out, f->outputs, !rows, f->of, &f->of_count, "output",
                  error));
    if (rows) LG_TRY(check_rows(f, error));
    LG_TRY(make_ports(d, error));
    const lg_function_spec spec = {
        .name = what->name != NULL ? what->name
                                   : name_of(d, "%s%s", lg_derivative_begins[what->kind], what->function),
        .inputs = d->in,
        .input_count = d->inputs,
        .outputs = d->out,
        .output_count = d->outputs,
        .record = record,
        .user = d};
    return lg_program_record_function(program, &spec, true, error);
}

lg_status lg_program_derive(lg_program *program, const lg_derivative *what, lg_error *error) {
    if (program == NULL || what == NULL || what->size != sizeof *what || what->function == NULL ||
        (unsigned)what->kind >= LG_DERIVATIVE_KIND_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the program, the derivative or its function's name is NULL, or the derivative's size "
                       "or kind is wrong");
    LG_TRY_SCRATCH(deriving, d, program->context, 1,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a derivative of '%s'", what->function));
    return derive(d, program, what, error);
}

lg_status lg_program_jacobian(lg_program *program, const char *function, lg_error *error) {
    const lg_derivative what = {.size = sizeof what, .kind = LG_DERIVATIVE_JACOBIAN, .function = function};
    return lg_program_derive(program, &what, error);
}
