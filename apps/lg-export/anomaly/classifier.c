/* Classical classifiers: constants and arrays of the features, the principal components and the model, and
 * the description in NAME.h. The functions themselves are the fragments below code/classifier. */
#include "lg-export/anomaly/classifier.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

enum { STACK = 3072, NAMED_FEATURES = 64 };

static bool is_svm(const lg_classifier *c) {
    return c->method == LG_METHOD_SVM_LINEAR || c->method == LG_METHOD_SVM_RBF;
}

/* ---- linear decisions y = W p + b ---- */

static void add_vectors(const lg_svm *svm, size_t own, size_t other, size_t first, size_t outputs,
                        size_t pair, double *weight) {
    const double *coefficient =
        svm->coefficient + (other > own ? other - 1 : other) * (size_t)svm->vectors + first;
    for (size_t v = 0; v < svm->vectors_of[own]; v++)
        for (size_t i = 0; i < svm->inputs; i++)
            weight[i * outputs + pair] += coefficient[v] * svm->vector[(first + v) * svm->inputs + i];
}

/* With a linear kernel, the sum over the support vectors of a pair of classes is one vector. */
static void sum_vectors(const lg_svm *svm, size_t outputs, classifier_linear *out) {
    size_t pair = 0, first_i = 0;
    for (size_t i = 0; i < svm->classes; first_i += svm->vectors_of[i++]) {
        size_t first_j = first_i + svm->vectors_of[i];
        for (size_t j = i + 1; j < svm->classes; first_j += svm->vectors_of[j++], pair++) {
            const bool has_i = svm->vectors_of[i] > 0, has_j = svm->vectors_of[j] > 0;
            if (svm->classes > 2 && !(has_i && has_j)) {
                out->bias[pair] = (double)has_i - (double)has_j;
                continue;
            }
            add_vectors(svm, i, j, first_i, outputs, pair, out->weight);
            add_vectors(svm, j, i, first_j, outputs, pair, out->weight);
            out->bias[pair] = -svm->rho[pair];
        }
    }
}

static classifier_linear linear_of(const classifier_job *j) {
    classifier_linear out = {app_alloc(j->k * j->outputs, sizeof(double)),
                             app_alloc(j->outputs, sizeof(double))};
    if (j->c->method == LG_METHOD_SVM_LINEAR) {
        sum_vectors(&j->c->svm, j->outputs, &out);
        return out;
    }
    for (size_t o = 0; o < j->outputs; o++) {
        out.bias[o] = j->c->logistic.intercept[o];
        for (size_t i = 0; i < j->k; i++)
            out.weight[i * j->outputs + o] = j->c->logistic.weight[o * j->k + i];
    }
    return out;
}

/* Whether linear decisions read features that are only centred, with weights divided by their scale. A count
 * over the window's length has no digits that the mean's rounding could leave out. */
static bool is_folded(const lg_classifier *c) {
    return c->features.kind == LG_FEATURES_ROCKET && classifier_is_linear(c) && c->pca.components == 0;
}

static void fold_scale(const classifier_job *j, classifier_linear *w) {
    for (size_t i = 0; i < j->k; i++)
        for (size_t o = 0; o < j->outputs; o++) w->weight[i * j->outputs + o] /= j->c->pca.scale[i];
}

/* ---- arrays ---- */

static void add_standardisation(const classifier_job *j) {
    const lg_pca *pca = &j->c->pca;
    export_array(j->source, "mean", &(export_part){"mean of each feature", j->d, pca->mean}, 1);
    if (is_folded(j->c)) return;
    APP_FREE double *rest = app_alloc(j->d, sizeof *rest), *inverse = app_alloc(j->d, sizeof *inverse);
    for (size_t i = 0; i < j->d; i++) {
        rest[i] = pca->mean[i] - export_round(j->source->options, pca->mean[i]);
        inverse[i] = 1 / pca->scale[i];
    }
    if (j->source->options->dtype == LG_F32)
        export_array(j->source, "mean_rest", &(export_part){"what its rounding leaves out", j->d, rest}, 1);
    export_array(j->source, "inverse_deviation", &(export_part){"1/scale of each feature", j->d, inverse}, 1);
}

/* Adds the tables of the spectrum. Columns of s->wave hold cosines and sines times the taper; the taper and
 * all angles are computed from the columns of the first bin. */
