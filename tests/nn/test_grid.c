/* Samplers with an end, of which a grid is one: they have each combination of their levels exactly once. */
#include "nn/search.h"
#include "support/searches.h"
#include "test_support.h"

static const lg_range uniform = {.name = "uniform", .kind = LG_RANGE_UNIFORM, .low = -2, .high = 0.3},
                      logarithm = {.name = "log", .kind = LG_RANGE_LOG_UNIFORM, .low = 3e-5, .high = 0.1},
                      few = {.name = "few", .kind = LG_RANGE_INTEGER, .low = -3, .high = 2},
                      many = {.name = "many", .kind = LG_RANGE_INTEGER, .low = -5, .high = 95},
                      choice = {
                          .name = "choice", .kind = LG_RANGE_CHOICE, .choices = 3, .choice = {"a", "b", "c"}};

enum { MOST_POINTS = 5000 };
typedef double point[LG_RANGE_MAX];

static lg_search_options options_of(const char *name, uint64_t trials) {
    lg_search_options options;
    lg_search_options_init(&options);
    options.trials = trials;
    while (strcmp(lg_search_sampler_name(options.sampler), name) != 0) options.sampler++;
    return options;
}

static void assert_in_ranges(const lg_search_space *space, const lg_trial *trial) {
    for (size_t i = 0; i < space->count; i++) {
        const lg_range *range = &space->ranges[i];
        const bool named = range->kind == LG_RANGE_CHOICE, whole = named || range->kind == LG_RANGE_INTEGER;
        const double x = trial->value[i], high = named ? range->choices - 1.0 : range->high;
        assert_true(x >= (named ? 0 : range->low) && x <= high && (!whole || floor(x) == x));
    }
}

/* Writes the points that a search by a grid tries, and returns their number. */
static size_t points_of(const lg_search_space *space, uint64_t trials, point *out) {
    const lg_search_options options = options_of("grid", trials);
    point levels;
    const double points = lg_search_sampler(options.sampler)->points(space, trials, levels);
    lg_trial trial;
    assert_true(points > 0 && points <= MOST_POINTS);
    for (uint64_t i = 0; i < (uint64_t)points; i++) {
        assert_ok(search_values(space, &options, i, &trial));
        assert_in_ranges(space, &trial);
        memcpy(out[i], trial.value, sizeof trial.value);
    }
    assert_ok(search_values(space, &options, (uint64_t)points, &trial)); /* they begin again */
    assert_memory_equal(out[0], trial.value, sizeof trial.value);
    return (size_t)points;
}

/* The number of different values of a range. */
static size_t levels_of(const point *points, size_t count, size_t range) {
    size_t levels = 0;
    for (size_t i = 0; i < count; i++) {
        size_t k = 0;
        while (points[k][range] != points[i][range]) k++;
        levels += k == i;
    }
    return levels;
}

static int compare(const double *a, const double *b, size_t count) {
    size_t i = 0;
    while (i < count && a[i] == b[i]) i++;
    return i == count ? 0 : a[i] < b[i] ? -1 : 1;
}

static lg_search_space space_of(size_t count, const lg_range *const *ranges) {
    lg_search_space space = {.count = count};
    for (size_t i = 0; i < count; i++) {
        space.ranges[i] = *ranges[i];
        (void)snprintf(space.ranges[i].name, LG_RANGE_NAME, "x%zu", i);
    }
    assert_ok(lg_search_space_check(&space, NULL));
    return space;
}

TEST("a grid has each combination of its levels once, at most so many as trials, and divides ranges evenly") {
    static const lg_range *const spaces[][5] = {{&uniform},
                                                {&many},
                                                {&few, &choice},
                                                {&logarithm, &uniform},
                                                {&uniform, &choice, &logarithm, &few, &many},
                                                {&many, &uniform, &many, &logarithm}};
    point *points = TEST_ARRAY(point, MOST_POINTS);
    for (size_t s = 0; s < LG_COUNT(spaces); s++) {
        size_t ranges = 0, whole = 1, before = 0;
        while (ranges < LG_COUNT(*spaces) && spaces[s][ranges] != NULL) ranges++;
        const lg_search_space space = space_of(ranges, spaces[s]);
        for (size_t i = 0; i < ranges; i++)
            whole *= spaces[s][i] == &choice ? 3 : spaces[s][i] == &few ? 6 : 1;
        for (uint64_t trials = 1; trials <= MOST_POINTS; trials += 1 + trials / 3) {
            const size_t count = points_of(&space, trials, points);
            size_t product = 1, least = SIZE_MAX, most = 0;
            assert_true(count <= trials || count == whole);
            assert_true(count >= before);
            before = count;
            for (size_t i = 1; i < count; i++)
                assert_int_equal(compare(points[i - 1], points[i], ranges), -1);
            for (size_t i = 0; i < ranges; i++) {
                const lg_range *range = spaces[s][i];
                const size_t levels = levels_of(points, count, i);
                product *= levels;
                if (range == &choice || range == &few) {
                    assert_int_equal(levels, range == &choice ? 3 : 6);
                    continue;
                }
                if (range == &many && levels == 101) continue; /* all integers of the range */
                least = levels < least ? levels : least;
                most = levels > most ? levels : most;
            }
            assert_int_equal(product, count);
            if (most > 0) assert_true(most - least <= 1);
            /* One more level would be too many. */
            if (most > 0 && count <= trials) assert_true(count / least * (least + 1) > trials);
        }
    }
}

