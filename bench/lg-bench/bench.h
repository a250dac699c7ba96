/* lg-bench: named cases, all timed in the same way. A case makes its inputs from a fixed seed, measures one
 * or more rows, and reports for each row the error of the computed numbers. */
#ifndef LG_APPS_BENCH_H
#define LG_APPS_BENCH_H

#include "common/app.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/model.h"
#include "liegrad/networks.h"
#include "liegrad/tape.h"

enum { BENCH_ROWS = 96, BENCH_NOTES = 6 };

typedef struct bench_options {
    uint64_t batch, width, links, repeats, epochs;
    int dtype; /* 0: the case's own type, 1: f64, 2: f32. */
    const char *only, *out, *weights;
    bool judge, tape;
} bench_options;

/* A further number of a row, with a name. */
typedef struct bench_note {
    const char *name; /* A string literal; not copied. */
    double value;
} bench_note;

/* One measurement. Times are per call of the measured work, in microseconds. */
typedef struct bench_row {
    char name[64];
    uint64_t batch, width;   /* 0: does not apply. */
    uint64_t samples, inner; /* Number of timed samples; number of calls in each sample. */
    double median_us, min_us, p10_us, p90_us;
    double error; /* NaN: not known. */
    const char *error_is;
    double rate; /* In `unit`; NaN: none. */
    const char *unit;
    size_t notes;
    bench_note note[BENCH_NOTES];
    double *series; /* (series_count); NULL: none. Freed by main.c. */
    const char *series_is;
    size_t series_count;
} bench_row;

typedef struct bench_case bench_case;

typedef struct bench {
    app *app;
    const bench_case *what;
    const bench_options *given;
    lg_dtype dtype;
    int threads, core; /* core: the core to which the only thread is pinned; -1: not pinned. */
    size_t rows;
    bench_row row[BENCH_ROWS];
} bench;

struct bench_case {
    const char *name, *summary;
    lg_dtype dtype;      /* Default of --dtype. */
    uint64_t batches[4]; /* Default of --batch: measured one after another; the list ends with 0. */
    uint64_t width;      /* Default of --width; 0: the case has no width. */
    uint64_t epochs;     /* Default of --epochs; 0: the case has no epochs. */
    void (*run)(bench *b);
};

/* ---- measurements (timing.c) ---- */

/* Pins the process to one of the cores that it may use. Returns the core, or -1 on failure. Must be called
 * before any thread is made. */
int bench_pin(void);
/* Warms up, then times `call`. Short calls are timed in batches of `inner` calls. Takes --repeats samples; by
 * default 101, or fewer (at least 5) if they would take more than 4 s. Returns NULL if --only excludes the
 * row. */
bench_row *bench_measure(bench *b, const char *name, void (*call)(void *user), void *user);
/* Makes a row from times measured elsewhere (microseconds). Sorts `us`. */
bench_row *bench_from_samples(bench *b, const char *name, double *us, size_t count);
/* Returns whether --only allows the row. */
bool bench_wanted(const bench *b, const char *name);
void bench_note_add(bench_row *row, const char *name, double value);

/* ---- helpers for the cases (timing.c) ---- */

/* Unless status is LG_OK: prints what failed and exits with the exit code of this status. */
void bench_check(const bench *b, lg_status status, const char *what);
/* Makes the model with these parameters; the caller destroys it. */
lg_model *bench_model(const bench *b, const lg_hamiltonian *model, const double *theta);
/* If the tape has an error: prints it and exits with its exit code. */
void bench_check_tape(const bench *b, const lg_tape *tape);
lg_tape *bench_tape(const bench *b, lg_dtype dtype, int threads);
size_t bench_size(lg_dtype dtype); /* Bytes of an element. */
/* Copy an array: bench_typed from double to `dtype`, bench_doubles from `dtype` to double. The caller frees
 * the copy. */
void *bench_typed(lg_dtype dtype, const double *x, size_t n);
double *bench_doubles(lg_dtype dtype, const void *x, size_t n);
/* Draws n numbers of U[-1, 1) from a fixed seed and the given stream. */
double *bench_uniform(size_t n, uint64_t stream);
/* Initial parameters of a network, from a fixed seed. */
double *bench_parameters(const lg_mlp *net);
lg_mlp bench_net(const bench *b, uint32_t inputs, uint32_t width, uint32_t hidden, uint32_t outputs,
                 bool last_bias);
/* Writes n doubles to the file PREFIX.ending (--out PREFIX), for other programs. */
void bench_write_doubles(const bench *b, const char *ending, const double *x, size_t n);
/* max |x - reference| / max |reference|; NaN if either array holds one. */
double bench_difference(const double *x, const double *reference, size_t n);
/* Batch sizes to measure: --batch, or else the case's list. *count is set. */
const uint64_t *bench_batches(const bench *b, size_t *count);

/* ---- references in long double (reference.c) ---- */

/* Words for the error of a result that was compared with such a reference. */
extern const char bench_long_double[];

/* A network with tanh, evaluated by naive loops over rows. x (rows, in); dx (rows, in), a tangent, or NULL;
 * y, dy (rows, out), outputs, or NULL. cy, cdy (rows, out) are cotangents of y and dy; NULL means zero.
 * gradient (parameters), if not NULL: d(cy.y + cdy.dy)/dtheta is added to it. input (rows, in), if not NULL,
 * is set to the derivative with respect to x. All numbers must be finite. */
typedef struct reference_pass {
    const lg_mlp *net;
    const double *theta;
    size_t rows;
    const long double *x, *dx, *cy, *cdy;
    long double *y, *dy, *gradient, *input;
} reference_pass;
void reference_run(const reference_pass *pass);
long double *reference_widen(const double *x, size_t n);
double *reference_narrow(const long double *x, size_t n);

/* ---- cases ---- */

void bench_mlp2(bench *b);
void bench_mlp2_small(bench *b);
void bench_mlp2_parts(bench *b);
void bench_jvp(bench *b);
void bench_hamiltonian(bench *b);
void bench_elastica(bench *b);
void bench_elastica_solve(bench *b);
void bench_elastica_curve(bench *b);
void bench_cnn(bench *b);
void bench_cnn_parts(bench *b);
void bench_cnn_window(bench *b);
void bench_dense(bench *b);
void bench_adam(bench *b);
void bench_scalar(bench *b);
void bench_scalar_ops(bench *b);
void bench_peak(bench *b);
void bench_gemm(bench *b);
void bench_act(bench *b);
void bench_node(bench *b);
void bench_batch1(bench *b);
void bench_ode(bench *b);

#endif
