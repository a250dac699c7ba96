/* Detectors: tables and weights of a convolutional network, words and golden vectors. The functions
 * themselves are those below code/detector. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-export/detector.h"
#include "liegrad/convolution.h"
#include "liegrad/detector.h"
#include "liegrad/metrics.h"

enum { GOLDEN_STREAM = 0x64657463, STACK = 4096 };

/* ---- sizes ---- */

static size_t channels_of(const lg_cnn *net, uint32_t i) {
    return i == 0 ? net->channels : net->block[i - 1].channels;
}

static size_t padding_of(const lg_cnn *net, uint32_t i) {
    return i < net->blocks ? net->block[i].padding : 0;
}

/* Numbers that enter block i, the zeros around them included. */
static size_t padded(const lg_cnn *net, uint32_t i) {
    return (net->lengths[i] + 2 * padding_of(net, i)) * channels_of(net, i);
}

static size_t convolved(const lg_cnn *net, uint32_t i) {
    const lg_cnn_block *b = &net->block[i];
    return (net->lengths[i] + 2 * (size_t)b->padding - b->kernel) / b->stride + 1;
}

static size_t numbers_of(const lg_cnn *net, uint32_t i) {
    return convolved(net, i) * net->block[i].channels;
}

static size_t most(size_t a, size_t b) {
    return a > b ? a : b;
}

/* ---- places in work ---- */

typedef struct places {
    size_t logit, probability, sides, side, activated, plane, reverse_convolved;
    size_t input[LG_CNN_MAX_BLOCKS + 1];
    size_t eval[LG_CNN_MAX_BLOCKS + 1], grad[LG_CNN_MAX_BLOCKS + 1]; /* what the activation works on */
    size_t slope[LG_CNN_MAX_BLOCKS + 1];
    size_t eval_end, end;
} places;

static size_t take(size_t *at, size_t count) {
    const size_t here = *at;
    *at += (count + 7) / 8 * 8;
    return here;
}

/* Inputs of blocks lie in two sides in turn, and so do cotangents on the way back. Beyond what an evaluation
 * needs: slopes, and what a maximum was taken of. */
static places place_all(const lg_detector *model) {
    const lg_cnn *net = &model->net;
    places p = {.side = 0};
    size_t at = 0, pooled = 0, largest = 0;
    for (uint32_t i = 0; i <= net->blocks; i++) p.side = most(p.side, padded(net, i));
    p.side = (p.side + 7) / 8 * 8;
    for (uint32_t i = 0; i < net->blocks; i++) {
        largest = most(largest, numbers_of(net, i));
        if (net->block[i].pooling != LG_POOL_NONE) pooled = most(pooled, numbers_of(net, i));
    }
    p.logit = take(&at, net->outputs);
    p.probability = take(&at, model->classes);
    p.sides = take(&at, 2 * p.side);
    p.activated = take(&at, pooled);
    p.plane = take(&at, net->plane);
    p.eval_end = at;
    p.reverse_convolved = largest > pooled ? take(&at, largest) : p.activated;
    for (uint32_t i = 0; i <= net->blocks; i++) p.input[i] = p.sides + i % 2 * p.side;
    for (uint32_t i = 0; i < net->blocks; i++) {
        const size_t next = p.input[i + 1] + padding_of(net, i + 1) * channels_of(net, i + 1);
        const lg_pooling pooling = net->block[i].pooling;
        p.eval[i] = pooling == LG_POOL_NONE ? next : p.activated;
        p.grad[i] = pooling == LG_POOL_MAX ? take(&at, numbers_of(net, i)) : p.eval[i];
        p.slope[i] = take(&at, numbers_of(net, i));
    }
    p.eval[net->blocks] = p.grad[net->blocks] = p.plane;
    p.slope[net->blocks] = take(&at, net->plane);
    p.end = at;
    return p;
}

/* ---- code ---- */

