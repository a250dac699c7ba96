/* lg-bench: named cases, timed the same way. A case sets up its inputs from a fixed seed, measures one or
 * more rows and puts beside each the error of what was computed. */
#ifndef LG_APPS_BENCH_H
#define LG_APPS_BENCH_H

#include "common/app.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/model.h"
#include "liegrad/nn.h"
#include "liegrad/tape.h"

enum { BENCH_ROWS = 96, BENCH_NOTES = 6 };

typedef struct bench_options {
    uint64_t batch, width, links, repeats, epochs;
    int dtype; /* 0: the case's own, 1: f64, 2: f32 */
    const char *only, *out, *weights;
    bool judge;
} bench_options;

/* A further number of a row, by name. */
typedef struct bench_note {
    const char *name; /* static */
    double value;
} bench_note;

/* One measurement. Times are of one call of the work, in microseconds. */
typedef struct bench_row {
    char name[64];
    uint64_t batch, width;   /* 0: does not apply */
    uint64_t samples, inner; /* timed samples, calls in each */
    double median_us, min_us, p10_us, p90_us;
    double error; /* NaN: not known */
    const char *error_is;
    double rate; /* in `unit`; NaN: none */
    const char *unit;
    size_t notes;
    bench_note note[BENCH_NOTES];
    double *series; /* (series_count), or NULL */
    const char *series_is;
    size_t series_count;
} bench_row;

typedef struct bench_case bench_case;

typedef struct bench {
    app *app;
    const bench_case *what;
    const bench_options *given;
    lg_dtype dtype;
    int threads, core; /* core: where the only thread is pinned, -1 for none */
    size_t rows;
    bench_row row[BENCH_ROWS];
} bench;

struct bench_case {
    const char *name, *summary;
    lg_dtype dtype;      /* when --dtype is not given */
    uint64_t batches[4]; /* when --batch is not given; ends with 0 */
    uint64_t width;      /* when --width is not given; 0: the case has none */
    uint64_t epochs;     /* likewise; 0: the case has none */
    void (*run)(bench *b);
};

/* ---- measuring (timing.c) ---- */

/* Pins the process to one of the cores it may use; returns which, -1 when it cannot. Before any thread is
 * made. */
int bench_pin(void);
/* Warms up, then times `call`: short calls in batches of inner iterations, --repeats samples (else 101, fewer
 * when that takes long). NULL when --only asks for other rows. */
bench_row *bench_measure(bench *b, const char *name, void (*call)(void *user), void *user);
/* A row from times measured elsewhere (microseconds; sorted here). */
bench_row *bench_from_samples(bench *b, const char *name, double *us, size_t count);
/* True when --only does not exclude the row. */
bool bench_wanted(const bench *b, const char *name);
void bench_note_add(bench_row *row, const char *name, double value);

/* ---- what cases share (timing.c) ---- */

/* Says what failed and exits with the status' code, unless it is LG_OK. */
void bench_check(const bench *b, lg_status status, const char *what);
/* The model with these parameters; the caller destroys it. */
lg_model *bench_model(const bench *b, const lg_hamiltonian *model, const double *theta);
/* The same for whatever error stands on the tape. */
void bench_check_tape(const bench *b, const lg_tape *tape);
lg_tape *bench_tape(const bench *b, lg_dtype dtype, int threads);
size_t bench_size(lg_dtype dtype); /* of an element */
/* Copies from and to doubles; the caller frees. */
void *bench_typed(lg_dtype dtype, const double *x, size_t n);
double *bench_doubles(lg_dtype dtype, const void *x, size_t n);
/* n numbers of U[-1, 1) from a fixed seed and this stream. */
double *bench_uniform(size_t n, uint64_t stream);
/* Parameters of a network from a fixed seed. */
double *bench_parameters(const lg_mlp *net);
lg_mlp bench_net(const bench *b, uint32_t inputs, uint32_t width, uint32_t hidden, uint32_t outputs,
                 bool last_bias);
/* n doubles as the file --out.ending, for other programs. */
void bench_write_doubles(const bench *b, const char *ending, const double *x, size_t n);
/* max |x - reference| / max |reference|; NaN when either holds one. */
double bench_difference(const double *x, const double *reference, size_t n);
/* The values that --batch or the case's table gives: *count of them. */
const uint64_t *bench_batches(const bench *b, size_t *count);

/* ---- references in long double (reference.c) ---- */

extern const char bench_long_double[]; /* what such an error is relative to */

/* Rows of a network with tanh, naive loops. x (rows, in), dx (rows, in) a tangent or NULL; y, dy (rows, out)
 * or NULL. With cotangents cy, cdy (rows, out; NULL for zero): gradient (parameters) += d(cy.y + cdy.dy)
 * /dtheta when not NULL, input (rows, in) = its derivative in x when not NULL. All finite. */
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
