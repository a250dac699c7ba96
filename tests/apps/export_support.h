/* Tests exported models: runs lg-export, compiles the C with many compilers and flags, calls the functions
 * and inspects the objects. Use:
 *
 *    TEST_GROUP(export_begin, export_end)                makes and removes a folder (cli_folder)
 *    lg_..._save(cli path of "m.h5")               or a program writes the model
 *    export_run("m.h5 --out m --dtype f32 --seed 3");
 *    export_library lib = export_open("m", "m", "gcc", "-O1");
 *    export_eval(&lib, x, y); export_grad(&lib, x, y, jacobian); export_call(&lib, "field", 3, ports);
 *    export_close(&lib);
 *    export_check_ways("m", "m");                        warnings, self-tests, sanitizers, C++
 *    export_check_objects("m", "m"); export_check_stack("m"); */
#ifndef LG_TEST_EXPORT_SUPPORT_H
#define LG_TEST_EXPORT_SUPPORT_H

#include "cli_support.h"

#include <dlfcn.h>

#include "liegrad/core.h"
#include "support/seed.h"

#define EXPORT_WARNINGS                                                                                      \
    "-Wall -Wextra -Wconversion -Wdouble-promotion -Wshadow -pedantic -Werror -Wstrict-aliasing "
#define EXPORT_C   "-x c -std=c99 -Wmissing-prototypes -Wstrict-prototypes " EXPORT_WARNINGS
#define EXPORT_CPP "-x c++ -std=c++14 " EXPORT_WARNINGS

enum { EXPORT_TEXT = 65536, EXPORT_LINE = 2048 };

static inline int export_begin(void **state) {
    (void)setenv("ASAN_OPTIONS", "allocator_may_return_null=1", 0);
    cli_make_folder();
    return cli_folder[0] == '\0' ? -1 : 0;
}

/* ---- the shell ---- */

/* Starts a shell command in the folder. The stream yields its standard output and standard error. */
static inline FILE *export_start(const char *command) {
    const char *line = test_text("cd '%s' && { %s; } 2>&1", cli_folder, command);
    (void)fflush(NULL);
    FILE *stream = popen(line, "r");
    assert_non_null(stream);
    return stream;
}

/* Waits for the command and returns its exit code; its output is in `out` (EXPORT_TEXT bytes). */
static inline int export_finish(FILE *stream, char *out) {
    size_t used = 0;
    char rest[256];
    for (size_t n; (n = fread(out + used, 1, EXPORT_TEXT - 1 - used, stream)) > 0;) used += n;
    out[used] = '\0';
    while (fread(rest, 1, sizeof rest, stream) > 0) continue;
    const int status = pclose(stream);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1000;
}

static inline int export_shell(const char *command, char *out) {
    return export_finish(export_start(command), out);
}

static inline void export_expect(const char *command) {
    static char out[EXPORT_TEXT];
    const int code = export_shell(command, out);
    if (code != 0) fail_msg("%s: exit code %d\n%s", command, code, out);
}

static inline bool export_has(const char *compiler) {
    static char out[EXPORT_TEXT];
    const bool found =
        export_shell(test_text("command -v %.*s", (int)strcspn(compiler, " "), compiler), out) == 0;
    if (!found) print_message("%s is not installed: left out\n", compiler);
    return found;
}

/* Ends the group of tests: removes the folder with all its files. */
static inline int export_end(void **state) {
    char command[300];
    (void)snprintf(command, sizeof command, "rm -rf -- '%s'", cli_folder);
    return system(command) == 0 ? 0 : -1;
}

/* ---- exporting ---- */

/* Runs lg-export with these arguments; it must succeed. The folder of --out is made in the test's folder. */
static inline void export_run(const char *arguments) {
    cli_expect("lg-export", arguments, 0, "");
}

