/* Saving and loading of classifiers in archives. The same lists name the stored items for reading and for
 * writing. The reader checks all sizes before it allocates, and all values afterwards. */
#include "anomaly/classify/features.h"
#include "core/stored.h"

#include <math.h>
#include <string.h>

#define ROOT "classifier/"

#define NAMES   3
#define SCALARS 19
#define ARRAYS  19

static void list_names(lg_classifier *c, lg_stored out[NAMES]) {
#define NAME(path_, member, name_, count)                                                                    \
    { ROOT path_, .data = &(member), .name = name_, .names = count }
    const lg_stored rows[NAMES] = {
        NAME("method", c->method, lg_classifier_method_name, LG_METHOD_COUNT),
        NAME("features/kind", c->features.kind, lg_feature_kind_name, LG_FEATURE_KIND_COUNT),
        NAME("tree/criterion", c->tree.criterion, lg_tree_criterion_name, LG_CRITERION_COUNT)};
    memcpy(out, rows, sizeof rows);
}

/* Lists the numbers, which determine the sizes of all arrays. `bands` and `rate` are stored for the kinds
 * that use them, `convolutions` and `listed` for random convolutions. */
static void list_scalars(lg_classifier *c, lg_stored out[SCALARS]) {
    lg_features *f = &c->features;
    const lg_feature_row *kind = lg_feature_rows[f->kind];
    const bool rocket = f->kind == LG_FEATURES_ROCKET;
    const lg_stored rows[SCALARS] = {
        {ROOT "classes", LG_ELEMENT_U32, .data = &c->classes},
        {ROOT "features/channels", LG_ELEMENT_U32, .data = &f->channels},
        {ROOT "features/length", LG_ELEMENT_U32, .data = &f->length},
        {ROOT "features/selected", LG_ELEMENT_U32, .data = &f->selected},
        {ROOT "features/segments", LG_ELEMENT_U32, .data = &f->segments},
        {ROOT "features/pairs", LG_ELEMENT_U32, .data = &f->pairs},
        {ROOT "features/bands", LG_ELEMENT_U32, .data = kind->bands > 0 ? &f->bands : NULL},
        {ROOT "features/rate", LG_ELEMENT_F64, .data = kind->rated ? &f->rate : NULL},
        {ROOT "features/count", LG_ELEMENT_U32, .data = &f->count},
        {ROOT "pca/inputs", LG_ELEMENT_U32, .data = &c->pca.inputs},
        {ROOT "pca/components", LG_ELEMENT_U32, .data = &c->pca.components},
        {ROOT "pca/variances", LG_ELEMENT_U32, .data = &c->pca.variances},
        {ROOT "tree/nodes", LG_ELEMENT_U32, .data = &c->tree.count},
        {ROOT "svm/vectors", LG_ELEMENT_U32, .data = &c->svm.vectors},
        {ROOT "logistic/iterations", LG_ELEMENT_U32, .data = &c->logistic.iterations},
        {ROOT "rocket/convolutions", LG_ELEMENT_U32, .data = rocket ? &f->rocket.count : NULL},
        {ROOT "rocket/listed", LG_ELEMENT_U32, .data = rocket ? &f->rocket.listed : NULL},
        {ROOT "svm/gamma", LG_ELEMENT_F64, .data = &c->svm.gamma},
        {ROOT "svm/c", LG_ELEMENT_F64, .data = &c->svm.c},
    };
    memcpy(out, rows, sizeof rows);
}

/* Lists the arrays of the method and features in *c, whose sizes must be set. The nodes of a tree are stored
 * as one array *nodes (count, 6): feature, left, right, threshold, impurity, samples. */
