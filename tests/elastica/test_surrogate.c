/* Surrogates: description, presets, split, range, and their curves: symmetry, ends, derivatives, integrals,
 * precision, memory, errors.
 * ctest-labels: src/elastica */
#include "elastica/surrogate_support.h"

enum { N = 50 };

static const double some_x[][8] = {
    {0.0, 0.0, 0.8, 0.6, 3.0, 0.0, 0.8, -0.6},    {0.0, 0.0, 0.8, -0.6, 3.0, 0.0, 0.8, 0.6},
    {0.0, 0.0, 1.0, 0.0, 3.0, 0.0, -0.6, 0.8},    {0.1, -0.2, -0.6, 0.8, 2.9, 0.3, -0.8, 0.6},
    {0.1, -0.2, -0.6, -0.8, 2.9, 0.3, -0.8, 0.6}, {0.0, 0.0, -1.0, 0.0, 3.0, 0.0, 0.8, 0.6}};
enum { SOME = LG_COUNT(some_x) };

/* ---- descriptions ---- */

TEST("kinds of surrogates have their names") {
    ASSERT_NAMES(lg_surrogate_kind, lg_surrogate_kind, LG_SURROGATE_KIND_COUNT);
    assert_string_equal(lg_surrogate_kind_name(LG_SURROGATE_CONTINUOUS), "continuous");
}

TEST("a refused description leaves the surrogate unchanged") {
    const lg_surrogate_options good = test_options[0];
    lg_surrogate model, before;
    lg_error error;
    memset(&model, 7, sizeof model);
    before = model;
#define REFUSED(intervals, length, centre, ...)                                                              \
    do {                                                                                                     \
        lg_surrogate_options o = good;                                                                       \
        __VA_ARGS__;                                                                                         \
        assert_status(lg_surrogate_init(&model, &o, intervals, length, centre, &error),                      \
                      LG_INVALID_ARGUMENT);                                                                  \
    } while (0)
    const double bad[] = {0.0, -1.0, NAN, INFINITY}, gammas[] = {-1e-300, NAN, INFINITY};
    for (size_t i = 0; i < LG_COUNT(bad); i++) REFUSED(N, bad[i], 1.5, (void)0);
    for (size_t i = 0; i < LG_COUNT(bad); i++) REFUSED(N, 3.3, bad[i], (void)0);
    for (size_t i = 0; i < LG_COUNT(gammas); i++) REFUSED(N, 3.3, 1.5, o.gamma = gammas[i]);
    REFUSED(1, 3.3, 1.5, (void)0);
    REFUSED(100001, 3.3, 1.5, (void)0);
    REFUSED(N, 3.3, 1.5, o.kind = (lg_surrogate_kind)LG_SURROGATE_KIND_COUNT);
    REFUSED(N, 3.3, 1.5, (o.kind = LG_SURROGATE_ANGLE, o.boundary = true, o.energy = INFINITY));
    REFUSED(N, 3.3, 1.5, (o.kind = LG_SURROGATE_ANGLE, o.residual = INFINITY));
    REFUSED(N, 3.3, 1.5, o.hidden = 0);
    REFUSED(N, 3.3, 1.5, o.layers = LG_NET_MAX_LAYERS + 1);
    REFUSED(N, 3.3, 1.5, (o.kind = LG_SURROGATE_ANGLE, o.modes = 1));
    REFUSED(N, 3.3, 1.5, (o.kind = LG_SURROGATE_CONTINUOUS, o.angles = true));
    REFUSED(N, 3.3, 1.5, (o.modes = 1, o.angles = true));
    REFUSED(N, 3.3, 1.5, o.modes = 4 * (N - 1) + 1);
    REFUSED(N, 3.3, 1.5, o.loss = LG_SURROGATE_ENERGY);
    REFUSED(N, 3.3, 1.5, (o.angles = true, o.loss = (lg_surrogate_loss)LG_SURROGATE_LOSS_COUNT));
    REFUSED(N, 3.3, 1.5, o.penalty = (lg_surrogate_penalty)LG_SURROGATE_PENALTY_COUNT);
    REFUSED(N, 3.3, 1.5, o.boundary = true);
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++) {
        if (kind == LG_SURROGATE_ANGLE) continue;
        REFUSED(N, 3.3, 1.5, (o.kind = (lg_surrogate_kind)kind, o.symmetric = true));
        assert_non_null(strstr(error.message, "angle"));
    }
    assert_memory_equal(&model, &before, sizeof model);
    assert_ok(lg_surrogate_init(&model, &good, 2, 3.3, 1.5, &error));
    assert_int_equal(model.net.outputs, 4);
}

/* ---- presets ---- */

