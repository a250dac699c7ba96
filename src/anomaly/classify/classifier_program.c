/* What a classifier computes from a window, by way of its features f (d), as a program:
 *   z = (f - mean) inverse components     (d, k); without principal components z = (f - mean) inverse
 *   y = z weight^T + bias                 logistic and ridge regression
 *   y = z (weight vector)^T + bias        SVM with the linear kernel, weight (pairs, vectors)
 *   y = exp(-gamma |vector - z|^2) weight^T + bias      SVM with the RBF kernel
 *   y = fractions of the classes in the leaf that z falls into      decision tree
 * A plan computes products of parameters alone when it is made. */
#include <float.h>
#include <string.h>

#include "anomaly/classify/features.h"
#include "autodiff/program/program.h"
#include "liegrad/ops.h"
#include "model/record.h"

/* Rows of SIGN are pairs of classes (i, j): 1 for i, -1 for j. LIVING is 1 for pairs whose classes both have
 * support vectors, PRESENT 1 for classes that have some. ORDER falls with the number of the class. EPS is the
 * relative distance of neighbouring numbers; features alone need no other parameter. */
enum { EPS, MEAN, REST, INVERSE, COMPONENTS, WEIGHT, BIAS, VECTOR, THRESHOLD, FRACTION, SIGN, LIVING };
enum { PRESENT = LIVING + 1, ORDER, PARAMETERS };
static const char *const names[PARAMETERS] = {"eps",    "mean",   "rest",    "inverse",   "components",
                                              "weight", "bias",   "vector",  "threshold", "fraction",
                                              "sign",   "living", "present", "order"};

typedef struct chain {
    const lg_classifier *c;
    lg_parameter_spec parameter[PARAMETERS];
    double *own[PARAMETERS]; /* Values that are computed here. */
    bool failed;             /* No memory for one of them. */
} chain;

/* ---- parameters ---- */

static void give(chain *ch, int which, size_t rows, size_t columns, const double *values) {
    ch->parameter[which].shape = lg_shape2((uint32_t)rows, (uint32_t)columns);
    ch->parameter[which].values = values;
}

/* Returns zeroed memory for the values of a parameter. */
static double *make(chain *ch, int which, size_t rows, size_t columns) {
    ch->own[which] = lg_alloc(NULL, rows, columns * sizeof(double));
    ch->failed = ch->failed || ch->own[which] == NULL;
    give(ch, which, rows, columns, ch->own[which]);
    return ch->own[which];
}

/* Samples are exact, so what single precision leaves out of their mean is subtracted, too. Computed features
 * are rounded themselves. */
static void add_standardisation(chain *ch) {
    const lg_pca *p = &ch->c->pca;
    const bool exact = lg_feature_rows[ch->c->features.kind]->exact;
    double *mean = make(ch, MEAN, 1, p->inputs), *inverse = make(ch, INVERSE, 1, p->inputs),
           *rest = make(ch, REST, 1, p->inputs);
    if (p->components > 0) give(ch, COMPONENTS, p->inputs, p->components, p->vectors);
    for (uint32_t i = 0; i < p->inputs && !ch->failed; i++) {
        mean[i] = exact ? (double)(float)p->mean[i] : p->mean[i];
        rest[i] = p->mean[i] - mean[i];
        inverse[i] = 1.0 / p->scale[i];
    }
}

/* Copies the coefficients of class `own` in its pair with class `other`. */
static void put_coefficients(const lg_svm *s, size_t own, size_t other, double *row) {
    size_t first = 0;
    for (size_t i = 0; i < own; i++) first += s->vectors_of[i];
    memcpy(row + first, s->coefficient + (other > own ? other - 1 : other) * (size_t)s->vectors + first,
           s->vectors_of[own] * sizeof *row);
}

static void put_pair(chain *ch, size_t i, size_t j, size_t pair) {
    const lg_svm *s = &ch->c->svm;
    const bool a = s->vectors_of[i] > 0, b = s->vectors_of[j] > 0, living = s->classes == 2 || (a && b);
    ch->own[SIGN][pair * s->classes + i] = 1.0;
    ch->own[SIGN][pair * s->classes + j] = -1.0;
    ch->own[LIVING][pair] = living;
    ch->own[BIAS][pair] = living ? -s->rho[pair] : (double)a - (double)b;
    if (!living) return;
    put_coefficients(s, i, j, ch->own[WEIGHT] + pair * s->vectors);
    put_coefficients(s, j, i, ch->own[WEIGHT] + pair * s->vectors);
}

