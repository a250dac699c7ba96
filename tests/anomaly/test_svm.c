/* Support vector machines: decisions equal to libsvm's, optimality conditions of the dual, planes, absent
 * classes, both layouts of the kernel, difficult tables. */
#include "classify_support.h"

#include <libsvm/svm.h>

OWNED(lg_svm, lg_svm_destroy)

static const lg_svm *fit(lg_kernel kernel, double c, double gamma, const double *x, const uint32_t *label,
                         size_t n, uint32_t d, uint32_t classes) {
    lg_svm svm;
    assert_ok(lg_svm_fit(NULL, kernel, c, gamma, x, label, n, d, classes, &svm, NULL));
    return own_lg_svm(svm);
}

/* ---- libsvm on the same table ---- */

static void quiet(const char *text) {
}

typedef struct reference {
    struct svm_node *nodes, **rows;
    double *target;
    struct svm_model *model;
} reference;

static struct svm_node *node_row(const double *x, uint32_t d, struct svm_node *out) {
    for (uint32_t j = 0; j < d; j++) out[j] = (struct svm_node){(int)j + 1, x[j]};
    out[d].index = -1;
    return out;
}

/* Passes the rows to libsvm sorted by class, because libsvm numbers classes in the order in which they
 * occur. */
static void reference_train(reference *r, const double *x, const uint32_t *label, size_t n, uint32_t d,
                            uint32_t classes, const lg_svm *like) {
    r->nodes = malloc(n * (d + 1) * sizeof *r->nodes);
    r->rows = malloc(n * sizeof *r->rows);
    r->target = malloc(n * sizeof *r->target);
    size_t at = 0;
    for (uint32_t c = 0; c < classes; c++)
        for (size_t i = 0; i < n; i++)
            if (label[i] == c) {
                r->target[at] = c;
                r->rows[at] = node_row(x + i * d, d, r->nodes + at * (d + 1));
                at++;
            }
    const struct svm_problem problem = {(int)n, r->target, r->rows};
    const struct svm_parameter parameter = {.svm_type = C_SVC,
                                            .kernel_type = like->kernel == LG_KERNEL_RBF ? RBF : LINEAR,
                                            .gamma = like->gamma,
                                            .cache_size = 200,
                                            .eps = 1e-3,
                                            .C = like->c,
                                            .shrinking = 1};
    svm_set_print_string_function(quiet);
    r->model = svm_train(&problem, &parameter);
}

static void reference_free(reference *r) {
    svm_free_and_destroy_model(&r->model);
    free(r->nodes);
    free(r->rows);
    free(r->target);
}

/* Scores as lg_classifier_score defines them, computed from libsvm's decisions. */
static void scores_of(const double *decision, uint32_t classes, double *score) {
    double lean[8] = {0};
    memset(score, 0, classes * sizeof *score);
    if (classes == 2) {
        score[0] = decision[0];
        score[1] = -decision[0];
        return;
    }
    for (uint32_t i = 0, p = 0; i < classes; i++)
        for (uint32_t j = i + 1; j < classes; j++, p++) {
            score[decision[p] > 0 ? i : j] += 1;
            lean[i] += decision[p];
            lean[j] -= decision[p];
        }
    uint32_t first = 0, largest = 0;
    for (uint32_t i = 1; i < classes; i++)
        if (score[i] > score[first]) first = i;
    for (uint32_t i = 0; i < classes; i++) score[i] += lean[i] / (3 * (fabs(lean[i]) + 1));
    for (uint32_t i = 1; i < classes; i++)
        if (score[i] > score[largest]) largest = i;
    score[first] = score[largest]; /* or the next larger number */
}

