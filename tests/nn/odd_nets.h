/* Convolutional networks in which every size differs from every other. */
#ifndef LG_ODD_NETS_H
#define LG_ODD_NETS_H

#include "liegrad/convolution.h"

/* Before lg_cnn_init; the activation is the user's. */
static const lg_cnn odd_nets[] = {
    {.channels = 3,
     .length = 23,
     .blocks = 2,
     .block = {{.channels = 5,
                .kernel = 4,
                .stride = 2,
                .padding = 3,
                .pooling = LG_POOL_MAX,
                .pool_size = 3,
                .pool_stride = 1},
               {.channels = 9,
                .kernel = 3,
                .stride = 1,
                .padding = 1,
                .pooling = LG_POOL_AVERAGE,
                .pool_size = 2,
                .pool_stride = 3}},
     .plane = 4,
     .outputs = 3},
    {.channels = 2,
     .length = 40,
     .blocks = 3,
     .block = {{.channels = 17, .kernel = 5, .stride = 3, .padding = 0},
               {.channels = 4,
                .kernel = 2,
                .stride = 1,
                .padding = 1,
                .pooling = LG_POOL_AVERAGE,
                .pool_size = 3,
                .pool_stride = 2},
               {.channels = 7,
                .kernel = 6,
                .stride = 4,
                .padding = 5,
                .pooling = LG_POOL_MAX,
                .pool_size = 1,
                .pool_stride = 1}},
     .plane = 0,
     .outputs = 2},
    {.channels = 3, .length = 4, .blocks = 0, .plane = 2, .outputs = 1}, /* a perceptron */
    {.channels = 1, .length = 1, .blocks = 0, .plane = 0, .outputs = 1}, /* a line */
    {.channels = 2, .length = 5, .blocks = 0, .plane = 0, .outputs = 2},
    {.channels = 2, .length = 1, .blocks = 0, .plane = 3, .outputs = 3},
    {.channels = 1,
     .length = 1,
     .blocks = 1,
     .block = {{.channels = 2,
                .kernel = 3,
                .stride = 1,
                .padding = 2,
                .pooling = LG_POOL_AVERAGE,
                .pool_size = 3,
                .pool_stride = 1}},
     .plane = 1,
     .outputs = 4},
};
enum { ODD_NETS = LG_COUNT(odd_nets) };

#endif