static void add_spectrum(const classifier_job *j) {
    const lg_spectrum *s = &j->c->features.spectrum;
    APP_FREE double *taper = app_alloc(s->segment, sizeof *taper),
                    *cosine = app_alloc(s->segment, sizeof *cosine),
                    *sine = app_alloc(s->segment, sizeof *sine);
    for (size_t t = 0; t < s->segment; t++) {
        const double *row = s->wave + t * 2 * s->bins;
        taper[t] = hypot(row[0], row[s->bins]);
        cosine[t] = row[0] / taper[t];
        sine[t] = row[s->bins] / taper[t];
    }
    export_array(j->source, "taper", &(export_part){"window of a segment (segment)", s->segment, taper}, 1);
    export_array(j->source, "cosine", &(export_part){"of 2 pi t/segment", s->segment, cosine}, 1);
    export_array(j->source, "sine", &(export_part){"of 2 pi t/segment", s->segment, sine}, 1);
    export_integers(j->source, "edge", "the first frequency of each band, and the end (bands + 1)", s->edge,
                    (size_t)s->bands + 1);
    export_constant(j->source, "SEGMENT", s->segment);
    export_constant(j->source, "SEGMENTS", s->segments);
    export_constant(j->source, "HOP", s->hop);
    export_constant(j->source, "BANDS", s->bands);
    export_real(j->source, "POWER_FLOOR", LG_FEATURES_FLOOR);
}

static size_t rocket_margin(const lg_rocket *r) {
    return r->count > 0 ? 4 * (size_t)r->convolution[r->count - 1].dilation : 0; /* dilations rise */
}

/* Adds the tables of the convolutions, a column each. */
static void add_rocket(const classifier_job *j) {
    const lg_rocket *r = &j->c->features.rocket;
    static const struct {
        const char *name, *comment;
        size_t offset;
    } columns[] = {
        {"kernel", "kernel of each convolution", offsetof(lg_rocket_convolution, kernel)},
        {"dilation", "distance of its taps", offsetof(lg_rocket_convolution, dilation)},
        {"padded", "0: only samples where all taps lie in the window",
         offsetof(lg_rocket_convolution, padded)},
        {"added", "how many channels it adds up", offsetof(lg_rocket_convolution, channels)},
        {"compared", "how many thresholds it is compared with", offsetof(lg_rocket_convolution, features)},
    };
    APP_FREE uint32_t *column = app_alloc(r->count, sizeof *column);
    APP_FREE double *bias = app_alloc(j->d, sizeof *bias);
    for (size_t i = 0; i < LG_COUNT(columns); i++) {
        for (size_t c = 0; c < r->count; c++)
            memcpy(&column[c], (const char *)&r->convolution[c] + columns[i].offset, sizeof *column);
        export_integers(j->source, columns[i].name, columns[i].comment, column, r->count);
    }
    for (size_t i = 0; i < j->d; i++) bias[i] = (double)r->bias[i];
    export_integers(j->source, "channel", "2 i: channel select[i] is added, 2 i + 1: subtracted", r->channel,
                    r->listed);
    export_array(j->source, "bias", &(export_part){"thresholds, by convolution", j->d, bias}, 1);
    export_array(j->source, "channel_mean",
                 &(export_part){"mean of each channel", j->c->features.channels, r->mean}, 1);
    export_constant(j->source, "CONVOLUTIONS", r->count);
    export_constant(j->source, "MARGIN", rocket_margin(r));
}

/* Returns whether the outputs are constant between thresholds. */
static bool is_constant(const lg_classifier *c) {
    return c->method == LG_METHOD_TREE || c->features.kind == LG_FEATURES_ROCKET;
}

/* Returns whether features of this kind divide the channels by their scale. */
static bool is_scaled(lg_feature_kind kind) {
    return kind != LG_FEATURES_RAW && kind != LG_FEATURES_STD;
}

static void add_features(const classifier_job *j) {
    const lg_features *f = &j->c->features;
    APP_FREE double *inverse = app_alloc(f->channels, sizeof *inverse);
    for (size_t i = 0; i < f->channels; i++) inverse[i] = 1 / f->scale[i];
    if (is_scaled(f->kind))
        export_array(j->source, "inverse_scale",
                     &(export_part){"1/scale of each channel (channels)", f->channels, inverse}, 1);
    if (f->kind == LG_FEATURES_BASELINE)
        export_integers(j->source, "pair", "channels of acceleration and moment (pairs, 2)", f->pair,
                        2 * (size_t)f->pairs);
    else
        export_integers(j->source, "select", "channels that are used", f->select, f->selected);
    if (f->kind == LG_FEATURES_BASELINE) {
        export_constant(j->source, "PAIRS", f->pairs);
        export_constant(j->source, "SEGMENTS", f->segments);
    } else {
        export_constant(j->source, "SELECTED", f->selected);
    }
    if (f->kind == LG_FEATURES_SPECTRUM) add_spectrum(j);
    if (f->kind == LG_FEATURES_ROCKET) add_rocket(j);
}

