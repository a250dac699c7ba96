/* Friction that sticks, measured: what bench/friction prints. The reference is an event-driven integrator:
 * rk4 with steps of 0.1 ms at most in one mode, whose end is found by bisection.
 *   friction steps                            accuracy, creep, energy and gradients, a line of CSV each
 *   friction write FOLDER                     C of a step of the trolley: sticking.c and soft.c
 *   friction time LIBRARY NAME COUNT          nanoseconds of COUNT calls of NAME_step
 *   friction log HZ RUNS SECONDS NOISE SEED   a log of the trolley by the reference
 *   friction policy LIBRARY MEMORY DELAY STARTS SEED
 *                                             share of the starts from which the exported policy p brings
 *                                             the trolley to its goal; MEMORY: numbers that it remembers;
 *                                             inputs act DELAY periods late
 */
#include <dlfcn.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "liegrad/machine.h"
#include "liegrad/program.h"

enum { N = 2, TROLLEY = 0, ARM, BELT, INCLINE, RIGS };

typedef struct rig {
    const char *name, *yaml; /* %s: the width's key, or nothing */
    int n;
    double q[N], v[N], drive;
} rig;

#define TWO(a, b)                                                                                            \
    "columns: {time: t}\ncoordinates: [{name: x, kind: " a ", velocity: vx}, {name: a, kind: " b             \
    ", velocity: va}]\n" INPUT
#define ONE   "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}]\n" INPUT
#define INPUT "inputs: {columns: [u]}\n"
static const rig rigs[RIGS] = {
    {"trolley",
     TWO("line", "angle") "system: cart-pole\nparameters: {cart: 10, pole: 1, length: 0.8, gravity: -9.81}\n"
                          "damping: [{kind: known, values: [0.5, 0.05]}, {kind: coulomb, values: [6, 0]%s}]\n"
                          "input_map: {kind: known, values: [[1], [0]]}\n",
     2,
     {0.1, 0.6},
     {0.7, -0.4},
     14},
    {"arm",
     TWO("angle",
         "angle") "system: two-link-arm\nparameters: {masses: [1, 0.7], centres: [0.5, 0.4], inertia: [0.02, "
                  "0.01], "
                  "length: 0.5, gravity: 9.81}\n"
                  "damping: [{kind: known, values: [0.05, 0.05]}, {kind: coulomb, values: [1.5, 0.5]%s}]\n"
                  "input_map: {kind: known, values: [[1], [0.3]]}\n",
     2,
     {0.8, -0.5},
     {0.5, 1.5},
     5},
    {"belt",
     ONE "mass: {kind: known, values: [1]}\npotential: {kind: known, form: quadratic, of: x, values: [10]}\n"
         "damping: [{kind: known, values: [0.2]}, {kind: stribeck, values: [[2], [3.5], [0.1]]%s}]\n"
         "input_map: {kind: known, values: [[1]]}\n",
     1,
     {0.3},
     {0.4},
     4},
    {"incline",
     ONE "mass: {kind: known, values: [1]}\ndamping: [{kind: coulomb, values: [2]%s}]\ninput_map: {kind: "
         "known, values: [[1]]}\n",
     1,
     {0.1234567890123},
     {0},
     0},
};

static void need(bool right, const char *what) {
    if (right) return;
    fprintf(stderr, "friction: %s\n", what);
    exit(1);
}

/* ---- the reference ---- */

static void formulas(const rig *r, const double *q, const double *v, double u, double M[N][N], double *F,
                     double *c) {
    const double g = 9.81;
    if (r == &rigs[TROLLEY]) {
        const double C = cos(q[1]), S = sin(q[1]);
        M[0][0] = 11, M[0][1] = M[1][0] = 0.8 * C, M[1][1] = 0.64;
        F[0] = u - 0.5 * v[0] + 0.8 * S * v[1] * v[1], F[1] = -g * 0.8 * S - 0.05 * v[1];
        c[0] = 6, c[1] = 0;
    } else if (r == &rigs[ARM]) {
        const double a = 0.14, C = cos(q[1]), S = sin(q[1]), second = 0.28 * g * sin(q[0] + q[1]);
        M[1][1] = 0.122, M[0][1] = M[1][0] = M[1][1] + a * C, M[0][0] = 0.445 + M[1][1] + 2 * a * C;
        F[0] = a * S * (2 * v[0] * v[1] + v[1] * v[1]) - 0.85 * g * sin(q[0]) - second - 0.05 * v[0] + u;
        F[1] = -a * S * v[0] * v[0] - second - 0.05 * v[1] + 0.3 * u;
        c[0] = 1.5, c[1] = 0.5;
    } else {
        const bool belt = r == &rigs[BELT];
        M[0][0] = 1, F[0] = u - (belt ? 20 * q[0] + 0.2 * v[0] : 0);
        c[0] = belt ? 2 + 1.5 * exp(-(v[0] / 0.1) * (v[0] / 0.1)) : 2;
    }
}

