/* Second derivatives of small networks: the cases mlp2, mlp2-parts and jvp. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "autodiff/program/program_tape.h"
#include "autodiff/tape/tape_internal.h"
#include "kernels/kernels.h"
#include "core/core.h"
#include "lg-bench/bench.h"
#include "nn/fit_internal.h"
#include "liegrad/ops.h"

/* ---- shared by mlp2 and jvp: a loss over rows, cut into shards that do not depend on the number of threads.
 * The gradient of a chunk is a plan, as in fits of machines, or is recorded each time (--tape) ---- */

typedef struct second second;
typedef lg_var (*loss_fn)(lg_tape *tape, const lg_mlp *net, const lg_mlp_vars *vars, lg_var x);

/* Gradients of chunks of `rows` rows; rows = 0: not made yet. */
typedef struct chunk_plan {
    size_t rows;
    lg_tape *tape;
    lg_plan *plan;
    void *x, *work; /* x: the plan's data; belongs to the tape */
} chunk_plan;

typedef struct piece {
    lg_tape *tape;
    void *gradient, *part; /* part: the gradient of one chunk */
    size_t first, rows;
    chunk_plan whole, rest; /* whole chunks, and the last one */
} piece;

struct second {
    const bench *b;
    lg_mlp net;
    lg_dtype dtype;
    loss_fn loss;
    size_t parameters, rows, pieces;
    void *theta, *x;
    piece *piece;
    lg_thread_pool *pool;
};

static void record_chunk(const second *s, lg_tape *tape, size_t rows, const void *x, lg_var *theta,
                         lg_var *loss) {
    lg_mlp_vars vars;
    *theta = lg_parameter(tape, lg_shape1((uint32_t)s->parameters), s->theta);
    const lg_var in = lg_parameter(tape, lg_shape2((uint32_t)rows, lg_mlp_inputs(&s->net)), x);
    (void)lg_mlp_bind(tape, &s->net, *theta, 0, &vars);
    *loss = s->loss(tape, &s->net, &vars, in);
}

static void chunk_by_tape(const second *s, piece *p, size_t rows, const void *x, bool first) {
    lg_var theta, loss;
    lg_tape_reset(p->tape);
    record_chunk(s, p->tape, rows, x, &theta, &loss);
    (void)(first ? lg_backward_set : lg_backward)(p->tape, loss, &theta, 1, &p->gradient);
}

static void make_plan(const second *s, chunk_plan *c, size_t rows, const void *x) {
    lg_var theta, out[2];
    c->tape = bench_tape(s->b, s->dtype, 1);
    lg_tape_set_dry(c->tape);
    record_chunk(s, c->tape, rows, x, &theta, &out[0]);
    bench_check(s->b, lg_grad(c->tape, out[0], &theta, 1, &out[1]), "recording the gradient");
    bench_check(s->b, lg_plan_of_tape(c->tape, theta, out, 2, rows, &c->plan, &c->x, NULL), "making a plan");
    c->work = lg_alloc(s->b->app->context, lg_plan_work_size(c->plan), 1); /* aligned */
    if (c->work == NULL) bench_check(s->b, LG_OUT_OF_MEMORY, "memory of a plan");
    c->rows = rows;
}

static void chunk_by_plan(const second *s, piece *p, size_t rows, const void *x, bool first) {
    chunk_plan *c = rows == LG_FIT_CHUNK ? &p->whole : &p->rest;
    double loss; /* of the plan's type */
    if (c->rows == 0) make_plan(s, c, rows, x);
    memcpy(c->x, x, rows * lg_mlp_inputs(&s->net) * bench_size(s->dtype));
    lg_plan_eval(c->plan, (const void *const[]){s->theta, c->x},
                 (void *const[]){&loss, first ? p->gradient : p->part}, c->work);
    if (!first) lg_kernels_for(s->dtype)->axpy(s->parameters, 1.0, p->part, p->gradient);
}