/* The number that `#define NAME_<constant>` has in the exported header. */
static inline double export_constant(const char *folder, const char *name, const char *constant) {
    char line[EXPORT_LINE];
    const char *path = test_text("%s/%s/%s.h", cli_folder, folder, name);
    const char *words = test_text("#define %s_%s ", name, constant);
    double value = NAN;
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    while (fgets(line, sizeof line, file) != NULL)
        if (strncmp(line, words, strlen(words)) == 0) value = strtod(line + strlen(words), NULL);
    assert_int_equal(fclose(file), 0);
    if (isnan(value)) fail_msg("%s: no %s", path, words);
    return value;
}

/* ---- calls ---- */

typedef struct export_library {
    void *handle;
    char name[64];
    bool single;            /* NAME_real is float */
    size_t inputs, outputs; /* NAME_INPUTS, NAME_OUTPUTS */
    size_t work_size;       /* NAME_WORK_SIZE */
    double tolerance;       /* NAME_TOLERANCE */
    void *work;             /* work_size numbers of type NAME_real; filled with NaN before every call */
} export_library;

/* Compiles NAME.c and NAME_weights.c of the folder into a shared object and loads it. A compiler whose name
 * contains "++" is a C++ compiler. */
static inline export_library export_open(const char *folder, const char *name, const char *compiler,
                                         const char *flags) {
    static int count;
    char command[EXPORT_LINE];
    export_library lib = {.inputs = (size_t)export_constant(folder, name, "INPUTS"),
                          .outputs = (size_t)export_constant(folder, name, "OUTPUTS"),
                          .work_size = (size_t)export_constant(folder, name, "WORK_SIZE"),
                          .tolerance = export_constant(folder, name, "TOLERANCE")};
    (void)snprintf(lib.name, sizeof lib.name, "%s", name);
    const char *path = test_text("%s/%s/lib%d.so", cli_folder, folder, ++count);
    (void)snprintf(command, sizeof command,
                   "cd %s && %s %s %s -fPIC -shared %s.c %s_weights.c -x none -lm -o %s", folder, compiler,
                   strstr(compiler, "++") != NULL ? EXPORT_CPP : EXPORT_C, flags, name, name, path);
    export_expect(command);
    lib.handle = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (lib.handle == NULL) fail_msg("%s", dlerror());
    const char *words = test_text("grep -q 'typedef float %s_real;' %s/%s.h", name, folder, name);
    static char out[EXPORT_TEXT];
    lib.single = export_shell(words, out) == 0;
    lib.work = calloc(lib.work_size, lib.single ? sizeof(float) : sizeof(double));
    assert_non_null(lib.work);
    return lib;
}

static inline void export_close(export_library *lib) {
    assert_int_equal(dlclose(lib->handle), 0);
    free(lib->work);
    *lib = (export_library){.handle = NULL};
}

/* The address of NAME_<what>. The caller casts it to the function's type through a union or memcpy, or uses
 * EXPORT_FUNCTION. */
static inline void *export_symbol(const export_library *lib, const char *what) {
    const char *symbol = test_text("%s_%s", lib->name, what);
    void *found = dlsym(lib->handle, symbol);
    if (found == NULL) fail_msg("no symbol %s", symbol);
    return found;
}

/* EXPORT_FUNCTION(&lib, "step", void, (double h, const double *x, ...), step): declares a pointer `step`. */
#define EXPORT_FUNCTION(lib, what, result, parameters, pointer)                                              \
    result(*pointer) parameters;                                                                             \
    *(void **)&pointer = export_symbol(lib, what)

/* export_reals: a copy of `values` in the exported type, NULL for NULL. export_doubles: copies such numbers
 * back. The caller frees the copy. */
static inline void *export_reals(const export_library *lib, const double *values, size_t count) {
    if (values == NULL) return NULL;
    void *out = calloc(count > 0 ? count : 1, lib->single ? sizeof(float) : sizeof(double));
    assert_non_null(out);
    for (size_t i = 0; i < count; i++) {
        if (lib->single)
            ((float *)out)[i] = (float)values[i];
        else
            ((double *)out)[i] = values[i];
    }
    return out;
}

