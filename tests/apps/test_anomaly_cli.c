/* lg-anomaly (in LG_BIN_DIR) from outside: the scene's data, models of every method on them and on data of
 * other shapes, votes, scores, bad input, training and searches that are interrupted and resumed. */
#include "cli_support.h"

#include <math.h>

#include <hdf5.h>

#include "liegrad/io.h"
#include "liegrad/random.h"

static const char lg[] = "lg-anomaly";
static cli result;

static const char ranges[] = "fixed: {epochs: 6, batch: 10, preset: thesis}\n"
                             "ranges:\n"
                             "  activation: {choice: [tanh, swish]}\n"
                             "  lr: {log-uniform: [1e-4, 1e-1]}\n"
                             "  plane: {integer: [0, 3]}\n";

#define SEARCH "search ranges.yaml data.h5 --trials 6 --warm-up 2 "

static void run(const char *arguments) {
    cli_expect(lg, arguments, 0, "", &result);
}

/* ---- data of other people ---- */

typedef struct other {
    const char *name;
    size_t count;
    uint32_t channels, length, classes;
    double rate;
    uint32_t of_run; /* windows of a recording; 0: unknown */
    bool half;       /* the second half of each recording is of class 1, otherwise classes take turns */
    bool constant;   /* the last channel does not vary */
} other;

static const other others[] = {
    {"three.h5", 60, 2, 40, 3, 0, 0, false, false},   {"one-channel.h5", 40, 1, 152, 2, 0, 0, false, false},
    {"short.h5", 40, 3, 2, 2, 0, 0, false, false},    {"point.h5", 40, 4, 1, 2, 0, 0, false, false},
    {"constant.h5", 40, 3, 30, 2, 0, 0, false, true}, {"votes.h5", 48, 2, 20, 2, 4, 8, true, false},
    {"single.h5", 10, 2, 20, 1, 0, 0, false, false},  {"tiny.h5", 4, 2, 20, 2, 0, 0, false, false},
};

/* Class c: noise of standard deviation 1 + 3 c about 2 c. */
static void write_other(const other *what) {
    lg_series_data data;
    lg_error error = {LG_OK, ""};
    lg_rng rng;
    char path[1024];
    memset(&data, 0, sizeof data);
    data.noise = data.severity = NAN;
    data.series = (lg_series){
        .count = what->count, .channels = what->channels, .length = what->length, .classes = what->classes};
    assert_int_equal(lg_series_allocate(NULL, &data.series, false, what->of_run > 0), LG_OK);
    data.series.rate = what->rate;
    lg_rng_seed(&rng, 11, 0);
    const size_t window = (size_t)what->channels * what->length;
    for (size_t i = 0; i < what->count; i++) {
        const uint32_t c =
            what->half ? (i % what->of_run) / (what->of_run / 2) : (uint32_t)(i % what->classes);
        data.series.label[i] = c;
        if (what->of_run > 0) data.series.run[i] = (uint32_t)(i / what->of_run);
        for (size_t k = 0; k < window; k++)
            data.series.x[i * window + k] = what->constant && k >= window - what->length
                                                ? 5.0f
                                                : (float)(2.0 * c + (1 + 3.0 * c) * lg_rng_normal(&rng));
    }
    cli_path(what->name, path, sizeof path);
    if (lg_series_write(NULL, path, &data, &error) != LG_OK) fail_msg("%s", error.message);
    lg_series_data_destroy(&data);
}

static lg_series_data read_back(const char *name) {
    lg_series_data data;
    lg_error error = {LG_OK, ""};
    char path[1024];
    cli_path(name, path, sizeof path);
    if (lg_series_read(NULL, path, NULL, NULL, &data, &error) != LG_OK) fail_msg("%s", error.message);
    return data;
}

static int setup(void **state) {
    (void)state;
    if (cli_begin() != 0) return -1;
    cli_write("ranges.yaml", ranges);
    for (size_t i = 0; i < LG_COUNT(others); i++) write_other(&others[i]);
    run("generate --runs 16 --hours 0.1 --noise 1 --window 30 --out data.h5");
    run("generate --runs 4 --hours 0.1 --noise 1 --window 30 --seed 9 --out fresh.h5");
    run("train data.h5 --epochs 2 --out model.h5");
    run("train data.h5 --method logistic --out logistic.h5");
    run("generate --runs 2 --hours 0.005 --window 10 --out brief.h5");
    run("train three.h5 --epochs 1 --out three-model.h5");
    return 0;
}

/* ---- words ---- */

TEST("every command has help") {
    static const char *const commands[] = {"generate", "feed", "train", "evaluate", "search", "watch"};
    cli_expect_help(lg, commands, LG_COUNT(commands), &result);
}