static void piece_gradient(void *user, size_t index) {
    const second *s = user;
    piece *p = &s->piece[index];
    const size_t row = lg_mlp_inputs(&s->net) * bench_size(s->dtype);
    for (size_t at = 0; at < p->rows; at += LG_FIT_CHUNK) {
        const size_t rows = p->rows - at < LG_FIT_CHUNK ? p->rows - at : LG_FIT_CHUNK;
        const void *x = (const char *)s->x + (p->first + at) * row;
        (s->b->given->tape ? chunk_by_tape : chunk_by_plan)(s, p, rows, x, at == 0);
    }
}

/* Computes the gradient of the whole batch; it is in the memory of the first piece. */
static void second_call(void *user) {
    const second *s = user;
    lg_thread_pool_run(s->pool, s->pieces, piece_gradient, user);
    for (size_t i = 1; i < s->pieces; i++)
        lg_kernels_for(s->dtype)->axpy(s->parameters, 1.0, s->piece[i].gradient, s->piece[0].gradient);
}

static void second_open(const bench *b, lg_dtype dtype, int threads, const lg_mlp *net, loss_fn loss,
                        const double *theta, const double *x, size_t rows, second *s) {
    *s = (second){.b = b, .net = *net, .dtype = dtype, .loss = loss, .rows = rows};
    s->parameters = lg_mlp_parameters(net);
    s->theta = bench_typed(dtype, theta, s->parameters);
    s->x = bench_typed(dtype, x, rows * lg_mlp_inputs(net));
    s->pieces = lg_fit_pieces(rows, s->parameters, LG_FIT_CHUNK);
    s->piece = app_alloc(s->pieces, sizeof *s->piece);
    for (size_t i = 0; i < s->pieces; i++) {
        piece *p = &s->piece[i];
        p->tape = bench_tape(b, dtype, 1);
        p->gradient = app_alloc(s->parameters, bench_size(dtype));
        p->part = app_alloc(s->parameters, bench_size(dtype));
        p->first = i * rows / s->pieces;
        p->rows = (i + 1) * rows / s->pieces - p->first;
    }
    bench_check(b, lg_thread_pool_create(b->app->context, threads, &s->pool), "making threads");
}

static void close_plan(const second *s, chunk_plan *c) {
    lg_plan_destroy(c->plan);
    lg_tape_destroy(c->tape);
    lg_free(s->b->app->context, c->work);
}

static void second_close(second *s) {
    lg_thread_pool_destroy(s->pool);
    for (size_t i = 0; i < s->pieces; i++) {
        piece *p = &s->piece[i];
        lg_tape_destroy(p->tape);
        free(p->gradient);
        free(p->part);
        close_plan(s, &p->whole);
        close_plan(s, &p->rest);
    }
    free(s->piece);
    free(s->theta);
    free(s->x);
}

/* Computes the gradient once and returns it as doubles. */
static double *second_gradient(const bench *b, second *s) {
    second_call(s);
    for (size_t i = 0; i < s->pieces; i++) bench_check_tape(b, s->piece[i].tape);
    return bench_doubles(s->dtype, s->piece[0].gradient, s->parameters);
}

/* Adds the gradient of the case's loss, computed in long double, to `gradient` (parameters). */
typedef void (*reference_fn)(const lg_mlp *net, const double *theta, const double *x, size_t rows,
                             long double *gradient);

static const char against_doubles[] = "max |x - r| / max |r|, r: the same computation in f64";

/* Computes the row's error: f64 against long double; f32 against f64 with the same (rounded) inputs. In f64,
 * large batches are judged by their first rows alone, since naive long double loops take a second for some
 * 1e8 products. */
