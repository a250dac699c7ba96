/* Ranges of searches in YAML, and tables of trials. */
#include <locale.h>

#include "support/io_test.h"

#include "nn/search.h"
#include "support/searches.h"

/* ---- ranges ---- */

static const char example[] = "fixed: {network: discrete, batch: 32, lr-gamma: 1e-1}\n"
                              "ranges:\n"
                              "  architecture: {choice: [mlp, resnet]}\n"
                              "  layers: {integer: [0, 4]}\n"
                              "  gamma: {uniform: [0, 1e-2]}\n"
                              "  lr:\n"
                              "    log-uniform: [1e-4, 1e-1]\n"
                              "  normalise: {choice: [true, false]}\n";

static lg_search_file read_example(void) {
    lg_search_file file;
    const char *path = scratch_path("ranges.yaml");
    write_text_to(path, example);
    assert_ok(lg_search_file_read(NULL, path, &file, NULL));
    return file;
}

TEST("ranges are read") {
    static const lg_range expected[] = {
        {.name = "architecture", .kind = LG_RANGE_CHOICE, .choices = 2, .choice = {"mlp", "resnet"}},
        {.name = "layers", .kind = LG_RANGE_INTEGER, .low = 0, .high = 4},
        {.name = "gamma", .kind = LG_RANGE_UNIFORM, .low = 0, .high = 1e-2},
        {.name = "lr", .kind = LG_RANGE_LOG_UNIFORM, .low = 1e-4, .high = 1e-1},
        {.name = "normalise", .kind = LG_RANGE_CHOICE, .choices = 2, .choice = {"true", "false"}}};
    const lg_search_file f = read_example();
    const lg_range *r = f.space.ranges;
    assert_int_equal(f.fixed_count, 3);
    assert_string_equal(f.fixed_name[0], "network");
    assert_string_equal(f.fixed_value[0], "discrete");
    assert_string_equal(f.fixed_name[2], "lr-gamma");
    assert_string_equal(f.fixed_value[2], "1e-1");
    assert_true(f.fixed_line[1] == 1 && f.line[0] == 3 && f.line[3] == 7);
    assert_int_equal(f.space.count, LG_COUNT(expected));
    for (size_t i = 0; i < LG_COUNT(expected); i++) {
        assert_string_equal(r[i].name, expected[i].name);
        assert_true(r[i].kind == expected[i].kind && r[i].choices == expected[i].choices);
        assert_true(r[i].low == expected[i].low && r[i].high == expected[i].high);
        for (uint32_t c = 0; c < r[i].choices; c++)
            assert_string_equal(r[i].choice[c], expected[i].choice[c]);
    }
    /* `fixed` may be left out; JSON is YAML. */
    lg_search_file g;
    const char *path = scratch_path("only.json");
    write_text_to(path, "{\"ranges\": {\"lr\": {\"uniform\": [0, 1]}}}\n");
    assert_ok(lg_search_file_read(NULL, path, &g, NULL));
    assert_int_equal(g.fixed_count, 0);
    assert_int_equal(g.space.count, 1);
}

static lg_status read_ranges(const lg_context *context, const char *path, const lg_read_options *options,
                             lg_error *error) {
    (void)options;
    lg_search_file file;
    memset(&file, 0x5a, sizeof file);
    const lg_search_file before = file;
    const lg_status status = lg_search_file_read(context, path, &file, error);
    if (status != LG_OK) assert_memory_equal(&file, &before, sizeof file);
    return status;
}