static double energy(const double *q, const double *v, const rig *r) {
    double M[N][N], F[N], c[N], T = 0;
    formulas(r, q, v, 0, M, F, c);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) T += 0.5 * v[i] * M[i][j] * v[j];
    return r == &rigs[TROLLEY] ? T - 9.81 * 0.8 * cos(q[1])
                               : T - 9.81 * (0.85 * cos(q[0]) + 0.28 * cos(q[0] + q[1]));
}

/* In the mode s: 0 where v sticks or has no friction. */
static void accelerate(const rig *r, const double *q, const double *v, double u, const int *s, double *a,
                       double *hold) {
    double M[N][N], F[N], c[N], A[N][N] = {{0}}, b[N] = {0};
    bool stuck[N] = {false};
    formulas(r, q, v, u, M, F, c);
    for (int i = 0; i < r->n; i++) stuck[i] = s[i] == 0 && c[i] > 0;
    for (int i = 0; i < r->n; i++) {
        b[i] = stuck[i] ? 0 : F[i] - s[i] * c[i];
        for (int j = 0; j < r->n; j++) A[i][j] = stuck[i] || stuck[j] ? i == j : M[i][j];
    }
    const double det = r->n == 1 ? A[0][0] : A[0][0] * A[1][1] - A[0][1] * A[1][0];
    a[0] = (r->n == 1 ? b[0] : b[0] * A[1][1] - b[1] * A[0][1]) / det;
    if (r->n == 2) a[1] = (A[0][0] * b[1] - A[1][0] * b[0]) / det;
    for (int i = 0; i < r->n; i++) {
        double rest = F[i];
        for (int j = 0; j < r->n; j++) rest -= M[i][j] * a[j];
        hold[i] = stuck[i] ? rest / c[i] : 0;
    }
}

static void find_mode(const rig *r, const double *q, const double *v, double u, int *s) {
    static const int signs[3] = {0, 1, -1};
    for (int try = 0; try < 9; try++) {
        double a[N], hold[N], M[N][N], F[N], c[N];
        bool fits = true;
        formulas(r, q, v, u, M, F, c);
        for (int i = 0; i < r->n; i++)
            s[i] = c[i] == 0 ? 0 : v[i] > 0 ? 1 : v[i] < 0 ? -1 : signs[i == 0 ? try % 3 : try / 3];
        accelerate(r, q, v, u, s, a, hold);
        for (int i = 0; i < r->n; i++)
            if (v[i] == 0 && c[i] > 0)
                fits = fits && (s[i] == 0 ? fabs(hold[i]) <= 1 + 1e-12 : s[i] * a[i] > 0);
        if (fits) return;
    }
    need(false, "no mode fits");
}

static void small_step(const rig *r, double *q, double *v, double u, const int *s, double h) {
    static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1, 2, 2, 1};
    double dq[N] = {0}, dv[N] = {0}, kq[N] = {0}, kv[N] = {0}, hold[N];
    for (int j = 0; j < 4; j++) {
        double Q[N] = {0}, V[N] = {0}, a[N];
        for (int i = 0; i < r->n; i++) Q[i] = q[i] + at[j] * h * kq[i], V[i] = v[i] + at[j] * h * kv[i];
        accelerate(r, Q, V, u, s, a, hold);
        for (int i = 0; i < r->n; i++) {
            kq[i] = V[i], kv[i] = a[i];
            dq[i] += h / 6 * weight[j] * kq[i], dv[i] += h / 6 * weight[j] * kv[i];
        }
    }
    for (int i = 0; i < r->n; i++) q[i] += dq[i], v[i] += dv[i];
}

static double margin(const rig *r, const double *q, const double *v, double u, const int *s, int *which) {
    double a[N], hold[N], M[N][N], F[N], c[N], least = INFINITY;
    formulas(r, q, v, u, M, F, c);
    accelerate(r, q, v, u, s, a, hold);
    for (int i = 0; i < r->n; i++) {
        const double x = c[i] == 0 ? INFINITY : s[i] != 0 ? s[i] * v[i] : 1 - fabs(hold[i]);
        if (x < least) least = x, *which = i;
    }
    return least;
}