TEST("the presets of the thesis have their published settings") {
    static const struct {
        lg_surrogate_kind kind;
        bool boundary, merged;
        double asked, fraction;
        uint32_t layers, hidden;
        double lr, gamma;
        uint64_t batch;
    } rows[] = {
        {LG_SURROGATE_DISCRETE, false, false, 0.1, 0.1, 4, 950, 1.019e-3, 8.595e-3, 64},
        {LG_SURROGATE_DISCRETE, false, false, 0.22, 0.2, 4, 351, 5.455e-3, 2.973e-3, 32},
        {LG_SURROGATE_DISCRETE, false, false, 0.6, 0.4, 3, 904, 1.429e-3, 9.338e-3, 32},
        {LG_SURROGATE_DISCRETE, false, false, 0.8, 0.9, 4, 879, 1.378e-3, 4.242e-3, 32},
        {LG_SURROGATE_DISCRETE, false, true, 0.1, 0.9, 2, 1006, 3.611e-3, 6.388e-3, 32},
        {LG_SURROGATE_CONTINUOUS, false, false, 0.0, 0.1, 5, 193, 4.548e-3, 2e-2, 1024},
        {LG_SURROGATE_CONTINUOUS, false, false, 0.2, 0.2, 6, 121, 4.913e-3, 2e-2, 1024},
        {LG_SURROGATE_CONTINUOUS, false, false, 0.4, 0.4, 6, 169, 4.2e-3, 2e-2, 1024},
        {LG_SURROGATE_CONTINUOUS, false, false, 1.0, 0.9, 5, 190, 3.025e-3, 2e-2, 1024},
        {LG_SURROGATE_ANGLE, false, false, 0.9, 0.9, 7, 143, 3.007e-3, 0.0, 20},
        {LG_SURROGATE_ANGLE, true, false, 0.9, 0.9, 4, 175, 1.846e-3, 0.0, 20},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_surrogate_preset *row = lg_surrogate_preset_find(
            "thesis", rows[i].kind, rows[i].boundary, LG_SURROGATE_MSE, rows[i].merged, rows[i].asked);
        assert_non_null(row);
        assert_close(row->fraction, rows[i].fraction, 0.0, 0.0);
        assert_int_equal(row->model.layers, rows[i].layers);
        assert_int_equal(row->model.hidden, rows[i].hidden);
        assert_close(row->training.lr, rows[i].lr, 0.0, 0.0);
        assert_close(row->model.gamma, rows[i].gamma, 0.0, 0.0);
        assert_int_equal(row->training.batch, rows[i].batch);
        const bool discrete = rows[i].kind == LG_SURROGATE_DISCRETE;
        assert_int_equal(row->training.epochs, discrete ? 300 : 100);
        assert_int_equal(row->training.lr_step, discrete ? 100 : 45);
        assert_false(row->model.mirror);
        assert_int_equal(row->model.architecture, discrete ? LG_NET_MLP : LG_NET_MULT_AFFINE);
        assert_int_equal(row->model.embedding, discrete ? 0 : rows[i].hidden);
        assert_int_equal(row->training.dtype, LG_F32);
    }
    assert_int_equal(
        lg_surrogate_preset_find("thesis", LG_SURROGATE_CONTINUOUS, false, LG_SURROGATE_MSE, false, 0.4)
            ->model.activation,
        LG_SINE);
}

TEST("every preset can be built, and for each setting there is a `best` one") {
    const char *const families[] = {"thesis", "best"};
    for (size_t f = 0; f < 2; f++)
        for (int which = 0; which < 80; which++) {
            const lg_surrogate_kind kind = (lg_surrogate_kind)(which % 4 == 3 ? 2 : which % 4);
            const bool boundary = which % 4 == 3, merged = which / 4 % 2 == 1;
            lg_surrogate model;
            const lg_surrogate_preset *row = lg_surrogate_preset_find(
                families[f], kind, boundary, LG_SURROGATE_MSE, merged, which / 8 * 0.1);
            if (row == NULL) {
                assert_true(f == 0 && merged && kind != LG_SURROGATE_DISCRETE);
                continue;
            }
            assert_string_equal(row->name, families[f]);
            assert_int_equal(row->kind, kind);
            assert_int_equal(row->model.kind, kind);
            assert_int_equal(row->model.boundary, boundary);
            assert_int_equal(row->boundary, boundary);
            assert_int_equal(row->merged, merged);
            assert_ok(lg_surrogate_init(&model, &row->model, N, 3.3, 1.5, NULL));
            assert_true(row->training.epochs > 0 && row->training.batch > 0 && row->training.shards > 0);
            assert_true(row->training.lr > 0.0 && row->training.adam_eps > 0.0 && row->training.lr_step > 0);
        }
    for (int merged = 0; merged < 2; merged++) {
        lg_surrogate model;
        const lg_surrogate_preset *row =
            lg_surrogate_preset_find("best", LG_SURROGATE_DISCRETE, false, LG_SURROGATE_ENERGY, merged, 0.5);
        assert_true(row != NULL && row->model.loss == LG_SURROGATE_ENERGY && row->model.angles);
        assert_ok(lg_surrogate_init(&model, &row->model, N, 3.3, 1.5, NULL));
    }
    assert_null(
        lg_surrogate_preset_find("thesis", LG_SURROGATE_DISCRETE, false, LG_SURROGATE_ENERGY, false, 0.9));
    assert_null(lg_surrogate_preset_find("best", LG_SURROGATE_ANGLE, false, LG_SURROGATE_ENERGY, false, 0.9));
    assert_null(
        lg_surrogate_preset_find("worst", LG_SURROGATE_DISCRETE, false, LG_SURROGATE_MSE, false, 0.9));
    assert_null(lg_surrogate_preset_find(NULL, LG_SURROGATE_DISCRETE, false, LG_SURROGATE_MSE, false, 0.9));
    assert_null(lg_surrogate_preset_find("best", LG_SURROGATE_DISCRETE, true, LG_SURROGATE_MSE, false, 0.9));
    assert_null(lg_surrogate_preset_find("best", LG_SURROGATE_DISCRETE, false, LG_SURROGATE_MSE, false, NAN));
}

/* ---- splits ---- */

static size_t count_of(const uint8_t *parts, size_t n, uint8_t part) {
    size_t count = 0;
    for (size_t i = 0; i < n; i++) count += parts[i] == part;
    return count;
}

TEST("a split has the given parts, a test part that depends only on the seed, and tests every curve "
     "equally often") {
    enum { CURVES = 1000 };
    static uint8_t parts[CURVES], whole[CURVES], other[CURVES];
    assert_ok(lg_surrogate_split(CURVES, 0.9, 0.1, 3, whole));
    assert_int_equal(count_of(whole, CURVES, LG_PART_TEST), 100);
    assert_int_equal(count_of(whole, CURVES, LG_PART_TRAIN), 900);
    const double fractions[] = {0.1, 0.2, 0.4, 0.9};
    for (size_t f = 0; f < 4; f++) {
        assert_ok(lg_surrogate_split(CURVES, fractions[f], 0.1, 3, parts));
        assert_int_equal(count_of(parts, CURVES, LG_PART_TRAIN), (int)(fractions[f] * CURVES + 0.5));
        for (size_t i = 0; i < CURVES; i++)
            assert_int_equal(parts[i] == LG_PART_TEST, whole[i] == LG_PART_TEST);
    }
    assert_ok(lg_surrogate_split(CURVES, 0.9, 0.1, 4, other));
    assert_memory_not_equal(whole, other, CURVES);
    size_t early = count_of(whole, CURVES / 2, LG_PART_TEST); /* the test part is spread over both halves */
    assert_true(early > 30 && early < 70);
    /* Every curve is in the test part for some seed. */
    static unsigned tested[20];
    for (uint64_t seed = 0; seed < 4000; seed++) {
        assert_ok(lg_surrogate_split(20, 0.5, 0.25, seed, parts));
        assert_int_equal(count_of(parts, 20, LG_PART_TEST), 5);
        for (size_t i = 0; i < 20; i++) tested[i] += parts[i] == LG_PART_TEST;
    }
    for (size_t i = 0; i < 20; i++) assert_true(tested[i] > 890 && tested[i] < 1110);
}

