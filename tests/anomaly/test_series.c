/* Sets of series: memory, windows across stored windows, splits that keep units together, scaling compared
 * with direct formulas. */
#include "anomaly/series_support.h"

#include "liegrad/core.h"

/* ---- helpers ---- */

/* Sample number `at` of channel c in the run that starts with stored window 0. */
static float ramp(size_t c, size_t at) {
    return (float)(1000 * c + at);
}

/* Every stored window continues the window before it, across all runs. */
static void fill_ramp(lg_series *s) {
    for (size_t i = 0; i < s->count; i++)
        for (size_t c = 0; c < s->channels; c++)
            for (size_t t = 0; t < s->length; t++)
                s->x[(i * s->channels + c) * s->length + t] = ramp(c, i * s->length + t);
}

/* ---- memory ---- */

TEST("a set has memory for its sizes, or none") {
    lg_series s = {.count = 3, .channels = 2, .length = 4, .classes = 11, .rate = 5.0};
    assert_ok(lg_series_allocate(NULL, &s, true, false));
    assert_string_equal(s.class_name[0], "0");
    assert_string_equal(s.class_name[10], "10");
    assert_non_null(s.group);
    assert_null(s.run);
    assert_null(s.channel_name);
    assert_close(s.rate, 5.0, 0, 0);
    for (size_t i = 0; i < 24; i++) assert_close((double)s.x[i], 0.0, 0, 0);
    lg_series_destroy(&s);
    assert_null(s.x);
    lg_series_destroy(&s);
    const lg_series bad[] = {{.count = 0, .channels = 1, .length = 1, .classes = 1},
                             {.count = 1, .channels = 0, .length = 1, .classes = 1},
                             {.count = 1, .channels = 1, .length = 0, .classes = 1},
                             {.count = 1, .channels = 1, .length = 1, .classes = 0}};
    for (size_t i = 0; i < 4; i++) {
        lg_series copy = bad[i];
        assert_status(lg_series_allocate(NULL, &copy, false, false), LG_INVALID_ARGUMENT);
        assert_null(copy.x);
    }
    lg_series huge = {.count = SIZE_MAX / 2, .channels = UINT32_MAX, .length = UINT32_MAX, .classes = 1};
    assert_status(lg_series_allocate(NULL, &huge, true, true), LG_OUT_OF_MEMORY);
    assert_null(huge.x);
    lg_series_destroy(NULL);
    lg_windows_destroy(NULL);
    lg_scaler_destroy(NULL);
    lg_windows w = {.count = 7};
    const lg_series no_series[] = {{.count = 0, .length = 4}, {.count = 4, .length = 0}};
    for (size_t i = 0; i < 2; i++)
        assert_status(lg_windows_create(NULL, &no_series[i], 2, 2, &w, NULL), LG_INVALID_ARGUMENT);
    const lg_series many = {.count = (size_t)1 << 33, .length = 4};
    assert_status(lg_windows_create(NULL, &many, 4, 4, &w, NULL), LG_INVALID_ARGUMENT);
    assert_int_equal(w.count, 7);
}

/* ---- windows ---- */

static void check_ramp(const lg_series *s, const lg_windows *w, const size_t *starts, size_t n) {
    float *x = TEST_ARRAY(float, (size_t)s->channels * w->length);
    assert_int_equal(w->count, n);
    for (size_t i = 0; i < n; i++) {
        assert_int_equal(w->first[i] * s->length + w->offset[i], starts[i]);
        assert_true(w->offset[i] < s->length);
        lg_windows_copy(s, w, i, x);
        for (size_t c = 0; c < s->channels; c++)
            for (size_t t = 0; t < w->length; t++)
                assert_close((double)x[c * w->length + t], (double)ramp(c, starts[i] + t), 0, 0);
    }
}

/* Two runs, of four and of two stored windows with ten samples each. */
static lg_series two_runs(void) {
    lg_series s = make_series(6, 3, 10, 2, false, true);
    for (size_t i = 0; i < 6; i++) s.label[i] = s.run[i] = i < 4 ? 0 : 1;
    fill_ramp(&s);
    return s;
}