static void add_svm(chain *ch) {
    const lg_svm *s = &ch->c->svm;
    const size_t classes = s->classes, pairs = classes * (classes - 1) / 2;
    give(ch, VECTOR, s->vectors, s->inputs, s->vector);
    (void)make(ch, WEIGHT, pairs, s->vectors);
    (void)make(ch, BIAS, 1, pairs);
    (void)make(ch, SIGN, pairs, classes);
    (void)make(ch, LIVING, 1, pairs);
    double *present = make(ch, PRESENT, 1, classes), *order = make(ch, ORDER, 1, classes);
    for (size_t i = 0, pair = 0; i < classes && !ch->failed; i++) {
        present[i] = s->vectors_of[i] > 0;
        order[i] = -0.5 * (double)i / (double)classes;
        for (size_t j = i + 1; j < classes; j++) put_pair(ch, i, j, pair++);
    }
}

/* Thresholds of the nodes that split, and fractions of the leaves, both in the order of the nodes. */
static void add_tree(chain *ch) {
    const lg_tree *tree = &ch->c->tree;
    const size_t classes = tree->classes, splits = tree->count / 2;
    double *threshold = make(ch, THRESHOLD, splits > 0 ? splits : 1, 1),
           *fraction = make(ch, FRACTION, splits + 1, classes);
    for (size_t i = 0; i < tree->count && !ch->failed; i++) {
        const lg_tree_node *node = &tree->node[i];
        if (node->left != 0) *threshold++ = node->threshold;
        for (size_t k = 0; k < classes && node->left == 0; k++)
            *fraction++ = tree->counts[i * classes + k] / (double)node->samples;
    }
}

static void add_parameters(chain *ch) {
    static const double eps = DBL_EPSILON;
    const lg_classifier *c = ch->c;
    const lg_logistic *l = &c->logistic;
    const size_t outputs = c->classes == 2 ? 1 : c->classes;
    for (int i = 0; i < PARAMETERS; i++) ch->parameter[i] = (lg_parameter_spec){names[i], lg_shape1(1), NULL};
    ch->parameter[EPS].values = &eps;
    if (c->pca.inputs == 0) return;
    add_standardisation(ch);
    if (c->method == LG_METHOD_TREE) {
        add_tree(ch);
    } else if (lg_method_is_svm(c->method)) {
        add_svm(ch);
    } else {
        give(ch, WEIGHT, outputs, l->inputs, l->weight);
        give(ch, BIAS, 1, outputs, l->intercept);
    }
}

/* ---- y ---- */

static lg_var standardised(lg_tape *t, const chain *ch, const lg_var *w, lg_var f) {
    lg_var z = lg_sub(t, f, w[MEAN]);
    if (lg_feature_rows[ch->c->features.kind]->exact) z = lg_sub(t, z, w[REST]);
    if (ch->c->pca.components == 0) return lg_mul(t, z, w[INVERSE]);
    return lg_matmul(t, z, lg_mul(t, w[COMPONENTS], lg_transpose(t, w[INVERSE])));
}

/* exp(-gamma |vector - z|^2), (B, vectors) */
static lg_var kernel(lg_tape *t, const lg_svm *s, const lg_var *w, lg_var z) {
    const uint32_t rows = lg_var_shape(t, z).dims[0];
    const lg_var away = lg_sub(t, w[VECTOR], lg_reshape(t, z, lg_shape3(rows, 1, s->inputs)));
    const lg_var square = lg_reshape(t, lg_rownorm2(t, away), lg_shape2(rows, s->vectors));
    return lg_exp(t, lg_scale(t, square, -s->gamma));
}

/* Whether z reaches each leaf (leaves, B). A node is reached if all edges from the root to it are taken.
 * index (2 count): for each node the row of its edge, and its parent; the product of the edges up to the
 * ancestor `parent` becomes longer by twice its length in each pass. */
static lg_var reached(lg_tape *t, const lg_tree *tree, lg_var edges, uint32_t *index) {
    const uint32_t count = tree->count, splits = count / 2;
    uint32_t *edge = index, *parent = index + count, leaves = 0;
    edge[0] = 2 * splits;
    for (uint32_t i = 0, split = 0; i < count; i++) {
        const lg_tree_node *node = &tree->node[i];
        if (node->left == 0) continue;
        edge[node->left] = split, edge[node->right] = splits + split++;
        parent[node->left] = parent[node->right] = i;
    }
    lg_var taken = lg_gather(t, edges, edge, count);
    for (uint32_t length = 1, depth = tree->depth; length < depth; length *= 2) {
        taken = lg_mul(t, taken, lg_gather(t, taken, parent, count));
        for (uint32_t i = 0; i < count; i++) edge[i] = parent[parent[i]];
        memcpy(parent, edge, count * sizeof *parent);
    }
    for (uint32_t i = 0; i < count; i++)
        if (tree->node[i].left == 0) edge[leaves++] = i;
    return lg_gather(t, taken, edge, leaves);
}