static void second_error(const bench *b, const lg_mlp *net, loss_fn loss, reference_fn reference,
                         const double *theta, const double *x, size_t rows, bench_row *row) {
    const size_t n = lg_mlp_parameters(net), affordable = 50000000 / n > 0 ? 50000000 / n : 1;
    const size_t judged = b->dtype == LG_F64 && rows > affordable ? affordable : rows;
    second fast, slow;
    second_open(b, b->dtype, b->threads, net, loss, theta, x, judged, &fast);
    double *found = second_gradient(b, &fast), *expected;
    if (b->dtype == LG_F64) {
        long double *sum = app_alloc(n, sizeof *sum);
        reference(net, theta, x, judged, sum);
        expected = reference_narrow(sum, n);
        free(sum);
    } else {
        double *theta32 = bench_doubles(LG_F32, fast.theta, n);
        double *x32 = bench_doubles(LG_F32, fast.x, rows * lg_mlp_inputs(net));
        second_open(b, LG_F64, 1, net, loss, theta32, x32, judged, &slow);
        expected = second_gradient(b, &slow);
        second_close(&slow);
        free(theta32);
        free(x32);
    }
    row->error = bench_difference(found, expected, n);
    row->error_is = b->dtype == LG_F64 ? bench_long_double : against_doubles;
    free(found);
    free(expected);
    second_close(&fast);
}

/* `products`: number of products of size width x width per row. */
static void second_case(bench *b, const lg_mlp *net, loss_fn loss, reference_fn reference, double products) {
    size_t count;
    const uint64_t *batches = bench_batches(b, &count);
    double *theta = bench_parameters(net);
    for (size_t i = 0; i < count; i++) {
        const size_t rows = (size_t)batches[i];
        const uint32_t width = net->width[1];
        char name[64];
        second s;
        double *x = bench_uniform(rows * lg_mlp_inputs(net), 1);
        (void)snprintf(name, sizeof name, "B=%zu", rows);
        second_open(b, b->dtype, b->threads, net, loss, theta, x, rows, &s);
        free(second_gradient(b, &s));
        bench_row *row = bench_measure(b, name, second_call, &s);
        second_close(&s);
        if (row != NULL) {
            row->batch = rows;
            row->width = width;
            row->rate = products * 2e-3 * (double)rows * width * width / row->median_us;
            row->unit = "GF/s in its large products";
            second_error(b, net, loss, reference, theta, x, rows, row);
        }
        free(x);
    }
    free(theta);
}

/* ---- mlp2: d/dtheta sum |grad_x V|^2 ---- */

static lg_var squared_gradient(lg_tape *tape, const lg_mlp *net, const lg_mlp_vars *vars, lg_var x) {
    return lg_sum(tape, lg_square(tape, lg_mlp_record_gradient(tape, net, vars, x)));
}

/* With u = grad_x V held fixed, d/dtheta |grad_x V|^2 = d/dtheta (2 u . grad_x V): reverse mode applied to a
 * tangent. */
static void squared_gradient_reference(const lg_mlp *net, const double *theta, const double *x, size_t rows,
                                       long double *gradient) {
    const size_t size = rows * lg_mlp_inputs(net);
    long double *wide = reference_widen(x, size), *u = app_alloc(size, sizeof *u);
    long double *one = app_alloc(rows, sizeof *one);
    for (size_t i = 0; i < rows; i++) one[i] = 1;
    reference_run(
        &(reference_pass){.net = net, .theta = theta, .rows = rows, .x = wide, .cy = one, .input = u});
    for (size_t i = 0; i < size; i++) u[i] *= 2;
    reference_run(&(reference_pass){
        .net = net, .theta = theta, .rows = rows, .x = wide, .dx = u, .cdy = one, .gradient = gradient});
    free(wide);
    free(u);
    free(one);
}

static void mlp2_case(bench *b, uint32_t layers) {
    const lg_mlp net = bench_net(b, 3, (uint32_t)b->given->width, layers, 1, false);
    second_case(b, &net, squared_gradient, squared_gradient_reference, 6.0 * (layers - 1));
}

void bench_mlp2(bench *b) {
    mlp2_case(b, 3);
}

void bench_mlp2_small(bench *b) {
    mlp2_case(b, 2);
}

/* ---- jvp: d/dtheta sum |dq/ds|^2 of a curve q(s) in the plane ---- */

static lg_var squared_speed(lg_tape *tape, const lg_mlp *net, const lg_mlp_vars *vars, lg_var s) {
    lg_var q = lg_mlp_record_bound(tape, net, vars, s), speed = LG_NONE;
    lg_var one = lg_full(tape, lg_var_shape(tape, s), 1.0);
    if (lg_jvp(tape, &q, 1, &s, &one, 1, &speed) != LG_OK) return LG_NONE;
    return lg_sum(tape, lg_square(tape, speed));
}

