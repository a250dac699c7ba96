/* ctest-labels: threads
 * The chain of features, principal components and method: every method on difficult tables, saving and
 * loading, damaged archives, cross-validation. */
#include "classify_support.h"
#include "support/memory_archive.h"

#include "liegrad/series.h"

/* BLAS uses one thread, as in the executables; the thread sanitizer cannot see the threads of BLAS. */
__attribute__((constructor)) static void one_thread_of_blas(void) {
    lg_runtime_setup();
}

static const struct {
    lg_classifier_method method;
    uint32_t components;
} chains[] = {{LG_METHOD_LOGISTIC, 0}, {LG_METHOD_LOGISTIC, 2},   {LG_METHOD_TREE, 0},
              {LG_METHOD_TREE, 2},     {LG_METHOD_SVM_LINEAR, 2}, {LG_METHOD_RIDGE, 0},
              {LG_METHOD_SVM_RBF, 0},  {LG_METHOD_SVM_RBF, 2},    {LG_METHOD_RIDGE, 2}};
#define CHAINS (LG_COUNT(chains))

static lg_classifier_options options_of(size_t chain) {
    lg_classifier_options o;
    lg_classifier_options_init(&o);
    o.method = chains[chain].method;
    o.components = chains[chain].components;
    return o;
}

static double accuracy(const lg_classifier *c, const double *x, const uint32_t *label, size_t n, uint32_t d) {
    double *work = TEST_ARRAY(double, (lg_classifier_work_size(c) / sizeof(double) + c->classes)), right = 0;
    for (size_t i = 0; i < n; i++) {
        lg_classifier_score(c, x + i * d, work, work + c->classes);
        right += lg_metrics_class(work, c->classes) == label[i];
    }
    return right / (double)n;
}

TEST("chains separate clouds") {
    for (uint32_t classes = 2; classes <= 4; classes++)
        for (size_t t = 0; t < CHAINS; t++) {
            uint32_t label[160], chosen[80];
            double *x = clouds(160, 5, classes, 6.0, 40, label);
            for (int i = 0; i < 160; i++) x[5 * i + 1] *= 1e9; /* standardisation must remove this factor */
            for (uint32_t i = 0; i < 80; i++) chosen[i] = 2 * (i / classes * classes) + i % classes;
            const lg_classifier_options o = options_of(t);
            lg_classifier c = {0};
            assert_ok(lg_classifier_fit(NULL, &o, x, label, chosen, 80, 5, classes, &c, NULL));
            assert_true(accuracy(&c, x, label, 160, 5) >= (classes == 2 ? 0.97 : o.components ? 0.7 : 0.93));
            /* Only the chosen rows may matter. */
            for (uint32_t i = 0; i < 160; i++) {
                bool used = false;
                for (int k = 0; k < 80; k++) used |= chosen[k] == i;
                if (!used) x[5 * i] = 1e6;
            }
            lg_classifier again = {0};
            assert_ok(lg_classifier_fit(NULL, &o, x, label, chosen, 80, 5, classes, &again, NULL));
            assert_memory_equal(c.pca.mean, again.pca.mean, 5 * sizeof(double));
            lg_classifier_destroy(&c);
            lg_classifier_destroy(&again);
        }
}

TEST("wide, short, scaled and contradictory tables give finite scores") {
    static const uint32_t shapes[][3] = {
        {30, 1, 2}, {20, 600, 4}, {2, 3, 2}, {3, 2, 3}, {4, 1, 4}}; /* n, d, classes */
    for (size_t s = 0; s < LG_COUNT(shapes); s++)
        for (int variant = 0; variant < 5; variant++)
            for (size_t t = 0; t < CHAINS; t++) {
                const uint32_t n = shapes[s][0], d = shapes[s][1], classes = shapes[s][2];
                uint32_t label[30];
                double *x = clouds(n, d, classes, 1.0, s, label);
                const double factor = variant == 1 ? 1e-12 : variant == 2 ? 1e12 : variant == 3 ? 0.0 : 1.0;
                for (size_t i = 0; i < n * d; i++) x[i] *= factor;
                if (variant == 4) memcpy(x + d, x, d * sizeof *x); /* the same row with two labels */
                lg_classifier_options o = options_of(t);
                if (o.components > (n < d ? n : d)) o.components = n < d ? n : d;
                lg_classifier c = {0};
                lg_error e;
                const lg_status status = lg_classifier_fit(NULL, &o, x, label, NULL, n, d, classes, &c, &e);
                if (status != LG_OK)
                    fail_msg("n %u d %u variant %d chain %zu: %s", n, d, variant, t, e.message);
                double *work = TEST_ARRAY(double, (lg_classifier_work_size(&c) / sizeof(double) + classes));
                for (uint32_t i = 0; i < n; i++) {
                    lg_classifier_score(&c, x + i * d, work, work + classes);
                    for (uint32_t k = 0; k < classes; k++) assert_true(isfinite(work[k]));
                }
                lg_classifier_destroy(&c);
            }
}

