/* Classical classifiers exported as C against the library: features, decisions and their Jacobian, scores and
 * classes of random windows in both types; windows whose covariance is singular; what is written beside them.
 */
#include "export_classifier.h"

enum { ROWS = 1000, INPUTS = CHANNELS * LENGTH, MOST = 512 };

typedef struct pair {
    const sample *of;
    fitted here;
    export_library lib;
    double *work;
    float window[INPUTS];
} pair;

static void open_pair(pair *p, const sample *of, const char *dtype) {
    char folder[64];
    p->of = of;
    classifier_make(of, &p->here);
    classifier_export(&p->here, of->folder, dtype, folder, sizeof folder);
    p->lib = export_open(folder, "m", export_has(of->compiler) ? of->compiler : "cc", of->flags);
    p->work = calloc(lg_classifier_work_size(&p->here.classifier) / sizeof(double) +
                         lg_classifier_jacobian_work_size(&p->here.classifier) / sizeof(double),
                     sizeof *p->work);
    assert_int_equal(p->lib.inputs, INPUTS);
    assert_int_equal(p->lib.outputs, lg_classifier_outputs(&p->here.classifier));
}

static void close_pair(pair *p) {
    export_close(&p->lib);
    classifier_free(&p->here);
    free(p->work);
}

/* ---- windows ---- */

static void as_floats(pair *p, const double *x) {
    for (size_t i = 0; i < INPUTS; i++) p->window[i] = (float)x[i];
}

/* Within rounding of a threshold a window may fall on its other side. */
static bool is_decided(pair *p) {
    const lg_classifier *c = &p->here.classifier;
    const double margin = p->lib.single ? 1e-4 : 1e-12;
    double f[MOST], number[MOST];
    if (c->method != LG_METHOD_TREE) return true;
    assert_ok(lg_features_compute(&c->features, p->window, f, p->work));
    lg_pca_eval(&c->pca, f, 1, number, p->work);
    for (uint32_t i = 0; c->tree.node[i].left != 0;) {
        const lg_tree_node *node = &c->tree.node[i];
        if (fabs(number[node->feature] - node->threshold) < margin * (1 + fabs(node->threshold)))
            return false;
        i = number[node->feature] <= node->threshold ? node->left : node->right;
    }
    return true;
}

static void draw_window(void *user, lg_rng *rng, double *x) {
    pair *p = user;
    do {
        classifier_window(rng, (uint32_t)lg_rng_below(rng, p->of->classes), p->window);
    } while (!is_decided(p));
    for (size_t i = 0; i < INPUTS; i++) x[i] = p->window[i];
}

static void reference(void *user, const double *x, double *y, double *jacobian) {
    pair *p = user;
    as_floats(p, x);
    assert_ok(lg_classifier_decisions(&p->here.classifier, p->window, y, jacobian, p->work));
}

/* ---- NAME_features, NAME_classify ---- */

static void call_features(const pair *p, const double *x, double *out) {
    const size_t d = p->here.classifier.features.count;
    void *in = export_reals(&p->lib, x, INPUTS), *to = export_reals(&p->lib, out, d);
    EXPORT_FUNCTION(&p->lib, "features", void, (const void *, void *, void *), features);
    export_spoil(&p->lib);
    features(in, to, p->lib.work);
    export_doubles(&p->lib, to, out, d);
    free(to);
    free(in);
}

