/* attitude_control --log LOG.csv [--seed S]
 * attitude_control MODEL.h5 [--starts N] [--seed S] [--duration T] [--noise SIGMA]
 *
 * The first form writes a log of the true body (plant.h) for lg-identify. The second form controls the true
 * body at 1 kHz with the learned machine (controller.h): it holds an attitude, from random starts. With
 * --noise the controller sees the body through sensors and a filter (observer.h). Exit codes: 0; 1 if a run
 * does not end at the set point; 2 usage; 3 if a file cannot be read or written, or the model is not a model
 * of a body; 5 memory.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <liegrad/machine.h>
#include <liegrad/model.h>
#include <liegrad/settings.h>

#include "log.h"
#include "trial.h"

static const double period = 1e-3, hold = 2.0, tolerance = 0.01; /* s, s, rad */
static const double frequency = 5.0, torque_max = 6.0;           /* rad/s, N m */
/* Far from every equilibrium of the body: its centre of mass is above the pivot and to the side. */
static const double set_point[3] = {1.1, -0.7, 0.5}; /* rotation vector */

typedef struct settings {
    const char *model, *log;
    double starts, seed, duration, noise;
} settings;

/* ---- latency of a step ---- */

static int ascending(const void *a, const void *b) {
    const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

static void print_latency(samples *s) {
    if (s->count == 0) return;
    qsort(s->ns, s->count, sizeof *s->ns, ascending);
    const size_t last = s->count - 1;
    (void)printf(
        "computing a step, %zu of them, microseconds: median %.2f, 99 %% %.2f, 99.9 %% %.2f, maximum %.2f\n",
        s->count, 1e-3 * (double)s->ns[last / 2], 1e-3 * (double)s->ns[last - s->count / 100],
        1e-3 * (double)s->ns[last - s->count / 1000], 1e-3 * (double)s->ns[last]);
}

/* ---- runs ---- */

/* Runs all starts and prints the table. Returns the number of runs that do not hold the set point. */
static int run_all(const settings *set, plant *truth, controller *control, observer *by, samples *times,
                   double *rate) {
    int failed = 0;
    double measured = 0.0;
    lg_rng rng;
    lg_rng_seed(&rng, (uint64_t)set->seed, 1);
    (void)printf("\n%3s %10s %10s %12s %10s %12s\n", "", "start, deg", "rate there", "arrived at", "torque",
                 "held within");
    (void)printf("%3s %10s %10s %12s %10s %12s\n", "", "", "rad/s", "s", "N m", "rad");
    for (int i = 0; i < (int)set->starts; i++) {
        double state[PLANT_STATE];
        plant_start(&rng, 1.0, state);
        const double first = trial_norm(state + ATTITUDE);
        const trial_options options = {period, set->duration, hold, tolerance};
        const trial_result r = trial_run(&options, truth, control, by, state, times);
        const bool held = r.finite && r.worst <= tolerance && r.torque <= torque_max;
        (void)printf("%3d %10.1f %10.2f %12.2f %10.2f %12.1e%s\n", i + 1, r.angle * 57.29577951308232, first,
                     r.arrived, r.torque, r.worst, held ? "" : "  NOT HELD");
        *rate = fmax(*rate, r.rate);
        measured = fmax(measured, r.measured);
        failed += !held;
    }
    (void)printf("%d of %d reached the set point and held it within %g rad for the last %g s of %g s\n",
                 (int)set->starts - failed, (int)set->starts, tolerance, hold, set->duration);
    if (by != NULL)
        (void)printf(
            "measured attitudes were off by up to %.3f rad; the filter's deviation of an angle is %.4f rad\n",
            measured, by->worst);
    return failed;
}

/* ---- the model ---- */

/* Compares the learned inertia with the true one. Column j of the inertia is the momentum at the unit rate
 * about axis j. */
static void print_learned(const lg_model *model, void *work) {
    const double unit[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    double worst = 0.0;
    for (int j = 0; j < 3; j++) {
        double state[STATE];
        if (lg_model_machine_state(model, unit, unit + 3 * j, state, work) != LG_OK) return;
        for (int i = 0; i < 3; i++) worst = fmax(worst, fabs(state[MOMENTUM + i] - true_body.J[3 * i + j]));
    }
    (void)printf("learned inertia: off by at most %.1e kg m^2 (its largest number is %g)\n", worst,
                 true_body.J[4]);
}

/* Prints the rates of both, because the model does not know rates beyond those of the log. */
static void print_range(const lg_model_file *file, double rate) {
    const lg_machine_range *range =
        &((const lg_machine_model_file *)lg_model_file_of(file, &lg_recipe_machine_model))->run.range;
    double most = 0.0;
    for (int i = ATTITUDE; i < ATTITUDE + 3; i++) most = fmax(most, fmax(-range->low[i], range->high[i]));
    (void)printf("rates: up to %.1f rad/s in control, up to %.1f rad/s about an axis in the log\n", rate,
                 most);
}

static int control_with(const settings *set, const lg_model_file *file, void *work, samples *times) {
    controller control;
    observer by, *seen = set->noise > 0.0 ? &by : NULL;
    plant truth;
    double Rd[ATTITUDE], rate = 0.0;
    char why[256];
    plant_attitude(set_point, Rd);
    if (!controller_init(&control, file->model, work, Rd, frequency, torque_max, why)) {
        (void)fprintf(stderr, "%s: %s\n", set->model, why);
        return 3;
    }
    if (seen != NULL && !observer_create(seen, file->model, work, set->noise, (uint64_t)set->seed)) return 5;
    if (!plant_create(&truth)) {
        if (seen != NULL) observer_destroy(seen);
        return 5;
    }
    print_learned(file->model, work);
    const int failed = run_all(set, &truth, &control, seen, times, &rate);
    print_range(file, rate);
    print_latency(times);
    plant_destroy(&truth);
    if (seen != NULL) observer_destroy(seen);
    return failed > 0 ? 1 : 0;
}

static int control(const settings *set) {
    lg_model_file file;
    lg_error error = {LG_OK, ""};
    if (lg_model_load(NULL, set->model, NULL, &file, &error) != LG_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        return 3;
    }
    const size_t room = (size_t)(set->starts * (set->duration / period + 1.0));
    samples times = {malloc(room * sizeof(int64_t)), 0, room};
    void *work = aligned_alloc(64, (lg_model_work_size(file.model) + 63) / 64 * 64);
    int code = 5;
    if (work != NULL && times.ns != NULL) {
        memset(times.ns, 1, room * sizeof(int64_t)); /* touches all pages before the loop */
        code = control_with(set, &file, work, &times);
    }
    free(work);
    free(times.ns);
    lg_model_file_destroy(&file);
    return code;
}

/* ---- the command line ---- */

static int usage(void) {
    (void)fputs(
        "usage: attitude_control --log LOG.csv [--seed S]\n"
        "       attitude_control MODEL.h5 [--starts N] [--seed S] [--duration SECONDS] [--noise RAD]\n",
        stderr);
    return 2;
}

static bool number(const char *text, double least, double most, double *out) {
    return lg_number_parse(text, out) == LG_OK && *out >= least && *out <= most;
}

static bool parse(int argc, char **argv, settings *to) {
    for (int i = 1; i < argc; i++) {
        const char *given = argv[i], *value = i + 1 < argc ? argv[i + 1] : "";
        bool good = true;
        if (given[0] != '-') {
            good = to->model == NULL;
            to->model = given;
            i--;
        } else if (strcmp(given, "--log") == 0) {
            to->log = value;
            good = value[0] != '\0';
        } else if (strcmp(given, "--starts") == 0) {
            good = number(value, 1.0, 1000.0, &to->starts);
        } else if (strcmp(given, "--seed") == 0) {
            good = number(value, 0.0, 1e15, &to->seed);
        } else if (strcmp(given, "--duration") == 0) {
            good = number(value, 3.0, 100.0, &to->duration);
        } else if (strcmp(given, "--noise") == 0) {
            good = number(value, 0.0, 0.1, &to->noise);
        } else {
            good = false;
        }
        if (!good) return false;
        i++;
    }
    return (to->model == NULL) != (to->log == NULL);
}

int main(int argc, char **argv) {
    settings set = {.starts = 20, .seed = 1, .duration = 8};
    if (!parse(argc, argv, &set)) return usage();
    if (set.log == NULL) return control(&set);
    const log_options options = {.runs = 10,
                                 .rate = 100.0,
                                 .duration = 5.0,
                                 .torque = 1.0,
                                 .angle_noise = 5e-4,
                                 .rate_noise = 2e-3,
                                 .seed = (uint64_t)set.seed};
    if (log_write(set.log, &options)) return 0;
    (void)fprintf(stderr, "%s: cannot be written\n", set.log);
    return 3;
}
