/* Files of every kind that liegrad 1 wrote (format_1/README.md) must load, evaluate and export as
 * format_1/expected.txt says. */
#include "cli_support.h"
#include "liegrad/files.h"
#include "liegrad/model.h"
#include "liegrad/program.h"

enum { NUMBERS = 1 << 14, SOURCE = 1 << 20 };

typedef struct old_file {
    const char *name;
    enum { MODEL, PROGRAM, CLASSIFIER } what;
    bool series; /* evaluated on windows */
} old_file;

static const old_file files[] = {
    {"chain", MODEL, false},      {"separable", MODEL, false},       {"discrete", MODEL, false},
    {"continuous", MODEL, false}, {"angle", MODEL, false},           {"detector", MODEL, true},
    {"table", MODEL, false},      {"table-classes", MODEL, false},   {"machine", MODEL, false},
    {"program", PROGRAM, false},  {"program-calls", PROGRAM, false}, {"classifier", CLASSIFIER, true},
};

static const char *path_of(const old_file *file) {
    static char path[512];
    (void)snprintf(path, sizeof path, "%s/format_1/%s.h5", LG_TEST_DIR, file->name);
    return path;
}

/* The results, line by line. With LG_FORMAT_1_OUT=FILE they are written to FILE instead of being compared. */
static char found[1 << 20];
static size_t used;

static void note(const char *format, ...) {
    va_list list;
    va_start(list, format);
    used += (size_t)vsnprintf(found + used, sizeof found - used, format, list);
    va_end(list);
    assert_true(used < sizeof found);
}

static void note_numbers(const double *x, size_t count) {
    for (size_t i = 0; i < count; i++) note(" %a", x[i]);
}

/* ---- evaluation ---- */

static void fill(double *x, size_t count) {
    for (size_t i = 0; i < count; i++) x[i] = 0.25 + 0.5 * (double)(i % 3) + 0.01 * (double)(i % 7);
}

static void evaluate_model(const old_file *file) {
    lg_model_file model;
    assert_told(lg_model_load(NULL, path_of(file), NULL, &model, &told));
    const size_t inputs = lg_model_inputs(model.model), outputs = lg_model_outputs(model.model);
    double *x = TEST_ARRAY(double, inputs), *y = TEST_ARRAY(double, outputs);
    fill(x, inputs);
    lg_model_eval(model.model, x, y, lg_test_memory(lg_model_work_size(model.model)));
    note("%s value", file->name);
    note_numbers(y, outputs);
    note("\n");
    lg_model_file_destroy(&model);
}

static void evaluate_program(const char *title, const char *path) {
    enum { ROWS = 2, PORTS = 8 };
    lg_program *program;
    lg_error error = {LG_OK, ""};
    assert_told(lg_program_load(NULL, path, NULL, &program, &told));
    for (size_t f = 0; f < lg_program_functions(program); f++) {
        const char *name = lg_program_function_name(program, f);
        double *x[PORTS], *y[PORTS];
        size_t inputs, outputs, count[PORTS];
        const lg_port *in = lg_program_inputs(program, f, &inputs);
        const lg_port *out = lg_program_outputs(program, f, &outputs);
        for (size_t i = 0; i < inputs; i++) {
            const size_t n = lg_shape_count(lg_port_shape(&in[i], ROWS));
            fill(x[i] = TEST_ARRAY(double, n), n);
        }
        for (size_t j = 0; j < outputs; j++)
            y[j] = TEST_ARRAY(double, count[j] = lg_shape_count(lg_port_shape(&out[j], ROWS)));
        assert_ok(lg_program_eval(NULL, program, name, ROWS, (const double *const *)x, y, &error));
        note("%s %s", title, name);
        for (size_t j = 0; j < outputs; j++) note_numbers(y[j], count[j]);
        note("\n");
    }
    lg_program_destroy(program);
}

static void judge_windows(const old_file *file) {
    cli_json("lg-anomaly",
             test_text("evaluate %s %s/format_1/series.h5 --part=all", path_of(file), LG_TEST_DIR), "");
    note("%s windows %a %a\n", file->name, json_number(result.out, "accuracy"),
         json_number(result.out, "mse"));
}

/* ---- export ---- */

