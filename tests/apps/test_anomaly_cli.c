/* Runs lg-anomaly (in LG_BIN_DIR): the scene's data, models of every method on these and on data of other
 * shapes, votes, scores, plots. Elsewhere: what it shares with other executables is in test_runs, what it
 * refuses in test_refused, and watching in test_watch_cli.
 * ctest-labels: apps/lg-anomaly src/anomaly */
#include "cli_support.h"

#include <hdf5.h>

#include "liegrad/anomaly.h"
#include "liegrad/core.h"
#include "liegrad/series.h"
#include "support/fixtures.h"

static const char lg[] = "lg-anomaly";

static void json(const char *arguments, const char *members) {
    cli_json(lg, arguments, members);
}

static double number(const char *arguments, const char *key) {
    json(arguments, "");
    return json_number(result.out, key);
}

/* ---- data that other programs made ---- */

typedef struct other {
    const char *name;
    size_t count;
    uint32_t channels, length, classes;
    double rate;
    uint32_t of_run; /* windows per recording; 0: unknown */
    bool half;       /* true: the second half of each recording has class 1; false: the classes alternate */
    bool constant;   /* the last channel does not vary */
} other;

static const other others[] = {
    {"three.h5", 60, 2, 40, 3, 0, 0, false, false},   {"one-channel.h5", 40, 1, 152, 2, 0, 0, false, false},
    {"short.h5", 40, 3, 2, 2, 0, 0, false, false},    {"point.h5", 40, 4, 1, 2, 0, 0, false, false},
    {"constant.h5", 40, 3, 30, 2, 0, 0, false, true}, {"votes.h5", 48, 2, 20, 2, 4, 8, true, false},
    {"tiny.h5", 4, 2, 20, 2, 0, 0, false, false},     {"many-plain.h5", 120, 6, 40, 6, 0, 0, false, false},
};

/* Writes a file of windows. A window of class c is normal noise of mean 2 c and standard deviation 1 + 3
 * c. */
static void write_other(const other *what) {
    lg_series_data data = {.noise = NAN, .severity = NAN};
    data.series = (lg_series){
        .count = what->count, .channels = what->channels, .length = what->length, .classes = what->classes};
    assert_ok(lg_series_allocate(NULL, &data.series, false, what->of_run > 0));
    data.series.rate = what->rate;
    lg_rng rng = test_rng(11, 0);
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
    assert_ok(lg_series_write(NULL, cli_at(what->name), &data, NULL));
    lg_series_data_destroy(&data);
}

OWNED(lg_series_data, lg_series_data_destroy)

static lg_series_data *read_back(const char *name) {
    lg_series_data data;
    assert_ok(lg_series_read(NULL, cli_at(name), NULL, NULL, &data, NULL));
    return own_lg_series_data(data);
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    for (size_t i = 0; i < LG_COUNT(others); i++) write_other(&others[i]);
    cli_run(lg, "generate --runs 16 --hours 0.1 --noise 1 --window 30 --out data.h5");
    cli_run(lg, "generate --runs 4 --hours 0.1 --noise 1 --window 30 --seed 9 --out fresh.h5");
    cli_run(lg, "train data.h5 --epochs 2 --out model.h5");
    cli_run(lg, "train data.h5 --method logistic --out logistic.h5");
    cli_run(lg, "train three.h5 --epochs 1 --out three-model.h5");
    return 0;
}

/* ---- data ---- */

TEST("generate makes the windows that are asked for, and the same windows for the same seed") {
#define SAME "generate --runs 4 --hours 0.05 --noise 0 --window 20 "
    json(SAME "--severity 1 --out same.h5 --threads 1", "windows 36, length 100, broken 18");
    const lg_series_data *same = read_back("same.h5");
    const lg_series *s = &same->series;
    assert_int_equal(s->channels, 6);
    assert_close(s->rate, 5, 0, 0);
    assert_string_equal(s->class_name[1], "broken");
    assert_string_equal(s->channel_name[4], "moment_x");
    assert_close(same->severity, 1, 0, 0);
    assert_string_equal(same->housing, "slack");
    /* Damage with severity 1 leaves all of the stiffness, so the windows are the same as the intact ones:
     * each pair shares its waves. */
    const size_t size = (size_t)s->channels * s->length, half = 9 * size * sizeof *s->x;
    assert_memory_equal(s->x, s->x + 9 * size, half);
    /* The channels keep their order: accelerations in m/s^2, then moments in N m. */
    float largest[2] = {0, 0};
    for (size_t t = 0; t < s->length; t++) {
        largest[0] = fmaxf(largest[0], fabsf(s->x[t]));
        largest[1] = fmaxf(largest[1], fabsf(s->x[4 * s->length + t]));
    }
    assert_true(largest[0] > 1e-4f && largest[0] < 10 && largest[1] > 1e3f);
    assert_true(s->label[0] == 0 && s->label[9] == 1 && s->run[9] == 1);
    assert_true(s->group[0] == s->group[9] && s->group[0] != s->group[18]);
    assert_memory_not_equal(s->x, s->x + 18 * size, half);
    cli_run(lg, SAME "--severity 1 --out two.h5 --threads 2");
    assert_string_equal(read_back("two.h5")->sha256, same->sha256);
    cli_run(lg, SAME "--severity 0.58 --out cracked.h5");
    const lg_series_data *cracked = read_back("cracked.h5");
    assert_memory_equal(cracked->series.x, s->x, half);
    assert_memory_not_equal(cracked->series.x + 9 * size, s->x + 9 * size, half);
}