TEST("invalid ranges are refused") {
    static const struct {
        const char *text, *line, *word;
    } wrong[] = {
        {"ranges: {}\n", "line 1", "ranges"},
        {"fixed: {a: 1}\n", "line 1", "'ranges' is missing"},
        {"ranges: [1]\n", "line 1", "ranges"},
        {"ranges:\n", "line 1", "ranges"},
        {"ranges: {a: {uniform: [0, 1]}}\nfixed: 3\n", "line 2", "fixed"},
        {"ranges: {a: {uniform: [0, 1]}}\nrange: {}\n", "line 2", "unknown key 'range'"},
        {"ranges: {a: {uniform: [0, 1]}}\nranges: {b: {uniform: [0, 1]}}\n", "line 2", "twice"},
        {"ranges:\n  a: {uniform: [0, 1]}\n  a: {uniform: [0, 1]}\n", "line 3", "'a' stands twice"},
        {"fixed: {a: 1}\nranges:\n  b: {uniform: [0, 1]}\n  a: {uniform: [0, 1]}\n", "line 4",
         "first on line 1"},
        {"fixed:\n  a: 1\n  a: 2\nranges: {b: {uniform: [0, 1]}}\n", "line 3", "'a' stands twice"},
        {"ranges: {b: {uniform: [0, 1]}}\nfixed: {\n  a: [1, [2]]}\n", "line 3", "a: a value"},
        {"ranges: {b: {uniform: [0, 1]}}\nfixed:\n  a: ''\n", "line 3", "a: a value"},
        {"ranges:\n  --lr: {uniform: [0, 1]}\n", "line 2", "name of an option"},
        {"ranges:\n  'l r': {uniform: [0, 1]}\n", "line 2", "name of an option"},
        {"ranges:\n  a2345678901234567890123456789012: {uniform: [0, 1]}\n", "line 2", "name of an option"},
        {"ranges:\n  'L_{': {uniform: [0, 1]}\n", "line 2", "name of an option"},
        {"ranges:\n  \"a\\0b\": {uniform: [0, 1]}\n", "line 2", "name of an option"},
        {"ranges:\n  lr: {[uniform]: [0, 1]}\n", "line 2", "log-uniform"},
        {"ranges:\n  lr: 0.1\n", "line 2", "log-uniform"},
        {"ranges:\n  lr: {normal: [0, 1]}\n", "line 2", "log-uniform"},
        {"ranges:\n  lr: {uniform: [0, 1], integer: [0, 1]}\n", "line 2", "log-uniform"},
        {"ranges:\n  lr: {}\n", "line 2", "log-uniform"},
        {"ranges:\n  lr: {uniform: 1}\n", "line 2", "2 numbers"},
        {"ranges:\n  lr: {uniform: [0, 1, 2]}\n", "line 2", "3 numbers"},
        {"ranges:\n  lr: {uniform: [0, 1,5]}\n", "line 2", "3 numbers"},
        {"ranges:\n  lr:\n    uniform: [0,\n      1m]\n", "line 4", "'1m' is not a number"},
        {"ranges:\n  lr: {uniform: [0, .inf]}\n", "line 2", "not a number"},
        {"ranges:\n  lr: {uniform: [0, 1e999]}\n", "line 2", "finite"},
        {"ranges:\n  lr: {uniform: [1, 0]}\n", "line 2", "above"},
        {"ranges:\n  a: {uniform: [0, 1]}\n  lr: {log-uniform: [0, 1]}\n", "line 3", "log-uniform"},
        {"ranges:\n  n: {integer: [0, 1.5]}\n", "line 2", "whole"},
        {"ranges:\n  n: {choice: mlp}\n", "line 2", "a list"},
        {"ranges:\n  n: {choice: []}\n", "line 2", "choices"},
        {"ranges:\n  n: {choice: [a, [b, [c]]]}\n", "line 2", "choice"},
        {"ranges:\n  n: {choice: [a, b, a]}\n", "line 2", "twice"},
        {"ranges:\n  n: {choice: [[a, b], 'a,b']}\n", "line 2", "twice"},
        {"ranges:\n  n: {choice: [[]]}\n", "line 2", "choice"},
        {"ranges:\n  n: {choice: [[a23456789012345678901234567890, a]]}\n", "line 2", "1 to 31 bytes"},
        {"fixed:\n  n: {a: 1}\nranges:\n  x: {uniform: [0, 1]}\n", "line 2", "1 to 63 bytes"},
        {"ranges:\n  n: {choice: [1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17]}\n", "line 2", "16 choices"},
    };
    const char *path = scratch_path("bad.yaml");
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        write_text_to(path, wrong[i].text);
        assert_refused(read_ranges, path, LG_FORMAT, wrong[i].line, wrong[i].word);
    }
    char many[4096] = "ranges:\n";
    for (int i = 0; i <= LG_RANGE_MAX; i++)
        (void)sprintf(many + strlen(many), "  a%d: {uniform: [0, 1]}\n", i);
    write_text_to(path, many);
    assert_refused(read_ranges, path, LG_FORMAT, "line 34", "more than 32");
    (void)read_example();
    survive_changed_bytes(read_ranges, scratch_path("ranges.yaml"), 400);
}

