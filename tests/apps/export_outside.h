/* Programs as C against the tape: all functions of a bundle at random inputs.
 *
 *   outside o = outside_compile(program, "gcc", "-O2", LG_F64);
 *   outside_compare(&o, program, function, points, condition, kinks);
 *   outside_discard(&o);
 */
#ifndef LG_TEST_EXPORT_OUTSIDE_H
#define LG_TEST_EXPORT_OUTSIDE_H

#include <dlfcn.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "liegrad/program.h"
#include "liegrad/random.h"
#include "test_support.h"

enum { OUTSIDE_PORTS = 16, OUTSIDE_PIECE = 10 };

typedef struct outside {
    char folder[512];
    void *handle;
    lg_c_source *source;
    lg_dtype dtype;
} outside;

static inline void outside_write(const outside *o, const char *name, const char *const *parts) {
    char path[640];
    (void)snprintf(path, sizeof path, "%s/%s", o->folder, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    for (; *parts != NULL; parts++) assert_true(fputs(*parts, file) >= 0);
    assert_int_equal(fclose(file), 0);
}

/* For each function one that takes arrays of pointers: shim_<function>. */
static inline void outside_write_shims(const outside *o, const lg_program *program) {
    char path[640];
    (void)snprintf(path, sizeof path, "%s/shims.c", o->folder);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    (void)fprintf(file, "#include \"p.h\"\n");
    for (size_t i = 0; i < o->source->functions; i++) {
        size_t ins = 0, outs = 0;
        const char *name = lg_program_function_name(program, o->source->function[i]);
        (void)lg_program_inputs(program, o->source->function[i], &ins);
        (void)lg_program_outputs(program, o->source->function[i], &outs);
        (void)fprintf(file, "void shim_%s(const void *const *in, void *const *out, void *work);\n", name);
        (void)fprintf(file, "void shim_%s(const void *const *in, void *const *out, void *work) {\n    p_%s(",
                      name, name);
        for (size_t k = 0; k < ins; k++) (void)fprintf(file, "(const p_real *)in[%zu], ", k);
        for (size_t k = 0; k < outs; k++) (void)fprintf(file, "(p_real *)out[%zu], ", k);
        (void)fprintf(file, "(p_real *)work);\n}\n");
    }
    assert_int_equal(fclose(file), 0);
}

/* p.h, p.c, p_weights.c and shims.c in o->folder. */
static inline void outside_write_all(outside *o, const lg_program *program) {
    lg_c_options options;
    lg_error error;
    lg_c_options_init(&options);
    options.name = "p";
    options.dtype = o->dtype;
    if (lg_program_write_c(program, &options, &o->source, &error) != LG_OK) fail_msg("%s", error.message);
    const lg_c_source *s = o->source;
    outside_write(o, "p.h",
                  (const char *const[]){"#ifndef P_H\n#define P_H\n",
                                        "#ifdef __cplusplus\nextern \"C\" {\n#endif\n", s->sizes,
                                        s->declarations, "#ifdef __cplusplus\n}\n#endif\n#endif\n", NULL});
    outside_write(o, "p.c", (const char *const[]){"#include \"p.h\"\n", s->arrays, s->code, NULL});
    outside_write(o, "p_weights.c", (const char *const[]){"#include \"p.h\"\n", s->arrays, s->weights, NULL});
    outside_write_shims(o, program);
}

/* A compiler of C++ is known by its "++". */
static inline outside outside_compile(const lg_program *program, const char *compiler, const char *flags,
                                      lg_dtype dtype) {
    outside o = {.folder = "/tmp/liegrad-outside-XXXXXX", .dtype = dtype};
    char command[2048];
    const char *language = strstr(compiler, "++") != NULL ? "-x c++ -std=c++14" : "-x c -std=c99";
    assert_non_null(mkdtemp(o.folder));
    outside_write_all(&o, program);
    (void)snprintf(command, sizeof command,
                   "cd %s && %s %s -Wall -Wextra -Wshadow -pedantic -Werror %s -fPIC -c p.c p_weights.c && "
                   "%s -std=c99 -fPIC -c shims.c && %s %s -shared p.o p_weights.o shims.o -lm -o lib.so 2>&1",
                   o.folder, compiler, language, flags, strstr(compiler, "++") != NULL ? "cc" : compiler,
                   compiler, flags);
    if (system(command) != 0) fail_msg("%s", command);
    (void)snprintf(command, sizeof command, "%s/lib.so", o.folder);
    o.handle = dlopen(command, RTLD_NOW | RTLD_LOCAL);
    if (o.handle == NULL) fail_msg("%s", dlerror());
    return o;
}

static inline void outside_discard(outside *o) {
    char command[640];
    if (o->handle != NULL) assert_int_equal(dlclose(o->handle), 0);
    lg_c_source_destroy(o->source);
    (void)snprintf(command, sizeof command, "rm -rf -- '%s'", o->folder);
    assert_int_equal(system(command), 0);
}

/* ---- what is compared: numbers of all ports, row after row ---- */

typedef struct outside_numbers {
    size_t ports, points, count[OUTSIDE_PORTS]; /* of one row */
    double *x[OUTSIDE_PORTS];                   /* (points, count) */
} outside_numbers;

static inline outside_numbers outside_new(const lg_port *port, size_t ports, size_t points) {
    outside_numbers n = {.ports = ports, .points = points};
    assert_true(ports <= OUTSIDE_PORTS);
    for (size_t k = 0; k < ports; k++) {
        n.count[k] = lg_shape_count(port[k].shape);
        n.x[k] = calloc(points * n.count[k] + 1, sizeof(double));
        assert_non_null(n.x[k]);
    }
    return n;
}

static inline void outside_free(outside_numbers *n) {
    for (size_t k = 0; k < n->ports; k++) free(n->x[k]);
}

static inline outside_numbers outside_draw(const lg_program *program, size_t function, lg_dtype dtype,
                                           size_t points) {
    size_t ports;
    const lg_port *port = lg_program_inputs(program, function, &ports);
    outside_numbers in = outside_new(port, ports, points);
    lg_rng rng;
    lg_rng_seed(&rng, 14, function);
    for (size_t k = 0; k < ports; k++) {
        const bool open = port[k].low == 0 && port[k].high == 0;
        for (size_t i = 0; i < points * in.count[k]; i++) {
            in.x[k][i] = lg_rng_uniform_in(&rng, open ? -1 : port[k].low, open ? 1 : port[k].high);
            if (dtype == LG_F32) in.x[k][i] = (double)(float)in.x[k][i];
        }
    }
    return in;
}

/* The tape of double precision, `rows` points at a time from `first` on. */
static inline void outside_on_tape(lg_tape *tape, const lg_program *program, size_t function,
                                   const outside_numbers *in, size_t first, uint32_t rows,
                                   outside_numbers *out) {
    lg_var x[OUTSIDE_PORTS], y[OUTSIDE_PORTS];
    size_t ports;
    const lg_port *port = lg_program_inputs(program, function, &ports);
    lg_tape_reset(tape);
    for (size_t k = 0; k < ports; k++) {
        lg_shape shape = port[k].shape;
        if (!port[k].shared) {
            memmove(shape.dims + 1, shape.dims, shape.rank * sizeof *shape.dims);
            shape.dims[0] = rows;
            shape.rank++;
        }
        x[k] = lg_input(tape, shape, in->x[k] + first * in->count[k]);
    }
    assert_ok(lg_program_record(tape, program, function, NULL, x, y));
    for (size_t j = 0; j < out->ports; j++)
        assert_ok(lg_read(tape, y[j], rows * out->count[j], out->x[j] + first * out->count[j]));
}

static inline bool outside_shares(const lg_program *program, size_t function) {
    size_t ins, outs;
    const lg_port *in = lg_program_inputs(program, function, &ins),
                  *out = lg_program_outputs(program, function, &outs);
    bool shared = false;
    for (size_t k = 0; k < ins; k++) shared |= in[k].shared;
    for (size_t k = 0; k < outs; k++) shared |= out[k].shared;
    return shared;
}

static inline outside_numbers outside_wanted(lg_tape *tape, const lg_program *program, size_t function,
                                             const outside_numbers *in) {
    size_t ports;
    const lg_port *port = lg_program_outputs(program, function, &ports);
    outside_numbers out = outside_new(port, ports, in->points);
    const size_t piece = outside_shares(program, function) ? 1 : OUTSIDE_PIECE;
    for (size_t p = 0; p < in->points; p += piece)
        outside_on_tape(tape, program, function, in, p,
                        (uint32_t)(in->points - p < piece ? in->points - p : piece), &out);
    return out;
}

static inline void outside_call(const outside *o, const char *function, const outside_numbers *in,
                                outside_numbers *out) {
    char name[128];
    void (*call)(const void *const *, void *const *, void *);
    void *from[OUTSIDE_PORTS], *to[OUTSIDE_PORTS], *work = malloc(o->source->work_size * sizeof(double) + 1);
    const bool single = o->dtype == LG_F32;
    (void)snprintf(name, sizeof name, "shim_%s", function);
    *(void **)&call = dlsym(o->handle, name);
    assert_true(call != NULL && work != NULL);
    for (size_t k = 0; k < in->ports; k++) from[k] = malloc(in->count[k] * sizeof(double) + 1);
    for (size_t j = 0; j < out->ports; j++) to[j] = malloc(out->count[j] * sizeof(double) + 1);
    for (size_t p = 0; p < in->points; p++) {
        for (size_t k = 0; k < in->ports; k++)
            for (size_t i = 0; i < in->count[k]; i++) {
                const double value = in->x[k][p * in->count[k] + i];
                if (single)
                    ((float *)from[k])[i] = (float)value;
                else
                    ((double *)from[k])[i] = value;
            }
        memset(work, 0xff, o->source->work_size * sizeof(double)); /* NaN */
        call((const void *const *)from, to, work);
        for (size_t j = 0; j < out->ports; j++)
            for (size_t i = 0; i < out->count[j]; i++)
                out->x[j][p * out->count[j] + i] =
                    single ? (double)((float *)to[j])[i] : ((double *)to[j])[i];
    }
    for (size_t k = 0; k < in->ports; k++) free(from[k]);
    for (size_t j = 0; j < out->ports; j++) free(to[j]);
    free(work);
}

static inline double outside_distance(const double *a, const double *b, size_t n) {
    double sum = 0;
    for (size_t i = 0; i < n; i++) sum += (a[i] - (b != NULL ? b[i] : 0)) * (a[i] - (b != NULL ? b[i] : 0));
    return sqrt(sum);
}

/* Of row p of output j: the norm of the difference over the row's norm, or over the root mean square of all
 * norms where that is larger. */
static inline double outside_error(const outside_numbers *got, const outside_numbers *want, size_t j,
                                   size_t p, double mean) {
    const size_t n = want->count[j];
    const double own = outside_distance(want->x[j] + p * n, NULL, n), scale = own > mean ? own : mean;
    return outside_distance(got->x[j] + p * n, want->x[j] + p * n, n) / (scale > 0 ? scale : 1);
}

static inline double outside_mean(const outside_numbers *n, size_t j) {
    double sum = 0;
    for (size_t p = 0; p < n->points; p++)
        sum += pow(outside_distance(n->x[j] + p * n->count[j], NULL, n->count[j]), 2);
    return sqrt(sum / (double)n->points);
}

/* True where the function jumps when point p moves by `by` relative to 1: a kink of its antiderivative. */
static inline bool outside_at_kink(lg_tape *tape, const lg_program *program, size_t function,
                                   const outside_numbers *in, const outside_numbers *want, size_t p,
                                   double by, double tolerance) {
    enum { TRIES = 16 };
    outside_numbers near = *in, out = *want;
    bool jumps = false;
    lg_rng rng;
    lg_rng_seed(&rng, 15, p);
    near.points = out.points = 1;
    for (size_t k = 0; k < in->ports; k++) near.x[k] = malloc(in->count[k] * sizeof(double) + 1);
    for (size_t j = 0; j < want->ports; j++) out.x[j] = malloc(want->count[j] * sizeof(double) + 1);
    for (int n = 0; n < TRIES; n++) {
        for (size_t k = 0; k < in->ports; k++)
            for (size_t i = 0; i < in->count[k]; i++)
                near.x[k][i] = in->x[k][p * in->count[k] + i] + by * lg_rng_uniform_in(&rng, -1, 1);
        outside_on_tape(tape, program, function, &near, 0, 1, &out);
        for (size_t j = 0; j < want->ports; j++) {
            const double *there = want->x[j] + p * want->count[j];
            const double change = outside_distance(out.x[j], there, want->count[j]);
            jumps |= change > 100 * tolerance * (1e-3 + outside_distance(there, NULL, want->count[j]));
        }
    }
    for (size_t k = 0; k < in->ports; k++) free(near.x[k]);
    for (size_t j = 0; j < want->ports; j++) free(out.x[j]);
    return jumps;
}

/* All rows of all outputs within 20 eps depth condition of the tape's; prints the worst in units of eps
 * depth. Functions with kinks may leave out one point in a hundred, if they jump there. */
static inline void outside_compare(const outside *o, const lg_program *program, size_t index, size_t points,
                                   double condition, bool kinks) {
    const size_t function = o->source->function[index];
    const char *name = lg_program_function_name(program, function);
    const double eps = o->dtype == LG_F32 ? (double)FLT_EPSILON : DBL_EPSILON;
    const double unit = eps * (double)(o->source->depth[index] > 0 ? o->source->depth[index] : 1);
    lg_tape *tape;
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    outside_numbers in = outside_draw(program, function, o->dtype, points);
    outside_numbers want = outside_wanted(tape, program, function, &in), got = want;
    for (size_t j = 0; j < got.ports; j++) {
        got.x[j] = malloc((points * got.count[j] + 1) * sizeof(double));
        assert_non_null(got.x[j]);
    }
    outside_call(o, name, &in, &got);
    double worst = 0;
    size_t left_out = 0;
    for (size_t j = 0; j < want.ports; j++) {
        const double mean = outside_mean(&want, j);
        for (size_t p = 0; p < points; p++) {
            const double error = outside_error(&got, &want, j, p, mean) / unit;
            if (error <= 20 * condition) {
                worst = error > worst ? error : worst;
                continue;
            }
            if (!kinks || !outside_at_kink(tape, program, function, &in, &want, p, 20 * unit, unit))
                fail_msg("%s, output %zu, point %zu: error %.3g eps depth", name, j, p, error);
            left_out++;
        }
    }
    assert_true(left_out * 100 <= points);
    print_message("  %-16s depth %3zu: worst %.2f eps depth, %zu left out\n", name, o->source->depth[index],
                  worst, left_out);
    outside_free(&in);
    outside_free(&want);
    outside_free(&got);
    lg_tape_destroy(tape);
}

#endif