TEST("divided ranges have both ends to the last bit, and even steps between them") {
    static const lg_range *const tested[] = {&uniform, &logarithm, &many};
    point *points = TEST_ARRAY(point, MOST_POINTS);
    for (size_t t = 0; t < LG_COUNT(tested); t++) {
        const lg_range *range = tested[t];
        const lg_search_space space = space_of(1, &range);
        for (uint64_t trials = 2; trials < 200; trials++) {
            const size_t count = points_of(&space, trials, points);
            const double steps = (double)count - 1;
            assert_int_equal(count, range == &many && trials > 101 ? 101 : trials);
            assert_true(points[0][0] == range->low && points[count - 1][0] == range->high);
            for (size_t i = 1; i < count; i++)
                if (range == &logarithm)
                    assert_close(points[i][0] / points[i - 1][0], pow(range->high / range->low, 1 / steps),
                                 1e-12, 0);
                else
                    assert_close(points[i][0] - points[i - 1][0], (range->high - range->low) / steps, 0,
                                 range == &many ? 1 : 1e-12);
        }
    }
}

TEST("with one trial a range is tried in its middle; a range with one value has one level") {
    static const lg_range one = {.name = "one", .kind = LG_RANGE_UNIFORM, .low = 2.5, .high = 2.5},
                          same = {.name = "same", .kind = LG_RANGE_INTEGER, .low = 7, .high = 7},
                          log_one = {.name = "l", .kind = LG_RANGE_LOG_UNIFORM, .low = 0.1, .high = 0.1},
                          wide = {.name = "w", .kind = LG_RANGE_UNIFORM, .low = -1.7e308, .high = 1.7e308},
                          whole = {.name = "i", .kind = LG_RANGE_INTEGER, .low = -0x1p53, .high = 0x1p53},
                          only = {.name = "only", .kind = LG_RANGE_CHOICE, .choices = 1, .choice = {"a"}};
    static const lg_range *const ranges[] = {&one,  &same,  &log_one, &only,
                                             &wide, &whole, &uniform, &logarithm};
    const lg_search_space space = space_of(LG_COUNT(ranges), ranges);
    point *points = TEST_ARRAY(point, MOST_POINTS);
    assert_int_equal(points_of(&space, 1, points), 1);
    static const double middle[] = {2.5, 7, 0.1, 0, 0, 0, -0.85};
    for (size_t i = 0; i < LG_COUNT(middle); i++) assert_close(points[0][i], middle[i], 1e-15, 0);
    assert_close(points[0][LG_COUNT(middle)], sqrt(3e-6), 1e-14, 0);
    assert_int_equal(points_of(&space, 16, points), 16);
    for (size_t i = 0; i < 8; i++) assert_int_equal(levels_of(points, 16, i), i < 4 ? 1 : 2);
}

TEST("a grid depends on ranges and trials alone; the other samplers have no end") {
    static const lg_range *const ranges[] = {&choice, &uniform, &many};
    const lg_search_space space = space_of(LG_COUNT(ranges), ranges);
    lg_search_options options = options_of("grid", 40), other = options;
    other.seed = 99;
    for (uint64_t number = 0; number < 40; number++) {
        lg_trial one, two;
        assert_ok(search_values(&space, &options, number, &one));
        assert_ok(search_values(&space, &other, number, &two));
        assert_memory_equal(one.value, two.value, sizeof one.value);
    }
    for (uint32_t i = 0; lg_search_sampler_name(i) != NULL; i++)
        assert_int_equal(lg_search_sampler(i)->points != NULL, i == options.sampler);
    /* More points than there are numbers of trials. */
    lg_search_space huge = {.count = LG_RANGE_MAX};
    point levels;
    for (size_t i = 0; i < huge.count; i++) huge.ranges[i] = few;
    assert_close(lg_search_sampler(options.sampler)->points(&huge, 50, levels), pow(6, LG_RANGE_MAX), 1e-14,
                 0);
}
