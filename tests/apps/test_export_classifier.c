/* Classical classifiers exported as C against the library: features, decisions and their Jacobian, scores and
 * classes of random windows in both types; windows whose covariance is singular; what is written beside them.
 * ctest-labels: slow apps/lg-export src/anomaly */
#include "export_classifier.h"

enum { ROWS = 1000, MOST = 512 };

/* ---- windows ---- */

static void as_floats(fitted *f, const double *x) {
    for (size_t i = 0; i < INPUTS; i++) f->window[i] = (float)x[i];
}

/* Within rounding of a threshold a window may fall on its other side. */
static bool is_decided(const exported *e) {
    const fitted *of = e->model;
    const lg_classifier *c = &of->classifier;
    const double margin = e->lib.single ? 1e-4 : 1e-12;
    double f[MOST], number[MOST];
    if (c->method != LG_METHOD_TREE) return true;
    assert_ok(lg_features_compute(&c->features, of->window, f, of->work));
    lg_pca_eval(&c->pca, f, 1, number, of->work);
    for (uint32_t i = 0; c->tree.node[i].left != 0;) {
        const lg_tree_node *node = &c->tree.node[i];
        if (fabs(number[node->feature] - node->threshold) < margin * (1 + fabs(node->threshold)))
            return false;
        i = number[node->feature] <= node->threshold ? node->left : node->right;
    }
    return true;
}

static void draw_window(void *user, lg_rng *rng, double *x) {
    const exported *e = user;
    fitted *f = e->model;
    do {
        classifier_window(rng, (uint32_t)lg_rng_below(rng, f->of->classes), f->window);
    } while (!is_decided(e));
    for (size_t i = 0; i < INPUTS; i++) x[i] = f->window[i];
}

static void reference(void *user, const double *x, double *y, double *jacobian) {
    fitted *f = ((const exported *)user)->model;
    as_floats(f, x);
    assert_ok(lg_classifier_decisions(&f->classifier, f->window, y, jacobian, f->work));
}

/* ---- NAME_features, NAME_classify ---- */

static void call_features(const exported *e, const double *x, double *out) {
    const size_t d = ((const fitted *)e->model)->classifier.features.count;
    void *in = export_reals(&e->lib, x, INPUTS), *to = export_reals(&e->lib, out, d);
    EXPORT_FUNCTION(&e->lib, "features", void, (const void *, void *, void *), features);
    export_spoil(&e->lib);
    features(in, to, e->lib.work);
    export_doubles(&e->lib, to, out, d);
    free(to);
    free(in);
}

/* Features: the norm of the differences, each in units of what training has seen of it. */
static double features_error(const double *got, const double *want, const lg_pca *pca) {
    double sum = 0, all = 0;
    for (size_t i = 0; i < pca->inputs; i++) {
        const double unit = fabs(pca->mean[i]) + pca->scale[i];
        sum += pow((got[i] - want[i]) / unit, 2);
        all += pow(want[i] / unit, 2);
    }
    return all > 0 ? sqrt(sum / all) : sqrt(sum);
}

static void check_classes(exported *e) {
    const fitted *f = e->model;
    const lg_classifier *c = &f->classifier;
    const uint32_t classes = f->of->classes;
    double x[INPUTS], got[MOST] = {0}, want[MOST], worst[2] = {0, 0};
    size_t seen[8] = {0}, close = 0;
    lg_rng rng;
    lg_rng_seed(&rng, 3, 4);
    for (size_t r = 0; r < ROWS; r++) {
        draw_window(e, &rng, x);
        assert_ok(lg_features_compute(&c->features, f->window, want, f->work));
        call_features(e, x, got);
        const double features = features_error(got, want, &c->pca);
        assert_true(features <= e->lib.tolerance);
        assert_ok(lg_classifier_window(c, f->window, want, f->work));
        const uint32_t class = lg_class_of(want, classes);
        double second = -INFINITY, size = 1;
        for (uint32_t k = 0; k < classes; k++) {
            if (k != class && want[k] > second) second = want[k];
            size = fmax(size, fabs(want[k]));
        }
        const int found = export_classify(&e->lib, x, got, classes);
        assert_int_equal(export_classify(&e->lib, x, NULL, classes), found);
        assert_true(found >= 0 && found < (int)classes);
        seen[found]++;
        if (want[class] - second <= 10 * e->lib.tolerance * size) {
            close++; /* the class is a matter of rounding */
            continue;
        }
        assert_int_equal(found, class);
        const double error = export_norm(got, want, classes) / size;
        if (!(error <= 4 * e->lib.tolerance)) fail_msg("%s: scores %.3g", e->name, error);
        worst[0] = fmax(worst[0], error);
        worst[1] = fmax(worst[1], features);
    }
    print_message("  scores %.2e, features %.2e; %zu close; classes", worst[0], worst[1], close);
    for (uint32_t k = 0; k < classes; k++) print_message(" %zu", seen[k]);
    print_message("\n");
    assert_true(close < ROWS / 10);
}

/* ---- windows on which something vanishes ---- */

enum { CONSTANT, ONE_CONSTANT, TWINS, TWO_VALUES, EDGES };