static const cli_bad bad_input[] = {
    {"", 2, "which command"},
    {"guess", 2, "'guess' is no command"},
    {"generate", 2, "--out FILE is missing"},
    {"generate --out nowhere/s.h5", 3, "nowhere/s.h5"},
    {"generate --out s.h5 --noise -1", 2, "--noise: '-1'"},
    {"generate --out s.h5 --noise nan", 2, "--noise: 'nan'"},
    {"generate --out s.h5 --runs 0", 2, "--runs: '0'"},
    {"generate --out s.h5 --hours 0", 2, "--hours: '0'"},
    {"generate --out s.h5 --severity 0", 2, "--severity: '0'"},
    {"generate --out s.h5 --severity 1.1", 2, "--severity: '1.1'"},
    {"generate --out s.h5 --housing loose", 2, "'loose' is not one of slack, tight"},
    {"generate --out s.h5 --window 0.3", 2, "--window 0.3: is 1.5 samples"},
    {"generate --out s.h5 --window 7200", 2, "shorter than one window"},
    {"generate --out s.h5 --runs 100000 --hours 1000 --window 0.2", 2, "more than a file may hold"},
    {"generate --out s.h5 --plot s.jpg", 2, "--plot: 's.jpg'"},
    {"feed --hours 0", 2, "--hours: '0'"},
    {"feed --json", 2, "--json: the feed itself goes to standard output"},
    {"feed --out nowhere/f.csv", 3, "nowhere/f.csv"},
    {"feed --gaps -1", 2, "--gaps: '-1'"},
    {"train", 2, "missing argument"},
    {"train data.h5", 2, "--out FILE is missing"},
    {"train data.h5 --out data.h5", 2, "--out: data.h5 is an input"},
    {"train missing.h5 --out m.h5", 3, "missing.h5"},
    {"train empty.h5 --out m.h5", 3, "empty.h5"},
    {"train foreign.h5 --out m.h5", 3, "foreign.h5"},
    {"train model.h5 --out m.h5", 3, "model.h5"},
    {"train data.h5 --out m.h5 --method forest", 2, "'forest' is not one of cnn, logistic"},
    {"train data.h5 --out m.h5 --features cov", 2, "--features: --method cnn has no such option"},
    {"train data.h5 --out m.h5 --method tree --lr 1", 2, "--lr: --method tree has no such option"},
    {"train data.h5 --out m.h5 --method logistic --gamma 1", 2, "--gamma: --method logistic"},
    {"train data.h5 --out m.h5 --method svm-rbf --c 1 --grid 1,2", 2, "--grid: chooses C"},
    {"train data.h5 --out m.h5 --method svm-rbf --grid 1,0", 2, "--grid: C must be above 0"},
    {"train data.h5 --out m.h5 --method tree --ccp-alpha 0.1", 2, "--ccp-alpha: belongs to --prune post"},
    {"train data.h5 --out m.h5 --method tree --prune pre --max-depth 3", 2, "--prune pre: chooses"},
    {"train data.h5 --out m.h5 --test-fraction 0.9 --validation 0.5", 2, "together below 1"},
    {"train data.h5 --out m.h5 --window 0.3", 2, "--window 0.3: is 1.5 samples"},
    {"train data.h5 --out m.h5 --window 3600", 2, "18000"},
    {"train data.h5 --out m.h5 --hop 0", 2, "--hop 0: is 0 samples"},
    {"train three.h5 --out m.h5 --window 2.5", 2, "the data do not tell their rate: give samples"},
    {"train three.h5 --out m.h5 --loss mse", 2, "--loss mse: is for two classes, the data have 3"},
    {"train three.h5 --out m.h5 --split run", 2, "run"},
    {"train three.h5 --out m.h5 --split group", 2, "group"},
    {"train single.h5 --out m.h5", 2, "all windows are of one class, '0'"},
    {"train single.h5 --out m.h5 --method tree", 2, "all windows are of one class, '0'"},
    {"train data.h5 --out m.h5 --test three.h5", 3, "three.h5"},
    {"train data.h5 --out m.h5 --test missing.h5", 3, "missing.h5"},
    {"train data.h5 --out fresh.h5 --test fresh.h5", 2, "--out: fresh.h5 is an input of --test"},
    {"train data.h5 --out m.h5 --test fresh.h5 --test-fraction 0.1", 2, "--test: does not go with"},
    {"train data.h5 --out m.h5 --kernel 200", 2, "block"},
    {"train data.h5 --out m.h5 --filters 1,2,3,4,5,6,7,8,9", 2,
     "--filters: a list of 9 numbers is too long: at most 8"},
    {"train data.h5 --out m.h5 --method logistic --components 1000", 2, "component"},
    {"train one-channel.h5 --out m.h5 --method baseline", 2, "channel"},
    {"train data.h5 --out m.h5 --picture roc", 2, "--picture: needs --plot FILE"},
    {"train data.h5 --out m.h5 --plot p.svg --picture tree", 2, "--picture tree: the model is no tree"},
    {"train data.h5 --out m.h5 --method tree --plot p.svg --picture loss", 2, "--picture loss: is drawn"},
    {"train data.h5 --out m.h5 --resume missing.h5", 3, "missing.h5"},
    {"train data.h5 --out m.h5 --resume model.h5", 3, "model.h5"},
    {"train data.h5 --out m.h5 --resume model.h5 --preset best", 2, "--preset: a resumed run"},
    {"evaluate model.h5", 2, "missing argument"},
    {"evaluate missing.h5 data.h5", 3, "missing.h5"},
    {"evaluate data.h5 data.h5", 3, "data.h5: holds"},
    {"evaluate foreign.h5 data.h5", 3, "foreign.h5"},
    {"evaluate model.h5 model.h5", 3, "model.h5"},
    {"evaluate model.h5 three.h5", 3, "three.h5"},
    {"evaluate model.h5 fresh.h5 --part test", 2, "--part test: model.h5 was not trained on fresh.h5"},
    {"evaluate logistic.h5 data.h5 --part validation", 2, "no windows in it"},
    {"evaluate model.h5 data.h5 --votes 3", 2, "--votes: two numbers"},
    {"evaluate model.h5 data.h5 --votes 6,5", 2, "--votes: two numbers"},
    {"evaluate three-model.h5 three.h5 --votes 3,5", 2, "--votes: three.h5 does not tell its recordings"},
    {"evaluate model.h5 data.h5 --scores model.h5", 2, "--scores: model.h5 is an input"},
    {"evaluate model.h5 data.h5 fresh.h5 --scores s.csv", 2, "for one data file at a time"},
    {"evaluate model.h5 data.h5 --picture roc", 2, "--picture: needs --plot FILE"},
    {"evaluate model.h5 data.h5 --plot p.svg --picture loss", 2, "'loss' is not one of default, pairs"},
    {"evaluate logistic.h5 data.h5 --plot p.svg --picture pruning", 2, "'pruning' is not one of"},
    {"evaluate model.h5 brief.h5", 3, "brief.h5: not one window of 150 samples fits"},
    {"train data.h5 --out m.h5 --test brief.h5", 3, "brief.h5: not one window of 150 samples fits"},
    {"train data.h5 --out m.h5 --method tree --test brief.h5", 3, "brief.h5: not one window of 150"},
    {"train data.h5 --out m.h5 --filters 30,30,30,30,30,30,30,30 --kernel 1 --pooling none --activation "
     "identity --lr 1e3 --schedule constant --epochs 3",
     4, "; the state before it is in m.h5.checkpoint"},
    {"generate --out s.h5 --picture housings", 2, "--picture: needs --plot FILE"},
    {"evaluate model.h5 data.h5 --plot p.svg --picture clouds", 2, "--picture clouds: a cnn has no features"},
    {"search ranges.yaml data.h5", 2, "--out FILE.csv is missing"},
    {"search missing.yaml data.h5 --out s.csv", 3, "missing.yaml"},
    {"search ranges.yaml missing.h5 --out s.csv", 3, "missing.h5"},
    {"search ranges.yaml data.h5 --out ranges.yaml", 2, "--out: ranges.yaml is an input"},
};

