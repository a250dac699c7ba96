/* Schemes in YAML files: schemes of the table are written and read back. Errors are refused with their
 * line. */
#include "support/io_test.h"

#include "liegrad/files.h"
#include "liegrad/integrators.h"

RELEASES(release_scheme, lg_scheme_destroy)

static const char *file_of(const char *text) {
    const char *path = scratch_path("scheme.yaml");
    write_text_to(path, text);
    return path;
}

static lg_scheme *read_text(const char *text) {
    lg_scheme *scheme;
    assert_told(lg_scheme_read(NULL, file_of(text), &scheme, &told));
    lg_test_owns(scheme, release_scheme);
    return scheme;
}

static lg_status read_and_free(const lg_context *context, const char *path, const lg_read_options *options,
                               lg_error *error) {
    lg_scheme *scheme = NULL;
    (void)options;
    const lg_status status = lg_scheme_read(context, path, &scheme, error);
    lg_scheme_destroy(scheme);
    return status;
}

#define HEUN "kind: rkmk\norder: 2\na: [[], [1]]\nb: [1/2, 1/2]\n"

TEST("tableaus, brackets, rows of exponentials and splittings are read") {
    const lg_scheme *s =
        read_text("name: own\nkind: rkmk\norder: 2\nembedded_order: 1\na: [[], [0.5], [0.25, 0.75]]\n"
                  "b: [0.25, 0.75, 0]\nembedded: [1, 0, 0]\ndexpinv: exact\n");
    assert_string_equal(s->name, "own");
    assert_true(s->kind == LG_SCHEME_RKMK && s->stages == 3 && s->order == 2 && s->embedded_order == 1);
    assert_true(s->fsal && s->dexpinv == LG_DEXPINV_EXACT && !s->ambient);
    assert_true(s->c[1] == 0.5 && s->c[2] == 1.0 && s->b[1] == 0.75 && s->embedded[0] == 1.0);
    s = read_text(HEUN);
    assert_string_equal(s->name, "scheme.yaml");
    assert_true(!s->fsal && s->a[1][0] == 1.0 && s->b[0] == 0.5);
    s = read_text("kind: rkmk\norder: 2\na: [[], [1]]\nb: [1/2, 1/2]\ncommutators: [[3, 1, 2, 1/12]]\n");
    assert_true(s->commutator_count == 1 && s->dexpinv == 0);
    assert_true(s->commutators[0].row == 2 && s->commutators[0].first == 0 && s->commutators[0].second == 1);
    s = read_text("kind: commutator-free\norder: 2\nembedded_order: 1\nrows: [[], [1], [[1/2, 1/2]]]\n"
                  "embedded: [1]\n");
    assert_true(s->kind == LG_SCHEME_COMMUTATOR_FREE && s->stages == 2 && s->rows[2].exponentials == 1);
    assert_true(s->rows[3].coefficient[0][0] == 1.0);
    s = read_text(
        "kind: commutator-free\norder: 1\nrows: [[], [1/2], {base: 2, exponentials: [[1/4], [1/4]]}]\n");
    assert_true(s->rows[2].base == 1 && s->rows[2].exponentials == 2);
    s = read_text("kind: splitting\norder: 1\nkick: [1]\ndrift: [1]\n");
    assert_true(s->kind == LG_SCHEME_SPLITTING && s->kick[0] == 1.0 && s->drift[0] == 1.0);
    s = read_text("kind: runge-kutta\norder: 1\nc: [0]\na: [[]]\nb: [1]\n");
    assert_true(s->ambient && s->stages == 1);
    lg_scheme_destroy(NULL);
    /* In the current folder the path has no slash. */
    char here[512];
    lg_scheme *scheme;
    (void)file_of(HEUN);
    assert_non_null(getcwd(here, sizeof here));
    assert_int_equal(chdir(scratch), 0);
    const lg_status status = lg_scheme_read(NULL, "scheme.yaml", &scheme, NULL);
    assert_int_equal(chdir(here), 0);
    assert_ok(status);
    assert_string_equal(scheme->name, "scheme.yaml");
    lg_scheme_destroy(scheme);
}

#define RK   "kind: rkmk\norder: 1\n"
#define FREE "kind: commutator-free\norder: 1\n"