TEST("the shipped files have their ranges and fixed settings") {
    static const struct {
        const char *name;
        size_t ranges, fixed;
    } rows[] = {{"discrete", 9, 11}, {"continuous", 6, 15}, {"angle", 5, 14}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_search_file file;
        assert_told(lg_search_file_read(
            NULL, test_text("%s/../searches/elastica-%s.yaml", LG_TEST_DIR, rows[i].name), &file, &told));
        assert_int_equal(file.space.count, rows[i].ranges);
        assert_int_equal(file.fixed_count, rows[i].fixed);
        assert_string_equal(file.fixed_name[0], "network");
        assert_string_equal(file.fixed_value[0], rows[i].name);
    }
}

/* ---- trials ---- */

#define SEED 18446744073709551615u
#define N    6

/* Six trials with everything that a trial can hold. */
static void make_trials(const lg_search_file *file, lg_trial *trials) {
    static const double awkward[] = {0.1,  1.0 / 3, 5e-324,   1.7976931348623157e308,
                                     -0.0, NAN,     INFINITY, -INFINITY};
    for (size_t i = 0; i < N; i++) {
        lg_trial *t = &trials[i];
        *t = (lg_trial){.number = i == N - 1 ? UINT64_MAX : i,
                        .state = (lg_trial_state)(i % 3),
                        .objective = awkward[i],
                        .seconds = 0.1 * (double)i,
                        .parameters = i * 1000003,
                        .epochs = 300 * i,
                        .reports = (uint32_t)i};
        lg_search_draw(&file->space, 1, t->number, t->value);
        for (size_t k = 0; k < i; k++) t->report[k] = awkward[(i + k) % LG_COUNT(awkward)];
    }
}

static void assert_same_trial(const lg_trial *a, const lg_trial *b) {
    assert_int_equal(a->number, b->number);
    assert_int_equal(a->state, b->state);
    assert_int_equal(a->parameters, b->parameters);
    assert_int_equal(a->epochs, b->epochs);
    assert_int_equal(a->reports, b->reports);
    assert_memory_equal(a->value, b->value, sizeof a->value);
    assert_memory_equal(&a->objective, &b->objective, sizeof a->objective);
    assert_memory_equal(&a->seconds, &b->seconds, sizeof a->seconds);
    assert_memory_equal(a->report, b->report, sizeof a->report);
}

TEST("trials are read back as they were written") {
    const lg_search_file file = read_example();
    lg_trial trials[N], back[N];
    size_t count = 99;
    const char *path = scratch_path("trials.csv"), *again = scratch_path("again.csv");
    make_trials(&file, trials);
    assert_ok(lg_trials_write(NULL, path, &file, SEED, "data 1", trials, N, NULL));
    assert_ok(lg_trials_read(NULL, path, &file, SEED, "data 1", N, back, &count, NULL));
    assert_int_equal(count, N);
    for (size_t i = 0; i < N; i++) assert_same_trial(&back[i], &trials[i]);
    assert_ok(lg_trials_write(NULL, again, &file, SEED, "data 1", back, N, NULL));
    assert_same_bytes(path, again);
    /* Line ends of Windows. */
    size_t size, used = 0;
    unsigned char *data = read_bytes_of(path, &size), *wide = TEST_ARRAY(unsigned char, 2 * size);
    for (size_t i = 0; i < size; i++) {
        if (data[i] == '\n') wide[used++] = '\r';
        wide[used++] = data[i];
    }
    write_bytes_to(again, wide, used);
    assert_ok(lg_trials_read(NULL, again, &file, SEED, "data 1", N, back, &count, NULL));
    assert_int_equal(count, N);
    /* No trials yet. */
    assert_ok(lg_trials_write(NULL, path, &file, 1, NULL, NULL, 0, NULL));
    assert_ok(lg_trials_read(NULL, path, &file, 1, "", N, back, &count, NULL));
    assert_int_equal(count, 0);
}

TEST("a range may have the name of a column that every table has") {
    lg_search_file file;
    const lg_trial trial = {.epochs = 7, .value = {3}};
    lg_trial back[1];
    size_t count = 0;
    const char *path = scratch_path("same.csv"), *ranges = scratch_path("same.yaml");
    write_text_to(ranges, "ranges: {epochs: {integer: [1, 9]}}\n");
    assert_told(lg_search_file_read(NULL, ranges, &file, &told));
    assert_told(lg_trials_write(NULL, path, &file, 1, NULL, &trial, 1, &told));
    assert_told(lg_trials_read(NULL, path, &file, 1, NULL, 1, back, &count, &told));
    assert_int_equal(count, 1);
    assert_true(back[0].epochs == 7 && back[0].value[0] == 3);
}

