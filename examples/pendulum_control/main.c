/* pendulum_control MODEL.h5 [--starts N] [--seed S] [--duration T] [--realtime T] [--torque F] [--plots DIR]
 *
 * A learned Hamiltonian swings up and balances a spherical pendulum at 1 kHz. The controller (controller.h)
 * knows the model file and the bound of the torque: 0.35 of the torque that would hold the pendulum
 * horizontal, so that it has to pump energy. The plant (plant.h) is the true pendulum. The first `realtime`
 * seconds of the first run (10 s, or the whole run if it is shorter) run in real time; everything else is
 * simulated as fast as possible. Exit codes: 0; 1 if a run does not end upright; 2 usage; 3 if a file cannot
 * be read or written, or the model is not a model of a pendulum; 5 memory.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "plots.h"
#include "trial.h"

typedef struct settings {
    const char *model, *plots;
    double starts, seed, torque; /* torque: bound divided by m g L */
    trial_options trial;
} settings;

/* All memory that the loops write to, allocated before them. */
typedef struct buffers {
    void *work;
    trial_times times;
    samples empty;
    trace record;
} buffers;

static int usage(void) {
    (void)fputs(
        "usage: pendulum_control MODEL.h5 [--starts N] [--seed S] [--duration SECONDS] [--realtime SECONDS]\n"
        "                                 [--torque BOUND/mgL] [--plots DIR]\n",
        stderr);
    return 2;
}

typedef struct option {
    const char *name;
    double *value, least, most;
    bool whole;
} option;

static bool parse_number(const char *text, const option *to) {
    double value;
    if (lg_number_parse(text, &value) == LG_OK && value >= to->least && value <= to->most &&
        !(to->whole && value != floor(value))) {
        *to->value = value;
        return true;
    }
    (void)fprintf(stderr, "%s %s: a%s number from %g to %g is wanted\n", to->name, text,
                  to->whole ? " whole" : "", to->least, to->most);
    return false;
}

static bool parse(int argc, char **argv, settings *to) {
    const option options[] = {{"--starts", &to->starts, 1.0, 100.0, true},
                              {"--seed", &to->seed, 0.0, 1e15, true},
                              {"--duration", &to->trial.duration, 1.0, 1000.0, false},
                              {"--realtime", &to->trial.realtime, 0.0, 1000.0, false},
                              {"--torque", &to->torque, 0.01, 10.0, false}};
    for (int i = 1; i < argc; i++) {
        size_t o = 0;
        if (argv[i][0] != '-' && to->model == NULL) {
            to->model = argv[i];
            continue;
        }
        if (++i >= argc) return false;
        if (strcmp(argv[i - 1], "--plots") == 0) {
            to->plots = argv[i];
            continue;
        }
        while (o < sizeof options / sizeof *options && strcmp(argv[i - 1], options[o].name) != 0) o++;
        if (o == sizeof options / sizeof *options) return false;
        if (!parse_number(argv[i], options + o)) return false;
    }
    if (to->trial.realtime < 0.0) to->trial.realtime = fmin(10.0, to->trial.duration);
    return to->model != NULL && to->trial.hold < to->trial.duration &&
           to->trial.realtime <= to->trial.duration;
}

static bool reserve(const settings *set, const lg_model *model, buffers *to) {
    const size_t steps = (size_t)(set->trial.duration / set->trial.period + 1.5);
    const size_t timed = (size_t)(set->trial.realtime / set->trial.period + 1.5);
    const size_t all = steps * (size_t)set->starts, rows = 6000, every = (steps + rows - 1) / rows;
    to->times.unpaced = (samples){malloc(all * sizeof(int64_t)), 0, all};
    to->times.paced = (samples){malloc(timed * sizeof(int64_t)), 0, timed};
    to->times.wake = (samples){malloc(timed * sizeof(int64_t)), 0, timed};
    to->times.response = (samples){malloc(timed * sizeof(int64_t)), 0, timed};
    to->empty = (samples){malloc(timed * sizeof(int64_t)), 0, timed};
    to->record = (trace){malloc(rows * sizeof(trace_row)), 0, rows, every};
    to->work = aligned_alloc(64, (controller_work_size(model) + 63) / 64 * 64);
    if (to->times.unpaced.ns == NULL || to->times.paced.ns == NULL || to->times.wake.ns == NULL ||
        to->times.response.ns == NULL || to->empty.ns == NULL || to->record.rows == NULL || to->work == NULL)
        return false;
    /* Touches all pages before the loop. */
    memset(to->times.unpaced.ns, 1, all * sizeof(int64_t));
    memset(to->times.paced.ns, 1, timed * sizeof(int64_t));
    memset(to->times.wake.ns, 1, timed * sizeof(int64_t));
    memset(to->times.response.ns, 1, timed * sizeof(int64_t));
    memset(to->empty.ns, 1, timed * sizeof(int64_t));
    return true;
}

static void release(buffers *from) {
    free(from->times.unpaced.ns);
    free(from->times.paced.ns);
    free(from->times.wake.ns);
    free(from->times.response.ns);
    free(from->empty.ns);
    free(from->record.rows);
    free(from->work);
}