TEST("a refused command line tells its exit code and word, and writes nothing") {
    cli_expect_refused(lg, bad_input, LG_COUNT(bad_input), &result);
    assert_false(cli_exists("m.h5"));
    assert_false(cli_exists("s.h5"));
}

TEST("bad ranges of a search are refused with their line") {
    static const char *const rows[][2] = {
        {"fixed: {bogus: 1}\nranges:\n  plane: {integer: [0, 4]}\n", "line 1: 'bogus' is no option of train"},
        {"fixed:\n  test: m.h5\nranges:\n  plane: {integer: [0, 4]}\n", "line 2: 'test' is no option"},
        {"ranges:\n  activation: {choice: [tanh, tan]}\n", "line 2: activation: 'tan' is not one of"},
        {"ranges:\n  lr: {uniform: [0, 1]}\n", "line 2: lr: '0'"},
        {"ranges:\n  lr: {uniform: [0.1, 1]}\n  c: {uniform: [1, 2]}\n",
         "line 3: 'c' is no option of --method"},
        {"ranges:\n  max-depth: {integer: [1, 2]}\n", "line 2: 'max-depth' is no option of --method cnn"},
        {"fixed: {method: cnn}\nranges:\n  components: {choice: [1, 2]}\n", "line 3: 'components' is no"},
        {"fixed:\n  lr: 0.1\n  prune: pre\nranges:\n  plane: {integer: [0, 4]}\n", "line 3: 'prune' is no"},
        {"ranges:\n  method: {choice: [cnn, tree]}\n", "line 2: 'method' can only be cnn in a search"},
        {"fixed: {method: tree}\nranges:\n  plane: {integer: [0, 4]}\n", "line 1: 'method' can only be"}};
    cli_expect_bad_ranges(lg, rows, LG_COUNT(rows), &result);
}

/* ---- data ---- */

TEST("generated windows are those that are asked for, and the same for the same seed") {
    run("generate --runs 4 --hours 0.05 --noise 0 --severity 1 --window 20 --out same.h5 --threads 1 --json");
    assert_true(json_is_object(result.out));
    assert_close(json_number(result.out, "windows"), 36, 0, 0);
    assert_close(json_number(result.out, "length"), 100, 0, 0);
    assert_close(json_number(result.out, "broken"), 18, 0, 0);
    lg_series_data same = read_back("same.h5");
    const lg_series *s = &same.series;
    assert_int_equal(s->channels, 6);
    assert_close(s->rate, 5, 0, 0);
    assert_string_equal(s->class_name[1], "broken");
    assert_string_equal(s->channel_name[4], "moment_x");
    assert_close(same.severity, 1, 0, 0);
    assert_string_equal(same.housing, "slack");
    /* Broken with all its stiffness is intact: pairs share their waves, so the windows are the same. */
    const size_t size = (size_t)s->channels * s->length;
    assert_memory_equal(s->x, s->x + 9 * size, 9 * size * sizeof *s->x);
    /* Channels keep their order: accelerations in m/s^2, moments in N m. */
    float largest[2] = {0, 0};
    for (size_t t = 0; t < s->length; t++) {
        largest[0] = fmaxf(largest[0], fabsf(s->x[t]));
        largest[1] = fmaxf(largest[1], fabsf(s->x[4 * s->length + t]));
    }
    assert_true(largest[0] > 1e-4f && largest[0] < 10 && largest[1] > 1e3f);
    assert_int_equal(s->label[0], 0);
    assert_int_equal(s->label[9], 1);
    assert_int_equal(s->run[9], 1);
    assert_int_equal(s->group[0], s->group[9]);
    assert_int_not_equal(s->group[0], s->group[18]);
    assert_memory_not_equal(s->x, s->x + 18 * size, 9 * size * sizeof *s->x);
    run("generate --runs 4 --hours 0.05 --noise 0 --severity 1 --window 20 --out two.h5 --threads 2");
    lg_series_data two = read_back("two.h5");
    assert_string_equal(two.sha256, same.sha256);
    run("generate --runs 4 --hours 0.05 --noise 0 --severity 0.58 --window 20 --out cracked.h5");
    lg_series_data cracked = read_back("cracked.h5");
    assert_memory_equal(cracked.series.x, s->x, 9 * size * sizeof *s->x);
    assert_memory_not_equal(cracked.series.x + 9 * size, s->x + 9 * size, 9 * size * sizeof *s->x);
    lg_series_data_destroy(&same);
    lg_series_data_destroy(&two);
    lg_series_data_destroy(&cracked);
}

