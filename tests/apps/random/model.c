/* Makes programs of recordings and exports them. */
#include <dlfcn.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "apps/random/exports.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"

/* Undefined behaviour ends the program with a signal. */
#define CHECKED                                                                                              \
    "-O0 -Wall -Wextra -Werror -fsanitize=undefined,float-cast-overflow "                                    \
    "-fno-sanitize-recover=all"

/* ---- the function "value" ---- */

/* Calls function `of` with constants in place of the inputs that all rows share. The new function has only
 * the outputs that differ by row, with the numbers `output`. So it has derivatives. */
typedef struct wrapping {
    const char *of;
    const lg_port *in;
    size_t ins, output[MOST_OUTPUTS], outs;
} wrapping;

static lg_status record_value(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const wrapping *w = user;
    lg_var all[MOST_INPUTS];
    double values[64];
    (void)theta;
    for (size_t i = 0; i < LG_COUNT(values); i++) values[i] = 0.5 * sin((double)i + 1);
    for (size_t i = 0; i < w->ins; i++)
        all[i] = w->in[i].shared ? lg_input(tape, w->in[i].shape, values) : *x++;
    for (size_t o = 0; o < w->outs; o++) y[o] = lg_program_call(tape, w->of, w->output[o], all);
    return lg_tape_status(tape);
}

static void add_value(model *m) {
    size_t outs, taken = 0;
    lg_error error = {.message = ""};
    lg_port in[MOST_INPUTS], ports[MOST_OUTPUTS] = {{.name = NULL}};
    wrapping w = {.of = m->function};
    const size_t of = function_named(m, m->function);
    w.in = lg_program_inputs(m->program, of, &w.ins);
    const lg_port *out = lg_program_outputs(m->program, of, &outs);
    for (size_t i = 0; i < w.ins; i++)
        if (!w.in[i].shared) in[taken++] = w.in[i];
    for (size_t o = 0; o < outs && w.outs < MOST_OUTPUTS; o++)
        if (!out[o].shared) {
            ports[w.outs].name = out[o].name;
            w.output[w.outs++] = o;
        }
    if (w.outs == 0) return;
    const lg_function_spec spec = {"value", in, taken, ports, w.outs, record_value, &w};
    if (lg_program_record_function(m->program, &spec, false, &error) != LG_OK)
        stop("recording %llu: %s", (unsigned long long)m->r->number, error.message);
    (void)snprintf(m->function, sizeof m->function, "value");
}

/* ---- the functions "rate" and "step" ---- */

/* The rate is sin(y) - x. x is the first input, and y is a result of function `of`, cut or filled up to the
 * size of x. So states stay between -1 and 1. */
typedef struct dynamics {
    const char *of;
    size_t output;
    const lg_port *in;
    size_t ins;
    uint32_t count; /* of "advanced" */
    double h;
    bool step;
} dynamics;

/* v (rows, ...) as (rows, m). */
static lg_var in_columns(lg_tape *tape, lg_var v, uint32_t rows, uint32_t m) {
    const uint32_t n = (uint32_t)(lg_shape_count(lg_var_shape(tape, v)) / rows);
    v = lg_reshape(tape, v, lg_shape2(rows, n));
    if (n > m) v = lg_slice(tape, v, 1, 0, m);
    return n < m ? lg_pad(tape, v, 1, 0, m - n) : v;
}

static lg_status record_rate(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const dynamics *d = user;
    (void)theta;
    const lg_shape shape = lg_var_shape(tape, x[0]);
    const uint32_t m = (uint32_t)lg_shape_count(d->in[0].shape);
    lg_var v = in_columns(tape, lg_program_call(tape, d->of, d->output, x), shape.dims[0], m);
    v = lg_reshape(tape, v, shape);
    y[0] = lg_sub(tape, lg_sin(tape, v), x[0]);
    return lg_tape_status(tape);
}