static void list_arrays(lg_classifier *c, double **nodes, lg_stored out[ARRAYS]) {
    const bool features = c->features.count > 0, logistic = lg_method_is_linear(c->method);
    const bool tree = c->method == LG_METHOD_TREE, svm = lg_method_is_svm(c->method);
    const bool rocket = features && c->features.kind == LG_FEATURES_ROCKET;
    lg_rocket *r = &c->features.rocket;
    const uint64_t m = c->features.selected, d = c->pca.inputs, k = c->pca.components, classes = c->classes;
    const uint64_t inputs = lg_pca_outputs(&c->pca), rows = classes == 2 ? 1 : classes;
#define ROW_OF(positive_, path, type, rank, first, second, when, member)                                     \
    {                                                                                                        \
        ROOT path, LG_ELEMENT_##type, rank, {first, second}, (when) ? &(member) : NULL,                      \
            .pointed = true, .positive = positive_                                                           \
    }
#define ROW(...)      ROW_OF(false, __VA_ARGS__)
#define POSITIVE(...) ROW_OF(true, __VA_ARGS__)
    const lg_stored list[ARRAYS] = {
        ROW("features/select", U32, 1, m, 0, features, c->features.select),
        ROW("features/pair", U32, 2, c->features.pairs, 2, c->features.pairs > 0, c->features.pair),
        POSITIVE("features/scale", F64, 1, c->features.channels, 0, features, c->features.scale),
        ROW("pca/mean", F64, 1, d, 0, true, c->pca.mean),
        POSITIVE("pca/scale", F64, 1, d, 0, true, c->pca.scale),
        ROW("pca/vectors", F64, 2, d, k, k > 0, c->pca.vectors),
        ROW("pca/variance", F64, 1, c->pca.variances, 0, c->pca.variances > 0, c->pca.variance),
        ROW("logistic/weight", F64, 2, rows, inputs, logistic, c->logistic.weight),
        ROW("logistic/intercept", F64, 1, rows, 0, logistic, c->logistic.intercept),
        ROW("tree/node", F64, 2, c->tree.count, 6, tree, *nodes),
        ROW("tree/counts", U32, 2, c->tree.count, classes, tree, c->tree.counts),
        ROW("svm/vectors_of", U32, 1, classes, 0, svm, c->svm.vectors_of),
        ROW("svm/vector", F64, 2, c->svm.vectors, inputs, svm, c->svm.vector),
        ROW("svm/coefficient", F64, 2, classes - 1, c->svm.vectors, svm, c->svm.coefficient),
        ROW("svm/rho", F64, 1, classes * (classes - 1) / 2, 0, svm, c->svm.rho),
        ROW("rocket/convolution", U32, 2, r->count, 5, rocket, r->convolution),
        ROW("rocket/channel", U32, 1, r->listed, 0, rocket, r->channel),
        ROW("rocket/bias", F32, 1, c->features.count, 0, rocket, r->bias),
        ROW("rocket/mean", F64, 1, c->features.channels, 0, rocket, r->mean),
    };
    memcpy(out, list, sizeof list);
}

/* ---- writing ---- */

static double *pack_nodes(const lg_tree *tree) {
    double *out = lg_alloc(NULL, tree->count, 6 * sizeof *out);
    for (uint32_t i = 0; out != NULL && i < tree->count; i++) {
        const lg_tree_node *n = &tree->node[i];
        const double row[6] = {n->feature, n->left, n->right, n->threshold, n->impurity, n->samples};
        memcpy(out + 6 * (size_t)i, row, sizeof row);
    }
    return out;
}

