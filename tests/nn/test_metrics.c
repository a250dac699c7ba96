/* Metrics compared with scikit-learn; ties, empty classes. */
#include "test_support.h"

#include "golden/metrics_table.h"
#include "liegrad/series.h"
#include "support/fixtures.h"

static void expect_golden(const uint32_t *truth, const uint32_t *given, const double *score, uint32_t classes,
                          const uint64_t *confusion, const double *metrics, double auc) {
    uint32_t own[TABLE_WINDOWS];
    uint64_t counted[16];
    for (int i = 0; i < TABLE_WINDOWS; i++) {
        own[i] = lg_metrics_class(&score[(size_t)i * classes], classes);
        assert_int_equal(own[i], given[i]);
    }
    lg_metrics_confusion(truth, own, TABLE_WINDOWS, classes, counted);
    assert_memory_equal(counted, confusion, classes * classes * sizeof *counted);
    const lg_metrics m = lg_metrics_of(counted, classes, 0);
    assert_close(m.accuracy, metrics[0], 1e-14, 0);
    assert_close(m.precision, metrics[1], 1e-14, 0);
    assert_close(m.recall, metrics[2], 1e-14, 0);
    assert_close(m.f1, metrics[3], 1e-14, 0);
    double got = 0.0;
    assert_ok(lg_metrics_auc(NULL, truth, score, TABLE_WINDOWS, classes, &got));
    assert_close(got, auc, 1e-14, 0);
}

TEST("metrics agree with scikit-learn") {
    expect_golden(two_truth, two_given, two_score, 2, two_confusion, two_metrics, two_auc);
    expect_golden(four_truth, four_given, four_score, 4, four_confusion, four_metrics, four_auc);
}

static void expect_roc(const uint32_t *truth, const double *score, uint32_t classes, const double *fpr,
                       const double *tpr, const double *threshold, size_t points) {
    double column[TABLE_WINDOWS], x[TABLE_WINDOWS + 1], y[TABLE_WINDOWS + 1], t[TABLE_WINDOWS + 1];
    uint32_t order[TABLE_WINDOWS];
    for (int i = 0; i < TABLE_WINDOWS; i++) column[i] = score[(size_t)i * classes + 1];
    assert_int_equal(lg_metrics_roc(truth, column, TABLE_WINDOWS, 1, x, y, t, order), points);
    for (size_t i = 0; i < points; i++) {
        assert_close(x[i], fpr[i], 1e-15, 0);
        assert_close(y[i], tpr[i], 1e-15, 0);
        assert_close(t[i], i == 0 ? INFINITY : threshold[i - 1], 0, 0);
    }
}

TEST("receiver operating characteristics agree with scikit-learn") {
    expect_roc(two_truth, two_score, 2, two_fpr, two_tpr, two_threshold, sizeof two_fpr / sizeof *two_fpr);
    expect_roc(four_truth, four_score, 4, four_fpr, four_tpr, four_threshold,
               sizeof four_fpr / sizeof *four_fpr);
}

TEST("a characteristic agrees with one by hand, with ties, with NaN and with one class only") {
    const uint32_t truth[] = {1, 0, 1, 0};
    const double score[] = {0.9, 0.5, 0.5, 0.1}, flat[] = {2, 2, 2, 2}, missing[] = {0.9, 0.5, NAN, NAN};
    double fpr[5], tpr[5], threshold[5];
    uint32_t order[4];
    assert_int_equal(lg_metrics_roc(truth, score, 4, 1, fpr, tpr, threshold, order), 4);
    const double f[] = {0, 0, 0.5, 1}, t[] = {0, 0.5, 1, 1}, h[] = {INFINITY, 0.9, 0.5, 0.1};
    for (int i = 0; i < 4; i++) {
        assert_close(fpr[i], f[i], 0, 0);
        assert_close(tpr[i], t[i], 0, 0);
        assert_close(threshold[i], h[i], 0, 0);
    }
    assert_int_equal(lg_metrics_roc(truth, flat, 4, 1, fpr, tpr, threshold, order), 2);
    assert_int_equal(lg_metrics_roc(truth, missing, 4, 1, fpr, tpr, threshold, order), 4);
    assert_close(threshold[3], -INFINITY, 0, 0);
    assert_int_equal(lg_metrics_roc(truth, score, 4, 2, fpr, tpr, threshold, order), 0);
    assert_int_equal(lg_metrics_roc(truth + 2, score, 1, 1, fpr, tpr, threshold, order),
                     0); /* positives only */
    assert_int_equal(lg_metrics_roc(truth, score, 0, 1, fpr, tpr, threshold, order), 0);
}