static void squared_speed_reference(const lg_mlp *net, const double *theta, const double *s, size_t rows,
                                    long double *gradient) {
    const size_t size = rows * lg_mlp_outputs(net);
    long double *wide = reference_widen(s, rows), *one = app_alloc(rows, sizeof *one);
    long double *speed = app_alloc(size, sizeof *speed);
    for (size_t i = 0; i < rows; i++) one[i] = 1;
    reference_run(
        &(reference_pass){.net = net, .theta = theta, .rows = rows, .x = wide, .dx = one, .dy = speed});
    for (size_t i = 0; i < size; i++) speed[i] *= 2;
    reference_run(&(reference_pass){
        .net = net, .theta = theta, .rows = rows, .x = wide, .dx = one, .cdy = speed, .gradient = gradient});
    free(wide);
    free(one);
    free(speed);
}

void bench_jvp(bench *b) {
    const lg_mlp net = bench_net(b, 1, (uint32_t)b->given->width, 3, 2, true);
    second_case(b, &net, squared_speed, squared_speed_reference, 12);
}

/* ---- mlp2-parts: the 12 products and the activations, without the rest of mlp2 ---- */

/* Memory is laid out as in mlp2: every layer has its own arrays, which all chunks of rows share. W^T is given
 * and not timed. a: activations of the three layers; g: gradients with respect to the values before
 * activation; r: adjoints of g; z: results. */
typedef struct parts {
    const lg_kernels *k;
    size_t batch, rows, width; /* rows: rows of the chunk that is being computed. */
    bool first;
    void *weight[2], *transposed[2], *dw[2], *a[3], *g[3], *r[3], *z[3];
} parts;

/* c = a w, rows x width x width; for products with W^T, w is the transposed weight. */
static void product(const parts *p, const void *a, const void *w, void *c) {
    p->k->gemm(p->rows, p->width, p->width, a, p->width, 1, w, p->width, c, p->width, false);
}

/* dw = a^T c, or dw += a^T c if `accumulate`. */
static void outer(const parts *p, const void *a, const void *c, void *dw, bool accumulate) {
    p->k->gemm(p->width, p->width, p->rows, a, 1, p->width, c, p->width, dw, p->width, accumulate);
}

static void products(const parts *p) {
    for (int l = 0; l < 2; l++) product(p, p->a[l], p->weight[l], p->z[l + 1]); /* Forward. */
    for (int l = 1; l >= 0; l--)
        product(p, p->g[l + 1], p->transposed[l], p->z[l]); /* Gradient with respect to x. */
    for (int l = 0; l < 2; l++) {                           /* Adjoint of that gradient. */
        product(p, p->r[l], p->weight[l], p->z[l + 1]);
        outer(p, p->r[l], p->g[l + 1], p->dw[l], !p->first);
    }
    for (int l = 1; l >= 0; l--) { /* Adjoint of the values. */
        product(p, p->g[l + 1], p->transposed[l], p->z[l]);
        outer(p, p->a[l], p->g[l + 1], p->dw[l], true);
    }
}

static void activations(const parts *p) {
    for (int l = 0; l < 3; l++) p->k->act(LG_K_TANH, 0, p->rows * p->width, p->a[l], NULL, NULL, p->z[l]);
}

/* Calls the derivatives of tanh as often as mlp2 does: for g sigma' (the gradient), r sigma' and (r g)
 * sigma'' (the gradient's adjoint), and z sigma' (the adjoint of the values). */
static void derivatives(const parts *p) {
    const size_t n = p->rows * p->width;
    for (int l = 0; l < 3; l++) {
        p->k->act(LG_K_TANH, 1, n, NULL, p->a[l], p->g[l], p->z[l]);
        p->k->act(LG_K_TANH, 1, n, NULL, p->a[l], p->r[l], p->z[l]);
        p->k->act(LG_K_TANH, 2, n, NULL, p->a[l], p->r[l], p->z[l]);
        p->k->act(LG_K_TANH, 1, n, NULL, p->a[l], p->g[l], p->z[l]);
    }
}

