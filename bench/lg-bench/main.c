/* lg-bench: measures the speed and the error of computations, and reports the machine they ran on. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-bench/bench.h"

static bench_options given = {.dtype = 0};

static const bench_case cases[] = {
    {"mlp2",
     "d/dtheta sum |grad_x V|^2 of V: 3-W-W-W-1, tanh",
     LG_F64,
     {1, 50, 500, 1500},
     100,
     0,
     bench_mlp2},
    {"mlp2-small",
     "the same of V: 3-W-W-1, which is cached whole",
     LG_F64,
     {1, 50, 500, 1500},
     20,
     0,
     bench_mlp2_small},
    {"mlp2-parts",
     "the 12 products B x W x W of mlp2 and its activations, alone",
     LG_F64,
     {1, 50, 500, 1500},
     100,
     0,
     bench_mlp2_parts},
    {"jvp", "d/dtheta sum |dq/ds|^2 of q: 1-W-W-W-2, tanh", LG_F64, {50, 500}, 100, 0, bench_jvp},
    {"hamiltonian",
     "an epoch of the single pendulum: CF4, N=500, M=5",
     LG_F64,
     {80},
     0,
     20,
     bench_hamiltonian},
    {"hamiltonian-small", "the same with a network 3-20-20-1", LG_F64, {80}, 0, 20, bench_hamiltonian},
    {"hamiltonian-double",
     "an epoch of the double pendulum: CF4, N=500, M=5",
     LG_F64,
     {80},
     0,
     20,
     bench_hamiltonian},
    {"hamiltonian-quartic",
     "an epoch of the quartic potential: Stormer-Verlet, N=900, M=6",
     LG_F64,
     {50},
     0,
     20,
     bench_hamiltonian},
    {"elastica-discrete",
     "an epoch of the discrete surrogate: 8-5x879-196, 900 curves",
     LG_F32,
     {32},
     0,
     6,
     bench_elastica},
    {"elastica-continuous",
     "an epoch of the continuous surrogate: 5 x 190, derivative in the loss, 45900 points",
     LG_F32,
     {1024},
     0,
     6,
     bench_elastica},
    {"elastica-angle",
     "an epoch of the angle surrogate: 7 x 143, 900 curves of 51 nodes and 150 Gauss points",
     LG_F32,
     {20},
     0,
     6,
     bench_elastica},
    {"dense", "a training step of 8-5xW-196: forward, backward, Adam", LG_F32, {32}, 879, 0, bench_dense},
    {"adam", "Adam's step on W parameters", LG_F32, {0}, 2500000, 0, bench_adam},
    {"scalar",
     "planar double pendulum, RK4, 100 steps, gradient in the start, as a custom operation",
     LG_F64,
     {0},
     0,
     0,
     bench_scalar},
    {"scalar-ops", "the same with plain operations on the tape", LG_F64, {0}, 0, 0, bench_scalar_ops},
    {"peak", "multiply-adds on registers alone: the peak of a core", LG_F64, {0}, 0, 0, bench_peak},
    {"gemm",
     "dense products of one thread: own kernels, OpenBLAS, the tape's operation",
     LG_F64,
     {0},
     0,
     0,
     bench_gemm},
    {"act", "elementwise functions on W elements, error in ULP", LG_F64, {0}, 4096, 0, bench_act},
    {"node",
     "recording and differentiating a chain of W scalar additions",
     LG_F64,
     {0},
     10000,
     0,
     bench_node},
    {"batch1",
     "value and gradient of a learned Hamiltonian (net of width W) at one state",
     LG_F64,
     {0},
     100,
     0,
     bench_batch1},
    {"elastica-solve",
     "a curve by Newton's method, cold and from a neighbour, on W intervals: time and error",
     LG_F64,
     {0},
     0,
     0,
     bench_elastica_solve},
    {"elastica-curve",
     "the same curve by the network of --weights MODEL.h5",
     LG_F32,
     {0},
     0,
     0,
     bench_elastica_curve},
    {"cnn",
     "an epoch of the detector: 6-12-24-48 channels of 300 samples, 4944 windows",
     LG_F32,
     {30},
     0,
     6,
     bench_cnn},
    {"cnn-parts",
     "the parts of that network's blocks, on the windows of a shard",
     LG_F32,
     {8},
     0,
     0,
     bench_cnn_parts},
    {"cnn-window", "the detector's value for one window", LG_F32, {1}, 0, 0, bench_cnn_window},
    {"ode", "RKMK(5,4) on pendulum chains: time against error, cost of a step", LG_F64, {0}, 0, 0, bench_ode},
};

static const char *const dtypes[] = {"default", "f64", "f32", NULL};

static const lg_field options[] = {
    LG_OPTION(bench_options, batch, U64, "B", "Rows of a batch (default: the case's list)", .low = 1,
              .high = 1e6),
    LG_OPTION(bench_options, width, U64, "W", "Width of the hidden layers, or length", .low = 1, .high = 1e8),
    LG_OPTION(bench_options, dtype, NAME, NULL, "f64 or f32 (default: the case's)", .names = dtypes),
    LG_OPTION(bench_options, links, U64, "N", "ode: links of the chain (default: 2, 6, 10 and 20)", .low = 1,
              .high = 1e4),
    LG_OPTION(bench_options, repeats, U64, "r", "Timed samples (default 101, fewer when they take long)",
              .low = 1, .high = 1e6),
    LG_OPTION(bench_options, epochs, U64, "k",
              "Epochs of the hamiltonian, elastica and cnn cases (default 20; 6; 6)", .low = 2, .high = 1e6),
    LG_OPTION(bench_options, judge, SWITCH, NULL, "hamiltonian: also E1 of the trained model on a test set"),
    LG_OPTION(bench_options, tape, SWITCH, NULL, "mlp2, jvp: gradients by the tape instead of by plans"),
    LG_OPTION(bench_options, weights, STRING, "FILE",
              "hamiltonian: no training; judges these parameters (doubles, as --out writes them); "
              "elastica-curve: the model file"),
    LG_OPTION(bench_options, out, STRING, "PREFIX",
              "hamiltonian, elastica: writes the training set and the initial parameters as doubles, for "
              "other programs: PREFIX.data, PREFIX.weights; elastica: PREFIX.data, PREFIX.order, and a "
              "file named by each row"),
    LG_OPTION(bench_options, only, STRING, "TEXT", "Only rows whose name contains TEXT"),
    LG_FIELD_END};

/* ---- listing cases ---- */