TEST("invalid fractions and numbers of curves are refused") {
    uint8_t parts[5] = {9, 9, 9, 9, 9};
    const double bad[][2] = {{1.1, 0.0}, {-0.1, 0.1}, {0.5, -0.1}, {0.6, 0.5}, {NAN, 0.1},
                             {0.5, NAN}, {0.0, 0.5},  {0.0, 0.0},  {0.05, 0.1}};
    for (size_t i = 0; i < LG_COUNT(bad); i++)
        assert_status(lg_surrogate_split(5, bad[i][0], bad[i][1], 1, parts), LG_INVALID_ARGUMENT);
    assert_status(lg_surrogate_split(0, 0.9, 0.1, 1, parts), LG_INVALID_ARGUMENT);
    for (size_t i = 0; i < 5; i++) assert_int_equal(parts[i], 9);
    /* 2.5 each: three test, and the two that are left train */
    assert_ok(lg_surrogate_split(5, 0.5, 0.5, 1, parts));
    assert_int_equal(count_of(parts, 5, LG_PART_TEST), 3);
    assert_int_equal(count_of(parts, 5, LG_PART_TRAIN), 2);
}

/* ---- training range ---- */

TEST("the distance to the training curves takes ends relative to q0, and reflects if the model does") {
    const lg_surrogate plain = {.length = 1.0}, folded = {.options = {.mirror = true}};
    double trained[4][8] = {{0.0}, {0.0}, {0.0}, {0.0}}, x[8] = {0.0};
    trained[1][2] = 1.0;
    trained[2][2] = 1.5;
    trained[3][2] = 1.5;
    trained[3][7] = 2.0;
    assert_close(lg_surrogate_reach(trained[0], 4), 2.0, 1e-15, 0.0);
    assert_close(lg_surrogate_reach(trained[0], 3), 1.0, 1e-15, 0.0);
    assert_close(lg_surrogate_reach(trained[0], 1), 0.0, 0.0, 0.0);
    assert_close(lg_surrogate_reach(trained[0], 0), 0.0, 0.0, 0.0);
    x[2] = 1.5;
    x[7] = 5.0;
    assert_close(lg_surrogate_distance(&plain, trained[0], 4, x), 3.0, 1e-15, 0.0);
    assert_close(lg_surrogate_distance(&plain, trained[0], 1, x), sqrt(27.25), 1e-15, 0.0);
    assert_close(lg_surrogate_distance(&plain, trained[0], 4, trained[2]), 0.0, 0.0, 0.0);
    assert_true(isinf(lg_surrogate_distance(&plain, trained[0], 0, x)));
    x[7] = -2.0; /* the mirror image of the last curve */
    assert_close(lg_surrogate_distance(&plain, trained[0], 4, x), 2.0, 1e-15, 0.0);
    assert_close(lg_surrogate_distance(&folded, trained[0], 4, x), 0.0, 0.0, 0.0);
    x[7] = 2.0;
    x[0] = x[4] = 7.0; /* the last curve, translated */
    assert_close(lg_surrogate_distance(&plain, trained[0], 4, x), 0.0, 0.0, 0.0);
    x[2] = NAN;
    assert_true(isinf(lg_surrogate_distance(&plain, trained[0], 4, x)));
}

TEST("one isolated curve in a hundred does not extend the range, two do") {
    enum { COUNT = 100 };
    double trained[COUNT][8];
    memset(trained, 0, sizeof trained);
    for (size_t i = 0; i < COUNT; i++) trained[i][2] = 0.01 * (double)i;
    trained[COUNT / 2][7] = 5.0;
    assert_close(lg_surrogate_reach(trained[0], COUNT), 0.01, 1e-9, 0.0);
    assert_close(lg_surrogate_reach(trained[0], COUNT - 1), sqrt(25.0 + 0.01 * 0.01), 1e-9, 0.0);
    trained[COUNT / 4][7] = 9.0;
    assert_close(lg_surrogate_reach(trained[0], COUNT), sqrt(16.0 + 0.25 * 0.25), 1e-9, 0.0);
    /* At most 32 curves are left out: of 33 isolated ones in 3300, the one that is nearest remains. */
    enum { MANY = 3300, LONE = 33 };
    double *many = TEST_ARRAY(double, 8 * MANY);
    for (size_t i = 0; i < MANY; i++) many[8 * i + 2] = 0.001 * (double)i;
    for (size_t i = 0; i < LONE; i++) many[8 * i * 100 + 7] = 100.0 * (double)(i + 1);
    assert_close(lg_surrogate_reach(many, MANY), 100.0, 1e-3, 0.0);
}

static void set_angles(double *x, double theta0, double thetaN, double unit) {
    const double values[8] = {unit,     2 * unit,   cos(theta0), sin(theta0),
                              4 * unit, 2.5 * unit, cos(thetaN), sin(thetaN)};
    memcpy(x, values, sizeof values);
}

/* The end angles of a family for a parameter t in [0, 1] (the second one, u, for families of two parameters).
 * */
static void angles_of(int family, double t, double u, double *theta0, double *thetaN) {
    const double x = 2 * 3.14159265358979323846 * t;
    *theta0 = family == 0 || (family == 2 && u < 0.5) ? x : family == 3 ? t : family == 4 ? 2 * t : 0.0;
    *thetaN = family <= 2 ? -x : family == 3 ? u : t * t - 1;
}