/* Runs all starts and prints the table. Returns the number of runs that did not end upright. */
static int run_trials(const settings *set, plant *true_plant, controller *control, buffers *memory) {
    int failed = 0;
    (void)printf("\n%3s  %-43s %9s %12s %12s %8s\n", "", "start", "caught at", "held within", "at the end",
                 "torque");
    (void)printf("%3s  %-43s %9s %12s %12s %8s\n", "", "", "s", "rad", "rad", "/ mgL");
    for (int i = 0; i < (int)set->starts; i++) {
        double state[STATE];
        trial_options options = set->trial;
        if (i > 0) options.realtime = 0.0;
        const char *name = trial_start(true_plant, (uint64_t)set->seed, i, state);
        const double angle = pendulum_angle(state);
        const trial_result r =
            trial_run(&options, true_plant, control, state, &memory->times, i == 0 ? &memory->record : NULL);
        const bool bounded = r.most_torque <= control->torque_max * (1.0 + 1e-12);
        (void)printf("%3d  %-34s %4.0f deg %9.2f %12.1e %12.1e %8.3f%s\n", i + 1, name,
                     angle * 57.29577951308232, r.caught, r.worst_held, r.last_angle,
                     r.most_torque / true_plant->weight,
                     !bounded ? "  TORQUE EXCEEDED"
                     : r.held ? ""
                              : "  NOT HELD");
        failed += !(r.held && bounded && r.manifold < 1e-10);
    }
    (void)printf("%d of %d swung up and held within %g rad for the last %g s of %g s\n",
                 (int)set->starts - failed, (int)set->starts, set->trial.tolerance, set->trial.hold,
                 set->trial.duration);
    return failed;
}

static void print_latency(const char *name, samples *of) {
    const latency l = samples_summary(of);
    if (l.count > 0) (void)printf("%-44s %9zu %9.2f %9.2f %9.2f\n", name, l.count, l.median, l.p999, l.most);
}

static void print_latencies(buffers *memory) {
    (void)printf("\n%-44s %9s %9s %9s %9s\n", "microseconds", "steps", "median", "99.9 %", "maximum");
    print_latency("computing a step, at 1 kHz in real time", &memory->times.paced);
    print_latency("computing a step, back to back", &memory->times.unpaced);
    print_latency("empty timer loop, late by", &memory->empty);
    print_latency("control loop, timer late by", &memory->times.wake);
    print_latency("control loop, from due to torque computed", &memory->times.response);
}

static bool draw(const settings *set, const controller *control, const buffers *memory) {
    /* Draws only the series that have samples. Without real time only the second series has some; if all of
     * it ran in real time, the second has none. */
    const histogram_series all[] = {{"computing, at 1 kHz", &memory->times.paced},
                                    {"computing, back to back", &memory->times.unpaced},
                                    {"empty loop: timer late", &memory->empty},
                                    {"control loop: timer late", &memory->times.wake},
                                    {"control loop: due to torque", &memory->times.response}};
    histogram_series series[sizeof all / sizeof *all];
    int count = 0;
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        if (all[i].from->count > 0) series[count++] = all[i];
    (void)mkdir(set->plots, 0777);
    return plot_energy(set->plots, &memory->record, control->energy_up, set->trial.tolerance) &&
           plot_latency(set->plots, series, count);
}

static int run(const settings *set, const lg_model *model, plant *true_plant, buffers *memory) {
    controller control;
    char why[256];
    if (!controller_init(&control, model, memory->work, set->torque * true_plant->weight, why)) {
        (void)fprintf(stderr, "%s: %s\n", set->model, why);
        return 3;
    }
    (void)printf("learned: upright %.1e rad from e3, m g L = %.5f (true %g), m L^2 = %.5f (true %g); "
                 "|torque| <= %g mgL\n",
                 pendulum_angle(control.upright), control.energy_scale, true_plant->weight, control.mass,
                 true_plant->mass, set->torque);
    empty_loop(set->trial.period, set->trial.realtime, &memory->empty);
    const int failed = run_trials(set, true_plant, &control, memory);
    print_latencies(memory);
    if (set->plots != NULL && !draw(set, &control, memory)) return 3;
    return failed > 0 ? 1 : 0;
}

int main(int argc, char **argv) {
    settings set = {.starts = 20.0,
                    .seed = 1.0,
                    .torque = 0.35,
                    .trial = {1e-3, 30.0, 5.0, 1e-2, -1.0}}; /* realtime -1: not given */
    lg_model_file file;
    lg_error error;
    if (!parse(argc, argv, &set)) return usage();
    if (lg_model_load(NULL, set.model, NULL, &file, &error) != LG_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        return 3;
    }
    plant true_plant;
    buffers memory = {0};
    int code = 5;
    if (plant_create(&true_plant) && reserve(&set, file.model, &memory))
        code = run(&set, file.model, &true_plant, &memory);
    else
        (void)fputs("out of memory\n", stderr);
    release(&memory);
    plant_destroy(&true_plant);
    lg_model_file_destroy(&file);
    return code;
}