/* Lines of a text, and what stands in the last column of the line that begins with `time`. */
static size_t count_lines(const char *text) {
    size_t lines = 0;
    for (const char *s = text; *s != '\0'; s++) lines += *s == '\n';
    return lines;
}

TEST("a feed has the lines and the columns that are asked for") {
    static char whole[CLI_TEXT], again[CLI_TEXT];
    run("feed --hours 0.02 --out feed.csv --json");
    assert_close(json_number(result.out, "lines"), 360, 0, 0);
    (void)cli_read("feed.csv", whole, sizeof whole);
    static const char head[] = "time,acc_lower_x,acc_lower_y,acc_upper_x,acc_upper_y,moment_x,moment_y\n0.0,";
    assert_memory_equal(whole, head, sizeof head - 1);
    assert_int_equal(count_lines(whole), 361);
    assert_non_null(strstr(whole, "\n71.8,"));
    assert_null(strstr(whole, "nan"));
    /* The same through a pipe, with any number of threads. */
    run("feed --hours 0.02 --threads 1");
    assert_string_equal(result.out, whole);
    /* Until the crack nothing has changed; after it something has. */
    run("feed --hours 0.02 --crack-at 0.01");
    const char *crack = strstr(whole, "\n36.0,");
    assert_non_null(crack);
    assert_memory_equal(result.out, whole, (size_t)(crack - whole));
    assert_string_not_equal(result.out, whole);
    /* Lines that are there are those of the whole feed, but for a nan. */
    run("feed --hours 0.02 --gaps 20000 --gap-seconds 2 --nan 20000 --out torn.csv --json");
    const double lines = json_number(result.out, "lines"), holes = json_number(result.out, "nan");
    assert_true(lines < 360 && lines > 60 && holes > 5 && json_number(result.out, "gaps") > 1);
    (void)cli_read("torn.csv", again, sizeof again);
    assert_int_equal(count_lines(again), (size_t)lines + 1);
    size_t found = 0, with_nan = 0;
    for (char *save = NULL, *line = strtok_r(again, "\n", &save); line != NULL;
         line = strtok_r(NULL, "\n", &save)) {
        if (strstr(line, "nan") != NULL)
            with_nan++;
        else if (strstr(whole, line) != NULL)
            found++;
    }
    assert_int_equal(with_nan, (size_t)holes);
    assert_int_equal(found + with_nan, (size_t)lines + 1);
}

/* Nine digits give every float back: each number is, to half a unit of its ninth digit, a float. */
TEST("every number of a feed is, to half a unit of its ninth digit, a float") {
    static char text[CLI_TEXT];
    run("feed --hours 0.02 --noise 0 --out digits.csv");
    (void)cli_read("digits.csv", text, sizeof text);
    int numbers = 0;
    for (char *save = NULL, *word = strtok_r(strchr(text, '\n'), ",\n", &save); word != NULL;
         word = strtok_r(NULL, ",\n", &save), numbers++) {
        char *end;
        const double value = strtod(word, &end);
        assert_true(*end == '\0' && end != word);
        if (numbers % 7 == 0) {
            assert_close(value, numbers / 7 * 0.2, 1e-12, 1e-12);
            continue;
        }
        const char *exponent = strchr(word, 'e');
        assert_non_null(exponent);
        assert_int_equal(exponent - word, word[0] == '-' ? 11 : 10);
        assert_close(value, (double)(float)value, 0, 0.5000001 * pow(10, atoi(exponent + 1) - 8));
    }
    assert_int_equal(numbers, 7 * 360);
}

/* ---- every method ---- */

static void expect_equal_key(const char *a, const char *b, const char *key) {
    const double x = json_number(a, key), y = json_number(b, key);
    if (!(fabs(x - y) <= 1e-12)) fail_msg("%s: %.17g in training, %.17g in evaluation", key, x, y);
}

/* Trains, evaluates what was written on the same data, and compares what both say of the test part. */
static void train_and_evaluate(const char *data, const char *options) {
    static const char *const keys[] = {"accuracy", "precision", "recall", "f1"};
    static cli trained;
    char line[512];
    (void)snprintf(line, sizeof line, "train %s %s --out method.h5 --json", data, options);
    cli_expect(lg, line, 0, "", &trained);
    if (!json_is_object(trained.out)) fail_msg("%s: no JSON: %s", line, trained.out);
    assert_non_null(json_find(trained.out, "confusion"));
    assert_non_null(json_find(trained.out, "train_accuracy"));
    (void)snprintf(line, sizeof line, "evaluate method.h5 %s --json", data);
    run(line);
    assert_true(json_is_object(result.out));
    if (strstr(result.out, "\"part\": \"test\"") == NULL) fail_msg("%s %s: %s", data, options, result.out);
    expect_equal_key(trained.out, result.out, "accuracy");
    for (size_t i = 0; i < LG_COUNT(keys); i++) expect_equal_key(trained.out, result.out, keys[i]);
    assert_close(json_number(trained.out, "test_windows"), json_number(result.out, "windows"), 0, 0);
}