static bool is_outside(const lg_surrogate *model, const double *trained, size_t n, double reach,
                       double spread, const double *x) {
    return lg_surrogate_distance(model, trained, n, x) > 2 * reach ||
           lg_surrogate_off_family(model, trained, n, x) > 2 * spread;
}

/* Families: both ends, right end, both of these, all pairs of angles in a square, and a curve of pairs. */
TEST("queries of the training family are inside, other ends next to it are outside, whatever the unit of "
     "length") {
    enum { FAMILIES = 5, TRAINED = 150, SEEDS = 6, QUERIES = 200 };
    static const double units[] = {1.0, 1e-9, 1e9};
    double *trained = TEST_ARRAY(double, 8 * TRAINED), x[8], theta0, thetaN;
    for (int family = 0; family < FAMILIES; family++)
        for (uint64_t seed = 1; seed <= SEEDS; seed++) {
            size_t wrong[LG_COUNT(units)] = {0}, missed[LG_COUNT(units)] = {0};
            for (size_t u = 0; u < LG_COUNT(units); u++) {
                const lg_surrogate model = {.length = 4 * units[u]};
                lg_rng rng = test_rng(seed, (uint64_t)family);
                for (size_t i = 0; i < TRAINED; i++) {
                    /* Without large gaps: one condition in each of TRAINED equal parts. */
                    const double part = ((double)i + lg_rng_uniform(&rng)) / TRAINED;
                    const double other = family == 2 ? (double)(i % 2) : lg_rng_uniform(&rng);
                    angles_of(family, part, other, &theta0, &thetaN);
                    set_angles(trained + 8 * i, theta0, thetaN, units[u]);
                }
                const double reach = lg_surrogate_reach(trained, TRAINED),
                             spread = lg_surrogate_spread(trained, TRAINED);
                for (size_t i = 0; i < QUERIES; i++) {
                    const double t = 0.02 + 0.96 * lg_rng_uniform(&rng), v = lg_rng_uniform(&rng);
                    angles_of(family, t, v, &theta0, &thetaN);
                    set_angles(x, theta0, thetaN, units[u]);
                    wrong[u] += is_outside(&model, trained, TRAINED, reach, spread, x);
                    /* Off the square all of [0, 1]^2 is near; off a curve a small change of one angle is far.
                     * */
                    if (family == 3)
                        set_angles(x, theta0, thetaN + 2.0, units[u]);
                    else
                        set_angles(x, theta0 + 0.25, thetaN - 0.1, units[u]);
                    missed[u] += !is_outside(&model, trained, TRAINED, reach, spread, x);
                    set_angles(x, theta0, thetaN, units[u]);
                    x[5] += 0.5 * units[u]; /* another end of the beam */
                    missed[u] += !is_outside(&model, trained, TRAINED, reach, spread, x);
                }
            }
            print_message("  family %d, seed %d: %zu of %d inside called outside, %zu of %d outside missed\n",
                          family, (int)seed, wrong[0], QUERIES, missed[0], 2 * QUERIES);
            assert_true(wrong[0] <= QUERIES / 100);
            /* Where two families cross, conditions between them are near both. */
            assert_true(missed[0] <= (family == 2 ? QUERIES / 10 : QUERIES / 50));
            for (size_t u = 1; u < LG_COUNT(units); u++) {
                assert_int_equal(wrong[u], wrong[0]);
                assert_int_equal(missed[u], missed[0]);
            }
        }
}

/* ---- curves ---- */

/* The network's input for a row, as the header defines it, and the network's output. */
static void ask(const small *s, const double *row, double *y, double *dy) {
    const double along[9] = {1.0 / s->model.length};
    const lg_net *net = &s->model.net;
    lg_tape *tape = NULL;
    lg_var out = LG_NONE, slope = LG_NONE;
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)s->parameters), s->theta);
    const lg_var x = lg_input(tape, lg_shape2(1, net->inputs), row);
    const lg_var direction = lg_input(tape, lg_shape2(1, net->inputs), along);
    assert_ok(lg_net_record_jvp(tape, net, theta, 0, x, direction, &out, &slope));
    assert_ok(lg_read(tape, out, net->outputs, y));
    if (dy != NULL) assert_ok(lg_read(tape, slope, net->outputs, dy));
    lg_tape_destroy(tape);
}

/* Row 0 of the options: the boundary conditions unchanged. Row 1: x-coordinates normalised, reflected if v0y
 * < vNy. */
TEST("the nodes of a discrete network are its outputs for the documented inputs") {
    const double shown[2][8] = {{0.0, 0.0, -0.6, -0.8, 2.9 - 0.1, 0.3 + 0.2, -0.8, 0.6},
                                {-1.0, 0.0, -0.6, 0.8, (2.9 - 0.1 - 1.5) / 1.5, -0.3 - 0.2, -0.8, -0.6}};
    for (size_t which = 0; which < 2; which++) {
        const small s = make_small(which, N, TEST_LENGTH, 21);
        double y[4 * (N - 1)], at[N + 1], q[2 * (N + 1)], v[2 * (N + 1)];
        const double sign = which == 1 ? -1.0 : 1.0;
        for (size_t k = 0; k <= N; k++) at[k] = TEST_LENGTH / N * (double)k;
        curve_of(&s, some_x[4], at, N + 1, q, v);
        ask(&s, shown[which], y, NULL);
        for (size_t k = 1; k < N; k++)
            for (size_t c = 0; c < 2; c++) {
                const double side = c == 1 ? sign : 1.0;
                assert_close(q[2 * k + c], some_x[4][c] + side * y[2 * (k - 1) + c], 0.0, 0.0);
                assert_close(v[2 * k + c], side * y[2 * (N - 1) + 2 * (k - 1) + c], 0.0, 0.0);
            }
        for (size_t c = 0; c < 2; c++) {
            assert_close(q[c], some_x[4][c], 0.0, 0.0);
            assert_close(v[c], some_x[4][2 + c], 0.0, 0.0);
            assert_close(q[2 * N + c], some_x[4][4 + c], 0.0, 0.0);
            assert_close(v[2 * N + c], some_x[4][6 + c], 0.0, 0.0);
        }
    }
}

