/* Detectors: functions of their program, words and golden vectors. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-export/detector.h"
#include "liegrad/convolution.h"
#include "liegrad/detector.h"
#include "liegrad/metrics.h"

enum { GOLDEN_STREAM = 0x64657463, STACK = 1024, CALLS = 2 };

/* ---- code ---- */

static int add_code(const app *self, export_source *source, const lg_model_file *file) {
    const lg_detector_file *trained = lg_model_file_of(file, &lg_recipe_detector);
    const lg_detector *model = &trained->run.model;
    export_function functions[] = {{.function = "value", .name = "eval"},
                                   {.function = "grad", .name = "grad"},
                                   {.function = "probability", .name = "probability"}};
    const size_t scores = (model->classes + 7) / 8 * 8;
    lg_program *program = NULL;
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_model_file_program(file, NULL, &program, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, source->options->file);
    const int code = export_bundle(self, source, program, true, functions, LG_COUNT(functions));
    lg_program_destroy(program);
    if (code != APP_EXIT_OK) return code;
    const size_t classify = scores + functions[2].work;
    const size_t most = functions[0].work > classify ? functions[0].work : classify;
    if (most > source->work) source->work = most;
    source->stack += STACK;
    source->calls += CALLS;
    source->depth = model->net.blocks + (model->net.plane > 0) + 2;
    export_size(source, "EVAL_WORK_SIZE", most, "numbers of work that suffice for all but the gradient");
    export_constant(source, "AT_NET", scores);
    export_code(source, "detector_class");
    export_code(source, "detector_main");
    return APP_EXIT_OK;
}

/* ---- words ---- */

static void add_network(text *to, const lg_detector *model) {
    const lg_cnn *net = &model->net;
    lg_text_add(to, "network       %u blocks, then %s%s\n", net->blocks,
                net->plane > 0 ? "a layer before the output; activation " : "the output layer; activation ",
                lg_activation_name(net->activation));
    for (uint32_t i = 0; i < net->blocks; i++) {
        const lg_cnn_block *b = &net->block[i];
        lg_text_add(to, "              %u: %u filters, kernel %u, stride %u, padding %u; pooling %s", i + 1,
                    b->channels, b->kernel, b->stride, b->padding, lg_pooling_name(b->pooling));
        if (b->pooling != LG_POOL_NONE) lg_text_add(to, " %u/%u", b->pool_size, b->pool_stride);
        lg_text_add(to, "; gives %u samples\n", net->lengths[i + 1]);
    }
    if (net->plane > 0) lg_text_add(to, "              plane: %u\n", net->plane);
}

static void add_scaling(text *to, const lg_detector *model, const lg_scaler *scaler) {
    lg_text_add(to, "scaling       (x - mean)/scale of each channel%s:\n",
                model->centred ? ", after the window's own mean of the channel is taken off" : "");
    for (uint32_t i = 0; i < scaler->channels; i++)
        lg_text_add(to, "              channel %u: mean %.6g, scale %.6g\n", i, scaler->mean[i],
                    scaler->scale[i]);
}

static void add_words(export_source *source, const lg_detector_file *file, const export_window *window) {
    const lg_detector *model = &file->run.model;
    const bool mse = model->loss == LG_DETECTOR_MSE;
    text *to = &source->about;
    lg_text_add(to, "Detector: the class of a window of sensor data, by a convolutional network.\n\n");
    export_window_words(source, window);
    lg_text_add(
        to,
        mse ? "outputs y (1): the logit of class 1 against class 0; its probability is 1/(1 + exp(-y))."
            : "outputs y (%u): a logit a class; probabilities are exp(y_i)/sum_j exp(y_j).",
        window->classes);
    lg_text_add(
        to, " Gradient: d y/d x, one row an output, by the window as recorded. ReLU and maxima have the "
            "derivative of the branch that is taken: within rounding of a kink it may be the other one.\n\n");
    export_window_score_words(to, window);
    if (isfinite(file->test_mse)) lg_text_add(to, "test MSE      %.6g of the probability\n", file->test_mse);
    lg_text_add(to, "\n");
    add_network(to, model);
    add_scaling(to, model, &file->scaler);
    if (source->condition != 1)
        lg_text_add(
            to,
            "tolerance     contains the factor %.6g, as measured on %d windows like the golden ones: 4/(20 "
            "DEPTH) "
            "times the larger of two changes of value and gradient beside their root mean squares, in "
            "roundings; that when weights and samples move by one each, and that between single and double "
            "precision of the library\n",
            source->condition, DETECTOR_WINDOWS);
    lg_text_add(to, "training      %zu of %llu epochs, loss %s, %s; %llu windows\n", file->epochs_done,
                (unsigned long long)file->run.training.epochs, lg_detector_loss_name(model->loss),
                file->run.training.dtype == LG_F32 ? "float" : "double",
                (unsigned long long)file->run.windows);
    export_provenance(source, &file->provenance, file->run.data_sha256);
}

/* ---- golden vectors ---- */