TEST("the table of trials is text that other programs can read") {
    const lg_search_file file = read_example();
    lg_trial t[2] = {{.number = 1, .state = LG_TRIAL_FAILED, .objective = NAN, .value = {0, 0, 0, 0.001, 1}},
                     {.number = 3,
                      .state = LG_TRIAL_PRUNED,
                      .objective = 0.5,
                      .seconds = 1.25,
                      .parameters = 7,
                      .epochs = 100,
                      .value = {1, 4, 0.0078125, 0.0625, 0},
                      .reports = 2,
                      .report = {0.75, 0.5}}};
    const char *path = scratch_path("text.csv");
    /* A locale with a decimal comma, if there is one. */
    const bool comma = setlocale(LC_NUMERIC, "de_DE.UTF-8") != NULL;
    assert_ok(lg_trials_write(NULL, path, &file, 5, NULL, t, 2, NULL));
    if (comma) (void)setlocale(LC_NUMERIC, "C");
    size_t size;
    char *text = (char *)read_bytes_of(path, &size);
    assert_memory_equal(text, "# seed 5 space ", 15);
    assert_string_equal(strchr(text, '\n') + 1,
                        "trial,state,objective,parameters,epochs,seconds,architecture,layers,gamma,lr,"
                        "normalise,rung1,rung2\n"
                        "1,failed,nan,0,0,0,mlp,0,0,0.001,false,,\n"
                        "3,pruned,0.5,7,100,1.25,resnet,4,0.0078125,0.0625,true,0.75,0.5\n");
}

TEST("a range named like another column of the table gets the column option-NAME") {
    lg_search_file file = {.space = {.count = 2,
                                     .ranges = {{.name = "epochs", .kind = LG_RANGE_INTEGER, .high = 100},
                                                {.name = "lr", .kind = LG_RANGE_UNIFORM, .high = 1}}}};
    const lg_trial trial = {.state = LG_TRIAL_PRUNED, .objective = 0.5, .epochs = 17, .value = {85, 0.25}};
    const char *path = scratch_path("epochs.csv");
    lg_trial back;
    size_t size, count;
    assert_ok(lg_trials_write(NULL, path, &file, 5, NULL, &trial, 1, NULL));
    assert_string_equal(strchr((char *)read_bytes_of(path, &size), '\n') + 1,
                        "trial,state,objective,parameters,epochs,seconds,option-epochs,lr\n"
                        "0,pruned,0.5,0,17,0,85,0.25\n");
    assert_ok(lg_trials_read(NULL, path, &file, 5, NULL, 1, &back, &count, NULL));
    assert_int_equal(count, 1);
    assert_same_trial(&back, &trial);
}

/* The table is cut anywhere: complete lines are read, and the last trial is run again. */
TEST("if a table is cut anywhere, its complete lines are read") {
    const lg_search_file file = read_example();
    lg_trial trials[N], back[N];
    const char *path = scratch_path("trials.csv"), *cut = scratch_path("cut.csv");
    make_trials(&file, trials);
    assert_ok(lg_trials_write(NULL, path, &file, SEED, NULL, trials, N, NULL));
    size_t size, first;
    unsigned char *data = read_bytes_of(path, &size);
    first = (size_t)((unsigned char *)memchr(data, '\n', size) - data) + 1;
    for (size_t keep = 0; keep <= size; keep++) {
        size_t count = 77, lines = 0;
        write_bytes_to(cut, data, keep);
        for (size_t i = 0; i < keep; i++) lines += data[i] == '\n';
        lg_error error = {LG_OK, ""};
        const lg_status status = lg_trials_read(NULL, cut, &file, SEED, NULL, N, back, &count, &error);
        assert_status(status, keep < first ? LG_FORMAT : LG_OK);
        assert_int_equal(count, keep < first ? 77 : lines < 2 ? 0 : lines - 2);
        if (keep < first) assert_non_null(strstr(error.message, "line 1"));
        for (size_t i = 0; status == LG_OK && i < count; i++) assert_same_trial(&back[i], &trials[i]);
    }
}

