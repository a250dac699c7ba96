/* Learned Hamiltonians: seconds per epoch of training, and the quality of the result. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/read_file.h"
#include "lg-bench/bench.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/mechanics.h"
#include "liegrad/model.h"

enum { STREAM_WEIGHTS = 1, DATA_SEED = 1, TEST_SEED = 1001 };

/* Each row is one experiment. The learning rate starts at 1e-2 and is multiplied by 0.1 every `decay`
 * epochs. */
typedef struct experiment {
    const char *name, *system;
    size_t links, trajectories, points, segments;
    double t_end;
    const char *integrator;
    uint32_t layers, hidden[3];
    uint64_t decay;
    size_t test_points;
} experiment;

static const experiment experiments[] = {
    {"hamiltonian", "pendulum-chain", 1, 500, 5, 1, 0.1, "cf4", 3, {100, 100, 100}, 50, 15},
    {"hamiltonian-small", "pendulum-chain", 1, 500, 5, 1, 0.1, "cf4", 2, {20, 20}, 50, 15},
    {"hamiltonian-double", "pendulum-chain", 2, 500, 5, 1, 0.1, "cf4", 3, {100, 100, 100}, 50, 15},
    {"hamiltonian-quartic", "quartic", 2, 900, 6, 3, 0.3, "stormer-verlet", 3, {100, 50, 50}, 30, 20},
};

typedef struct training {
    const experiment *what;
    lg_system *system;
    size_t dim;
    double *t, *data, *energies;
    lg_hamiltonian model;
    lg_hamiltonian_problem problem;
    double *theta;
} training;

static void sample(const bench *b, const training *l, size_t trajectories, size_t points, size_t segments,
                   uint64_t seed, double *t, double *data, double *energies) {
    lg_trajectory_options options;
    lg_error error = {LG_OK, ""};
    lg_trajectory_options_init(&options);
    options.trajectories = trajectories;
    options.points = points;
    options.t_end = l->what->t_end;
    options.segments = segments;
    options.seed = seed;
    bench_check(b, lg_system_generate(b->app->context, l->system, &options, t, data, energies, &error),
                error.message);
}

static void open_learning(const bench *b, training *l) {
    const experiment *e = l->what;
    lg_system_options options;
    lg_rng rng;
    const bool chain = strcmp(e->system, "pendulum-chain") == 0;
    const double gravity = 1.0;
    const lg_named_values given = {"gravity", &gravity, 1};
    lg_system_options_init(&options);
    options.links = e->links;
    if (chain) {
        options.form = "hamiltonian";
        options.parameters = &given;
        options.parameter_count = 1;
    }
    bench_check(b, lg_system_create(b->app->context, e->system, &options, &l->system, NULL),
                "making the system");
    l->dim = lg_system_dim(l->system);
    l->t = app_alloc(e->points, sizeof *l->t);
    l->data = app_alloc(e->trajectories * e->points * l->dim, sizeof *l->data);
    l->energies = app_alloc(e->trajectories, sizeof *l->energies);
    sample(b, l, e->trajectories, e->points, e->segments, DATA_SEED, l->t, l->data, l->energies);
    size_t n;
    const lg_hamiltonian_family *family = lg_hamiltonian_family_for(l->system, &n);
    bench_check(
        b,
        lg_hamiltonian_init(&l->model, family, (uint32_t)n, LG_POTENTIAL_MLP, e->hidden, e->layers, LG_TANH),
        "making the model");
    l->problem = (lg_hamiltonian_problem){.model = &l->model,
                                          .scheme = lg_scheme_find(e->integrator),
                                          .substeps = 1,
                                          .trajectories = e->trajectories,
                                          .points = e->points,
                                          .dt = e->t_end / (double)(e->points - 1),
                                          .data = l->data};
    l->theta = app_alloc(lg_hamiltonian_parameters(&l->model), sizeof *l->theta);
    lg_rng_seed(&rng, b->app->seed, STREAM_WEIGHTS);
    lg_hamiltonian_initialise(&l->model, &rng, l->theta);
}

static void close_learning(training *l) {
    lg_system_destroy(l->system);
    free(l->t);
    free(l->data);
    free(l->energies);
    free(l->theta);
}

lg_model *bench_model(const bench *b, const lg_hamiltonian *model, const double *theta) {
    lg_program *program;
    lg_space space;
    lg_model *out = NULL;
    bench_check(b, lg_hamiltonian_space(model->family, model->n, &space), "making the model");
    bench_check(b, lg_hamiltonian_program(b->app->context, model, theta, NULL, &program, NULL),
                "making the model");
    bench_check(b, lg_model_create(b->app->context, program, &space, &out, NULL), "making the model");
    return out;
}

/* ---- E1: the true and the learned flow are integrated accurately; mean squared difference over all points
 * ---- */

static double e1(const bench *b, const training *l, const double *theta) {
    enum { TEST = 100 };
    const size_t points = l->what->test_points, size = points * l->dim;
    double *t = app_alloc(points, sizeof *t), *truth = app_alloc(TEST * size, sizeof *truth);
    double *y = app_alloc(size, sizeof *y), energies[TEST], sum = 0;
    lg_model *learned = bench_model(b, &l->model, theta);
    void *work = app_alloc(lg_model_work_size(learned), 1);
    lg_model_user user;
    lg_ode ode;
    lg_step_controller control;
    lg_stepper *stepper = NULL;
    sample(b, l, TEST, points, 1, TEST_SEED, t, truth, energies);
    lg_step_controller_init(&control);
    control.rtol = control.atol = 1e-10;
    bench_check(b, lg_model_ode(learned, &ode, &user, work), "making the learned system");
    bench_check(b,
                lg_stepper_create(b->app->context, lg_scheme_find(l->model.family->accurate), &ode, &stepper),
                "making the stepper");
    for (size_t i = 0; i < TEST; i++) {
        const double *given = truth + i * size;
        bench_check(b, lg_integrate_adaptive(stepper, &control, t[0], given, t, points, y, NULL),
                    "integrating the learned flow");
        for (size_t k = 0; k < size; k++) sum += (y[k] - given[k]) * (y[k] - given[k]);
    }
    lg_stepper_destroy(stepper);
    lg_model_destroy(learned);
    free(work);
    free(t);
    free(truth);
    free(y);
    return sum / (double)(TEST * size);
}