static inline void export_doubles(const export_library *lib, const void *reals, double *out, size_t count) {
    for (size_t i = 0; i < count && out != NULL; i++)
        out[i] = lib->single ? (double)((const float *)reals)[i] : ((const double *)reals)[i];
}

/* The value rounded to the exported type, so that the library gets the same inputs as the exported code. */
static inline double export_rounded(const export_library *lib, double value) {
    return lib->single ? (double)(float)value : value;
}

static inline void export_spoil(const export_library *lib) {
    for (size_t i = 0; i < lib->work_size; i++) {
        if (lib->single)
            ((float *)lib->work)[i] = NAN;
        else
            ((double *)lib->work)[i] = NAN;
    }
}

/* An array that a function of the exported code reads (`in`) or writes (`out`). A NULL pointer is passed as
 * NULL. */
typedef struct export_port {
    const double *in;
    double *out;
    size_t count;
} export_port;
#define EXPORT_IN(numbers, n)                                                                                \
    { .in = (numbers), .count = (n) }
#define EXPORT_OUT(numbers, n)                                                                               \
    { .out = (numbers), .count = (n) }

/* Calls NAME_<what> with 2 to 5 arrays and the work memory. The arrays are doubles for both exported types.
 * The work memory is filled with NaN before the call. */
static inline void export_call(const export_library *lib, const char *what, size_t n,
                               const export_port *ports) {
    void *p[5];
    assert_true(n >= 2 && n <= LG_COUNT(p));
    for (size_t i = 0; i < n; i++)
        p[i] = export_reals(lib, ports[i].in != NULL ? ports[i].in : ports[i].out, ports[i].count);
    EXPORT_FUNCTION(lib, what, void, (void *, void *, void *), of_two);
    EXPORT_FUNCTION(lib, what, void, (void *, void *, void *, void *), of_three);
    EXPORT_FUNCTION(lib, what, void, (void *, void *, void *, void *, void *), of_four);
    EXPORT_FUNCTION(lib, what, void, (void *, void *, void *, void *, void *, void *), of_five);
    export_spoil(lib);
    if (n == 2) of_two(p[0], p[1], lib->work);
    if (n == 3) of_three(p[0], p[1], p[2], lib->work);
    if (n == 4) of_four(p[0], p[1], p[2], p[3], lib->work);
    if (n == 5) of_five(p[0], p[1], p[2], p[3], p[4], lib->work);
    for (size_t i = 0; i < n; i++) export_doubles(lib, p[i], ports[i].out, ports[i].count);
    for (size_t i = 0; i < n; i++) free(p[i]);
}

static inline void export_eval(const export_library *lib, const double *x, double *y) {
    export_call(lib, "eval", 2, (export_port[]){EXPORT_IN(x, lib->inputs), EXPORT_OUT(y, lib->outputs)});
}

/* y may be NULL. */
static inline void export_grad(const export_library *lib, const double *x, double *y, double *jacobian) {
    export_call(lib, "grad", 3,
                (export_port[]){EXPORT_IN(x, lib->inputs), EXPORT_OUT(y, lib->outputs),
                                EXPORT_OUT(jacobian, lib->inputs * lib->outputs)});
}

/* ---- comparisons ---- */

static inline double export_norm(const double *a, const double *b, size_t size) {
    double sum = 0;
    for (size_t i = 0; i < size; i++) {
        const double d = a[i] - (b != NULL ? b[i] : 0);
        sum += d * d;
    }
    return sqrt(sum);
}

/* The largest of |got - want| / max(|want|, m) over all rows: Euclidean norms of rows of `size` numbers; m is
 * the root mean square of |want| over the rows. NaN if any of them is NaN. */