static const char *const methods[] = {
    "--method logistic",
    "--method logistic --features std --split group",
    "--method logistic --components 4 --directions x",
    "--method logistic --grid 0.1,10 --folds 3",
    "--method tree",
    "--method tree --criterion entropy --prune post --components 3",
    "--method tree --prune pre --features std --folds 2",
    "--method tree --max-depth 2 --min-samples-leaf 3",
    "--method svm-linear --components 3",
    "--method svm-rbf --c 10 --gamma 0.1",
    "--method svm-rbf --folds 3 --split run",
    "--method baseline --window 120 --hop 30 --split run",
    "--epochs 2 --centred yes",
    "--epochs 2 --preset thesis --split run --dtype f64",
    "--epochs 2 --filters 8,4 --kernel 3 --pooling max --plane 0 --loss cross-entropy",
};

TEST("every method trains, evaluates and predicts") {
    for (size_t i = 0; i < LG_COUNT(methods); i++) train_and_evaluate("data.h5", methods[i]);
    run("train data.h5 --method tree --out t.h5 --json");
    assert_true(json_number(result.out, "nodes") >= 3 && json_number(result.out, "depth") >= 1);
    assert_close(json_number(result.out, "false_alarms_per_day"),
                 json_number(result.out, "false_positive_rate") * 2880, 1e-12, 0);
    run("train data.h5 --method svm-rbf --out t.h5 --json");
    assert_true(json_number(result.out, "support_vectors") >= 2 && json_number(result.out, "gamma") > 0);
    assert_non_null(json_find(result.out, "grid"));
    assert_non_null(json_find(result.out, "cv_accuracy"));
    double chosen[3]; /* all windows train: only the folds differ */
    for (size_t i = 0; i < LG_COUNT(chosen); i++) {
        static const char *const split[] = {"random", "run", "group"};
        char line[128];
        (void)snprintf(line, sizeof line,
                       "train data.h5 --method svm-rbf --features std --test-fraction 0 --out t.h5 --json "
                       "--split %s",
                       split[i]);
        run(line);
        chosen[i] = json_number(result.out, "cv_accuracy");
    }
    assert_true(chosen[0] != chosen[1] && chosen[0] != chosen[2] && chosen[1] != chosen[2]);
}

/* Classes that a child could tell apart, and every shape. */
TEST("data of every shape are learned") {
    static const char *const how[] = {"--epochs 3",
                                      "--method logistic",
                                      "--method tree",
                                      "--method svm-linear --c 1",
                                      "--method svm-rbf --c 1",
                                      "--method logistic --features raw --components 2"};
    static const char *const names[] = {"three.h5", "one-channel.h5", "short.h5", "point.h5", "constant.h5"};
    for (size_t d = 0; d < LG_COUNT(names); d++)
        for (size_t i = 0; i < LG_COUNT(how); i++) {
            if (i == 5 && strcmp(names[d], "point.h5") == 0) continue;
            train_and_evaluate(names[d], how[i]);
        }
    run("train three.h5 --method logistic --features std --out t.h5 --json");
    assert_true(json_number(result.out, "accuracy") > 0.9);
    const char *rate = json_find(result.out, "false_alarms_per_day");
    assert_memory_equal(rate, "null", 4);
    cli_expect(lg, "train tiny.h5 --method logistic --out t.h5", 2,
               "a test part of 0.2 of 4 windows is empty", &result);
    run("train tiny.h5 --method logistic --test-fraction 0.5 --out t.h5 --json");
    run("train tiny.h5 --epochs 1 --test-fraction 0.5 --out t.h5 --json");
    run("train three.h5 --test-fraction 0 --method tree --out t.h5 --json");
    assert_memory_equal(json_find(result.out, "accuracy"), "null", 4);
    assert_memory_equal(json_find(result.out, "confusion"), "null", 4);
    assert_close(json_number(result.out, "train_windows"), 60, 0, 0);
    cli_expect(lg, "evaluate t.h5 three.h5", 0, "three.h5 (all)", &result);
    assert_non_null(strstr(result.err, "without a test part"));
}

TEST("a test set may be a file of its own") {
    run("train data.h5 --test fresh.h5 --method logistic --out given.h5 --json");
    lg_series_data data = read_back("data.h5"), fresh = read_back("fresh.h5");
    assert_close(json_number(result.out, "train_windows"), (double)data.series.count, 0, 0);
    assert_close(json_number(result.out, "test_windows"), (double)fresh.series.count, 0, 0);
    const double accuracy = json_number(result.out, "accuracy");
    run("evaluate given.h5 fresh.h5 --json");
    assert_close(json_number(result.out, "accuracy"), accuracy, 0, 0);
    cli_expect(lg, "train data.h5 --test data.h5 --method logistic --out given.h5", 0, "", &result);
    assert_non_null(strstr(result.err, "nothing is tested on unseen data"));
    lg_series_data_destroy(&data);
    lg_series_data_destroy(&fresh);
}