TEST("without a positive or without a negative window the rate of the absent class is 0, not NaN") {
    const uint32_t all[] = {1, 1};
    const double score[] = {0.9, 0.5}, none[] = {0, 0, 0}, rising[] = {0, 0.5, 1};
    double fpr[3], tpr[3], threshold[3];
    uint32_t order[2];
    for (uint32_t positive = 0; positive < 2; positive++) {
        assert_int_equal(lg_metrics_roc(all, score, 2, positive, fpr, tpr, threshold, order), 0);
        assert_all_close(positive == 1 ? fpr : tpr, none, 3, 0, 0);
        assert_all_close(positive == 1 ? tpr : fpr, rising, 3, 0, 0);
    }
}

TEST("areas under the curve agree with those by hand, with ties and absent classes") {
    const uint32_t truth[] = {1, 0, 1, 0}, three[] = {0, 0, 2, 2}, none[] = {0, 0, 0, 0};
    const double score[] = {0, 0.9, 0, 0.5, 0, 0.5, 0, 0.1}, flat[8] = {0};
    const double of_three[] = {1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 1};
    double auc = 0.0;
    assert_ok(lg_metrics_auc(NULL, truth, score, 4, 2, &auc));
    assert_close(auc, 3.5 / 4, 1e-15, 0);
    assert_ok(lg_metrics_auc(NULL, truth, flat, 4, 2, &auc));
    assert_close(auc, 0.5, 1e-15, 0);
    /* class 1 does not occur: the mean over classes 0 and 2 */
    assert_ok(lg_metrics_auc(NULL, three, of_three, 4, 3, &auc));
    assert_close(auc, 1.0, 1e-15, 0);
    assert_ok(lg_metrics_auc(NULL, none, score, 4, 2, &auc));
    assert_true(isnan(auc));
    assert_ok(lg_metrics_auc(NULL, none, score, 0, 2, &auc));
    assert_true(isnan(auc));
    assert_status(lg_metrics_auc(NULL, none, score, 4, 0, &auc), LG_INVALID_ARGUMENT);
    if (SIZE_MAX > UINT32_MAX)
        assert_status(lg_metrics_auc(NULL, none, score, SIZE_MAX, 2, &auc), LG_INVALID_ARGUMENT);
    const uint32_t all[] = {1, 1, 1, 1};
    assert_ok(lg_metrics_auc(NULL, all, score, 4, 2, &auc));
    assert_true(isnan(auc));
}

TEST("the largest score wins; of equal scores the later of two classes, the first of more classes") {
    const double two[] = {0.5, 0.5}, lower[] = {0.6, 0.4}, three[] = {1, 3, 3}, unknown[] = {NAN, 1};
    assert_int_equal(lg_metrics_class(two, 2), 1);
    assert_int_equal(lg_metrics_class(lower, 2), 0);
    assert_int_equal(lg_metrics_class(three, 3), 1);
    assert_int_equal(lg_metrics_class(three, 1), 0);
    assert_int_equal(lg_metrics_class(unknown, 2), 0);
}

