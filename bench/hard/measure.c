/* hard_cases CASES KNOWN [--all] [--print]: computes the rows of bench/hard/cases.txt and compares them with
 * their references. A row fails if its error is above what its conditioning allows. A row that known.txt
 * lists fails if its error is above the limit given there. --all includes slow rows. --print prints one line
 * per row, which bench/hard-cases reads. */
#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>

#include "hard.h"
#include "liegrad/core.h"
#include "liegrad/program.h"

enum { ROOM, FUNCTION, CASE, METRIC, HOW, ALLOWS, WHEN, INPUTS, REFERENCE, FIELDS };
enum { KNOWN_FUNCTION, KNOWN_CASE, KNOWN_LIMIT, KNOWN_SENTENCE, KNOWN_FIELDS };

/* Splits a line at its tabs. Returns false if it does not have `fields` fields. */
static bool cut(char *line, char **field, size_t fields) {
    line[strcspn(line, "\n")] = 0;
    for (size_t i = 0; i < fields; i++) {
        field[i] = line;
        line = line ? strchr(line, '\t') : NULL;
        if (line) *line++ = 0;
        if (!field[i]) return false;
    }
    return !line;
}

/* Reads the numbers of a field, into memory that the caller frees. */
static double *numbers(const char *text, size_t *count) {
    double *out = malloc((strlen(text) / 2 + 2) * sizeof(double));
    if (!out) exit(5);
    char *end;
    for (*count = 0;; text = end, ++*count) {
        out[*count] = strtod(text, &end);
        if (end == text) return out;
    }
}

static const hard_function *find(const char *name) {
    const hard_function *const tables[] = {hard_maths, hard_motion, hard_methods};
    for (size_t i = 0; i < sizeof(tables) / sizeof(*tables); i++)
        for (const hard_function *f = tables[i]; f->name; f++)
            if (strcmp(f->name, name) == 0) return f;
    return NULL;
}

/* ---- recorded functions ---- */

static lg_status on_tape(const hard_function *f, const double *in, size_t n, double *out, size_t m) {
    lg_tape_options options;
    lg_tape_options_init(&options);
    options.dtype = f->dtype;
    lg_tape *tape;
    if (lg_tape_create(NULL, &options, &tape) != LG_OK) exit(5);
    float *rounded = malloc((n + 1) * sizeof(float));
    if (!rounded) exit(5);
    for (size_t i = 0; i < n; i++) rounded[i] = (float)in[i];
    const void *data = f->dtype == LG_F32 ? (const void *)rounded : in;
    const lg_var x = lg_input(tape, lg_shape2(1, (uint32_t)n), data);
    lg_var y = f->record(tape, x);
    if (f->way == HARD_GRADIENT) lg_grad(tape, y, &x, 1, &y);
    const lg_status status = lg_read(tape, y, m, out);
    lg_tape_destroy(tape);
    free(rounded);
    return status;
}

static lg_status record(void *user, lg_tape *tape, const lg_var *parameters, const lg_var *in, lg_var *out) {
    (void)parameters;
    out[0] = ((const hard_function *)user)->record(tape, in[0]);
    return LG_OK;
}

/* Evaluates by a plan, at one row of n numbers or at n rows of one number. */
static lg_status in_plan(const hard_function *f, const double *in, size_t n, double *out) {
    const bool rows = f->way == HARD_ROWS;
    const lg_port x = {.name = "x", .shape = lg_shape1(rows ? 1 : (uint32_t)n)}, y = {.name = "y"};
    const lg_function_spec function = {"f", &x, 1, &y, 1, record, (void *)f};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.functions = &function, spec.function_count = 1;
    lg_program *program;
    lg_status status = lg_program_build(NULL, &spec, &program, NULL);
    if (status != LG_OK) return status;
    status = lg_program_eval(NULL, program, "f", rows ? n : 1, &in, &out, NULL);
    lg_program_destroy(program);
    return status;
}

static lg_status evaluate(const hard_function *f, const double *in, size_t n, double *out, size_t m) {
    if (f->measure) return f->measure(in, n, out, m);
    if (f->system) return hard_run(f, in, out, m);
    return f->way == HARD_PLAN || f->way == HARD_ROWS ? in_plan(f, in, n, out) : on_tape(f, in, n, out, m);
}

/* ---- errors ---- */

/* Metrics: "relative" is the largest difference over the largest reference; "each" is the largest of the
 * relative errors of the single numbers; "absolute" is the largest difference. Equal numbers, equal
 * infinities and NaN for NaN count as no error. */