TEST("invalid tables and options are refused, and the classifier is unchanged") {
    uint32_t label[8];
    double *x = clouds(8, 2, 2, 1.0, 3, label);
    lg_classifier c = {.classes = 55};
    lg_error e;
    for (size_t t = 0; t < CHAINS; t++) {
        lg_classifier_options o = options_of(t);
        x[3] = NAN;
        assert_status(lg_classifier_fit(NULL, &o, x, label, NULL, 8, 2, 2, &c, &e), LG_NOT_FINITE);
        x[3] = 0;
        o.components = 3;
        assert_status(lg_classifier_fit(NULL, &o, x, label, NULL, 8, 2, 2, &c, &e), LG_INVALID_ARGUMENT);
        o = options_of(t);
        assert_status(lg_classifier_fit(NULL, &o, x, label, NULL, 0, 2, 2, &c, &e), LG_INVALID_ARGUMENT);
        o.size = 1;
        assert_status(lg_classifier_fit(NULL, &o, x, label, NULL, 8, 2, 2, &c, &e), LG_INVALID_ARGUMENT);
    }
    lg_classifier_options o = options_of(0);
    assert_status(lg_classifier_fit(NULL, &o, x, label, NULL, 8, 0, 2, &c, &e), LG_INVALID_ARGUMENT);
    o.method = (lg_classifier_method)LG_METHOD_COUNT;
    assert_status(lg_classifier_fit(NULL, &o, x, label, NULL, 8, 2, 2, &c, &e), LG_INVALID_ARGUMENT);
    assert_int_equal(c.classes, 55);
    assert_string_equal(lg_classifier_method_name(o.method), "unknown");
    lg_classifier_destroy(NULL);
    /* the choice by cross-validation: rows, features, classes, threads */
    static const struct {
        size_t rows;
        uint32_t d, classes;
        int threads;
    } wrong[] = {{0, 2, 2, 1}, {(size_t)1 << 33, 2, 2, 1}, {8, 0, 2, 1},
                 {8, 2, 1, 1}, {8, 2, UINT32_MAX, 1},      {8, 2, 2, 0}};
    double rate = 7;
    size_t best = 9;
    o = options_of(0);
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        assert_status(lg_classifier_search(NULL, &o, 1, 2, x, label, NULL, NULL, wrong[i].rows, wrong[i].d,
                                           wrong[i].classes, wrong[i].threads, &rate, &best, &e),
                      LG_INVALID_ARGUMENT);
        assert_says(e.message, "cross-validation needs rows");
    }
    x[3] = INFINITY;
    assert_status(lg_classifier_search(NULL, &o, 1, 2, x, label, NULL, NULL, 8, 2, 2, 1, &rate, &best, &e),
                  LG_NOT_FINITE);
    assert_says(e.message, "setting 0");
    x[3] = 0;
    const volatile int stop = 1;
    lg_context_options options;
    lg_context *context;
    lg_context_options_init(&options);
    options.cancel = &stop;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    assert_status(lg_classifier_search(context, &o, 1, 2, x, label, NULL, NULL, 8, 2, 2, 1, &rate, &best, &e),
                  LG_CANCELLED);
    static const size_t cancelled[] = {0, 2}; /* logistic regression, and a tree */
    for (size_t i = 0; i < LG_COUNT(cancelled); i++) {
        o = options_of(cancelled[i]);
        assert_status(lg_classifier_fit(context, &o, x, label, NULL, 8, 2, 2, &c, &e), LG_CANCELLED);
    }
    assert_true(rate == 7 && best == 9 && c.classes == 55);
}

/* ---- archives ---- */

