/* Programs as C: the library writes the code; the golden vectors of every function are drawn here. */
#include "core/numbers.h"
#include "lg-export/export.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { GOLDEN_STREAM = 11, CONDITION_POINTS = 64 };

/* Most operations that one run of a plan may take. All points of a self-test together then take seconds. */
static const double SELF_TEST_WORK = 3e8;

typedef struct job {
    const app *self;
    export_source *source;
    lg_program *program;
    lg_c_source *c;
    double condition; /* Condition of the function that is being written. */
} job;

/* ---- random inputs ---- */

size_t export_draw_port(const lg_port *port, lg_rng *rng, double *x) {
    const bool open = port->low == 0 && port->high == 0;
    const size_t count = lg_shape_count(port->shape);
    for (size_t i = 0; i < count; i++)
        x[i] = lg_rng_uniform_in(rng, open ? -1 : port->low, open ? 1 : port->high);
    return count;
}

static size_t draw(const job *j, const lg_port *port, lg_rng *rng, double *x) {
    const size_t count = export_draw_port(port, rng, x);
    for (size_t i = 0; i < count; i++) x[i] = export_round(j->source->options, x[i]);
    return count;
}

/* ---- results of the library ---- */

lg_status export_evaluation_open(const lg_program *program, const char *function, lg_dtype dtype, double most,
                                 export_evaluation *e, lg_error *error) {
    lg_plan_options options;
    size_t at;
    LG_TRY(lg_program_find(program, function, &at, error));
    lg_plan_options_init(&options);
    options.dtype = dtype;
    if (most > 0) options.most_work = most;
    *e = (export_evaluation){.dtype = dtype};
    e->in = lg_program_inputs(program, at, &e->ins);
    e->out = lg_program_outputs(program, at, &e->outs);
    const lg_status status = lg_plan_create(program, at, &options, &e->plan, error);
    if (status == LG_OK) e->work = app_alloc(lg_plan_work_size(e->plan), 1);
    return status;
}

void export_evaluation_close(export_evaluation *e) {
    lg_plan_destroy(e->plan);
    free(e->work);
}

void export_evaluate(const export_evaluation *e, const double *x, double *y) {
    const size_t size = e->dtype == LG_F32 ? sizeof(float) : sizeof(double);
    const size_t ins = export_numbers(e->in, e->ins), outs = export_numbers(e->out, e->outs);
    APP_FREE const void **in = app_alloc(e->ins, sizeof *in);
    APP_FREE void **out = app_alloc(e->outs, sizeof *out);
    APP_FREE unsigned char *from = app_alloc(ins, size), *to = app_alloc(outs, size);
    lg_put_numbers(e->dtype, from, 0, x, ins);
    for (size_t i = 0, at = 0; i < e->ins; at += lg_shape_count(e->in[i++].shape)) in[i] = from + at * size;
    for (size_t i = 0, at = 0; i < e->outs; at += lg_shape_count(e->out[i++].shape)) out[i] = to + at * size;
    lg_plan_eval(e->plan, in, out, e->work);
    lg_get_numbers(e->dtype, to, 0, y, outs);
}

/* ---- condition ---- */

/* Returns the largest error of single precision at the given points, in units of (eps of single precision
 * times depth). Each output's error is relative to the larger of its norm and the root mean square of its
 * norm over the points. */
static double amplification(const export_evaluation *wide, const export_evaluation *narrow, const double *x,
                            size_t points, size_t depth) {
    const size_t ins = export_numbers(wide->in, wide->ins), outs = export_numbers(wide->out, wide->outs);
    APP_FREE double *y = app_alloc(points * outs, sizeof *y), *z = app_alloc(points * outs, sizeof *z);
    double worst = 0;
    for (size_t p = 0; p < points; p++) {
        export_evaluate(wide, x + p * ins, y + p * outs);
        export_evaluate(narrow, x + p * ins, z + p * outs);
    }
    for (size_t o = 0, at = 0; o < wide->outs; at += lg_shape_count(wide->out[o++].shape)) {
        const size_t count = lg_shape_count(wide->out[o].shape);
        double mean = 0;
        for (size_t p = 0; p < points; p++)
            mean += pow(export_norm(y + p * outs + at, NULL, count), 2) / (double)points;
        for (size_t p = 0; p < points; p++) {
            const double *want = y + p * outs + at;
            const double scale = fmax(export_norm(want, NULL, count), sqrt(mean));
            const double error = export_norm(z + p * outs + at, want, count) / (scale > 0 ? scale : 1);
            if (!isnan(worst) && !(error <= worst)) worst = error; /* A NaN stays. */
        }
    }
    return worst / ((double)FLT_EPSILON * (double)(depth > 0 ? depth : 1));
}