static double error_of(const char *metric, const double *got, const double *want, size_t m) {
    double difference = 0, size = 0, each = 0;
    for (size_t i = 0; i < m; i++) {
        size = fmax(size, fabs(want[i]));
        if (got[i] == want[i] || (isnan(got[i]) && isnan(want[i]))) continue;
        const double d = fabs(got[i] - want[i]);
        if (isnan(d)) return INFINITY;
        difference = fmax(difference, d), each = fmax(each, d / fabs(want[i]));
    }
    if (strcmp(metric, "each") == 0) return each;
    return strcmp(metric, "absolute") == 0 || difference == 0 ? difference : difference / size;
}

/* Returns the error of a row. For the metric "told", where a failure is expected, it returns 0 if the
 * expected status came, else infinity. */
static double measure(char **field) {
    const hard_function *f = find(field[FUNCTION]);
    if (!f) {
        fprintf(stderr, "hard_cases: there is no function '%s'\n", field[FUNCTION]);
        exit(2);
    }
    size_t n, m;
    double *in = numbers(field[INPUTS], &n), *want = numbers(field[REFERENCE], &m);
    double *got = malloc((m + 1) * sizeof(double));
    if (!got) exit(5);
    for (size_t i = 0; i < m; i++) got[i] = NAN;
    const lg_status status = evaluate(f, in, n, got, m);
    double error = INFINITY;
    if (strcmp(field[METRIC], "told") == 0)
        error = strcmp(field[REFERENCE], lg_status_name(status)) == 0 ? 0 : INFINITY;
    else if (status == LG_OK)
        error = error_of(field[METRIC], got, want, m);
    else
        fprintf(stderr, "%s, %s: %s\n", field[FUNCTION], field[CASE], lg_status_sentence(status));
    free(in), free(want), free(got);
    return error;
}

/* ---- files ---- */

typedef struct known {
    char *line, *field[KNOWN_FIELDS];
} known;

static FILE *open_file(const char *path) {
    FILE *file = fopen(path, "r");
    if (file) return file;
    fprintf(stderr, "hard_cases: %s: %s\n", path, strerror(errno));
    exit(3);
}

static known *read_known(const char *path, size_t *count) {
    FILE *file = open_file(path);
    known *rows = NULL;
    *count = 0;
    for (;;) {
        rows = realloc(rows, (*count + 1) * sizeof(*rows));
        known *row = &rows[*count];
        size_t room = 0;
        row->line = NULL;
        if (getline(&row->line, &room, file) < 0) break;
        if (!cut(row->line, row->field, KNOWN_FIELDS)) exit(3);
        ++*count;
    }
    fclose(file);
    return rows;
}

int main(int argc, char **argv) {
    bool all = false, print = false;
    for (int i = 3; i < argc; i++) {
        all |= strcmp(argv[i], "--all") == 0;
        print |= strcmp(argv[i], "--print") == 0;
    }
    if (argc < 3) return 2;
    lg_runtime_setup();
    size_t known_count, room = 0, rows = 0, failed = 0;
    known *worse = read_known(argv[2], &known_count);
    FILE *file = open_file(argv[1]);
    char *line = NULL, *field[FIELDS];
    while (getline(&line, &room, file) >= 0) {
        if (!cut(line, field, FIELDS)) return 3;
        if (!all && strcmp(field[WHEN], "slow") == 0) continue;
        const double error = measure(field);
        double limit = strtod(field[ALLOWS], NULL);
        for (size_t i = 0; i < known_count; i++)
            if (strcmp(worse[i].field[KNOWN_FUNCTION], field[FUNCTION]) == 0 &&
                strcmp(worse[i].field[KNOWN_CASE], field[CASE]) == 0)
                limit = strtod(worse[i].field[KNOWN_LIMIT], NULL);
        rows++;
        if (print) printf("%s\t%s\t%.17g\n", field[FUNCTION], field[CASE], error);
        if (error <= limit) continue;
        failed++;
        fprintf(stderr, "%s, %s: error %.2g (%s), at most %.2g is known or allowed\n", field[FUNCTION],
                field[CASE], error, field[METRIC], limit);
    }
    fprintf(stderr, "%zu rows, %zu fail\n", rows, failed);
    for (size_t i = 0; i <= known_count; i++) free(worse[i].line);
    free(worse), free(line), fclose(file);
    return failed ? 1 : 0;
}