static void reference(const rig *r, double *q, double *v, double u, double T) {
    for (double left = T; left > 1e-13 * T;) {
        double Q[N], V[N], h = fmin(1e-4, left), a[N], hold[N];
        int s[N], which = 0;
        find_mode(r, q, v, u, s);
        memcpy(Q, q, sizeof Q), memcpy(V, v, sizeof V);
        small_step(r, Q, V, u, s, h);
        if (margin(r, Q, V, u, s, &which) < 0) {
            double low = 0, high = h;
            for (int i = 0; i < 60; i++) {
                h = i < 59 ? (low + high) / 2 : high;
                memcpy(Q, q, sizeof Q), memcpy(V, v, sizeof V);
                small_step(r, Q, V, u, s, h);
                *(margin(r, Q, V, u, s, &which) < 0 ? &high : &low) = h;
            }
            accelerate(r, Q, V, u, s, a, hold);
            V[which] = s[which] != 0 ? 0 : hold[which] > 0 ? 1e-300 : -1e-300;
        }
        memcpy(q, Q, sizeof Q), memcpy(v, V, sizeof V);
        left -= h;
    }
}

/* ---- the library ---- */

typedef struct model {
    lg_machine machine;
    lg_program *program;
    lg_plan *step, *momenta, *velocities;
    void *work;
    int n;
} model;

static lg_plan *plan_of(const lg_program *program, const char *name, size_t *most) {
    lg_plan *plan;
    size_t at;
    need(lg_program_find(program, name, &at, NULL) == LG_OK &&
             lg_plan_create(program, at, NULL, &plan, NULL) == LG_OK,
         name);
    if (lg_plan_work_size(plan) > *most) *most = lg_plan_work_size(plan);
    return plan;
}

static void open_model(const rig *r, double width, model *out) {
    char yaml[2000], key[40] = "";
    lg_machine_file file;
    lg_error error;
    size_t most = 64;
    if (width > 0) snprintf(key, sizeof key, ", width: %g", width);
    snprintf(yaml, sizeof yaml, r->yaml, key);
    need(lg_machine_file_parse(NULL, r->name, yaml, strlen(yaml), &file, &error) == LG_OK, error.message);
    out->machine = file.machine;
    out->n = r->n;
    lg_machine_file_destroy(&file);
    need(lg_machine_program(NULL, &out->machine, NULL, NULL, false, &out->program, &error) == LG_OK,
         error.message);
    out->step = plan_of(out->program, "step", &most);
    out->momenta = plan_of(out->program, "momenta", &most);
    out->velocities = plan_of(out->program, "velocities", &most);
    out->work = aligned_alloc(64, (most + 63) / 64 * 64);
}

static void close_model(model *m) {
    lg_plan_destroy(m->step), lg_plan_destroy(m->momenta), lg_plan_destroy(m->velocities);
    lg_program_destroy(m->program);
    free(m->work);
}

/* Moves the state x by `count` steps in the time T. */
static void steps(const model *m, double *x, double u, double T, int count) {
    const double h = T / count;
    double next[2 * N];
    for (int i = 0; i < count; i++) {
        lg_plan_eval(m->step, (const void *const[]){x, &u, &h}, (void *const[]){next}, m->work);
        memcpy(x, next, 2 * (size_t)m->n * sizeof *x);
    }
}

static void to_state(const model *m, const double *q, const double *v, double *x) {
    lg_plan_eval(m->momenta, (const void *const[]){q, v}, (void *const[]){x}, m->work);
}

/* ---- tables of steps ---- */

enum { PIECES = 400, METHODS = 2 };
static const double PIECE = 0.05;
static const struct {
    const char *name;
    double width;
    int substeps;
} methods[METHODS] = {{"sticks", 0, 1}, {"tanh 0.005 (32 substeps)", 0.005, 32}};

static double input_of(const rig *r, int piece) {
    return r->drive * (sin(0.37 * piece) + (piece / 7 % 3 == 1 ? -0.8 : 0.3));
}

