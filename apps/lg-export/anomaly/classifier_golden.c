/* Golden vectors of a classifier: windows whose features resemble the training data's, and whose decisions do
 * not depend on rounding errors. */
#include "lg-export/anomaly/classifier.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { GOLDEN_STREAM = 0x636c6173 };
static const double PI = 3.14159265358979323846;

bool classifier_is_constant(const lg_classifier *c) {
    return c->method == LG_METHOD_TREE || c->features.kind == LG_FEATURES_ROCKET;
}

typedef struct drawing {
    const classifier_job *j;
    lg_rng rng;
    float *window;
    /* made: the features that a window is drawn for (d numbers), followed by room for an (m, m) matrix and m
     * numbers. */
    double *feature, *work, *made;
    double *moved; /* Decisions and Jacobian of a slightly moved window. */
    double *point; /* Features and the cotangent of the decisions, as the program's adjoint takes them. */
} drawing;

/* ---- drawing windows ---- */

static void put(const drawing *d, size_t channel, size_t sample, double value) {
    d->window[channel * d->j->c->features.length + sample] = export_window_number(d->j->source, value);
}

/* Draws noise mixed by the symmetric matrix R whose upper triangle is `made`: the square root of its
 * covariance is |R|. */
static void draw_mixed(drawing *d) {
    const lg_features *f = &d->j->c->features;
    const size_t m = f->selected;
    double *root = d->made + d->j->d, *noise = root + m * m;
    for (size_t i = 0, e = 0; i < m; i++)
        for (size_t k = i; k < m; k++, e++) root[i * m + k] = root[k * m + i] = d->made[e];
    for (size_t t = 0; t < f->length; t++) {
        for (size_t k = 0; k < m; k++) noise[k] = lg_rng_normal(&d->rng);
        for (size_t i = 0; i < m; i++) {
            double sum = 0;
            for (size_t k = 0; k < m; k++) sum += root[i * m + k] * noise[k];
            put(d, f->select[i], t, sum * f->scale[f->select[i]]);
        }
    }
}

/* Draws noise whose size `a` varies from part to part; the moment's size follows the line made[0] + made[1]
 * a. */
static void draw_parts(drawing *d) {
    const lg_features *f = &d->j->c->features;
    for (uint32_t p = 0; p < f->pairs; p++) {
        double a = 1;
        uint32_t part = f->segments;
        for (uint32_t t = 0; t < f->length; t++) {
            const uint32_t now = (uint32_t)((uint64_t)t * f->segments / f->length);
            if (now != part) a = lg_rng_uniform_in(&d->rng, 0.5, 1.5);
            part = now;
            const double m = d->made[2 * p] + d->made[2 * p + 1] * a;
            put(d, f->pair[2 * p], t, a * lg_rng_normal(&d->rng) * f->scale[f->pair[2 * p]]);
            put(d, f->pair[2 * p + 1], t, m * lg_rng_normal(&d->rng) * f->scale[f->pair[2 * p + 1]]);
        }
    }
}

/* Draws waves of all frequencies of a segment with random phases, repeated from segment to segment. With
 * amplitude a, their power is segment a^2/4 in every band. */
static void draw_waves(drawing *d) {
    const lg_features *f = &d->j->c->features;
    const lg_spectrum *s = &f->spectrum;
    APP_FREE double *z = app_alloc(s->segment, sizeof *z);
    for (size_t i = 0; i < f->selected; i++) {
        const double *power = d->made + i * f->bands;
        for (uint32_t t = 0; t < s->segment; t++) z[t] = 0;
        for (uint32_t b = 0; b < f->bands; b++)
            for (uint32_t k = s->edge[b]; k < s->edge[b + 1]; k++) {
                const double a = 2 * sqrt(fmax(exp(power[b]) - LG_FEATURES_FLOOR, 0) / s->segment);
                const double phase = lg_rng_uniform_in(&d->rng, 0, 2 * PI);
                for (uint32_t t = 0; t < s->segment; t++)
                    z[t] += a * cos(2 * PI * k * t / s->segment + phase);
            }
        for (size_t t = 0; t < f->length; t++)
            put(d, f->select[i], t, z[t % s->segment] * f->scale[f->select[i]]);
    }
}

/* Draws a window whose features are near `made`; unused channels are noise. */
static void draw_window(drawing *d) {
    const lg_features *f = &d->j->c->features;
    for (size_t c = 0; c < f->channels; c++)
        for (size_t t = 0; t < f->length; t++)
            put(d, c, t,
                lg_rng_normal(&d->rng) * f->scale[c] + (f->rocket.mean != NULL ? f->rocket.mean[c] : 0));
    if (f->kind == LG_FEATURES_COV) draw_mixed(d);
    if (f->kind == LG_FEATURES_BASELINE) draw_parts(d);
    if (f->kind == LG_FEATURES_SPECTRUM) draw_waves(d);
    if (f->kind == LG_FEATURES_RAW || f->kind == LG_FEATURES_STD)
        for (size_t i = 0; i < f->selected; i++)
            for (size_t t = 0; t < f->length; t++)
                put(d, f->select[i], t,
                    f->kind == LG_FEATURES_RAW ? d->made[i * f->length + t]
                                               : d->made[i] * lg_rng_normal(&d->rng));
}