/* fresh.h5 as another program would write it: no names of classes, /y is low, low + 1, ... */
static void write_numbered(const char *name, uint32_t low, bool named) {
    lg_series_data data = read_back("fresh.h5");
    lg_error error = {LG_OK, ""};
    char path[1024];
    char(*channels)[LG_SERIES_NAME] = data.series.channel_name;
    if (!named) data.series.channel_name = NULL;
    cli_path(name, path, sizeof path);
    if (lg_series_write(NULL, path, &data, &error) != LG_OK) fail_msg("%s", error.message);
    data.series.channel_name = channels;
    for (size_t i = 0; i < data.series.count; i++) data.series.label[i] += low;
    hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT), set = H5Dopen2(file, "y", H5P_DEFAULT);
    assert_true(H5Dwrite(set, H5T_NATIVE_UINT32, H5S_ALL, H5S_ALL, H5P_DEFAULT, data.series.label) >= 0);
    assert_true(H5Adelete(file, "classes") >= 0 && H5Adelete(file, "format") >= 0);
    assert_true(H5Dclose(set) >= 0 && H5Fclose(file) >= 0);
    lg_series_data_destroy(&data);
}

TEST("a model remembers what stood for its classes, also in files without names") {
    static const char *const models[] = {"model.h5", "logistic.h5"};
    char line[128];
    write_numbered("from-0.h5", 0, true);
    write_numbered("from-1.h5", 1, true);
    for (size_t i = 0; i < LG_COUNT(models); i++) {
        (void)snprintf(line, sizeof line, "evaluate %s fresh.h5 --json", models[i]);
        run(line);
        const double accuracy = json_number(result.out, "accuracy");
        (void)snprintf(line, sizeof line, "evaluate %s from-0.h5 --json", models[i]);
        run(line);
        assert_close(json_number(result.out, "accuracy"), accuracy, 0, 0);
        (void)snprintf(line, sizeof line, "evaluate %s from-1.h5", models[i]);
        cli_expect(lg, line, 3, "label '2' is none of 0|1", &result);
    }
    run("train from-1.h5 --method logistic --out from-1.model.h5");
    cli_expect(lg, "evaluate from-1.model.h5 from-0.h5", 3, "class '0' is none of the classes 1|2", &result);
}

/* Pictures of a file without names have the names that were trained on; one feature is drawn alone. */
TEST("pictures of a file without names have those that were trained on") {
    static char text[CLI_TEXT];
    write_numbered("unnamed.h5", 0, false);
    run("train data.h5 --method tree --features std --out named.h5 --plot named.svg");
    (void)cli_read("named.gp", text, sizeof text);
    assert_non_null(strstr(text, "std acc_lower_x <="));
    run("evaluate named.h5 unnamed.h5 --plot pairs.svg --picture pairs");
    (void)cli_read("pairs.gp", text, sizeof text);
    assert_non_null(strstr(text, "\"std moment_y\""));
    run("train one-channel.h5 --method logistic --features std --out one-std.h5 --plot single.svg --picture "
        "pairs");
    assert_null(strstr(result.err, "gnuplot failed"));
    (void)cli_read("single.gp", text, sizeof text);
    assert_null(strstr(text, "multiplot"));
    assert_non_null(strstr(text, "filledcurves"));
}

static size_t blocks_of(const char *json) {
    size_t count = 0;
    for (const char *at = json; (at = strstr(at, "\"filters\"")) != NULL; at++) count++;
    return count;
}

TEST("without --filters there are as many blocks as fit, three at most") {
    static const struct {
        const char *options;
        size_t blocks;
    } cases[] = {{"", 2},
                 {"--padding 2", 3},
                 {"--kernel 3", 2},
                 {"--kernel 5", 1},
                 {"--pooling none", 3},
                 {"--stride 3", 1},
                 {"--pool-size 6", 1},
                 {"--kernel 3 --padding 1 --pooling none", 3}};
    char line[192];
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        (void)snprintf(line, sizeof line, "train data.h5 --window 2 --epochs 1 --out blocks.h5 --json %s",
                       cases[i].options);
        run(line);
        if (blocks_of(result.out) != cases[i].blocks)
            fail_msg("%s: %zu blocks\n%s", cases[i].options, blocks_of(result.out), result.out);
    }
}

TEST("a split by group keeps sea states whole") {
    static char text[CLI_TEXT];
    bool tested[32] = {false};
    run("train data.h5 --method logistic --split group --out parts.h5");
    for (int part = 0; part < 2; part++) {
        run(part == 0 ? "evaluate parts.h5 data.h5 --part test --scores part.csv"
                      : "evaluate parts.h5 data.h5 --part train --scores part.csv");
        (void)cli_read("part.csv", text, sizeof text);
        char *save = NULL, *line = strtok_r(text, "\n", &save);
        assert_string_equal(line, "window,run,group,truth,class,score intact,score broken");
        size_t rows = 0;
        for (line = strtok_r(NULL, "\n", &save); line != NULL; line = strtok_r(NULL, "\n", &save), rows++) {
            unsigned window, recording, group;
            assert_int_equal(sscanf(line, "%u,%u,%u,", &window, &recording, &group), 3);
            assert_true(group < 32);
            if (part == 0)
                tested[group] = true;
            else if (tested[group])
                fail_msg("group %u is trained on and tested", group);
        }
        assert_true(rows > 0);
    }
    run("train data.h5 --epochs 1 --validation 0.25 --out parts.h5 --json");
    const double train = json_number(result.out, "train_windows"),
                 held = json_number(result.out, "validation_windows");
    assert_true(held > 10 && train > held);
    run("evaluate parts.h5 data.h5 --part validation --json");
    assert_close(json_number(result.out, "windows"), held, 0, 0);
    run("evaluate parts.h5 data.h5 --part train --json");
    assert_close(json_number(result.out, "windows"), train, 0, 0);
    cli_expect(lg, "train data.h5 --method logistic --window 30 --hop 15 --out o.h5", 0, "", &result);
    assert_non_null(strstr(result.err, "windows overlap and are split at random"));
}

