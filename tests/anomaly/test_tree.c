/* Trees compared with scikit-learn and with brute force; limits, ties, unusual tables. */
#include "test_support.h"

#include "golden/tree_table.h"
#include "liegrad/classify.h"
#include "liegrad/core.h"
#include "support/fixtures.h"

static lg_tree_options options_of(lg_tree_criterion criterion, uint32_t leaf) {
    lg_tree_options options;
    lg_tree_options_init(&options);
    options.criterion = criterion;
    options.min_samples_leaf = leaf;
    return options;
}

OWNED(lg_tree, lg_tree_destroy)

static const lg_tree *fit(const lg_tree_options *options, const double *x, const uint32_t *label, size_t n,
                          uint32_t d, uint32_t classes) {
    lg_tree tree;
    assert_ok(lg_tree_fit(NULL, options, x, label, n, d, classes, &tree, NULL));
    return own_lg_tree(tree);
}

static const lg_tree *pruned_at(const lg_tree *tree, double alpha) {
    lg_tree pruned;
    assert_ok(lg_tree_prune(NULL, tree, alpha, &pruned));
    return own_lg_tree(pruned);
}

/* A tree whose nodes are golden tables. */
#define GOLDEN(name, of)                                                                                     \
    {                                                                                                        \
        .inputs = TABLE_FEATURES, .classes = TABLE_CLASSES,                                                  \
        .count = sizeof name##_node / sizeof *name##_node, .criterion = of,                                  \
        .node = (lg_tree_node *)name##_node, .counts = (uint32_t *)name##_counts                             \
    }

static void expect_same(const lg_tree *tree, const lg_tree *golden) {
    assert_int_equal(tree->count, golden->count);
    for (uint32_t i = 0; i < tree->count; i++) {
        assert_int_equal(tree->node[i].left, golden->node[i].left);
        assert_int_equal(tree->node[i].right, golden->node[i].right);
        assert_int_equal(tree->node[i].feature, golden->node[i].feature);
        assert_int_equal(tree->node[i].samples, golden->node[i].samples);
        assert_close(tree->node[i].threshold, golden->node[i].threshold, 0, 0);
        assert_close(tree->node[i].impurity, golden->node[i].impurity, 1e-13, 1e-15);
    }
    assert_memory_equal(tree->counts, golden->counts,
                        (size_t)tree->count * tree->classes * sizeof *tree->counts);
}

TEST("the tree agrees with the golden one") {
    const lg_tree golden[] = {GOLDEN(leaf_gini, LG_GINI), GOLDEN(leaf_entropy, LG_ENTROPY)};
    const double *probability[] = {leaf_gini_probability, leaf_entropy_probability};
    const double alpha[] = {leaf_gini_ccp_alpha, leaf_entropy_ccp_alpha};
    const uint32_t nodes[] = {leaf_gini_ccp_nodes, leaf_entropy_ccp_nodes};
    const uint32_t depths[] = {leaf_gini_ccp_depth, leaf_entropy_ccp_depth};
    const uint32_t whole_depth[] = {leaf_gini_depth, leaf_entropy_depth};
    double got[TABLE_TESTS * TABLE_CLASSES];
    for (int c = 0; c < 2; c++) {
        lg_tree_options options = options_of((lg_tree_criterion)c, 8);
        const lg_tree *tree = fit(&options, table_x, table_y, TABLE_ROWS, TABLE_FEATURES, TABLE_CLASSES);
        expect_same(tree, &golden[c]);
        assert_int_equal(tree->depth, whole_depth[c]);
        lg_tree_predict(tree, table_test, TABLE_TESTS, got);
        for (int i = 0; i < TABLE_TESTS * TABLE_CLASSES; i++)
            assert_close(got[i], probability[c][i], 1e-15, 0);
        options.ccp_alpha = alpha[c];
        tree = fit(&options, table_x, table_y, TABLE_ROWS, TABLE_FEATURES, TABLE_CLASSES);
        assert_int_equal(tree->count, nodes[c]);
        assert_int_equal(tree->depth, depths[c]);
    }
}

