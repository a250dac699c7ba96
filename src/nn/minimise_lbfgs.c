/* Limited memory BFGS: the two-loop recursion (Nocedal & Wright, algorithm 7.4). */
#include <string.h>

#include "nn/minimise_internal.h"

/* m->curvature holds a ring of pairs s_0, y_0, s_1, y_1, ..., each vector at a stride; then 1/y.s of each
 * pair; then the recursion's alpha of each pair. It is longer if the Lanczos vectors need more. */
static size_t length(size_t n, const lg_minimise_options *options) {
    const size_t pairs = (size_t)options->memory * (2 * lg_minimise_stride(n) + 2),
                 least = lg_minimise_curvature_length(n, options);
    return pairs > least ? pairs : least;
}

/* m->d = -H g from the pairs numbered below `count`, at most options.memory of them. H_0 = (y.s/y.y) 1, from
 * the newest pair. */
static void recursion(lg_minimiser *m, uint64_t count) {
    const lg_kernels *k = m->k;
    const size_t n = m->n, stride = lg_minimise_stride(n), most = m->options.memory;
    double *pairs = m->curvature, *rho = pairs + 2 * most * stride, *alpha = rho + most;
    const uint64_t held = count < most ? count : most;
    const size_t last = (size_t)((count - 1) % most);
    const double *y = pairs + (2 * last + 1) * stride, scale = 1.0 / (rho[last] * k->dot(n, y, y));
    for (size_t i = 0; i < n; i++) m->d[i] = -m->g[i];
    for (uint64_t back = 1; back <= held; back++) {
        const size_t i = (size_t)((count - back) % most);
        const double *si = pairs + 2 * i * stride;
        alpha[i] = rho[i] * k->dot(n, si, m->d);
        k->axpy(n, -alpha[i], si + stride, m->d);
    }
    for (size_t i = 0; i < n; i++) m->d[i] *= scale;
    for (uint64_t back = held; back >= 1; back--) {
        const size_t i = (size_t)((count - back) % most);
        const double *si = pairs + 2 * i * stride;
        const double beta = rho[i] * k->dot(n, si + stride, m->d);
        k->axpy(n, alpha[i] - beta, si, m->d);
    }
}

static void update(lg_minimiser *m, double *s, double *y) {
    const size_t n = m->n, stride = lg_minimise_stride(n), most = m->options.memory;
    const size_t newest = (size_t)(m->counts.pairs % most);
    double *slot = m->curvature + 2 * newest * stride;
    memcpy(slot, s, n * sizeof *s);
    memcpy(slot + stride, y, n * sizeof *y);
    m->curvature[2 * most * stride + newest] = 1.0 / m->k->dot(n, y, s);
    recursion(m, m->counts.pairs + 1);
}

static void direction(lg_minimiser *m) {
    recursion(m, m->counts.pairs);
}

const lg_minimise_row lg_minimise_lbfgs = {
    .name = "lbfgs", .slow = 200, .creep = 100, .length = length, .update = update, .direction = direction};
