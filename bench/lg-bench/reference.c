/* Networks in long double, row by row with naive loops: the reference for the fast results. */
#include <math.h>
#include <stdlib.h>

#include "lg-bench/bench.h"

const char bench_long_double[] = "max |x - r| / max |r|, r: the same computation in long double";

long double *reference_widen(const double *x, size_t n) {
    long double *out = app_alloc(n, sizeof *out);
    for (size_t i = 0; i < n; i++) out[i] = x[i];
    return out;
}

double *reference_narrow(const long double *x, size_t n) {
    double *out = app_alloc(n, sizeof *out);
    for (size_t i = 0; i < n; i++) out[i] = (double)x[i];
    return out;
}

/* Values of one row in all layers; layer l begins at l * stride. a: activations. da: their tangents. dz:
 * tangents before the activation. abar, dabar: adjoints of a and da. */
typedef struct layers {
    size_t stride;
    long double *a, *da, *dz, *abar, *dabar;
} layers;

static void forward(const reference_pass *p, const layers *w) {
    for (uint32_t l = 0; l < p->net->layers; l++) {
        const size_t in = p->net->width[l], out = p->net->width[l + 1], at = l * w->stride;
        const double *weight = p->theta + lg_mlp_weight_offset(p->net, l);
        const double *bias = lg_mlp_has_bias(p->net, l) ? p->theta + lg_mlp_bias_offset(p->net, l) : NULL;
        const bool last = l + 1 == p->net->layers;
        long double *z = w->a + at + w->stride, *dz = w->dz + at + w->stride;
        for (size_t j = 0; j < out; j++) z[j] = bias != NULL ? (long double)bias[j] : 0, dz[j] = 0;
        for (size_t i = 0; i < in; i++)
            for (size_t j = 0; j < out; j++) {
                z[j] += w->a[at + i] * weight[i * out + j];
                dz[j] += w->da[at + i] * weight[i * out + j];
            }
        for (size_t j = 0; j < out; j++) {
            if (!last) z[j] = tanhl(z[j]);
            w->da[at + w->stride + j] = last ? dz[j] : (1 - z[j] * z[j]) * dz[j];
        }
    }
}

/* Turns the adjoints of layer l's outputs into the adjoints of its inputs, and adds to the gradient of the
 * parameters. */
static void backward(const reference_pass *p, const layers *w, uint32_t l) {
    const size_t in = p->net->width[l], out = p->net->width[l + 1], at = l * w->stride, next = at + w->stride;
    const size_t place = lg_mlp_weight_offset(p->net, l);
    const double *weight = p->theta + place;
    const bool last = l + 1 == p->net->layers;
    for (size_t j = 0; j < out && !last; j++) { /* Backwards through tanh: h' = 1 - h^2, h'' = -2 h h'. */
        const long double h = w->a[next + j], d1 = 1 - h * h, d2 = -2 * h * d1;
        w->abar[next + j] = w->abar[next + j] * d1 + w->dabar[next + j] * d2 * w->dz[next + j];
        w->dabar[next + j] *= d1;
    }
    for (size_t i = 0; i < in; i++) {
        long double sum = 0, dsum = 0;
        for (size_t j = 0; j < out; j++) {
            sum += weight[i * out + j] * w->abar[next + j];
            dsum += weight[i * out + j] * w->dabar[next + j];
            if (p->gradient != NULL)
                p->gradient[place + i * out + j] +=
                    w->a[at + i] * w->abar[next + j] + w->da[at + i] * w->dabar[next + j];
        }
        w->abar[at + i] = sum;
        w->dabar[at + i] = dsum;
    }
    if (p->gradient != NULL && lg_mlp_has_bias(p->net, l))
        for (size_t j = 0; j < out; j++) p->gradient[lg_mlp_bias_offset(p->net, l) + j] += w->abar[next + j];
}

static void one_row(const reference_pass *p, const layers *w, size_t row) {
    const size_t in = lg_mlp_inputs(p->net), out = lg_mlp_outputs(p->net);
    const size_t end = p->net->layers * w->stride;
    for (size_t i = 0; i < in; i++) {
        w->a[i] = p->x[row * in + i];
        w->da[i] = p->dx != NULL ? p->dx[row * in + i] : 0;
    }
    forward(p, w);
    for (size_t j = 0; j < out; j++) {
        if (p->y != NULL) p->y[row * out + j] = w->a[end + j];
        if (p->dy != NULL) p->dy[row * out + j] = w->da[end + j];
        w->abar[end + j] = p->cy != NULL ? p->cy[row * out + j] : 0;
        w->dabar[end + j] = p->cdy != NULL ? p->cdy[row * out + j] : 0;
    }
    if (p->gradient == NULL && p->input == NULL) return;
    for (uint32_t l = p->net->layers; l-- > 0;) backward(p, w, l);
    for (size_t i = 0; i < in && p->input != NULL; i++) p->input[row * in + i] = w->abar[i];
}

void reference_run(const reference_pass *p) {
    layers w = {.stride = 0};
    for (uint32_t l = 0; l <= p->net->layers; l++)
        if (p->net->width[l] > w.stride) w.stride = p->net->width[l];
    const size_t size = (p->net->layers + 1) * w.stride;
    long double *memory = app_alloc(5 * size, sizeof *memory);
    w.a = memory;
    w.da = memory + size;
    w.dz = memory + 2 * size;
    w.abar = memory + 3 * size;
    w.dabar = memory + 4 * size;
    for (size_t row = 0; row < p->rows; row++) one_row(p, &w, row);
    free(memory);
}
