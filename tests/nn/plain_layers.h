/* Layers computed directly from their formulas, one number at a time. */
#ifndef LG_PLAIN_LAYERS_H
#define LG_PLAIN_LAYERS_H

#include <math.h>

#include "liegrad/tape.h"

static inline double plain_activation(lg_activation kind, double x) {
    switch (kind) {
    case LG_TANH:
        return tanh(x);
    case LG_SIGMOID:
        return 1.0 / (1.0 + exp(-x));
    case LG_SWISH:
        return x / (1.0 + exp(-x));
    case LG_RELU:
        return x > 0.0 ? x : 0.0;
    case LG_LEAKY_RELU:
        return x > 0.0 ? x : 0.01 * x;
    case LG_SINE:
        return sin(x);
    case LG_IDENTITY:
        break;
    }
    return x;
}

/* y = sigma(x W + b). The parameters are at *theta, which is moved behind them. */
static inline void plain_dense(const double **theta, size_t in, size_t out, bool bias, lg_activation kind,
                               const double *x, double *y) {
    for (size_t j = 0; j < out; j++) {
        double z = bias ? (*theta)[in * out + j] : 0.0;
        for (size_t i = 0; i < in; i++) z += x[i] * (*theta)[i * out + j];
        y[j] = plain_activation(kind, z);
    }
    *theta += in * out + (bias ? out : 0);
}

#endif