/* Makes the network return these numbers for any input, by its last bias. */
static void make_constant(const small *s, const double *numbers) {
    const size_t n = s->model.net.outputs;
    memset(s->theta, 0, s->parameters * sizeof *s->theta);
    memcpy(s->theta + s->parameters - n, numbers, n * sizeof *numbers);
}

TEST("a network of angles has unit tangents, and its points follow the beam's discrete rule") {
    for (size_t which = TEST_INNER; which < TEST_OPTIONS; which++) {
        const small s = make_small(which, N, TEST_LENGTH, 21);
        for (size_t x = 0; x < 5; x++) {
            double at[N + 1], q[2 * (N + 1)], v[2 * (N + 1)], theta[N + 1], expected[2 * (N + 1)];
            for (size_t k = 0; k <= N; k++) at[k] = TEST_LENGTH / N * (double)k;
            curve_of(&s, some_x[x], at, N + 1, q, v);
            for (size_t k = 0; k <= N; k++) theta[k] = atan2(v[2 * k + 1], v[2 * k]);
            for (size_t k = 1; k < N; k++) assert_close(hypot(v[2 * k], v[2 * k + 1]), 1.0, 1e-15, 0.0);
            const lg_elastica problem = {.length = TEST_LENGTH,
                                         .stiffness = 10.0,
                                         .q0 = {some_x[x][0], some_x[x][1]},
                                         .qN = {some_x[x][4], some_x[x][5]},
                                         .intervals = N};
            lg_elastica_curve(&problem, theta, expected, NULL);
            for (size_t i = 0; i < 2 * (N + 1); i++) assert_close(q[i], expected[i], 1e-13, 1e-13);
        }
    }
}

TEST("between the nodes a cubic is reproduced, with its derivative") {
    enum { M = 4, POINTS = 97 };
    const small s = make_small(0, M, TEST_LENGTH, 22);
    double numbers[4 * (M - 1)], at[POINTS], q[2 * POINTS], v[2 * POINTS], x[8];
    for (size_t k = 0; k <= M; k++) {
        const double t = TEST_LENGTH * (double)k / M;
        const double place[2] = {t - 0.1 * t * t * t, 0.3 * t * t - 0.05 * t * t * t};
        const double tangent[2] = {1.0 - 0.3 * t * t, 0.6 * t - 0.15 * t * t};
        const bool end = k == 0 || k == M;
        memcpy(end ? x + k : numbers + 2 * (k - 1), place, sizeof place);
        memcpy(end ? x + 2 + k : numbers + 2 * (M + k - 2), tangent, sizeof tangent);
    }
    make_constant(&s, numbers);
    for (size_t i = 0; i < POINTS; i++) at[i] = TEST_LENGTH * (double)i / (POINTS - 1);
    curve_of(&s, x, at, POINTS, q, v);
    for (size_t i = 0; i < POINTS; i++) {
        const double t = at[i];
        assert_close(q[2 * i], t - 0.1 * t * t * t, 0.0, 1e-14);
        assert_close(q[2 * i + 1], 0.3 * t * t - 0.05 * t * t * t, 0.0, 1e-14);
        assert_close(v[2 * i], 1.0 - 0.3 * t * t, 0.0, 1e-13);
        assert_close(v[2 * i + 1], 0.6 * t - 0.15 * t * t, 0.0, 1e-13);
    }
}

TEST("points and tangents of a continuous network are its outputs for s and the documented inputs") {
    const double at = 1.234, sign = -1.0;
    const double shown[3][9] = {
        {1.234 / 3.3, 0.0, 0.0, -0.6, -0.8, 2.9 - 0.1, 0.3 + 0.2, -0.8, 0.6},
        {1.234 / 3.3, -1.0, 0.0, -0.6, 0.8, (2.9 - 0.1 - 1.5) / 1.5, -0.3 - 0.2, -0.8, -0.6},
        {1.234 / 3.3, -1.0, 0.0, -0.6, -0.8, (2.9 - 0.1 - 1.5) / 1.5, 0.3 + 0.2, -0.8, 0.6}};
    for (size_t i = 0; i < 3; i++) {
        const small s = make_small(2 + i, N, TEST_LENGTH, 23);
        double y[2], dy[2], q[2], v[2];
        curve_of(&s, some_x[4], &at, 1, q, v);
        ask(&s, shown[i], y, dy);
        assert_close(q[0], some_x[4][0] + y[0], 1e-15, 1e-15);
        assert_close(v[0], dy[0], 1e-15, 1e-15);
        assert_close(q[1], some_x[4][1] + (i == 1 ? sign : 1.0) * y[1], 1e-15, 1e-15);
        assert_close(v[1], (i == 1 ? sign : 1.0) * dy[1], 1e-15, 1e-15);
    }
}

/* The term that a symmetric reconstruction adds to the tangent, (qN - q0 - int v ds)/L; otherwise 0. */
static void stretch(const small *s, const double *x, double *out) {
    const double end = TEST_LENGTH;
    small plain = *s;
    double q[2];
    plain.model.options.symmetric = false;
    curve_of(&plain, x, &end, 1, q, NULL);
    for (size_t c = 0; c < 2; c++)
        out[c] = s->model.options.symmetric ? (x[4 + c] - q[c]) / TEST_LENGTH : 0.0;
}