TEST("windows are cut out of runs, across stored windows") {
    lg_series s = two_runs();
    const struct {
        size_t length, hop, count, start[8];
    } cases[] = {
        {0, 0, 6, {0, 10, 20, 30, 40, 50}}, /* as stored */
        {25, 0, 1, {0}},                    /* 40 = 25 + 15, 20 < 25 */
        {20, 0, 3, {0, 20, 40}},            /* whole stored windows joined */
        {7, 13, 5, {0, 13, 26, 40, 53}},    /* across stored windows and inside */
        {40, 1, 1, {0}},                    /* a whole run */
        {15, 9, 4, {0, 9, 18, 40}},
        {20, SIZE_MAX, 2, {0, 40}},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_windows w = cut_windows(&s, cases[i].length, cases[i].hop);
        check_ramp(&s, &w, cases[i].start, cases[i].count);
    }
    lg_windows w = {.count = 77};
    lg_error error;
    assert_status(lg_windows_create(NULL, &s, 41, 0, &w, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "41 samples"));
    assert_int_equal(w.count, 77);
    assert_status(lg_windows_create(NULL, &s, (size_t)UINT32_MAX + 1, 0, &w, &error), LG_INVALID_ARGUMENT);
}

TEST("no window crosses a change of class or group") {
    static const size_t starts[] = {0, 5, 10, 20, 30, 35, 40, 45, 50};
    for (int grouped = 0; grouped < 2; grouped++) {
        lg_series s = make_series(6, 1, 10, 2, true, true);
        memset(s.label, 0, 6 * sizeof *s.label);
        *(grouped ? &s.group[2] : &s.label[2]) = 1;
        fill_ramp(&s);
        lg_windows w = cut_windows(&s, 10, 5);
        check_ramp(&s, &w, starts, 9);
        lg_error error;
        assert_status(lg_windows_create(NULL, &s, 40, 0, &w, &error), LG_INVALID_ARGUMENT);
    }
}

TEST("without runs, windows lie inside stored windows") {
    static const size_t starts[] = {0, 4, 10, 14, 20, 24};
    lg_series s = make_series(3, 2, 10, 1, false, false);
    fill_ramp(&s);
    lg_windows w = cut_windows(&s, 6, 4);
    check_ramp(&s, &w, starts, 6);
    lg_error error;
    assert_status(lg_windows_create(NULL, &s, 11, 0, &w, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "runs"));
    s = make_series(1, 1, 1, 1, false, false);
    w = cut_windows(&s, 0, 0);
    assert_int_equal(w.count, 1);
}

/* ---- splits ---- */

typedef struct counts {
    size_t part[4];
} counts;

static counts split_of(const lg_series *s, const lg_windows *w, lg_split kind, double test, double validation,
                       uint64_t seed, uint8_t *parts) {
    assert_told(lg_series_split(NULL, s, w, kind, test, validation, seed, parts, &told));
    counts c = {{0}};
    for (size_t i = 0; i < w->count; i++) {
        assert_true(parts[i] >= LG_PART_TRAIN && parts[i] <= LG_PART_VALIDATION);
        c.part[parts[i]]++;
    }
    return c;
}

TEST("a random split divides each class, and its test part depends only on the seed") {
    enum { N = 250 };
    uint8_t parts[N], again[N], other[N];
    lg_series s = make_series(N, 1, 1, 3, false, false);
    for (size_t i = 0; i < N; i++) s.label[i] = i < 150 ? 0 : i < 240 ? 1 : 2; /* 150, 90, 10 */
    lg_windows w = cut_windows(&s, 0, 0);
    const counts c = split_of(&s, &w, LG_SPLIT_RANDOM, 0.2, 0.1, 7, parts);
    assert_int_equal(c.part[LG_PART_TEST], 30 + 18 + 2);
    assert_int_equal(c.part[LG_PART_VALIDATION], 15 + 9 + 1);
    static const size_t wanted[3] = {30, 18, 2};
    for (uint32_t k = 0; k < 3; k++) {
        size_t tested = 0;
        for (size_t i = 0; i < N; i++) tested += s.label[i] == k && parts[i] == LG_PART_TEST;
        assert_int_equal(tested, wanted[k]);
    }
    (void)split_of(&s, &w, LG_SPLIT_RANDOM, 0.2, 0.1, 7, again);
    (void)split_of(&s, &w, LG_SPLIT_RANDOM, 0.2, 0.1, 8, other);
    assert_memory_equal(parts, again, N);
    assert_memory_not_equal(parts, other, N);
    /* The test part does not depend on the size of the validation part. */
    (void)split_of(&s, &w, LG_SPLIT_RANDOM, 0.2, 0.3, 7, other);
    for (size_t i = 0; i < N; i++) assert_int_equal(parts[i] == LG_PART_TEST, other[i] == LG_PART_TEST);
    assert_int_equal(split_of(&s, &w, LG_SPLIT_RANDOM, 0.0, 0.0, 7, parts).part[LG_PART_TRAIN], N);
}

