/* Convolutional networks in which all sizes differ from each other. */
#ifndef LG_ODD_NETS_H
#define LG_ODD_NETS_H

#include "liegrad/networks.h"

/* Before lg_cnn_init. The including test sets the activation. Blocks: channels, kernel, stride, padding,
 * pooling. */
static const lg_cnn odd_nets[] = {
    {.channels = 3,
     .length = 23,
     .blocks = 2,
     .block = {{5, 4, 2, 3, LG_POOL_MAX, 3, 1}, {9, 3, 1, 1, LG_POOL_AVERAGE, 2, 3}},
     .plane = 4,
     .outputs = 3},
    {.channels = 2,
     .length = 40,
     .blocks = 3,
     .block = {{17, 5, 3, 0, LG_POOL_NONE, 0, 0},
               {4, 2, 1, 1, LG_POOL_AVERAGE, 3, 2},
               {7, 6, 4, 5, LG_POOL_MAX, 1, 1}},
     .plane = 0,
     .outputs = 2},
    {.channels = 3, .length = 4, .blocks = 0, .plane = 2, .outputs = 1}, /* a perceptron */
    {.channels = 1, .length = 1, .blocks = 0, .plane = 0, .outputs = 1}, /* a line */
    {.channels = 2, .length = 5, .blocks = 0, .plane = 0, .outputs = 2},
    {.channels = 2, .length = 1, .blocks = 0, .plane = 3, .outputs = 3},
    {.channels = 1,
     .length = 1,
     .blocks = 1,
     .block = {{2, 3, 1, 2, LG_POOL_AVERAGE, 3, 1}},
     .plane = 1,
     .outputs = 4},
};
enum { ODD_NETS = LG_COUNT(odd_nets) };

#endif
