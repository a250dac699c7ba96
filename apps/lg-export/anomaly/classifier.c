/* Classical classifiers: constants and arrays of the features, and the description in NAME.h. The fragments
 * below code/classifier compute the features, functions of the classifier's program everything else. */
#include "lg-export/anomaly/classifier.h"

#include <math.h>
#include <string.h>

#include "anomaly/classify/classify_internal.h"

enum { STACK = 1024, NAMED_FEATURES = 64 };

/* ---- arrays ---- */

static void add_spectrum(const classifier_job *j) {
    const lg_spectrum *s = &j->c->features.spectrum;
    export_array(j->source, "taper", "window of a segment (segment)", s->taper, s->segment);
    export_array(j->source, "cosine", "of 2 pi t/segment", s->cosine, s->segment);
    export_array(j->source, "sine", "of 2 pi t/segment", s->sine, s->segment);
    export_integers(j->source, "edge", "the first frequency of each band, and the end (bands + 1)", s->edge,
                    (size_t)s->bands + 1);
    export_constant(j->source, "SEGMENT", s->segment);
    export_constant(j->source, "SEGMENTS", s->segments);
    export_constant(j->source, "HOP", s->hop);
    export_constant(j->source, "BANDS", s->bands);
    export_real(j->source, &j->source->code, "POWER_FLOOR", LG_FEATURES_FLOOR);
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
    export_array(j->source, "bias", "thresholds, by convolution", bias, j->d);
    export_array(j->source, "channel_mean", "mean of each channel", r->mean, j->c->features.channels);
    export_constant(j->source, "CONVOLUTIONS", r->count);
    export_constant(j->source, "MARGIN", rocket_margin(r));
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
        export_array(j->source, "inverse_scale", "1/scale of each channel (channels)", inverse, f->channels);
    if (f->kind == LG_FEATURES_BASELINE) {
        export_integers(j->source, "pair", "channels of acceleration and moment (pairs, 2)", f->pair,
                        2 * (size_t)f->pairs);
        export_constant(j->source, "PAIRS", f->pairs);
        export_constant(j->source, "SEGMENTS", f->segments);
    } else {
        export_integers(j->source, "select", "channels that are used", f->select, f->selected);
        export_constant(j->source, "SELECTED", f->selected);
    }
    if (f->kind == LG_FEATURES_SPECTRUM) add_spectrum(j);
    if (f->kind == LG_FEATURES_ROCKET) add_rocket(j);
}

/* ---- code ---- */

/* The code is the library's, where the window lies before it and the waves of a spectrum behind it. */
static size_t features_work(const lg_features *f) {
    const size_t length = f->length,
                 waves = f->kind == LG_FEATURES_SPECTRUM ? lg_spectrum_work(&f->spectrum) : 0;
    return f->kind == LG_FEATURES_ROCKET
               ? 2 * f->selected * (length + rocket_margin(&f->rocket)) + length
               : lg_features_work_size(f) / sizeof(double) - f->channels * length - waves;
}

/* Adds the functions of the program, which need the longest of their work memories. */
static size_t add_program(const classifier_job *j) {
    export_function functions[] = {{.function = "value", .name = "decide", .hidden = true},
                                   {.function = "scores", .name = "score", .hidden = true},
                                   {.function = "adj1_value", .name = "pull_back", .hidden = true}};
    size_t work = 0;
    const size_t count = LG_COUNT(functions) - classifier_is_constant(j->c);
    export_bundle(j->self, j->source, j->program, functions, count);
    for (size_t i = 0; i < count; i++) work = functions[i].work > work ? functions[i].work : work;
    return work;
}

/* Adds the constants that say where arrays begin in `work`. NAME_features uses the memory before COMPUTED. */
static void add_places(const classifier_job *j, size_t program_work) {
    const struct {
        const char *name;
        size_t count;
    } rows[] = {{"COMPUTED", j->d},
                {"SCORES", j->c->classes},
                {"SEED", j->outputs},
                {"BY_FEATURES", j->d},
                {"PROGRAM", program_work}};
    size_t at = (features_work(&j->c->features) + 7) / 8 * 8;
    lg_text_add(&j->source->code, "\n/* where arrays begin in work */\n");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        export_constant(j->source, rows[i].name, at);
        at += (rows[i].count + 7) / 8 * 8;
    }
    j->source->work = at;
}

static void add_fragments(const classifier_job *j) {
    const lg_feature_kind kind = j->c->features.kind;
    const bool centred = kind != LG_FEATURES_RAW && kind != LG_FEATURES_ROCKET,
               deviations = kind == LG_FEATURES_STD || kind == LG_FEATURES_BASELINE,
               slopes = !classifier_is_constant(j->c);
    char features[64], vjp[80];
    (void)snprintf(features, sizeof features, "features_%s", lg_feature_kind_name(kind));
    (void)snprintf(vjp, sizeof vjp, "%s_vjp", features);
    const struct {
        const char *name;
        bool wanted;
    } fragments[] = {{"rolled", true},
                     {"features_centre", centred},
                     {"features_cov_factor", kind == LG_FEATURES_COV},
                     {"features_segment", kind == LG_FEATURES_SPECTRUM},
                     {features, true},
                     {"features_deviation_vjp", slopes && deviations},
                     {vjp, slopes},
                     {"detector_class", true},
                     {"classifier_main", true},
                     {slopes ? "classifier_grad" : "classifier_grad_zero", true}};
    for (size_t i = 0; i < LG_COUNT(fragments); i++)
        if (fragments[i].wanted) export_code(j->source, fragments[i].name);
}

