/* embedding MODEL.h5 SCHEME ROUNDS: compares the library with the code of lg-export, alternating in one
 * process.
 *
 * It is compiled with the exported folder (--name model) as an include folder and linked with its objects.
 * Each function is timed in ROUNDS rounds. A round has some calls of the library and as many of the exported
 * code, cycling through 16 inputs. Microseconds per call are medians over rounds. The error is the largest
 * norm of the difference from the library over 1000 random inputs, relative to the root mean square of the
 * norms of the library's results. Prints one JSON object.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "liegrad/core.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/integrators.h"
#include "liegrad/model.h"
#include "model.h"

enum { INPUTS = model_INPUTS, OUTPUTS = model_OUTPUTS, STATES = 16, CHECKS = 1000, MOST = 100000 };

static struct {
    lg_model_file file;
    const lg_model *model;
    lg_stepper *stepper;
    void *work;
    double x[CHECKS][INPUTS];
    model_real narrow[CHECKS][INPUTS]; /* the same inputs; x is rounded to the exported type */
    double *y;
    model_real *to;
    model_real room[model_WORK_SIZE];
} all;

#ifdef model_STATE_SIZE
static const double h = 0.01; /* length of a step */
#endif

/* ---- compared functions: evaluate at input i, into all.y and all.to ---- */

static void library_value(size_t i) {
    lg_model_eval(all.model, all.x[i], all.y, all.work);
}
static void exported_value(size_t i) {
    model_eval(all.narrow[i], all.to, all.room);
}
static void library_gradient(size_t i) {
    lg_model_jacobian(all.model, all.x[i], all.y, all.y + OUTPUTS, all.work);
}
static void exported_gradient(size_t i) {
    model_grad(all.narrow[i], all.to, all.to + OUTPUTS, all.room);
}
#ifdef model_STATE_SIZE
static void library_field(size_t i) {
    (void)lg_model_field(all.model, all.x[i], NULL, all.y, all.work);
}
static void exported_field(size_t i) {
    model_field(all.narrow[i], NULL, all.to, all.room);
}
static void library_step(size_t i) {
    lg_stepper_reset(all.stepper);
    (void)lg_stepper_step(all.stepper, 0.0, h, all.x[i], NULL, all.y);
}
static void exported_step(size_t i) {
    model_step((model_real)h, all.narrow[i], NULL, all.to, all.room);
}
#endif

static const struct pair {
    const char *name;
    void (*library)(size_t), (*exported)(size_t);
    size_t numbers;
} pairs[] = {
    {"value", library_value, exported_value, OUTPUTS},
    {"gradient", library_gradient, exported_gradient, OUTPUTS + (size_t)OUTPUTS *INPUTS},
#ifdef model_STATE_SIZE
    {"field", library_field, exported_field, model_STATE_SIZE},
    {"step", library_step, exported_step, model_STATE_SIZE},
#endif
};

/* ---- inputs ---- */

/* Draws a link's q with length 1 and p orthogonal to q. */
static void draw_link(lg_rng *rng, double *x) {
    double norm = 0.0, along = 0.0;
    for (int c = 0; c < 6; c++) x[c] = lg_rng_normal(rng);
    for (int c = 0; c < 3; c++) norm += x[c] * x[c];
    for (int c = 0; c < 3; c++) x[c] /= sqrt(norm);
    for (int c = 0; c < 3; c++) along += x[c] * x[3 + c];
    for (int c = 0; c < 3; c++) x[3 + c] -= along * x[c];
}

static void draw(void) {
    lg_rng rng;
    lg_rng_seed(&rng, 1, 0);
    const lg_hamiltonian_file *file = lg_model_file_of(&all.file, &lg_recipe_hamiltonian);
    const int chain = file != NULL && file->run.model.family == lg_hamiltonian_family_find("chain");
    for (size_t i = 0; i < CHECKS; i++) {
        for (size_t k = 0; k < INPUTS; k += chain ? 6 : 1) {
            if (chain)
                draw_link(&rng, all.x[i] + k);
            else
                all.x[i][k] = 2.0 * lg_rng_uniform(&rng) - 1.0;
        }
        for (size_t k = 0; k < INPUTS; k++) {
            all.narrow[i][k] = (model_real)all.x[i][k];
            all.x[i][k] = (double)all.narrow[i][k];
        }
    }
}