static void expect_path(const lg_tree *tree, const double *alpha, const double *impurity, size_t count) {
    lg_pruning_step steps[256];
    size_t got = 0;
    assert_ok(lg_tree_pruning_path(NULL, tree, 0, NULL, &got));
    assert_int_equal(got, count);
    assert_ok(lg_tree_pruning_path(NULL, tree, 256, steps, &got));
    assert_int_equal(got, count);
    for (size_t i = 0; i < count; i++) {
        assert_close(steps[i].alpha, alpha[i], 1e-10, 1e-15);
        assert_close(steps[i].impurity, impurity[i], 1e-11, 1e-14);
    }
    assert_int_equal(steps[0].nodes, tree->count);
    assert_int_equal(steps[count - 1].nodes, 1);
}

TEST("the pruning path agrees with the golden one") {
    const lg_tree gini = GOLDEN(leaf_gini, LG_GINI), entropy = GOLDEN(leaf_entropy, LG_ENTROPY);
    const lg_tree full = GOLDEN(full, LG_GINI);
    expect_path(&gini, leaf_gini_alpha, leaf_gini_impurity, LG_COUNT(leaf_gini_alpha));
    expect_path(&entropy, leaf_entropy_alpha, leaf_entropy_impurity, LG_COUNT(leaf_entropy_alpha));
    expect_path(&full, full_alpha, full_impurity, LG_COUNT(full_alpha));
}

/* ---- comparison with brute force ---- */

enum { ROWS = 60, FEATURES = 3, CLASSES = 3 };

static void draw_table(uint64_t seed, uint32_t levels, double *x, uint32_t *label) {
    lg_rng rng = test_rng(seed, 0);
    for (int i = 0; i < ROWS * FEATURES; i++) x[i] = (double)lg_rng_below(&rng, levels);
    for (int i = 0; i < ROWS; i++) label[i] = (uint32_t)lg_rng_below(&rng, CLASSES);
}

static double impurity_of(lg_tree_criterion criterion, const uint32_t *counts, uint32_t samples) {
    double sum = criterion == LG_GINI ? 1.0 : 0.0;
    for (int k = 0; k < CLASSES; k++) {
        const double p = (double)counts[k] / samples;
        if (criterion == LG_GINI)
            sum -= p * p;
        else if (p > 0)
            sum -= p * log(p) / log(2.0);
    }
    return sum;
}

/* samples * impurity of both sides when the rows with in[i] are split; negative if a side is too small. */
static double cost_of(lg_tree_criterion criterion, const double *x, const uint32_t *label, const bool *in,
                      uint32_t feature, double threshold, uint32_t leaf) {
    uint32_t counts[2][CLASSES] = {{0}}, samples[2] = {0, 0};
    for (int i = 0; i < ROWS; i++) {
        if (!in[i]) continue;
        const int side = x[i * FEATURES + feature] > threshold;
        counts[side][label[i]]++;
        samples[side]++;
    }
    if (samples[0] < leaf || samples[1] < leaf) return -1.0;
    return samples[0] * impurity_of(criterion, counts[0], samples[0]) +
           samples[1] * impurity_of(criterion, counts[1], samples[1]);
}

/* For every node: its rows are those that reach it, no other split of them is better, and it is a leaf only
 * if it is pure or cannot be split. */
static void expect_best_splits(const lg_tree *tree, lg_tree_criterion criterion, const double *x,
                               const uint32_t *label, uint32_t leaf) {
    static bool in[ROWS * 2][ROWS];
    memset(in, 0, sizeof in);
    for (int i = 0; i < ROWS; i++) in[0][i] = true;
    assert_in_range(tree->count, 1, ROWS * 2 - 1);
    for (uint32_t t = 0; t < tree->count; t++) {
        const lg_tree_node *node = &tree->node[t];
        uint32_t samples = 0;
        for (int i = 0; i < ROWS; i++) samples += in[t][i];
        assert_int_equal(samples, node->samples);
        double best = INFINITY;
        for (uint32_t j = 0; j < FEATURES; j++)
            for (int i = 0; i < ROWS; i++) {
                const double cost = cost_of(criterion, x, label, in[t], j, x[i * FEATURES + j], leaf);
                if (in[t][i] && cost >= 0.0) best = fmin(best, cost);
            }
        if (node->left == 0) {
            assert_true(best == INFINITY || node->impurity < 1e-12);
            continue;
        }
        assert_true(node->left == t + 1 && node->right > node->left);
        const double own = cost_of(criterion, x, label, in[t], node->feature, node->threshold, leaf);
        assert_close(own, best, 0, 1e-9);
        for (int i = 0; i < ROWS; i++) {
            if (!in[t][i]) continue;
            in[x[i * FEATURES + node->feature] <= node->threshold ? node->left : node->right][i] = true;
        }
    }
}