/* Adds NAME_weights (principal components, then the weights and offsets of linear decisions) and the layers
 * that read it. */
static void add_layers(const classifier_job *j, const classifier_linear *w) {
    const lg_pca *pca = &j->c->pca;
    const size_t components = pca->components > 0 ? j->d * j->k : 0, rows = j->k * j->outputs;
    export_part parts[3];
    char comments[2][96];
    size_t count = 0;
    if (components == 0 && !classifier_is_linear(j->c)) return;
    (void)snprintf(comments[0], sizeof comments[0], "principal components (%zu, %zu)", j->d, j->k);
    (void)snprintf(comments[1], sizeof comments[1], "weights of the decisions (%zu, %zu)", j->k, j->outputs);
    if (components > 0) parts[count++] = (export_part){comments[0], components, pca->vectors};
    if (classifier_is_linear(j->c)) parts[count++] = (export_part){comments[1], rows, w->weight};
    if (classifier_is_linear(j->c)) parts[count++] = (export_part){"their offsets", j->outputs, w->bias};
    export_array(j->source, "weights", parts, count);
    export_code(j->source, "dot");
    export_code(j->source, "noinline");
    export_code(j->source, "dense_add");
    export_code(j->source, "dense");
    lg_text_add(&j->source->code, "\n");
    if (components > 0)
        lg_text_add(&j->source->code, "static const net_layer components = {%zu, %zu, 0, -1};\n", j->d, j->k);
    if (classifier_is_linear(j->c))
        lg_text_add(&j->source->code, "static const net_layer decisions = {%zu, %zu, %zu, %zu};\n", j->k,
                    j->outputs, components, components + rows);
}

static void add_tree(const classifier_job *j) {
    const lg_tree *tree = &j->c->tree;
    const size_t n = tree->count, classes = tree->classes;
    uint32_t *feature = app_alloc(n, sizeof *feature), *left = app_alloc(n, sizeof *left),
             *right = app_alloc(n, sizeof *right), leaves = 0;
    APP_FREE double *threshold = app_alloc(n, sizeof *threshold),
                    *fraction = app_alloc(n * classes, sizeof *fraction);
    for (size_t i = 0; i < n; i++) {
        const lg_tree_node *node = &tree->node[i];
        left[i] = node->left;
        right[i] = node->left != 0 ? node->right : leaves;
        if (node->left != 0) {
            feature[i] = node->feature;
            threshold[i] = node->threshold;
            continue;
        }
        for (size_t k = 0; k < classes; k++)
            fraction[leaves * classes + k] = tree->counts[i * classes + k] / (double)node->samples;
        leaves++;
    }
    export_integers(j->source, "feature", "number that a node compares (nodes)", feature, n);
    export_array(j->source, "threshold", &(export_part){"at most this: to the left (nodes)", n, threshold},
                 1);
    export_integers(j->source, "left", "left child, 0: a leaf (nodes)", left, n);
    export_integers(j->source, "right", "right child, of a leaf its row of fractions (nodes)", right, n);
    export_array(j->source, "fractions",
                 &(export_part){"of the classes in each leaf (leaves, classes)", leaves * classes, fraction},
                 1);
    free(feature);
    free(left);
    free(right);
}

static void add_svm(const classifier_job *j) {
    const lg_svm *svm = &j->c->svm;
    if (j->c->method == LG_METHOD_SVM_RBF || svm->classes > 2)
        export_integers(j->source, "vectors_of", "support vectors of each class (classes)", svm->vectors_of,
                        svm->classes);
    if (j->c->method != LG_METHOD_SVM_RBF) return;
    const size_t v = svm->vectors, classes = svm->classes;
    export_array(j->source, "vector",
                 &(export_part){"support vectors, by class (vectors, numbers)", v * svm->inputs, svm->vector},
                 1);
    export_array(
        j->source, "coefficient",
        &(export_part){"their coefficients (classes - 1, vectors)", (classes - 1) * v, svm->coefficient}, 1);
    export_array(j->source, "rho", &(export_part){"of each pair of classes", j->outputs, svm->rho}, 1);
    export_constant(j->source, "VECTORS", v);
    export_real(j->source, "GAMMA", svm->gamma);
}