static lg_series make_series(void) {
    lg_series s = {.count = 24, .channels = 6, .length = 40, .classes = 3, .rate = 0.125};
    assert_ok(lg_series_allocate(NULL, &s, false, false));
    lg_rng rng = test_rng(9, 1);
    for (size_t i = 0; i < 24; i++) {
        s.label[i] = (uint32_t)(i % 3);
        for (size_t t = 0; t < 240; t++)
            s.x[i * 240 + t] = (float)(lg_rng_normal(&rng) * (1.0 + (double)s.label[i] * (t / 40 == 2)));
    }
    return *own_lg_series(s);
}

/* Chain t, fitted to features of the series. */
static lg_classifier make_classifier(const lg_series *s, size_t t) {
    static const lg_feature_kind kinds[] = {LG_FEATURES_STD,      LG_FEATURES_COV,      LG_FEATURES_RAW,
                                            LG_FEATURES_BASELINE, LG_FEATURES_SPECTRUM, LG_FEATURES_ROCKET,
                                            LG_FEATURES_LEVELS};
    const lg_feature_kind kind = kinds[t % LG_COUNT(kinds)];
    lg_classifier c = {0};
    const lg_windows w = windows_of(s);
    if (kind == LG_FEATURES_ROCKET)
        c.features = rocket_made(s, 96, 1);
    else
        assert_ok(lg_features_create(NULL, kind, false, s, 40, NULL, &c.features, NULL));
    double *x = TEST_ARRAY(double, w.count *c.features.count);
    assert_ok(lg_features_table(NULL, &c.features, s, &w, 1, x, NULL));
    const lg_classifier_options o = options_of(t);
    assert_ok(lg_classifier_fit(NULL, &o, x, s->label, NULL, w.count, c.features.count, 3, &c, NULL));
    return *own_lg_classifier(c);
}

/* A classifier with its features, made with the options number t, and the archive that it was saved to. */
typedef struct archived {
    lg_classifier c;
    memory_archive archive;
    lg_archive_reader reader;
} archived;

static archived *save(const lg_series *s, size_t t) {
    archived *a = TEST_ARRAY(archived, 1);
    a->reader = memory_reader(&a->archive);
    const lg_archive_writer writer = memory_writer(&a->archive);
    a->c = make_classifier(s, t);
    assert_ok(lg_classifier_save(&a->c, &writer, NULL));
    return a;
}

TEST("archives keep every bit") {
    lg_series s = make_series();
    for (size_t t = 0; t < CHAINS; t++) {
        lg_classifier back;
        lg_error e;
        archived *a = save(&s, t);
        const lg_status status = lg_classifier_load(NULL, &a->reader, &back, &e);
        if (status != LG_OK) fail_msg("%s", e.message);
        assert_int_equal(back.method, a->c.method);
        assert_int_equal(lg_classifier_work_size(&back) / sizeof(double),
                         lg_classifier_work_size(&a->c) / sizeof(double));
        double *work = TEST_ARRAY(double, lg_classifier_work_size(&a->c) / sizeof(double)), kept[3], read[3];
        /* the other kinds can be read by older versions */
        assert_int_equal(memory_find(&a->archive, "classifier/features/bands") != NULL,
                         a->c.features.kind == LG_FEATURES_SPECTRUM);
        assert_int_equal(memory_find(&a->archive, "classifier/features/rate") != NULL,
                         a->c.features.kind == LG_FEATURES_LEVELS);
        for (size_t i = 0; i < s.count; i++) {
            assert_ok(lg_classifier_window(&a->c, s.x + i * 240, kept, work));
            assert_ok(lg_classifier_window(&back, s.x + i * 240, read, work));
            assert_memory_equal(kept, read, sizeof kept);
        }
        lg_classifier_destroy(&back);
    }
}

TEST("a full archive, and windows that do not fit the features, are refused") {
    lg_series s = make_series();
    for (size_t t = 0; t < CHAINS; t++) {
        archived *a = save(&s, t);
        lg_error e;
        for (size_t i = 1; i < a->archive.count; i++) {
            memory_archive *full = TEST_ARRAY(memory_archive, 1);
            full->fail_after = i;
            const lg_archive_writer writer = memory_writer(full);
            assert_status(lg_classifier_save(&a->c, &writer, &e), LG_FILE);
            assert_says(e.message, "could not be saved");
        }
        double *work = TEST_ARRAY(double, lg_classifier_work_size(&a->c) / sizeof(double)), score[3];
        lg_classifier other = a->c;
        other.features.count = 0;
        assert_status(lg_classifier_window(&other, s.x, score, work), LG_INVALID_ARGUMENT);
        other.features.count = a->c.features.count + 1;
        assert_status(lg_classifier_window(&other, s.x, score, work), LG_INVALID_ARGUMENT);
        const lg_archive_writer writer = memory_writer(&a->archive);
        other.method = (lg_classifier_method)LG_METHOD_COUNT;
        assert_status(lg_classifier_save(&other, &writer, &e), LG_INVALID_ARGUMENT);
    }
}