TEST("ties of votes are decided as libsvm does") {
    enum { N = 240, D = 2, CLASSES = 6 };
    uint32_t ties = 0, turned = 0;
    for (int kernel = LG_KERNEL_LINEAR; kernel <= LG_KERNEL_RBF; kernel++) {
        uint32_t label[N];
        double *x = clouds(N, D, CLASSES, 0.3, 3, label), *other = clouds(N, D, 2, 0.0, 4, (uint32_t[N]){0});
        const lg_svm *svm = fit((lg_kernel)kernel, 10.0, 2.0, x, label, N, D, CLASSES);
        double score[CLASSES];
        reference r;
        reference_train(&r, x, label, N, D, CLASSES, svm);
        for (uint32_t i = 0; i < N; i++) {
            struct svm_node node[D + 1];
            double decision[15], votes[CLASSES] = {0}, lean[CLASSES] = {0};
            const double *row = other + (size_t)i * D;
            (void)svm_predict_values(r.model, node_row(row, D, node), decision);
            for (uint32_t a = 0, p = 0; a < CLASSES; a++)
                for (uint32_t b = a + 1; b < CLASSES; b++, p++) {
                    votes[decision[p] > 0 ? a : b]++;
                    lean[a] += decision[p];
                    lean[b] -= decision[p];
                }
            const uint32_t wanted = (uint32_t)svm_predict(r.model, node);
            svm_scores(svm, row, 1, score);
            bool tie = false, turn = false;
            for (uint32_t c = 0; c < CLASSES; c++) {
                assert_true(c == wanted || score[c] < score[wanted]);
                assert_true(fabs(score[c] - votes[c]) <= 1.0 / 3.0);
                tie = tie || (c != wanted && votes[c] == votes[wanted]);
                turn = turn || (votes[c] == votes[wanted] && lean[c] > lean[wanted]);
            }
            ties += tie;
            turned += turn;
        }
        reference_free(&r);
    }
    print_message("%u ties, %u would turn\n", ties, turned);
    assert_true(ties > 20 && turned > 5);
}

TEST("decisions agree with libsvm, for lists and for tables") {
    static const struct {
        lg_kernel kernel;
        uint32_t n, d, classes;
        double c, gamma;
        /* few features: the same lists and the same bits; more features: a table, to libsvm's tolerance */
        double rtol;
    } cases[] = {
        {LG_KERNEL_RBF, 120, 4, 2, 1.0, 0.0, 1e-12},   {LG_KERNEL_LINEAR, 120, 4, 2, 10.0, 0.0, 1e-12},
        {LG_KERNEL_RBF, 120, 4, 4, 100.0, 0.3, 1e-12}, {LG_KERNEL_LINEAR, 90, 3, 3, 1.0, 0.0, 1e-12},
        {LG_KERNEL_RBF, 131, 20, 3, 10.0, 0.0, 5e-3},  {LG_KERNEL_LINEAR, 131, 9, 2, 0.1, 0.0, 5e-3},
        {LG_KERNEL_LINEAR, 20, 600, 4, 1.0, 0.0, 5e-3}};
    for (size_t t = 0; t < sizeof cases / sizeof cases[0]; t++) {
        const uint32_t n = cases[t].n, d = cases[t].d, classes = cases[t].classes;
        uint32_t label[131];
        double *x = clouds(n, d, classes, 1.0, 20 + t, label), *score = TEST_ARRAY(double, n *classes);
        lg_svm svm;
        lg_error e;
        const lg_status status =
            lg_svm_fit(NULL, cases[t].kernel, cases[t].c, cases[t].gamma, x, label, n, d, classes, &svm, &e);
        if (status != LG_OK) fail_msg("%s", e.message);
        svm_scores(&svm, x, n, score);
        reference r;
        reference_train(&r, x, label, n, d, classes, &svm);
        struct svm_node *node = TEST_ARRAY(struct svm_node, d + 1);
        for (uint32_t i = 0; i < n; i++) {
            double decision[6], expected[4], alone[4];
            (void)svm_predict_values(r.model, node_row(x + i * d, d, node), decision);
            scores_of(decision, classes, expected);
            svm_scores(&svm, x + i * d, 1, alone);
            for (uint32_t c = 0; c < classes; c++) {
                if (classes == 2 || cases[t].rtol < 1e-6)
                    assert_close(score[i * classes + c], expected[c], cases[t].rtol, cases[t].rtol);
                else /* a vote may differ */
                    assert_true(fabs(score[i * classes + c] - expected[c]) < 1.0);
                assert_close(alone[c], score[i * classes + c], 1e-12, 1e-12);
            }
        }
        reference_free(&r);
        lg_svm_destroy(&svm);
    }
}