/* Static memory, valid until the next call. */
static const char *replaced(const char *text, const char *from, const char *to) {
    static char out[2048];
    const char *at = strstr(text, from);
    assert_non_null(at);
    assert_in_range(snprintf(out, sizeof out, "%.*s%s%s", (int)(at - text), text, to, at + strlen(from)), 1,
                    sizeof out - 1);
    return out;
}

TEST("a damaged table is refused") {
    const lg_search_file file = read_example();
    lg_trial t[2] = {{.number = 1, .objective = 0.5, .value = {0, 3, 0.0078125, 0.0625, 0}},
                     {.number = 2, .objective = 0.25, .value = {1, 4, 0, 0.03125, 1}, .reports = 2}};
    const char *path = scratch_path("good.csv"), *bad = scratch_path("bad.csv");
    assert_ok(lg_trials_write(NULL, path, &file, 5, NULL, t, 2, NULL));
    size_t size;
    char *text = (char *)read_bytes_of(path, &size);
    static const struct {
        const char *from, *to, *line, *word;
    } wrong[] = {
        {"# seed", "seed", "line 1", "expected"},
        {"# seed 5", "# seed -5", "line 1", "expected"},
        {"# seed 5", "# seed 99999999999999999999", "line 1", "expected"},
        {"trial,state", "trial\nstate", "line 2", "'state'"},
        {",rung2",
         ",rung2,rung3,rung4,rung5,rung6,rung7,rung8,rung9,rung10,rung11,rung12,rung13,rung14,rung15,rung16,"
         "rung17",
         "line 2", "column"},
        {"1,done,", "1,done\n", "line 3", "has 2 cells, the header has 13"},
        {",mlp,3,", ",mlp\n3,", "line 3", "has 7 cells"},
        {",true,,\n", ",true,x,\n", "line 3", "column rung1: 'x'"},
        {" setting ", " ", "line 1", "expected"},
        {"\ntrial,state", "x\ntrial,state", "line 1", "expected"},
        {"trial,state", "trial,status", "line 2", "column 2 is 'status', expected: state"},
        {",lr,", ",learning,", "line 2", "expected: lr"},
        {",normalise", "", "line 2", "expected: normalise"},
        {",rung2", ",rung3", "line 2", "column"},
        {"1,done,", "x,done,", "line 3", "trial"},
        {"1,done,", "-1,done,", "line 3", "trial"},
        {"1,done,", "2,done,", "line 4", "in the table already"},
        {"1,done,", "1,finished,", "line 3", "state"},
        {"done,0.5,", "done,0.5x,", "line 3", "objective"},
        {"done,0.5,", "done,,", "line 3", "objective"},
        {"done,0.5,0,", "done,0.5,1.5,", "line 3", "parameters"},
        {",mlp,3,", ",cnn,3,", "line 3", "architecture"},
        {",mlp,3,", ",mlp,3.5,", "line 3", "layers"},
        {",mlp,3,", ",mlp,5,", "line 3", "layers"},
        {",0.0078125,", ",0.02,", "line 3", "gamma"},
        {",0.0625,", ",nan,", "line 3", "lr"},
        {",true,,\n", ",true,\n", "line 3", "has 12 cells"},
        {",true,,\n", ",true\n", "line 3", "has 11 cells"},
        {",true,,\n", ",true,,0.5\n", "line 3", "column rung2: '0.5'"},
        {",true,,\n", ",true,,,\n", "line 3", "has 14 cells"},
        {",true,,\n", ",tr\n", "line 3", "has 11 cells"},
        {"1,done,", "\n1,done,", "line 3", "is blank or a comment"},
        {"1,done,", "# 1,done\n1,done,", "line 3", "is blank or a comment"},
    };
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        const char *changed = replaced(text, wrong[i].from, wrong[i].to);
        lg_trial back[2];
        size_t count = 77;
        lg_error error = {LG_OK, ""};
        write_text_to(bad, changed);
        assert_status(lg_trials_read(NULL, bad, &file, 5, NULL, 2, back, &count, &error), LG_FORMAT);
        if (strstr(error.message, wrong[i].line) == NULL || strstr(error.message, wrong[i].word) == NULL)
            fail_msg("%zu: no '%s' or '%s' in: %s", i, wrong[i].line, wrong[i].word, error.message);
        assert_int_equal(count, 77);
    }
    size_t count;
    text[size / 2] = '\0';
    write_bytes_to(scratch_path("zero.csv"), text, size);
    write_bytes_to(scratch_path("empty.csv"), "", 0);
    static const struct {
        const char *name;
        lg_status status;
    } files[] = {{"zero.csv", LG_FORMAT}, {"empty.csv", LG_FORMAT}, {".", LG_FILE}, {"none", LG_NOT_FOUND}};
    for (size_t i = 0; i < LG_COUNT(files); i++)
        assert_status(
            lg_trials_read(NULL, scratch_path(files[i].name), &file, 5, NULL, 0, NULL, &count, NULL),
            files[i].status);
}

