/* Limited memory BFGS: the two-loop recursion (Nocedal & Wright, algorithm 7.4) from a diagonal H_0, which
 * the pairs update too if they can be n or more (Gilbert & Lemarechal, Math. Prog. 45, 1989). */
#include <math.h>
#include <string.h>

#include "nn/minimise_internal.h"

/* an update leaves at least this part of an element of 1/H_0 */
static const double LEAST_PART = 0.1;

/* `pairs` holds a ring of pairs s_0, y_0, s_1, y_1, ..., each vector at a stride; then 1/y.s of each pair;
 * then the recursion's alpha of each pair; then the diagonal of H_0. */
size_t lg_minimise_pairs_length(size_t n, size_t most) {
    return most * (2 * lg_minimise_stride(n) + 2) + n;
}

const double *lg_minimise_pairs_diagonal(const lg_minimiser *m, const double *pairs, size_t most) {
    return pairs + most * (2 * lg_minimise_stride(m->n) + 2);
}

/* Scales H_0 so that y.H_0 y = y.s. */
static void scale_diagonal(size_t n, const double *y, double ys, double *H) {
    double yhy = 0.0;
    for (size_t i = 0; i < n; i++) yhy += y[i] * y[i] * H[i];
    for (size_t i = 0; i < n; i++) H[i] *= ys / yhy;
}

/* Updates H_0: the diagonal of the BFGS update of 1/H_0. */
static void update_diagonal(size_t n, const double *s, const double *y, double ys, double *H) {
    double sbs = 0.0;
    scale_diagonal(n, y, ys, H);
    for (size_t i = 0; i < n; i++) sbs += s[i] * s[i] / H[i];
    for (size_t i = 0; i < n; i++) {
        const double b = 1.0 / H[i];
        H[i] = 1.0 / fmax(b + y[i] * y[i] / ys - b * s[i] * b * s[i] / sbs, LEAST_PART * b);
    }
}

void lg_minimise_pairs_direction(lg_minimiser *m, double *pairs, size_t most, uint64_t count) {
    const lg_kernels *k = m->k;
    const size_t n = m->n, stride = lg_minimise_stride(n);
    double *rho = pairs + 2 * most * stride, *alpha = rho + most;
    const double *H = lg_minimise_pairs_diagonal(m, pairs, most);
    const uint64_t held = count < most ? count : most;
    k->unary[LG_K_SCALE](n, -1.0, m->g, m->d);
    for (uint64_t back = 1; back <= held; back++) {
        const size_t i = (size_t)((count - back) % most);
        const double *si = pairs + 2 * i * stride;
        alpha[i] = rho[i] * k->dot(n, si, m->d);
        k->axpy(n, -alpha[i], si + stride, m->d);
    }
    for (size_t i = 0; i < n; i++) m->d[i] *= H[i];
    for (uint64_t back = held; back >= 1; back--) {
        const size_t i = (size_t)((count - back) % most);
        const double *si = pairs + 2 * i * stride;
        const double beta = rho[i] * k->dot(n, si + stride, m->d);
        k->axpy(n, alpha[i] - beta, si, m->d);
    }
}

void lg_minimise_pairs_add(lg_minimiser *m, double *pairs, size_t most, const double *s, const double *y) {
    const size_t n = m->n, stride = lg_minimise_stride(n), newest = (size_t)(m->counts.pairs % most);
    const double ys = m->k->dot(n, y, s);
    double *slot = pairs + 2 * newest * stride, *H = pairs + most * (2 * stride + 2);
    memcpy(slot, s, n * sizeof *s);
    memcpy(slot + stride, y, n * sizeof *y);
    pairs[2 * most * stride + newest] = 1.0 / ys;
    /* In L-BFGS n pairs or more tell a diagonal, fewer only its size. */
    const bool size_only = n > most && !m->row->dense;
    if (m->counts.pairs == 0 || size_only) m->k->fill(n, 1.0, H);
    if (!size_only) update_diagonal(n, s, y, ys, H);
    scale_diagonal(n, y, ys, H);
    lg_minimise_pairs_direction(m, pairs, most, m->counts.pairs + 1);
}

/* It is longer if the Lanczos vectors need more. */
static size_t length(size_t n, const lg_minimise_options *options) {
    const size_t pairs = lg_minimise_pairs_length(n, options->memory),
                 least = lg_minimise_curvature_length(n, options);
    return pairs > least ? pairs : least;
}

static void update(lg_minimiser *m, double *s, double *y) {
    lg_minimise_pairs_add(m, m->curvature, m->options.memory, s, y);
}

static void direction(lg_minimiser *m) {
    lg_minimise_pairs_direction(m, m->curvature, m->options.memory, m->counts.pairs);
}

const lg_minimise_row lg_minimise_lbfgs = {
    .name = "lbfgs", .slow = 200, .creep = 50, .length = length, .update = update, .direction = direction};