lg_status export_amplification(const lg_program *program, const char *function, const double *x,
                               size_t points, size_t depth, double *out, lg_error *error) {
    export_evaluation wide, narrow;
    LG_TRY(export_evaluation_open(program, function, LG_F64, SELF_TEST_WORK, &wide, error));
    const lg_status status =
        export_evaluation_open(program, function, LG_F32, SELF_TEST_WORK, &narrow, error);
    if (status == LG_OK) {
        *out = amplification(&wide, &narrow, x, points, depth);
        export_evaluation_close(&narrow);
    }
    export_evaluation_close(&wide);
    return status;
}

/* The run of a function with a memory, or NULL. */
static const export_memory *run_of(const job *j, const char *function) {
    const export_source *source = j->source;
    for (size_t i = 0; i < source->runs; i++)
        if (strcmp(source->run[i].function, function) == 0) return &source->run[i];
    return NULL;
}

/* Inputs and outputs at `points` points along a run. */
static void follow(const job *j, const export_evaluation *e, const export_memory *run, size_t points,
                   double *x, double *y) {
    const size_t ins = export_numbers(e->in, e->ins), outs = export_numbers(e->out, e->outs),
                 given = ins - run->numbers;
    APP_FREE double *row = app_alloc(ins, sizeof *row), *next = app_alloc(outs, sizeof *next);
    memcpy(row + given, run->start, run->numbers * sizeof *row);
    for (size_t k = 0, p = 0; k < run->rows; k++) {
        memcpy(row, run->inputs + k * given, given * sizeof *row);
        export_evaluate(e, row, next);
        for (; p < points && p * run->rows / points == k; p++) {
            memcpy(x + p * ins, row, ins * sizeof *x);
            memcpy(y + p * outs, next, outs * sizeof *y);
        }
        for (size_t i = 0; i < run->numbers; i++) row[given + i] = export_round(j->source->options, next[i]);
    }
}

/* Inputs and outputs at points that are drawn, or that lie on the function's run. */
static void fill_points(const job *j, const export_evaluation *e, const char *function, uint64_t stream,
                        size_t points, double *x, double *y) {
    const export_memory *run = run_of(j, function);
    const size_t outs = export_numbers(e->out, e->outs);
    lg_rng rng;
    lg_rng_seed(&rng, j->source->options->seed, stream);
    for (size_t p = 0; p < points && run == NULL; p++) {
        double *at = x;
        for (size_t i = 0; i < e->ins; i++) x += draw(j, &e->in[i], &rng, x);
        export_evaluate(e, at, y + p * outs);
    }
    if (run != NULL) follow(j, e, run, points, x, y);
}

/* Measures the condition of the function; at least 1, rounded up to a whole number. */
static void find_condition(job *j, const export_evaluation *e, const char *function, size_t depth) {
    double found = 1;
    lg_error error = {LG_OK, ""};
    const size_t numbers = CONDITION_POINTS * export_numbers(e->in, e->ins);
    APP_FREE double *x = app_alloc(numbers, sizeof *x),
                    *y = app_alloc(CONDITION_POINTS * export_numbers(e->out, e->outs), sizeof *y);
    fill_points(j, e, function, GOLDEN_STREAM + 1, CONDITION_POINTS, x, y);
    for (size_t i = 0; i < numbers; i++) x[i] = (double)(float)x[i];
    lg_status status = export_amplification(j->program, function, x, CONDITION_POINTS, depth, &found, &error);
    j->condition = isfinite(found) && found > 1 ? ceil(found) : 1;
    if (status == LG_OK && !isfinite(found) && j->source->options->dtype == LG_F32)
        status = lg_fail(&error, LG_NOT_FINITE,
                         "%s: function '%s' gives numbers that are not finite in single precision, at random "
                         "points of its inputs: export it with --dtype f64",
                         j->source->options->file, function);
    app_must_file(j->self, status, &error, j->source->options->file);
}

/* ---- the self-test ---- */