TEST("every split is the best possible one") {
    double x[ROWS * FEATURES];
    uint32_t label[ROWS];
    for (uint64_t seed = 1; seed <= 20; seed++)
        for (int c = 0; c < LG_CRITERION_COUNT; c++) {
            const uint32_t leaf = seed % 3 == 0 ? 4 : 1;
            const lg_tree_options options = options_of((lg_tree_criterion)c, leaf);
            draw_table(seed, seed % 2 == 0 ? 5 : 1000, x, label);
            const lg_tree *tree = fit(&options, x, label, ROWS, FEATURES, CLASSES);
            expect_best_splits(tree, (lg_tree_criterion)c, x, label, leaf);
        }
}

/* ---- pruning ---- */

static double risk(const lg_tree *tree, double alpha) {
    double sum = 0.0;
    for (uint32_t i = 0; i < tree->count; i++)
        if (tree->node[i].left == 0)
            sum += alpha + tree->node[i].impurity * tree->node[i].samples / tree->node[0].samples;
    return sum;
}

static uint32_t depth_below(const lg_tree *tree, uint32_t t) {
    const lg_tree_node *node = &tree->node[t];
    if (node->left == 0) return 0;
    const uint32_t left = depth_below(tree, node->left), right = depth_below(tree, node->right);
    return 1 + (left > right ? left : right);
}

/* The smallest R_alpha below node t, by recursion: min(leaf, best left + best right). */
static double smallest_risk(const lg_tree *tree, uint32_t t, double alpha) {
    const lg_tree_node *node = &tree->node[t];
    const double leaf = alpha + node->impurity * node->samples / tree->node[0].samples;
    if (node->left == 0) return leaf;
    return fmin(leaf, smallest_risk(tree, node->left, alpha) + smallest_risk(tree, node->right, alpha));
}

TEST("pruning minimises the risk") {
    double x[ROWS * FEATURES];
    uint32_t label[ROWS];
    lg_pruning_step steps[ROWS];
    for (uint64_t seed = 1; seed <= 10; seed++) {
        const lg_tree_options options = options_of((lg_tree_criterion)(seed % 2), 1);
        const lg_tree *tree, *pruned;
        size_t count;
        draw_table(seed, 1000, x, label);
        tree = fit(&options, x, label, ROWS, FEATURES, CLASSES);
        assert_ok(lg_tree_pruning_path(NULL, tree, ROWS, steps, &count));
        for (size_t i = 0; i < count; i++) {
            if (i > 0)
                assert_true(steps[i].alpha >= steps[i - 1].alpha && steps[i].nodes < steps[i - 1].nodes);
            if (i + 1 < count && steps[i + 1].alpha <= steps[i].alpha)
                continue; /* is pruned together with the next one */
            pruned = pruned_at(tree, steps[i].alpha);
            assert_int_equal(pruned->count, steps[i].nodes);
            assert_int_equal(pruned->depth, depth_below(pruned, 0));
            assert_close(risk(pruned, 0.0), steps[i].impurity, 1e-12, 1e-14);
            assert_close(risk(pruned, steps[i].alpha), smallest_risk(tree, 0, steps[i].alpha), 1e-12, 0);
        }
        pruned = pruned_at(tree, INFINITY);
        assert_int_equal(pruned->count, 1);
        assert_memory_equal(pruned->counts, tree->counts, CLASSES * sizeof *tree->counts);
    }
}

/* ---- limits, ties, unusual tables ---- */

static const double exclusive_x[] = {0, 0, 0, 1, 1, 0, 1, 1};
static const uint32_t exclusive_y[] = {0, 1, 1, 0};