/* Mean squared error over the whole training set in double precision. */
static double full_loss(const bench *b, const training *l, const double *theta) {
    lg_fit_problem problem;
    lg_var loss = LG_NONE;
    double value = NAN;
    uint32_t *samples = app_alloc(l->what->trajectories, sizeof *samples);
    lg_tape *tape = bench_tape(b, LG_F64, 1);
    lg_hamiltonian_fit_problem(&l->problem, &problem);
    for (uint32_t i = 0; i < l->what->trajectories; i++) samples[i] = i;
    const lg_var parameters = lg_parameter(tape, lg_shape1((uint32_t)problem.parameters), theta);
    (void)problem.loss(problem.user, tape, parameters, samples, problem.samples, problem.samples, &loss);
    (void)lg_read(tape, loss, 1, &value);
    bench_check_tape(b, tape);
    lg_tape_destroy(tape);
    free(samples);
    return value;
}

static void judge_row(const bench *b, const training *l, const double *theta, bench_row *row) {
    row->error = full_loss(b, l, theta);
    row->error_is = "mean squared error over the training set, f64";
    if (b->given->judge || b->given->weights != NULL) bench_note_add(row, "E1", e1(b, l, theta));
}

/* ---- training ---- */

static void train(bench *b, training *l) {
    lg_fit_problem problem;
    lg_fit_options options;
    lg_fit *fit = NULL;
    lg_error error = {LG_OK, ""};
    size_t count;
    lg_hamiltonian_fit_problem(&l->problem, &problem);
    lg_fit_options_init(&options);
    options.dtype = b->dtype;
    options.epochs =
        b->given->repeats > 0 && !app_given(b->app, "epochs") ? b->given->repeats + 1 : b->given->epochs;
    options.batch = (size_t)*bench_batches(b, &count);
    options.adam.lr = 1e-2;
    options.adam.eps = LG_HAMILTONIAN_ADAM_EPS;
    options.clip_norm = LG_HAMILTONIAN_CLIP;
    options.schedule = (lg_schedule){.kind = LG_SCHEDULE_STEP, .every = l->what->decay, .gamma = 0.1};
    options.seed = b->app->seed;
    options.threads = b->threads;
    bench_check(b, lg_fit_create(b->app->context, &problem, &options, l->theta, &fit, &error), error.message);
    bench_check(b, lg_fit_run(fit, &error), error.message);
    const size_t epochs = (size_t)lg_fit_epochs_done(fit);
    double *us = app_alloc(epochs, sizeof *us);
    for (size_t i = 1; i < epochs; i++) us[i - 1] = 1e6 * lg_fit_history(fit, LG_FIT_SECONDS)[i];
    bench_row *row = bench_from_samples(b, "epoch", us, epochs - 1);
    free(us);
    if (row != NULL) {
        lg_fit_parameters(fit, l->theta);
        row->batch = options.batch;
        judge_row(b, l, l->theta, row);
        bench_note_add(row, "loss", lg_fit_loss(fit));
        bench_note_add(row, "epochs", (double)epochs);
        row->series_is = "losses";
        row->series_count = epochs;
        row->series = app_alloc(epochs, sizeof *row->series);
        memcpy(row->series, lg_fit_history(fit, LG_FIT_LOSS), epochs * sizeof *row->series);
    }
    lg_fit_destroy(fit);
}

/* ---- parameters trained by other programs ---- */

static void read_weights(const bench *b, training *l) {
    const size_t n = lg_hamiltonian_parameters(&l->model);
    FILE *file = NULL;
    uint64_t bytes;
    const bool whole = lg_read_open(b->given->weights, &file, &bytes, NULL) == LG_OK &&
                       bytes == n * sizeof *l->theta && fread(l->theta, sizeof *l->theta, n, file) == n;
    if (file != NULL) (void)fclose(file);
    if (!whole) exit(app_fail_file(b->app, LG_FORMAT, NULL, b->given->weights));
}

/* Does not train: computes the error and E1 of given parameters. The row's time is the time of this
 * judgement. */
static void judge_weights(bench *b, training *l) {
    read_weights(b, l);
    const double start = app_seconds();
    bench_row judged = {.error = NAN};
    judge_row(b, l, l->theta, &judged);
    double us = 1e6 * (app_seconds() - start);
    bench_row *row = bench_from_samples(b, "judge", &us, 1);
    if (row == NULL) return;
    row->error = judged.error;
    row->error_is = judged.error_is;
    bench_note_add(row, judged.note[0].name, judged.note[0].value);
}

void bench_hamiltonian(bench *b) {
    training l = {.what = NULL};
    for (size_t i = 0; i < LG_COUNT(experiments); i++)
        if (strcmp(experiments[i].name, b->what->name) == 0) l.what = &experiments[i];
    open_learning(b, &l);
    if (b->given->out != NULL) {
        bench_write_doubles(b, "data", l.data, l.what->trajectories * l.what->points * l.dim);
        bench_write_doubles(b, "weights", l.theta, lg_hamiltonian_parameters(&l.model));
    }
    if (b->given->weights != NULL)
        judge_weights(b, &l);
    else
        train(b, &l);
    close_learning(&l);
}