TEST("an error in a scheme is refused with its line and its key") {
    static const struct {
        const char *text, *line, *says;
    } rows[] = {
        {RK "a: [[]]\nb: [one]\n", "line 4", "b: "},
        {RK "a: [[]]\nb: [[1]]\n", "line 4", "b: a number is expected"},
        {RK "a: [[]]\nb: [1/0]\n", "line 4", "b: "},
        {RK "a: [[]]\nb: [1/x]\n", "line 4", "b: "},
        {RK "a: [[]]\nb: [1e999]\n", "line 4", "b: "},
        {RK "a: [[]]\nb: [\"1\\0\"]\n", "line 4", "b: a number is expected"},
        {RK "a: [[]]\n"
            "b: [1.00000000000000000000000000000000000000000000000000000000000000000000000000000000000000]\n",
         "line 4", "b: a number is expected"},
        {RK "a: [[], 1]\nb: [0, 1]\n", "line 3", "a: a list of numbers is expected"},
        {RK "a: [[1, 2]]\nb: [1]\n", "line 3", "a: 2 numbers, at most 1"},
        {RK "a: [[], []]\nb: [1]\n", "line 3", "a: a list for each stage"},
        {RK "a: [[]]\nb: []\n", "line 4", "the scheme has 0 stages"},
        {RK "a: [[]]\nb: 1\n", "line 4", "the scheme has 0 stages"},
        {RK "a: [[]]\nb: [1]\nc: [0, 1]\n", "line 5", "c: 2 numbers"},
        {RK "a: [[]]\nb: [1]\nc: []\n", "line 5", "c: 0 numbers"},
        {RK "a: [[]]\nb: [1]\nembedded: [1, 2]\nembedded_order: 1\n", "line 5", "embedded: 2 numbers"},
        {RK "a: [[]]\nb: [1]\nembedded: [1]\n", "line 5", "must be given together"},
        {RK "a: [[]]\nb: [1]\nembedded_order: 1\n", "line 5", "must be given together"},
        {RK "a: [[]]\nb: [1]\ndexpinv: all\n", "line 5", "dexpinv: 'all'"},
        {RK "a: [[]]\nb: [1]\ndexpinv: 99\n", "line 5", "dexpinv: '99'"},
        {RK "a: [[]]\nb: [1]\nkick: [1]\n", "line 5", "kick: a scheme of kind rkmk has no such key"},
        {RK "b: [1]\n", "line 1", "needs the key 'a'"},
        {RK "a: [[]]\nb: [1/2]\n", "line 1", "sum"},
        {HEUN "commutators: []\n", "line 5", "commutators: a list of"},
        {HEUN "commutators: 1\n", "line 5", "commutators: a list of"},
        {HEUN "commutators: [1]\n", "line 5", "commutators: a list of numbers"},
        {HEUN "commutators: [[3, 1, 2]]\n", "line 5", "[row, first, second, weight] with"},
        {HEUN "commutators: [[3, 1.5, 2, 1]]\n", "line 5", "[row, first, second, weight] with"},
        {HEUN "commutators: [[3, 0, 2, 1]]\n", "line 5", "[row, first, second, weight] with"},
        {HEUN "commutators: [[4, 1, 2, 1]]\n", "line 5", "[row, first, second, weight] with"},
        {HEUN "commutators: [[3, 1, 3, 1]]\n", "line 5", "[row, first, second, weight] with"},
        {FREE "rows: [[], 1]\n", "line 3", "rows: a list of exponentials"},
        {FREE "rows: [[], {base: 1, exponentials: 1}]\n", "line 3", "rows: a list of exponentials"},
        {FREE "rows: [[], [[1], [1], [1], [1], [1], [1], [1], [1], [1], [1]]]\n", "line 3",
         "rows: too many exponentials"},
        {FREE "rows: [[], {[1]: 2}]\n", "line 3", "the keys `base` and `exponentials`"},
        {FREE "rows: [[], {base: 1, base: 1}]\n", "line 3", "the keys `base` and `exponentials`"},
        {FREE "rows: [[], {stage: 1}]\n", "line 3", "the keys `base` and `exponentials`"},
        {FREE "rows: [[], {base: one}]\n", "line 3", "rows: "},
        {FREE "rows: [[], {base: 1.5}]\n", "line 3", "the number of a stage"},
        {FREE "rows: [[], {base: 0}]\n", "line 3", "the number of a stage"},
        {FREE "rows: [[], {base: 2}]\n", "line 3", "the number of a stage"},
        {FREE "rows: [[], {base: 2, exponentials: [[1]]}, [[1/2, 1/2]]]\n", "line 3", "an earlier stage"},
        {FREE "rows: [[], [[x]]]\n", "line 3", "rows: "},
        {FREE "rows: [[]]\n", "line 3", "the scheme has 0 stages"},
        {FREE "rows: [[], [1]]\nembedded: 1\nembedded_order: 1\n", "line 4", "embedded: a list"},
        {"kind: splitting\norder: 1\nkick: [1, 0]\ndrift: [1]\n", "line 4", "drift: 1 numbers"},
        {"kind: splitting\norder: 1\nkick: [x]\ndrift: [1]\n", "line 3", "kick: "},
        {"kind: splitting\norder: 1\nkick: [1/2]\ndrift: [1]\n", "line 1", "the kicks do not sum to 1"},
        {"kind: splitting\norder: 1\nkick: [1]\ndrift: [1/2]\n", "line 1", "the drifts do not sum to 1"},
        {"kind: magnus\norder: 1\n", "line 1", "magnus"},
        {"kind: splitting\norder: 0\nkick: [1]\ndrift: [1]\n", "line 2", "order"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        assert_refused(read_and_free, file_of(rows[i].text), LG_FORMAT, rows[i].line, rows[i].says);
        assert_status(lg_scheme_read(NULL, file_of(rows[i].text), &(lg_scheme *){NULL}, NULL), LG_FORMAT);
    }
    assert_status(lg_scheme_read(NULL, file_of(HEUN), NULL, NULL), LG_INVALID_ARGUMENT);
}

TEST("every allocation may fail, and nothing leaks") {
    assert_true(fail_every_reading(read_and_free, file_of(HEUN)) >= 2);
}
