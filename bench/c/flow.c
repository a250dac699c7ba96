/* flow MODEL.h5 DATA.h5: error of a learned flow against the seconds of its integration.
 *
 * Starts are the first points of the trajectories in DATA.h5, the time is that of their last points. Every
 * row of `methods` runs with a list of tolerances or of steps. Its error is the root mean square over the
 * starts of the distance from the reference at the end, its seconds are those of one trajectory: the median
 * of rounds. The reference is rkmk54 of the same model with tolerance 1e-14; "known" is its distance from
 * dp85 with tolerance 1e-14, "model" its distance from the last points of the data. Ambient methods get
 * the velocity of the same field in R^d. Prints one JSON object. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <liegrad/hamiltonian.h>
#include <liegrad/integrators.h>

enum { ROUNDS = 5, LEVELS = 10, MOST = LG_SPACE_MAX_FACTORS * LG_SPACE_MAX_STATE };

static struct {
    lg_model_file file;
    lg_trajectories data;
    lg_ode own, ambient;
    lg_model_user user;
    double algebra[MOST], *end, *reference, t;
    size_t d, starts;
} all;

/* The field of the model as a velocity in R^d. */
static lg_status velocity(void *user, double t, const double *y, const double *input, double *out) {
    const lg_status status = all.own.field(user, t, y, input, all.algebra);
    if (status == LG_OK) lg_space_generator(&all.own.space, all.algebra, y, out);
    return status;
}

static const struct method {
    const char *name;
    bool adaptive, ambient;
} methods[] = {{"rkmk54", true, false}, {"cf43", true, false}, {"dp54", true, true},
               {"dp85", true, true},    {"cf4", false, false}, {"rkmk4", false, false},
               {"rkmk5", false, false}, {"rk4", false, true}};

static void check(lg_status status, const char *what) {
    if (status == LG_OK) return;
    (void)fprintf(stderr, "%s: %s\n", what, lg_status_sentence(status));
    exit(4);
}

/* Follows all trajectories once; `setting` is a tolerance or a number of steps. Returns false if a state grew
 * without bound. */
static bool follow(const struct method *m, double setting, double *end) {
    lg_stepper *stepper;
    lg_step_controller control;
    lg_step_controller_init(&control);
    control.rtol = setting, control.atol = -setting;
    check(lg_stepper_create(NULL, lg_scheme_find(m->name), m->ambient ? &all.ambient : &all.own, &stepper),
          m->name);
    lg_status status = LG_OK;
    for (size_t i = 0; i < all.starts && status == LG_OK; i++) {
        const double *y0 = all.data.data + i * all.data.points * all.d;
        double out[2 * MOST];
        const size_t steps = (size_t)setting;
        lg_stepper_reset(stepper);
        status = m->adaptive ? lg_integrate_adaptive(stepper, &control, 0.0, y0, &all.t, 1, out, NULL)
                             : lg_integrate_fixed(stepper, 0.0, all.t / (double)steps, steps, NULL, 0, steps,
                                                  y0, out, NULL);
        memcpy(end + i * all.d, out + (m->adaptive ? 0 : all.d), all.d * sizeof *end);
    }
    lg_stepper_destroy(stepper);
    if (status != LG_NOT_FINITE) check(status, m->name);
    return status == LG_OK;
}

static double distance(const double *a, const double *b, size_t row) {
    double sum = 0;
    for (size_t i = 0; i < all.starts; i++)
        for (size_t k = 0; k < all.d; k++) sum += pow(a[i * all.d + k] - b[i * row + k], 2);
    return sqrt(sum / (double)all.starts);
}

static double now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Seconds of one trajectory. */
static double seconds(const struct method *m, double setting) {
    double round[ROUNDS];
    for (size_t r = 0; r < ROUNDS; r++) {
        int times = 0;
        const double begin = now();
        do {
            (void)follow(m, setting, all.end);
        } while (++times < 3 || now() - begin < 0.02);
        round[r] = (now() - begin) / times / (double)all.starts;
    }
    qsort(round, ROUNDS, sizeof *round, ascending);
    return round[ROUNDS / 2];
}

int main(int argc, char **argv) {
    lg_error error;
    if (argc != 3) return 2;
    if (lg_model_load(NULL, argv[1], NULL, &all.file, &error) != LG_OK ||
        lg_trajectories_read(NULL, argv[2], NULL, &all.data, &error) != LG_OK)
        return fprintf(stderr, "%s\n", error.message), 3;
    all.d = all.data.state_dim, all.starts = all.data.count;
    all.t = all.data.dt * (double)(all.data.points - 1);
    void *work = aligned_alloc(64, (lg_model_work_size(all.file.model) + 63) / 64 * 64);
    all.end = calloc(all.starts * all.d, sizeof(double));
    all.reference = calloc(all.starts * all.d, sizeof(double));
    if (!work || !all.end || !all.reference || all.d > MOST) return 5;
    check(lg_model_ode(all.file.model, &all.own, &all.user, work), argv[1]);
    all.ambient = all.own, all.ambient.field = velocity, all.ambient.manifold = all.own.space;
    check(lg_space_init_rn(&all.ambient.space, all.d), "R^d");
    if (!follow(&methods[0], 1e-14, all.reference) || !follow(&methods[3], 1e-14, all.end)) return 4;
    const size_t row = all.data.points * all.d;
    printf("{\"t\": %.17g, \"starts\": %zu, \"known\": %.3g, \"model\": %.3g, \"points\": [", all.t,
           all.starts, distance(all.end, all.reference, all.d),
           distance(all.reference, all.data.data + row - all.d, row));
    for (size_t i = 0; i < sizeof methods / sizeof *methods; i++)
        for (int level = 0; level < LEVELS; level++) {
            const double setting = methods[i].adaptive ? pow(10, -3 - level) : ldexp(10, level);
            if (!follow(&methods[i], setting, all.end)) continue;
            const double each = seconds(&methods[i], setting);
            printf("%s{\"method\": \"%s\", \"%s\": %g, \"seconds\": %.4g, \"error\": %.4g}",
                   i + (size_t)level > 0 ? ", " : "", methods[i].name,
                   methods[i].adaptive ? "tolerance" : "steps", setting, each,
                   distance(all.end, all.reference, all.d));
        }
    printf("]}\n");
    return 0;
}
