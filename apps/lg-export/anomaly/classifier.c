/* Classical classifiers: their description in NAME.h, golden windows whose features resemble the training
 * data's, and NAME_features. */
#include <math.h>
#include <string.h>

#include "anomaly/classify/classify_internal.h"
#include "common/classifier_file.h"
#include "lg-export/faces.h"

enum { NAMED_FEATURES = 64 };

static const lg_classifier *classifier_of(const export_model *m) {
    return &((const classifier_file *)m->file->contents)->classifier;
}

/* Returns whether the outputs are constant between thresholds. */
static bool is_constant(const void *contents) {
    const lg_classifier *c = &((const classifier_file *)contents)->classifier;
    return c->method == LG_METHOD_TREE || c->features.kind == LG_FEATURES_ROCKET;
}

/* ---- description in NAME.h ---- */

static void add_outputs(const classifier_file *file, size_t outputs, text *to) {
    const lg_classifier *c = &file->classifier;
    const bool two = c->classes == 2;
    if (c->method == LG_METHOD_TREE)
        lg_text_add(to,
                    "outputs y (%zu): fractions of the classes among the training windows of the leaf. "
                    "Gradient: 0 everywhere, since\nthe fractions change at thresholds only; a window within "
                    "rounding of one may fall on its other side.\n\n",
                    outputs);
    else if (c->method == LG_METHOD_LOGISTIC && two)
        lg_text_add(to, "outputs y (1): the logit of class 1; its probability is 1/(1 + exp(-y)).");
    else if (c->method == LG_METHOD_LOGISTIC)
        lg_text_add(to, "outputs y (%zu): a logit a class; probabilities are exp(y_i)/sum_j exp(y_j).",
                    outputs);
    else if (c->method == LG_METHOD_RIDGE)
        lg_text_add(to, two ? "outputs y (1): the score of class 1, positive for class 1."
                            : "outputs y: the score of each class; the largest is the answer.");
    else
        lg_text_add(to, "outputs y (%zu): decisions of the pairs of classes (i, j), i < j, positive for i%s.",
                    outputs, two ? "" : ", in the order (0, 1), (0, 2), ..., (1, 2), ...");
    if (c->method != LG_METHOD_TREE && is_constant(file))
        lg_text_add(to, " Gradient: 0, since counts of samples are constant between thresholds.\n\n");
    else if (c->method != LG_METHOD_TREE)
        lg_text_add(to,
                    " Gradient: d y/d x, one row an output, by the window as recorded; that of a standard "
                    "deviation of 0 is 0.\n\n");
}

static void add_features(const classifier_file *file, text *to) {
    const lg_features *f = &file->classifier.features;
    const lg_pca *pca = &file->classifier.pca;
    lg_text_add(to, "features      %s: %u numbers, standardised; ", lg_feature_kind_name(f->kind), f->count);
    if (pca->components > 0)
        lg_text_add(to, "%u principal components of them\n", pca->components);
    else
        lg_text_add(to, "no principal components\n");
    for (uint32_t i = 0; i < f->count && f->count <= NAMED_FEATURES; i++) {
        char name[256];
        (void)lg_features_name(f, &file->names, i, name, sizeof name);
        lg_text_add(to, "              %u: %s, mean %.6g, scale %.6g\n", i, name, pca->mean[i],
                    pca->scale[i]);
    }
}

static void tell(export_model *m) {
    const classifier_file *file = m->file->contents;
    const lg_classifier *c = &file->classifier;
    text *to = &m->source->about;
    lg_text_add(to, "Classifier: the class of a window of sensor data, by %s.\n\n", file->method);
    export_window_words(m->source, &m->window);
    add_outputs(file, m->source->outputs, to);
    export_window_score_words(to, &m->window);
    add_features(file, to);
    if (c->method == LG_METHOD_TREE)
        lg_text_add(to, "tree          %u nodes, depth %u\n", c->tree.count, c->tree.depth);
    if (lg_method_is_svm(c->method))
        lg_text_add(to, "svm           %u support vectors, C %.6g%s\n", c->svm.vectors, c->svm.c,
                    c->method == LG_METHOD_SVM_LINEAR ? ", summed up to one vector a pair of classes" : "");
    lg_text_add(
        to,
        "tolerance     contains the factor %.3g, by which value and gradient multiply rounding errors on "
        "windows like the golden ones\n",
        m->source->condition);
    if (c->features.kind == LG_FEATURES_COV)
        lg_text_add(to,
                    "gradient      Its rounding grows as the largest root of a window's covariance over the "
                    "smallest; along roots below 2^-22 + m eps of the largest (m channels) it is 0.\n");
}

static const char *const score_words[] = {
    ("It is the one of the largest: of two equal ones class 1,\n * of more the first."),
    ("The scores are the decision and its negative, the larger\n * one is the class."),
    ("The scores are how many of the other classes each one\n * wins against, and a term within 1/3 that "
     "orders classes of equal votes; of the classes with the most\n * votes the first is the class.")};