TEST("an archive with an unknown text or rank is refused, and the message names the array") {
    static const char *const texts[] = {"method", "features/kind", "tree/criterion"};
    lg_series s = make_series();
    lg_classifier back;
    lg_error e;
    for (size_t i = 0; i < LG_COUNT(texts); i++) {
        archived *a = save(&s, 0);
        memory_item *item = memory_find(&a->archive, test_text("classifier/%s", texts[i]));
        assert_non_null(item);
        memory_fill(item, "no such name", sizeof "no such name");
        assert_status(lg_classifier_load(NULL, &a->reader, &back, &e), LG_FORMAT);
        assert_says(e.message, texts[i]);
    }
    archived *a = save(&s, 0);
    memory_find(&a->archive, "classifier/logistic/weight")->rank = 1;
    assert_status(lg_classifier_load(NULL, &a->reader, &back, &e), LG_FORMAT);
    assert_says(e.message, "logistic/weight");
}

/* Changes every number of every stored array, one at a time, and every dimension. The reader must refuse the
 * archive, or return a classifier that can be used without memory errors (checked by the address
 * sanitizer). */
static void use(const lg_archive_reader *reader, const float *x) {
    lg_classifier c;
    if (lg_classifier_load(NULL, reader, &c, NULL) != LG_OK) {
        assert_null(c.pca.mean);
        assert_int_equal(c.classes, 0);
        return;
    }
    double *work = TEST_ARRAY(double, (lg_classifier_work_size(&c) / sizeof(double) + c.classes));
    if (c.features.channels * c.features.length <= 240)
        (void)lg_classifier_window(&c, x, work, work + c.classes);
    lg_classifier_destroy(&c);
}

TEST("damaged archives are refused, or give a classifier that can be used") {
    static const double wrong[] = {-1.0, 0.0, 1.0, 2.5, 1e9, NAN, INFINITY};
    static const uint32_t wrong32[] = {0, 1, 2, 3, 7, 1u << 20, UINT32_MAX};
    lg_series s = make_series();
    for (size_t t = 0; t < CHAINS; t++) {
        archived *a = save(&s, t);
        for (size_t i = 0; i < a->archive.count; i++) {
            memory_item *item = &a->archive.items[i];
            unsigned char *bytes = item->data;
            const size_t size = item->type == LG_ELEMENT_F64 ? 8 : 4;
            const size_t step = item->bytes / size > 12 ? item->bytes / size / 12 : 1;
            for (size_t at = 0; (at + 1) * size <= item->bytes; at += step)
                for (int w = 0; w < 7; w++) {
                    unsigned char saved[8];
                    memcpy(saved, bytes + at * size, size);
                    memcpy(bytes + at * size, size == 8 ? (const void *)&wrong[w] : &wrong32[w], size);
                    use(&a->reader, s.x);
                    memcpy(bytes + at * size, saved, size);
                }
            for (uint32_t r = 0; r < item->rank; r++) {
                item->dims[r] ^= 1;
                lg_classifier back;
                assert_status(lg_classifier_load(NULL, &a->reader, &back, NULL), LG_FORMAT);
                item->dims[r] ^= 1;
            }
            const char first = item->path[0]; /* leaves the array out */
            lg_classifier back;
            item->path[0] = '?';
            assert_status(lg_classifier_load(NULL, &a->reader, &back, NULL), LG_NOT_FOUND);
            item->path[0] = first;
        }
    }
}