/* Hashes a source without its comments, because a comment names the version of liegrad. */
static void add_source(lg_sha256 *hash, const char *name) {
    static char text[SOURCE];
    (void)cli_read(name, text, sizeof text);
    for (const char *from = text, *end; from != NULL; from = end != NULL ? strstr(end, "*/") : NULL) {
        if (from != text) from += 2;
        end = strstr(from, "/*");
        lg_sha256_add(hash, from, end != NULL ? (size_t)(end - from) : strlen(from));
    }
}

static void export_sources(const old_file *file) {
    static const char *const endings[] = {".h", ".c", "_weights.c"};
    char text[LG_SHA256_TEXT];
    lg_sha256 hash;
    lg_sha256_init(&hash);
    cli_expect("lg-export", test_text("%s --name=old --out=.", path_of(file)), 0, "");
    for (size_t i = 0; i < 3; i++) {
        add_source(&hash, test_text("old%s", endings[i]));
    }
    lg_sha256_finish(&hash, text);
    note("%s code %s\n", file->name, text);
}

/* ---- comparison with the expected results ---- */

/* Operations are recorded in the order in which the compiler evaluates arguments. clang uses another order,
 * so its exported code has the same operations in another order and is not compared. */
#if defined(__clang__)
static const bool same_order = false;
#else
static const bool same_order = true;
#endif

/* Words must be equal; numbers may differ by the rounding of another mathematics library. */
static void compare_line(const char *got, const char *expected) {
    if (!same_order && strstr(expected, " code ") != NULL) return;
    char a[64], b[64], *end;
    int skip_a, skip_b;
    for (size_t word = 0; sscanf(expected, "%63s%n", b, &skip_b) == 1; word++) {
        if (sscanf(got, "%63s%n", a, &skip_a) != 1) fail_msg("nothing for %s", expected);
        const double wanted = strtod(b, &end);
        if (word > 1 && *end == '\0' && strlen(b) < LG_SHA256_TEXT - 1)
            assert_close(strtod(a, NULL), wanted, 1e-14, 1e-15);
        else if (strncmp(a, b, 63) != 0)
            fail_msg("%.100s: expected %.100s", got, expected);
        got += skip_a;
        expected += skip_b;
    }
}

/* Both texts must have the same lines in the same order. */
static void compare(char *expected) {
    char *rest = NULL, *others = NULL;
    char *got = strtok_r(found, "\n", &rest), *line = strtok_r(expected, "\n", &others);
    for (; got != NULL && line != NULL; got = strtok_r(NULL, "\n", &rest)) {
        compare_line(got, line);
        line = strtok_r(NULL, "\n", &others);
    }
    assert_true(got == NULL && line == NULL);
}

static int begin(void **state) {
    (void)state;
    /* the expected numbers were computed by the simplest kernels */
    return setenv("LIEGRAD_ISA", "baseline", 1);
}

TEST_GROUP(begin, NULL)

TEST("files of liegrad 1 load, evaluate and export as they did") {
    static char expected[sizeof found];
    for (const old_file *file = files; file < files + LG_COUNT(files); file++) {
        const size_t mark = lg_test_owned();
        cli_test_folder();
        if (file->what == MODEL) evaluate_model(file);
        if (file->what == PROGRAM) evaluate_program(file->name, path_of(file));
        if (file->series) judge_windows(file);
        export_sources(file);
        lg_test_give_back(mark);
    }
    const char *path = getenv("LG_FORMAT_1_OUT");
    FILE *file = path != NULL ? fopen(path, "w") : fopen(LG_TEST_DIR "/format_1/expected.txt", "r");
    assert_non_null(file);
    if (path != NULL)
        assert_true(fputs(found, file) >= 0);
    else
        expected[fread(expected, 1, sizeof expected - 1, file)] = '\0';
    assert_int_equal(fclose(file), 0);
    if (path == NULL) compare(expected);
}

TEST("programs of format 1 have the same bits after they are saved again") {
    static char before[sizeof found];
    cli_test_folder();
    const char *path = cli_at("again.h5");
    for (const old_file *file = files; file < files + LG_COUNT(files); file++) {
        lg_program *loaded;
        if (file->what != PROGRAM) continue;
        used = 0;
        evaluate_program(file->name, path_of(file));
        memcpy(before, found, used + 1);
        assert_ok(lg_program_load(NULL, path_of(file), NULL, &loaded, NULL));
        assert_ok(lg_program_save(NULL, path, loaded, NULL, NULL));
        lg_program_destroy(loaded);
        used = 0;
        evaluate_program(file->name, path);
        assert_string_equal(found, before);
    }
}