static void add_weights(export_source *source, const lg_model_file *file) {
    const lg_cnn *net = &file->detector.run.model.net;
    export_part parts[2 * (LG_CNN_MAX_BLOCKS + 2)];
    char comment[LG_COUNT(parts)][128];
    lg_slice_info s;
    uint32_t count = 0;
    for (; count < LG_COUNT(parts) && lg_cnn_slice(net, count, &s); count++) {
        int length = snprintf(comment[count], sizeof comment[count], "%s (", s.name);
        for (uint32_t k = 0; k < s.rank; k++)
            length += snprintf(comment[count] + length, sizeof comment[count] - (size_t)length, "%s%llu%s",
                               k > 0 ? ", " : "", (unsigned long long)s.dims[k], k + 1 == s.rank ? ")" : "");
        parts[count] = (export_part){comment[count], s.count, file->detector.theta + s.offset};
    }
    export_array(source, "weights", parts, count);
}

/* The mean and what its rounding leaves out, and 1/scale. */
static void add_scaler(export_source *source, const lg_scaler *scaler) {
    const size_t n = scaler->channels;
    double *rest = app_alloc(n, sizeof *rest), *inverse = app_alloc(n, sizeof *inverse);
    for (size_t i = 0; i < n; i++) {
        rest[i] = scaler->mean[i] - export_round(source->options, scaler->mean[i]);
        inverse[i] = 1 / scaler->scale[i];
    }
    export_array(source, "mean", &(export_part){"mean of each channel (channels)", n, scaler->mean}, 1);
    export_array(source, "mean_rest", &(export_part){"what its rounding leaves out", n, rest}, 1);
    export_array(source, "inverse_scale", &(export_part){"1/scale of each channel (channels)", n, inverse},
                 1);
    free(rest);
    free(inverse);
}

/* {in, out, weight, bias} of layer number `layer`. */
static void add_layer(text *to, const lg_cnn *net, uint32_t layer) {
    lg_slice_info weight, bias;
    if (!lg_cnn_slice(net, 2 * layer, &weight) || !lg_cnn_slice(net, 2 * layer + 1, &bias)) return;
    lg_text_add(to, "{%zu, %zu, %zu, %zu}", weight.count / bias.count, bias.count, weight.offset,
                bias.offset);
}

static void add_blocks(export_source *source, const lg_cnn *net) {
    text *to = &source->code;
    lg_text_add(
        to,
        "\n/* length, channels, stride, padding, convolved, pooling, pool, pool_stride, pooled, {in, out, "
        "weight,\n * bias} */\nstatic const cnn_block cnn_blocks[] = {\n");
    for (uint32_t i = 0; i < net->blocks; i++) {
        const lg_cnn_block *b = &net->block[i];
        const bool pooled = b->pooling != LG_POOL_NONE;
        lg_text_add(to, "    {%u, %zu, %u, %u, %zu, %d, %u, %u, %u, ", net->lengths[i], channels_of(net, i),
                    b->stride, b->padding, convolved(net, i), (int)b->pooling, pooled ? b->pool_size : 1,
                    pooled ? b->pool_stride : 1, net->lengths[i + 1]);
        add_layer(to, net, i);
        lg_text_add(to, "},\n");
    }
    if (net->blocks == 0)
        lg_text_add(to, "    {0, 0, 0, 0, 0, 0, 0, 0, 0, {0, 0, 0, 0}}, /* there are none */\n");
    lg_text_add(to, "};\n");
    if (net->plane > 0) {
        lg_text_add(to, "static const net_layer cnn_plane = ");
        add_layer(to, net, net->blocks);
        lg_text_add(to, ";\n");
    }
    lg_text_add(to, "static const net_layer cnn_output = ");
    add_layer(to, net, net->blocks + (net->plane > 0));
    lg_text_add(to, ";\n");
}