/* ---- results of the library ---- */

/* Computes features and decisions of the window. */
static bool decide(drawing *d, double *y) {
    if (lg_features_compute(&d->j->c->features, d->window, d->feature, d->work) != LG_OK) return false;
    export_evaluate(&d->j->value, d->feature, y);
    return true;
}

/* Computes the derivative of decision o by the features that decide() has computed. */
static void pull_back(drawing *d, size_t o, double *by_features) {
    memcpy(d->point, d->feature, d->j->d * sizeof *d->point);
    for (size_t k = 0; k < d->j->outputs; k++) d->point[d->j->d + k] = k == o;
    export_evaluate(&d->j->pull_back, d->point, by_features);
}

static bool decide_with_jacobian(drawing *d, double *y, double *jacobian) {
    const classifier_job *j = d->j;
    if (!decide(d, y)) return false;
    for (size_t o = 0; o < j->outputs && !classifier_is_constant(j->c); o++) {
        pull_back(d, o, d->made);
        lg_features_reverse(&j->c->features, d->made, jacobian + o * j->source->inputs, d->work);
    }
    return true;
}

/* ---- rounding ---- */

/* Rounding error, in eps, of the logarithm of a power P in a channel whose mean power is A: amplitudes are
 * accurate to eps A^(1/2), so P is accurate to 2 eps (A P)^(1/2). */
static double size_of_power(const lg_features *f, const double *mean, size_t i) {
    const double *bands = mean + i / f->bands * f->bands;
    double sum = 0;
    for (size_t b = 0; b < f->bands; b++) sum += exp(bands[b] - mean[i]);
    return fabs(mean[i]) + 2 * sqrt(sum / f->bands);
}

/* Estimates the rounding error of feature i at the training mean, in eps. For a standard deviation it is the
 * feature itself; for an entry of a matrix root, the norm of the matrix; for the coefficients of a line, a
 * multiple of both coefficients, since the deviations that the line is fitted to are rounded. Windows
 * themselves are exact. */
static double size_of(const classifier_job *j, size_t i) {
    const double *mean = j->c->pca.mean;
    switch (j->c->features.kind) {
    case LG_FEATURES_RAW:
        return 0;
    case LG_FEATURES_STD:
    case LG_FEATURES_ROCKET:
        return fabs(mean[i]);
    case LG_FEATURES_COV:
        return sqrt(2) * export_norm(mean, NULL, j->d);
    case LG_FEATURES_SPECTRUM:
        return size_of_power(&j->c->features, mean, i);
    default:
        return 4 * (fabs(mean[i / 2 * 2]) + fabs(mean[i / 2 * 2 + 1]));
    }
}

/* Returns whether rounding errors leave the results y and the Jacobian within the tolerance: a tree could
 * take another path, and for COV the Jacobian multiplies them by the ratio of the covariance's largest and
 * smallest eigenvalues. It measures this: about half of the samples move by one float, for trees by 64. */
static bool is_steady(drawing *d, const double *y, const double *jacobian) {
    /* Largest accepted change, in units of depth * condition * FLT_EPSILON. Code in double precision rounds
     * to 1e-16, which changes the Jacobian less than this move of the samples does. */
    enum { MOST_GROWTH = 100 };
    const classifier_job *j = d->j;
    const size_t inputs = j->source->inputs, size = j->outputs * inputs;
    const bool tree = j->c->method == LG_METHOD_TREE;
    for (size_t i = 0; i < inputs; i++)
        if (lg_rng_uniform(&d->rng) < 0.5)
            d->window[i] += (tree ? 64 : 1) * (nextafterf(d->window[i], INFINITY) - d->window[i]);
    if (!decide_with_jacobian(d, d->moved, d->moved + j->outputs)) return false;
    if (tree) return memcmp(d->moved, y, j->outputs * sizeof *y) == 0;
    const double allowed = MOST_GROWTH * (double)j->source->depth * j->source->condition,
                 change = export_norm(d->moved + j->outputs, jacobian, size),
                 length = export_norm(jacobian, NULL, size);
    return change <= allowed * (double)FLT_EPSILON * length || length == 0;
}

/* Draws a window whose features are about as far from their means as in training, times `spread`. */
static void draw_like_training(drawing *d, double spread) {
    const lg_pca *pca = &d->j->c->pca;
    for (size_t i = 0; i < d->j->d; i++)
        d->made[i] = pca->mean[i] + spread * pca->scale[i] * lg_rng_normal(&d->rng);
    draw_window(d);
}