TEST("invalid numbers in an archive are refused with the array's name") {
    static const struct {
        size_t chain;
        const char *path;
        size_t entry;
        double value;
        lg_status status;
    } lies[] = {{0, "classifier/classes", 0, 1, LG_FORMAT},
                {0, "classifier/pca/scale", 2, 0.0, LG_FORMAT},
                {0, "classifier/pca/scale", 2, -1.0, LG_FORMAT},
                {0, "classifier/logistic/weight", 1, NAN, LG_NOT_FINITE},
                {0, "classifier/features/select", 1, 6, LG_FORMAT},
                {0, "classifier/features/select", 1, 0, LG_FORMAT},
                {3, "classifier/features/pair", 1, 6, LG_FORMAT},
                {1, "classifier/features/scale", 1, 0.0, LG_FORMAT},
                {4, "classifier/features/bands", 0, 0, LG_FORMAT},
                {4, "classifier/features/bands", 0, 21, LG_FORMAT}, /* of 20 frequencies */
                {4, "classifier/features/count", 0, 47, LG_FORMAT},
                {2, "classifier/tree/node", 1, 0, LG_FORMAT},   /* a root with one child */
                {2, "classifier/tree/node", 0, 1e6, LG_FORMAT}, /* feature */
                {2, "classifier/tree/node", 1, 1e6, LG_FORMAT}, /* child */
                {2, "classifier/tree/node", 1, 1.5, LG_FORMAT},
                {2, "classifier/tree/counts", 0, 999, LG_FORMAT},
                {4, "classifier/svm/vectors_of", 0, 9999, LG_FORMAT},
                {5, "classifier/svm/gamma", 0, -1.0, LG_FORMAT},
                {6, "classifier/features/rate", 0, 0.0, LG_FORMAT},
                {6, "classifier/features/rate", 0, INFINITY, LG_FORMAT}};
    lg_series s = make_series();
    for (size_t i = 0; i < sizeof lies / sizeof lies[0]; i++) {
        lg_classifier back;
        archived *a = save(&s, lies[i].chain);
        memory_item *item = memory_find(&a->archive, lies[i].path);
        assert_non_null(item);
        const uint32_t whole = (uint32_t)(lies[i].value > 0 ? lies[i].value : 0);
        if (item->type == LG_ELEMENT_F64)
            ((double *)item->data)[lies[i].entry] = lies[i].value;
        else
            ((uint32_t *)item->data)[lies[i].entry] = whole;
        lg_error e;
        const lg_status status = lg_classifier_load(NULL, &a->reader, &back, &e);
        if (status != lies[i].status) fail_msg("%s: %s", lies[i].path, lg_status_name(status));
        assert_non_null(strstr(e.message, lies[i].path));
    }
}

static void replace(memory_archive *archive, const char *path, const void *data, size_t rows,
                    size_t row_bytes) {
    memory_item *item = memory_find(archive, path);
    assert_non_null(item);
    memory_fill(item, data, rows * row_bytes);
    item->dims[0] = rows;
}

/* Seven nodes. The first row is a tree; in the second one each node is the child of one other node, with a
 * cycle of 3 and 4. Then a node has one child twice, a node has two parents (on either side), and a node has
 * none. */
TEST("trees with cycles, two parents or no parent are refused") {
    static const double children[][7][2] = {
        {{1, 2}, {0, 0}, {3, 4}, {0, 0}, {5, 6}, {0, 0}, {0, 0}},
        {{1, 2}, {0, 0}, {0, 0}, {4, 5}, {3, 6}, {0, 0}, {0, 0}},
        {{1, 2}, {0, 0}, {3, 3}, {0, 0}, {5, 6}, {0, 0}, {0, 0}},
        {{1, 2}, {3, 4}, {3, 5}, {0, 0}, {0, 0}, {0, 0}, {0, 0}},
        {{1, 2}, {3, 4}, {5, 4}, {0, 0}, {0, 0}, {0, 0}, {0, 0}},
        {{1, 2}, {0, 0}, {3, 4}, {0, 0}, {0, 0}, {0, 0}, {0, 0}},
    };
    lg_series s = make_series();
    for (size_t k = 0; k < LG_COUNT(children); k++) {
        double node[7][6] = {{0}};
        uint32_t counts[7][3] = {{0}};
        const uint32_t seven = 7;
        for (int i = 0; i < 7; i++) {
            memcpy(&node[i][1], children[k][i], sizeof children[k][i]);
            node[i][5] = counts[i][0] = 1;
        }
        lg_classifier back;
        archived *a = save(&s, 2);
        replace(&a->archive, "classifier/tree/nodes", &seven, 1, sizeof seven);
        replace(&a->archive, "classifier/tree/node", node, 7, sizeof node[0]);
        replace(&a->archive, "classifier/tree/counts", counts, 7, sizeof counts[0]);
        assert_status(lg_classifier_load(NULL, &a->reader, &back, NULL), k == 0 ? LG_OK : LG_FORMAT);
        lg_classifier_destroy(&back);
    }
}

