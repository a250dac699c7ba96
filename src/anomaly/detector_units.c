/* Finds units whose output is constant, detects networks that died, and gives those new weights. */
#include <math.h>

#include "core/clean.h"
#include "kernels/kernels.h"
#include "anomaly/detector_internal.h"
#include "nn/cnn.h"

enum { STREAM_WEIGHTS = 1 };

void lg_detector_initialise(const lg_detector *model, uint64_t seed, uint64_t restart, double *theta) {
    lg_rng rng;
    lg_rng_seed(&rng, seed, STREAM_WEIGHTS);
    for (uint64_t i = 0; i <= restart; i++) lg_cnn_initialise(&model->net, &rng, theta);
}

/* ---- smallest and largest output of each unit ---- */

typedef struct survey {
    const lg_detector_problem *problem;
    lg_layers layout;
    uint32_t layers; /* number of layers without the output layer */
    size_t units, chunk;
    lg_tape *tape;
    void *theta;       /* parameters in the tape's type */
    double *low;       /* (units) smallest output, layer by layer */
    double *high;      /* (units) largest output */
    double *values;    /* outputs of one layer for one chunk of windows */
    uint32_t *samples; /* (chunk) indices of the windows on the tape */
} survey;

static void survey_end(survey *s) {
    if (s->problem == NULL) return;
    lg_tape_destroy(s->tape);
    LG_FREE_ALL(s->problem->data->context, s->theta, s->low, s->values, s->samples);
}

static lg_status survey_begin(const lg_detector_problem *problem, const double *theta, survey *out) {
    const lg_detector_data *data = problem->data;
    const lg_kernels *k = lg_kernels_for(data->dtype);
    const lg_cnn *net = &problem->model->net;
    LG_CLEAN(survey_end) survey s = {.problem = problem, .chunk = lg_detector_chunk(problem)};
    lg_tape_options options;
    size_t largest = 0; /* values that the largest layer has for one window */
    s.layout = lg_cnn_layers(net);
    s.layers = s.layout.count - 1;
    for (uint32_t i = 0; i < s.layers; i++) {
        const size_t units = s.layout.layer[i].out,
                     values = i < net->blocks ? units * net->lengths[i + 1] : units;
        s.units += units;
        if (values > largest) largest = values;
    }
    lg_tape_options_init(&options);
    options.dtype = data->dtype;
    LG_TRY(LG_ALLOC_ALL(data->context, {&s.theta, s.layout.parameters, k->size},
                        LG_ARRAY(s.low, 2 * s.units + 1), LG_ARRAY(s.values, s.chunk * largest + 1),
                        LG_ARRAY(s.samples, s.chunk)));
    LG_TRY(lg_tape_create(data->context, &options, &s.tape));
    k->convert_in(s.layout.parameters, theta, s.theta);
    s.high = s.low + s.units;
    for (size_t i = 0; i < s.units; i++) s.low[i] = INFINITY, s.high[i] = -INFINITY;
    return LG_GIVE(out, s);
}

/* Evaluates the training windows from .. from + count - 1 and updates low and high of all units. */
static lg_status look(survey *s, size_t from, size_t count) {
    lg_var layers[CNN_MAX_LAYERS];
    size_t at = 0;
    lg_tape_reset(s->tape);
    for (size_t i = 0; i < count; i++) s->samples[i] = (uint32_t)(from + i);
    const lg_var theta = lg_parameter(s->tape, lg_shape1((uint32_t)s->layout.parameters), s->theta);
    const lg_var x = lg_detector_put_windows(s->problem, s->tape, s->samples, (uint32_t)count);
    (void)lg_cnn_record_layers(s->tape, &s->problem->model->net, theta, 0, x, layers);
    LG_TRY(lg_tape_status(s->tape));
    for (uint32_t i = 0; i < s->layers; i++) {
        const size_t units = s->layout.layer[i].out,
                     values = lg_shape_count(lg_var_shape(s->tape, layers[i]));
        LG_TRY(lg_read(s->tape, layers[i], values, s->values));
        double *low = s->low + at, *high = s->high + at;
        for (const double *y = s->values; y < s->values + values; y += units)
            for (size_t u = 0; u < units; u++) {
                low[u] = y[u] < low[u] ? y[u] : low[u];
                high[u] = y[u] > high[u] ? y[u] : high[u];
            }
        at += units;
    }
    return LG_OK;
}

static lg_detector_units conclude(const survey *s) {
    static const double SAME = 1e-6;
    lg_detector_units out = {.layers = s->layers};
    const double *low = s->low, *high = s->high;
    for (uint32_t i = 0; i < s->layers; i++) {
        const uint32_t units = s->layout.layer[i].out;
        out.layer[i].units = units;
        for (uint32_t u = 0; u < units; u++, low++, high++) {
            out.layer[i].constant += *high - *low <= SAME * fmax(1.0, fmax(fabs(*low), fabs(*high)));
            out.layer[i].zero += *low == 0.0 && *high == 0.0;
        }
        out.died = out.died || (out.layer[i].constant == units && s->problem->training > 1);
    }
    return out;
}

/* Counts constant units. If `whole`, all training windows are evaluated. Otherwise evaluation stops as soon
 * as the windows seen so far show that the network has not died. */
static lg_status count(const lg_detector_problem *problem, const double *theta, bool whole,
                       lg_detector_units *out) {
    survey s;
    lg_status status = LG_OK;
    bool enough = false;
    LG_TRY(survey_begin(problem, theta, &s));
    for (size_t at = 0; at < problem->training && status == LG_OK && !enough; at += s.chunk) {
        const size_t rest = problem->training - at;
        status = look(&s, at, rest < s.chunk ? rest : s.chunk);
        enough = status == LG_OK && !whole && !conclude(&s).died;
    }
    if (status == LG_OK) *out = conclude(&s);
    survey_end(&s);
    return status;
}

lg_status lg_detector_count_units(const lg_detector_problem *problem, const double *theta,
                                  lg_detector_units *out) {
    LG_NEEDS(NULL, problem, theta, out);
    return count(problem, theta, true, out);
}

lg_status lg_detector_revive(void *user, uint64_t number, double *theta, bool *dead) {
    const lg_detector_problem *problem = user;
    lg_detector_units units;
    LG_TRY(count(problem, theta, false, &units));
    *dead = units.died;
    if (*dead) lg_detector_initialise(problem->model, problem->seed, number, theta);
    return LG_OK;
}