static void list(app *self) {
    app_json *out = self->out;
    app_json_open(out, "cases", '[');
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        double batches[LG_COUNT(cases[i].batches)];
        size_t n = 0;
        for (; n < LG_COUNT(batches) && cases[i].batches[n] > 0; n++)
            batches[n] = (double)cases[i].batches[n];
        app_result_line(out, "%-20s %s", cases[i].name, cases[i].summary);
        app_json_open(out, NULL, '{');
        app_json_text(out, "case", cases[i].name);
        app_json_text(out, "what", cases[i].summary);
        app_json_text(out, "dtype", cases[i].dtype == LG_F64 ? "f64" : "f32");
        app_json_reals(out, "batches", batches, n);
        app_json_size(out, "width", cases[i].width);
        app_json_close(out, '}');
    }
    app_json_close(out, ']');
}

/* ---- reports ---- */

/* The processor's name ("AMD EPYC ..."), or "unknown" if the system does not tell it. */
static void processor_name(char *name, size_t size) {
    char line[512];
    (void)snprintf(name, size, "unknown");
    FILE *file = fopen("/proc/cpuinfo", "r");
    while (file != NULL && fgets(line, sizeof line, file) != NULL) {
        if (strncmp(line, "model name", 10) != 0) continue;
        const char *value = strchr(line, ':');
        if (value == NULL) break;
        line[strcspn(line, "\n")] = '\0';
        (void)snprintf(name, size, "%s", value + 1 + strspn(value + 1, " "));
        break;
    }
    if (file != NULL) (void)fclose(file);
}

/* Puts the members of a row. In output for people, all rows of the table must have the same members. */
static void put_row(app_json *out, const bench_row *row) {
    const bool all = !out->people;
    app_json_real(out, "median_us", row->median_us);
    app_json_real(out, "min_us", row->min_us);
    app_json_real(out, "p10_us", row->p10_us);
    app_json_real(out, "p90_us", row->p90_us);
    app_json_real(out, "error", row->error);
    if (all) app_json_text(out, "error_is", row->error_is);
    if (all) app_json_size(out, "samples", row->samples);
    if (all) app_json_size(out, "inner", row->inner);
    if (all && row->batch > 0) app_json_size(out, "batch", row->batch);
    if (all && row->width > 0) app_json_size(out, "width", row->width);
    if (!all || row->unit != NULL) {
        app_json_real(out, "rate", row->unit != NULL ? row->rate : (double)NAN);
        app_json_text(out, "unit", row->unit);
    }
    for (size_t i = 0; all && i < row->notes; i++) app_json_real(out, row->note[i].name, row->note[i].value);
    if (all && row->series != NULL) app_json_reals(out, row->series_is, row->series, row->series_count);
}