static void add_places(export_source *source, const lg_cnn *net, const places *p) {
    text *to = &source->code;
    const size_t *const activated[] = {p->eval, p->grad};
    static const char *const names[] = {"eval", "grad"};
    for (size_t k = 0; k < 2; k++) {
        lg_text_add(to, "\n/* input, activated, slope */\nstatic const cnn_place cnn_places_%s[] = {\n",
                    names[k]);
        for (uint32_t i = 0; i <= net->blocks; i++)
            lg_text_add(to, "    {%zu, %zu, %zu},\n", p->input[i], activated[k][i], k == 0 ? 0 : p->slope[i]);
        lg_text_add(to, "};\n");
    }
    lg_text_add(to,
                "/* where arrays begin in work, and how large each of two is that cotangents lie in */\n");
    export_constant(source, "LOGIT", p->logit);
    export_constant(source, "PROBABILITY", p->probability);
    export_constant(source, "REVERSE", p->sides);
    export_constant(source, "REVERSE_SIDE", p->side);
    export_constant(source, "REVERSE_CONVOLVED", p->reverse_convolved);
}

static void add_fragments(export_source *source, const lg_detector *model) {
    const bool plane = model->net.plane > 0;
    const struct {
        const char *name;
        bool wanted;
    } fragments[] = {
        {"cnn_activate", true},
        {"cnn_pool", true},
        {"cnn_tile", true},
        {"cnn_forward", true},
        {"cnn_dense_plane", plane},
        {"cnn_dense", !plane},
        {"rolled", true},
        {"row_products", true},
        {"cnn_dense_plane_vjp", plane},
        {"cnn_dense_vjp", !plane},
        {"cnn_pool_vjp", true},
        {"cnn_reverse", true},
        {"detector_scale", !model->centred},
        {"detector_scale_centred", model->centred},
        {"detector_sigmoid", model->loss == LG_DETECTOR_MSE},
        {"detector_softmax", model->loss != LG_DETECTOR_MSE},
        {"detector_class", true},
        {"detector_main", true},
    };
    export_activation(source, model->net.activation, EXPORT_NET_VJP);
    for (size_t i = 0; i < LG_COUNT(fragments); i++)
        if (fragments[i].wanted) export_code(source, fragments[i].name);
}

static void add_code(export_source *source, const lg_model_file *file) {
    const lg_detector *model = &file->detector.run.model;
    const places p = place_all(model);
    add_weights(source, file);
    add_scaler(source, &file->detector.scaler);
    export_code(source, "dot");
    export_code(source, "noinline");
    export_code(source, "dense_add");
    export_code(source, "dense");
    export_code(source, "cnn_types");
    export_constant(source, "BLOCKS", model->net.blocks);
    add_blocks(source, &model->net);
    add_places(source, &model->net, &p);
    add_fragments(source, model);
    source->work = p.end;
    source->stack += STACK;
    source->depth = model->net.blocks + (model->net.plane > 0) + 2;
    export_size(source, "EVAL_WORK_SIZE", p.eval_end,
                "numbers of work that suffice for all but the gradient");
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
    const lg_detector *model = &file->detector.run.model;
    const export_window window = {
        .channels = model->net.channels,
        .length = model->net.length,
        .classes = model->classes,
        .rate = file->detector.rate,
        .class_name = file->detector.class_name,
        .channel_name = file->detector.channel_name,
        .accuracy = file->detector.accuracy,
        .f1 = file->detector.f1,
        .scores = "probabilities",
        .score_words = "It is the one of the largest probability: of two equal ones class 1,\n"
                       " * of more the first.",
    };
    source->inputs = lg_model_inputs(file->model);
    source->outputs = lg_model_outputs(file->model);
    source->parameters = lg_model_parameters(file->model);
    source->work = place_all(model).end;
    const int code = export_window_check(self, source, (double)source->parameters);
    if (code != APP_EXIT_OK) return code;
    export_window_code(source, &window);
    add_code(source, file);
    const exported_detector exported = {file->detector.run.model, file->detector.scaler, file->detector.theta,
                                        file->model};
    const int drawn = add_golden(self, source, &exported);
    if (drawn != APP_EXIT_OK) return drawn;
    source->condition = detector_condition(source, &exported);
    add_words(source, &file->detector, &window);
    return APP_EXIT_OK;
}
