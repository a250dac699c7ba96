/* soak SECONDS TESTS FOLDER: a process that uses the library for long, as a server does. It does the
 * activities of the table below in turn and checks their results. Each activity has another context, which
 * must get all its memory back. long_runs watches the process. TESTS is this tree's folder; files are written
 * to FOLDER. */
#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <liegrad/ensemble.h>
#include <liegrad/files.h>
#include <liegrad/fit.h>
#include <liegrad/mechanics.h>
#include <liegrad/model.h>
#include <liegrad/table.h>

enum {
    PATH = 4096,
    ROWS = 64,
    MEMBERS = 256,
    THREADS = 2,
    EPOCHS = 6,
    THETA = 64,
    NUMBERS = 1 << 16,
    BYTES = 1 << 20
};
static char tests[PATH], saved[PATH];
static atomic_long blocks; /* of memory that contexts have given */
static lg_error error;

static void *give(void *user, size_t bytes) {
    (void)user;
    void *memory = aligned_alloc(64, (bytes + 63) / 64 * 64);
    if (memory != NULL) atomic_fetch_add(&blocks, 1);
    return memory;
}

static void take_back(void *user, void *memory) {
    (void)user;
    atomic_fetch_sub(&blocks, 1);
    free(memory);
}

static void want(int good, const char *what, const char *where) {
    if (good) return;
    (void)fprintf(stderr, "soak: %s: %s %s\n", where, what, error.message);
    exit(1);
}
#define OK(call) want((call) == LG_OK, #call, __func__)

/* Loads a model, evaluates it, makes a step if it moves, and writes it as C. */
static void use_model(const lg_context *context, const char *name) {
    static double x[NUMBERS], y[NUMBERS];
    static _Alignas(64) char work[BYTES], memory[BYTES];
    char path[PATH + 64];
    lg_model_file file;
    (void)snprintf(path, sizeof path, "%s/models/%s.h5", tests, name);
    OK(lg_model_load(context, path, NULL, &file, &error));
    const size_t in = lg_model_inputs(file.model), out = lg_model_outputs(file.model);
    const size_t step = lg_model_stepper_size(file.model, lg_scheme_find("cf4"));
    want(in <= NUMBERS && out + in * out <= NUMBERS && step <= BYTES &&
             lg_model_work_size(file.model) <= BYTES,
         "too large", name);
    for (size_t i = 0; i < in; i++) x[i] = i % 6 == 2 || i % 6 == 3; /* an upright pendulum that moves */
    lg_model_jacobian(file.model, x, y, y + out, work);
    for (size_t i = 0; i < out + in * out; i++) want(isfinite(y[i]), "not finite", name);
    lg_stepper *stepper;
    if (step > 0) {
        OK(lg_model_stepper_init(file.model, lg_scheme_find("cf4"), &stepper, memory, step));
        OK(lg_stepper_step(stepper, 0, 1e-3, x, NULL, x));
    }
    lg_program *program;
    lg_c_source *source;
    lg_c_options how;
    lg_c_options_init(&how);
    how.name = "soak";
    OK(lg_model_file_program(&file, NULL, &program, &error));
    OK(lg_program_write_c(program, &how, &source, &error));
    want(strstr(source->code, "soak_") != NULL, "no function", name);
    lg_c_source_destroy(source);
    lg_program_destroy(program);
    lg_model_file_destroy(&file);
}

static lg_status start(void *user, uint64_t member, double *y0, double *parameters) {
    const double angle = 0.01 * (double)member;
    (void)user, (void)parameters;
    memcpy(y0, (double[]){sin(angle), 0, -cos(angle), 0, 0, 0}, 6 * sizeof *y0);
    return LG_OK;
}

static lg_status keep(void *user, const lg_ensemble_block *block) {
    lg_statistics *const *statistics = user; /* one for each thread */
    for (size_t i = 0; i < block->dim; i++)
        lg_statistics_add(statistics[block->thread], 0, i, block->states + i * block->room, block->members);
    return LG_OK;
}

/* Swings pendulums of a scene, and merges the statistics of two threads. */
static void run_ensemble(const lg_context *context, const char *name) {
    char path[PATH + 64];
    lg_scene scene;
    lg_ensemble_options how;
    lg_ensemble_stats stats;
    lg_statistics *statistics[THREADS];
    (void)snprintf(path, sizeof path, "%s/../scenes/%s.yaml", tests, name);
    OK(lg_scene_read(context, path, NULL, &scene, &error));
    lg_ensemble_options_init(&how);
    how.members = MEMBERS, how.threads = THREADS, how.block = 16, how.times = (double[]){1}, how.count = 1;
    OK(lg_statistics_create(context, 1, lg_system_dim(scene.system), 64, NULL, &statistics[0]));
    OK(lg_statistics_create_like(statistics[0], &statistics[1]));
    OK(lg_ensemble_run(context, scene.system, &how, start, NULL, keep, statistics, &stats, &error));
    OK(lg_statistics_merge(statistics[0], statistics[1]));
    want(lg_statistics_of(statistics[0], 0, 0).count == MEMBERS && stats.failed == 0, "lost members", name);
    for (int i = 0; i < THREADS; i++) lg_statistics_destroy(statistics[i]);
    lg_scene_destroy(&scene);
}