static void add_code(const classifier_job *j, const export_window *window) {
    const size_t work = add_program(j);
    export_window_code(j->source, window);
    export_size(j->source, "FEATURES", j->d, "numbers that are made of a window");
    add_features(j);
    add_places(j, work);
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
    if (j->c->method != LG_METHOD_TREE && classifier_is_constant(j->c))
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
        (void)lg_features_name(&j->c->features, &j->file->names, i, name, sizeof name);
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
    if (isfinite(j->file->accuracy))
        lg_text_add(to, "accuracy      %.6g on the test part, F1 %.6g (mean over the classes)\n",
                    j->file->accuracy, j->file->f1);
    else
        lg_text_add(to, "accuracy      unknown: there was no test part\n");
    add_features_words(j, to);
    if (j->c->method == LG_METHOD_TREE)
        lg_text_add(to, "tree          %u nodes, depth %u\n", j->c->tree.count, j->c->tree.depth);
    if (lg_method_is_svm(j->c->method))
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

static void check(const classifier_job *j, const app *self) {
    const lg_classifier *c = j->c;
    if (c->features.count == 0 || c->features.count != c->pca.inputs ||
        (lg_method_is_svm(c->method) && c->svm.vectors == 0))
        app_stop(self, LG_FILE, "%s: the classifier has no features, or no support vectors",
                 j->source->options->file);
}

static const char *const score_words[] = {
    ("It is the one of the largest: of two equal ones class 1,\n * of more the first."),
    ("The scores are the decision and its negative, the larger\n * one is the class."),
    ("The scores are how many of the other classes each one\n * wins against, and a term within 1/3 that "
     "orders classes of equal votes; of the classes with the most\n * votes the first is the class.")};

static export_window window_of(const classifier_file *file) {
    const lg_classifier *c = &file->classifier;
    export_window out = {file->names, file->run.healthy, NULL, NULL};
    out.names.length = c->features.length;
    out.scores = lg_method_is_svm(c->method) || c->method == LG_METHOD_RIDGE ? "scores" : "probabilities";
    out.score_words = score_words[!lg_method_is_svm(c->method) ? 0 : c->classes == 2 ? 1 : 2];
    return out;
}

/* Makes the program and the derivative of its value, and prepares both for the golden vectors. */
static void open_program(classifier_job *j) {
    const char *const names[] = {"value", "adj1_value"};
    export_evaluation *const evaluations[] = {&j->value, &j->pull_back};
    lg_derivative adjoint;
    lg_derivative_init(&adjoint);
    adjoint.kind = LG_DERIVATIVE_ADJOINT;
    adjoint.function = "value";
    EXPORT_MUST(j, lg_classifier_program(j->self->context, j->c, &j->program, &error));
    if (j->c->method != LG_METHOD_TREE) EXPORT_MUST(j, lg_program_derive(j->program, &adjoint, &error));
    for (size_t i = 0; i < lg_program_functions(j->program) - 1; i++)
        EXPORT_MUST(j, export_evaluation_open(j->program, names[i], LG_F64, 0, evaluations[i], &error));
    j->outputs = lg_plan_output_count(j->value.plan, 0);
    const double eps = export_eps(j->source->options);
    for (size_t i = 0; i < lg_program_parameters(j->program); i++)
        if (strcmp(lg_program_parameter(j->program, i).name, "eps") == 0)
            (void)lg_program_set_parameter(j->program, i, &eps);
}

static void export_loaded(const app *self, const classifier_file *file, export_source *source) {
    const lg_classifier *c = &file->classifier;
    const export_window window = window_of(file);
    classifier_job j = {.self = self, .source = source, .file = file, .c = c, .d = c->pca.inputs};
    check(&j, self);
    open_program(&j);
    export_window_check(self, source, (double)j.outputs * c->svm.vectors);
    add_code(&j, &window);
    source->inputs = (size_t)c->features.channels * c->features.length;
    source->outputs = j.outputs;
    source->depth = 3 + (c->pca.components > 0) + is_scaled(c->features.kind);
    source->stack += STACK;
    classifier_golden(&j);
    add_words(&j, &window);
    export_evaluation_close(&j.value);
    export_evaluation_close(&j.pull_back);
    lg_program_destroy(j.program);
}

void export_classifier(const app *self, const char *path, export_source *source) {
    classifier_file file;
    APP_FILE(self, path, classifier_file_load, &file);
    if (classifier_file_is_novelty(&file))
        APP_MUST_FILE(
            self, path,
            lg_fail(&error, LG_UNSUPPORTED, "%s: the method novelty is not exported as code", path));
    export_loaded(self, &file, source);
    classifier_file_free(&file);
}