TEST("windows of a run, or of a group, stay together") {
    enum { STATES = 18, RUNS = 6, STORED = 4, N = STATES * RUNS * STORED };
    uint8_t parts[4 * N];
    lg_series s = make_series(N, 1, 10, 2, true, true);
    for (size_t i = 0; i < N; i++) {
        s.run[i] = (uint32_t)(1000000 - i / STORED);
        s.group[i] = (uint32_t)(i / STORED % STATES * 7919);
        s.label[i] = (uint32_t)(i / (STORED * STATES) % 2);
    }
    lg_windows w = cut_windows(&s, 20, 5);
    assert_true(w.count < sizeof parts);
    for (int kind = LG_SPLIT_RUN; kind <= LG_SPLIT_GROUP; kind++) {
        const uint32_t *unit = kind == LG_SPLIT_RUN ? s.run : s.group;
        const counts c = split_of(&s, &w, (lg_split)kind, 0.2, 0.2, 11, parts);
        const size_t per_unit = w.count / (kind == LG_SPLIT_RUN ? STATES * RUNS : STATES);
        /* runs: round(0.2 * 54) of each class; groups: round(0.2 * 18) of the only stratum */
        assert_int_equal(c.part[LG_PART_TEST], (kind == LG_SPLIT_RUN ? 22 : 4) * per_unit);
        assert_int_equal(c.part[LG_PART_VALIDATION], (kind == LG_SPLIT_RUN ? 22 : 4) * per_unit);
        for (size_t i = 0; i < w.count; i++)
            for (size_t j = 0; j < i; j++)
                if (unit[w.first[i]] == unit[w.first[j]]) assert_int_equal(parts[i], parts[j]);
    }
}

TEST("for any sizes every class has training windows, or the split is refused") {
    lg_rng rng = test_rng(5, 0);
    for (int trial = 0; trial < 200; trial++) {
        uint8_t parts[64];
        const size_t n = 2 + (size_t)lg_rng_below(&rng, 60);
        const uint32_t classes = 1 + (uint32_t)lg_rng_below(&rng, 4);
        if (n < classes) continue;
        lg_series s = make_series(n, 1, 1, classes, true, false);
        for (size_t i = classes; i < n; i++) s.label[i] = (uint32_t)lg_rng_below(&rng, classes);
        for (size_t i = 0; i < n; i++) s.group[i] = (uint32_t)lg_rng_below(&rng, 12);
        lg_windows w = cut_windows(&s, 0, 0);
        const lg_split kind = trial % 2 ? LG_SPLIT_GROUP : LG_SPLIT_RANDOM;
        const double test = 0.6 * lg_rng_uniform(&rng), validation = (0.99 - test) * lg_rng_uniform(&rng);
        lg_error error;
        const lg_status status =
            lg_series_split(NULL, &s, &w, kind, test, validation, (uint64_t)trial, parts, &error);
        if (status == LG_OK) {
            for (uint32_t k = 0; k < classes; k++) {
                bool trains = false;
                for (size_t i = 0; i < n; i++) trains |= s.label[i] == k && parts[i] == LG_PART_TRAIN;
                assert_true(trains);
            }
        } else {
            assert_status(status, LG_INVALID_ARGUMENT);
            assert_non_null(strstr(error.message, "is empty"));
        }
    }
}

