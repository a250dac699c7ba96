/* Detectors: convolutional networks that tell the class of a window of sensor data.
 *
 * A window (channels, length) is scaled channel by channel, z = (x - mean)/scale, with the numbers of the
 * training part; with `centred` each window's own mean is subtracted first. Loss:
 *   LG_DETECTOR_MSE            two classes, one output: mean of (sigmoid(y) - label)^2
 *   LG_DETECTOR_CROSS_ENTROPY  an output a class: mean of -log softmax(y)[label]
 */
#ifndef LIEGRAD_DETECTOR_H
#define LIEGRAD_DETECTOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/convolution.h"
#include "liegrad/nn.h"
#include "liegrad/program.h"
#include "liegrad/series.h"

LG_BEGIN_DECLS

typedef enum lg_detector_loss { LG_DETECTOR_MSE, LG_DETECTOR_CROSS_ENTROPY } lg_detector_loss;
#define LG_DETECTOR_LOSS_COUNT 2
LG_API const char *lg_detector_loss_name(lg_detector_loss loss); /* "mse", "cross-entropy" */

/* Plain data. net.outputs is 1 for LG_DETECTOR_MSE, `classes` otherwise. */
typedef struct lg_detector {
    lg_cnn net;
    uint32_t classes; /* >= 2; 2 for LG_DETECTOR_MSE */
    lg_detector_loss loss;
    bool centred;
} lg_detector;
/* `net` must come from lg_cnn_init. Errors: LG_INVALID_ARGUMENT with a sentence. */
LG_API lg_status lg_detector_check(const lg_detector *model, lg_error *error);

/* ---- training ---- */

/* Windows scaled and ordered as the network reads them: (count, length, channels) of `dtype`. Made once. */
typedef struct lg_detector_data {
    size_t count;
    lg_dtype dtype;
    void *x;                   /* (count, length, channels) */
    uint32_t *label;           /* (count) */
    const lg_context *context; /* whose memory the arrays are in */
} lg_detector_data;
/* Makes the data of windows `chosen` (count; NULL: all of them), in this order: the training part first, then
 * the validation part. Errors, with a sentence: LG_SHAPE (channels, length or classes other than the
 * model's), LG_INVALID_ARGUMENT (no windows, or one that does not exist), LG_OUT_OF_MEMORY, LG_NOT_FINITE
 * (overflow in dtype). */
LG_API lg_status lg_detector_data_create(const lg_context *context, const lg_detector *model,
                                         const lg_scaler *scaler, const lg_series *series,
                                         const lg_windows *windows, const uint32_t *chosen, size_t count,
                                         lg_dtype dtype, lg_detector_data *out, lg_error *error);
LG_API void lg_detector_data_destroy(lg_detector_data *data);

/* A model and its data. The first `training` windows are the training part, the others the validation
 * part (lg_fit_problem.validation; set lg_fit_options.keep_best for the parameters of its best epoch).
 * Borrowed. */
typedef struct lg_detector_problem {
    const lg_detector *model;
    const lg_detector_data *data;
    size_t training;
    uint64_t seed; /* of the weights with which a network that died starts again */
} lg_detector_problem;
/* With lg_fit_options.restarts, a network that died (below) starts again with the weights of
 * lg_detector_initialise. */
LG_API void lg_detector_fit_problem(const lg_detector_problem *problem, lg_fit_problem *out);
/* Weights by LG_INIT_FAN_IN: draw number `restart` (0: the first) of one generator with this seed. */
LG_API void lg_detector_initialise(const lg_detector *model, uint64_t seed, uint64_t restart, double *theta);

/* ---- dead units ---- */

/* A unit is a number of the plane, or an output channel of a convolution at all its times, after activation
 * and pooling. It is constant when its least and largest value over all training windows differ by at most
 * 1e-6 max(1, |value|): what is behind it learns nothing of the window from it. Zero: constant, and all
 * values are 0, as those of a ReLU whose argument is never positive; then its own weights have no gradient
 * either. Where all units of a layer are constant, the output is, too, and the network has died: it gives
 * every window the same class, and training cannot change that. */
#define LG_DETECTOR_MAX_LAYERS (LG_CNN_MAX_BLOCKS + 1)
typedef struct lg_detector_units {
    uint32_t layers; /* the convolutions, then the plane where there is one; the output is none of them */
    struct {
        uint32_t units, constant, zero;
    } layer[LG_DETECTOR_MAX_LAYERS];
    bool died; /* false for a single training window */
} lg_detector_units;
/* Counts the units for theta (lg_cnn_parameters), in the type of the data. Errors: LG_OUT_OF_MEMORY, the
 * tape's. */
LG_API lg_status lg_detector_count_units(const lg_detector_problem *problem, const double *theta,
                                         lg_detector_units *out);

/* Settings for levels of the sensors' noise: those published for the subsea well ("thesis"), and our own
 * ("best"). Our own include one for data of unknown noise. */
typedef struct lg_detector_preset {
    const char *name;   /* "thesis", "best" */
    double noise;       /* 1, 10, 50, or NaN: unknown. The nearest preset is taken, else the first */
    const char *source; /* "table 6.5", ... */
    lg_activation activation;
    lg_detector_loss loss;
    lg_training training;
} lg_detector_preset;
/* NULL for an unknown name. Static storage. */
LG_API const lg_detector_preset *lg_detector_preset_find(const char *name, double noise);

/* ---- as a program ---- */

/* A bundle on the parameters `theta`, `mean`, `mean_rest` and `inverse_scale`; x is a window as recorded
 * (channels, length), z a scaled window (length, channels):
 *   value        x -> y, the logits
 *   grad         x -> y, g: (outputs, channels length)
 *   probability  x -> probability (classes)
 *   scores       z -> probability, plane (where the network has one)
 * Errors: those of lg_program_build. */
LG_API lg_status lg_detector_program(const lg_context *context, const lg_detector *model,
                                     const lg_scaler *scaler, const double *theta, lg_program **out,
                                     lg_error *error);

/* ---- use, without a tape ---- */

/* A plan of `scores` above for one window. Immutable: threads may share it, each with its own work memory.
 * Everything is copied. The network computes in `dtype`, to which theta is rounded. Errors: those of
 * lg_detector_program and lg_plan_create. */
typedef struct lg_detector_plan lg_detector_plan;
LG_API lg_status lg_detector_plan_create(const lg_context *context, const lg_detector *model,
                                         const lg_scaler *scaler, const double *theta, lg_dtype dtype,
                                         lg_detector_plan **out, lg_error *error);
LG_API void lg_detector_plan_destroy(lg_detector_plan *plan); /* NULL is fine */
/* Bytes, to be aligned to 64. */
LG_API size_t lg_detector_work_size(const lg_detector_plan *plan);
/* One window x (channels, length), as recorded. probability (classes), plane (net.plane) or NULL. No
 * allocation, no lock. */
LG_API void lg_detector_eval(const lg_detector_plan *plan, const float *x, double *probability, double *plane,
                             void *work);

LG_END_DECLS

#endif