TEST("a table of another search is refused") {
    const lg_search_file file = read_example();
    lg_trial trials[N], back[N];
    const char *path = scratch_path("trials.csv");
    make_trials(&file, trials);
    assert_ok(lg_trials_write(NULL, path, &file, 5, "data", trials, N, NULL));
#define OTHER(seed, data, room, word, ...)                                                                   \
    do {                                                                                                     \
        lg_search_file other = file;                                                                         \
        size_t count = 77;                                                                                   \
        lg_error error = {LG_OK, ""};                                                                        \
        __VA_ARGS__;                                                                                         \
        assert_status(lg_trials_read(NULL, path, &other, seed, data, room, back, &count, &error),            \
                      LG_INVALID_ARGUMENT);                                                                  \
        if (strstr(error.message, word) == NULL) fail_msg("no '%s' in: %s", word, error.message);            \
        assert_int_equal(count, 77);                                                                         \
    } while (0)
    OTHER(5, "data", N, "other ranges", other.space.ranges[2].high = 1.0000000000000002e-2);
    OTHER(5, "data", N, "other ranges", other.space.ranges[1].kind = LG_RANGE_UNIFORM);
    OTHER(5, "data", N, "other ranges", (void)strcpy(other.space.ranges[0].choice[1], "mult"));
    OTHER(5, "data", N, "other ranges", (void)strcpy(other.space.ranges[0].name, "arch"));
    OTHER(5, "data", N, "other ranges", other.space.count = 4);
    OTHER(5, "data", N, "other fixed options", (void)strcpy(other.fixed_value[1], "64"));
    OTHER(5, "data", N, "other fixed options", other.fixed_count = 2);
    OTHER(6, "data", N, "seed 5, not 6", (void)0);
    OTHER(5, "dat", N, "", (void)0);
    OTHER(5, "data", N - 1, "holds more than the 5 trials that fit", (void)0);
    /* Line numbers do not matter for the comparison. */
    lg_search_file moved = file;
    size_t count;
    moved.line[0] = 40;
    assert_ok(lg_trials_read(NULL, path, &moved, 5, "data", N, back, &count, NULL));
}