TEST("tangents are the derivatives of points, except for the term of a symmetric reconstruction") {
    enum { PLACES = 10 };
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        /* Places between nodes, where the difference quotient of a cubic is exact after one extrapolation.
         * The quadrature of the angle network is accurate to about 1e-9 on narrow panels. */
        const bool angle = test_options[which].kind == LG_SURROGATE_ANGLE;
        const double tolerance = angle ? 2e-7 : 1e-9;
        const small s = make_small(which, angle ? 400 : N, TEST_LENGTH, 24);
        for (size_t i = 0; i < SOME; i++) {
            double at[PLACES * 7], q[PLACES * 14], v[PLACES * 14], more[2], table[3][2];
            for (int k = 0; k < PLACES * 7; k++) { /* each place, and three pairs around it */
                const double h = k % 7 == 0 ? 0 : 8e-3 / (1 << (k % 7 - 1) / 2);
                at[k] = 0.1 + 0.331 * (k / 7) + (k % 7 % 2 == 0 ? h : -h);
            }
            curve_of(&s, some_x[i], at, PLACES * 7, q, v);
            stretch(&s, some_x[i], more);
            for (size_t k = 0; k < PLACES * 7; k += 7)
                for (size_t c = 0; c < 2; c++) {
                    for (size_t e = 0; e < 3; e++) {
                        const size_t a = k + 1 + 2 * e, b = a + 1;
                        table[e][c] = (q[2 * b + c] - q[2 * a + c]) / (at[b] - at[a]);
                    }
                    const double a = (4.0 * table[1][c] - table[0][c]) / 3.0;
                    const double b = (4.0 * table[2][c] - table[1][c]) / 3.0;
                    assert_close((16.0 * b - a) / 15.0, v[2 * k + c] + more[c], tolerance, tolerance);
                }
        }
    }
}

/* The angle in (-pi, pi], whatever the sign of a zero. */
static double angle_of(double x, double y) {
    const double angle = atan2(y, x);
    return angle <= -TEST_PI ? TEST_PI : angle;
}

TEST("angles are the network's outputs, reflected or not, with or without fixed ends") {
    const double at = 0.17;
    for (size_t which = TEST_ANGLE; which < TEST_MODES; which++)
        for (size_t i = 0; i < SOME; i++) {
            const small s = make_small(which, N, TEST_LENGTH, 25);
            double f, f0, fL, v[2];
            const double *x = some_x[i];
            const double sign = s.model.options.mirror && x[3] < x[7] ? -1.0 : 1.0;
            const double a = angle_of(x[2], sign * x[3]), b = angle_of(x[6], sign * x[7]);
            ask(&s, (double[3]){a / TEST_PI, b / TEST_PI, at}, &f, NULL);
            ask(&s, (double[3]){a / TEST_PI, b / TEST_PI, 0.0}, &f0, NULL);
            ask(&s, (double[3]){a / TEST_PI, b / TEST_PI, TEST_LENGTH}, &fL, NULL);
            double theta = TEST_PI * f;
            if (s.model.options.boundary)
                theta += (a - TEST_PI * f0) * exp(-100.0 * at * at) +
                         (b - TEST_PI * fL) * exp(-100.0 * (at - TEST_LENGTH) * (at - TEST_LENGTH));
            curve_of(&s, x, &at, 1, NULL, v);
            assert_close(v[0], cos(theta), 0.0, 1e-14);
            assert_close(v[1], sign * sin(theta), 0.0, 1e-14);
        }
}

/* q of the angle network is the integral of its tangents, for any places. If the ends are fixed, their
 * weights e^{-100 s^2} are integrated less accurately. */
TEST("points of the angle network are the integrals of its tangents, at any places") {
    enum { FINE = 4001 };
    for (size_t which = TEST_ANGLE; which < TEST_MODES; which++) {
        const small s = make_small(which, N, TEST_LENGTH, 26);
        static double at[FINE], v[2 * FINE];
        const double *x = some_x[3], tolerance = s.model.options.boundary ? 2e-5 : 1e-8;
        for (size_t i = 0; i < FINE; i++) at[i] = TEST_LENGTH * (double)i / (FINE - 1);
        for (size_t i = 0; i < FINE; i += 500)
            curve_of(&s, x, at + i, FINE - i < 500 ? FINE - i : 500, NULL, v + 2 * i);
        double sum[2] = {x[0], x[1]}, more[2], q[8];
        stretch(&s, x, more);
        const double h = TEST_LENGTH / (FINE - 1), points[4] = {at[1000], at[1000], at[1500], at[4000]};
        curve_of(&s, x, points, 4, q, NULL);
        for (size_t i = 0; i + 2 < FINE; i += 2) {
            for (size_t c = 0; c < 2; c++)
                sum[c] += h / 3.0 * (v[2 * i + c] + 4.0 * v[2 * i + 2 + c] + v[2 * i + 4 + c]);
            for (size_t p = 0; p < 4; p++)
                for (size_t c = 0; c < 2; c++)
                    if (at[i + 2] == points[p])
                        assert_close(q[2 * p + c], sum[c] + at[i + 2] * more[c], 0.0, tolerance);
        }
    }
}

/* Tangents have unit length for any parameters. With `boundary` the end angles are exact to the rounding of
 * both precisions, for long and short beams. */
TEST("tangents of the angle network are units, and its fixed ends are exact to rounding in both "
     "precisions") {
    static const double lengths[] = {3.3, 1.0, 0.3, 0.02};
    for (size_t which = TEST_ANGLE; which < TEST_MODES; which++)
        for (size_t l = 0; l < 4; l++)
            for (size_t i = 0; i < SOME; i++) {
                const small s = make_small(which, N, lengths[l], 27);
                double at[101], v[202];
                for (size_t k = 0; k <= 100; k++)
                    at[k] = k == 100 ? lengths[l] : lengths[l] * 0.01 * (double)k;
                for (int single = 0; single < 2; single++) {
                    typed_curve_of(&s, single ? LG_F32 : LG_F64, some_x[i], at, 101, NULL, v);
                    for (size_t k = 0; k <= 100; k++)
                        assert_close(sqrt(v[2 * k] * v[2 * k] + v[2 * k + 1] * v[2 * k + 1]), 1.0, 0.0,
                                     1e-15);
                    double error = 0.0;
                    for (size_t c = 0; c < 2; c++) {
                        error = fmax(error, fabs(v[c] - some_x[i][2 + c]));
                        error = fmax(error, fabs(v[200 + c] - some_x[i][6 + c]));
                    }
                    const double rounding = single ? 1e-5 : 1e-12;
                    assert_true(s.model.options.boundary ? error <= rounding : error > 1e-3);
                }
            }
}