TEST("every allocation may fail") {
    lg_series s = make_series();
    for (size_t t = 0; t < CHAINS; t++) {
        lg_classifier back;
        archived *a = save(&s, t);
        static const uint32_t unit[12] = {0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3};
        uint32_t label[12];
        double *x = clouds(12, 3, 3, 1.0, 2, label);
        const lg_classifier_options o = options_of(t);
        for (int what = 0; what < 3; what++)
            EVERY_ALLOCATION_FAILS(context, 1, {
                double rates[1];
                size_t best;
                back = (lg_classifier){0};
                if (what == 0) status = lg_classifier_load(context, &a->reader, &back, NULL);
                if (what == 1) status = lg_classifier_fit(context, &o, x, label, NULL, 12, 3, 3, &back, NULL);
                if (what == 2)
                    status = lg_classifier_search(context, &o, 1, 2, x, label, unit, NULL, 12, 3, 3, 1, rates,
                                                  &best, NULL);
                lg_classifier_destroy(&back);
            });
    }
}

/* ---- choosing ---- */

TEST("the choice by cross-validation agrees with one computed by hand, with any number of threads") {
    enum { N = 61, FOLDS = 5 };
    uint32_t chosen[N], own[N], fold[N], n = 0;
    double *x = clouds(70, 4, 2, 1.5, 77, (uint32_t[70]){0});
    uint32_t all[70];
    for (uint32_t i = 0; i < 70; i++) all[i] = i % 2;
    for (uint32_t i = 9; i < 70; i++) chosen[n++] = 78 - i; /* not in order */
    for (uint32_t i = 0; i < N; i++) own[i] = all[chosen[i]];
    lg_classifier_options grid[4];
    for (int i = 0; i < 4; i++) lg_classifier_options_init(&grid[i]);
    grid[1].method = LG_METHOD_TREE;
    grid[2].method = LG_METHOD_SVM_RBF;
    grid[3].components = 1;
    double rates[4], expected = 0, other[4];
    size_t best = 99, again;
    assert_ok(
        lg_classifier_search(NULL, grid, 4, FOLDS, x, all, NULL, chosen, N, 4, 2, 1, rates, &best, NULL));
    assert_ok(lg_series_folds(NULL, own, NULL, N, FOLDS, fold, NULL));
    for (uint32_t f = 0; f < FOLDS; f++) { /* The rate of option 2, computed by hand. */
        uint32_t rows[N], count = 0, tested = 0;
        double right = 0, score[2], *work;
        for (uint32_t i = 0; i < N; i++)
            if (fold[i] != f) rows[count++] = chosen[i];
        lg_classifier c = {0};
        assert_ok(lg_classifier_fit(NULL, &grid[2], x, all, rows, count, 4, 2, &c, NULL));
        work = malloc(lg_classifier_work_size(&c));
        for (uint32_t i = 0; i < N; i++) {
            if (fold[i] != f) continue;
            lg_classifier_score(&c, x + 4 * chosen[i], score, work);
            right += lg_metrics_class(score, 2) == own[i];
            tested++;
        }
        expected += right / tested / FOLDS;
        free(work);
        lg_classifier_destroy(&c);
    }
    assert_close(rates[2], expected, 1e-14, 0);
    for (int i = 0; i < 4; i++)
        assert_true(rates[i] <= rates[best] && (i >= (int)best || rates[i] < rates[best]));
    for (int threads = 2; threads <= 5; threads += 3) {
        assert_ok(lg_classifier_search(NULL, grid, 4, FOLDS, x, all, NULL, chosen, N, 4, 2, threads, other,
                                       &again, NULL));
        assert_memory_equal(other, rates, sizeof rates);
        assert_int_equal(again, best);
    }
}

/* Four recordings of each class. Each recording is a tight cloud with its own centre, which does not depend
 * on the class. If recordings are split between folds, rows are recognised by their neighbours; if they are
 * kept together, no row is. */