/* Returns the factor >= 1 by which the decisions multiply rounding errors: of features that are off by eps
 * size_of, after they are standardised, and of the program itself, as it is measured in single precision. */
static double condition_of(drawing *d) {
    enum { WINDOWS = 50 };
    const classifier_job *j = d->j;
    APP_FREE double *y = app_alloc(j->outputs, sizeof *y), *at = app_alloc(WINDOWS * j->d, sizeof *at);
    double most = 0, decisions = 0, found = 1;
    for (size_t w = 0; w < WINDOWS; w++) {
        double grown = 0;
        draw_like_training(d, 1);
        if (!decide(d, y)) continue;
        decisions += pow(export_norm(y, NULL, j->outputs), 2) / WINDOWS;
        for (size_t i = 0; i < j->d; i++) at[w * j->d + i] = (double)(float)d->feature[i];
        for (size_t o = 0; o < j->outputs; o++) {
            pull_back(d, o, d->made);
            for (size_t i = 0; i < j->d; i++)
                grown += pow(d->made[i] * (j->c->pca.scale[i] + size_of(j, i)), 2);
        }
        most = fmax(most, grown);
    }
    (void)export_amplification(j->program, "value", at, WINDOWS, j->source->depth, &found, NULL);
    return fmax(1, fmax(decisions > 0 ? sqrt(most / decisions) : 1, isfinite(found) ? found : 1));
}

/* Draws golden vector v. Returns false if it has to be drawn again. */
static bool draw(drawing *d, size_t v, double spread, const double *size) {
    const classifier_job *j = d->j;
    export_golden *golden = &j->source->golden;
    const size_t scores = j->c->classes + 1;
    double *x = golden->x + v * j->source->inputs, *score = golden->further[0].values + v * scores;
    double *y = golden->y + v * j->outputs;
    double *jacobian = golden->jacobian + v * j->outputs * j->source->inputs;
    draw_like_training(d, spread);
    for (size_t i = 0; i < j->source->inputs; i++) x[i] = d->window[i];
    if (!decide_with_jacobian(d, y, jacobian)) return false;
    for (size_t i = 0; i < golden->further[1].size; i++)
        golden->further[1].values[v * j->d + i] = d->feature[i] * size[i];
    lg_classifier_score(j->c, d->feature, score, d->work);
    score[j->c->classes] = lg_metrics_class(score, j->c->classes);
    return export_window_clear(score, j->c->classes) &&
           ((j->c->features.kind != LG_FEATURES_COV && j->c->method != LG_METHOD_TREE) ||
            is_steady(d, y, jacobian));
}

void classifier_golden(const classifier_job *j) {
    const lg_classifier *c = j->c;
    const size_t inputs = j->source->inputs, m = c->features.selected;
    drawing d = {.j = j,
                 .window = app_keep(inputs, sizeof(float)),
                 .feature = app_keep(j->d, sizeof(double)),
                 .work = app_keep(lg_classifier_work_size(c), 1),
                 .made = app_keep(j->d + m * m + m, sizeof(double)),
                 .moved = app_keep(j->outputs * (1 + inputs), sizeof(double)),
                 .point = app_keep(j->d + j->outputs, sizeof(double))};
    APP_FREE double *size = app_alloc(j->d, sizeof *size);
    for (size_t i = 0; i < j->d; i++)
        size[i] = export_round(j->source->options, 1 / (fabs(c->pca.mean[i]) + c->pca.scale[i]));
    /* The self-test compares features, in units of their own size. RAW features are the window itself. */
    const size_t features = c->features.kind != LG_FEATURES_RAW ? j->d : 0;
    export_window_golden(j->source, c->classes + 1 + features);
    (void)export_golden_further(j->source, c->classes + 1, "scores, class");
    (void)export_golden_further(j->source, features, features > 0 ? "scores, class, features" : NULL);
    lg_rng_seed(&d.rng, j->source->options->seed, GOLDEN_STREAM);
    if (c->method != LG_METHOD_TREE) j->source->condition = condition_of(&d);
    lg_rng_seed(&d.rng, j->source->options->seed, GOLDEN_STREAM);
    for (size_t v = 0; v < j->source->golden.count; v++)
        for (int attempt = 0; attempt < 30 && !draw(&d, v, attempt < 20 ? 1 : 0.1, size); attempt++) continue;
    if (features > 0) export_reals(j->source, &j->source->test, "feature_size", size, features);
    export_test_code(j->source, features > 0 ? "test_classifier" : "test_detector");
    if (!isfinite(
            export_squares(j->source->options, j->source->golden.y, j->source->golden.count * j->outputs)))
        app_stop(j->self, LG_FILE, "%s: windows like those of the training data have no finite decision",
                 j->source->options->file);
}