/* The first sample of the first standard run. */
static void first_sample(bool completion, double relief, float out[LG_RISER_CHANNELS]) {
    lg_riser_parameters p;
    lg_riser_run run;
    uint32_t label, sea;
    lg_riser_standard_run(0, 1, 0.58, &p, &run, &label, &sea);
    if (completion) lg_riser_complete(&p);
    p.relief_stiffness = relief;
    run.noise = 0;
    assert_ok(lg_riser_simulate(NULL, &p, &run, 1, out, NULL));
}

TEST("operation and load relief change the well of generate and of feed") {
#define GENERATE     "generate --seed 1 --runs 1 --hours 0.05 --noise 0 --window 20 --out setup.h5"
#define SETUP(words) GENERATE words, "feed --hours 0.001 --out setup.csv" words
    static const struct {
        const char *generate, *feed, *printed;
        bool completion;
        double relief;
    } rows[] = {{SETUP(""), "operation \"drilling\", load_relief 0", false, 0},
                {SETUP(" --operation completion"), "operation \"completion\", load_relief 0", true, 0},
                {SETUP(" --load-relief 2e6"), "operation \"drilling\", load_relief 2000000", false, 2e6},
                {SETUP(" --operation completion --load-relief 2e6"),
                 "operation \"completion\", load_relief 2000000", true, 2e6}};
    char lines[LG_COUNT(rows)][4096];
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        float x[LG_RISER_CHANNELS];
        json(rows[i].generate, rows[i].printed);
        const lg_series *s = &read_back("setup.h5")->series;
        first_sample(rows[i].completion, rows[i].relief, x);
        for (uint32_t c = 0; c < s->channels; c++) assert_close(s->x[c * s->length], x[c], 0, 0);
        cli_run(lg, "%s", rows[i].feed);
        (void)cli_read("setup.csv", lines[i], sizeof lines[i]);
        for (size_t k = 0; k < i; k++) assert_string_not_equal(lines[i], lines[k]);
    }
}

static size_t count_lines(const char *text) {
    size_t lines = 0;
    for (const char *s = text; *s != '\0'; s++) lines += *s == '\n';
    return lines;
}

TEST("a feed has the lines and columns that are asked for") {
    static char whole[CLI_TEXT], again[CLI_TEXT];
    json("feed --hours 0.02 --out feed.csv", "lines 360");
    (void)cli_read("feed.csv", whole, sizeof whole);
    static const char head[] = "time,acc_lower_x,acc_lower_y,acc_upper_x,acc_upper_y,moment_x,moment_y\n0.0,";
    assert_memory_equal(whole, head, sizeof head - 1);
    assert_int_equal(count_lines(whole), 361);
    assert_says(whole, "\n71.8,");
    assert_null(strstr(whole, "nan"));
    /* Through a pipe and with any number of threads the text is the same. */
    cli_run(lg, "feed --hours 0.02 --threads 1");
    assert_string_equal(result.out, whole);
    /* Before the crack the lines are unchanged; after it they differ. */
    cli_run(lg, "feed --hours 0.02 --crack-at 0.01");
    const char *crack = strstr(whole, "\n36.0,");
    assert_non_null(crack);
    assert_memory_equal(result.out, whole, (size_t)(crack - whole));
    assert_string_not_equal(result.out, whole);
    /* The lines that are left equal those of the complete feed, except for values that are nan. */
    json("feed --hours 0.02 --gaps 20000,2 --nan 20000 --out torn.csv",
         "lines <360, lines >60, nan >5, gaps >1");
    const double lines = json_number(result.out, "lines"), holes = json_number(result.out, "nan");
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

TEST("every number of a feed is a float written with nine digits") {
    static char text[CLI_TEXT];
    cli_run(lg, "feed --hours 0.02 --noise 0 --out digits.csv");
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

/* Trains a model, evaluates the written model on the same data, and compares the results of both commands for
 * the test part. */
static void train_and_evaluate(const char *data, const char *options, const char *model) {
    static const char *const keys[][2] = {{"accuracy", "accuracy"},
                                          {"precision", "precision"},
                                          {"recall", "recall"},
                                          {"f1", "f1"},
                                          {"test_windows", "windows"}};
    static cli trained;
    cli_json(lg, test_text("train %s %s --out %s", data, options, model), "confusion *, train_accuracy *");
    trained = result;
    json(test_text("evaluate %s %s", model, data), "part \"test\"");
    for (size_t i = 0; i < LG_COUNT(keys); i++) {
        const double x = json_number(trained.out, keys[i][0]), y = json_number(result.out, keys[i][1]);
        if (!(fabs(x - y) <= 1e-12)) fail_msg("%s: %.17g in training, %.17g in evaluation", keys[i][0], x, y);
    }
}

static const char *const methods[] = {
    "--method logistic",
    "--method logistic --features std --split group",
    "--method logistic --components 4 --directions x",
    "--method logistic --grid 0.1,10 --folds 3",
    "--method logistic --features spectrum",
    "--method tree",
    "--method tree --features spectrum --prune pre --folds 2",
    "--method tree --criterion entropy --prune post --components 3",
    "--method tree --prune pre --features std --folds 2",
    "--method tree --max-depth 2",
    "--method svm-linear --components 3",
    "--method svm-rbf --c 10 --gamma 0.1",
    "--method svm-rbf --folds 3 --split run",
    "--method svm-linear --features levels --c 1",
    "--method tree --features levels --max-depth 5",
    "--method baseline --window 120 --hop 30 --split run",
    "--method novelty --split run",
    "--epochs 2 --centred yes",
    "--epochs 2 --preset thesis --split run --dtype f64",
    "--epochs 2 --filters 8,4 --kernel 3 --pooling max --plane 0 --loss cross-entropy",
};

/* The model of data.h5 by this method: trained once, and compared with its evaluation. */
static const char *model_by(size_t method) {
    const char *name = test_text("method-%zu.h5", method);
    if (!cli_exists(name)) train_and_evaluate("data.h5", methods[method], name);
    return name;
}

TEST("every method trains, evaluates and predicts") {
    for (size_t i = 0; i < LG_COUNT(methods); i++) (void)model_by(i);
    json("train data.h5 --method tree --out t.h5", "nodes >2, depth >0");
    assert_close(json_number(result.out, "false_alarms_per_day"),
                 json_number(result.out, "false_positive_rate") * 2880, 1e-12, 0);
    json("train data.h5 --method svm-rbf --out t.h5", "support_vectors >1, gamma >0, grid *, cv_accuracy *");
    double chosen[3]; /* No part is held out, so all windows train and only the folds differ. */
    for (size_t i = 0; i < LG_COUNT(chosen); i++) {
        static const char *const split[] = {"random", "run", "group"};
        char line[128];
        (void)snprintf(
            line, sizeof line,
            "train data.h5 --method svm-rbf --features std --test-fraction 0 --out t.h5 --split %s",
            split[i]);
        chosen[i] = number(line, "cv_accuracy");
    }
    assert_true(chosen[0] != chosen[1] && chosen[0] != chosen[2] && chosen[1] != chosen[2]);
}

/* Networks in single precision overflow for huge inputs; the other methods do not. */
TEST("scores that are not finite are refused; only networks give such scores") {
    static char scores[1 << 14];
    size_t refused = 0;
    lg_series_data *data = read_back("fresh.h5");
    const char *path = cli_at("large.h5");
    data->series.x[5] = 3e38F;
    assert_ok(lg_series_write(NULL, path, data, NULL));
    for (size_t i = 0; i < LG_COUNT(methods); i++) {
        cli_forget("large.csv");
        cli_run_limited(lg, test_text("evaluate %s large.h5 --scores large.csv", model_by(i)), 0);
        if (result.code == 4) {
            assert_says(result.err,
                        "scores of 48 windows are not finite, the first of window 0 (counted from 0)");
            refused++;
            continue;
        }
        if (result.code != 0) fail_msg("%s: %s", methods[i], result.err);
        (void)cli_read("large.csv", scores, sizeof scores);
        if (strstr(scores, "nan") != NULL || strstr(scores, "inf") != NULL)
            fail_msg("%s: %s", methods[i], scores);
    }
    assert_true(refused > 0);
}

/* The classes are easy to tell apart; the data have every shape. */
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
            train_and_evaluate(names[d], how[i], "method.h5");
        }
    json("train three.h5 --method logistic --features std --out t.h5",
         "accuracy >0.9, false_alarms_per_day null");
    cli_expect(lg, "train tiny.h5 --method logistic --out t.h5", 2,
               "the test part, 0.2 of 4 windows, is empty");
    json("train tiny.h5 --method logistic --test-fraction 0.5 --out t.h5", "");
    json("train tiny.h5 --epochs 1 --test-fraction 0.5 --out t.h5", "");
    json("train three.h5 --test-fraction 0 --method tree --out t.h5",
         "accuracy null, confusion null, train_windows 60");
    json("evaluate t.h5 three.h5", "part \"all\"");
    assert_says(result.err, "without a test part");
}