lg_status lg_classifier_save(const lg_classifier *classifier, const lg_archive_writer *writer,
                             lg_error *error) {
    if (classifier == NULL || writer == NULL || (unsigned)classifier->method >= LG_METHOD_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "no classifier to save");
    /* A copy that is only read, because the list takes pointers without const. */
    lg_classifier c = *classifier;
    double *nodes = NULL;
    lg_stored rows[NAMES + SCALARS + ARRAYS];
    if (c.method == LG_METHOD_TREE && (nodes = pack_nodes(&c.tree)) == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory to save %u nodes", c.tree.count);
    list_names(&c, rows);
    list_scalars(&c, rows + NAMES);
    list_arrays(&c, &nodes, rows + NAMES + SCALARS);
    const lg_status status = lg_stored_save(writer, rows, LG_COUNT(rows), error);
    lg_free(NULL, nodes);
    return status;
}

/* ---- reading ---- */

static lg_status wrong(lg_error *error, const char *path, const char *what) {
    return lg_fail(error, LG_FORMAT, ROOT "%s %s", path, what);
}

/* Checks that the sizes that were read fit each other, and sets those that follow from them. */
static lg_status take_sizes(lg_classifier *c, lg_error *error) {
    const lg_features *f = &c->features;
    const bool baseline = f->kind == LG_FEATURES_BASELINE, spectrum = f->kind == LG_FEATURES_SPECTRUM;
    const bool rocket = f->kind == LG_FEATURES_ROCKET, svm = lg_method_is_svm(c->method);
    const uint32_t convolutions = f->rocket.count;
    c->logistic.classes = c->tree.classes = c->svm.classes = c->classes;
    c->logistic.inputs = c->tree.inputs = c->svm.inputs = lg_pca_outputs(&c->pca);
    c->svm.kernel = c->method == LG_METHOD_SVM_RBF ? LG_KERNEL_RBF : LG_KERNEL_LINEAR;
    const struct {
        bool good;
        const char *path, *what;
    } rules[] = {
        {c->classes >= 2 && c->classes <= LG_CLASSES_MAX, "classes", "is out of range"},
        {f->channels <= LG_FEATURES_MAX, "features/channels", "is out of range"},
        {(f->count > 0) == (f->channels > 0) && (f->count > 0) == (f->length > 0), "features/count",
         "does not fit channels and length"},
        {(uint64_t)f->channels * f->length <= UINT32_MAX, "features/length", "is out of range"},
        {f->selected <= f->channels && (f->count > 0) == (f->selected > 0), "features/selected",
         "does not fit the channels"},
        {baseline && f->count > 0 ? f->segments >= 1 && f->segments <= f->length : f->segments == 0,
         "features/segments", "is out of range"},
        {f->pairs <= f->channels && (baseline || f->pairs == 0), "features/pairs", "is out of range"},
        {f->bands == lg_spectrum_bands(f->length, f->bands) && (f->bands > 0) == (spectrum && f->count > 0),
         "features/bands", "is out of range"},
        {!lg_feature_rows[f->kind]->rated || (isfinite(f->rate) && f->rate > 0), "features/rate",
         "is out of range"},
        {(rocket || f->count == lg_features_count(f)) && f->count <= LG_FEATURES_MAX, "features/count",
         "does not fit the kind of the features"},
        {convolutions <= f->count && (convolutions > 0) == (rocket && f->count > 0), "rocket/convolutions",
         "does not fit the features"},
        {f->rocket.listed <= (uint64_t)convolutions * f->selected, "rocket/listed",
         "does not fit the channels"},
        {c->pca.inputs >= 1 && c->pca.inputs <= LG_FEATURES_MAX &&
             (f->count == 0 || c->pca.inputs == f->count),
         "pca/inputs", "is not the number of features"},
        {c->pca.components <= c->pca.inputs, "pca/components", "is larger than the number of features"},
        {c->pca.components > 0 ? c->pca.variances >= c->pca.components && c->pca.variances <= c->pca.inputs
                               : c->pca.variances == 0,
         "pca/variances", "does not fit the components"},
        {(c->tree.count > 0) == (c->method == LG_METHOD_TREE), "tree/nodes", "does not fit the method"},
        {(c->svm.vectors > 0) == svm, "svm/vectors", "does not fit the method"},
        {isfinite(c->svm.gamma) && c->svm.gamma >= 0.0, "svm/gamma", "is out of range"},
        {isfinite(c->svm.c) && (c->svm.c > 0.0) == svm, "svm/c", "is out of range"},
    };
    for (size_t i = 0; i < LG_COUNT(rules); i++)
        if (!rules[i].good) return wrong(error, rules[i].path, rules[i].what);
    return LG_OK;
}

static lg_status check_features(const lg_classifier *c, lg_error *error) {
    const lg_features *f = &c->features;
    for (uint32_t i = 0; i < f->selected; i++)
        if (f->select[i] >= f->channels || (i > 0 && f->select[i] <= f->select[i - 1]))
            return wrong(error, "features/select", "is not a rising list of channels");
    for (uint32_t i = 0; i < 2 * f->pairs; i++)
        if (f->pair[i] >= f->channels)
            return wrong(error, "features/pair", "names a channel that does not exist");
    const lg_rocket_table table = lg_rocket_table_of(&f->rocket);
    const char *what = table.count > 0 ? lg_rocket_check(&table, f->selected, f->length, f->count) : NULL;
    return what == NULL ? LG_OK : wrong(error, "rocket/convolution", what);
}

static bool is_index(double x, double below) {
    return x >= 0.0 && x < below && floor(x) == x;
}

/* Converts rows (count, 6) to tree->node and checks that they form a tree: children come after their parent,
 * and each node except the root is the child of exactly one node. Returns NULL, or what is wrong. depth
 * (count) must be 0 on entry. */
static const char *unpack_nodes(lg_tree *tree, const double *rows, uint32_t *depth) {
    for (uint32_t i = 0; i < tree->count; i++) {
        const double *row = rows + 6 * (size_t)i;
        if (!is_index(row[0], tree->inputs)) return "names a feature that does not exist";
        if (!is_index(row[1], tree->count) || !is_index(row[2], tree->count))
            return "names a child node that does not exist";
        if (!is_index(row[5], 0x1p32))
            return "has a number of samples that is not a whole number from 0 to 2^32 - 1";
        const uint32_t left = (uint32_t)row[1], right = (uint32_t)row[2];
        if ((left == 0) != (right == 0)) return "has a node with one child";
        if (left != 0 && (left <= i || right <= i || left == right || depth[left] || depth[right]))
            return "is not a tree: a child comes before its parent, or has two parents";
        if (left != 0) depth[left] = depth[right] = depth[i] + 1;
        if (depth[i] > tree->depth) tree->depth = depth[i];
        tree->node[i] = (lg_tree_node){(uint32_t)row[0], left, right, row[3], row[4], (uint32_t)row[5]};
    }
    for (uint32_t i = 1; i < tree->count; i++)
        if (depth[i] == 0) return "has a node that is no child of any node";
    return NULL;
}

static lg_status check_tree(const lg_context *context, lg_tree *tree, const double *rows, lg_error *error) {
    LG_SCRATCH(uint32_t, depth, context, tree->count);
    tree->node = lg_alloc(context, tree->count, sizeof *tree->node);
    if (depth == NULL || tree->node == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %u nodes", tree->count);
    const char *what = unpack_nodes(tree, rows, depth);
    if (what != NULL) return wrong(error, "tree/node", what);
    for (uint32_t i = 0; i < tree->count; i++) {
        uint64_t sum = 0;
        for (uint32_t c = 0; c < tree->classes; c++) sum += tree->counts[(size_t)i * tree->classes + c];
        if (sum == 0 || sum != tree->node[i].samples)
            return wrong(error, "tree/counts", "does not add up to the number of samples of each node");
    }
    return LG_OK;
}

static lg_status check_svm(const lg_svm *svm, lg_error *error) {
    uint64_t sum = 0;
    for (uint32_t c = 0; c < svm->classes; c++) sum += svm->vectors_of[c];
    return sum == svm->vectors
               ? LG_OK
               : wrong(error, "svm/vectors_of", "does not add up to the number of support vectors");
}

static lg_status read_classifier(const lg_context *context, const lg_archive_reader *r, lg_classifier *c,
                                 double **nodes, lg_error *error) {
    lg_stored names[NAMES], scalars[SCALARS], arrays[ARRAYS];
    list_names(c, names);
    LG_TRY(lg_stored_load(r, names, NAMES, error));
    list_scalars(c, scalars);
    lg_status status = lg_stored_load(r, scalars, SCALARS, error);
    if (status == LG_SHAPE) status = lg_as_format(status, error);
    LG_TRY(status);
    LG_TRY(take_sizes(c, error));
    list_arrays(c, nodes, arrays);
    LG_TRY(lg_stored_make(context, r, arrays, ARRAYS, error));
    LG_TRY(check_features(c, error));
    if (c->features.bands > 0)
        LG_TRY(
            lg_spectrum_create(context, c->features.length, c->features.bands, &c->features.spectrum, error));
    if (c->method == LG_METHOD_TREE) LG_TRY(check_tree(context, &c->tree, *nodes, error));
    if (lg_method_is_svm(c->method)) LG_TRY(check_svm(&c->svm, error));
    return c->features.count > 0 ? lg_features_ready(&c->features, error) : LG_OK;
}

/* Clears the models of the other methods; only their sizes have been set. */
static void forget_others(lg_classifier *c) {
    if (!lg_method_is_linear(c->method)) c->logistic = (lg_logistic){0};
    if (c->method != LG_METHOD_TREE) c->tree = (lg_tree){0};
    if (!lg_method_is_svm(c->method)) c->svm = (lg_svm){0};
}

lg_status lg_classifier_load(const lg_context *context, const lg_archive_reader *reader, lg_classifier *out,
                             lg_error *error) {
    LG_NEEDS(error, reader, out);
    LG_CLEAN(lg_classifier_destroy)
    lg_classifier c = {.features = {.context = context},
                       .pca = {.context = context},
                       .logistic = {.context = context},
                       .tree = {.context = context},
                       .svm = {.context = context}};
    double *nodes = NULL;
    *out = (lg_classifier){0};
    const lg_status status = read_classifier(context, reader, &c, &nodes, error);
    lg_free(context, nodes);
    LG_TRY(status);
    forget_others(&c);
    LG_TRY(lg_classifier_ready(context, &c, error));
    return LG_GIVE(out, c);
}