TEST("a split without gain is made if later splits need it") {
    for (int c = 0; c < LG_CRITERION_COUNT; c++) {
        const lg_tree_options options = options_of((lg_tree_criterion)c, 1);
        const lg_tree *pruned, *tree = fit(&options, exclusive_x, exclusive_y, 4, 2, 2);
        assert_int_equal(tree->count, 7);
        assert_int_equal(tree->node[0].feature, 0);
        assert_close(tree->node[0].threshold, 0.5, 0, 0);
        for (int i = 0; i < 4; i++) {
            double p[2];
            lg_tree_predict(tree, &exclusive_x[2 * i], 1, p);
            assert_close(p[exclusive_y[i]], 1.0, 0, 0);
        }
        /* Although the root gains nothing, alpha 0 keeps all nodes, because the two splits below gain. */
        pruned = pruned_at(tree, 0.0);
        assert_int_equal(pruned->count, 7);
    }
}

TEST("ties are decided for the lower feature and threshold") {
    /* Features 1 and 2 are mirrored copies; feature 0 is constant. A cut after the first row is as good as
     * one before the last row. */
    const double x[] = {7, 0, 3, 7, 1, 2, 7, 2, 1, 7, 3, 0};
    const uint32_t y[] = {0, 1, 1, 0};
    for (int c = 0; c < LG_CRITERION_COUNT; c++) {
        lg_tree_options options = options_of((lg_tree_criterion)c, 1);
        options.max_depth = 1;
        const lg_tree *tree = fit(&options, x, y, 4, 3, 2);
        assert_int_equal(tree->node[0].feature, 1);
        assert_close(tree->node[0].threshold, 0.5, 0, 0);
    }
}

TEST("depth, leaf size and split size keep their limits") {
    double x[ROWS * FEATURES];
    uint32_t label[ROWS];
    draw_table(3, 1000, x, label);
    for (uint32_t depth = 1; depth <= 4; depth++) {
        lg_tree_options options = options_of(LG_GINI, 1);
        options.max_depth = depth;
        assert_int_equal(fit(&options, x, label, ROWS, FEATURES, CLASSES)->depth, depth);
    }
    lg_tree_options options = options_of(LG_ENTROPY, 3);
    options.min_samples_split = 10;
    const lg_tree *tree = fit(&options, x, label, ROWS, FEATURES, CLASSES);
    for (uint32_t i = 0; i < tree->count; i++) {
        assert_true(tree->node[i].samples >= 3);
        if (tree->node[i].left != 0) assert_true(tree->node[i].samples >= 10);
    }
}

TEST("a threshold lies between neighbouring doubles") {
    const lg_tree_options options = options_of(LG_GINI, 1);
    const double pairs[][2] = {{1.0, 1.0 + 0x1p-52}, {-1e308, 1e308},   {1e308, 1.7e308},
                               {0.0, 0x1p-1074},     {-0x1p-1074, 0.0}, {-1.0 - 0x1p-52, -1.0}};
    const uint32_t y[] = {0, 1};
    for (size_t i = 0; i < LG_COUNT(pairs); i++) {
        const lg_tree *tree = fit(&options, pairs[i], y, 2, 1, 2);
        assert_int_equal(tree->count, 3);
        assert_true(tree->node[0].threshold >= pairs[i][0] && tree->node[0].threshold < pairs[i][1]);
        double probability[4];
        lg_tree_predict(tree, pairs[i], 2, probability);
        assert_true(probability[0] == 1 && probability[1] == 0); /* leaf 1 */
        assert_true(probability[2] == 0 && probability[3] == 1); /* leaf 2 */
    }
}

TEST("tables without a possible split give a single leaf") {
    const lg_tree_options options = options_of(LG_ENTROPY, 1);
    const double same[] = {2, 2, 2, -0.0, 0.0, 0.0}, one[] = {5.0};
    const uint32_t y[] = {0, 1, 1};
    double p[4];
    const lg_tree *tree = fit(&options, same, y, 3, 1, 2);
    assert_int_equal(tree->count, 1);
    lg_tree_predict(tree, same, 1, p);
    assert_close(p[1], 2.0 / 3.0, 1e-15, 0);
    assert_int_equal(tree->depth, 0);
    tree = fit(&options, same + 3, y, 3, 1, 2); /* -0 and 0 are equal */
    assert_int_equal(tree->count, 1);
    tree = fit(&options, one, y, 1, 1, 4); /* classes 1 to 3 do not occur */
    lg_tree_predict(tree, one, 1, p);
    assert_close(p[0], 1.0, 0, 0);
    assert_close(p[3], 0.0, 0, 0);
}