static void accuracy(void) {
    static const int each[3] = {1, 5, 50};
    static double exact[PIECES + 1][N];
    for (int k = 0; k < INCLINE; k++) {
        const rig *r = &rigs[k];
        double q[N] = {r->q[0], r->q[1]}, v[N] = {r->v[0], r->v[1]};
        for (int i = 0; i <= PIECES; i++) {
            memcpy(exact[i], q, sizeof q);
            if (i < PIECES) reference(r, q, v, input_of(r, i), PIECE);
        }
        for (int j = 0; j < METHODS; j++) {
            model m;
            open_model(r, methods[j].width, &m);
            printf("accuracy,%s,%s", r->name, methods[j].name);
            for (int e = 0; e < 3; e++) {
                double x[2 * N], sum = 0;
                to_state(&m, r->q, r->v, x);
                for (int i = 0; i <= PIECES; i++) {
                    for (int d = 0; d < r->n; d++) sum += (x[d] - exact[i][d]) * (x[d] - exact[i][d]) / r->n;
                    if (i < PIECES) steps(&m, x, input_of(r, i), PIECE, each[e] * methods[j].substeps);
                }
                printf(",%.3g", sqrt(sum / (PIECES + 1)));
            }
            printf("\n");
            close_model(&m);
        }
    }
}

static void creep(void) {
    static const double widths[3] = {0, 0.005, 0.03};
    for (int i = 0; i < 3; i++) {
        model m;
        double x[2] = {rigs[INCLINE].q[0], 0};
        open_model(&rigs[INCLINE], widths[i], &m);
        steps(&m, x, 0.9 * 2, 100, 2000 * (i == 0 ? 1 : 32));
        printf("creep,incline,");
        printf(i == 0 ? "sticks" : "tanh %.4g", widths[i]);
        printf(",%.3g\n", x[0] - rigs[INCLINE].q[0]);
        close_model(&m);
    }
}

/* The largest rise of the energy in a step of 50 ms without an input, as a part of the largest energy. */
static void rises(void) {
    for (int k = TROLLEY; k <= ARM; k++)
        for (int j = 0; j < METHODS; j++) {
            const rig *r = &rigs[k];
            lg_rng rng;
            model m;
            double most = 0, size = 0;
            lg_rng_seed(&rng, 5, 0);
            open_model(r, methods[j].width, &m);
            for (int s = 0; s < 300; s++) {
                double q[N], v[N], x[2 * N], before = 0;
                for (int d = 0; d < N; d++)
                    q[d] = lg_rng_uniform_in(&rng, -1.5, 1.5), v[d] = lg_rng_uniform_in(&rng, -2, 2);
                to_state(&m, q, v, x);
                for (int i = 0; i <= 40; i++) {
                    lg_plan_eval(m.velocities, (const void *const[]){x}, (void *const[]){v}, m.work);
                    const double E = energy(x, v, r);
                    size = fmax(size, fabs(E));
                    if (i > 0) most = fmax(most, E - before);
                    before = E;
                    steps(&m, x, 0, 0.05, methods[j].substeps);
                }
            }
            printf("energy,%s,%s,%.3g\n", r->name, methods[j].name, most / size);
            close_model(&m);
        }
}

static double after(const rig *r, const double *start, double u) {
    double q[N] = {start[0], start[1]}, v[N] = {start[2], start[3]};
    reference(r, q, v, u, 1);
    return q[0] + q[1];
}

/* Derivatives of the sum of q after 1 s by the start (q, v): the program's own, step by step. */
static void gradient_of(const rig *r, model *m, double u, int count, double *g) {
    lg_derivative what;
    lg_error error;
    size_t most = 64;
    const double h = 1.0 / count;
    double x[2 * N], J[2 * N][2 * N], S[2 * N][2 * N], of_start[2 * N][2 * N], ju[2 * N], jh[2 * N];
    static const char *const functions[2] = {"step", "momenta"};
    lg_plan *plans[2];
    for (int i = 0; i < 2; i++) {
        lg_derivative_init(&what);
        what.kind = LG_DERIVATIVE_JACOBIAN;
        what.function = functions[i];
        what.name = i == 0 ? "slopes" : "first";
        need(lg_program_derive(m->program, &what, &error) == LG_OK, error.message);
        plans[i] = plan_of(m->program, what.name, &most);
    }
    void *work = aligned_alloc(64, (most + 63) / 64 * 64);
    double by_q[2 * N][N], by_v[2 * N][N];
    lg_plan_eval(plans[1], (const void *const[]){r->q, r->v}, (void *const[]){by_q, by_v}, work);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < N; j++) of_start[i][j] = by_q[i][j], of_start[i][N + j] = by_v[i][j];
    to_state(m, r->q, r->v, x);
    memcpy(S, of_start, sizeof S);
    for (int k = 0; k < count; k++) {
        double moved[2 * N][2 * N] = {{0}};
        lg_plan_eval(plans[0], (const void *const[]){x, &u, &h}, (void *const[]){J, ju, jh}, work);
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++)
                for (int l = 0; l < 4; l++) moved[i][j] += J[i][l] * S[l][j];
        memcpy(S, moved, sizeof S);
        steps(m, x, u, h, 1);
    }
    for (int j = 0; j < 4; j++) g[j] = S[0][j] + S[1][j];
    lg_plan_destroy(plans[0]), lg_plan_destroy(plans[1]);
    free(work);
}