static inline double export_worst(const double *got, const double *want, size_t rows, size_t size) {
    double mean = 0, worst = 0;
    for (size_t r = 0; r < rows; r++) mean += pow(export_norm(want + r * size, NULL, size), 2);
    mean = sqrt(mean / (double)rows);
    for (size_t r = 0; r < rows; r++) {
        const double own = export_norm(want + r * size, NULL, size);
        const double scale = own > mean ? own : mean;
        const double error = export_norm(got + r * size, want + r * size, size) / (scale > 0 ? scale : 1);
        if (isnan(error)) return NAN;
        if (error > worst) worst = error;
    }
    return worst;
}

/* Computes the expected value and Jacobian at x, all in doubles. */
typedef void (*export_reference)(void *user, const double *x, double *y, double *jacobian);
typedef void (*export_draw)(void *user, lg_rng *rng, double *x); /* draws random inputs of the model */

/* One input that is not finite must make all results NaN, even results that do not depend on it. */
static inline void export_check_unfit(const export_library *lib, const double *finite) {
    const size_t n = lib->inputs, m = lib->outputs, stride = 1 + n / 8;
    double *x = TEST_ARRAY(double, n), *y = TEST_ARRAY(double, m), *matrix = TEST_ARRAY(double, n *m);
    memcpy(x, finite, n * sizeof *x);
    for (size_t i = 0; i < n; i += stride) {
        x[i] = i % 2 == 0 ? (double)NAN : (double)INFINITY;
        export_eval(lib, x, y);
        for (size_t o = 0; o < m; o++) assert_true(isnan(y[o]));
        memset(y, 0, m * sizeof *y);
        export_grad(lib, x, y, matrix);
        for (size_t o = 0; o < m; o++) assert_true(isnan(y[o]));
        for (size_t o = 0; o < n * m; o++) assert_true(isnan(matrix[o]));
        x[i] = finite[i];
    }
}

/* Compares `rows` random inputs: the value, and the gradient together with its value, must agree with the
 * reference to NAME_TOLERANCE. Prints the largest errors under `title`. */
static inline void export_compare(const export_library *lib, const char *title, size_t rows, export_draw draw,
                                  export_reference reference, void *user) {
    const size_t n = lib->inputs, m = lib->outputs, size = n * m;
    double *x = TEST_ARRAY(double, n), *y[3], *matrix[2];
    lg_rng rng = test_rng(20, 26);
    for (int i = 0; i < 3; i++) y[i] = calloc(rows * m, sizeof(double));
    for (int i = 0; i < 2; i++) matrix[i] = calloc(rows * size, sizeof(double));
    assert_true(x != NULL && y[0] != NULL && y[1] != NULL && y[2] != NULL && matrix[0] != NULL &&
                matrix[1] != NULL);
    for (size_t r = 0; r < rows; r++) {
        draw(user, &rng, x);
        for (size_t i = 0; i < n; i++) x[i] = export_rounded(lib, x[i]);
        reference(user, x, y[0] + r * m, matrix[0] + r * size);
        export_eval(lib, x, y[1] + r * m);
        export_grad(lib, x, y[2] + r * m, matrix[1] + r * size);
    }
    const double errors[] = {export_worst(y[1], y[0], rows, m), export_worst(y[2], y[0], rows, m),
                             export_worst(matrix[1], matrix[0], rows, size)};
    print_message("%s: value %.2e, beside the gradient %.2e, gradient %.2e; tolerance %.2e\n", title,
                  errors[0], errors[1], errors[2], lib->tolerance);
    for (int i = 0; i < 3; i++) assert_close(errors[i], 0, 0, lib->tolerance);
    export_check_unfit(lib, x);
    for (int i = 0; i < 3; i++) free(y[i]);
    for (int i = 0; i < 2; i++) free(matrix[i]);
}

/* ---- many compilers and flags ---- */

typedef struct export_way {
    const char *compiler, *flags;
} export_way;