static lg_status fractions(lg_tape *t, const lg_tree *tree, const lg_var *w, lg_var z, lg_var *y) {
    const uint32_t splits = tree->count / 2, rows = lg_var_shape(t, z).dims[0];
    uint32_t n = 0;
    LG_TRY_SCRATCH(uint32_t, index, NULL, 2 * (size_t)tree->count, LG_OUT_OF_MEMORY);
    for (uint32_t i = 0; i < tree->count; i++)
        if (tree->node[i].left != 0) index[n++] = tree->node[i].feature;
    if (splits > 0) {
        const lg_var number = lg_gather(t, lg_transpose(t, z), index, splits),
                     left = lg_ge(t, w[THRESHOLD], number), right = lg_add_scalar(t, lg_neg(t, left), 1);
        const lg_var root = lg_add(t, lg_slice(t, left, 0, 0, 1), lg_slice(t, right, 0, 0, 1));
        memset(index, 0, tree->count * sizeof *index);
        const lg_var leaf = reached(t, tree, lg_concat(t, (lg_var[]){left, right, root}, 3, 0), index);
        *y = lg_matmul_tn(t, leaf, w[FRACTION]);
    } else {
        *y = lg_broadcast_to(t, w[FRACTION], lg_shape2(rows, tree->classes));
    }
    return LG_OK;
}

static lg_status decide(void *user, lg_tape *t, const lg_var *w, const lg_var *f, lg_var *y) {
    const chain *ch = user;
    const lg_classifier_method method = ch->c->method;
    const lg_var z = standardised(t, ch, w, f[0]);
    if (method == LG_METHOD_TREE) return fractions(t, &ch->c->tree, w, z, y);
    const lg_var from = method == LG_METHOD_SVM_RBF ? kernel(t, &ch->c->svm, w, z) : z;
    const lg_var by = method == LG_METHOD_SVM_LINEAR ? lg_matmul(t, w[WEIGHT], w[VECTOR]) : w[WEIGHT];
    y[0] = lg_add(t, lg_matmul_nt(t, from, by), w[BIAS]);
    return LG_OK;
}

/* ---- scores ---- */

/* The first class with the most votes gets the largest score. */
static lg_var votes(lg_tape *t, const lg_classifier *c, const lg_var *w, lg_var y) {
    const lg_var for_first = lg_neg(t, lg_sign(t, lg_neg(t, y))); /* 1 for y > 0, else -1 */
    lg_var won = lg_scale(t, lg_add_scalar(t, lg_matmul(t, for_first, w[SIGN]), c->classes - 1.0), 0.5);
    won = lg_add_scalar(t, lg_mul(t, lg_add_scalar(t, won, 1), w[PRESENT]), -1);
    const lg_var lean = lg_matmul(t, lg_mul(t, y, w[LIVING]), w[SIGN]);
    const lg_var within = lg_div(t, lean, lg_scale(t, lg_add_scalar(t, lg_abs(t, lean), 1), 3));
    const lg_var score = lg_add(t, won, lg_mul(t, within, w[PRESENT]));
    const lg_var rank = lg_add(t, won, w[ORDER]), top = lg_max_axis(t, score, 1, true);
    const lg_var first = lg_ge(t, rank, lg_max_axis(t, rank, 1, true));
    const lg_var above = lg_add(t, top, lg_mul(t, lg_add_scalar(t, lg_abs(t, top), 1), w[EPS]));
    const lg_var raised = lg_broadcast_to(t, above, lg_var_shape(t, score));
    return lg_select(t, first, lg_select(t, lg_ge(t, score, top), score, raised), score);
}

static lg_status score(void *user, lg_tape *t, const lg_var *w, const lg_var *f, lg_var *out) {
    const lg_classifier *c = ((const chain *)user)->c;
    const lg_var y = lg_program_call(t, "decide", 0, f);
    const bool svm = lg_method_is_svm(c->method), logistic = c->method == LG_METHOD_LOGISTIC;
    if (c->method == LG_METHOD_TREE)
        out[0] = y;
    else if (c->classes == 2)
        out[0] = lg_concat(t, (lg_var[]){svm ? y : lg_neg(t, y), svm ? lg_neg(t, y) : y}, 2, 1);
    else
        out[0] = svm ? votes(t, c, w, y) : y;
    if (logistic) out[0] = c->classes == 2 ? lg_act(t, out[0], LG_SIGMOID) : lg_record_softmax(t, y);
    return LG_OK;
}