static void products_and_activations(const parts *p) {
    products(p);
    activations(p);
}

static void all_parts(const parts *p) {
    products_and_activations(p);
    derivatives(p);
}

typedef struct part {
    parts *p;
    void (*run)(const parts *p);
} part;

static void part_call(void *user) {
    const part *one = user;
    parts *p = one->p;
    for (size_t at = 0; at < p->batch; at += p->rows) {
        p->first = at == 0;
        p->rows = p->batch - at < LG_FIT_CHUNK ? p->batch - at : LG_FIT_CHUNK;
        one->run(p);
    }
}

static void *parts_array(const bench *b, size_t n, uint64_t stream) {
    double *x = bench_uniform(n, stream);
    void *typed = bench_typed(b->dtype, x, n);
    free(x);
    return typed;
}

/* Error of the first row of the first forward product: shows that the timed code really computes. */
static double parts_error(const bench *b, const parts *p) {
    const size_t w = p->width;
    double *a = bench_doubles(b->dtype, p->a[0], w), *m = bench_doubles(b->dtype, p->weight[0], w * w),
           *found;
    double *expected = app_alloc(w, sizeof *expected);
    product(p, p->a[0], p->weight[0], p->z[1]);
    found = bench_doubles(b->dtype, p->z[1], w);
    for (size_t j = 0; j < w; j++) {
        long double sum = 0;
        for (size_t i = 0; i < w; i++) sum += (long double)a[i] * m[i * w + j];
        expected[j] = (double)sum;
    }
    const double error = bench_difference(found, expected, w);
    free(a);
    free(m);
    free(found);
    free(expected);
    return error;
}

static void parts_batch(bench *b, size_t rows) {
    static const struct {
        const char *name;
        void (*run)(const parts *p);
        double products;
    } table[] = {{"parts", products_and_activations, 12},
                 {"products", products, 12},
                 {"tanh", activations, 0},
                 {"derivatives", derivatives, 0},
                 {"all", all_parts, 12}};
    const size_t w = (size_t)b->given->width, most = rows < LG_FIT_CHUNK ? rows : LG_FIT_CHUNK;
    parts p = {.k = lg_kernels_for(b->dtype), .batch = rows, .rows = most, .width = w};
    for (uint64_t l = 0; l < 3; l++) {
        void **const arrays[] = {&p.a[l], &p.g[l], &p.r[l], &p.z[l]};
        for (uint64_t i = 0; i < LG_COUNT(arrays); i++) *arrays[i] = parts_array(b, most * w, 10 + 4 * l + i);
    }
    for (uint64_t l = 0; l < 2; l++) {
        p.weight[l] = parts_array(b, w * w, 30 + l);
        p.transposed[l] = parts_array(b, w * w, 32 + l);
        p.dw[l] = parts_array(b, w * w, 34 + l);
    }
    for (size_t i = 0; i < LG_COUNT(table); i++) {
        char name[64];
        (void)snprintf(name, sizeof name, "%s B=%zu", table[i].name, rows);
        bench_row *row = bench_measure(b, name, part_call, &(part){&p, table[i].run});
        if (row == NULL) continue;
        row->batch = rows;
        row->width = w;
        if (table[i].products > 0) {
            row->rate = table[i].products * 2e-3 * (double)(rows * w * w) / row->median_us;
            row->unit = "GF/s";
        }
        row->error = parts_error(b, &p);
        row->error_is = "of the first product, against long double";
    }
    for (int l = 0; l < 3; l++) {
        void *const arrays[] = {p.a[l], p.g[l], p.r[l], p.z[l]};
        for (size_t i = 0; i < LG_COUNT(arrays); i++) free(arrays[i]);
    }
    for (int l = 0; l < 2; l++) {
        free(p.weight[l]);
        free(p.transposed[l]);
        free(p.dw[l]);
    }
}

void bench_mlp2_parts(bench *b) {
    size_t count;
    const uint64_t *batches = bench_batches(b, &count);
    for (size_t i = 0; i < count; i++) parts_batch(b, (size_t)batches[i]);
}