/* ---- symmetry ---- */

TEST("mirror images have mirror curves exactly if the model has the option `mirror`") {
    /* Includes equal ends, angles of pi, and -0. */
    static const double more[][8] = {{0.0, 0.0, 0.8, 0.6, 3.0, 0.0, -0.8, 0.6},
                                     {0.0, 0.0, 1.0, 0.0, 3.0, 0.4, 1.0, 0.0},
                                     {0.0, 0.0, -1.0, 0.0, 3.0, 0.0, 0.8, 0.6},
                                     {0.0, -0.0, -1.0, -0.0, 3.0, 0.0, 0.8, -0.6}};
    enum { POINTS = 40 };
    for (size_t which = 0; which < TEST_OPTIONS; which++)
        for (size_t i = 0; i < SOME + LG_COUNT(more); i++) {
            const small s = make_small(which, N, TEST_LENGTH, 28);
            const double *x = i < SOME ? some_x[i] : more[i - SOME];
            double image[8], at[POINTS], q[4 * POINTS], v[4 * POINTS];
            for (size_t c = 0; c < 8; c++) image[c] = c % 2 == 1 ? -x[c] : x[c];
            for (size_t k = 0; k < POINTS; k++) at[k] = TEST_LENGTH * (double)k / (POINTS - 1);
            curve_of(&s, x, at, POINTS, q, v);
            curve_of(&s, image, at, POINTS, q + 2 * POINTS, v + 2 * POINTS);
            double error = 0.0;
            for (size_t k = 0; k < 2 * POINTS; k++) {
                const double side = k % 2 == 1 ? -1.0 : 1.0;
                error = fmax(error, fabs(q[2 * POINTS + k] - side * q[k]));
                error = fmax(error, fabs(v[2 * POINTS + k] - side * v[k]));
            }
            if (s.model.options.mirror)
                assert_true(error == 0.0);
            else
                assert_true(error > 1e-6);
        }
}

/* ---- precision, memory ---- */

TEST("single precision agrees with double precision to rounding") {
    enum { POINTS = 77 };
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        const small s = make_small(which, N, TEST_LENGTH, 29);
        double at[POINTS], q[4 * POINTS], v[4 * POINTS];
        for (size_t i = 0; i < s.parameters; i++) s.theta[i] = (double)(float)s.theta[i];
        for (size_t k = 0; k < POINTS; k++) at[k] = TEST_LENGTH * (double)k / (POINTS - 1);
        curve_of(&s, some_x[3], at, POINTS, q, v);
        typed_curve_of(&s, LG_F32, some_x[3], at, POINTS, q + 2 * POINTS, v + 2 * POINTS);
        double error = 0.0;
        for (size_t k = 0; k < 2 * POINTS; k++) {
            error = fmax(error, fabs(q[2 * POINTS + k] - q[k]));
            error = fmax(error, fabs(v[2 * POINTS + k] - v[k]));
        }
        assert_true(error > 0.0 && error < 2e-5);
    }
}

/* The points must agree to rounding. Used to check that only the requested bytes are written, and that
 * results do not depend on the grouping of points or on whether q, v or both are requested. */
static void assert_points(const double *x, const double *expected, size_t points, double rounding) {
    for (size_t k = 0; k < 2 * points; k++) assert_close(x[k], expected[k], rounding, rounding);
}

TEST("curves stay within their work memory and do not depend on grouping or on requested outputs") {
    static const size_t counts[] = {0, 1, 2, 42, 127, 128, 129, 300};
    enum { MOST = 300 };
    double at[MOST], all_q[2 * MOST], all_v[2 * MOST], q[2 * MOST], v[2 * MOST];
    for (size_t k = 0; k < MOST; k++) at[k] = TEST_LENGTH * (double)k / (MOST - 1);
    for (size_t which = 0; which < TEST_OPTIONS; which++)
        for (int single = 0; single < 2; single++) {
            const small s = make_small(which, N, TEST_LENGTH, 30);
            const double rounding = single ? 1e-5 : 1e-13;
            const lg_dtype dtype = single ? LG_F32 : LG_F64;
            typed_curve_of(&s, dtype, some_x[3], at, MOST, all_q, all_v);
            for (size_t n = 0; n < LG_COUNT(counts); n++) {
                typed_curve_of(&s, dtype, some_x[3], at, counts[n], q, v);
                assert_points(q, all_q, counts[n], rounding);
                assert_points(v, all_v, counts[n], rounding);
                memset(q, 0, sizeof q);
                memset(v, 0, sizeof v);
                typed_curve_of(&s, dtype, some_x[3], at, counts[n], q, NULL);
                typed_curve_of(&s, dtype, some_x[3], at, counts[n], NULL, v);
                assert_points(q, all_q, counts[n], rounding);
                assert_points(v, all_v, counts[n], rounding);
                typed_curve_of(&s, dtype, some_x[3], at, counts[n], NULL, NULL);
            }
        }
}

TEST("arc lengths that are NaN, infinite or beyond the ends are harmless") {
    static const double at[] = {-1.0, 4.0, 1e300, -INFINITY, INFINITY, NAN, 1.0, 0.5};
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        const small s = make_small(which, N, TEST_LENGTH, 31);
        double q[16], v[16];
        curve_of(&s, some_x[0], at, 8, q, v);
        for (size_t i = 0; i < 16; i++) { /* places that are not finite give NaN, the others do not */
            assert_true(isnan(q[i]) == !isfinite(at[i / 2]) || at[i / 2] == 1e300);
            assert_true(isnan(v[i]) == !isfinite(at[i / 2]) || at[i / 2] == 1e300);
        }
    }
}