/* ---- measuring ---- */

static double error_of(const struct pair *p) {
    double worst = 0.0, norms = 0.0;
    for (size_t i = 0; i < CHECKS; i++) {
        double difference = 0.0;
        p->library(i);
        p->exported(i);
        for (size_t k = 0; k < p->numbers; k++) {
            const double d = all.y[k] - (double)all.to[k];
            difference += d * d;
            norms += all.y[k] * all.y[k];
        }
        if (!(sqrt(difference) <= worst)) worst = sqrt(difference);
    }
    return worst / sqrt(norms / CHECKS);
}

static double now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e6 + (double)t.tv_nsec * 1e-3;
}

static double time_of(void (*call)(size_t), int calls) {
    const double begin = now();
    for (int i = 0; i < calls; i++) call((size_t)i % STATES);
    return (now() - begin) / calls;
}

static int ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, size_t count) {
    qsort(values, count, sizeof *values, ascending);
    return values[count / 2];
}

/* Number of calls that take about 20 us together. */
static int calls_for(const struct pair *p) {
    const double us = time_of(p->library, STATES);
    const int calls = (int)(20.0 / us);
    return calls > 1 ? calls : 1;
}

static void measure(const struct pair *p, size_t rounds, double *ours, double *exported) {
    const int calls = calls_for(p);
    for (size_t i = 0; i < rounds; i++) {
        ours[i] = time_of(p->library, calls);
        exported[i] = time_of(p->exported, calls);
    }
}

static int open_model(const char *path, const char *scheme) {
    lg_error error = {0};
    if (lg_model_load(NULL, path, NULL, &all.file, &error) != LG_OK) {
        (void)fprintf(stderr, "%s: %s\n", path, error.message);
        return 3;
    }
    all.model = all.file.model;
    if (lg_model_inputs(all.model) != INPUTS || lg_model_outputs(all.model) != OUTPUTS) {
        (void)fprintf(stderr, "%s: not the model that was exported\n", path);
        return 3;
    }
    all.work = aligned_alloc(64, (lg_model_work_size(all.model) + 63) / 64 * 64);
    all.y = calloc(OUTPUTS + (size_t)OUTPUTS * INPUTS + INPUTS, sizeof *all.y);
    all.to = calloc(OUTPUTS + (size_t)OUTPUTS * INPUTS + INPUTS, sizeof *all.to);
    if (all.work == NULL || all.y == NULL || all.to == NULL) return 5;
    if (lg_model_file_of(&all.file, &lg_recipe_hamiltonian) == NULL) return 0;
    const lg_scheme *found = lg_scheme_find(scheme);
    const size_t bytes = found != NULL ? lg_model_stepper_size(all.model, found) : 0;
    void *memory = aligned_alloc(64, (bytes + 64) / 64 * 64);
    if (memory == NULL || found == NULL ||
        lg_model_stepper_init(all.model, found, &all.stepper, memory, bytes) != LG_OK) {
        (void)fprintf(stderr, "%s: no steps with scheme %s\n", path, scheme);
        return 2;
    }
    return 0;
}

int main(int argc, char **argv) {
    static double ours[MOST], exported[MOST];
    if (argc != 4) return 2;
    const int code = open_model(argv[1], argv[2]);
    const long asked = strtol(argv[3], NULL, 10);
    const size_t rounds = asked < 1 ? 1 : asked > MOST ? MOST : (size_t)asked;
    if (code != 0) return code;
    draw();
    printf("{\"real_bytes\": %zu, \"rows\": [", sizeof(model_real));
    for (size_t i = 0; i < sizeof pairs / sizeof *pairs; i++) {
        const double error = error_of(&pairs[i]);
        measure(&pairs[i], rounds, ours, exported);
        printf("%s{\"name\": \"%s\", \"library_us\": %.4f, \"exported_us\": %.4f, \"error\": ",
               i > 0 ? ", " : "", pairs[i].name, median(ours, rounds), median(exported, rounds));
        printf(isfinite(error) ? "%.3g}" : "null}", error);
    }
    printf("]}\n");
    return 0;
}