TEST("invalid fractions, missing units and empty parts are refused") {
    static const struct {
        lg_split kind;
        double test, validation;
        const char *word;
    } cases[] = {
        {LG_SPLIT_RANDOM, -0.1, 0.0, ""},       {LG_SPLIT_RANDOM, 1.0, 0.0, ""},
        {LG_SPLIT_RANDOM, 0.5, 0.5, ""},        {LG_SPLIT_RANDOM, 0.0, -1.0, ""},
        {LG_SPLIT_RANDOM, NAN, 0.0, ""},        {LG_SPLIT_RANDOM, 0.0, NAN, ""},
        {LG_SPLIT_RUN, 0.2, 0.0, "no runs"},    {LG_SPLIT_GROUP, 0.2, 0.0, "no groups"},
        {LG_SPLIT_COUNT, 0.2, 0.0, ""},         {LG_SPLIT_RANDOM, 0.1, 0.0, "empty"}, /* round(0.1 * 3) = 0 */
        {LG_SPLIT_RANDOM, 0.4, 0.0, "class 2"}, {LG_SPLIT_RANDOM, 0.4, 0.0, "\"1\""},
    };
    uint8_t parts[6] = {9, 9, 9, 9, 9, 9};
    lg_series s = make_series(6, 1, 1, 2, false, false);
    lg_windows w = cut_windows(&s, 0, 0);
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_error error = {LG_OK, ""};
        if (strcmp(cases[i].word, "class 2") == 0) s.label[3] = 2;
        /* class 1 does not occur */
        if (strcmp(cases[i].word, "\"1\"") == 0) memset(s.label, 0, 6 * sizeof *s.label);
        assert_status(lg_series_split(NULL, &s, &w, cases[i].kind, cases[i].test, cases[i].validation, 1,
                                      parts, &error),
                      LG_INVALID_ARGUMENT);
        if (error.message[0] == '\0' || strstr(error.message, cases[i].word) == NULL)
            fail_msg("%zu: %s", i, error.message);
    }
    lg_windows none = w;
    none.count = 0;
    assert_status(lg_series_split(NULL, &s, &none, LG_SPLIT_RANDOM, 0.2, 0, 1, parts, NULL),
                  LG_INVALID_ARGUMENT);
    for (size_t i = 0; i < 6; i++) assert_int_equal(parts[i], 9);
}

/* ---- the healthy class ---- */

TEST("a class is healthy by its name or label, or else by the words of exactly one name") {
    static const struct {
        const char *name;
        bool healthy;
    } rows[] = {{"healthy", true},
                {"Normal", true},
                {"OK", true},
                {"good bearing", true},
                {"intact", true},
                {"Baseline_2", true},
                {"none", true},
                {"No Fault", true},
                {"undamaged", true},
                {"0", true},
                {"fault-free", true},
                {"state: ok", true},
                {"not damaged", true},
                {"unhealthy", false},
                {"abnormal", false},
                {"nok", false},
                {"not ok", false},
                {"no good", false},
                {"non-normal", false},
                {"broken", false},
                {"normal fault", false},
                {"10", false},
                {"0.007", false},
                {"none of these", false},
                {"goodness", false},
                {"bearing", false},
                {"", false},
                {"nearly intact", false},
                {"booking", false},
                {"\xc3\xb6k", false},
                {"damage", false},
                {"fault", false},
                {"isn't normal", false},
                {"ab-normal", false},
                {"off-nominal", false},
                {"n.ok.", false},
                {"hardly healthy", false},
                {"nicht ok", false},
                {"hopefully ok", false},
                {"good enough?", false},
                {"normal_0", true},
                {"Normal_1hp", true},
                {"normal condition", true},
                {"healthy state 3", true},
                {"normal operation", true},
                {"0 normal", true},
                {"97_Normal_0", true},
                {"!ok", false},
                {"ok?", false},
                {"presque normal", false},
                {"un-damaged", false}};
    char name[3][LG_SERIES_NAME] = {"", "worn", "cracked"}, label[3][LG_SERIES_NAME] = {"5", "6", "worn"};
    lg_series series = {.classes = 3, .class_name = name};
    for (uint32_t place = 0; place < 3; place++)
        for (size_t i = 0; i < LG_COUNT(rows); i++) {
            for (uint32_t c = 0; c < 3; c++) (void)snprintf(name[c], LG_SERIES_NAME, "worn %u", c + 1);
            (void)snprintf(name[place], LG_SERIES_NAME, "%s", rows[i].name);
            if (lg_series_healthy(&series, NULL) != (rows[i].healthy ? place : LG_NO_CLASS))
                fail_msg("'%s' is %s", rows[i].name, rows[i].healthy ? "not healthy" : "healthy");
            (void)snprintf(name[(place + 1) % 3], LG_SERIES_NAME, "Nominal");
            if (rows[i].healthy)
                assert_int_equal(lg_series_healthy(&series, ""), LG_NO_CLASS); /* two say so */
            if (rows[i].name[0] != '\0') assert_int_equal(lg_series_healthy(&series, rows[i].name), place);
        }
    (void)snprintf(name[1], LG_SERIES_NAME, "worn");
    assert_int_equal(lg_series_healthy(&series, "6"), LG_NO_CLASS);
    series.class_label = label;
    assert_int_equal(lg_series_healthy(&series, "6"), 1);
    assert_int_equal(lg_series_healthy(&series, "worn"), 1); /* a name comes before a label */
    assert_int_equal(lg_series_healthy(&series, "NORMAL"), LG_NO_CLASS);
    assert_int_equal(lg_series_healthy(NULL, "worn"), LG_NO_CLASS);
    memset(name[0], 'x', LG_SERIES_NAME - 1); /* the longest name */
    assert_int_equal(lg_series_healthy(&series, name[0]), 0);
}