TEST("a boundary condition that is not finite makes the whole curve NaN") {
    enum { BAD = 3 };
    static const double bad[BAD] = {NAN, INFINITY, -INFINITY}, at[] = {0.0, 0.5, 1.0};
    for (size_t i = 0; i < TEST_OPTIONS * 8 * BAD; i++) {
        const small s = make_small(i / 8 / BAD, N, TEST_LENGTH, 31);
        double x[8], q[6], v[6];
        memcpy(x, some_x[0], sizeof x);
        x[i / BAD % 8] = bad[i % BAD];
        curve_of(&s, x, at, 3, q, v);
        for (size_t k = 0; k < 6; k++) assert_true(isnan(q[k]) && isnan(v[k]));
    }
}

/* ---- evaluation ---- */

TEST("errors of a set are computed from the errors of its curves") {
    enum { CURVES = 300 };
    lg_elastica_curves set = make_curves(CURVES, 4);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        const small s = make_small(which, 4, TEST_LENGTH, 33);
        lg_surrogate_errors whole, e;
        double node[10], sum = 0.0, sum_q = 0.0, sum_node = 0.0, largest = 0.0, ends = 0.0, unit = 0.0;
        double at[5], q[10], v[10];
        assert_ok(lg_surrogate_evaluate(NULL, &s.model, s.theta, &set, NULL, 0, node, &whole, NULL));
        const bool discrete = s.model.options.kind == LG_SURROGATE_DISCRETE;
        lg_surrogate_curves *curves;
        assert_told(lg_surrogate_curves_create(NULL, &s.model, s.theta, LG_F64, 5, &curves, &told));
        void *work = test_work(lg_surrogate_curves_work_size(curves));
        for (size_t k = 0; k < 5; k++) at[k] = TEST_LENGTH * 0.25 * (double)k;
        for (uint32_t i = 0; i < CURVES; i++) {
            double square = 0.0;
            lg_surrogate_curve(curves, set.boundary + 8 * i, at, 5, q, v, work);
            for (size_t k = discrete ? 2 : 0; k < (discrete ? 8 : 10); k++) {
                const double dq = q[k] - set.q[10 * i + k], dv = v[k] - set.v[10 * i + k];
                square += (dq * dq + dv * dv) / (discrete ? 12.0 : 20.0);
                largest = fmax(largest, fmax(fabs(dq), fabs(dv)));
                sum_q += dq * dq / (discrete ? 6.0 : 10.0) / CURVES;
                if (k % 2 == 0) unit = fmax(unit, fabs(hypot(v[k], v[k + 1]) - 1.0));
            }
            if (i % 16 == 0) {
                assert_ok(lg_surrogate_evaluate(NULL, &s.model, s.theta, &set, &i, 1, NULL, &e, NULL));
                assert_close(e.mse, square, 1e-12, 0.0);
            }
            sum += square / CURVES;
            sum_node += hypot(q[4] - set.q[10 * i + 4], q[5] - set.q[10 * i + 5]) / CURVES;
            for (size_t c = 0; c < 2; c++) {
                ends = fmax(ends, fabs(v[c] - set.v[10 * i + c]));
                ends = fmax(ends, fabs(v[8 + c] - set.v[10 * i + 8 + c]));
                if (s.model.options.kind == LG_SURROGATE_ANGLE) continue;
                ends = fmax(ends, fabs(q[c] - set.q[10 * i + c]));
                ends = fmax(ends, fabs(q[8 + c] - set.q[10 * i + 8 + c]));
            }
        }
        lg_surrogate_curves_destroy(curves);
        assert_close(whole.mse, sum, 1e-12, 0.0);
        assert_close(whole.mse_q, sum_q, 1e-12, 0.0);
        assert_close(whole.mse, 0.5 * (whole.mse_q + whole.mse_v), 1e-14, 0.0);
        assert_close(whole.unit_tangent_error, unit, 1e-12, 1e-14);
        assert_close(whole.max_error, largest, 1e-12, 0.0);
        assert_close(node[4], sum_node, 1e-12, 0.0);
        assert_close(whole.boundary_error, ends, 1e-12, 1e-15);
    }
}

/* The output must stay unchanged when the call fails. */
static void not_judged(const small *s, const lg_elastica_curves *set, const uint32_t *chosen, size_t count,
                       lg_status status) {
    lg_surrogate_errors e = {.mse = 7.0};
    double node[14] = {7.0};
    assert_status(lg_surrogate_evaluate(NULL, &s->model, s->theta, set, chosen, count, node, &e, NULL),
                  status);
    assert_true(e.mse == 7.0 && node[0] == 7.0);
}

TEST("curves that do not fit the model, and numbers that are not finite, are refused") {
    const uint32_t beyond = 3;
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        lg_elastica_curves set = make_curves(3, 6), longer = set;
        const small s = make_small(which, 6, TEST_LENGTH, 34), other = make_small(which, 8, TEST_LENGTH, 34);
        if (s.model.options.kind == LG_SURROGATE_DISCRETE) not_judged(&other, &set, NULL, 0, LG_SHAPE);
        longer.length = 3.0;
        not_judged(&s, &set, &beyond, 0, LG_INVALID_ARGUMENT);
        not_judged(&s, &set, &beyond, 1, LG_INVALID_ARGUMENT);
        not_judged(&s, &longer, NULL, 0, LG_SHAPE);
        set.q[14 + 5] = NAN;
        not_judged(&s, &set, NULL, 0, LG_NOT_FINITE);
        set.q[14 + 5] = 0.0;
        s.theta[s.parameters - 1] = NAN;
        not_judged(&s, &set, NULL, 0, LG_NOT_FINITE);
    }
}

TEST("every allocation may fail, and nothing leaks") {
    lg_surrogate_curves_destroy(NULL);
    const lg_elastica_curves set = make_curves(3, 6);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        const small s = make_small(which, 6, TEST_LENGTH, 35);
        EVERY_ALLOCATION_FAILS(context, 2, {
            lg_surrogate_errors e = {.mse = 7.0};
            status = lg_surrogate_evaluate(context, &s.model, s.theta, &set, NULL, 0, NULL, &e, NULL);
            assert_true((e.mse == 7.0) == (status != LG_OK));
        });
    }
}
