/* Tests what lg-export writes for other tools. It is built with its Makefile and called as the tool would
 * call it: CasADi externals, FMUs, Simulink functions. ONNX and safetensors files are inspected. The
 * reference are plans of the model's program and of its derivatives. The tools themselves are run in
 * bench/tools.
 * ctest-labels: slow apps/lg-export src/autodiff */
#include "../../examples/programs/programs.h"
#include "export_support.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"
#include "support/machine_models.h"

/* ---- models ---- */

static lg_program *program;
static training how;

RELEASES(release_program, lg_program_destroy)

/* Writes NAME.h5 and keeps its program in `program`. */
static void make_model(const char *name, lg_status (*make)(lg_program **out, training *t, lg_error *error)) {
    lg_error error = {.status = LG_OK};
    if (make(&program, &how, &error) != LG_OK) fail_msg("%s: %s", name, error.message);
    lg_test_owns(program, release_program);
    assert_ok(lg_program_save(NULL, cli_at(test_text("%s.h5", name)), program, NULL, NULL));
}

/* Exports NAME.h5 as model `m` for a target and runs make in the folder named after the target. */
static void build(const char *name, const char *target) {
    export_run(test_text("%s.h5 --out %s --name m --target %s --golden 2", name, target, target));
    export_expect(test_text("make -s -C %s CFLAGS='-O1 -Wall -Wextra -Werror'", target));
}

static void *open_library(const char *file) {
    void *handle = dlopen(cli_at(file), RTLD_NOW | RTLD_LOCAL);
    if (handle == NULL) fail_msg("%s", dlerror());
    return handle;
}

static void *symbol_of(void *handle, const char *name) {
    void *found = dlsym(handle, name);
    if (found == NULL) fail_msg("no symbol %s", name);
    return found;
}
#define SYMBOL(handle, name, result, parameters, pointer)                                                    \
    result(*pointer) parameters;                                                                             \
    *(void **)&pointer = symbol_of(handle, name)

/* ---- the library's results ---- */

enum { MOST = 16, NUMBERS = 4096 };

static void evaluate(const char *function, const double *const *in, double *const *out) {
    size_t at;
    lg_plan *plan;
    assert_ok(lg_program_find(program, function, &at, NULL));
    assert_ok(lg_plan_create(program, at, NULL, &plan, NULL));
    void *work = aligned_alloc(64, (lg_plan_work_size(plan) + 127) / 64 * 64);
    lg_plan_eval(plan, (const void *const *)in, (void *const *)out, work);
    free(work);
    lg_plan_destroy(plan);
}

static void derive(lg_derivative_kind kind, const char *function) {
    lg_derivative what;
    lg_derivative_init(&what);
    what.kind = kind;
    what.function = function;
    assert_ok(lg_program_derive(program, &what, NULL));
}

/* ---- CasADi ---- */

typedef struct external {
    int (*call)(const double **arg, double **res, long long *iw, double *w, int mem);
    long long (*n_in)(void), (*n_out)(void);
    const char *(*name_in)(long long), *(*name_out)(long long);
    const long long *(*sparsity_in)(long long), *(*sparsity_out)(long long);
    int (*work)(long long *, long long *, long long *, long long *);
    int (*checkout)(void);
    void (*release)(int);
} external;

static external open_external(void *handle, const char *name) {
    static const char *const ends[] = {"",          "_n_in",        "_n_out",        "_name_in",
                                       "_name_out", "_sparsity_in", "_sparsity_out", "_work",
                                       "_checkout", "_release"};
    external e;
    for (size_t i = 0; i < LG_COUNT(ends); i++) {
        ((void **)(void *)&e)[i] = symbol_of(handle, test_text("%s%s", name, ends[i]));
    }
    return e;
}

/* Expands a matrix in CasADi's form to a full row-major matrix. `s` is its pattern: {rows, columns, 1} for a
 * dense matrix, otherwise compressed columns; `from` holds the nonzeros. */
static void spread(const long long *s, const double *from, double *to) {
    const bool dense = s[2] == 1;
    for (long long i = 0; i < s[0] * s[1]; i++) to[i] = 0;
    for (long long c = 0, k = 0; c < s[1]; c++) {
        const long long end = dense ? (c + 1) * s[0] : s[2 + c + 1];
        for (; k < end; k++) to[(dense ? k - c * s[0] : s[2 + s[1] + 1 + k]) * s[1] + c] = from[k];
    }
}

static size_t nonzeros(const long long *s) {
    return (size_t)(s[2] == 1 ? s[0] * s[1] : s[2 + s[1]]);
}

/* Calls the external function. An argument that is named as one of `names` gets the numbers of `in`, others
 * are zero. `out` gets the results as full matrices, one after the other, including results that are declared
 * empty. */
static size_t call_external(const external *e, const char *const *names, const double *const *in,
                            size_t given, double *out) {
    static double room[MOST][NUMBERS], w[1 << 18];
    const double *arg[MOST];
    double *res[MOST];
    long long sizes[4];
    size_t at = 0;
    assert_int_equal(e->work(&sizes[0], &sizes[1], &sizes[2], &sizes[3]), 0);
    assert_true(sizes[3] < (long long)LG_COUNT(w) && e->n_out() <= MOST && e->n_in() <= MOST);
    for (size_t i = 0; i < LG_COUNT(w); i++) w[i] = NAN;
    for (long long i = 0; i < e->n_in(); i++) {
        arg[i] = NULL;
        for (size_t k = 0; k < given; k++)
            if (strcmp(names[k], e->name_in(i)) == 0) arg[i] = in[k];
    }
    for (long long o = 0; o < e->n_out(); o++) res[o] = room[o];
    const int memory = e->checkout();
    assert_int_equal(e->call(arg, res, NULL, w, memory), 0);
    e->release(memory);
    /* nothing is written beyond the work memory that the function asked for */
    assert_true(isnan(w[sizes[3]]));
    for (long long o = 0; o < e->n_out(); o++) {
        const long long *s = e->sparsity_out(o);
        spread(s, room[o], out + at);
        at += (size_t)(s[0] * s[1]);
    }
    for (long long o = 0; o < e->n_out(); o++) res[o] = NULL; /* no result is requested */
    assert_int_equal(e->call(arg, res, NULL, w, memory), 0);
    return at;
}