TEST("folds do not split units") {
    enum { UNITS = 12, EACH = 10, N = UNITS * EACH };
    uint32_t label[N], unit[N], chosen[N];
    double x[2 * N], torn, whole, few;
    lg_rng rng = test_rng(5, 0);
    for (uint32_t i = 0; i < N; i++) {
        const uint32_t u = i / EACH;
        unit[i] = 70 - 3 * u;
        label[i] = (u + u / 4) % 2;
        x[2 * i] = 10.0 * (u % 4) + 0.01 * lg_rng_normal(&rng);
        x[2 * i + 1] = 10.0 * (u / 4) + 0.01 * lg_rng_normal(&rng);
        chosen[i] = (i * 7) % N;
    }
    lg_classifier_options o;
    lg_classifier_options_init(&o);
    o.method = LG_METHOD_SVM_RBF;
    o.gamma = 10.0;
    o.c = 100.0;
    size_t best;
    assert_ok(lg_classifier_search(NULL, &o, 1, 3, x, label, NULL, chosen, N, 2, 2, 1, &torn, &best, NULL));
    assert_ok(lg_classifier_search(NULL, &o, 1, 3, x, label, unit, chosen, N, 2, 2, 2, &whole, &best, NULL));
    assert_close(torn, 1.0, 0, 0);
    assert_true(whole < 0.6);
    /* Only one unit of class 1: no folds are possible, so the accuracy on the training rows is returned. */
    for (uint32_t i = 0; i < N; i++) unit[i] = label[i] == 1 ? 99 : i / EACH;
    assert_ok(lg_classifier_search(NULL, &o, 1, 3, x, label, unit, NULL, N, 2, 2, 1, &few, &best, NULL));
    assert_close(few, 1.0, 0, 0);
    /* If every row is a unit of its own, the result is the same as without units. */
    double alone, none;
    for (uint32_t i = 0; i < N; i++) unit[i] = i;
    o.gamma = 1e-3;
    assert_ok(lg_classifier_search(NULL, &o, 1, 7, x, label, NULL, NULL, N, 2, 2, 1, &none, &best, NULL));
    assert_ok(lg_classifier_search(NULL, &o, 1, 7, x, label, unit, NULL, N, 2, 2, 1, &alone, &best, NULL));
    assert_close(alone, none, 0, 0);
    assert_true(none < 1.0);
}

TEST("small and wide tables can be used for the choice, and of equal options the first is taken") {
    uint32_t label[30];
    double *x = clouds(30, 40, 3, 3.0, 5, label), rate[2];
    lg_classifier_options o[2];
    for (int i = 0; i < 2; i++) lg_classifier_options_init(&o[i]);
    size_t best = 7;
    lg_error e;
    assert_ok(lg_classifier_search(NULL, o, 2, 3, x, label, NULL, NULL, 30, 40, 3, 1, rate, &best, &e));
    assert_true(rate[0] == rate[1]);
    assert_int_equal(best, 0); /* the first of equals */
    o[1].components = 30;      /* more than the rows of a fold */
    assert_ok(lg_classifier_search(NULL, o, 2, 10, x, label, NULL, NULL, 30, 40, 3, 2, rate, &best, &e));
    assert_ok(lg_classifier_search(NULL, o, 1, 10, x, label, NULL, NULL, 3, 40, 3, 2, rate, &best,
                                   &e)); /* one row per class */
    assert_close(rate[0], 1.0, 0, 0);    /* on the training rows */
    assert_ok(lg_classifier_search(NULL, o, 1, 0, x, label, NULL, NULL, 30, 40, 3, 1, rate, &best, &e));
    for (int i = 0; i < 30; i++) label[i] = i < 28 ? 0 : 2; /* class 1 does not occur, class 2 is rare */
    assert_ok(lg_classifier_search(NULL, o, 1, 5, x, label, NULL, NULL, 30, 40, 3, 1, rate, &best, &e));
    memset(label, 0, sizeof label);
    best = 7;
    assert_status(lg_classifier_search(NULL, o, 1, 5, x, label, NULL, NULL, 30, 40, 3, 1, rate, &best, &e),
                  LG_INVALID_ARGUMENT);
    label[0] = 3;
    assert_status(lg_classifier_search(NULL, o, 1, 5, x, label, NULL, NULL, 30, 40, 3, 1, rate, &best, &e),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_classifier_search(NULL, o, 0, 5, x, label, NULL, NULL, 30, 40, 3, 1, rate, &best, &e),
                  LG_INVALID_ARGUMENT);
    assert_int_equal(best, 7);
}