static void add_golden(job *j, const char *name, const char *what, const double *values, size_t count) {
    text *to = &j->source->test;
    APP_FREE char *array = app_format("%s_%s", name, what);
    export_reals(j->source, to, array, values, count);
    if (!isfinite(export_squares(j->source->options, values, count))) to->unfit = true;
}

/* Writes run_<function> for the self-test: it calls the function with one vector for all inputs and one for
 * all outputs; a memory is copied to the first output. */
static void add_run(job *j, const export_evaluation *e, const char *name) {
    text *to = &j->source->test;
    const bool keeps = run_of(j, name) != NULL;
    lg_text_add(to, "static void run_%s(const real *x, real *y, int only, real *work) {\n    ", name);
    if (keeps)
        lg_text_add(
            to, "static real other[%zu];\n    (void)only;\n    memcpy(y, x + %zu, %zu * sizeof *y);\n    ",
            export_numbers(e->out, 1), export_numbers(e->in, e->ins - 1), export_numbers(e->out, 1));
    lg_text_add(to, "%s_%s%s(", j->source->options->name, j->source->prefix, name);
    for (size_t i = 0, at = 0; i < e->ins - keeps; at += lg_shape_count(e->in[i++].shape))
        lg_text_add(to, "x + %zu, ", at);
    for (size_t o = 0, at = 0; o < e->outs; at += lg_shape_count(e->out[o++].shape))
        if (keeps)
            lg_text_add(to, "y, other, ");
        else
            lg_text_add(to, "\n        only < 0 || only == %zu ? y + %zu : NULL, ", o, at);
    lg_text_add(to, "work);\n}\n");
}

static void add_outputs(job *j, const export_evaluation *e, const char *name) {
    text *to = &j->source->test;
    lg_text_add(to, "static const result outputs_of_%s[] = {\n", name);
    for (size_t o = 0, at = 0; o < e->outs; at += lg_shape_count(e->out[o++].shape))
        lg_text_add(to, "    {\"%s\", %zu, %zu, %zu},\n", e->out[o].name, o, at,
                    lg_shape_count(e->out[o].shape));
    lg_text_add(to, "    {NULL, 0, 0, 0}};\n");
}

/* Writes the golden vectors of one function, and adds its row to the table of functions. */
static void add_function(job *j, size_t index, text *table, size_t *largest) {
    const size_t depth = j->c->depth[index] > 0 ? j->c->depth[index] : 1;
    const export_options *options = j->source->options;
    const char *name = lg_program_function_name(j->program, j->c->function[index]);
    export_evaluation e;
    EXPORT_MUST(j, export_evaluation_open(j->program, name, LG_F64, SELF_TEST_WORK, &e, &error));
    find_condition(j, &e, name, depth);
    const size_t ins = export_numbers(e.in, e.ins), outs = export_numbers(e.out, e.outs),
                 golden = (size_t)options->golden;
    APP_FREE double *x = app_alloc(golden * ins, sizeof *x), *y = app_alloc(golden * outs, sizeof *y);
    fill_points(j, &e, name, GOLDEN_STREAM, golden, x, y);
    lg_text_add(&j->source->test, "\n");
    add_golden(j, name, "golden_x", x, golden * ins);
    add_golden(j, name, "golden_y", y, golden * outs);
    add_run(j, &e, name);
    add_outputs(j, &e, name);
    const double unit = 20 * export_eps(options) * (double)depth,
                 condition = export_bound_tolerance(j->source, unit * j->condition) / unit;
    lg_text_add(
        table,
        "    {\"%s\", run_%s, %s_golden_x, %s_golden_y, %zu, %zu, 20 * EPSILON * %zu * %g, outputs_of_%s},\n",
        name, name, name, name, ins, outs, depth, condition, name);
    if (outs > *largest) *largest = outs;
    if (j->condition > j->source->condition) j->source->condition = j->condition;
    export_evaluation_close(&e);
}

static void add_test(job *j) {
    text table = app_text(), *to = &j->source->test;
    const export_source *source = j->source;
    size_t largest = source->further_size;
    export_test_begin(source, (size_t)source->options->golden, to);
    for (size_t i = 0; i < j->c->functions; i++) add_function(j, i, &table, &largest);
    lg_text_add(to, "%s", source->further_test.data != NULL ? source->further_test.data : "");
    lg_text_add(&table, "%s", source->further_row.data != NULL ? source->further_row.data : "");
    export_test_end(source, &table, largest, to);
    lg_text_destroy(&table);
}