/* In JSON, the first row's numbers also stand at the top level, so that a case with one row needs no
 * search. */
static void report(const bench *b) {
    char processor[256], kernels[256];
    processor_name(processor, sizeof processor);
    (void)lg_cpu_describe(kernels, sizeof kernels);
    app_json *out = b->app->out;
    app_json_put(out, LG_TEXT("case", b->what->name, b->what->summary));
    app_json_text(out, "name", b->row[0].name);
    put_row(out, &b->row[0]);
    app_json_put(out, LG_TEXT("dtype", b->dtype == LG_F64 ? "f64" : "f32", NULL));
    app_json_put(out, LG_WHOLE("threads", (uint64_t)b->threads, NULL));
    if (b->core >= 0) app_json_put(out, LG_WHOLE("core", (uint64_t)b->core, NULL));
    app_json_put(out, LG_TEXT("cpu", processor, NULL));
    app_json_put(out, LG_TEXT("kernels", kernels, NULL));
    app_json_text(out, "version", lg_version());
    app_result_rows(out, "rows");
    for (size_t i = 0; i < b->rows; i++) {
        app_json_open(out, NULL, '{');
        app_json_text(out, "name", b->row[i].name);
        put_row(out, &b->row[i]);
        app_json_close(out, '}');
    }
    app_result_rows_end(out);
    for (size_t i = 0; i < b->rows; i++)
        for (size_t k = 0; k < b->row[i].notes; k++)
            app_result_line(out, "%s: %s %.6g", b->row[i].name, b->row[i].note[k].name,
                            b->row[i].note[k].value);
    if (b->row[0].error_is != NULL) app_result_line(out, "error: %s", b->row[0].error_is);
}

/* ---- running a case ---- */

static const bench_case *find(const char *name) {
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        if (strcmp(cases[i].name, name) == 0) return &cases[i];
    return NULL;
}

static bool threads_given; /* If not given, lg-bench uses one thread, unlike the other programs. */

static void check_outputs(const app *self) {
    static const char *const endings[] = {"data", "weights", "order", "mlp", "resnet", "mult", "mult-affine"};
    app_path paths[LG_COUNT(endings) + 1] = {{"weights", given.weights, LG_FILE_READ, NULL}};
    char *names[LG_COUNT(endings)];
    if (given.out == NULL) return;
    for (size_t i = 0; i < LG_COUNT(endings); i++) {
        names[i] = app_format("%s.%s", given.out, endings[i]);
        paths[i + 1] = (app_path){"out", names[i], LG_FILE_TEXT, NULL};
    }
    app_check_outputs(self, paths, LG_COUNT(paths));
    for (size_t i = 0; i < LG_COUNT(endings); i++) free(names[i]);
}

static void run(app *self) {
    static bench b; /* Static: too large for the stack. */
    b = (bench){.app = self, .what = find(self->command->name), .given = &given, .core = -1};
    b.dtype = given.dtype == 0 ? b.what->dtype : given.dtype == 1 ? LG_F64 : LG_F32;
    b.threads = threads_given ? (int)self->threads : 1;
    if (given.width == 0) given.width = b.what->width;
    if (given.epochs == 0) given.epochs = b.what->epochs;
    check_outputs(self);
    if (b.threads == 1) b.core = bench_pin();
    b.what->run(&b);
    if (app_interrupted()) app_end(APP_EXIT_INTERRUPTED);
    if (b.rows == 0 && given.only != NULL) app_stop_usage(self, "no row's name contains '%s'", given.only);
    if (b.rows == 0) app_stop_usage(self, "nothing to measure with these options");
    report(&b);
    for (size_t i = 0; i < b.rows; i++) free(b.row[i].series);
}

int main(int argc, char **argv) {
    static app_command commands[LG_COUNT(cases) + 2];
    static const app_settings settings[] = {APP_GIVEN(options, given), APP_SETTINGS_END};
    commands[0] = (app_command){.name = "list", .summary = "What can be measured", .run = list};
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        commands[i + 1] = (app_command){
            .name = cases[i].name,
            .summary = cases[i].summary,
            .details =
                "One thread unless --threads says otherwise; a single thread is pinned to a core. Inputs "
                "come from a fixed seed. Times are medians over samples after a warm-up; short calls are "
                "timed many at a time. The error of what was computed stands beside its time.",
            .settings = settings,
            .run = run};
    /* Detects --threads, also abbreviated, as argp accepts abbreviations; no other option begins with t. */
    for (int i = 1; i < argc; i++)
        if (strncmp(argv[i], "--t", 3) == 0) threads_given = true;
    return app_main(argc, argv, "lg-bench", "Measures speed, and the error beside it", commands);
}