/* Learns a table, saves the program, and loads it: it must give the same numbers. */
static void learn_table(const lg_context *context, const char *name) {
    double x[ROWS], y[ROWS], before[ROWS], after[ROWS];
    lg_table_fit_options how;
    lg_program *program, *loaded;
    for (int i = 0; i < ROWS; i++) x[i] = 0.1 * i, y[i] = sin(x[i]);
    lg_table_fit_options_init(&how);
    how.model.hidden[0] = how.model.hidden[1] = 4, how.evidence.evaluations = 10, how.starts = 1;
    OK(lg_table_fit(context, x, 1, y, 1, ROWS, &how, &program, NULL, &error));
    OK(lg_program_save(context, saved, program, NULL, &error));
    OK(lg_program_load(context, saved, NULL, &loaded, &error));
    OK(lg_program_eval(context, program, "value", ROWS, (const double *[]){x}, (double *[]){before}, &error));
    OK(lg_program_eval(context, loaded, "value", ROWS, (const double *[]){x}, (double *[]){after}, &error));
    want(memcmp(before, after, sizeof before) == 0, "another value after loading", name);
    lg_program_destroy(program);
    lg_program_destroy(loaded);
}

/* The file of a checkpoint at half of the epochs, from which the training goes on in another fit. */
static lg_fit *resume(const lg_context *context, const lg_fit *half, const lg_fit_problem *problem,
                      const lg_fit_options *how, const double *theta) {
    lg_file_writer *writer;
    lg_file_reader *reader;
    lg_archive_writer to;
    lg_archive_reader from;
    lg_fit *fit;
    OK(lg_file_writer_create(context, saved, "soak", NULL, &writer, &error));
    OK(lg_file_writer_archive(writer, "fit", &to));
    OK(lg_fit_save(half, &to, &error));
    OK(lg_file_writer_commit(writer, &error));
    lg_file_writer_destroy(writer);
    OK(lg_fit_create(context, problem, how, theta, &fit, &error));
    OK(lg_file_reader_create(context, saved, "soak", NULL, &reader, &error));
    OK(lg_file_reader_archive(reader, "fit", &from));
    OK(lg_fit_load(fit, &from, &error));
    lg_file_reader_destroy(reader);
    return fit;
}

/* Trains a network by a plan, at a stretch and with a checkpoint: the bits must be the same. */
static void train(const lg_context *context, const char *plan) {
    double x[ROWS], y[ROWS], theta[THETA], ends[2][THETA];
    lg_table model;
    lg_table_options shape = {.activation = LG_TANH, .hidden_count = 1, .hidden = {8}, .linear = true};
    lg_table_samples samples = {.count = ROWS, .training = ROWS, .x = x, .y = y};
    lg_fit_problem problem;
    lg_fit_options how;
    lg_rng rng;
    lg_fit *fit[3];
    for (int i = 0; i < ROWS; i++) x[i] = 0.1 * i - 3, y[i] = sin(x[i]);
    lg_rng_seed(&rng, 1, 0);
    OK(lg_table_init(&model, &shape, 1, 1, &error));
    want(lg_table_parameters(&model) <= THETA, "too many parameters", plan);
    lg_table_initialise(&model, &rng, theta);
    lg_table_fit_problem(&(lg_table_problem){.model = &model, .samples = &samples}, &problem);
    lg_fit_options_init(&how);
    OK(lg_fit_plan_parse(plan, true, &how.plan, &error));
    how.epochs = EPOCHS, how.threads = THREADS, how.shards = THREADS;
    OK(lg_fit_create(context, &problem, &how, theta, &fit[0], &error));
    how.stop_after = EPOCHS / 2;
    OK(lg_fit_create(context, &problem, &how, theta, &fit[1], &error));
    OK(lg_fit_run(fit[1], &error));
    fit[2] = resume(context, fit[1], &problem, &how, theta);
    for (int i = 0; i < 2; i++) {
        OK(lg_fit_run(fit[2 * i], &error));
        lg_fit_parameters(fit[2 * i], ends[i]);
    }
    want(memcmp(ends[0], ends[1], problem.parameters * sizeof(double)) == 0, "other bits", plan);
    for (int i = 0; i < 3; i++) lg_fit_destroy(fit[i]);
}

static const struct {
    void (*run)(const lg_context *context, const char *name);
    const char *name;
} activities[] = {
    {use_model, "chain"},    {use_model, "separable"},
    {use_model, "discrete"}, {use_model, "angle"},
    {use_model, "table"},    {use_model, "machine"},
    {use_model, "detector"}, {run_ensemble, "pendulum-ensemble"},
    {learn_table, "sine"},   {train, "adam"},
    {train, "ssbroyden"},    {train, "adam:2,lbfgs"},
    {train, "lm"},
};

static void do_activity(size_t i) {
    lg_context_options how;
    lg_context *context;
    lg_context_options_init(&how);
    how.allocate = give, how.release = take_back;
    OK(lg_context_create(&how, &context));
    activities[i].run(context, activities[i].name);
    lg_context_destroy(context);
    want(atomic_load(&blocks) == 0, "memory is not released", activities[i].name);
}

int main(int argc, char **argv) {
    if (argc != 4) return (void)fputs("usage: soak SECONDS TESTS FOLDER\n", stderr), 2;
    (void)snprintf(tests, sizeof tests, "%s", argv[2]);
    (void)snprintf(saved, sizeof saved, "%.4000s/soak.h5", argv[3]);
    lg_runtime_setup();
    lg_io_setup();
    struct timespec begin, now;
    (void)clock_gettime(CLOCK_MONOTONIC, &begin);
    const double most = strtod(argv[1], NULL);
    unsigned long rounds = 0;
    do {
        for (size_t i = 0; i < sizeof activities / sizeof *activities; i++) do_activity(i);
        rounds++;
        (void)clock_gettime(CLOCK_MONOTONIC, &now);
    } while ((double)(now.tv_sec - begin.tv_sec) < most);
    (void)printf("%lu\n", rounds);
    return 0;
}