TEST("a tree may be as deep as the table has rows, since nothing recurses") {
    enum { DEEP = 3000 };
    const lg_tree_options options = options_of(LG_GINI, 1);
    double *x = TEST_ARRAY(double, DEEP);
    uint32_t *y = TEST_ARRAY(uint32_t, DEEP);
    const lg_tree *tree, *pruned;
    assert_true(x != NULL && y != NULL);
    for (uint32_t i = 0; i < DEEP; i++) {
        x[i] = i;
        y[i] = i % 2; /* the best split cuts off one end */
    }
    tree = fit(&options, x, y, DEEP, 1, 2);
    assert_int_equal(tree->count, 2 * DEEP - 1);
    assert_true(tree->depth > DEEP / 4);
    pruned = pruned_at(tree, 1.0);
    assert_int_equal(pruned->count, 1);
}

TEST("invalid tables and options are refused, and the tree is unchanged") {
    static const double x[] = {1, 2, 3}, bad[] = {1, NAN, 3}, worse[] = {1, 2, -INFINITY};
    static const uint32_t y[] = {0, 1, 0}, out_of_range[] = {0, 2, 0};
    const struct {
        const double *x;
        const uint32_t *y;
        uint32_t rows, features, classes;
        lg_status status;
        const char *words;
    } tables[] = {{x, y, 0, 1, 2, LG_INVALID_ARGUMENT, ""},
                  {x, y, 3, 0, 2, LG_INVALID_ARGUMENT, ""},
                  {x, y, 3, 1, 0, LG_INVALID_ARGUMENT, ""},
                  {x, out_of_range, 3, 1, 2, LG_INVALID_ARGUMENT, "row 1 is of class 2"},
                  {bad, y, 3, 1, 2, LG_NOT_FINITE, "row 1"},
                  {worse, y, 3, 1, 2, LG_NOT_FINITE, "row 2"}};
    const lg_tree_options good = options_of(LG_GINI, 1);
    lg_tree_options options[] = {good, good, good, good, good, good};
    options[0].min_samples_split = 1;
    options[1].min_samples_leaf = 0;
    options[2].ccp_alpha = NAN;
    options[3].criterion = (lg_tree_criterion)LG_CRITERION_COUNT;
    options[4].size = 3;
    options[5].ccp_alpha = INFINITY;
    lg_tree tree = {.inputs = 77};
    lg_error error;
    for (size_t i = 0; i < LG_COUNT(tables); i++) {
        assert_status(lg_tree_fit(NULL, &good, tables[i].x, tables[i].y, tables[i].rows, tables[i].features,
                                  tables[i].classes, &tree, &error),
                      tables[i].status);
        assert_says(error.message, tables[i].words);
    }
    for (size_t i = 0; i < LG_COUNT(options); i++)
        assert_status(lg_tree_fit(NULL, &options[i], x, y, 3, 1, 2, &tree, NULL), LG_INVALID_ARGUMENT);
    const lg_tree golden = GOLDEN(leaf_gini, LG_GINI), empty = {.inputs = 0};
    size_t count;
    assert_status(lg_tree_prune(NULL, &golden, -1.0, &tree), LG_INVALID_ARGUMENT);
    assert_status(lg_tree_prune(NULL, &golden, NAN, &tree), LG_INVALID_ARGUMENT);
    assert_status(lg_tree_prune(NULL, &empty, 0.0, &tree), LG_INVALID_ARGUMENT);
    assert_status(lg_tree_pruning_path(NULL, &empty, 0, NULL, &count), LG_INVALID_ARGUMENT);
    assert_int_equal(tree.inputs, 77);
    assert_string_equal(lg_tree_criterion_name(LG_GINI), "gini");
    assert_string_equal(lg_tree_criterion_name((lg_tree_criterion)LG_CRITERION_COUNT), "unknown");
    lg_tree_destroy(NULL);
}

TEST("every allocation may fail, and the tree is unchanged") {
    lg_tree_options options = options_of(LG_ENTROPY, 1);
    options.ccp_alpha = 1e-3;
    EVERY_ALLOCATION_FAILS(context, 15, {
        lg_tree tree = {.inputs = 77};
        status = lg_tree_fit(context, &options, table_x, table_y, TABLE_ROWS, TABLE_FEATURES, TABLE_CLASSES,
                             &tree, NULL);
        if (status == LG_OK)
            lg_tree_destroy(&tree);
        else
            assert_int_equal(tree.inputs, 77);
    });
}
