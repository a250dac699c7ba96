/* Random convolutions of windows: lg_rocket (liegrad/classify.h) has the formulas. */
#ifndef LG_OP_ROCKET_H
#define LG_OP_ROCKET_H

#include "kernels/kernels.h"
#include "liegrad/ops.h"

enum {
    LG_ROCKET_TAPS = 9,
    LG_ROCKET_CHOICES = 84, /* ways to choose 3 of 9: kernels whose weights add up to 0 */
    LG_ROCKET_KERNELS = 96  /* the others have nine weights of 1 */
};

/* A convolution, as lg_rocket_convolution. */
typedef struct lg_rocket_row {
    uint32_t kernel, dilation, padded, channels, features;
} lg_rocket_row;

/* Of `count` rows; `channel` (listed) has their channels: 2 i for channel i, 2 i + 1 if it is subtracted. */
typedef struct lg_rocket_table {
    const lg_rocket_row *row;
    const uint32_t *channel;
    size_t count, listed;
} lg_rocket_table;

/* NULL, or what is wrong with a table for windows of `channels` channels and `length` samples and for this
 * number of features. */
LG_API const char *lg_rocket_check(const lg_rocket_table *table, uint32_t channels, uint32_t length,
                                   uint64_t features);

/* Memory for the convolutions of a window (channels, length), in floats: the scaled channels, zero outside
 * of the window; the sums of their nine taps; one convolution. */
typedef struct lg_rocket_work {
    size_t channels, length, margin, row; /* row: length + 2 margin */
    float rms;                            /* of the scaled window */
    float *z, *sum, *y;
} lg_rocket_work;
/* Sets the addresses in `memory`, which may be NULL, for the largest dilation of the table. Returns the
 * number of floats. */
LG_API size_t lg_rocket_lay_out(const lg_rocket_table *table, size_t channels, size_t length, float *memory,
                                lg_rocket_work *out);
/* z = (x - mean) inverse for each channel, all rounded to float. Returns whether all numbers are finite. */
LG_API bool lg_rocket_scale(const double *x, const double *mean, const double *inverse, lg_rocket_work *w);
/* Computes a convolution from the scaled window. Returns its samples, and in *count how many there are.
 * `unit`: of its thresholds. */
LG_API float *lg_rocket_convolve(const lg_rocket_work *w, const lg_rocket_row *row, const uint32_t *channel,
                                 bool sum_taps, size_t *count, float *unit);

/* The features (B, d) of windows x (B, channels, length), with mean and inverse (channels) and the
 * thresholds bias (d). They have no derivative. `table`: the rows and channels behind each other, kept by
 * the tape. */
LG_API lg_var lg_rocket_record(lg_tape *tape, lg_var x, lg_var mean, lg_var inverse, lg_var bias,
                               const lg_rocket_table *table);

#endif