/* ---- code ---- */

static size_t features_work(const lg_features *f) {
    const size_t m = f->selected, length = f->length;
    switch (f->kind) {
    case LG_FEATURES_RAW:
        return 0;
    case LG_FEATURES_STD:
        return length;
    case LG_FEATURES_COV:
        return m * (length + 3 * m + 2);
    case LG_FEATURES_SPECTRUM:
        return 2 * length + f->spectrum.segment + m * f->bands;
    case LG_FEATURES_ROCKET:
        return 2 * m * (length + rocket_margin(&f->rocket)) + length;
    default:
        return length + 2 * (size_t)f->segments * f->pairs;
    }
}

/* Adds the constants that say where arrays begin in `work`. REST must be first, at 0: NAME_features uses all
 * of its `work` as REST. */
static void add_places(const classifier_job *j) {
    const lg_classifier *c = j->c;
    const size_t kernel = c->method == LG_METHOD_SVM_RBF ? c->svm.vectors : 0;
    const bool gradient = !is_constant(c);
    const struct {
        const char *name;
        size_t count;
        bool wanted;
    } rows[] = {{"REST", features_work(&c->features), true},
                {"COMPUTED", j->d, true},
                {"STANDARDISED", j->d, true},
                {"PROJECTED", c->pca.components, c->pca.components > 0},
                {"KERNEL", kernel > c->classes ? kernel : c->classes, true},
                {"DECIDED", j->outputs, true},
                {"SCORES", c->classes, true},
                {"BY_PROJECTED", j->k, gradient},
                {"BY_FEATURES", j->d, gradient}};
    size_t at = 0;
    lg_text_add(&j->source->code, "\n/* where arrays begin in work */\n");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        if (!rows[i].wanted) continue;
        export_constant(j->source, rows[i].name, at);
        at += (rows[i].count + 7) / 8 * 8;
    }
    if (!classifier_is_linear(c)) export_constant(j->source, "PROJECTIONS", j->k);
    j->source->work = at;
}

static void add_fragments(const classifier_job *j) {
    static const char *const kinds[LG_FEATURE_KIND_COUNT] = {
        [LG_FEATURES_RAW] = "features_raw",           [LG_FEATURES_STD] = "features_std",
        [LG_FEATURES_COV] = "features_cov",           [LG_FEATURES_SPECTRUM] = "features_spectrum",
        [LG_FEATURES_BASELINE] = "features_baseline", [LG_FEATURES_ROCKET] = "features_rocket",
    };
    const lg_classifier *c = j->c;
    const lg_feature_kind kind = c->features.kind;
    const bool raw = kind == LG_FEATURES_RAW, cov = kind == LG_FEATURES_COV,
               deviations = kind == LG_FEATURES_STD || kind == LG_FEATURES_BASELINE, two = c->classes == 2,
               tree = c->method == LG_METHOD_TREE, rbf = c->method == LG_METHOD_SVM_RBF,
               rocket = kind == LG_FEATURES_ROCKET, slopes = !is_constant(c),
               ridge = c->method == LG_METHOD_RIDGE, single = j->source->options->dtype == LG_F32,
               pca = c->pca.components > 0, folded = is_folded(c);
    char vjp[64];
    (void)snprintf(vjp, sizeof vjp, "%s_vjp", kinds[kind]);
    const struct {
        const char *name;
        bool wanted;
    } fragments[] = {
        {"rolled", true},
        {"features_sums", !(raw || rocket) || rbf},
        {"features_centre", !(raw || rocket)},
        {"features_cov_factor", cov},
        {kinds[kind], true},
        {"features_deviation_vjp", slopes && deviations},
        {vjp, slopes},
        {"features_subtract", folded},
        {"features_standardise_rest", single && !folded},
        {"features_standardise", !single && !folded},
        {pca ? "project" : "project_none", true},
        {"row_products", pca && slopes},
        {pca ? "project_vjp" : "project_none_vjp", slopes},
        {"decide_rows", classifier_is_linear(c)},
        {"decide_rows_vjp", classifier_is_linear(c) && slopes},
        {"tree", tree},
        {"svm_distance", rbf},
        {"svm_rbf", rbf},
        {"svm_rbf_vjp", rbf && slopes},
        {"tree_scores", tree || (ridge && !two)},
        {"ridge_two_scores", ridge && two},
        {"scores_sigmoid", c->method == LG_METHOD_LOGISTIC && two},
        {"scores_softmax", c->method == LG_METHOD_LOGISTIC && !two},
        {"svm_two_scores", is_svm(c) && two},
        {"svm_votes", is_svm(c) && !two},
        {"detector_class", true},
        {"classifier_main", true},
        {slopes ? "classifier_grad" : "classifier_grad_zero", true},
    };
    for (size_t i = 0; i < LG_COUNT(fragments); i++)
        if (fragments[i].wanted) export_code(j->source, fragments[i].name);
}