/* Six recordings of eight windows of 5 s at 4 Hz, the second half of each damaged: with 2 of 3 votes the
 * alarm comes with the second damaged window, 10 s after the damage began. */
TEST("votes give the alarm and its delay") {
    run("train votes.h5 --method logistic --features std --split run --out v.h5");
    run("evaluate v.h5 votes.h5 --part all --votes 2,3 --json");
    assert_close(json_number(result.out, "accuracy"), 1, 0, 0);
    const char *votes = json_find(result.out, "votes");
    assert_non_null(votes);
    assert_close(json_number(votes, "damaged_runs"), 6, 0, 0);
    assert_close(json_number(votes, "detected_runs"), 6, 0, 0);
    assert_close(json_number(votes, "median_time_to_detection"), 10, 1e-12, 0);
    assert_close(json_number(votes, "largest_time_to_detection"), 10, 1e-12, 0);
    assert_close(json_number(votes, "false_alarms"), 0, 0, 0);
    assert_close(json_number(votes, "intact_time"), 6 * 4 * 5, 1e-12, 0);
    run("evaluate v.h5 votes.h5 --part all --votes 4,4 --json");
    assert_close(json_number(json_find(result.out, "votes"), "median_time_to_detection"), 20, 1e-12, 0);
    run("evaluate v.h5 votes.h5 --part all --votes 5,5 --json");
    assert_close(json_number(json_find(result.out, "votes"), "detected_runs"), 0, 0, 0);
    cli_expect(lg, "evaluate logistic.h5 data.h5 fresh.h5 --votes 3,5", 0, "detected", &result);
    run("evaluate logistic.h5 data.h5 fresh.h5 --votes 3,5 --json");
    assert_true(json_is_object(result.out));
    assert_non_null(json_find(result.out, "files"));
}

/* ---- resume, interruption ---- */

static void expect_same_models(const char *a, const char *b, bool same) {
    lg_detector_file files[2];
    const char *const names[] = {a, b};
    char path[1024];
    for (int i = 0; i < 2; i++) {
        cli_path(names[i], path, sizeof path);
        assert_int_equal(lg_model_load_detector(NULL, path, NULL, &files[i], NULL), LG_OK);
    }
    assert_int_equal(files[0].parameters, files[1].parameters);
    const bool equal =
        memcmp(files[0].theta, files[1].theta, files[0].parameters * sizeof *files[0].theta) == 0;
    if (equal != same) fail_msg("%s and %s %s", a, b, equal ? "are the same" : "differ");
    for (int i = 0; i < 2; i++) lg_detector_file_destroy(&files[i]);
}

#define TRAIN "train data.h5 --batch 20 --plane 3 --split run "

TEST("a resumed training ends in the same model") {
    run(TRAIN "--epochs 6 --out one.h5 --threads 1");
    run(TRAIN "--epochs 6 --out two.h5 --threads 2");
    run(TRAIN "--epochs 6 --out other.h5 --seed 3");
    run(TRAIN "--epochs 6 --out half.h5 --stop-after 2 --checkpoint c.h5");
    run("train data.h5 --test fresh.h5 --epochs 4 --out tested.h5");
    run("train data.h5 --test fresh.h5 --epochs 4 --out half.h5 --stop-after 2 --checkpoint t.h5");
    run("train data.h5 --test fresh.h5 --epochs 4 --out tested-2.h5 --resume t.h5 --json");
    expect_same_models("tested.h5", "tested-2.h5", true);
    assert_close(json_number(result.out, "test_windows"), 48, 0, 0);
    cli_expect(lg, "train data.h5 --test fresh.h5 --out r.h5 --resume c.h5", 2, "test_fraction", &result);
    run("train data.h5 --resume c.h5 --out resumed.h5 --json");
    assert_close(json_number(result.out, "epochs"), 6, 0, 0);
    assert_non_null(strstr(result.out, "\"split\": \"run\""));
    assert_close(json_number(result.out, "plane"), 3, 0, 0);
    expect_same_models("one.h5", "two.h5", true);
    expect_same_models("one.h5", "resumed.h5", true);
    expect_same_models("one.h5", "other.h5", false);
    cli_expect(lg, "train data.h5 --resume c.h5 --out r.h5 --batch 10", 2, "batch", &result);
    cli_expect(lg, "train data.h5 --resume c.h5 --out r.h5 --plane 2", 2, "plane", &result);
    cli_expect(lg, "train data.h5 --resume c.h5 --out r.h5 --split group", 2, "split", &result);
    cli_expect(lg, "train data.h5 --resume c.h5 --out r.h5 --validation 0.3", 2, "validation", &result);
    cli_expect(lg, "train fresh.h5 --resume c.h5 --out r.h5", 2, "c.h5", &result);
    assert_false(cli_exists("r.h5"));
}

/* With a validation part the parameters of its best epoch are the model. With a large learning rate that is
 * not the last one. */