TEST("splits have their names") {
    ASSERT_NAMES(lg_split, lg_split, LG_SPLIT_COUNT);
}

TEST("folds are assigned class by class") {
    static const uint32_t label[] = {0, 0, 1, 0, 2, 1, 0, 0, 1, 1, 5};
    static const uint32_t wanted[] = {0, 1, 0, 2, 0, 1, 0, 1, 2, 0, 0};
    uint32_t fold[11];
    assert_ok(lg_series_folds(NULL, label, NULL, 11, 3, fold, NULL));
    for (size_t i = 0; i < 11; i++) assert_int_equal(fold[i], wanted[i]);
    assert_ok(lg_series_folds(NULL, label, NULL, 11, 1, fold, NULL));
    for (size_t i = 0; i < 11; i++) assert_int_equal(fold[i], 0);
    assert_ok(lg_series_folds(NULL, label, NULL, 11, 0, fold, NULL));
    for (size_t i = 0; i < 11; i++) assert_int_equal(fold[i], 0);
}

/* A stratum is the set of units whose rows have the same classes. Units 2, 4, 9 have class 0 only, units 3, 7
 * have both classes, units 5, 6, 8 have class 1 only. The second stratum starts with the fold that has the
 * fewest rows of class 0. */
TEST("folds are assigned to whole units, stratum by stratum") {
    static const uint32_t unit[] = {9, 4, 4, 2, 2, 2, 7, 7, 3, 3, 3, 5, 6, 8, 8, 9};
    static const uint32_t label[] = {0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 1, 1, 1, 1, 1, 0};
    static const uint32_t wanted[] = {0, 1, 1, 0, 0, 0, 0, 0, 1, 1, 1, 0, 1, 0, 0, 0};
    static const uint32_t same[16] = {0}, few[] = {1, 0, 2, 1, 2, 2, 4, 4};
    uint32_t fold[16], more[16], rarest;
    assert_ok(lg_series_folds(NULL, few, NULL, 8, 2, fold, &rarest));
    assert_int_equal(rarest, 1); /* class 0; class 3 does not occur */
    assert_ok(lg_series_folds(NULL, label, NULL, 16, 2, fold, &rarest));
    assert_int_equal(rarest, 7); /* items of class 1 */
    assert_ok(lg_series_folds(NULL, label, unit, 16, 2, fold, &rarest));
    assert_int_equal(rarest, 5); /* units with class 0, and with class 1 */
    for (size_t i = 0; i < 16; i++) assert_int_equal(fold[i], wanted[i]);
    /* with more folds than units, no two units of a class share a fold */
    assert_ok(lg_series_folds(NULL, label, unit, 16, 100, more, NULL));
    for (size_t i = 0; i < 16; i++)
        for (size_t j = 0; j < 16; j++)
            if (label[i] == label[j]) assert_true((more[i] == more[j]) == (unit[i] == unit[j]));
    assert_ok(lg_series_folds(NULL, label, same, 16, 5, fold, NULL));
    for (size_t i = 0; i < 16; i++) assert_int_equal(fold[i], 0);
    assert_ok(lg_series_folds(NULL, label, unit, 16, 0, fold, NULL));
    for (size_t i = 0; i < 16; i++) assert_int_equal(fold[i], 0);
}