/* Karush-Kuhn-Tucker conditions: y f(x) >= 1 for rows that are not support vectors, <= 1 at the bound C, = 1
 * in between, each within libsvm's tolerance of 1e-3; with tables and with lists. */
TEST("the dual solution is optimal (Karush, Kuhn, Tucker)") {
    for (uint32_t d = 3; d <= 12; d += 9) {
        enum { N = 201 };
        uint32_t label[N];
        double *x = clouds(N, d, 2, 0.7, 31, label), score[2 * N], sum = 0;
        const lg_svm *svm = fit(LG_KERNEL_RBF, 2.0, 0.0, x, label, N, d, 2);
        svm_scores(svm, x, N, score);
        for (uint32_t v = 0; v < svm->vectors; v++) sum += svm->coefficient[v];
        assert_close(sum, 0.0, 0, 1e-10);
        for (int i = 0; i < N; i++) {
            double alpha = 0.0;
            for (uint32_t v = 0; v < svm->vectors; v++)
                if (memcmp(svm->vector + v * d, x + (size_t)i * d, d * sizeof *x) == 0)
                    alpha = fabs(svm->coefficient[v]);
            const double margin = score[2 * i + label[i]];
            if (alpha < 2.0) assert_true(margin >= 1.0 - 2e-3);
            if (alpha > 0.0) assert_true(margin <= 1.0 + 2e-3);
        }
        double mean = 0, var = 0; /* gamma = 1/(d var) */
        for (size_t i = 0; i < N * d; i++) mean += x[i] / (N * d);
        for (size_t i = 0; i < N * d; i++) var += (x[i] - mean) * (x[i] - mean) / (N * d);
        assert_close(svm->gamma, 1.0 / (d * var), 1e-12, 0);
    }
}

TEST("for two points the plane is half-way, both margins are 1, and class 1 is on the positive side") {
    const double x[] = {1.0, 0.0, 3.0, 0.0};
    const uint32_t label[] = {0, 1};
    const lg_svm *svm = fit(LG_KERNEL_LINEAR, 10.0, 0.0, x, label, 2, 2, 2);
    double w[2], b, score[4];
    assert_ok(lg_svm_plane(svm, w, &b));
    assert_close(w[0], 1.0, 1e-9, 0);
    assert_close(w[1], 0.0, 0, 1e-12);
    assert_close(b, -2.0, 1e-9, 0);
    svm_scores(svm, x, 2, score);
    assert_close(score[3], 1.0, 1e-9, 0);
    assert_close(score[1], -1.0, 1e-9, 0);
    svm = fit(LG_KERNEL_RBF, 10.0, 1.0, x, label, 2, 2, 2);
    assert_status(lg_svm_plane(svm, w, &b), LG_UNSUPPORTED);
}

TEST("classes that do not occur are never predicted, and do not affect the others") {
    uint32_t label[60], wide[60];
    double *x = clouds(60, 3, 3, 1.0, 9, label);
    for (int i = 0; i < 60; i++) wide[i] = 2 * label[i];
    const lg_svm *three, *five;
    three = fit(LG_KERNEL_RBF, 1.0, 0.0, x, label, 60, 3, 3);
    five = fit(LG_KERNEL_RBF, 1.0, 0.0, x, wide, 60, 3, 5);
    double a[3], b[5];
    for (int i = 0; i < 60; i++) {
        svm_scores(three, x + 3 * i, 1, a);
        svm_scores(five, x + 3 * i, 1, b);
        /* two more votes, against the absent classes */
        for (int c = 0; c < 3; c++) assert_close(b[2 * c] - a[c], 2.0, 1e-13, 0);
        assert_close(b[1], -1.0, 0, 0);
        assert_close(b[3], -1.0, 0, 0);
    }
}