TEST("with a validation part the best epoch is the model") {
    static const char *const rates[] = {"0.03", "0.1", "0.3", "0.01"};
    char line[256];
    int best = 12;
    size_t i = 0;
    for (; best == 12 && i < LG_COUNT(rates); i++) {
        (void)snprintf(line, sizeof line,
                       "train data.h5 --preset thesis --lr %s --epochs 12 --out long.h5 --json", rates[i]);
        run(line);
        best = (int)json_number(result.out, "best_epoch");
    }
    assert_true(best >= 1 && best < 12);
    (void)snprintf(line, sizeof line, "train data.h5 --preset thesis --lr %s --epochs %d --out best.h5",
                   rates[i - 1], best);
    run(line);
    expect_same_models("long.h5", "best.h5", true);
    run("train data.h5 --preset thesis --epochs 2 --validation 0 --out last.h5 --json");
    assert_close(json_number(result.out, "validation_windows"), 0, 0, 0);
}

TEST("Ctrl-C saves the state of a training") {
    const struct timespec pause = {0, 200000000};
    cli_interrupt_training(lg, TRAIN, &result);
    run("train data.h5 --resume never.h5.checkpoint --stop-after 1 --out now.h5 --json");
    cli_child child = cli_start(lg, "generate --runs 108 --hours 2 --out never.h5", 0);
    (void)nanosleep(&pause, NULL);
    const time_t before = time(NULL);
    cli_interrupt(child, &result);
    assert_true(time(NULL) - before <= 3);
    child = cli_start(lg, "feed --hours 1000 --out never.csv", 0);
    (void)nanosleep(&pause, NULL);
    cli_interrupt(child, &result);
    assert_int_equal(cli_count_files("never.csv"), 0);
    assert_false(cli_exists("never.h5"));
}

/* ---- search ---- */

TEST("a search runs, and goes on where it was stopped") {
    run(SEARCH "--out once.csv --json");
    assert_close(json_number(result.out, "new"), 6, 0, 0);
    const char *best = json_find(result.out, "best");
    assert_non_null(best);
    const double objective = json_number(best, "objective");
    assert_true(objective > 0 && objective < 1);
    cli_expect_same_table(lg, &result);
    assert_non_null(strstr(result.out, "lg-anomaly train data.h5 --epochs 6"));
    cli_expect(lg, "search ranges.yaml fresh.h5 --trials 6 --warm-up 2 --out again.csv --resume", 2, "data",
               &result);
    cli_write("tree.yaml", "fixed: {loss: mse}\nranges:\n  lr: {log-uniform: [1e-4, 1e-1]}\n");
    cli_expect(lg, "search tree.yaml three.h5 --trials 1 --out tree.csv", 4, "is for two classes", &result);
}

TEST("the published searches run") {
    static const char *const names[] = {"anomaly", "anomaly-wide"};
    cli_expect_published(lg, names, LG_COUNT(names), &result);
}

/* ---- full disks ---- */

TEST("a full disk is told, and leaves no file") {
    cli_expect_limited(lg, "generate --runs 2 --hours 0.05 --out full.h5", 4096, 3, "full.h5", &result);
    cli_expect_limited(lg, "train data.h5 --epochs 1 --out full.h5", 2048, 3, "full.h5", &result);
    cli_expect_limited(lg, "train data.h5 --method tree --out full.h5", 2048, 3, "full.h5", &result);
    cli_expect_limited(lg, "feed --hours 0.02 --out full.csv", 2048, 3, "full.csv", &result);
    cli_expect_limited(lg, "evaluate model.h5 data.h5 --scores full.csv", 200, 3, "full.csv", &result);
    assert_false(cli_exists("full.h5"));
    assert_int_equal(cli_count_files("full.csv"), 0);
    assert_int_equal(cli_count_files("tmp"), 0);
}

/* ---- pictures: what is drawn by default, and each by name ---- */

TEST("pictures are drawn") {
    static const char *const lines[] = {
        "train data.h5 --epochs 2 --out p.h5 --plot p.svg",
        "train data.h5 --method tree --criterion entropy --out p.h5 --plot p.svg",
        "train data.h5 --method tree --out p.h5 --plot p.svg --picture pruning",
        "train data.h5 --method svm-linear --components 3 --out p.h5 --plot p.svg",
        "train data.h5 --method logistic --components 4 --out p.h5 --plot p.svg",
        "train data.h5 --method baseline --window 60 --split run --out p.h5 --plot p.svg",
        "evaluate model.h5 data.h5 --plot p.svg",
        "evaluate model.h5 data.h5 --plot p.svg --picture confusion",
        "evaluate three-model.h5 three.h5 --plot p.svg --picture roc",
        "evaluate logistic.h5 data.h5 --plot p.svg --picture pairs",
        "evaluate logistic.h5 data.h5 --plot p.svg --picture clouds",
        "generate --runs 2 --hours 0.05 --out q.h5 --plot p.svg",
        "generate --runs 2 --hours 0.05 --out q.h5 --plot p.svg --picture housings",
    };
    for (size_t i = 0; i < LG_COUNT(lines); i++) {
        run(lines[i]);
        assert_true(cli_exists("p.gp"));
        if (strstr(result.err, "gnuplot failed") != NULL) fail_msg("%s: %s", lines[i], result.err);
        if (!cli_exists("p.svg")) assert_non_null(strstr(result.err, "gnuplot"));
    }
}

TEST_GROUP(setup, cli_end)