TEST("units are never split and are balanced in their strata; two classes both train in every fold") {
    enum { N = 300, UNITS = 40 };
    lg_rng rng = test_rng(12, 0);
    for (uint32_t draw = 0; draw < 200; draw++) {
        const uint32_t units = 4 + draw % (UNITS - 4), classes = 2 + draw % 3, folds = 2 + draw % 4;
        uint32_t label[N], unit[N], fold[N], of[UNITS], kind[UNITS], holds[UNITS][4] = {{0}};
        for (size_t u = 0; u < units; u++) kind[u] = (uint32_t)lg_rng_below(&rng, 2 * classes);
        for (size_t i = 0; i < N; i++) {
            unit[i] = i < units ? (uint32_t)i : (uint32_t)lg_rng_below(&rng, units);
            label[i] = kind[unit[i]] < classes ? kind[unit[i]] : (uint32_t)lg_rng_below(&rng, classes);
            holds[unit[i]][label[i]] = 1;
        }
        assert_ok(lg_series_folds(NULL, label, unit, N, folds, fold, NULL));
        for (size_t i = 0; i < units; i++) of[i] = fold[i];
        for (size_t i = 0; i < N; i++) assert_true(fold[i] < folds && fold[i] == of[unit[i]]);
        /* the numbers of units of u's stratum in two folds differ by at most one */
        for (size_t u = 0; u < units; u++) {
            uint32_t most = 0, least = N;
            for (uint32_t f = 0; f < folds; f++) {
                uint32_t count = 0;
                for (size_t v = 0; v < units; v++)
                    count += of[v] == f && memcmp(holds[u], holds[v], sizeof holds[u]) == 0;
                most = count > most ? count : most;
                least = count < least ? count : least;
            }
            assert_true(most - least <= 1);
        }
        for (uint32_t c = 0; c < classes && classes == 2; c++) {
            uint32_t total = 0, in[8] = {0};
            for (size_t u = 0; u < units; u++) {
                total += holds[u][c];
                in[of[u]] += holds[u][c];
            }
            for (uint32_t f = 0; f < folds && total >= folds; f++) assert_true(in[f] < total);
        }
        uint32_t alone[N], none[N];
        for (uint32_t i = 0; i < N; i++) unit[i] = i;
        assert_ok(lg_series_folds(NULL, label, unit, N, folds, alone, NULL));
        assert_ok(lg_series_folds(NULL, label, NULL, N, folds, none, NULL));
        assert_memory_equal(alone, none, sizeof alone);
    }
}

/* ---- scaling ---- */