static void describe(const void *contents, export_window *out) {
    const classifier_file *file = contents;
    const lg_classifier *c = &file->classifier;
    *out = (export_window){file->names, file->run.healthy, NULL, NULL};
    out->names.length = c->features.length;
    out->scores = lg_method_is_svm(c->method) || c->method == LG_METHOD_RIDGE ? "scores" : "probabilities";
    out->score_words = score_words[!lg_method_is_svm(c->method) ? 0 : c->classes == 2 ? 1 : 2];
}

static size_t depth_of(const void *contents) {
    const lg_classifier *c = &((const classifier_file *)contents)->classifier;
    const bool scaled = c->features.kind != LG_FEATURES_RAW && c->features.kind != LG_FEATURES_STD;
    return 3 + (c->pca.components > 0) + scaled;
}

/* ---- golden windows ---- */

/* Draws noise of about the size of the training data: of each sample, if samples are the features, else of
 * each channel. */
static void draw(export_model *m, double *x, size_t v) {
    const lg_features *f = &classifier_of(m)->features;
    const lg_pca *pca = &classifier_of(m)->pca;
    const size_t n = f->length;
    for (size_t c = 0; c < f->channels; c++)
        export_draw_channel(m, f->rocket.mean != NULL ? f->rocket.mean[c] : 0,
                            f->scale[c] * exp(0.5 * lg_rng_normal(&m->rng)), c, x);
    for (size_t i = 0; i < f->selected && f->kind == LG_FEATURES_STD; i++)
        export_draw_channel(m, 0, pca->mean[i] + pca->scale[i] * lg_rng_normal(&m->rng), f->select[i], x);
    for (size_t i = 0; i < f->selected && f->kind == LG_FEATURES_LEVELS; i++)
        export_draw_channel(m, pca->mean[4 * i], f->scale[f->select[i]], f->select[i], x);
    for (size_t i = 0; i < f->selected * n && f->kind == LG_FEATURES_RAW; i++)
        x[f->select[i / n] * n + i % n] = (double)(float)export_round(
            m->source->options, pca->mean[i] + pca->scale[i] * lg_rng_normal(&m->rng));
}

/* Returns whether a tree finds the same leaf if about half of the samples move by 64 floats. */
static bool is_steady(export_model *m, size_t v) {
    const size_t inputs = m->source->inputs, outputs = m->source->outputs;
    const double *x = m->source->golden.x + v * inputs;
    APP_FREE double *moved = app_alloc(inputs + outputs, sizeof *moved);
    for (size_t i = 0; i < inputs; i++) {
        const float now = (float)x[i], step = lg_rng_uniform(&m->rng) < 0.5 ? 64 : 0;
        moved[i] = (double)(now + step * (nextafterf(now, INFINITY) - now));
    }
    lg_model_eval(m->file->model, moved, moved + inputs, m->work);
    return classifier_of(m)->method != LG_METHOD_TREE ||
           memcmp(m->source->golden.y + v * outputs, moved + inputs, outputs * sizeof *moved) == 0;
}

const export_kind export_kind_classifier = {.recipe = &classifier_recipe,
                                            .stream = 0x636c6173,
                                            .draw = draw,
                                            .is_smooth = is_steady,
                                            .kinks = is_constant,
                                            .depth = depth_of,
                                            .window = describe,
                                            .hidden = "probability",
                                            .tell = tell};

/* ---- NAME_features ---- */

static bool has_features(const export_model *m) {
    return m->kind == &export_kind_classifier;
}

static void features_code(export_model *m) {
    export_size(m->source, "FEATURES", classifier_of(m)->features.count, "numbers that are made of a window");
}

const export_face export_face_features = {
    .functions = {{"features", "features", false}}, .fits = has_features, .code = features_code};

/* ---- the export ---- */

/* The classifier as a model with a program. */
static void open_model(const app *self, const char *path, const export_source *source, lg_model_file *file) {
    const lg_classifier *c = &((const classifier_file *)file->contents)->classifier;
    lg_program *program;
    const double eps = export_eps(source->options);
    if (c->features.count == 0 || c->features.count != c->pca.inputs ||
        (lg_method_is_svm(c->method) && c->svm.vectors == 0))
        app_stop(self, LG_FILE, "%s: the classifier has no features, or no support vectors",
                 source->options->file);
    APP_MUST_FILE(self, path, lg_classifier_program(self->context, c, &program, &error));
    for (size_t i = 0; i < lg_program_parameters(program); i++)
        if (strcmp(lg_program_parameter(program, i).name, "eps") == 0)
            (void)lg_program_set_parameter(program, i, &eps);
    APP_MUST_FILE(self, path, lg_model_create(self->context, program, NULL, &file->model, &error));
    export_window_check(self, source, (double)lg_model_outputs(file->model) * c->svm.vectors);
}

void export_classifier(const app *self, const char *path, export_source *source) {
    bool none;
    classifier_file contents;
    APP_FILE(self, path, classifier_file_load, &contents);
    if (classifier_file_is_novelty(&contents))
        APP_MUST_FILE(
            self, path,
            lg_fail(&error, LG_UNSUPPORTED, "%s: the method novelty is not exported as code", path));
    lg_model_file file = {.context = self->context, .recipe = &classifier_recipe, .contents = &contents};
    open_model(self, path, source, &file);
    export_faces(self, &file, source, &none);
    lg_model_destroy(file.model);
    classifier_file_free(&contents);
}