static void add_code(const classifier_job *j, const classifier_linear *w) {
    export_size(j->source, "FEATURES", j->d, "numbers that are made of a window");
    add_features(j);
    add_standardisation(j);
    add_layers(j, w);
    if (j->c->method == LG_METHOD_TREE) add_tree(j);
    if (is_svm(j->c)) add_svm(j);
    add_places(j);
    add_fragments(j);
    lg_text_add_named(&j->source->declarations, j->source->options->name,
                      "/* The features of a window (NAME_FEATURES), before standardisation. */\n"
                      "void NAME_features(const NAME_real *window, NAME_real *features, NAME_real *work);\n");
}

/* ---- description in NAME.h ---- */

static void add_outputs(const classifier_job *j, text *to) {
    const bool two = j->c->classes == 2;
    if (j->c->method == LG_METHOD_TREE)
        lg_text_add(to,
                    "outputs y (%zu): fractions of the classes among the training windows of the leaf. "
                    "Gradient: 0 everywhere, since\nthe fractions change at thresholds only; a window within "
                    "rounding of one may fall on its other side.\n\n",
                    j->outputs);
    else if (j->c->method == LG_METHOD_LOGISTIC && two)
        lg_text_add(to, "outputs y (1): the logit of class 1; its probability is 1/(1 + exp(-y)).");
    else if (j->c->method == LG_METHOD_LOGISTIC)
        lg_text_add(to, "outputs y (%zu): a logit a class; probabilities are exp(y_i)/sum_j exp(y_j).",
                    j->outputs);
    else if (j->c->method == LG_METHOD_RIDGE)
        lg_text_add(to, two ? "outputs y (1): the score of class 1, positive for class 1."
                            : "outputs y: the score of each class; the largest is the answer.");
    else
        lg_text_add(to, "outputs y (%zu): decisions of the pairs of classes (i, j), i < j, positive for i%s.",
                    j->outputs, two ? "" : ", in the order (0, 1), (0, 2), ..., (1, 2), ...");
    if (j->c->method != LG_METHOD_TREE && is_constant(j->c))
        lg_text_add(to, " Gradient: 0, since counts of samples are constant between thresholds.\n\n");
    else if (j->c->method != LG_METHOD_TREE)
        lg_text_add(to,
                    " Gradient: d y/d x, one row an output, by the window as recorded; that of a standard "
                    "deviation of 0 is 0.\n\n");
}

static void add_features_words(const classifier_job *j, text *to) {
    const lg_pca *pca = &j->c->pca;
    lg_text_add(to, "features      %s: %zu numbers, standardised; ",
                lg_feature_kind_name(j->c->features.kind), j->d);
    if (pca->components > 0)
        lg_text_add(to, "%u principal components of them\n", pca->components);
    else
        lg_text_add(to, "no principal components\n");
    for (uint32_t i = 0; i < j->d && j->d <= NAMED_FEATURES; i++) {
        char name[256];
        const lg_series *names = j->file->names.channels == j->c->features.channels ? &j->file->names : NULL;
        (void)lg_features_name(&j->c->features, names, i, name, sizeof name);
        lg_text_add(to, "              %u: %s, mean %.6g, scale %.6g\n", i, name, pca->mean[i],
                    pca->scale[i]);
    }
}