/* Writes fresh.h5 with its first two channels in the other order. */
static void write_turned(const char *name) {
    lg_series_data *data = read_back("fresh.h5");
    const lg_series *s = &data->series;
    char first[LG_SERIES_NAME];
    memcpy(first, s->channel_name[0], sizeof first);
    memcpy(s->channel_name[0], s->channel_name[1], sizeof first);
    memcpy(s->channel_name[1], first, sizeof first);
    for (size_t i = 0; i < s->count; i++)
        for (uint32_t k = 0; k < s->length; k++) {
            float *x = s->x + i * s->channels * s->length + k, old = x[0];
            x[0] = x[s->length];
            x[s->length] = old;
        }
    assert_ok(lg_series_write(NULL, cli_at(name), data, NULL));
}

TEST("a test set may be in a separate file, also when training is resumed") {
    const size_t windows[] = {read_back("data.h5")->series.count, read_back("fresh.h5")->series.count};
    json("train data.h5 --test fresh.h5 --method logistic --out given.h5", "");
    assert_close(json_number(result.out, "train_windows"), (double)windows[0], 0, 0);
    assert_close(json_number(result.out, "test_windows"), (double)windows[1], 0, 0);
    const double accuracy = json_number(result.out, "accuracy");
    assert_close(number("evaluate given.h5 fresh.h5", "accuracy"), accuracy, 0, 0);
    write_turned("turned.h5");
    assert_close(number("train data.h5 --test turned.h5 --method logistic --out given.h5", "accuracy"),
                 accuracy, 0, 0);
    cli_run(lg, "train data.h5 --test data.h5 --method logistic --out given.h5");
    assert_says(result.err, "there is no test on unseen data");
    cli_run(lg,
            "train data.h5 --test fresh.h5 --epochs 4 --out half.h5 --stop-after 2 --checkpoint state.h5");
    json("train data.h5 --test fresh.h5 --epochs 4 --out whole.h5 --resume state.h5",
         "epochs 4, test_windows 48");
    cli_run(lg, "train data.h5 --epochs 4 --out half.h5 --stop-after 2 --checkpoint c.h5");
    cli_expect(lg, "train data.h5 --test fresh.h5 --out r.h5 --resume c.h5", 2, "test_fraction");
}

/* Writes fresh.h5 as another program would: without names of classes (and of channels, unless `named`), and
 * with the class numbers low, low + 1, ... in /y. */