/* Channel 0: offset 1e6, deviation about 1; channel 1: constant; channel 2: small numbers with a trend. */
TEST("the scaler has the means and deviations of the chosen windows") {
    enum { N = 40, L = 25 };
    lg_rng rng = test_rng(8, 0);
    lg_series s = make_series(N, 3, L, 2, false, false);
    for (size_t i = 0; i < N; i++)
        for (size_t t = 0; t < L; t++) {
            float *x = s.x + i * 3 * L + t;
            x[0] = (float)(1e6 + 0.125 * (double)lg_rng_below(&rng, 24)); /* exact in float */
            x[L] = 0.1f;
            x[2 * L] = (float)(1e-6 * lg_rng_normal(&rng) + 1e-6 * (double)i);
        }
    lg_windows w = cut_windows(&s, 0, 0);
    static const uint32_t chosen[] = {3, 17, 4, 39, 0, 3};
    for (int centred = 0; centred < 2; centred++)
        for (int all = 0; all < 2; all++) {
            const size_t count = all ? N : 6;
            const lg_scaler scaler = fit_scaler(&s, &w, all ? NULL : chosen, count, centred);
            assert_int_equal(scaler.channels, 3);
            for (size_t c = 0; c < 3; c++) {
                long double mean = 0, squares = 0;
                for (size_t i = 0; i < count; i++)
                    for (size_t t = 0; t < L; t++)
                        mean += (long double)s.x[((all ? i : chosen[i]) * 3 + c) * L + t] / (count * L);
                for (size_t i = 0; i < count; i++) {
                    const float *x = s.x + ((all ? i : chosen[i]) * 3 + c) * L;
                    long double own = 0;
                    for (size_t t = 0; t < L; t++) own += (long double)x[t] / L;
                    for (size_t t = 0; t < L; t++) {
                        const long double d = x[t] - (centred ? own : mean);
                        squares += d * d / (count * L);
                    }
                }
                if (centred)
                    assert_close(scaler.mean[c], 0.0, 0, 0);
                else
                    assert_close(scaler.mean[c], (double)mean, 1e-14, 0);
                assert_close(scaler.scale[c], c == 1 ? 1.0 : (double)sqrtl(squares), 1e-11, 0);
            }
            if (!centred) assert_close(scaler.mean[1], (double)0.1f, 0, 0);
        }
    lg_scaler none = {.channels = 5};
    static const uint32_t beyond[] = {N};
    assert_status(lg_scaler_fit(NULL, &s, &w, beyond, 1, false, &none), LG_INVALID_ARGUMENT);
    assert_status(lg_scaler_fit(NULL, &s, &w, chosen, 0, false, &none), LG_INVALID_ARGUMENT);
    assert_status(lg_scaler_fit(NULL, &s, &w, NULL, N + 1, false, &none), LG_INVALID_ARGUMENT);
    assert_int_equal(none.channels, 5);
}

TEST("windows that are constant but differ from each other count as constant only if centred") {
    lg_series s = make_series(2, 1, 7, 1, false, false);
    for (size_t t = 0; t < 7; t++) {
        s.x[t] = 0.1f;
        s.x[7 + t] = 0.3f;
    }
    lg_windows w = cut_windows(&s, 0, 0);
    const lg_scaler scaler = fit_scaler(&s, &w, NULL, 2, false);
    assert_close(fit_scaler(&s, &w, NULL, 2, true).scale[0], 1.0, 0, 0);
    assert_close(scaler.mean[0], 0.5 * ((double)0.1f + (double)0.3f), 1e-15, 0);
    assert_close(scaler.scale[0], 0.5 * ((double)0.3f - (double)0.1f), 1e-14, 0);
}

/* ---- failing allocations ---- */

static lg_status all_at_once(const lg_context *context) {
    lg_series s = {.count = 8, .channels = 2, .length = 3, .classes = 2};
    lg_windows w = {0};
    lg_scaler scaler = {0};
    uint8_t parts[8];
    lg_status status = lg_series_allocate(context, &s, true, true);
    for (size_t i = 0; status == LG_OK && i < 8; i++) s.label[i] = (uint32_t)(i % 2);
    if (status == LG_OK) status = lg_windows_create(context, &s, 0, 0, &w, NULL);
    if (status == LG_OK) status = lg_series_split(context, &s, &w, LG_SPLIT_RANDOM, 0.3, 0, 1, parts, NULL);
    if (status == LG_OK) status = lg_series_folds(context, s.label, NULL, 8, 3, (uint32_t[8]){0}, NULL);
    if (status == LG_OK) status = lg_scaler_fit(context, &s, &w, NULL, 8, false, &scaler);
    lg_scaler_destroy(&scaler);
    lg_windows_destroy(&w);
    lg_series_destroy(&s);
    return status;
}

TEST("every allocation may fail, and nothing leaks") {
    EVERY_ALLOCATION_FAILS(context, 10, { status = all_at_once(context); });
}