/* x + h rate; the last input is h. */
static lg_status record_step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const dynamics *d = user;
    (void)theta;
    const lg_shape shape = lg_var_shape(tape, x[0]);
    const uint32_t m = (uint32_t)lg_shape_count(d->in[0].shape), rows = shape.dims[0];
    const lg_var h =
        lg_broadcast_to(tape, lg_reshape(tape, x[d->ins], lg_shape2(rows, 1)), lg_shape2(rows, m));
    const lg_var move = lg_mul(tape, lg_reshape(tape, h, shape), lg_program_call(tape, "rate", 0, x));
    y[0] = lg_add(tape, x[0], move);
    return lg_tape_status(tape);
}

static lg_var step_of_rate(const dynamics *d, lg_tape *tape, lg_var *x) {
    static const double place[4] = {0, 0.5, 0.5, 1}, share[4] = {1, 2, 2, 1};
    const lg_var from = x[0];
    lg_var next = from, k = from;
    for (int s = 0; s < 4; s++) {
        x[0] = s > 0 ? lg_add(tape, from, lg_scale(tape, k, place[s] * d->h)) : from;
        k = lg_program_call(tape, "rate", 0, x);
        next = lg_add(tape, next, lg_scale(tape, k, share[s] * d->h / 6));
    }
    return next;
}

static lg_status record_advanced(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,
                                 lg_var *y) {
    const dynamics *d = user;
    lg_var x[LG_PROGRAM_MAX_PORTS];
    (void)theta;
    for (size_t i = 0; i < d->ins; i++) x[i] = in[i];
    const lg_shape rows = {1, {lg_var_shape(tape, in[0]).dims[0]}};
    x[d->ins] = lg_broadcast_to(tape, lg_input(tape, lg_shape1(1), &d->h), rows);
    for (uint32_t n = 0; n < d->count; n++)
        x[0] = d->step ? lg_program_call(tape, "step", 0, x) : step_of_rate(d, tape, x);
    y[0] = x[0];
    return lg_tape_status(tape);
}

static size_t add_function(model *m, const char *name, size_t ins, lg_record_function record, dynamics *d) {
    lg_port in[LG_PROGRAM_MAX_PORTS] = {{.name = NULL}};
    const lg_port out = {.name = "next"};
    lg_error error = {.message = ""};
    for (size_t i = 0; i < ins; i++) in[i] = i < d->ins ? d->in[i] : (lg_port){.name = "h"};
    const lg_function_spec spec = {name, in, ins, &out, 1, record, d};
    if (lg_program_record_function(m->program, &spec, false, &error) != LG_OK)
        stop("recording %llu, %s: %s", (unsigned long long)m->r->number, name, error.message);
    return lg_program_functions(m->program) - 1;
}

/* Every fourth recording gets no rate. Of the recordings with a rate, every third also gets the function
 * "step". */
static void add_dynamics(model *m) {
    size_t ins, outs, at = 0;
    const size_t of = function_named(m, m->function);
    const lg_port *in = lg_program_inputs(m->program, of, &ins),
                  *out = lg_program_outputs(m->program, of, &outs);
    while (at < outs && out[at].shared) at++;
    m->rate = m->r->number % 4 != 3 && at < outs;
    m->step = m->rate && m->r->number % 3 == 0;
    dynamics d = {.of = m->function, .output = at, .in = in, .ins = ins};
    if (m->rate) (void)add_function(m, "rate", ins, record_rate, &d);
    if (m->step) (void)add_function(m, "step", ins + 1, record_step, &d);
}

size_t add_advanced(model *m, uint32_t count, double h) {
    dynamics d = {.count = count, .h = h, .step = m->step};
    d.in = lg_program_inputs(m->program, function_named(m, "rate"), &d.ins);
    return add_function(m, "advanced", d.ins, record_advanced, &d);
}

/* ---- models ---- */

void open_model(uint64_t number, bool blocks, recording *r, model *out) {
    size_t function[MOST_ALL], count, derivatives = 0;
    lg_error error = {.message = ""};
    looked_at = number;
    draw_recording(number, r);
    *out = (model){.r = r, .program = empty_program(), .folder = "/tmp/liegrad-exports-XXXXXX"};
    (void)snprintf(out->name, sizeof out->name, "m%llu", (unsigned long long)number);
    derivatives = r->derivations;
    r->derivations = 0; /* lg-export adds derivatives itself */
    if (!add_recording(out->program, r, function, &count, &error)) stop("%s", error.message);
    r->derivations = (uint32_t)derivatives;
    (void)snprintf(out->function, sizeof out->function, "%s",
                   lg_program_function_name(out->program, function[number % count]));
    if (number % 5 > 0) add_value(out);
    if (blocks) add_dynamics(out);
    if (mkdtemp(out->folder) == NULL) stop("no folder %s", out->folder);
}