TEST("trials that could not be read back are not written") {
    const lg_search_file file = read_example();
    lg_trial trials[N], changed[N];
    const char *path = scratch_path("unwritten.csv");
    make_trials(&file, trials);
    for (int i = 0; i < 9; i++) {
        memcpy(changed, trials, sizeof trials);
        if (i == 0) changed[2].number = changed[3].number;
        if (i == 1) changed[2].state = (lg_trial_state)LG_TRIAL_STATE_COUNT;
        if (i == 2) changed[2].reports = LG_TRIAL_REPORTS + 1;
        if (i == 3) changed[2].value[0] = 2;
        if (i == 4) changed[2].value[2] = NAN;
        if (i == 5) changed[2].value[1] = 1.5;
        if (i == 6) changed[2].state = (lg_trial_state)-1;
        if (i == 7) changed[2].value[0] = -1;
        if (i == 8) changed[2].value[0] = 0.5;
        assert_status(lg_trials_write(NULL, path, &file, 1, NULL, changed, N, NULL), LG_INVALID_ARGUMENT);
    }
    lg_search_file empty = file;
    empty.space.count = 0;
    assert_status(lg_trials_write(NULL, path, &empty, 1, NULL, trials, N, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_trials_write(NULL, path, NULL, 1, NULL, trials, N, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_trials_write(NULL, NULL, &file, 1, NULL, trials, N, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_trials_write(NULL, path, &file, 1, NULL, NULL, N, NULL), LG_INVALID_ARGUMENT);
    lg_search_file wrong[3] = {file, file, file};
    wrong[0].fixed_count = LG_RANGE_MAX + 1;
    wrong[1].fixed_count = wrong[2].fixed_count = 1;
    memset(wrong[1].fixed_name[0], 'n', LG_RANGE_NAME);
    memset(wrong[2].fixed_value[0], 'v', LG_SEARCH_FIXED_TEXT);
    for (int i = 0; i < 3; i++)
        assert_status(lg_trials_write(NULL, path, &wrong[i], 1, NULL, trials, N, NULL), LG_INVALID_ARGUMENT);
    size_t count = 77;
    for (int i = 0; i < 4; i++)
        assert_status(lg_trials_read(NULL,
                                     i == 0   ? NULL
                                     : i == 1 ? ""
                                              : path,
                                     &file, 1, NULL, 1, i == 2 ? NULL : changed, i == 3 ? NULL : &count,
                                     NULL),
                      LG_INVALID_ARGUMENT);
    assert_int_equal(count, 77);
    assert_int_not_equal(access(path, F_OK), 0);
}

/* ---- a search with its file ---- */

typedef struct session {
    const lg_search_file *file;
    const char *path;
    volatile int cancel;
    long epochs, stop_at;
    bool tear; /* the file loses its last bytes, as in a crash */
} session;

static lg_status session_run(void *user, lg_search *search, lg_trial *trial, lg_error *error) {
    session *s = user;
    (void)error;
    trial->parameters = trial->number;
    for (uint64_t done = 1; done <= 6; done++) {
        if (++s->epochs == s->stop_at) s->cancel = 1;
        if (s->cancel) return LG_CANCELLED;
        trial->epochs = done;
        trial->objective = trial->value[2] + 1.0 / (double)(done + (uint64_t)trial->value[1]);
        if (lg_search_report(search, done, 6, trial->objective)) break;
    }
    return LG_OK;
}

static lg_status session_save(void *user, const lg_trial *trials, size_t count, const lg_error *error) {
    session *s = user;
    lg_trial copy[16];
    (void)error;
    memcpy(copy, trials, count * sizeof *trials);
    for (size_t i = 0; i < count; i++) copy[i].seconds = 0;
    return lg_trials_write(NULL, s->path, s->file, 1, "d", copy, count, NULL);
}

/* One call of the program: reads the trials in the file, then runs the rest. */
static lg_status session_go(session *s) {
    lg_trial trials[16];
    size_t count = 0, size;
    lg_search_options options;
    lg_search_options_init(&options);
    options.warm_up = 2;
    if (s->tear) {
        unsigned char *data = read_bytes_of(s->path, &size);
        write_bytes_to(s->path, data, size - 5);
    }
    const lg_status found = lg_trials_read(NULL, s->path, s->file, 1, "d", 12, trials, &count, NULL);
    assert_true(found == LG_OK || found == LG_NOT_FOUND);
    const lg_search_problem problem = {session_run, s};
    return serial_search(&s->cancel, &s->file->space, &options, 12, &problem, session_save, trials, &count);
}

TEST("a resumed search ends as an uninterrupted one") {
    const lg_search_file file = read_example();
    const char *whole = scratch_path("whole.csv"), *parts = scratch_path("parts.csv");
    session one = {.file = &file, .path = whole};
    assert_ok(session_go(&one));
    size_t size;
    const char *text = (const char *)read_bytes_of(whole, &size);
    assert_non_null(strstr(text, "pruned"));
    assert_non_null(strstr(text, "done"));
    for (long stop = 1; stop <= one.epochs; stop++) {
        session two = {.file = &file, .path = parts, .stop_at = stop};
        (void)unlink(parts);
        assert_status(session_go(&two), LG_CANCELLED);
        two.cancel = 0;
        two.tear = stop % 2 == 0 && access(parts, F_OK) == 0;
        assert_ok(session_go(&two));
        assert_same_bytes(whole, parts);
    }
}

/* ---- memory ---- */

static lg_status use_memory(const lg_context *context, void *user, lg_error *error) {
    const lg_search_file *file = user;
    lg_search_file other;
    lg_trial trials[N];
    size_t count = 0;
    make_trials(file, trials);
    LG_TRY(lg_search_file_read(context, scratch_path("ranges.yaml"), &other, error));
    LG_TRY(lg_trials_write(context, scratch_path("m.csv"), file, 1, NULL, trials, N, error));
    return lg_trials_read(context, scratch_path("m.csv"), file, 1, NULL, N, trials, &count, error);
}

TEST("every allocation may fail, and nothing leaks") {
    lg_search_file file = read_example();
    assert_true(fail_every_allocation(use_memory, &file) >= 6);
}
