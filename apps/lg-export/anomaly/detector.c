/* Detectors: golden windows like the training data, and the description in NAME.h. */
#include <math.h>

#include "lg-export/faces.h"
#include "liegrad/anomaly.h"
#include "liegrad/networks.h"

static void begin(export_model *m) {
    return export_window_check(m->self, m->source, (double)m->source->parameters);
}

static size_t depth_of(const void *contents) {
    const lg_cnn *net = &((const lg_detector_file *)contents)->run.model.net;
    return net->blocks + (net->plane > 0) + 2;
}

static void describe(const void *contents, export_window *out) {
    const lg_detector_file *file = contents;
    *out = (export_window){file->names, file->run.healthy, NULL, NULL};
    out->names.length = file->run.model.net.length;
}

/* ---- description in NAME.h ---- */

static void add_scaling(text *to, const lg_detector *model, const lg_scaler *scaler) {
    lg_text_add(to, "scaling       (x - mean)/scale of each channel%s:\n",
                model->centred ? ", after the window's own mean of the channel is taken off" : "");
    for (uint32_t i = 0; i < scaler->channels; i++)
        lg_text_add(to, "              channel %u: mean %.6g, scale %.6g\n", i, scaler->mean[i],
                    scaler->scale[i]);
}

static void tell(export_model *m) {
    const lg_detector_file *file = m->file->contents;
    const lg_detector *model = &file->run.model;
    export_source *source = m->source;
    export_window window;
    const bool mse = model->loss == LG_DETECTOR_MSE;
    text *to = &source->about;
    describe(file, &window);
    lg_text_add(to, "Detector: the class of a window of sensor data, by a convolutional network.\n\n");
    export_window_words(source, &window);
    lg_text_add(
        to,
        mse ? "outputs y (1): the logit of class 1 against class 0; its probability is 1/(1 + exp(-y))."
            : "outputs y (%u): a logit a class; probabilities are exp(y_i)/sum_j exp(y_j).",
        window.names.classes);
    lg_text_add(
        to, " Gradient: d y/d x, one row an output, by the window as recorded. ReLU and maxima have the "
            "derivative of the branch that is taken: within rounding of a kink it may be the other one.\n\n");
    export_window_score_words(to, &window);
    lg_text_add(to, "\n");
    add_scaling(to, model, &file->scaler);
    if (source->condition != 1)
        lg_text_add(
            to,
            "tolerance     contains the factor %.6g: the error of single precision, divided by the root mean "
            "square of the results, is at most this times DEPTH roundings on windows like the golden ones\n",
            source->condition);
}

/* ---- golden vectors ---- */

/* Draws a window of noise with the mean and scale of the training data. For detectors that subtract the
 * window's own mean, each channel also gets a random offset. */
static void draw(export_model *m, double *x, size_t v) {
    const lg_detector_file *file = m->file->contents;
    const lg_scaler *scaler = &file->scaler;
    for (size_t c = 0; c < scaler->channels; c++) {
        const double offset = file->run.model.centred ? scaler->scale[c] * lg_rng_normal(&m->rng) : 0;
        export_draw_channel(m, scaler->mean[c] + offset, scaler->scale[c], c, x);
    }
}

/* Returns whether the gradient has kinks, caused by ReLU or maxima. */
static bool has_kinks(const void *contents) {
    const lg_cnn *net = &((const lg_detector_file *)contents)->run.model.net;
    bool kinks = net->activation == LG_RELU || net->activation == LG_LEAKY_RELU;
    for (uint32_t i = 0; i < net->blocks; i++) kinks = kinks || net->block[i].pooling == LG_POOL_MAX;
    return kinks;
}

/* Returns whether the window is far enough from every kink: two random windows that differ from it by a few
 * units in the last place have the same Jacobian up to the tolerance. */
static bool is_smooth(export_model *m, size_t v) {
    const export_source *source = m->source;
    const lg_detector_file *file = m->file->contents;
    const size_t n = source->inputs, all = n * source->outputs;
    const double *x = source->golden.x + v * n, *jacobian = source->golden.jacobian + v * all;
    const double eps = export_eps(source->options);
    APP_FREE double *near = app_alloc(all + n, sizeof *near);
    double *moved = near + all, change = 0;
    for (int side = 0; side < 2 && has_kinks(file); side++) {
        for (size_t i = 0; i < n; i++)
            moved[i] =
                x[i] + 8 * eps * lg_rng_normal(&m->rng) * file->scaler.scale[i / file->run.model.net.length];
        lg_model_jacobian(m->file->model, moved, NULL, near, m->work);
        change = hypot(change, export_norm(near, jacobian, all));
    }
    return change <= 10 * eps * (double)source->depth * sqrt(2) * export_norm(jacobian, NULL, all);
}

const export_kind export_kind_detector = {.recipe = &lg_recipe_detector,
                                          .stream = 0x64657463,
                                          .begin = begin,
                                          .draw = draw,
                                          .is_smooth = is_smooth,
                                          .depth = depth_of,
                                          .kinks = has_kinks,
                                          .window = describe,
                                          .tell = tell};