TEST("scaled tables have the same decisions") {
    enum { N = 40 };
    uint32_t label[N];
    double *x = clouds(N, 2, 2, 2.0, 6, label), score[2 * N], first[2 * N];
    static const double factors[] = {1.0, 1e-12, 1e12, 1e150};
    for (int kernel = LG_KERNEL_LINEAR; kernel <= LG_KERNEL_RBF; kernel++)
        for (int f = 0; f < (kernel == LG_KERNEL_RBF ? 3 : 4); f++) {
            double scaled[2 * N];
            for (int i = 0; i < 2 * N; i++) scaled[i] = x[i] * factors[f];
            /* A linear kernel with C/f^2 on f x is the same problem. */
            const double c = kernel == LG_KERNEL_RBF ? 1.0 : 1.0 / factors[f] / factors[f];
            const lg_svm *svm = fit((lg_kernel)kernel, c, 0.0, scaled, label, N, 2, 2);
            svm_scores(svm, scaled, N, score);
            if (f == 0) memcpy(first, score, sizeof score);
            for (int i = 0; i < 2 * N; i++) assert_close(score[i], first[i], 5e-3, 5e-3);
        }
}

TEST("invalid tables and options are refused") {
    uint32_t label[6];
    double *x = clouds(6, 2, 2, 1.0, 4, label);
    lg_svm m = {.inputs = 99};
    lg_error e;
    const lg_status bad = LG_INVALID_ARGUMENT;
    assert_status(lg_svm_fit(NULL, LG_KERNEL_RBF, 0.0, 0, x, label, 6, 2, 2, &m, &e), bad);
    assert_status(lg_svm_fit(NULL, LG_KERNEL_RBF, 1.0, NAN, x, label, 6, 2, 2, &m, &e), bad);
    assert_status(lg_svm_fit(NULL, LG_KERNEL_RBF, INFINITY, 0, x, label, 6, 2, 2, &m, &e), bad);
    assert_status(lg_svm_fit(NULL, LG_KERNEL_RBF, 1.0, 2e300, x, label, 6, 2, 2, &m, &e), bad);
    assert_status(lg_svm_fit(NULL, LG_KERNEL_RBF, 1.0, 0, x, label, 6, 2, UINT32_MAX, &m, &e), bad);
    lg_svm_destroy(NULL);
    assert_status(lg_svm_fit(NULL, (lg_kernel)7, 1.0, 0, x, label, 6, 2, 2, &m, &e), bad);
    assert_status(lg_svm_fit(NULL, LG_KERNEL_RBF, 1.0, 0, x, label, 6, 2, 1, &m, &e), bad);
    memset(label, 0, sizeof label);
    assert_status(lg_svm_fit(NULL, LG_KERNEL_RBF, 1.0, 0, x, label, 6, 2, 2, &m, &e), bad);
    label[1] = 1;
    double *small = TEST_ARRAY(double, 12), *large = TEST_ARRAY(double, 12);
    for (int i = 0; i < 12; i++) small[i] = x[i] * 1e-300, large[i] = x[i] * 1e300;
    assert_status(lg_svm_fit(NULL, LG_KERNEL_LINEAR, 1e-300, 0, small, label, 6, 2, 2, &m, &e), bad);
    assert_says(e.message, "does not fit the size of the features");
    assert_status(lg_svm_fit(NULL, LG_KERNEL_LINEAR, 1e300, 0, large, label, 6, 2, 2, &m, &e), bad);
    assert_says(e.message, "does not fit the size of the features");
    x[3] = NAN;
    assert_status(lg_svm_fit(NULL, LG_KERNEL_RBF, 1.0, 0, x, label, 6, 2, 2, &m, &e), LG_NOT_FINITE);
    assert_int_equal(m.inputs, 99);
}

TEST("every allocation may fail") {
    for (uint32_t d = 2; d <= 12; d += 10) {
        uint32_t label[30];
        double *x = clouds(30, d, 3, 1.0, 4, label);
        EVERY_ALLOCATION_FAILS(context, 1, {
            lg_svm m = {0};
            status = lg_svm_fit(context, LG_KERNEL_RBF, 1.0, 0, x, label, 30, d, 3, &m, NULL);
            lg_svm_destroy(&m);
        });
    }
}