/* ---- from the window ---- */

static lg_status features(void *user, lg_tape *t, const lg_var *w, const lg_var *x, lg_var *f) {
    const lg_features *of = &((const chain *)user)->c->features;
    f[0] = lg_feature_rows[of->kind]->record(t, of, w[EPS], x[0]);
    return lg_is_none(f[0]) && lg_tape_status(t) == LG_OK ? LG_OUT_OF_MEMORY : lg_tape_status(t);
}

static lg_status value(void *user, lg_tape *t, const lg_var *w, const lg_var *x, lg_var *y) {
    lg_var f;
    LG_TRY(features(user, t, w, x, &f));
    return decide(user, t, w, &f, y);
}

static lg_status gradient(void *user, lg_tape *t, const lg_var *w, const lg_var *x, lg_var *y) {
    return lg_record_gradient(value, user, t, w, x, false, y);
}

static lg_status probability(void *user, lg_tape *t, const lg_var *w, const lg_var *x, lg_var *out) {
    const lg_var f = lg_program_call(t, "features", 0, x);
    out[0] = lg_program_call(t, "score", 0, &f);
    return lg_tape_status(t);
}

/* ---- the program ---- */

/* A program with `count` of the functions, from number `first` on. */
enum { SCORE = 1, FEATURES, FUNCTIONS = 6 }; /* numbers of functions, and how many there are */
static lg_status build(const lg_context *context, const lg_classifier *classifier, size_t first, size_t count,
                       lg_program **out, lg_error *error) {
    const lg_features *f = &classifier->features;
    chain ch = {.c = classifier};
    const lg_port x = {.name = "window", .shape = lg_shape2(f->channels, f->length)};
    const lg_port from = {.name = "features", .shape = lg_shape1(classifier->pca.inputs)};
    const lg_port y[] = {{.name = "y"}, {.name = "g"}}, scores = {.name = "scores"};
    const lg_function_spec functions[FUNCTIONS] = {
        {"decide", &from, 1, y, 1, decide, &ch},      {"score", &from, 1, &scores, 1, score, &ch},
        {"features", &x, 1, &from, 1, features, &ch}, {"value", &x, 1, y, 1, value, &ch},
        {"grad", &x, 1, y, 2, gradient, &ch},         {"probability", &x, 1, &scores, 1, probability, &ch}};
    LG_CLEAN(lg_program_destroy_at) lg_program *program = NULL;
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    add_parameters(&ch);
    spec.parameters = ch.parameter;
    spec.parameter_count = classifier->pca.inputs > 0 ? PARAMETERS : 1;
    spec.description = "a classifier of windows by their features";
    lg_status status = ch.failed
                           ? lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the parameters of a classifier")
                           : lg_program_begin(context, &spec, &program, error);
    for (size_t i = first; i < first + count && status == LG_OK; i++)
        status = lg_program_record_function(program, &functions[i], true, error);
    for (int i = 0; i < PARAMETERS; i++) lg_free(NULL, ch.own[i]);
    LG_TRY(status);
    return LG_MOVE(out, program);
}

lg_status lg_classifier_program(const lg_context *context, const lg_classifier *classifier, lg_program **out,
                                lg_error *error) {
    LG_NEEDS(error, classifier, out);
    if (classifier->pca.inputs == 0 || (unsigned)classifier->method >= LG_METHOD_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the classifier is not fitted");
    return build(context, classifier, 0,
                 classifier->features.count == classifier->pca.inputs ? FUNCTIONS : FEATURES, out, error);
}

lg_status lg_features_ready(lg_features *f, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *program = NULL;
    const lg_classifier alone = {.features = *f};
    LG_TRY(build(f->context, &alone, FEATURES, 1, &program, error));
    return lg_program_plan(program, "features", LG_F64, 1, &f->plan, error);
}

lg_status lg_classifier_ready(const lg_context *context, lg_classifier *classifier, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *program = NULL;
    lg_plan_options options;
    if (classifier->method == LG_METHOD_TREE) return LG_OK; /* a plan would visit all nodes */
    LG_TRY(build(context, classifier, 0, FEATURES, &program, error));
    lg_plan_options_init(&options);
    options.max_size = SIZE_MAX;
    return lg_plan_create(program, SCORE, &options, &classifier->scores, error);
}