static void add_words(const classifier_job *j, const export_window *window) {
    text *to = &j->source->about;
    lg_text_add(to, "Classifier: the class of a window of sensor data, by %s.\n\n", j->file->method);
    export_window_words(j->source, window);
    add_outputs(j, to);
    export_window_score_words(to, window);
    add_features_words(j, to);
    if (j->c->method == LG_METHOD_TREE)
        lg_text_add(to, "tree          %u nodes, depth %u\n", j->c->tree.count, lg_tree_depth(&j->c->tree));
    if (is_svm(j->c))
        lg_text_add(to, "svm           %u support vectors, C %.6g%s\n", j->c->svm.vectors, j->c->svm.c,
                    j->c->method == LG_METHOD_SVM_LINEAR ? ", summed up to one vector a pair of classes"
                                                         : "");
    lg_text_add(
        to,
        "tolerance     contains the factor %.3g, by which standardisation and what follows multiply the "
        "rounding of the features at the training mean\n",
        j->source->condition);
    if (j->c->features.kind == LG_FEATURES_COV)
        lg_text_add(to,
                    "gradient      Its rounding grows as the largest root of a window's covariance over the "
                    "smallest; along roots below 2^-22 of the largest it is taken as 0.\n");
    lg_text_add(to, "training      %llu windows, split %s\n", (unsigned long long)j->file->run.windows,
                lg_split_name(j->file->run.split));
    export_provenance(j->source, &j->file->provenance, j->file->run.data_sha256);
}

/* ---- the export ---- */

static double largest_array(const classifier_job *j) {
    const double k = (double)j->k, d = (double)j->d;
    const double vectors = is_svm(j->c) ? (double)j->c->svm.vectors * fmax(k, j->c->classes) : 0;
    return fmax(fmax(d * k, k * (double)j->outputs),
                fmax(vectors, (double)j->c->tree.count * (double)j->c->classes));
}

static void check(const classifier_job *j, const app *self) {
    const lg_classifier *c = j->c;
    if (c->features.count == 0 || c->features.count != c->pca.inputs || (is_svm(c) && c->svm.vectors == 0))
        app_stop(self, LG_FILE, "%s: the classifier has no features, or no support vectors",
                 j->source->options->file);
    export_window_check(self, j->source, largest_array(j));
}

static const char *const score_words[] = {
    ("It is the one of the largest: of two equal ones class 1,\n * of more the first."),
    ("The scores are the decision and its negative, the larger\n * one is the class."),
    ("The scores are how many of the other classes each one\n * wins against, and a term within 1/3 that "
     "orders classes of equal votes; of the classes with the most\n * votes the first is the class.")};

static export_window window_of(const classifier_file *file) {
    const lg_classifier *c = &file->classifier;
    const bool named = file->names.channels == c->features.channels;
    return (export_window){.channels = c->features.channels,
                           .length = c->features.length,
                           .classes = c->classes,
                           .healthy = file->run.healthy,
                           .rate = file->names.rate,
                           .class_name = file->names.class_name,
                           .channel_name = named ? file->names.channel_name : NULL,
                           .accuracy = file->accuracy,
                           .f1 = file->f1,
                           .scores = is_svm(c) || c->method == LG_METHOD_RIDGE ? "scores" : "probabilities",
                           .score_words = score_words[!is_svm(c)        ? 0
                                                      : c->classes == 2 ? 1
                                                                        : 2]};
}

static void export_loaded(const app *self, const classifier_file *file, export_source *source) {
    const lg_classifier *c = &file->classifier;
    const export_window window = window_of(file);
    classifier_job j = {.source = source,
                        .file = file,
                        .c = c,
                        .d = c->pca.inputs,
                        .k = lg_pca_outputs(&c->pca),
                        .outputs = lg_classifier_outputs(c)};
    classifier_linear w = {NULL, NULL};
    source->inputs = (size_t)c->features.channels * c->features.length;
    source->outputs = j.outputs;
    source->work = features_work(&c->features);
    check(&j, self);
    if (classifier_is_linear(c)) w = linear_of(&j);
    source->condition = classifier_condition(&j, &w);
    if (is_folded(c)) fold_scale(&j, &w);
    source->depth = 3 + (c->pca.components > 0) + is_scaled(c->features.kind);
    source->stack += STACK;
    export_window_code(source, &window);
    add_code(&j, &w);
    free(w.weight);
    free(w.bias);
    add_words(&j, &window);
    classifier_golden(&j, self);
}

void export_classifier(const app *self, const char *path, export_source *source) {
    lg_error error = {LG_OK, ""};
    classifier_file file;
    lg_status status = classifier_file_load(self->context, path, &file, &error);
    if (status == LG_OK && classifier_file_is_novelty(&file)) {
        classifier_file_free(&file);
        status = lg_fail(&error, LG_UNSUPPORTED, "%s: the method novelty is not exported as code", path);
    }
    app_must_file(self, status, &error, path);
    export_loaded(self, &file, source);
    classifier_file_free(&file);
}