static const double x_at[2] = {0.3, -0.7}, u_at[1] = {0.4}, h_at[1] = {0.02}, seed[2] = {1.5, -0.25};

TEST("a CasADi external and its derivatives agree with the program") {
    static double got[NUMBERS], wanted[8][NUMBERS];
    static const char *const names[] = {"x", "u", "h", "adj_y", "fwd_x", "fwd_u", "fwd_h"};
    const double *const in[] = {x_at, u_at, h_at, seed, seed, u_at, h_at};
    make_model("driven", make_driven);
    build("driven", "casadi");
    void *handle = open_library("casadi/libm.so");
    double *out[8];
    for (size_t i = 0; i < 8; i++) out[i] = wanted[i];
    const external f = open_external(handle, "m_step"), adj = open_external(handle, "adj1_m_step"),
                   jac = open_external(handle, "jac_m_step"), fwd = open_external(handle, "fwd1_m_step"),
                   second = open_external(handle, "jac_adj1_m_step");
    assert_string_equal(f.name_in(1), "u");
    assert_null(f.name_in(3));
    evaluate("step", in, out);
    assert_int_equal(call_external(&f, names, in, 3, got), 2);
    assert_all_close(got, wanted[0], 2, 1e-14, 0);

    derive(LG_DERIVATIVE_ADJOINT, "step");
    evaluate("adj1_step", in, out);
    assert_int_equal(call_external(&adj, names, in, 4, got), 4);
    assert_all_close(got, wanted[0], 2, 1e-13, 0);
    assert_all_close(got + 2, wanted[1], 1, 1e-13, 0);
    assert_all_close(got + 3, wanted[2], 1, 1e-13, 0);

    derive(LG_DERIVATIVE_FORWARD, "step");
    const double *const forward[] = {x_at, u_at, h_at, seed, u_at, h_at};
    evaluate("fwd1_step", forward, out);
    assert_int_equal(call_external(&fwd, names, in, 7, got), 2);
    assert_all_close(got, wanted[0], 2, 1e-13, 0);

    derive(LG_DERIVATIVE_JACOBIAN, "step");
    evaluate("jac_step", in, out);
    assert_int_equal(call_external(&jac, names, in, 3, got), 8);
    assert_string_equal(jac.name_out(1), "jac_y_u");
    assert_string_equal(jac.name_in(3), "out_y");
    assert_int_equal(nonzeros(jac.sparsity_in(3)), 0);
    assert_all_close(got, wanted[0], 4, 1e-13, 1e-15);
    assert_all_close(got + 4, wanted[1], 2, 1e-13, 1e-15);
    assert_all_close(got + 6, wanted[2], 2, 1e-13, 1e-15);

    /* Outputs: the derivatives of adj_x, adj_u and adj_h with respect to x, u, h, out_y (empty) and adj_y. */
    derive(LG_DERIVATIVE_JACOBIAN_OF_ADJOINT, "step");
    size_t function, count;
    assert_ok(lg_program_find(program, "jac_adj1_step", &function, NULL));
    const lg_port *ports = lg_program_outputs(program, function, &count);
    static double all[MOST][NUMBERS];
    double *results[MOST];
    for (size_t i = 0; i < MOST; i++) results[i] = all[i];
    evaluate("jac_adj1_step", in, results);
    const size_t numbers = call_external(&second, names, in, 4, got);
    assert_int_equal(second.n_out(), 15);
    assert_int_equal(numbers, 4 * (4 + 2 + 2));
    for (long long o = 0, at = 0; o < second.n_out(); o++) {
        const long long *s = second.sparsity_out(o);
        size_t port = count;
        for (size_t i = 0; i < count; i++)
            if (strcmp(ports[i].name, second.name_out(o)) == 0) port = i;
        if (port < count)
            assert_all_close(got + at, all[port], (size_t)(s[0] * s[1]), 1e-12, 1e-14);
        else
            assert_int_equal(nonzeros(s), 0);
        at += s[0] * s[1];
    }
    assert_int_equal(dlclose(handle), 0);
    export_expect("make -s -C casadi CFLAGS=-O1 test");
}

/* ---- FMUs ---- */

static const char *token_of(const char *folder, const char *attribute) {
    static char text[CLI_TEXT], token[64];
    assert_true(cli_read(test_text("%s/modelDescription.xml", folder), text, sizeof text) > 0);
    const char *at = strstr(text, attribute);
    assert_non_null(at);
    (void)snprintf(token, sizeof token, "%.38s", strchr(at, '"') + 1);
    return token;
}

/* Ends the initialization, so that results can be read. */
static void begin2(void *handle, void *instance) {
    SYMBOL(handle, "fmi2EnterInitializationMode", int, (void *), enter);
    SYMBOL(handle, "fmi2ExitInitializationMode", int, (void *), leave);
    assert_int_equal(enter(instance), 0);
    assert_int_equal(leave(instance), 0);
}
static void begin3(void *handle, void *instance) {
    SYMBOL(handle, "fmi3EnterInitializationMode", int, (void *, bool, double, double, bool, double), enter);
    SYMBOL(handle, "fmi3ExitInitializationMode", int, (void *), leave);
    assert_int_equal(enter(instance, false, 0, 0, false, 0), 0);
    assert_int_equal(leave(instance), 0);
}

/* The functions of an FMU that keep and restore states, for either FMI version. */
typedef struct keeping {
    int (*keep)(void *, void **);
    int (*drop)(void *, void **);
    int (*size)(void *, void *, size_t *);
    int (*write)(void *, void *, char *, size_t);
    int (*read)(void *, const char *, size_t, void **);
} keeping;

/* Serialises a kept state and reads it back. Bytes that differ in one bit, or whose number differs by one,
 * must be refused. */