static void gradients(void) {
    static const double inputs[2] = {-3, 0.6};
    static const int counts[3] = {20, 100, 1000};
    for (int k = TROLLEY; k <= ARM; k++)
        for (int j = 0; j < METHODS; j++) {
            const rig *r = &rigs[k];
            const double start[4] = {r->q[0], r->q[1], r->v[0], r->v[1]}, e = 1e-5;
            double exact[4], size = 0;
            for (int i = 0; i < 4; i++) {
                double up[4], down[4];
                memcpy(up, start, sizeof up), memcpy(down, start, sizeof down);
                up[i] += e, down[i] -= e;
                exact[i] = (after(r, up, inputs[k]) - after(r, down, inputs[k])) / (2 * e);
                size = fmax(size, fabs(exact[i]));
            }
            printf("gradient,%s,%s", r->name, methods[j].name);
            for (int c = 0; c < 3; c++) {
                model m;
                double g[4], error = 0;
                open_model(r, methods[j].width, &m);
                gradient_of(r, &m, inputs[k], counts[c] * methods[j].substeps, g);
                for (int i = 0; i < 4; i++) error = fmax(error, fabs(g[i] - exact[i]) / size);
                printf(",%.3g", error);
                close_model(&m);
            }
            printf("\n");
        }
}

/* ---- C ---- */

static void write_c(const char *folder, const char *name, double width) {
    static const char *const ends[2] = {"h", "c"};
    model m;
    lg_c_options options;
    lg_c_source *s;
    lg_error error;
    open_model(&rigs[TROLLEY], width, &m);
    lg_c_options_init(&options);
    options.name = name;
    need(lg_program_write_c(m.program, &options, &s, &error) == LG_OK, error.message);
    for (int i = 0; i < 2; i++) {
        char path[1000];
        snprintf(path, sizeof path, "%s/%s.%s", folder, name, ends[i]);
        FILE *file = fopen(path, "w");
        need(file != NULL, path);
        if (i == 0) fprintf(file, "%s%s", s->sizes, s->declarations);
        if (i == 1)
            fprintf(file, "#include \"%s.h\"\n#include <stddef.h>\n%s%s%s", name, s->arrays, s->code,
                    s->weights);
        fclose(file);
    }
    lg_c_source_destroy(s);
    close_model(&m);
}

