/* Activations of networks. Kinks at 0 belong to the branch of x < 0. LeakyReLU's slope is 0.01. */
#ifndef LIEGRAD_ACTIVATION_H
#define LIEGRAD_ACTIVATION_H

#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

typedef enum lg_activation {
    LG_IDENTITY,
    LG_TANH,
    LG_SIGMOID,
    LG_SWISH, /* x sigmoid(x) */
    LG_RELU,
    LG_LEAKY_RELU,
    LG_SINE
} lg_activation;
#define LG_ACTIVATION_COUNT 7
LG_API const char *lg_activation_name(lg_activation kind);

LG_END_DECLS

#endif