static void check_bytes(const keeping *k, void *instance, bool finite) {
    void *state = NULL, *again = NULL;
    size_t size = 0;
    assert_int_equal(k->keep(instance, &state), 0);
    assert_int_equal(k->size(instance, state, &size), 0);
    char *bytes = TEST_ARRAY(char, size + 1);
    assert_int_equal(k->write(instance, state, bytes, size - 1), 3);
    assert_int_equal(k->write(instance, state, bytes, size), 0);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        bytes[bit / 8] = (char)(bytes[bit / 8] ^ 1 << bit % 8);
        if (k->read(instance, bytes, size, &again) != 3) fail_msg("bit %zu is taken", bit);
        bytes[bit / 8] = (char)(bytes[bit / 8] ^ 1 << bit % 8);
    }
    assert_int_equal(k->read(instance, bytes, size - 1, &again), 3);
    assert_int_equal(k->read(instance, bytes, size + 1, &again), 3);
    assert_null(again);
    assert_int_equal(k->read(instance, bytes, size, &again), finite ? 0 : 3);
    if (finite) assert_int_equal(k->drop(instance, &again), 0);
    assert_int_equal(k->drop(instance, &state), 0);
}

/* The value references in modelDescription.xml of FMI 2.0: 0 and 1 are x, 2 and 3 are x', 4 is u, 5 is the
 * parameter longest_step. */
TEST("an FMU of version 2 has the program's rate, its derivatives, steps and states") {
    make_model("driven", make_driven);
    build("driven", "fmu2");
    void *handle = open_library("fmu2/m.so");
    SYMBOL(handle, "fmi2Instantiate", void *,
           (const char *, int, const char *, const char *, const void *, int, int), instantiate);
    SYMBOL(handle, "fmi2SetReal", int, (void *, const unsigned *, size_t, const double *), set);
    SYMBOL(handle, "fmi2GetReal", int, (void *, const unsigned *, size_t, double *), get);
    SYMBOL(handle, "fmi2GetDerivatives", int, (void *, double *, size_t), derivatives);
    SYMBOL(handle, "fmi2GetDirectionalDerivative", int,
           (void *, const unsigned *, size_t, const unsigned *, size_t, const double *, double *),
           directional);
    SYMBOL(handle, "fmi2DoStep", int, (void *, double, double, int), do_step);
    SYMBOL(handle, "fmi2GetFMUstate", int, (void *, void **), keep);
    SYMBOL(handle, "fmi2SetFMUstate", int, (void *, void *), put_back);
    SYMBOL(handle, "fmi2FreeFMUstate", int, (void *, void **), drop);
    SYMBOL(handle, "fmi2FreeInstance", void, (void *), release);
    static const unsigned known[] = {0, 1, 4}, rates[] = {2, 3};
    const double values[3] = {x_at[0], x_at[1], u_at[0]}, direction[3] = {seed[0], seed[1], 0.5};
    double got[2], rate[2], moved[2], next[2];
    assert_null(instantiate("a", 0, "{wrong}", NULL, NULL, 0, 0));
    void *instance = instantiate("a", 1, token_of("fmu2", " guid="), NULL, NULL, 0, 0), *state = NULL;
    assert_non_null(instance);
    assert_int_equal(set(instance, known, 3, values), 0);
    assert_int_not_equal(set(instance, rates, 1, values), 0);    /* refused: a result cannot be set */
    assert_int_not_equal(do_step(instance, 0.0, h_at[0], 1), 0); /* refused: not initialised */
    begin2(handle, instance);
    assert_int_not_equal(derivatives(instance, got, 2), 0); /* refused: not in co-simulation */
    const double *const in[] = {x_at, u_at, h_at};
    double *const out[] = {rate};
    evaluate("field", in, out);
    assert_int_equal(get(instance, rates, 2, got), 0);
    assert_all_close(got, rate, 2, 1e-14, 0);
    void *other = instantiate("b", 0, token_of("fmu2", " guid="), NULL, NULL, 0, 0);
    assert_int_equal(set(other, known, 3, values), 0);
    begin2(handle, other);
    assert_int_equal(derivatives(other, got, 2), 0);
    assert_all_close(got, rate, 2, 1e-14, 0);
    assert_int_not_equal(do_step(other, 0.0, h_at[0], 1), 0); /* refused: not in model exchange */

    derive(LG_DERIVATIVE_FORWARD, "field");
    const double *const forward[] = {x_at, u_at, seed, &direction[2]};
    double *const changes[] = {moved};
    evaluate("fwd1_field", forward, changes);
    assert_int_equal(directional(instance, rates, 2, known, 3, direction, got), 0);
    assert_all_close(got, moved, 2, 1e-13, 0);

    assert_int_equal(keep(instance, &state), 0);
    const double refused[] = {0.0, -0.01, NAN, INFINITY};
    for (size_t i = 0; i < LG_COUNT(refused); i++)
        assert_int_equal(do_step(instance, 0.0, refused[i], 1), 3); /* fmi2Error */
    assert_int_equal(get(instance, known, 2, got), 0);
    assert_all_close(got, x_at, 2, 0, 0);
    assert_int_equal(do_step(instance, 0.0, h_at[0], 1), 0);
    assert_int_equal(get(instance, known, 2, got), 0);
    double *const after[] = {next};
    const double small[1] = {h_at[0] / 2}; /* the longest step is 0.01 */
    const double *const first[] = {x_at, u_at, small};
    evaluate("step", first, after);
    const double middle[2] = {next[0], next[1]};
    const double *const then[] = {middle, u_at, small};
    evaluate("step", then, after);
    assert_all_close(got, next, 2, 1e-13, 0);
    assert_int_not_equal(put_back(other, state), 0); /* refused: it is in the mode of co-simulation */
    release(other);
    assert_int_equal(put_back(instance, state), 0);
    assert_int_equal(get(instance, known, 2, got), 0);
    assert_all_close(got, x_at, 2, 0, 0);
    assert_int_equal(drop(instance, &state), 0);
    assert_null(state);
    release(instance);
    assert_int_equal(dlclose(handle), 0);
}

static char sentence_got[128];
static void tell2(void *environment, const char *name, int status, const char *category, const char *format,
                  const char *sentence) {
    assert_ptr_equal(environment, sentence_got);
    (void)snprintf(sentence_got, sizeof sentence_got, format, sentence);
}