static void *symbol_of(const char *library, const char *name) {
    void *handle = dlopen(library, RTLD_NOW);
    need(handle != NULL, library);
    void *found = dlsym(handle, name);
    need(found != NULL, name);
    return found;
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* The least time of 20 batches of 2000 steps along a motion that slides and sticks. */
static void time_step(const char *library, const char *name, int count) {
    typedef void step(const double *x, const double *u, const double *h, double *next, double *work);
    char symbol[100];
    static double work[1 << 16];
    double best = INFINITY;
    snprintf(symbol, sizeof symbol, "%s_step", name);
    step *f;
    *(void **)&f = symbol_of(library, symbol);
    for (int batch = 0; batch < 20; batch++) {
        double x[4] = {0.1, 0.6, 8, 0.3}, next[4];
        const double h = 0.05 / count, begun = now();
        for (int i = 0; i < 2000; i++) {
            const double u = input_of(&rigs[TROLLEY], i);
            for (int k = 0; k < count; k++) {
                f(x, &u, &h, next, work);
                memcpy(x, next, sizeof x);
            }
        }
        need(isfinite(x[0]), "the steps are not finite");
        best = fmin(best, (now() - begun) / 2000);
    }
    printf("time,trolley,%s,%.0f\n", name, 1e9 * best);
}

/* ---- logs ---- */

static void write_log(double hz, int runs, double seconds, double noise, uint64_t seed) {
    const rig *r = &rigs[TROLLEY];
    const int rows = (int)lround(hz * seconds);
    lg_rng rng;
    lg_rng_seed(&rng, seed, 0);
    printf("t,run,x,a,vx,va,u\n");
    for (int run = 0; run < runs; run++) {
        double q[N] = {0}, v[N] = {0}, u = 0;
        for (int i = 0; i < N; i++) q[i] = lg_rng_uniform_in(&rng, -0.5, 0.5);
        for (int i = 0; i <= rows; i++) {
            if (i % (int)lround(0.4 * hz) == 0) u = lg_rng_uniform_in(&rng, -15, 15);
            printf("%.9g,%d,%.12g,%.12g,%.12g,%.12g,%.9g\n", i / hz, run, q[0] + noise * lg_rng_normal(&rng),
                   q[1] + noise * lg_rng_normal(&rng), v[0] + noise * lg_rng_normal(&rng),
                   v[1] + noise * lg_rng_normal(&rng), u);
            reference(r, q, v, u, 1 / hz);
        }
    }
}

/* ---- policies ---- */

enum { MEMORY = 32, PERIODS = 200, HELD = 20 };

typedef struct policy {
    int memory, delay;
    void (*control)(const double *x, double *u, double *work);
    void (*remember)(const double *x, const double *u, double *next, double *work);
    void (*reset)(const double *x, double *first, double *work);
} policy;

/* Whether the trolley and its load are within 0.05 of the goal in the last HELD of PERIODS periods. */
static bool reaches(const policy *p, double *q, double *v) {
    static double work[1 << 16];
    double x[2 * N + MEMORY] = {0}, given[MEMORY] = {0}, next[MEMORY];
    bool good = true;
    for (int i = 0; i < PERIODS; i++) {
        double u;
        memcpy(x, q, N * sizeof *x);
        memcpy(x + N + p->memory, v, N * sizeof *x);
        if (i == 0 && p->memory > 0)
            p->reset(x, next, work), memcpy(x + N, next, (size_t)p->memory * sizeof *x);
        p->control(x, &u, work);
        if (p->memory > 0) p->remember(x, &u, next, work), memcpy(x + N, next, (size_t)p->memory * sizeof *x);
        memmove(given + 1, given, (MEMORY - 1) * sizeof *given);
        given[0] = u;
        reference(&rigs[TROLLEY], q, v, given[p->delay], PIECE);
        if (i >= PERIODS - HELD) good = good && fabs(q[0]) < 0.05 && fabs(q[1]) < 0.05;
    }
    return good;
}

static void run_policy(const char *library, int memory, int delay, int starts, uint64_t seed) {
    policy p = {.memory = memory, .delay = delay};
    lg_rng rng;
    int good = 0;
    need(memory < MEMORY && delay < MEMORY, "too much memory");
    *(void **)&p.control = symbol_of(library, "p_control");
    if (memory > 0)
        *(void **)&p.remember = symbol_of(library, "p_remember"),
               *(void **)&p.reset = symbol_of(library, "p_reset");
    lg_rng_seed(&rng, seed, 0);
    for (int i = 0; i < starts; i++) {
        double q[N] = {lg_rng_uniform_in(&rng, -1, 1), lg_rng_uniform_in(&rng, -0.3, 0.3)},
               v[N] = {lg_rng_uniform_in(&rng, -0.5, 0.5), lg_rng_uniform_in(&rng, -0.5, 0.5)};
        good += reaches(&p, q, v);
    }
    printf("policy,%d,%d\n", good, starts);
}

int main(int argc, char **argv) {
    const char *what = argc > 1 ? argv[1] : "";
    if (strcmp(what, "steps") == 0) {
        accuracy(), creep(), rises(), gradients();
    } else if (strcmp(what, "write") == 0 && argc == 3) {
        write_c(argv[2], "sticking", 0), write_c(argv[2], "soft", 0.005);
    } else if (strcmp(what, "time") == 0 && argc == 5) {
        time_step(argv[2], argv[3], atoi(argv[4]));
    } else if (strcmp(what, "log") == 0 && argc == 7) {
        write_log(atof(argv[2]), atoi(argv[3]), atof(argv[4]), atof(argv[5]), strtoull(argv[6], NULL, 10));
    } else if (strcmp(what, "policy") == 0 && argc == 7) {
        run_policy(argv[2], atoi(argv[3]), atoi(argv[4]), atoi(argv[5]), strtoull(argv[6], NULL, 10));
    } else {
        need(false, "steps | write FOLDER | time LIBRARY NAME COUNT | log HZ RUNS SECONDS NOISE SEED | "
                    "policy LIBRARY MEMORY DELAY STARTS SEED");
    }
    return 0;
}