/* ---- lines about the program ---- */

static void add_about(const job *j) {
    text *to = &j->source->about;
    const char *description = lg_program_description(j->program);
    if (!j->source->maps)
        lg_text_add(to, "program       %s\n", description[0] != '\0' ? description : "a bundle of functions");
    lg_text_add(
        to,
        "condition     of a function: by how much it multiplies rounding; %g is the largest, measured "
        "in single precision\n",
        j->source->condition);
}

void export_file_provenance(const app *self, export_source *source, const char *path) {
    lg_file_reader *reader = NULL;
    lg_provenance provenance;
    if (source->scene) return; /* a text file has no provenance */
    APP_FILE(self, path, lg_file_reader_create, NULL, NULL, &reader);
    lg_file_reader_provenance(reader, &provenance);
    export_provenance(source, &provenance, NULL);
    lg_file_reader_destroy(reader);
}

/* ---- the code ---- */

/* Writes the named functions; NULL: all but those that training alone needs. */
static void write_code(job *j, const export_names *named) {
    const size_t all = lg_program_functions(j->program);
    APP_FREE export_function *functions = app_alloc(all, sizeof *functions);
    size_t count = 0;
    for (size_t i = 0; i < (named != NULL ? named->count : all); i++)
        if (named != NULL || !export_trains_only(j->program, i))
            functions[count++].function =
                named != NULL ? named->name[i] : lg_program_function_name(j->program, i);
    for (export_function *f = functions; f < functions + count; f++) {
        f->hidden = run_of(j, f->function) != NULL;
        f->name = app_format("%s%s%s", j->source->prefix, f->function, f->hidden ? "_next" : "");
    }
    EXPORT_MUST(
        j, export_c(j->source, j->program, functions, count, j->source->options->compact, 0, &j->c, &error));
    for (size_t i = 0; i < count; i++) free((char *)(uintptr_t)functions[i].name);
}

/* Adds the sizes. The last line, about NAME_WORK_SIZE, is written anew if functions with a memory need
 * more. */
static void add_sizes(job *j) {
    export_source *source = j->source;
    size_t more = 0;
    for (size_t i = 0; i < j->c->functions; i++) {
        const export_memory *run = run_of(j, lg_program_function_name(j->program, j->c->function[i]));
        if (run != NULL && j->c->work[i] + run->work > more) more = j->c->work[i] + run->work;
    }
    const char *last = strrchr(j->c->sizes, '#');
    if (last == NULL || more <= source->work) {
        lg_text_add(&source->sizes, "%s", j->c->sizes);
        return;
    }
    source->work = more;
    lg_text_append(&source->sizes, j->c->sizes, (size_t)(last - j->c->sizes));
    lg_text_add(&source->sizes, "#define %s_WORK_SIZE %zu /* enough for all of them */\n",
                source->options->name, more);
}

void export_whole(const app *self, const char *path, lg_program *program, const export_names *functions,
                  export_source *source) {
    job j = {.self = self, .source = source, .program = program};
    if (source->prefix == NULL) source->prefix = "";
    source->parameters = export_parameters(program);
    EXPORT_MUST(&j, export_round_parameters(source, program));
    write_code(&j, functions);
    source->bundle = true;
    source->functions = j.c->functions;
    source->depth = 1;
    for (size_t i = 0; i < j.c->functions; i++)
        source->depth = j.c->depth[i] > source->depth ? j.c->depth[i] : source->depth;
    add_sizes(&j);
    if (source->further_code.length > 0) lg_text_add(&source->code, "\n%s", source->further_code.data);
    add_test(&j);
    add_about(&j);
    export_file_provenance(self, source, path);
    lg_c_source_destroy(j.c);
}

void export_program(const app *self, const char *path, export_source *source) {
    lg_program *program;
    export_names functions;
    const bool given = source->options->functions != NULL;
    if (source->scene)
        export_load_scene(self, path, true, source, &program);
    else
        APP_FILE(self, path, lg_program_load, NULL, &program);
    if (given) export_choose(self, source->options, program, NULL, &functions);
    export_whole(self, path, program, given ? &functions : NULL, source);
    lg_program_destroy(program);
}