static void write_numbered(const char *name, uint32_t low, bool named) {
    lg_series_data *data = read_back("fresh.h5");
    char(*channels)[LG_SERIES_NAME] = data->series.channel_name;
    if (!named) data->series.channel_name = NULL;
    const char *path = cli_at(name);
    assert_ok(lg_series_write(NULL, path, data, NULL));
    data->series.channel_name = channels;
    for (size_t i = 0; i < data->series.count; i++) data->series.label[i] += low;
    hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT), set = H5Dopen2(file, "y", H5P_DEFAULT);
    assert_true(H5Dwrite(set, H5T_NATIVE_UINT32, H5S_ALL, H5S_ALL, H5P_DEFAULT, data->series.label) >= 0);
    assert_true(H5Adelete(file, "classes") >= 0 && H5Adelete(file, "format") >= 0 &&
                H5Adelete(file, "healthy") >= 0);
    assert_true(H5Dclose(set) >= 0 && H5Fclose(file) >= 0);
}

TEST("a model remembers the class labels of its training file, also when the file has no names") {
    static const char *const models[] = {"model.h5", "logistic.h5"};
    write_numbered("from-0.h5", 0, true);
    write_numbered("from-1.h5", 1, true);
    for (size_t i = 0; i < LG_COUNT(models); i++) {
        const double accuracy = number(test_text("evaluate %s fresh.h5", models[i]), "accuracy");
        assert_close(number(test_text("evaluate %s from-0.h5", models[i]), "accuracy"), accuracy, 0, 0);
        cli_expect(lg, test_text("evaluate %s from-1.h5", models[i]), 3, "label '2' is none of 0|1");
    }
    cli_run(lg, "train from-1.h5 --method logistic --out from-1.model.h5");
    cli_expect(lg, "evaluate from-1.model.h5 from-0.h5", 3, "class '0' is none of the classes 1|2");
}

TEST("a novelty model finds the healthy class of a file that has other names of classes, or none") {
    cli_run(lg, "train data.h5 --method novelty --out alone.h5");
    const double accuracy = number("evaluate alone.h5 fresh.h5", "accuracy");
    assert_true(accuracy > 0.5);
    write_numbered("from-0.h5", 0, true);
    assert_close(number("evaluate alone.h5 from-0.h5", "accuracy"), accuracy, 0, 0);
    assert_says(result.err, "no class is 'intact', the healthy class of the training: '0' is taken for it");
    write_numbered("from-7.h5", 7, true);
    json("evaluate alone.h5 from-7.h5", "");
    assert_says(result.err, "'none' is taken for it");
}

TEST("a class that the test part lacks is named, and its figures are not 0") {
    lg_series_data *data = read_back("fresh.h5");
    size_t left = 2;
    for (size_t i = 0; i < data->series.count; i++)
        if (data->series.label[i] == 1 && left-- == 0) left = 0, data->series.label[i] = 0;
    assert_ok(lg_series_write(NULL, cli_at("few.h5"), data, NULL));
    json("train few.h5 --method logistic --split random --out few-model.h5", "f1 null, recall null");
    assert_says(result.err, "the test part has no window of class 'broken'");
}

TEST("plots for a file without names use the names of the training data; a single feature can be drawn") {
    static char text[CLI_TEXT];
    write_numbered("unnamed.h5", 0, false);
    cli_run(lg, "train data.h5 --method tree --features std --out named.h5 --plot named.svg");
    (void)cli_read("named.dat", text, sizeof text);
    assert_says(text, "\n=std acc_lower_x\n= <= ");
    cli_run(lg, "evaluate named.h5 unnamed.h5 --plot pairs.svg --plot-kind pairs");
    (void)cli_read("pairs.dat", text, sizeof text);
    assert_says(text, "\n=std moment_y\n");
    cli_run(lg, "train one-channel.h5 --method logistic --features std --out one-std.h5 --plot single.svg "
                "--plot-kind "
                "pairs");
    assert_null(strstr(result.err, "gnuplot failed"));
    (void)cli_read("single.dat", text, sizeof text);
    assert_says(text, "\n=1\n=2\n=std 0\n=0\n=1\n");
    if (!cli_exists("single.svg")) return;
    (void)cli_read("single.svg", text, sizeof text);
    assert_says(text, "part of the windows");
}

TEST("without --filters the network has as many blocks as fit, but at most three") {
    static const struct {
        const char *options;
        int blocks;
    } cases[] = {{"", 2},           {"--kernel 3", 2},
                 {"--kernel 5", 1}, {"--pooling none", 3},
                 {"--stride 3", 1}, {"--kernel 3 --pooling none", 3}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        int blocks = 0;
        cli_run(lg, "train data.h5 --window 2 --epochs 1 --out blocks.h5 --json %s", cases[i].options);
        for (const char *at = result.out; (at = strstr(at, "\"filters\"")) != NULL; at++) blocks++;
        if (blocks != cases[i].blocks) fail_msg("%s: %d blocks", cases[i].options, blocks);
    }
}