/* Starts a command that builds the self-test in a new folder and runs it. */
static inline FILE *export_start_way(const char *folder, const char *name, const export_way *way,
                                     size_t index) {
    char command[EXPORT_LINE];
    (void)snprintf(command, sizeof command,
                   "cd %s && %s %s %s %s.c %s_weights.c %s_test.c -x none -lm -o test-%zu && ./test-%zu",
                   folder, way->compiler, strstr(way->compiler, "++") != NULL ? EXPORT_CPP : EXPORT_C,
                   way->flags, name, name, name, index, index);
    return export_start(command);
}

/* Compiles the three C files with each compiler that is installed, without warnings, and runs the
 * self-test. */
static inline void export_check_each(const char *folder, const char *name, const export_way *ways,
                                     size_t count) {
    static char out[EXPORT_TEXT];
    FILE *streams[2] = {NULL, NULL}; /* two builds run at a time */
    for (size_t i = 0; i < count + 2; i++) {
        FILE **stream = &streams[i % 2];
        if (*stream != NULL) {
            const export_way *way = &ways[i - 2];
            const int code = export_finish(*stream, out);
            *stream = NULL;
            if (code != 0 || strstr(out, " ok\n") == NULL || strstr(out, "WRONG") != NULL)
                fail_msg("%s, %s %s: exit code %d\n%s", folder, way->compiler, way->flags, code, out);
        }
        if (i < count && export_has(ways[i].compiler)) *stream = export_start_way(folder, name, &ways[i], i);
    }
}

/* A selection that takes a few seconds for a small model: the models of a suite get one half of the ways and
 * the other half in turn; the commit decides which half comes first. */
static inline void export_check_ways(const char *folder, const char *name) {
    static const export_way ways[][4] = {
        {{"gcc", "-O0"},
         {"gcc", "-O1 -g1 -fsanitize=address,undefined -fno-sanitize-recover=all"},
         {"clang", "-O2"},
         {"g++", "-O1"}},
        {{"gcc", "-O3 -march=native -ffp-contract=fast"},
         {"clang", "-O0"},
         {"clang", "-O3 -march=native -ffp-contract=fast"},
         {"clang++", "-O1"}},
    };
    static uint64_t turn;
    export_check_each(folder, name, ways[(turn++ + commit_seed()) % 2], LG_COUNT(ways[0]));
}

/* All compilers at all optimisation levels. */
static inline void export_check_all_ways(const char *folder, const char *name) {
    static const export_way ways[] = {
        {"gcc", "-O0"},     {"gcc", "-O1"},
        {"gcc", "-O2"},     {"gcc", "-O3"},
        {"gcc", "-Os"},     {"clang", "-O0"},
        {"clang", "-O1"},   {"clang", "-O2"},
        {"clang", "-O3"},   {"g++", "-O0"},
        {"g++", "-O2"},     {"g++", "-O3"},
        {"clang++", "-O0"}, {"clang++", "-O2"},
        {"clang++", "-O3"}, {"clang", "-O1 -g1 -fsanitize=address,undefined -fno-sanitize-recover=all"}};
    for (int half = 0; half < 2; half++) export_check_ways(folder, name);
    export_check_each(folder, name, ways, LG_COUNT(ways));
}

/* ---- objects ---- */

static inline bool export_may_call(const char *symbol) {
    static const char *const names[] = {"exp",  "expm1", "log",    "log1p",  "sin",    "pow",   "sinh",
                                        "cosh", "tanh",  "cos",    "sincos", "tan",    "atan2", "sqrt",
                                        "fabs", "floor", "memcpy", "memset", "memmove"};
    const size_t length = strlen(symbol);
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        const size_t n = strlen(names[i]);
        if (strncmp(symbol, names[i], n) == 0 &&
            (length == n || (length == n + 1 && symbol[n] == 'f' && strncmp(symbol, "mem", 3) != 0)))
            return true;
    }
    return false;
}

/* Checks the symbols that nm lists: the objects need only libm and what compilers insert, they have no
 * writable data, and all visible names begin with NAME_. */