TEST("metrics do not depend on which number the healthy class has") {
    /* Three classes; row c, column d: windows of class c that were given class d. */
    const uint64_t three[3][3] = {{50, 3, 1}, {2, 70, 9}, {4, 5, 60}};
    const double false_positive[] = {4.0 / 54, 11.0 / 81, 9.0 / 69};
    for (uint32_t h = 0; h < 3; h++)
        assert_close(lg_metrics_of(three[0], 3, h).false_positive_rate, false_positive[h], 1e-15, 0);
    assert_true(isnan(lg_metrics_of(three[0], 3, LG_NO_CLASS).false_positive_rate));
    /* The same two classes in both orders. */
    const uint64_t first[] = {40, 2, 7, 30}, second[] = {30, 7, 2, 40};
    const lg_metrics a = lg_metrics_of(first, 2, 0), b = lg_metrics_of(second, 2, 1),
                     unknown = lg_metrics_of(second, 2, LG_NO_CLASS);
    assert_memory_equal(&a, &b, sizeof a);
    assert_close(a.recall, 30.0 / 37, 1e-15, 0);
    assert_close(unknown.recall, 40.0 / 42, 1e-15, 0);
    assert_true(isnan(unknown.false_positive_rate));
}

TEST("empty classes count as zero or are left out") {
    /* Class 1 was never predicted; class 2 does not occur, but was predicted once. */
    const uint64_t confusion[] = {3, 0, 1, 2, 0, 0, 0, 0, 0};
    const lg_metrics m = lg_metrics_of(confusion, 3, 0);
    assert_close(m.accuracy, 0.5, 1e-15, 0);
    assert_close(m.precision, (3.0 / 5) / 3, 1e-15, 0);
    assert_close(m.recall, (3.0 / 4) / 3, 1e-15, 0);
    assert_close(m.f1, (6.0 / 9) / 3, 1e-15, 0);
    assert_close(m.false_positive_rate, 0.25, 1e-15, 0);
    const uint64_t no_zero[] = {0, 0, 1, 4}, nothing[] = {0, 0, 0, 0};
    assert_true(isnan(lg_metrics_of(no_zero, 2, 0).false_positive_rate));
    assert_close(lg_metrics_of(no_zero, 2, 0).recall, 0.8, 1e-15, 0);
    assert_close(lg_metrics_of(nothing, 2, 0).accuracy, 0.0, 0, 0);
    assert_true(isnan(lg_metrics_of(nothing, 2, 0).f1));
    /* Class 2 neither occurs nor was given: the means are over the other classes. */
    const uint64_t two_of_three[] = {3, 0, 0, 1, 4, 0, 0, 0, 0}, two[] = {3, 0, 1, 4};
    assert_close(lg_metrics_of(two_of_three, 3, 0).precision, (3.0 / 4 + 1) / 2, 1e-15, 0);
    assert_close(lg_metrics_of(two_of_three, 3, 0).recall, (1 + 4.0 / 5) / 2, 1e-15, 0);
    assert_close(lg_metrics_of(two_of_three, 3, 0).f1, (6.0 / 7 + 8.0 / 9) / 2, 1e-15, 0);
    assert_close(lg_metrics_of(two, 2, 0).f1, 8.0 / 9, 1e-15, 0);
    uint64_t counted[4] = {9, 9, 9, 9};
    const uint32_t truth[] = {0, 1, 5}, given[] = {1, 1, 0};
    lg_metrics_confusion(truth, given, 3, 2, counted);
    const uint64_t expected[] = {0, 1, 0, 1};
    assert_memory_equal(counted, expected, sizeof expected);
}

TEST("every allocation may fail, and the area is unchanged") {
    EVERY_ALLOCATION_FAILS(context, 1, {
        double auc = 77.0;
        status = lg_metrics_auc(context, two_truth, two_score, TABLE_WINDOWS, 2, &auc);
        if (status != LG_OK) assert_close(auc, 77.0, 0, 0);
    });
}