static int call_classify(const pair *p, const double *x, double *score) {
    void *in = export_reals(&p->lib, x, INPUTS), *out = export_reals(&p->lib, score, p->of->classes);
    EXPORT_FUNCTION(&p->lib, "classify", int, (const void *, void *, void *), classify);
    export_spoil(&p->lib);
    const int class = classify(in, out, p->lib.work);
    export_doubles(&p->lib, out, score, p->of->classes);
    free(out);
    free(in);
    return class;
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

static void check_classes(pair *p) {
    const lg_classifier *c = &p->here.classifier;
    const uint32_t classes = p->of->classes;
    double x[INPUTS], got[MOST] = {0}, want[MOST], worst[2] = {0, 0};
    size_t seen[8] = {0}, close = 0;
    lg_rng rng;
    lg_rng_seed(&rng, 3, 4);
    for (size_t r = 0; r < ROWS; r++) {
        draw_window(p, &rng, x);
        assert_ok(lg_features_compute(&c->features, p->window, want, p->work));
        call_features(p, x, got);
        const double features = features_error(got, want, &c->pca);
        assert_true(features <= p->lib.tolerance);
        assert_ok(lg_classifier_window(c, p->window, want, p->work));
        const uint32_t class = lg_class_of(want, classes);
        double second = -INFINITY, size = 1;
        for (uint32_t k = 0; k < classes; k++) {
            if (k != class && want[k] > second) second = want[k];
            size = fmax(size, fabs(want[k]));
        }
        const int found = call_classify(p, x, got);
        assert_int_equal(call_classify(p, x, NULL), found);
        assert_true(found >= 0 && found < (int)classes);
        seen[found]++;
        if (want[class] - second <= 10 * p->lib.tolerance * size) {
            close++; /* the class is a matter of rounding */
            continue;
        }
        assert_int_equal(found, class);
        const double error = export_norm(got, want, classes) / size;
        if (!(error <= 4 * p->lib.tolerance)) fail_msg("%s: scores %.3g", p->of->folder, error);
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

static void check_edges(pair *p) {
    const size_t outputs = p->lib.outputs;
    for (int kind = 0; kind < EDGES; kind++) {
        double x[INPUTS], y[MOST] = {0}, mine[MOST], f[MOST], got[MOST] = {0};
        double *jacobian = calloc(outputs * INPUTS, sizeof *jacobian);
        double *wanted = calloc(outputs * INPUTS, sizeof *wanted);
        edge_window(kind, x);
        as_floats(p, x);
        assert_ok(lg_classifier_decisions(&p->here.classifier, p->window, mine, wanted, p->work));
        assert_ok(lg_features_compute(&p->here.classifier.features, p->window, f, p->work));
        call_features(p, x, got);
        const double within = p->lib.tolerance;
        const double error = features_error(got, f, &p->here.classifier.pca);
        if (!(error <= within)) fail_msg("%s, edge %d: features %.3g", p->of->folder, kind, error);
        export_grad(&p->lib, x, y, jacobian);
        for (size_t i = 0; i < outputs; i++) assert_true(isfinite(y[i]));
        for (size_t i = 0; i < outputs * INPUTS; i++) assert_true(isfinite(jacobian[i]));
        if (kind == CONSTANT && p->of->kind != RAW)
            for (size_t i = 0; i < outputs * INPUTS; i++) assert_true(jacobian[i] == 0);
        /* Both take the roots of channels that say the same for 0, and nothing along them. Far from all
         * support vectors single precision has no number for the gradient. */
        const bool some = export_norm(wanted, NULL, outputs * INPUTS) > 1e-30;
        const double slope = export_worst(jacobian, wanted, 1, outputs * INPUTS);
        if (some && !(slope <= 100 * within))
            fail_msg("%s, edge %d: gradient %.3g", p->of->folder, kind, slope);
        free(wanted);
        free(jacobian);
    }
}

static void check_nan(pair *p) {
    const lg_features *f = &p->here.classifier.features;
    double x[INPUTS], y[MOST] = {0};
    edge_window(ONE_CONSTANT, x);
    for (uint32_t i = 0; i < f->selected; i++) {
        if (p->of->kind == BASELINE && f->select[i] == 1 && p->of->directions_x) continue;
        const double before = x[f->select[i] * LENGTH + 20];
        x[f->select[i] * LENGTH + 20] = NAN;
        export_eval(&p->lib, x, y);
        for (size_t o = 0; o < p->lib.outputs; o++) assert_true(isnan(y[o]));
        x[f->select[i] * LENGTH + 20] = before;
    }
}

static void same_numbers(const char *dtype) {
    for (size_t s = 0; s < SAMPLES; s++) {
        pair p;
        char title[96];
        open_pair(&p, &samples[s], dtype);
        (void)snprintf(title, sizeof title, "%s %s", samples[s].folder, dtype);
        export_compare(&p.lib, title, ROWS, draw_window, reference, &p);
        check_classes(&p);
        check_edges(&p);
        check_nan(&p);
        close_pair(&p);
    }
}

static void in_double(void **state) {
    (void)state;
    same_numbers("f64");
}

static void in_float(void **state) {
    (void)state;
    same_numbers("f32");
}

/* ---- one sample, a class without vectors ---- */

static void lonely_class(void **state) {
    (void)state;
    sample of = samples[11]; /* raw-rbf, four classes */
    for (int linear = 0; linear < 2; linear++) {
        pair p = {.of = &of};
        char folder[64];
        of.folder = linear ? "lonely-linear" : "lonely-rbf";
        of.method = linear ? LINEAR : RBF;
        classifier_make(&of, &p.here);
        lg_svm *svm = &p.here.classifier.svm;
        /* the last class loses its vectors */
        svm->vectors -= svm->vectors_of[3];
        for (size_t r = 1; r < 3; r++)
            memmove(svm->coefficient + r * svm->vectors,
                    svm->coefficient + r * (svm->vectors + svm->vectors_of[3]),
                    svm->vectors * sizeof(double));
        svm->vectors_of[3] = 0;
        classifier_export(&p.here, of.folder, "f64", folder, sizeof folder);
        p.lib = export_open(folder, "m", "cc", "-O2");
        p.work = calloc(lg_classifier_work_size(&p.here.classifier) / sizeof(double) +
                            lg_classifier_jacobian_work_size(&p.here.classifier) / sizeof(double),
                        sizeof *p.work);
        export_compare(&p.lib, of.folder, 100, draw_window, reference, &p);
        check_classes(&p);
        close_pair(&p);
    }
}

static void expect_words(const char *path, const char *const *words, size_t count) {
    static char text[CLI_TEXT];
    assert_true(cli_read(path, text, sizeof text) > 0);
    for (size_t i = 0; i < count; i++)
        if (strstr(text, words[i]) == NULL) fail_msg("%s does not say '%s'", path, words[i]);
}

static void documented(void **state) {
    (void)state;
    fitted of;
    char folder[64];
    classifier_make(&samples[5], &of); /* std-tree */
    classifier_export(&of, "tree", "f32", folder, sizeof folder);
    classifier_free(&of);
    static const char *const tree[] = {"#define m_CHANNELS 4",
                                       "#define m_LENGTH 33",
                                       "#define m_CLASSES 2",
                                       "#define m_FEATURES 4",
                                       "#define m_RATE 10.0",
                                       "Gradient: 0 everywhere",
                                       "0.9375",
                                       "bbbbbbbb",
                                       "moment_y",
                                       "std acc_lower_x"};
    expect_words("tree-f32/m.h", tree, LG_COUNT(tree));
    classifier_make(&samples[0], &of); /* cov-logistic */
    classifier_export(&of, "cov", "f32", folder, sizeof folder);
    classifier_free(&of);
    static const char *const cov[] = {"cov acc_lower_x moment_x", "logit of class 1", "contains the factor"};
    expect_words("cov-f32/m.h", cov, LG_COUNT(cov));
}

static void builds(void **state) {
    (void)state;
    static const size_t chosen[] = {0, 3};
    for (size_t i = 0; i < 2; i++) {
        fitted of;
        char folder[64];
        classifier_make(&samples[chosen[i]], &of);
        classifier_export(&of, "ways", i == 0 ? "f64" : "f32", folder, sizeof folder);
        classifier_free(&of);
        if (i == 1) export_check_ways(folder, "m");
        export_check_objects(folder, "m");
    }
}

static void damaged_file(void **state) {
    (void)state;
    static cli result;
    fitted of;
    classifier_make(&samples[0], &of);
    classifier_save(&of, "whole");
    classifier_free(&of);
    export_expect("head -c 3000 whole.h5 > half.h5");
    cli_expect("lg-export", "half.h5 --out half", 3, "half.h5", &result);
    assert_false(cli_exists("half"));
}

static int setup(void **state) {
    (void)state;
    return export_begin();
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(in_double),  cmocka_unit_test(in_float), cmocka_unit_test(lonely_class),
        cmocka_unit_test(documented), cmocka_unit_test(builds),   cmocka_unit_test(damaged_file),
    };
    return cmocka_run_group_tests(tests, setup, export_end);
}