TEST("FMU steps that cannot be taken are refused with a message, and the state stays") {
    make_model("driven", make_driven);
    build("driven", "fmu2");
    void *handle = open_library("fmu2/m.so");
    SYMBOL(handle, "fmi2Instantiate", void *,
           (const char *, int, const char *, const char *, const void *, int, int), instantiate);
    SYMBOL(handle, "fmi2SetReal", int, (void *, const unsigned *, size_t, const double *), set);
    SYMBOL(handle, "fmi2GetReal", int, (void *, const unsigned *, size_t, double *), get);
    SYMBOL(handle, "fmi2DoStep", int, (void *, double, double, int), do_step);
    SYMBOL(handle, "fmi2FreeInstance", void, (void *), release);
    SYMBOL(handle, "fmi2GetFMUstate", int, (void *, void **), keep);
    SYMBOL(handle, "fmi2FreeFMUstate", int, (void *, void **), drop);
    SYMBOL(handle, "fmi2SerializedFMUstateSize", int, (void *, void *, size_t *), size);
    SYMBOL(handle, "fmi2SerializeFMUstate", int, (void *, void *, char *, size_t), write);
    SYMBOL(handle, "fmi2DeSerializeFMUstate", int, (void *, const char *, size_t, void **), read);
    const keeping all = {keep, drop, size, write, read};
    const struct {
        void (*logger)(void *, const char *, int, const char *, const char *, const char *);
        void *(*allocate)(size_t, size_t);
        void (*release)(void *);
        void (*finished)(void *, int);
        void *environment;
    } callbacks = {tell2, NULL, NULL, NULL, sentence_got};
    static const unsigned known[] = {0, 1, 4, 5};
    static const struct {
        double x, u, longest, length;
        const char *words; /* NULL: the step is taken */
    } rows[] = {{0.3, 0.4, 0.01, 0.02, NULL},
                {0.3, 0.4, 0.0, 0.02, NULL},
                {0.3, 0.4, 1e-11, 0.02, "1e9 steps"},
                {0.3, 0.4, 1e-300, 1e300, "1e9 steps"},
                {0.3, 0.4, -0.01, 0.02, "longest step"},
                {0.3, 0.4, NAN, 0.02, "longest step"},
                {NAN, 0.4, 0.01, 0.02, "not finite"},
                {0.3, INFINITY, 0.01, 0.02, "not finite"},
                {0.3, NAN, 1e-6, 20.0, "not finite"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        void *instance = instantiate("a", 1, token_of("fmu2", " guid="), NULL, &callbacks, 0, 0);
        const double values[] = {rows[i].x, x_at[1], rows[i].u, rows[i].longest};
        double got[2];
        sentence_got[0] = '\0';
        assert_int_equal(set(instance, known, 4, values), 0);
        begin2(handle, instance);
        if (do_step(instance, 1.0, rows[i].length, 1) != (rows[i].words != NULL ? 3 : 0))
            fail_msg("row %zu: %s", i, sentence_got);
        assert_int_equal(get(instance, known, 2, got), 0);
        const bool same = memcmp(got, values, sizeof got) == 0;
        if (same != (rows[i].words != NULL)) fail_msg("row %zu: the state is %g %g", i, got[0], got[1]);
        if (rows[i].words != NULL && strstr(sentence_got, rows[i].words) == NULL)
            fail_msg("row %zu: %s", i, sentence_got);
        if (i < 1 || isnan(rows[i].x)) check_bytes(&all, instance, i < 1);
        release(instance);
    }
    assert_int_equal(dlclose(handle), 0);
}

/* Value references of FMI 3.0 are ports: x 0, x' 1, u 2. */
TEST("an FMU of version 3 computes the program's adjoint derivatives") {
    make_model("driven", make_driven);
    build("driven", "fmu3");
    void *handle = open_library("fmu3/m.so");
    SYMBOL(handle, "fmi3InstantiateModelExchange", void *,
           (const char *, const char *, const char *, bool, bool, void *, void *), instantiate);
    SYMBOL(handle, "fmi3SetFloat64", int, (void *, const unsigned *, size_t, const double *, size_t), set);
    SYMBOL(handle, "fmi3GetFloat64", int, (void *, const unsigned *, size_t, double *, size_t), get);
    SYMBOL(handle, "fmi3GetAdjointDerivative", int,
           (void *, const unsigned *, size_t, const unsigned *, size_t, const double *, size_t, double *,
            size_t),
           adjoint);
    SYMBOL(handle, "fmi3FreeInstance", void, (void *), release);
    static const unsigned known[] = {0, 2}, rate_port[] = {1};
    const double values[3] = {x_at[0], x_at[1], u_at[0]};
    double got[3], rate[2], pulled[3];
    void *instance =
        instantiate("a", token_of("fmu3", "instantiationToken="), NULL, false, false, NULL, NULL);
    assert_non_null(instance);
    begin3(handle, instance);
    assert_int_equal(set(instance, known, 2, values, 3), 0);
    assert_int_not_equal(set(instance, known, 2, values, 2), 0);
    assert_int_equal(get(instance, rate_port, 1, got, 2), 0);
    const double *const in[] = {x_at, u_at, seed};
    double *const out[] = {rate}, *const back[] = {pulled, pulled + 2};
    evaluate("field", in, out);
    assert_all_close(got, rate, 2, 1e-14, 0);
    derive(LG_DERIVATIVE_ADJOINT, "field");
    evaluate("adj1_field", in, back);
    assert_int_equal(adjoint(instance, rate_port, 1, known, 2, seed, 2, got, 3), 0);
    assert_all_close(got, pulled, 3, 1e-13, 0);
    /* The state is an output here; its derivative by itself is the identity. */
    assert_int_equal(adjoint(instance, known, 1, known, 2, seed, 2, got, 3), 0);
    assert_all_close(got, ((double[]){seed[0], seed[1], 0}), 3, 0, 0);
    SYMBOL(handle, "fmi3GetFMUState", int, (void *, void **), keep);
    SYMBOL(handle, "fmi3FreeFMUState", int, (void *, void **), drop);
    SYMBOL(handle, "fmi3SerializedFMUStateSize", int, (void *, void *, size_t *), size);
    SYMBOL(handle, "fmi3SerializeFMUState", int, (void *, void *, char *, size_t), write);
    SYMBOL(handle, "fmi3DeserializeFMUState", int, (void *, const char *, size_t, void **), read);
    const keeping all = {keep, drop, size, write, read};
    check_bytes(&all, instance, true);
    release(instance);
    assert_int_equal(dlclose(handle), 0);
}

/* ---- descriptions of states and inputs ---- */

/* Joins comment lines that were wrapped, and replaces several blanks by one. */
static void join_lines(char *text) {
    char *to = text;
    for (const char *at = text; *at != '\0'; at++) {
        if (strncmp(at, "\n * ", 4) == 0) at += 3;
        if (*at != ' ' || to == text || to[-1] != ' ') *to++ = *at;
    }
    *to = '\0';
}

/* The machine of all kinds with this delay of its inputs. */
static const char *late_machine(const char *delay) {
    const char *end = strstr(machine_of_all_kinds, "[u1, u2]") + strlen("[u1, u2]");
    return test_text("%.*s, delay: %s%s", (int)(end - machine_of_all_kinds), machine_of_all_kinds, delay,
                     end);
}

TEST("an input that acts later than the others is named") {
    lg_machine_model_file *file = make_machine_model(late_machine("[0, 2]"), 3);
    save_machine_model(file, cli_at("late.h5"));
    cli_expect("lg-export", "late.h5 --out late-c --name m --target c --golden 1", 0, "");
    assert_says(result.err,
                "the model's input u2 acts 2 rows of the log, 0.04 in time, later than it is logged;");
}

TEST("every target describes the numbers of a machine, and says that inputs act with a delay") {
    static const struct {
        const char *target, *file, *words[3];
    } told[] = {
        {"c",
         "m.h",
         {"momenta x (1)", "u1 u2 as in the log", "delay inputs act 3 rows of the log, 0.06 in time, later"}},
        {"casadi", "m_casadi.c", {"momenta x (1)", "hull.R (9, rows)", "inputs act 3 rows of the log, 0.06"}},
        {"simulink", "m_simulink.h", {"momenta x (1)", "u1 u2", "inputs act 3 rows of the log, 0.06"}},
        {"simulink", "m_sfun.c", {"momenta x (1)", "u1 u2", "inputs act 3 rows of the log, 0.06"}},
        {"fmu2", "m.h", {"position x -1 to 2", "inputs act 3 rows", "x x theta hull"}},
        {"fmu2",
         "modelDescription.xml",
         {"name=\"x[1]\" valueReference=\"0\" causality=\"local\" variability=\"continuous\" "
          "initial=\"exact\" "
          "description=\"x\"",
          "description=\"momentum of body 3\"", "description=\"u2; inputs act 3 rows of the log, 0.06"}},
        {"fmu3",
         "modelDescription.xml",
         {"description=\"x theta hull.x hull.y hull.z rod.q (3) rod.p (3) body.R (9, rows) hull.R (9, rows) "
          "momenta",
          "description=\"u1 u2; inputs act 3 rows", "inputs act 3 rows"}}};
    static char text[1 << 20];
    char line[256];
    lg_machine_model_file *file = make_machine_model(late_machine("estimate"), 3);
    file->run.estimated = 3;
    save_machine_model(file, cli_at("late.h5"));
    for (size_t i = 0; i < LG_COUNT(told); i++) {
        (void)snprintf(line, sizeof line, "late.h5 --out late-%s --name m --target %s --golden 1",
                       told[i].target, told[i].target);
        cli_expect("lg-export", line, 0, "");
        assert_non_null(strstr(result.err, "inputs act 3 rows of the log, 0.06 in time, later"));
        assert_non_null(strstr(result.err, "delay the inputs before you pass them"));
        (void)snprintf(line, sizeof line, "late-%s/%s", told[i].target, told[i].file);
        assert_true(cli_read(line, text, sizeof text) > 0);
        join_lines(text);
        for (size_t k = 0; k < LG_COUNT(told[i].words); k++)
            if (strstr(text, told[i].words[k]) == NULL) fail_msg("%s: no '%s'", line, told[i].words[k]);
    }
}

/* ---- scenes ---- */

/* A pendulum with two links, in steps of the length that the parameter sets, compared with lg-simulate. */
TEST("a scene becomes an FMU with tunable parameters") {
    cli_write(
        "chain.yaml",
        "system: pendulum-chain\nform: hamiltonian\ngravity: 9.81\nmasses: [1, 1.3]\nlengths: [1, 0.8]\n"
        "initial: {q: [[0.6, 0, -0.8], [0, 0.6, 0.8]], p: [[0, 0.1, 0], [0.2, 0, 0]]}\nt_end: 0.2\n");
    export_run("chain.yaml --out scene --name m --target fmu3");
    export_expect("make -s -C scene CFLAGS='-O1 -Wall -Wextra -Werror' && grep -q 'name=\"m2\"' "
                  "scene/modelDescription.xml && grep -q 'stopTime=\"0.2' scene/modelDescription.xml");
    void *handle = open_library("scene/m.so");
    SYMBOL(handle, "fmi3InstantiateCoSimulation", void *,
           (const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *, size_t,
            void *, void *, void *),
           instantiate);
    SYMBOL(handle, "fmi3GetFloat64", int, (void *, const unsigned *, size_t, double *, size_t), get);
    SYMBOL(handle, "fmi3DoStep", int, (void *, double, double, bool, bool *, bool *, bool *, double *),
           do_step);
    SYMBOL(handle, "fmi3FreeInstance", void, (void *), release);
    static const unsigned state[] = {0}, masses[] = {3, 4};
    bool flags[3];
    double last, y[12], m[2];
    void *instance = instantiate("a", token_of("scene", "instantiationToken="), NULL, false, false, false,
                                 false, NULL, 0, NULL, NULL, NULL);
    assert_non_null(instance);
    begin3(handle, instance);
    assert_int_equal(get(instance, masses, 2, m, 2), 0);
    assert_close(m[0], 1, 0, 0);
    assert_close(m[1], 1.3, 0, 0);
    const double refused[] = {0.0, -0.01, NAN, INFINITY};
    for (size_t i = 0; i < LG_COUNT(refused); i++)
        assert_int_equal(do_step(instance, 0.0, refused[i], true, &flags[0], &flags[1], &flags[2], &last), 3);
    assert_int_equal(do_step(instance, 0.0, 0.2, true, &flags[0], &flags[1], &flags[2], &last), 0);
    assert_int_equal(get(instance, state, 1, y, 12), 0);
    cli_expect("lg-simulate", "chain.yaml --method cf4 --steps 20 --json", 0, "\"y\": [");
    const char *at = strstr(result.out, "\"y\": [") + 6;
    for (size_t i = 0; i < 12; i++) {
        char *end;
        assert_close(y[i], strtod(at, &end), 1e-10, 1e-12);
        at = end + 1;
    }
    SYMBOL(handle, "fmi3SetFloat64", int, (void *, const unsigned *, size_t, const double *, size_t), set);
    const double endless[] = {NAN};
    assert_int_equal(set(instance, masses, 1, endless, 1), 0);
    assert_int_equal(do_step(instance, 0.5, 0.2, true, &flags[0], &flags[1], &flags[2], &last), 3);
    assert_close(last, 0.5, 0, 0);
    double still[12];
    assert_int_equal(get(instance, state, 1, still, 12), 0);
    assert_all_close(still, y, 12, 0, 0);
    release(instance);
    assert_int_equal(dlclose(handle), 0);
    export_run("chain.yaml --out code --name m");
    cli_write("code/run.c",
              "#include <stdio.h>\n#include \"m.h\"\nint main(void) {\n"
              "    double x[12] = {0.6, 0, -0.8, 0, 0.1, 0, 0, 0.6, 0.8, 0.2, 0, 0}, next[12], "
              "work[m_WORK_SIZE];\n"
              "    const double g = 9.81, m[2] = {1, 1.3}, L[2] = {1, 0.8}, h = 0.01;\n"
              "    for (int i = 0; i < 20; i++) {\n"
              "        m_step(x, &g, &m[0], &m[1], &L[0], &L[1], &h, next, work);\n"
              "        for (int k = 0; k < 12; k++) x[k] = next[k];\n    }\n"
              "    for (int k = 0; k < 12; k++) printf(\"%.17g\\n\", x[k]);\n    return 0;\n}\n");
    export_expect(
        "cd code && make -s test && cc -std=c99 -O1 run.c m.c m_weights.c -lm -o run && ./run >../end");
    char text[1024], *from = text;
    cli_read("end", text, sizeof text);
    for (size_t i = 0; i < 12; i++) assert_close(strtod(from, &from), y[i], 1e-10, 1e-12);
    cli_expect("lg-export", "chain.yaml --out no --target safetensors", 2, "has no parameters");
}

/* ---- CMake, Simulink, ONNX, safetensors ---- */

TEST("an exported package is built, installed and found by CMake") {
    make_model("driven", make_driven);
    export_run("driven.h5 --out package --name m --target package");
    export_expect("grep -q '<build_type>cmake</build_type>' package/package.xml");
    export_expect("! command -v xmllint || xmllint --noout package/package.xml");
    export_expect("cmake -S package -B package-build -DCMAKE_INSTALL_PREFIX=$PWD/root && cmake --build "
                  "package-build && "
                  "(cd package-build && ctest) && cmake --install package-build");
    cli_write("CMakeLists.txt",
              "cmake_minimum_required(VERSION 3.10)\nproject(user C)\nfind_package(m 1.0 REQUIRED)\n"
              "add_executable(user user.c)\ntarget_link_libraries(user m::m)\n");
    cli_write("user.c", "#include <m.h>\nint main(void) { return m_WORK_SIZE > 0 ? 0 : 1; }\n");
    export_expect("cmake -S . -B user-build -DCMAKE_PREFIX_PATH=$PWD/root && cmake --build user-build && "
                  "./user-build/user");
}

static void *open_sfunction(const char *model) {
    build(model, "simulink");
    export_expect(test_text("cd simulink && cc -std=c99 -Wall -Wextra -Werror -Wno-unused-function "
                            "-Wno-unused-const-variable -fPIC -shared "
                            "-I'%s/apps/simulink' m_simulink.c m_sfun.c m.c m_weights.c -lm -o m.so",
                            LG_TEST_DIR));
    return open_library("simulink/m.so");
}

TEST("functions for Simulink take arrays of constant size; the S-function compiles with the documented "
     "names") {
    make_model("driven", make_driven);
    void *handle = open_sfunction("driven");
    SYMBOL(handle, "m_field", void, (const double *, const double *, double *), field);
    SYMBOL(handle, "stand_in_run", void, (const double *, const double *, double *, double *), run);
    double got[2], wanted[2], state[2], rate[2];
    const double *const in[] = {x_at, u_at};
    double *const out[] = {wanted};
    evaluate("field", in, out);
    field(x_at, u_at, got);
    assert_all_close(got, wanted, 2, 1e-14, 0);
    run(x_at, u_at, state, rate);
    assert_all_close(state, x_at, 2, 0, 0);
    assert_all_close(rate, wanted, 2, 1e-14, 0);
    assert_int_equal(dlclose(handle), 0);
}

TEST("ONNX and safetensors files have the right contents; an operation that ONNX lacks is named") {
    static char out[EXPORT_TEXT];
    make_model("throw", make_throw);
    export_run("throw.h5 --out onnx --name m --target onnx");
    export_expect("head -c 40 onnx/m.onnx | grep -qa 'lg-export: m'");
    export_run("throw.h5 --out onnx --name m --target onnx"); /* replaces the first export */
    export_run("throw.h5 --out tensors --name m --target safetensors");
    const int code =
        export_shell("n=$(od -An -tu8 -N8 tensors/m.safetensors); tail -c +9 tensors/m.safetensors | "
                     "head -c $n | tr -d ' ' && test $((n % 8)) = 0",
                     out);
    assert_int_equal(code, 0);
    const lg_parameter_spec first = lg_program_parameter(program, 0);
    assert_non_null(strstr(out, test_text("\"%s\":{\"dtype\":\"F64\"", first.name)));
    make_model("attitude", make_attitude);
    cli_expect("lg-export", "attitude.h5 --out no --name m --target onnx --functions step", 2,
               "has no form in ONNX");
}

/* A program whose input has a long name; it computes the sign of the input. */
static lg_status record_sign(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    (void)user;
    (void)theta;
    out[0] = lg_sign(tape, in[0]);
    return lg_tape_status(tape);
}
static lg_status make_sign(lg_program **out, training *t, lg_error *error) {
    const lg_port x = {.name = "position_of_the_first_body_in_metres", .shape = lg_shape1(2)},
                  y = {.name = "y"};
    const lg_function_spec value = {"value", &x, 1, &y, 1, record_sign, NULL};
    lg_program_spec spec;
    (void)t;
    lg_program_spec_init(&spec);
    spec.functions = &value;
    spec.function_count = 1;
    return lg_program_build(NULL, &spec, out, error);
}

TEST("ONNX: input names are complete; the sign of zero is 1 as in the library, unlike ONNX's Sign") {
    make_model("sign", make_sign);
    export_run("sign.h5 --out signs --name m --target onnx");
    export_expect("test $(grep -aow position_of_the_first_body_in_metres signs/m.onnx | wc -l) = 4");
    export_expect("grep -qa GreaterOrEqual signs/m.onnx && ! grep -qaw Sign signs/m.onnx");
}

/* Elementwise operations of numbers x and y; output i of a program is OUTPUT_LIST's entry i. */
#define OUTPUT_LIST(X)                                                                                       \
    X(lg_add(t, x, y))                                                                                       \
    X(lg_sub(t, x, y))                                                                                       \
    X(lg_mul(t, x, y))                                                                                       \
    X(lg_div(t, x, y))                                                                                       \
    X(lg_max(t, x, y))                                                                                       \
    X(lg_ge(t, x, y))                                                                                        \
    X(lg_atan2(t, x, y))                                                                                     \
    X(lg_select(t, x, y, lg_neg(t, y)))                                                                      \
    X(lg_lerp(t, x, y, x))                                                                                   \
    X(lg_linear_combination(t, (const lg_var[]){x, y}, (const double[]){2, -1}, 2))                          \
    X(lg_scale(t, x, 2.5))                                                                                   \
    X(lg_add_scalar(t, x, 1.5))                                                                              \
    X(lg_sqrt(t, x))                                                                                         \
    X(lg_exp(t, x))                                                                                          \
    X(lg_log(t, x))                                                                                          \
    X(lg_sin(t, x))                                                                                          \
    X(lg_cos(t, x))                                                                                          \
    X(lg_abs(t, x))                                                                                          \
    X(lg_sign(t, x))                                                                                         \
    X(lg_pow(t, x, 0))                                                                                       \
    X(lg_pow(t, x, 2))                                                                                       \
    X(lg_pow(t, x, 3))                                                                                       \
    X(lg_pow(t, x, 0.5))                                                                                     \
    X(lg_pow(t, x, -1))                                                                                      \
    X(lg_pow(t, x, -2))                                                                                      \
    X(lg_pow(t, x, -0.5))                                                                                    \
    X(lg_stop_gradient(t, x))                                                                                \
    X(lg_act_derivative(t, x, LG_TANH, 1))                                                                   \
    X(lg_act_derivative(t, x, LG_SIGMOID, 1))                                                                \
    X(lg_act_derivative(t, x, LG_SWISH, 1))                                                                  \
    X(lg_act_derivative(t, x, LG_SINE, 1))
#define COUNT_OUTPUT(expression) +1
enum { OUTPUTS = OUTPUT_LIST(COUNT_OUTPUT) + LG_ACTIVATION_COUNT };

static lg_status record_all(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_var x = in[0], y = in[1];
    (void)user;
    (void)theta;
#define PUT_OUTPUT(expression) *out++ = expression;
    OUTPUT_LIST(PUT_OUTPUT)
    for (int kind = 0; kind < LG_ACTIVATION_COUNT; kind++) *out++ = lg_act(t, x, (lg_activation)kind);
    return lg_tape_status(t);
}
static lg_status make_all(lg_program **out, training *t, lg_error *error) {
    static char names[OUTPUTS][8];
    const lg_port in[2] = {{.name = "x", .low = 0.1, .high = 2}, {.name = "y", .low = 0.1, .high = 2}};
    lg_port ports[OUTPUTS] = {{.name = NULL}};
    for (size_t i = 0; i < OUTPUTS; i++) {
        (void)snprintf(names[i], sizeof names[i], "r%zu", i);
        ports[i].name = names[i];
    }
    const lg_function_spec value = {"value", in, 2, ports, OUTPUTS, record_all, NULL};
    lg_program_spec spec;
    (void)t;
    lg_program_spec_init(&spec);
    spec.functions = &value;
    spec.function_count = 1;
    return lg_program_build(NULL, &spec, out, error);
}

static const double special[] = {0,
                                 -0.0,
                                 1,
                                 -1,
                                 0.75,
                                 -2.5,
                                 5e-324,
                                 -5e-324,
                                 1e-310,
                                 1e308,
                                 -1e308,
                                 800,
                                 -800,
                                 (double)INFINITY,
                                 -(double)INFINITY,
                                 (double)NAN};
enum { SPECIAL = LG_COUNT(special), POINTS = SPECIAL * SPECIAL };

static bool same_number(double a, double b) {
    if (isnan(a) || isnan(b)) return isnan(a) && isnan(b);
    return a == b || fabs(a - b) <= 1e-13 * fmax(1, fabs(b));
}

TEST(
    "ONNX: every elementwise operation is as in the program at zeros, denormal numbers, infinities and NaN") {
    double x[POINTS], y[POINTS], r[OUTPUTS][POINTS], got;
    const double *in[2] = {x, y};
    double *out[OUTPUTS];
    for (size_t i = 0; i < OUTPUTS; i++) out[i] = r[i];
    make_model("all", make_all);
    export_run("all.h5 --out all --name m --target onnx --dtype f64");
    FILE *file = fopen(cli_at("points.txt"), "w");
    assert_non_null(file);
    for (size_t i = 0; i < POINTS; i++) {
        x[i] = special[i / SPECIAL];
        y[i] = special[i % SPECIAL];
        assert_true(fprintf(file, "%.17g %.17g\n", x[i], y[i]) > 0);
    }
    assert_int_equal(fclose(file), 0);
    export_expect("python3 " LG_TEST_DIR "/apps/onnx_values.py all/m.onnx < points.txt > values.txt");
    lg_plan_options options;
    lg_plan *plan;
    lg_plan_options_init(&options);
    options.rows = POINTS;
    assert_told(lg_plan_create(program, 0, &options, &plan, &told));
    void *work = aligned_alloc(64, (lg_plan_work_size(plan) + 63) / 64 * 64);
    lg_plan_eval(plan, (const void *const *)in, (void *const *)out, work);
    free(work);
    lg_plan_destroy(plan);
    file = fopen(cli_at("values.txt"), "r");
    assert_non_null(file);
    for (size_t i = 0; i < POINTS; i++)
        for (size_t o = 0; o < OUTPUTS; o++) {
            assert_int_equal(fscanf(file, "%lf", &got), 1);
            if (!same_number(got, r[o][i]))
                fail_msg("output %zu at (%g, %g): ONNX %.17g, program %.17g", o, x[i], y[i], got, r[o][i]);
        }
    assert_int_equal(fclose(file), 0);
}

enum { LAYERS = 70 };

static double weight_of(size_t layer) {
    return 0.3 + 0.01 * (double)layer;
}

/* y = tanh(w70 ... tanh(w1 x)) */
static lg_status record_deep(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    (void)user;
    out[0] = in[0];
    for (size_t i = 0; i < LAYERS; i++) out[0] = lg_act(tape, lg_matmul(tape, out[0], theta[i]), LG_TANH);
    return lg_tape_status(tape);
}
static lg_status make_layers(lg_program **out, training *t, lg_error *error) {
    lg_parameter_spec parameters[LAYERS];
    char names[LAYERS][16];
    double values[LAYERS];
    const lg_port x = {.name = "x", .shape = lg_shape1(1)}, y = {.name = "y"};
    const lg_function_spec value = {"value", &x, 1, &y, 1, record_deep, NULL};
    lg_program_spec spec;
    (void)t;
    for (size_t i = 0; i < LAYERS; i++) {
        (void)snprintf(names[i], sizeof names[i], "w%zu", i);
        values[i] = weight_of(i);
        parameters[i] = (lg_parameter_spec){names[i], lg_shape2(1, 1), &values[i]};
    }
    lg_program_spec_init(&spec);
    spec.parameters = parameters;
    spec.parameter_count = LAYERS;
    spec.functions = &value;
    spec.function_count = 1;
    return lg_program_build(NULL, &spec, out, error);
}

TEST("ONNX: there may be more constants than function outputs, and each constant has its numbers") {
    static char text[1 << 16];
    make_model("deep", make_layers);
    export_run("deep.h5 --out deep --name m --target onnx");
    const size_t size = cli_read("deep/m.onnx", text, sizeof text);
    for (size_t i = 0, at = 0; i < LAYERS; i++) {
        const double wanted = weight_of(i);
        while (at + sizeof wanted <= size && memcmp(text + at, &wanted, sizeof wanted) != 0) at++;
        if (at + sizeof wanted > size) fail_msg("weight %zu is missing or out of order", i);
    }
}

/* y = -x */
static lg_status record_negative(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,
                                 lg_var *out) {
    out[0] = lg_neg(tape, in[0]);
    return lg_tape_status(tape);
}

TEST("ONNX: a program with as many functions as a program may have is exported") {
    const lg_port x = {.name = "x", .shape = lg_shape1(1)}, y = {.name = "y"};
    char name[16];
    const lg_function_spec more = {name, &x, 1, &y, 1, record_negative, NULL};
    lg_error why = {LG_OK, ""};
    make_model("deep", make_layers);
    for (size_t i = 0; why.status == LG_OK; i++) {
        (void)snprintf(name, sizeof name, "more_%zu", i);
        (void)lg_program_add_function(program, &more, &why);
    }
    assert_says(why.message, "at most 256 functions");
    assert_told(lg_program_save(NULL, cli_at("full.h5"), program, NULL, &told));
    export_run("full.h5 --out full --name m --target onnx");
    export_run("deep.h5 --out deep --name m --target onnx");
    export_expect("cmp full/m.onnx deep/m.onnx");
}

/* y = w x + 3 for each row x; all rows share w, the first input. */
static lg_status record_line(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const double three = 3;
    const lg_var rise = lg_mul(tape, in[0], in[1]), offset = lg_input_f64(tape, lg_shape1(1), &three);
    out[0] = lg_add(tape, rise, lg_broadcast_to(tape, offset, lg_var_shape(tape, rise)));
    return lg_tape_status(tape);
}
static lg_status make_line(lg_program **out, training *t, lg_error *error) {
    const lg_port in[2] = {{.name = "w", .shared = true}, {.name = "x"}}, y = {.name = "y"};
    const lg_function_spec value = {"value", in, 2, &y, 1, record_line, NULL};
    const lg_program_spec spec = {.size = sizeof spec, .functions = &value, .function_count = 1};
    return lg_program_build(NULL, &spec, out, error);
}

TEST("ONNX: the number of rows is that of an input that has rows, though rows share the first input") {
    make_model("line", make_line);
    export_run("line.h5 --out line --name m --target onnx --dtype f64");
    export_expect("test \"$(echo 2 5 | python3 " LG_TEST_DIR "/apps/onnx_values.py line/m.onnx)\" = 13.0");
}

TEST("inputs that rows share are input ports of an S-function") {
    make_model("line", make_line);
    void *handle = open_sfunction("line");
    SYMBOL(handle, "stand_in_run", void, (const double *, const double *, double *, double *), run);
    double got = 0, rate;
    run(&got, (const double[2]){2, 5}, &got, &rate);
    assert_close(got, 13, 0, 0);
    assert_int_equal(dlclose(handle), 0);
}

TEST("a scheme that a target does not support is refused; a function that is named twice counts once") {
    make_model("throw", make_throw);
    export_run("throw.h5 --out twice --name m --target fmu2 --functions value,value");
    export_expect("test $(grep -c 'name=\"value\\[1\\]\"' twice/modelDescription.xml) = 1");
    make_model("driven", make_driven);
    cli_expect("lg-export", "driven.h5 --out no --name m --target onnx --scheme cf4", 2,
               "is for Hamiltonians and machines");
}

TEST("single precision and missing functions are refused with a message") {
    make_model("driven", make_driven);
    static const char *const targets[] = {"casadi", "fmu2", "fmu3", "simulink"};
    for (size_t i = 0; i < LG_COUNT(targets); i++) {
        cli_expect("lg-export", test_text("driven.h5 --out no --name m --dtype f32 --target %s", targets[i]),
                   2, "double precision");
        cli_expect("lg-export",
                   test_text("driven.h5 --out no --name m --functions nothing --target %s", targets[i]), 2,
                   "no function 'nothing'");
        cli_expect("lg-export",
                   test_text("driven.h5 --out no --name m --functions linearise --target %s", targets[i]), 2,
                   "jac_NAME_step");
    }
}

TEST_GROUP(export_begin, export_end)