void close_model(model *m) {
    char command[FOLDER + 32];
    if (m->library != NULL) (void)dlclose(m->library);
    lg_program_destroy(m->program);
    (void)snprintf(command, sizeof command, "rm -rf -- '%s'", m->folder);
    if (system(command) != 0) stop("%s is not removed", m->folder);
}

/* Runs a command in the model's folder. Returns its exit code; `said` gets the end of its standard error. */
static int run(const model *m, char *said, size_t size, const char *format, ...) {
    char command[1024], line[1200];
    va_list list;
    va_start(list, format);
    (void)vsnprintf(command, sizeof command, format, list);
    va_end(list);
    (void)snprintf(line, sizeof line, "cd '%s' && %s 2>&1 >/dev/null", m->folder, command);
    FILE *stream = popen(line, "r");
    if (stream == NULL) stop("no shell");
    const size_t used = fread(said, 1, size - 1, stream);
    said[used] = '\0';
    for (char rest[256]; fread(rest, 1, sizeof rest, stream) > 0;) continue;
    const int status = pclose(stream);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
}

bool make_file(const model *m, const char *format, finding *f) {
    char file[NAME + 16], said[512];
    (void)snprintf(file, sizeof file, format, m->name);
    return run(m, said, sizeof said, "make -s -C out %s CC=gcc CFLAGS='%s'", file, CHECKED) == 0 ||
           found(f, false, "%s is not made: %.400s", file, said);
}

static bool build(model *m, const target *t, finding *f) {
    char built[NAME + 16], path[256];
    if (!make_file(m, t->built, f)) return false;
    (void)snprintf(built, sizeof built, t->built, m->name);
    (void)snprintf(path, sizeof path, "%s/out/%s", m->folder, built);
    m->library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    return m->library != NULL || found(f, false, "%.400s", dlerror());
}

bool export_model(model *m, const target *t, finding *f) {
    char path[FOLDER + 16];
    lg_error error = {.message = ""};
    (void)snprintf(path, sizeof path, "%s/model.h5", m->folder);
    if (lg_program_save(NULL, path, m->program, NULL, &error) != LG_OK) stop("%s: %s", path, error.message);
    const char *bin = getenv("LG_BIN_DIR");
    const int code = run(m, m->warnings, sizeof m->warnings,
                         "'%s/lg-export' model.h5 --target %s --name %s --functions %s --golden 1 --out out",
                         bin != NULL ? bin : LG_BIN_DIR, t->name, m->name, m->function);
    if (code == 2 || code == 3) return found(f, true, "%.500s", m->warnings);
    if (code != 0) return found(f, false, "lg-export ends with %d: %.400s", code, m->warnings);
    return t->built == NULL || build(m, t, f);
}

/* ---- functions and ports ---- */

size_t function_named(const model *m, const char *name) {
    size_t at;
    return lg_program_find(m->program, name, &at, NULL) == LG_OK ? at : SIZE_MAX;
}

size_t derivative_of(model *m, lg_derivative_kind kind, const char *function) {
    lg_derivative what;
    lg_derivative_init(&what);
    what.kind = kind;
    what.function = function;
    return lg_program_derive(m->program, &what, NULL) == LG_OK ? lg_program_functions(m->program) - 1
                                                               : SIZE_MAX;
}

size_t port_named(const lg_port *ports, size_t count, const char *name) {
    for (size_t i = 0; i < count; i++)
        if (strcmp(ports[i].name, name) == 0) return i;
    return SIZE_MAX;
}

const double *input_of(const truth *t, size_t i) {
    return lg_node_at(t->tape, t->in[i])->value;
}

void *symbol_in(const model *m, const char *format, ...) {
    char name[160];
    va_list list;
    va_start(list, format);
    (void)vsnprintf(name, sizeof name, format, list);
    va_end(list);
    return dlsym(m->library, name);
}