TEST("a split by group keeps all windows of a sea state in one part") {
    static char text[CLI_TEXT];
    bool tested[32] = {false};
    cli_run(lg, "train data.h5 --method logistic --split group --out parts.h5");
    for (int part = 0; part < 2; part++) {
        cli_run(lg, "%s",
                part == 0 ? "evaluate parts.h5 data.h5 --part test --scores part.csv"
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
    json("train data.h5 --epochs 1 --validation 0.25 --out parts.h5", "validation_windows >10");
    const double train = json_number(result.out, "train_windows"),
                 held = json_number(result.out, "validation_windows");
    assert_true(train > held);
    assert_close(number("evaluate parts.h5 data.h5 --part validation", "windows"), held, 0, 0);
    assert_close(number("evaluate parts.h5 data.h5 --part train", "windows"), train, 0, 0);
    cli_run(lg, "train data.h5 --method logistic --window 30 --hop 15 --out o.h5");
    assert_says(result.err, "windows overlap and are split at random");
    static const char *const overlap = "warnings [\"windows overlap and are split at random";
    json("train data.h5 --method logistic --window 30 --hop 15 --out o.h5", overlap);
    json("train data.h5 --epochs 1 --window 30 --hop 15 --out o.h5", overlap);
    static const char *const alone = "single windows are split at random, but the data have /";
    cli_expect(lg, "train data.h5 --method logistic --out o.h5", 0, "");
    assert_says(result.err, alone);
    assert_says(result.err, "use --split group");
    cli_expect(lg, "train votes.h5 --method logistic --features std --out o.h5", 0, "");
    assert_says(result.err, "use --split run");
    cli_expect(lg, "train data.h5 --method logistic --split group --out o.h5", 0, "");
    assert_null(strstr(result.err, alone));
    cli_expect(lg, "train data.h5 --method logistic --test fresh.h5 --out o.h5", 0, "");
    assert_null(strstr(result.err, alone));
}

/* Six recordings of eight windows of 5 s at 4 Hz; the second half of each is damaged. With 2 of 3 votes the
 * alarm comes with the second damaged window, 10 s after the damage began. */
TEST("votes give the alarm and its delay") {
    cli_run(lg, "train votes.h5 --method logistic --features std --split run --out v.h5");
    json("evaluate v.h5 votes.h5 --part all --votes 2,3", "accuracy 1");
    json_expect(json_find(result.out, "votes"),
                "damaged_runs 6, detected_runs 6, median_time_to_detection 10, largest_time_to_detection 10, "
                "false_alarms 0, intact_time 120");
    json("evaluate v.h5 votes.h5 --part all --votes 4,4", "votes {");
    json_expect(json_find(result.out, "votes"), "median_time_to_detection 20");
    json("evaluate v.h5 votes.h5 --part all --votes 5,5", "votes {");
    json_expect(json_find(result.out, "votes"), "detected_runs 0");
    cli_expect(lg, "evaluate logistic.h5 data.h5 fresh.h5 --votes 3,5", 0, "detected");
    json("evaluate logistic.h5 data.h5 fresh.h5 --votes 3,5", "files *");
    json("evaluate v.h5 votes.h5 votes.h5 votes.h5 votes.h5 votes.h5 votes.h5 votes.h5 votes.h5", "files *");
}

/* ---- the healthy class ---- */

/* Writes the windows of `from` (classes 0 and 1) with these names of their classes, as texts or with swapped
 * numbers. `healthy` becomes the attribute of the file, if it is not "". */
static void write_named(const char *name, const char *from, const char *first, const char *second,
                        bool swapped, const char *healthy) {
    lg_series_data *data = read_back(from);
    lg_series *series = &data->series;
    (void)snprintf(series->class_name[swapped], LG_SERIES_NAME, "%s", first);
    (void)snprintf(series->class_name[!swapped], LG_SERIES_NAME, "%s", second);
    for (size_t i = 0; i < series->count && swapped; i++) series->label[i] = 1 - series->label[i];
    (void)snprintf(data->healthy, sizeof data->healthy, "%s", healthy);
    assert_ok(lg_series_write(NULL, cli_at(name), data, NULL));
}

/* Compares rate of false positives, precision and recall of the JSON with its confusion matrix. */
static void check_metrics(bool swapped) {
    double confusion[4];
    const char *at = json_find(result.out, "confusion");
    assert_int_equal(
        sscanf(at, "[[%lf, %lf], [%lf, %lf]]", &confusion[0], &confusion[1], &confusion[2], &confusion[3]),
        4);
    const double *sound = confusion + (swapped ? 2 : 0), *fault = confusion + (swapped ? 0 : 2);
    const double found = fault[!swapped], false_alarms = sound[!swapped];
    assert_close(json_number(result.out, "false_positive_rate"), false_alarms / (sound[0] + sound[1]), 1e-12,
                 1e-12);
    assert_close(json_number(result.out, "recall"), found / (fault[0] + fault[1]), 1e-12, 1e-12);
    if (found > 0)
        assert_close(json_number(result.out, "precision"), found / (found + false_alarms), 1e-12, 1e-12);
}

TEST("no method takes the first class for the healthy one") {
    write_named("sound-0.h5", "data.h5", "sound", "at fault", false, "sound");
    write_named("sound-1.h5", "data.h5", "sound", "at fault", true, "sound");
    for (size_t i = 0; i < LG_COUNT(methods); i++)
        for (int swapped = 0; swapped < 2; swapped++) {
            const bool alone = strstr(methods[i], "novelty") != NULL; /* its first class is the healthy one */
            json(test_text("train sound-%d.h5 %s --out sound.model.h5", swapped, methods[i]),
                 "healthy \"sound\"");
            assert_null(strstr(result.err, "healthy"));
            check_metrics(swapped && !alone);
            json(test_text("evaluate sound.model.h5 sound-%d.h5 --part all", swapped), "healthy \"sound\"");
            check_metrics(swapped && !alone);
            if (alone) json_expect(result.out, "auc >0.9, false_positive_rate <0.2");
        }
}

TEST("the healthy class is the one given, or that of the data, or one whose name says so, with a warning") {
    write_named("plain.h5", "data.h5", "left", "right", false, "");
    write_named("marked.h5", "data.h5", "left", "right", false, "right");
    write_named("word.h5", "data.h5", "Normal", "Ball_fault", true, "");
    static const struct {
        const char *data, *option, *healthy, *warning;
    } rows[] = {
        {"plain.h5", "", "null", "which of the classes left|right means that all is well: give --healthy"},
        {"plain.h5", "--healthy right", "\"right\"", ""},
        {"marked.h5", "", "\"right\"", ""},
        {"marked.h5", "--healthy left", "\"left\"", ""},
        {"word.h5", "", "\"Normal\"", "class 'Normal' is taken as healthy because of its name: --healthy"},
        {"word.h5", "--healthy Ball_fault", "\"Ball_fault\"", ""}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        json(test_text("train %s %s --method tree --split group --out h.h5", rows[i].data, rows[i].option),
             test_text("healthy %s, false_alarms_per_day %s", rows[i].healthy, i == 0 ? "null" : "*"));
        if (rows[i].warning[0] == '\0') assert_null(strstr(result.err, "warning"));
        assert_says(result.err, rows[i].warning);
        json(test_text("evaluate h.h5 %s", rows[i].data), test_text("healthy %s", rows[i].healthy));
        assert_null(strstr(result.err, "means that all is well"));
        cli_expect("lg-export", "h.h5 --out exported --name m", 0, "");
        char header[16384];
        (void)cli_read("exported/m.h", header, sizeof header);
        assert_says(header, i == 0 ? "It is unknown which class means" : "(healthy)");
        if (i > 0)
            assert_says(header, i == 1 || i == 2 || i == 4 ? "#define m_HEALTHY 1" : "#define m_HEALTHY 0");
        if (i == 0) assert_null(strstr(header, "m_HEALTHY"));
    }
    cli_expect(lg, "train plain.h5 --healthy up --method tree --out h.h5", 2,
               "'up' is none of the classes left|right");
    cli_expect(lg, "train plain.h5 --method novelty --out h.h5", 2,
               "--classifier novelty: it is unknown which");
    cli_run(lg, "train plain.h5 --healthy left --method novelty --out n.h5");
    cli_expect(lg, "evaluate n.h5 plain.h5 --healthy unlike", 2, "'unlike' is none of the classes left");
    cli_run(lg, "train plain.h5 --method tree --out h.h5");
    cli_expect(lg, "watch h.h5 --input /dev/null", 2, "h.h5: it is unknown which of the classes left|right");
    cli_expect(lg, "watch h.h5 --healthy left --input /dev/null", 0,
               "# healthy                         left");
    json("watch h.h5 --healthy right --input /dev/null", "healthy \"right\"");
    cli_expect(lg, "evaluate h.h5 plain.h5 --votes 2,3", 2, "--votes: it is unknown which");
    json("evaluate h.h5 plain.h5 --votes 2,3 --healthy left", "healthy \"left\", votes *");
    json("evaluate h.h5 marked.h5", "healthy \"right\"");
    json("evaluate h.h5 plain.h5 marked.h5", "files *");
    hid_t file = H5Fopen(cli_at("marked.h5"), H5F_ACC_RDWR, H5P_DEFAULT);
    assert_true(H5Arename(file, "classes", "names") >= 0 && H5Fclose(file) >= 0);
    cli_expect(lg, "train marked.h5 --method tree --out h.h5", 3,
               "marked.h5: attribute healthy: expected the name of one of the classes, 0|1");
}

TEST("votes, delays and groups do not depend on the order of the classes") {
    char members[2][2][CLI_TEXT / 8];
    write_named("votes-0.h5", "votes.h5", "sound", "hurt", false, "sound");
    write_named("votes-1.h5", "votes.h5", "sound", "hurt", true, "sound");
    write_named("sound-0.h5", "data.h5", "sound", "hurt", false, "sound");
    write_named("sound-1.h5", "data.h5", "sound", "hurt", true, "sound");
    for (int swapped = 0; swapped < 2; swapped++) {
        static const char *const names[] = {"votes", "groups"}, *const data[] = {"votes", "sound"};
        for (int k = 0; k < 2; k++) {
            cli_run(
                lg,
                "train %s-%d.h5 --method tree --max-depth 1 --features std --test-fraction 0 --out order.h5",
                data[k], swapped);
            json(test_text("evaluate order.h5 %s-%d.h5 --votes 2,3", data[k], swapped), "");
            const char *at = json_find(result.out, names[k]);
            (void)snprintf(members[swapped][k], sizeof members[0][0], "%.*s",
                           (int)strcspn(at, k == 0 ? "}" : "]"), at);
        }
    }
    for (int k = 0; k < 2; k++) assert_string_equal(members[0][k], members[1][k]);
    assert_says(members[0][0], "\"detected_runs\": 6");
    assert_null(strstr(members[0][1], "null"));
}

/* With a large learning rate the best epoch is not the last one. */
TEST("a network that is no better than the most frequent class ends with exit code 4") {
    cli_expect(lg, "train data.h5 --lr 1000 --epochs 10 --out wild.h5 --json", 4, "the most frequent class");
    json_expect(result.out, "epochs 10, warnings [\"single windows are split at random");
    assert_says(json_find(result.out, "warnings"), "\"the model has learned nothing");
    cli_expect(lg, "train data.h5 --lr 1e-9 --epochs 3 --out wild.h5", 0, "");
    assert_says(result.err, "the model has learned nothing");
    cli_expect(lg, "train data.h5 --lr 1e-9 --epochs 20 --out wild.h5", 4, ""); /* long enough to be judged */
    assert_says(result.err, "the model has learned nothing");
}

TEST("a network whose units died starts again, and a warning is printed if it stays dead") {
    static const char *const line = "train data.h5 --activation relu --lr 1000 --clip 0 --epochs 3 --json "
                                    "--out dead.h5";
    json("train data.h5 --activation swish --epochs 2 --out living.h5",
         "restarts 0, dead_units 0, max_restarts 10, warnings [");
    cli_expect(lg, test_text("%s --max-restarts 2", line), 4, "the network has died");
    json_expect(result.out, "restarts 2, max_restarts 2, epochs 3");
    assert_true(json_number(result.out, "dead_units") >= 2);
    cli_expect(lg, test_text("%s --max-restarts 0", line), 4, "dead units of layer plane: 2 of 2");
    json_expect(result.out, "restarts 0");
}

TEST("with a validation part, the model is taken from the best epoch") {
    static const char *const rates[] = {"0.03", "0.05", "0.02", "0.04"};
    char line[256];
    int best = 12;
    size_t i = 0;
    for (; best == 12 && i < LG_COUNT(rates); i++) {
        (void)snprintf(line, sizeof line, "train data.h5 --preset thesis --lr %s --epochs 12 --out long.h5",
                       rates[i]);
        best = (int)number(line, "best_epoch");
    }
    assert_true(best >= 1 && best < 12);
    (void)snprintf(line, sizeof line, "train data.h5 --preset thesis --lr %s --epochs %d --out best.h5",
                   rates[i - 1], best);
    cli_run(lg, "%s", line);
    lg_detector_file files[2];
    for (int k = 0; k < 2; k++) {
        assert_ok(lg_recipe_load(NULL, cli_at(k == 0 ? "long.h5" : "best.h5"), NULL, &lg_recipe_detector,
                                 &files[k], NULL));
    }
    assert_int_equal(files[0].parameters, files[1].parameters);
    assert_memory_equal(files[0].theta, files[1].theta, files[0].parameters * sizeof *files[0].theta);
    for (int k = 0; k < 2; k++) lg_recipe_release(&lg_recipe_detector, &files[k]);
    json("train data.h5 --preset thesis --epochs 2 --validation 0 --out last.h5", "validation_windows 0");
    (void)snprintf(line, sizeof line,
                   "train data.h5 --preset thesis --lr %s --epochs 40 --patience 1 --out p.h5", rates[i - 1]);
    assert_true(number(line, "epochs") <= best + 1);
    json("train data.h5 --optimizer lbfgs --epochs 2 --out p.h5", "dtype \"f64\"");
}

TEST("Ctrl-C stops generate and feed, and no file is left") {
    static const char *const lines[] = {"generate --runs 108 --hours 2 --out never.h5",
                                        "feed --hours 1000 --out never.csv"};
    for (size_t i = 0; i < LG_COUNT(lines); i++) {
        const cli_child child = cli_start(lg, lines[i], 0);
        (void)nanosleep(&(struct timespec){0, 200000000}, NULL);
        cli_interrupt(child);
        assert_int_equal(cli_count_files("never"), 0);
    }
}

TEST("a search fails when its trials cannot use the data") {
    cli_write("tree.yaml", "fixed: {loss: mse}\nranges:\n  lr: {log-uniform: [1e-4, 1e-1]}\n");
    cli_expect(lg, "search tree.yaml three.h5 --trials 1 --out tree.csv", 4, "is for two classes");
}

TEST("a search varies the features of rocket, and judges by the held-out part alone") {
    cli_write("rocket.yaml",
              "fixed: {method: rocket, features: 840}\nranges:\n  prune: {choice: [100, 840]}\n");
    cli_json(lg, "search rocket.yaml data.h5 --trials 6 --out rocket.csv", "done 6, failed 0, best *");
    const char *best = json_find(result.out, "best");
    const double wrong = json_number(best, "objective"), number = json_number(best, "parameters");
    const bool pruned = strstr(result.out, "\"prune\": \"100\"") != NULL;
    assert_true(pruned ? number == 100 : number > 500 && number <= 840);
    assert_true(wrong >= 0.0 && wrong < 0.3); /* the larger class has about half of the windows */
    cli_write("single.yaml", "fixed: {method: rocket, features: 840, directions: x}\nranges:\n"
                             "  prune: {choice: [84, 85]}\n");
    cli_json(lg, "search single.yaml data.h5 --trials 1 --validation 0.3 --out single.csv", "done 1");
    assert_close(json_number(json_find(result.out, "best"), "parameters"), 84.5, 0, 0.5);
}

TEST("train accepts the command that a search over methods calls the best") {
    cli_write("both.yaml", "fixed: {features: 100, epochs: 1}\nranges:\n  method: {choice: [cnn, rocket]}\n"
                           "  plane: {choice: [1, 2]}\n");
    for (int seed = 1, seen[2] = {0}; seen[0] == 0 || seen[1] == 0; seed++) {
        assert_true(seed < 20);
        cli_expect(lg, test_text("search both.yaml data.h5 --trials 1 --out both.csv --seed %d", seed), 0,
                   "");
        char *best = strstr(result.out, "lg-anomaly train"), *end = strstr(result.out, " --out FILE");
        assert_true(best != NULL && end != NULL);
        *end = '\0';
        const bool rocket = strstr(best, "--method rocket") != NULL;
        assert_true((strstr(best, "--features") != NULL) == rocket &&
                    (strstr(best, "--plane") == NULL) == rocket);
        if (seen[rocket]++ == 0)
            cli_expect(lg, test_text("%s --out both.h5", best + strlen("lg-anomaly ")), 0, "");
    }
}

/* ---- plots: the default one, and each one by name ---- */

TEST("plots are drawn") {
    static const char *const lines[] = {
        "train data.h5 --epochs 2 --out p.h5 --plot p.svg",
        "train data.h5 --method tree --criterion entropy --out p.h5 --plot p.svg",
        "train data.h5 --method tree --out p.h5 --plot p.svg --plot-kind pruning",
        "train data.h5 --method svm-linear --components 3 --out p.h5 --plot p.svg",
        "train data.h5 --method logistic --components 4 --out p.h5 --plot p.svg",
        "train data.h5 --method baseline --window 60 --split run --out p.h5 --plot p.svg",
        "evaluate model.h5 data.h5 --plot p.svg",
        "evaluate model.h5 data.h5 --plot p.svg --plot-kind confusion",
        "evaluate three-model.h5 three.h5 --plot p.svg --plot-kind roc",
        "evaluate logistic.h5 data.h5 --plot p.svg --plot-kind pairs",
        "evaluate logistic.h5 data.h5 --plot p.svg --plot-kind clouds",
        "generate --runs 2 --hours 0.05 --out q.h5 --plot p.svg",
        "generate --runs 2 --hours 0.05 --out q.h5 --plot p.svg --plot-kind housings",
    };
    for (size_t i = 0; i < LG_COUNT(lines); i++) {
        cli_run(lg, "%s", lines[i]);
        assert_true(cli_exists("p.gp"));
        if (strstr(result.err, "gnuplot failed") != NULL) fail_msg("%s: %s", lines[i], result.err);
        if (!cli_exists("p.svg")) assert_says(result.err, "gnuplot");
    }
}

TEST("the line in the plot of a plane separates the windows as the network does") {
    static char text[CLI_TEXT];
    cli_run(lg, "train data.h5 --epochs 1 --plane 2 --out plane.h5");
    cli_run(lg, "evaluate plane.h5 data.h5 --part all --plot-kind plane --plot plane.svg --json");
    const double accuracy = json_number(result.out, "accuracy");
    (void)cli_read("plane.dat", text, sizeof text);
    double b, w[2], class, earlier, x[2];
    const char *at = strstr(text, "\n=plane\n=");
    assert_true(at != NULL && sscanf(at, "\n=plane\n=%lf\n=%lf\n=%lf\n", &b, &w[0], &w[1]) == 3);
    at = strstr(at, "\n\n\n") + 3;
    size_t right = 0, count = 0;
    for (int read; sscanf(at, "%lf %lf %lf %lf%n", &class, &earlier, &x[0], &x[1], &read) == 4; at += read) {
        right += (w[0] * x[0] + w[1] * x[1] + b > 0) == (class == 2);
        count++;
    }
    assert_true(count > 0 && b != 0);
    assert_close((double)right / (double)count, accuracy, 1e-9, 0);
}

/* The first line is that of the first window. The ratio of its ends does not depend on the channel's
 * scale. */
TEST("lines in the plot of regressions range over the accelerations of the segments") {
    enum { N = 300, PARTS = 10, PART = N / PARTS };
    static char text[CLI_TEXT];
    lg_series *series = &read_back("data.h5")->series;
    lg_windows windows;
    double least = INFINITY, most = 0, class = 0, intercept = 0, slope = 0, from = 0, to = 0;
    assert_ok(lg_windows_create(NULL, series, N, 0, &windows, NULL));
    float *x = TEST_ARRAY(float, (size_t)series->channels *N);
    lg_windows_copy(series, &windows, 0, x);
    for (int p = 0; p < PARTS; p++) {
        double sum = 0, squares = 0;
        for (int t = p * PART; t < (p + 1) * PART; t++) {
            sum += (double)x[t];
            squares += (double)x[t] * (double)x[t];
        }
        const double deviation = sqrt(squares / PART - sum / PART * sum / PART);
        least = fmin(least, deviation);
        most = fmax(most, deviation);
    }
    cli_run(lg, "train data.h5 --method baseline --window 60 --test-fraction 0 --out p.h5 --plot line.svg");
    (void)cli_read("line.dat", text, sizeof text);
    const char *at = strstr(text, "\n\n\n");
    assert_true(at != NULL && sscanf(at, "%lf %lf %lf %lf %lf", &class, &intercept, &slope, &from, &to) == 5);
    assert_close(to / from, most / least, 1e-6, 0);
    lg_windows_destroy(&windows);
}

/* Writes a file with other names of its classes, and of its channels if `channels`. */
static void write_strange(const char *name, const char *from, bool channels) {
    static char of_channel[CLI_NAMES][LG_SERIES_NAME];
    lg_series_data *data = read_back(from);
    char(*usual)[LG_SERIES_NAME] = data->series.channel_name;
    for (uint32_t c = 0; c < data->series.classes; c++)
        (void)snprintf(data->series.class_name[c], LG_SERIES_NAME, "%s", cli_strange_name(c));
    for (uint32_t c = 0; c < data->series.channels; c++)
        (void)snprintf(of_channel[c], LG_SERIES_NAME, "%s", cli_strange_name(c));
    memcpy(data->healthy, data->series.class_name[0], sizeof data->healthy);
    if (channels) data->series.channel_name = of_channel;
    assert_ok(lg_series_write(NULL, cli_at(name), data, NULL));
    data->series.channel_name = usual;
}

TEST("plots show names of classes and channels as they are, and no name is a command") {
    static const struct {
        const char *line;
        size_t classes, channels;
    } cases[] = {
        {"train many.h5 --method tree --features std --out n.h5 --plot n.svg", 6, 0},
        {"evaluate n.h5 many.h5 --plot-kind confusion --plot n.svg", 6, 0},
        {"evaluate n.h5 many.h5 --plot-kind roc --plot n.svg", 6, 0},
        {"evaluate n.h5 many.h5 --plot-kind pairs --plot n.svg", 6, 6},
        {"evaluate n.h5 many.h5 --plot-kind clouds --plot n.svg", 6, 0},
        {"train two.h5 --method svm-linear --components 3 --out n.h5 --plot n.svg", 2, 0},
        {"train two.h5 --method baseline --window 60 --split run --out n.h5 --plot n.svg", 2, 0},
        {"train two.h5 --epochs 1 --plane 2 --out n.h5", 0, 0},
        {"evaluate n.h5 two.h5 --plot n.svg", 2, 0},
    };
    write_strange("many.h5", "many-plain.h5", true);
    write_strange("two.h5", "data.h5", false);
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        cli_run(lg, "%s", cases[i].line);
        cli_shows_names("n.svg", "", 0, cases[i].classes);
        cli_shows_names("n.svg", "std ", 0, cases[i].channels);
    }
}

TEST_GROUP(setup, cli_end)