static inline void export_check_objects_of(const char *folder, const char *name, const char *compiler,
                                           const char *flags) {
    static char out[EXPORT_TEXT];
    char command[EXPORT_LINE];
    size_t visible = 0;
    if (!export_has(compiler)) return;
    const char *prefix = test_text("%s_", name);
    (void)snprintf(command, sizeof command,
                   "cd %s && %s %s %s -fno-pic -c %s.c -o nm-code.o && %s %s %s -fno-pic -c %s_weights.c -o "
                   "nm-weights.o && nm -P nm-code.o nm-weights.o",
                   folder, compiler, EXPORT_C, flags, name, compiler, EXPORT_C, flags, name);
    if (export_shell(command, out) != 0) fail_msg("%s\n%s", command, out);
    for (char *save = NULL, *line = strtok_r(out, "\n", &save); line != NULL;
         line = strtok_r(NULL, "\n", &save)) {
        char symbol[256], type;
        if (sscanf(line, "%255s %c", symbol, &type) != 2 || symbol[strlen(symbol) - 1] == ':') continue;
        const bool own = strncmp(symbol, prefix, strlen(prefix)) == 0;
        if (strchr("DdBbCGgSsu", type) != NULL) fail_msg("%s: %s can be written (%c)", command, symbol, type);
        if (type == 'U' && !own && !export_may_call(symbol)) fail_msg("%s: refers to %s", command, symbol);
        if (isupper((unsigned char)type) && type != 'U' && !own)
            fail_msg("%s: %s is visible", command, symbol);
        if (own && type == 'T') visible++;
    }
    assert_true(visible > 0);
}

static inline void export_check_objects(const char *folder, const char *name) {
    export_check_objects_of(folder, name, "gcc", "-O2");
    export_check_objects_of(folder, name, "clang", "-O2");
}

/* The flags with which `make stack` is run: one long list where EVERY_WAY is defined. */
#ifdef EVERY_WAY
#define EXPORT_LEVELS "-O0", "-O1", "-O2", "-O3", "-Os"
#else
#define EXPORT_LEVELS "-O0", "-O2", "-O3"
#endif
#ifdef __x86_64__
#define EXPORT_PROCESSORS "", "-march=native", "-march=x86-64-v4", "-march=x86-64-v3"
#else
#define EXPORT_PROCESSORS "", "-march=native"
#endif

/* Runs `make stack` in the folder with both compilers and prints what each needs. Where EVERY_WAY is defined,
 * each level is combined with each set of instructions; else only -O3 is. The code is not run, so the machine
 * need not have the instructions. */
static inline void export_check_stack(const char *folder) {
    static const char *const compilers[] = {"gcc", "clang"}, *const levels[] = {EXPORT_LEVELS},
                             *const processors[] = {EXPORT_PROCESSORS};
    static char out[EXPORT_TEXT];
    for (size_t k = 0; k < LG_COUNT(compilers) * LG_COUNT(levels) * LG_COUNT(processors); k++) {
        const char *compiler = compilers[k / (LG_COUNT(levels) * LG_COUNT(processors))];
        const char *level = levels[k / LG_COUNT(processors) % LG_COUNT(levels)];
        const char *processor = processors[k % LG_COUNT(processors)];
        const bool plain = processor[0] == '\0', last = strcmp(level, "-O3") == 0;
        if (LG_COUNT(levels) == 3 && (last ? plain || strstr(processor, "v3") != NULL : !plain)) continue;
        if (!export_has(compiler)) continue;
        const char *command = test_text("make -C %s stack CC=%s CFLAGS='%s %s -ffp-contract=fast'", folder,
                                        compiler, level, processor);
        if (export_shell(command, out) != 0) fail_msg("%s\n%s", command, out);
        const char *line = strstr(out, "\nstack: ");
        assert_non_null(line);
        print_message("%s, %s %s %s: %.*s\n", folder, compiler, level, plain ? "(baseline)" : processor,
                      (int)strcspn(line + 8, "\n"), line + 8);
    }
}

#endif