static void edge_window(int kind, double *x) {
    lg_rng rng;
    lg_rng_seed(&rng, 9, 9);
    float window[INPUTS];
    classifier_window(&rng, 0, window);
    for (size_t i = 0; i < INPUTS; i++) {
        x[i] = window[i];
        if (kind == CONSTANT) x[i] = window[i / LENGTH * LENGTH];
        if (kind == ONE_CONSTANT && i < LENGTH) x[i] = window[0];
        if (kind == TWINS) x[i] = window[i % LENGTH]; /* channels are the same: a covariance of rank 1 */
        if (kind == TWO_VALUES) x[i] = i % LENGTH == 5;
    }
}

static void check_edges(exported *e) {
    fitted *of = e->model;
    const lg_classifier *c = &of->classifier;
    const size_t size = e->lib.outputs * INPUTS;
    const double within = e->lib.tolerance;
    double *jacobian = TEST_ARRAY(double, size), *wanted = TEST_ARRAY(double, size);
    for (int kind = 0; kind < EDGES; kind++) {
        double x[INPUTS], y[MOST] = {0}, mine[MOST], f[MOST], got[MOST] = {0};
        edge_window(kind, x);
        as_floats(of, x);
        assert_ok(lg_classifier_decisions(c, of->window, mine, wanted, of->work));
        assert_ok(lg_features_compute(&c->features, of->window, f, of->work));
        call_features(e, x, got);
        const double error = features_error(got, f, &c->pca);
        if (!(error <= within)) fail_msg("%s, edge %d: features %.3g", e->name, kind, error);
        export_grad(&e->lib, x, y, jacobian);
        for (size_t i = 0; i < e->lib.outputs; i++) assert_true(isfinite(y[i]));
        for (size_t i = 0; i < size; i++) assert_true(isfinite(jacobian[i]));
        if (kind == CONSTANT && of->of->kind != RAW)
            for (size_t i = 0; i < size; i++) assert_true(jacobian[i] == 0);
        /* Both take the roots of channels that say the same for 0, and nothing along them. Far from all
         * support vectors single precision has no number for the gradient. */
        const bool some = export_norm(wanted, NULL, size) > 1e-30;
        const double slope = export_worst(jacobian, wanted, 1, size);
        if (some && !(slope <= 100 * within)) fail_msg("%s, edge %d: gradient %.3g", e->name, kind, slope);
    }
}

static void more(exported *e) {
    assert_int_equal(e->lib.inputs, INPUTS);
    assert_int_equal(e->lib.outputs, lg_classifier_outputs(&((const fitted *)e->model)->classifier));
    check_classes(e);
    check_edges(e);
}

static const export_kind classifiers = {
    LG_COUNT(samples), classifier_name, classifier_way, classifier_make, draw_window, reference, more};

TEST("features, decisions, scores and classes are the library's in double precision") {
    export_compare_all(&classifiers, "f64");
}

TEST("features, decisions, scores and classes are the library's in single precision") {
    export_compare_all(&classifiers, "f32");
}

TEST("a class may have no support vectors") {
    static const lg_method methods[] = {RBF, LINEAR};
    static const char *const names[] = {"lonely-rbf", "lonely-linear"};
    for (int i = 0; i < 2; i++) {
        sample of = samples[11]; /* raw-rbf, four classes */
        of.name = names[i];
        of.method = methods[i];
        fitted *f = classifier_fit(&of);
        lg_svm *svm = &f->classifier.svm;
        svm->vectors -= svm->vectors_of[3]; /* the last class loses its own */
        for (size_t r = 1; r < 3; r++)
            memmove(svm->coefficient + r * svm->vectors,
                    svm->coefficient + r * (svm->vectors + svm->vectors_of[3]),
                    svm->vectors * sizeof(double));
        svm->vectors_of[3] = 0;
        classifier_save(f);
        exported e = export_saved(of.name, "f64", 7, f);
        export_compile(&e, (export_way){"cc", "-O2"});
        export_compare(&e.lib, of.name, 100, draw_window, reference, &e);
        check_classes(&e);
        export_close(&e.lib);
    }
}

TEST("the header tells the windows, the classes, the features and where they come from") {
    (void)export_saved("std-tree", "f32", 7, classifier_make(5));
    export_expect_words("std-tree-f32/m.h",
                        "#define m_CHANNELS 4|#define m_LENGTH 33|#define m_CLASSES 2|"
                        "#define m_FEATURES 4|#define m_RATE 10.0|Gradient: 0 everywhere|0.9375|"
                        "bbbbbbbb|moment_y|std acc_lower_x");
    (void)export_saved("cov-logistic", "f32", 7, classifier_make(0));
    export_expect_words("cov-logistic-f32/m.h",
                        "cov acc_lower_x moment_x|logit of class 1|contains the factor");
    static cli result;
    cli_expect("lg-export", "cov-logistic.h5 --out told --name m --dtype f32 --json", 0, "", &result);
    static char numbers[EXPORT_TEXT]; /* those that are told in hexadecimal are the reals */
    assert_int_equal(export_shell("grep -o 0x told/m_weights.c | wc -l", numbers), 0);
    assert_true(atof(numbers) > 10 && json_number(result.out, "weights_bytes") >= 4.0 * atof(numbers));
}

TEST("classifiers are built in every way") {
    export_build(&classifiers, 3, "f32", export_check_ways);
    const exported e = export_saved(classifier_name(0), "f64", 7, classifier_make(0));
    export_check_objects(e.folder, "m");
}

TEST_GROUP(export_begin, export_end)