/* Whether no kink is within rounding: a window that is a few units in the last place away has the same
 * Jacobian up to the tolerance. near: outputs x inputs + inputs numbers. */
static bool is_smooth(const export_source *source, const exported_detector *model, const double *x,
                      const double *jacobian, double *near, void *work, lg_rng *rng) {
    const size_t n = source->inputs, all = n * source->outputs;
    const double eps = source->options->dtype == LG_F32 ? (double)FLT_EPSILON : DBL_EPSILON;
    double *moved = near + all, sum = 0, change = 0;
    if (!detector_has_kinks(&model->detector.net)) return true;
    for (int side = 0; side < 2; side++) {
        for (size_t i = 0; i < n; i++)
            moved[i] =
                x[i] + 8 * eps * lg_rng_normal(rng) * model->scaler.scale[i / model->detector.net.length];
        lg_model_jacobian(model->learned, moved, NULL, near, work);
        for (size_t i = 0; i < all; i++) {
            sum += jacobian[i] * jacobian[i];
            change += (near[i] - jacobian[i]) * (near[i] - jacobian[i]);
        }
    }
    const double bound = 10 * eps * (double)source->depth;
    return change <= bound * bound * sum;
}

typedef struct drawing {
    const exported_detector *model;
    lg_rng rng;
    float *window;
    double *near;
    void *work, *score_work;
    lg_detector_plan *scores;
} drawing;

static bool draw(export_source *source, drawing *d, size_t v) {
    const lg_detector *model = &d->model->detector;
    const size_t n = source->inputs;
    export_golden *golden = &source->golden;
    double *x = golden->x + v * n, *extra = golden->extra + v * golden->extras;
    double *jacobian = golden->jacobian + v * n * source->outputs;
    detector_draw_window(source, d->model, &d->rng, x);
    for (size_t i = 0; i < n; i++) d->window[i] = (float)x[i];
    lg_model_jacobian(d->model->learned, x, golden->y + v * source->outputs, jacobian, d->work);
    lg_detector_eval(d->scores, d->window, extra, NULL, d->score_work);
    extra[model->classes] = lg_class_of(extra, model->classes);
    return export_window_clear(extra, model->classes) &&
           is_smooth(source, d->model, x, jacobian, d->near, d->work, &d->rng);
}

/* Windows as noise of the training data's mean and scale; drawn again, a few times, where the class or the
 * gradient is a matter of rounding. */
static int add_golden(const app *self, export_source *source, const exported_detector *model) {
    const lg_detector *detector = &model->detector;
    lg_error error = {LG_OK, ""};
    drawing d = {.model = model,
                 .window = app_alloc(source->inputs, sizeof(float)),
                 .near = app_alloc(source->inputs * (source->outputs + 1), sizeof(double)),
                 .work = app_alloc(lg_model_work_size(model->learned), 1)};
    const lg_status status = lg_detector_plan_create(self->context, detector, &model->scaler, model->theta,
                                                     LG_F64, &d.scores, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, source->options->file);
    d.score_work = app_alloc(lg_detector_work_size(d.scores), 1);
    export_window_golden(source, detector->classes + 1, "probabilities, class");
    lg_rng_seed(&d.rng, source->options->seed, GOLDEN_STREAM);
    for (size_t v = 0; v < source->golden.count; v++)
        for (int attempt = 0; attempt < 20 && !draw(source, &d, v); attempt++) continue;
    export_test_code(source, "test_detector");
    free(d.window);
    free(d.near);
    free(d.work);
    free(d.score_work);
    lg_detector_plan_destroy(d.scores);
    return APP_EXIT_OK;
}

int export_detector(const app *self, const lg_model_file *file, export_source *source) {
    const lg_detector_file *trained = lg_model_file_of(file, &lg_recipe_detector);
    const lg_detector *model = &trained->run.model;
    const export_window window = {
        .channels = model->net.channels,
        .length = model->net.length,
        .classes = model->classes,
        .rate = trained->rate,
        .class_name = trained->class_name,
        .channel_name = trained->channel_name,
        .accuracy = trained->accuracy,
        .f1 = trained->f1,
        .scores = "probabilities",
        .score_words = "It is the one of the largest probability: of two equal ones class 1,\n"
                       " * of more the first.",
    };
    source->inputs = lg_model_inputs(file->model);
    source->outputs = lg_model_outputs(file->model);
    source->parameters = lg_model_parameters(file->model);
    int code = export_window_check(self, source, (double)source->parameters);
    if (code == APP_EXIT_OK) code = add_code(self, source, file);
    if (code != APP_EXIT_OK) return code;
    export_window_code(source, &window);
    const exported_detector exported = {trained->run.model, trained->scaler, trained->theta, file->model};
    const int drawn = add_golden(self, source, &exported);
    if (drawn != APP_EXIT_OK) return drawn;
    const lg_status status = detector_condition(source, &exported, &source->condition);
    if (status != LG_OK) return app_fail(self, status, "rounding of the network");
    add_words(source, trained, &window);
    return APP_EXIT_OK;
}
