/* lg-fit: what it learns, what it predicts, and how it reports unusual tables.
 * ctest-labels: apps/lg-fit src/table */
#include "cli_files.h"
#include "files/csv.h"
#include "files/h5.h"
#include "liegrad/program.h"
#include "liegrad/table.h"
#include "support/texts.h"

#include <hdf5.h>

OWNED_FILE(table)
OWNED(lg_table_data, lg_table_data_destroy)

static const char fit[] = "lg-fit";
static const double turned = 6.283185307179586;

/* ---- tables ---- */

enum { TEXT = 1 << 18 };
typedef struct sheet {
    char text[TEXT];
    size_t used;
} sheet;

static void put(sheet *s, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    s->used += (size_t)vsnprintf(s->text + s->used, TEXT - s->used, format, arguments);
    va_end(arguments);
    assert_true(s->used < TEXT);
}

static double noise(size_t i) { /* pseudo-random numbers from -1 to 1 */
    const double x = sin(12.9898 * (double)(i + 1)) * 43758.5453;
    return sqrt(12) * (x - floor(x) - 0.5);
}

/* y = sin 2a + b c + error, in columns of very different sizes. y does not depend on d. */
static void write_smooth(const char *name, size_t first, size_t rows, double error) {
    sheet *s = TEST_ARRAY(sheet, 1);
    put(s, "a,b,c,d,y,z\n");
    for (size_t i = first; i < first + rows; i++) {
        const double a = noise(5 * i), b = noise(5 * i + 1), c = noise(5 * i + 2);
        put(s, "%.12g,%.12g,%.12g,%.12g,%.12g,%.12g\n", a, 1e6 * b + 3e6, 1e-7 * c, noise(5 * i + 3),
            10 * (sin(2 * a) + b * c + error * noise(5 * i + 4)), a - b);
    }
    cli_write(name, s->text);
}

/* Three classes, determined by the angle of a point in a plane. */
static void write_classes(const char *name, size_t first, size_t rows) {
    static const char *const classes[] = {"\"north, far\"", "east", "7"};
    sheet *s = TEST_ARRAY(sheet, 1);
    put(s, "u;v;where\n");
    for (size_t i = first; i < first + rows; i++) {
        const double u = noise(2 * i), v = noise(2 * i + 1), turn = 0.5 + atan2(v, u) / turned;
        put(s, "%.9g;%.9g;%s\n", u, v, classes[(int)fmin(3 * turn, 2)]);
    }
    cli_write(name, s->text);
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    return 0;
}

static void need_tables(void) {
    if (cli_exists("smooth.csv")) return;
    write_smooth("smooth.csv", 0, 250, 0.0);
    write_smooth("other.csv", 1000, 200, 0.0);
    write_smooth("noisy.csv", 0, 300, 0.5);
    write_smooth("clear.csv", 1000, 200, 0.0);
    write_classes("classes.csv", 0, 400);
    write_classes("more.csv", 900, 300);
}

/* The number that belongs to a column in a member of the result: "rmse", "y". */
static double inner(const char *json, const char *key, const char *column) {
    const char *object = json_find(json, key);
    assert_non_null(object);
    return json_number(object, column);
}

/* ---- regression ---- */

TEST("a smooth table is learned with columns given by name, and the error on another table is small") {
    need_tables();
    cli_json(fit, "train smooth.csv --inputs a,b,c,d --outputs y --test other.csv --out smooth.h5",
             "task \"regression\", part \"test\", rows 250, train_rows 250, inputs 4, outputs 1, method "
             "\"lm\", warnings []");
    assert_true(inner(result.out, "rmse", "y") < 0.3);
    assert_true(inner(result.out, "r2", "y") > 0.999);
    cli_json(fit, "evaluate smooth.h5 other.csv", "judged_rows 200, outside *");
    assert_true(inner(result.out, "rmse", "y") < 0.3);
}

/* A smooth table. In line `line` column a is multiplied by `a` and y by `y`, in the other lines both by
 * `unit`. */
static void write_marked(const char *name, size_t line, double a, double y, double unit) {
    sheet *s = TEST_ARRAY(sheet, 1);
    put(s, "a,b,y\n");
    for (size_t i = 2; i < 302; i++) {
        const double p = noise(5 * i), q = noise(5 * i + 1);
        put(s, "%.12g,%.12g,%.12g\n", p * (i == line ? a : unit), q,
            (sin(p) + 0.1 * q * q) * (i == line ? y : unit));
    }
    cli_write(name, s->text);
}

TEST("a cell far from all others is reported with line and value, and the stored range has it") {
    static const double sizes[] = {1e3, -1e6, 1e12, 1e150, 1e200, -1e307, 1.4e308},
                        stored[] = {1e3, 1e12, 1e6};
    write_marked("clean.csv", 0, 1, 1, 1);
    cli_json(fit, "train clean.csv --hidden 4 --out far.h5", "warnings []");
    for (size_t i = 0; i < LG_COUNT(sizes); i++) {
        write_marked("far.csv", 40, sizes[i], 1, 1);
        cli_json(fit, "train far.csv --test clean.csv --hidden 4 --out far.h5", "inputs 2");
        if (strstr(result.out,
                   "column a: 1 of 300 cells lies far from all others, the farthest in line 40") == NULL)
            fail_msg("%g: %s", sizes[i], result.out);
        if (!(inner(result.out, "rmse", "y") < 0.05)) fail_msg("%g: %s", sizes[i], result.out);
        assert_true(json_number(result.out, "outside") == 0);
    }
    for (size_t i = 0; i < 2; i++) {
        const char *line = test_text("column %s: 1 of 300 cells", i == 0 ? "a" : "y");
        write_marked("far.csv", 40, i == 0 ? 1e307 : 1, i == 0 ? 1 : 1e307, 1);
        cli_run_limited(fit, "train far.csv --hidden 4 --out far.h5 --json", 0);
        if (strstr(result.out, line) == NULL) fail_msg("%s%s", result.out, result.err);
    }
    /* The stored range is the range of all rows that are learned: none of them lies outside. */
    for (size_t i = 0; i < LG_COUNT(stored); i++) {
        write_marked("far.csv", 40, stored[i], 1, 1);
        cli_json(fit, test_text("train far.csv --test far.csv --hidden 4 --seed %zu --out far.h5", i + 1),
                 "train_rows 300, outside 0");
        assert_null(strstr(result.out, "outside of the training range"));
    }
    cli_write("query.csv", "a,b,y\n1e7,0,0\n-1e7,0,0\n100,0,0\n");
    cli_json(fit, "evaluate far.h5 query.csv", "outside 2");
}

/* y = u, or noise; in line `line` u is 50 and y is 3. */
static void write_wrong(const char *name, size_t line, size_t first, bool noisy) {
    sheet *s = TEST_ARRAY(sheet, 1);
    put(s, "u,v,y\n");
    for (size_t i = 2; i < 2002; i++) {
        const size_t at = first + 7 * i;
        const double u = (noise(at) + noise(at + 1) + noise(at + 2)) / 2, y = noisy ? noise(at + 4) : u;
        put(s, "%.12g,%.12g,%.12g\n", i == line ? 50 : u, noise(at + 3), i == line ? 3 : y);
    }
    cli_write(name, s->text);
}

TEST("a single row that the model does not follow is named, and the model has learned all the same") {
    int named = 0;
    for (size_t first = 2; first < 4; first++) {
        write_wrong("row.csv", 400 + 7 * first, 99999 * first, false);
        cli_json(fit, "train row.csv --out row.h5", "outside *");
        const bool follows = json_number(result.out, "train_scaled_rmse") < 0.9;
        const char *line = test_text("training rows, the worst in line %zu", 400 + 7 * first);
        assert_null(strstr(result.out, "learned nothing"));
        if (!follows && strstr(result.out, line) == NULL) fail_msg("%zu: %s", first, result.out);
        if (!follows) assert_true(json_number(result.out, "noise") < 0.1);
        named += !follows;
        write_wrong("row.csv", 400 + 7 * first, 99999 * first, true);
        cli_json(fit, "train row.csv --out row.h5", "outputs 1");
        assert_says(result.out, "learned nothing");
    }
    assert_true(named > 0);
}

TEST("a far cell of an output is reported when a table is judged, and the errors are right up to 1e308") {
    static const double sizes[] = {1e3, -1e6, 1e12, 1e150, 1e200, -1e307, 1e308};
    static const char *const lines[] = {"evaluate clean.h5 far.csv",
                                        "train clean.csv --test far.csv --hidden 4 --epochs 2 --out far.h5"};
    const double y = sin(noise(200)) + 0.1 * noise(201) * noise(201), rows = 300;
    write_marked("clean.csv", 0, 1, 1, 1);
    cli_expect(fit, "train clean.csv --hidden 4 --out clean.h5", 0, "");
    for (size_t i = 0; i < LG_COUNT(sizes) * LG_COUNT(lines); i++) {
        const double size = sizes[i / LG_COUNT(lines)];
        write_marked("far.csv", 40, 1, size, 1);
        cli_json(fit, lines[i % LG_COUNT(lines)], "scaled_rmse >1");
        if (strstr(result.out, "far.csv: column y: 1 of 300 cells lies far from all others, the farthest in "
                               "line 40") == NULL)
            fail_msg("%g: %s", size, result.out);
        assert_close(inner(result.out, "rmse", "y"), fabs(size * y) / sqrt(rows), 1e-9, 1);
        assert_close(inner(result.out, "r2", "y"), -1 / (rows - 1), 1e-9, 10 / fabs(size));
    }
}

TEST("errors that overflow are null in JSON and named in a message, and no table prints them") {
    static const char *const rows[][3] = {
        {"a,b,y\n0,0,-1.7e308\n0,1,1.7e308\n", "rmse {\"y\": 1.7", "column y: scaled_rmse is not finite"},
        {"a,b,y\n1e170,0,1\n1e170,0,1.001\n", "r2 {\"y\": null", "column y: r2 is not finite"},
        {"a,b,y\n1e308,0,1.7976e308\n1e308,0,-1.7976e308\n", "rmse {\"y\": null",
         "column y: rmse is not finite"},
    };
    write_marked("clean.csv", 0, 1, 1, 1);
    cli_expect(fit, "train clean.csv --out clean.h5", 0, "");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_write("over.csv", rows[i][0]);
        cli_expect(fit, "evaluate clean.h5 over.csv --json", 4, rows[i][2]);
        json_expect(result.out, rows[i][1]);
        cli_expect(fit, "evaluate clean.h5 over.csv", 4, rows[i][2]);
        if (strstr(result.out, "inf") != NULL || strstr(result.out, "nan") != NULL)
            fail_msg("%s", result.out);
    }
    cli_write("over.csv", "a,b,y\n0,1,1\n1,1,1\n");
    cli_expect(fit, "evaluate clean.h5 over.csv", 0,
               "r2, y                        unknown\n"); /* of a constant column */
    cli_json(fit, "evaluate clean.h5 over.csv", "warnings []");
}

TEST("numbers too small to be scaled are refused before the training, with their lines") {
    static const double units[] = {1e-310, 1e-320};
    need_tables();
    for (size_t i = 0; i < LG_COUNT(units); i++) {
        write_marked("tiny.csv", 0, 1, 1, units[i]);
        cli_expect(fit, "train tiny.csv --out tiny.h5", 3, "tiny.csv: column a: its values, from -");
        assert_non_null(strstr(result.err, " in line "));
        assert_false(cli_exists("tiny.h5"));
        assert_false(cli_exists("tiny.h5.checkpoint"));
        cli_expect(fit, "train tiny.csv --inputs b --outputs y --out tiny.h5", 3, "column y: its values");
    }
    static const double sound[] = {1e-300, 1e300};
    for (size_t i = 0; i < LG_COUNT(sound); i++) {
        write_marked("tiny.csv", 0, 1, 1, sound[i]);
        cli_json(fit, "train tiny.csv --out tiny.h5", "warnings []");
        assert_true(inner(result.out, "r2", "y") > 0.999);
    }
}

TEST("predictions that are not finite are counted, and the exit code is 4") {
    need_tables();
    cli_json(fit, "train smooth.csv --inputs a,b,c,d --outputs y --out finite.h5", "inputs 4");
    cli_write("huge.csv", "a,b,c,d,y\n0,3e6,0,0,1\n1e308,-1e308,1e308,1,1\n");
    cli_expect(fit, "predict finite.h5 huge.csv", 4, "predictions of 1 of 2 rows are not finite");
    assert_string_equal(strrchr(result.out, '.') + strcspn(strrchr(result.out, '.'), "\n"), "\n\"\"\n");
    cli_expect(fit, "predict finite.h5 huge.csv --out p.csv", 4, "predictions of 1 of 2 rows");
    cli_expect(fit, "evaluate finite.h5 huge.csv", 4, "predictions of 1 of 2 rows");
    cli_expect(fit, "train smooth.csv --inputs a,b,c,d --outputs y --test huge.csv --hidden 4 --out test.h5",
               4, "predictions of 1 of 2 rows");
    cli_expect(fit, "predict test.h5 smooth.csv", 0, "y\n");
}

TEST("the noise of a table is not learned, because the priors estimate its size") {
    need_tables();
    cli_json(fit, "train noisy.csv --inputs a,b,c,d --outputs y --test clear.csv --out noisy.h5",
             "effective_parameters <120, noise >0.2, noise <0.5");
    /* sqrt(25 d/300) is 1.4 if the data determine d = 23 parameters. */
    assert_true(inner(result.out, "rmse", "y") < 2.5);
    print_message("priors: rmse %.3f\n", inner(result.out, "rmse", "y"));
    cli_json(fit,
             "train noisy.csv --inputs a,b,c,d --outputs y --test clear.csv --out loose.h5 --weight-decay 0 "
             "--epochs 200",
             "evidence_evaluations 0");
    print_message("no priors: rmse %.3f\n", inner(result.out, "rmse", "y"));
    assert_true(inner(result.out, "rmse", "y") > 3.5);
}

TEST("a given width learns as well as the width that is chosen by default") {
    static const char *const widths[] = {"", "--hidden 24", "--hidden 10,10"};
    double error[LG_COUNT(widths)];
    need_tables();
    write_smooth("many.csv", 0, 800, 0.1);
    for (size_t i = 0; i < LG_COUNT(widths); i++) {
        char line[256];
        (void)snprintf(line, sizeof line,
                       "train many.csv --inputs a,b,c,d --outputs y --test clear.csv --out wide.h5 %s",
                       widths[i]);
        cli_json(fit, line, "noise >0.06, noise <0.11, warnings []");
        error[i] = inner(result.out, "rmse", "y");
        print_message("%s: rmse %.4f\n", widths[i], error[i]);
        assert_true(error[i] < 2 * error[0]);
    }
}

static const lg_table_file *model_of(const char *name) {
    lg_table_file file;
    assert_ok(lg_recipe_load(NULL, cli_at(name), NULL, &lg_recipe_table, &file, NULL));
    return own_lg_table_file(file);
}

TEST("a table that determines nearly all parameters of one layer gets two layers, and others do not") {
    sheet *s = TEST_ARRAY(sheet, 1);
    put(s, "a,b,c,y\n");
    for (size_t i = 0; i < 1200; i++) {
        const double a = 0.6 * noise(3 * i), b = 0.6 * noise(3 * i + 1), c = 0.6 * noise(3 * i + 2);
        put(s, "%.9g,%.9g,%.9g,%.9g\n", 1e9 * a, b, c,
            sin(4 * a + 3 * sin(4 * b)) + exp(-4 * pow(c - sin(3 * a), 2)));
    }
    cli_write("hard.csv", s->text);
    cli_json(fit, "train hard.csv --hidden 16 --out one.h5", "inputs 3");
    const double one = inner(result.out, "rmse", "y");
    cli_json(fit, "train hard.csv --out two.h5", "inputs 3");
    assert_says(result.out, "\"hidden\": [16, 16]");
    const double two = inner(result.out, "rmse", "y");
    print_message("one layer: %.3g, two layers: %.3g\n", one, two);
    assert_true(two < 0.5 * one);
    write_smooth("easy.csv", 0, 800, 0.1);
    cli_json(fit, "train easy.csv --inputs a,b,c,d --outputs y --out easy.h5", "effective_parameters <60");
    assert_int_equal(model_of("easy.h5")->run.model.options.hidden_count, 1);
}

/* Events 0 and 1 change x. Event 2, a share of the rows, moves the quiet sensor s, whose noise is `quiet`. */
static void write_events(const char *name, size_t first, double share, double quiet, double unit,
                         double place) {
    sheet *s = TEST_ARRAY(sheet, 1);
    put(s, "x,s,event\n");
    for (size_t i = first; i < first + 2000; i++) {
        const double normal = (noise(8 * i) + noise(8 * i + 1) + noise(8 * i + 2)) / sqrt(3),
                     other = (noise(8 * i + 3) + noise(8 * i + 4) + noise(8 * i + 5)) / sqrt(3);
        const bool moved = noise(8 * i + 6) < sqrt(12) * (share - 0.5);
        const int event = moved ? 2 : noise(8 * i + 7) > 0;
        put(s, "%.7g,%.7g,%d\n", normal + (event == 1 ? 2.5 : 0.0),
            unit * (moved ? place + 0.5 * other : 0.03 + quiet * other), event);
    }
    cli_write(name, s->text);
}

static int rising(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

TEST("a second mode of an input is no error: it is learned, in any unit, and the stored range has it") {
    static const double shares[] = {0.5, 0.3, 0.1, 0.03}, units[] = {1, 1e9, 1e-9, 1},
                        places[] = {0, 0, 3, 3};
    for (size_t k = 0; k < LG_COUNT(shares); k++) {
        double accuracy[3];
        for (size_t seed = 0; seed < LG_COUNT(accuracy); seed++) {
            write_events("events.csv", 20000 * seed, shares[k], 3e-4, units[k], places[k]);
            write_events("later.csv", 20000 * seed + 10000, shares[k], 0.02, units[k], places[k]);
            cli_json(
                fit,
                test_text("train events.csv --class event --test later.csv --seed %zu --out e.h5", seed + 1),
                "inputs 2");
            assert_null(strstr(result.out, "far from all"));
            accuracy[seed] = json_number(result.out, "accuracy");
            assert_true(json_number(result.out, "outside") < 100);
            assert_true(model_of("e.h5")->high[1] > 0.8 * units[k]);
        }
        qsort(accuracy, LG_COUNT(accuracy), sizeof *accuracy, rising);
        print_message("share %g: accuracy %.3f to %.3f\n", shares[k], accuracy[0], accuracy[2]);
        assert_true(accuracy[0] > 0.75 && accuracy[1] > 0.8);
    }
}

TEST("a large offset costs a column no digits, and one of rounded digits alone is reported") {
    static const double offsets[] = {1e8, -1e8, 1e17, 0}, sizes[] = {1e-5, 1e-6, 1e4, 1e-9};
    for (size_t k = 0; k < LG_COUNT(offsets); k++) {
        sheet *s = TEST_ARRAY(sheet, 1);
        put(s, "a,b,y\n");
        for (size_t i = 0; i < 300; i++) {
            const double a = noise(2 * i), b = noise(2 * i + 1);
            put(s, "%.17g,%.17g,%.17g\n", offsets[k] + sizes[k] * a, b,
                offsets[k] + sizes[k] * (a + 0.1 * b));
        }
        cli_write("offset.csv", s->text);
        cli_json(fit, "train offset.csv --hidden 4 --out o.h5", "warnings []");
        if (!(inner(result.out, "r2", "y") > 0.99)) fail_msg("%g: %s", offsets[k], result.out);
    }
    sheet *s = TEST_ARRAY(sheet, 1);
    put(s, "a,b,y\n");
    for (size_t i = 0; i < 300; i++)
        put(s, "%.17g,%.17g,%.17g\n", noise(2 * i) > 0 ? 0.3 : 0.1 + 0.2, noise(2 * i + 1), noise(2 * i + 1));
    cli_write("rounded.csv", s->text);
    cli_json(fit, "train rounded.csv --hidden 2 --out o.h5", "inputs 2");
    assert_says(result.out, "column a: its values, near 0.29999999999999999, differ only");
}

TEST("labels of 16 digits and more stay as they are written, from the table to the predictions") {
    static const char *const labels[] = {"1234567890123456", "1234567890123457", "123456789012345678901234"};
    sheet *s = TEST_ARRAY(sheet, 1);
    put(s, "a,b,c\n");
    for (size_t i = 0; i < 150; i++)
        put(s, "%.9g,%.9g,%s\n", (double)(i % 3) + 0.1 * noise(i), noise(i + 500), labels[i % 3]);
    cli_write("long16.csv", s->text);
    for (int k = 0; k < 2; k++) {
        cli_json(fit,
                 k == 0 ? "train long16.csv --class c --hidden 4 --epochs 60 --out l.h5"
                        : "evaluate l.h5 long16.csv",
                 "accuracy 1");
        assert_says(result.out, "[\"1234567890123456\", \"1234567890123457\", \"123456789012345678901234\"]");
    }
    cli_expect(fit, "predict l.h5 long16.csv", 0, "probability_1234567890123457");
}

TEST("two outputs, all networks and methods are trained") {
    static const char *const lines[] = {"--network resnet --hidden 7,7 --epochs 15",
                                        "--network mult --hidden 10 --epochs 30",
                                        "--network mult-affine --hidden 8,8 --activation swish --epochs 20",
                                        "--hidden 20 --activation sine --linear false",
                                        "--hidden 20 --method ssbroyden --epochs 200",
                                        "--hidden 20 --method adam:20,lbfgs --epochs 200",
                                        "--size 12,12 --method lbfgs --epochs 60"};
    need_tables();
    for (size_t i = 0; i < LG_COUNT(lines); i++) {
        char line[512];
        (void)snprintf(line, sizeof line,
                       "train smooth.csv --inputs a,b,c --outputs y,z --test other.csv --out n.h5 %s",
                       lines[i]);
        cli_json(fit, line, "outputs 2");
        if (!(inner(result.out, "r2", "y") > 0.97 && inner(result.out, "r2", "z") > 0.99))
            fail_msg("%s: %s", line, result.out);
    }
}

TEST("--size auto chooses a width") {
    need_tables();
    write_smooth("few.csv", 0, 100, 0.0); /* smooth.csv would take a minute under sanitizers */
    cli_json(fit, "train few.csv --inputs a,b,c --outputs y --test other.csv --out n.h5 --size auto",
             "sizes *");
    assert_true(inner(result.out, "r2", "y") > 0.99);
}

/* ---- equal bits ---- */

TEST("resumed training gives the bits of training that never stopped, with any number of threads") {
    static const char *const methods[] = {"", "--method lbfgs --epochs 40", "--method adam --epochs 6"};
    need_tables();
    for (size_t i = 0; i < LG_COUNT(methods); i++) {
        char line[512];
        static const char common[] = "train noisy.csv --inputs a,b,c,d --outputs y --validation 0.2";
        (void)snprintf(line, sizeof line, "%s %s --out whole.h5 --threads 1", common, methods[i]);
        cli_expect(fit, line, 0, "");
        (void)snprintf(line, sizeof line,
                       "%s %s --out part.h5 --stop-after 3 --checkpoint part.chk --threads 2", common,
                       methods[i]);
        cli_expect(fit, line, 0, "");
        (void)snprintf(line, sizeof line, "%s --out part.h5 --resume part.chk --threads 2", common);
        cli_expect(fit, line, 0, "");
        const lg_table_file *a = model_of("whole.h5"), *b = model_of("part.h5");
        assert_int_equal(a->parameters, b->parameters);
        assert_memory_equal(a->theta, b->theta, a->parameters * sizeof(double));
    }
    cli_expect(fit,
               "train smooth.csv --inputs a,b,c,d --outputs y --validation 0.2 --out x.h5 --resume part.chk",
               2, "was written from other data");
}

/* ---- classification ---- */

TEST("classes whose names are texts are learned, and predicted with probabilities") {
    static char text[1 << 16];
    need_tables();
    cli_json(fit, "train classes.csv --class where --test more.csv --out c.h5 --seed 3",
             "task \"classification\", accuracy >0.93, f1 >0.93, outputs 3");
    cli_json(fit, "evaluate c.h5 more.csv", "accuracy >0.93, judged_rows 300");
    cli_json(fit, "predict c.h5 more.csv --out where.csv", "rows 300, incomplete 0");
    (void)cli_read("where.csv", text, sizeof text);
    assert_non_null(strstr(text, "where,probability_7,probability_east,\"probability_north, far\"\n"));
    cli_expect(fit, "train classes.csv --class where --out c.h5 --method lm", 2, "lbfgs");
    cli_expect(fit, "train classes.csv --class where --out c.h5 --prior 0.1", 2,
               "--prior: this loss is no sum");
    /* Rows are true classes: one row of east is classified as east, the other as 7. */
    static const double told[9] = {0, 0, 0, 1, 1, 0, 0, 0, 0};
    double confusion[9];
    cli_write("east.csv", "u,v,where\n1,0,east\n-1,0.5,east\n");
    cli_json(fit, "evaluate c.h5 east.csv", "accuracy 0.5, classes *");
    assert_int_equal(json_array(result.out, "confusion", confusion, 9), 9);
    assert_memory_equal(confusion, told, sizeof told);
    cli_run(fit, "evaluate c.h5 east.csv");
    assert_says(result.out, "\ntrue class / given  7  east  north, far\n");
    assert_says(result.out, "\neast                1     1           0\n");
}

/* ---- predictions ---- */

enum { LABELS = 3 };

/* Draws names of a class column and of two inputs, and labels, all different. The columns are numbers but for
 * the labels. */
static void write_drawn(const char *name, lg_rng *rng, lg_table_text *column, lg_table_text *label) {
    lg_table_text all[3 + LABELS];
    for (uint32_t i = 0; i < LG_COUNT(all); i++) do
            draw_text(rng, all[i]);
        while (all[i][0] == '\0' || strchr(all[i], ' ') != NULL ||
               (i > 0 && strcmp(all[i], all[i - 1]) == 0) || (i > 1 && strcmp(all[i], all[i - 2]) == 0));
    lg_columns to = {.row = 0};
    for (uint32_t c = 0; c < 3; c++) lg_columns_name(&to, all[c]);
    lg_columns_end(&to);
    for (uint32_t i = 0; i < 60; i++) {
        lg_columns_whole(&to, i);
        lg_columns_text(&to, all[3 + i / 20]);
        lg_columns_number(&to, noise(i));
        lg_columns_end(&to);
    }
    FILE *file = fopen(cli_at(name), "wb");
    assert_non_null(file);
    assert_true(fputs(to.text.data, file) >= 0 && fclose(file) == 0);
    lg_text_destroy(&to.text);
    memcpy(column, all[1], sizeof *column);
    memcpy(label, all + 3, LABELS * sizeof *label);
}

/* The labels of a file must be among these. */
static void expect_drawn(const char *name, const char *column, lg_table_text *label) {
    lg_table_data data;
    assert_told(lg_table_read(NULL, cli_at(name), (const char *const[]){""}, 0, column, NULL, &data, &told));
    own_lg_table_data(data);
    assert_int_equal(data.rows, 60);
    for (size_t i = 0; i < data.rows; i++)
        if (strcmp(data.class_name[data.label[i]], label[i / 20]) != 0)
            fail_msg("row %zu: '%s' is not '%s'", i, data.class_name[data.label[i]], label[i / 20]);
}

TEST("names and labels of any bytes survive training, prediction, and training on the predictions") {
    lg_rng rng;
    lg_rng_seed(&rng, 3, 0);
    for (int k = 0; k < 4; k++) {
        lg_table_text column, label[LABELS];
        cli_forget("predicted.csv again.csv");
        write_drawn("drawn.csv", &rng, &column, label);
        expect_drawn("drawn.csv", column, label);
        cli_run(
            fit,
            "train drawn.csv --class %s --hidden 8 --validation 0 --method lbfgs --epochs 300 --out drawn.h5",
            lg_csv_quote(column).text);
        cli_json(fit, "evaluate drawn.h5 drawn.csv", "accuracy 1");
        cli_run(fit, "predict drawn.h5 drawn.csv --out predicted.csv");
        expect_drawn("predicted.csv", column, label);
        cli_run(fit, "train predicted.csv --class %s --hidden 4 --validation 0 --epochs 300 --out again.h5",
                lg_csv_quote(column).text);
        cli_run(fit, "predict again.h5 predicted.csv --out again.csv");
        expect_drawn("again.csv", column, label);
    }
}

TEST("a label belongs to the class of its text, or else to the only class of its number") {
    cli_write("ones.csv", "x,c\n1,1\n2,1\n3,1\n7,2\n8,2\n9,2\n");
    cli_run(fit, "train ones.csv --class c --hidden 2 --validation 0 --epochs 50 --out ones.h5");
    cli_write("labels.csv", "x,c\n1,1.0\n9,02\n");
    cli_json(fit, "evaluate ones.h5 labels.csv", "accuracy 1, judged_rows 2, classes [\"1\"");
    cli_write("labels.csv", "x,c\n1,1.5\n");
    cli_expect(fit, "evaluate ones.h5 labels.csv", 3, "does not know class '1.5'");
    cli_write("ones.csv", "x,c\n1,1\n2,1\n3,1.0\n7,1.0\n8,2\n9,2\n");
    cli_run(fit, "train ones.csv --class c --hidden 2 --validation 0 --epochs 50 --out ones.h5");
    assert_says(result.err, "the classes '1' and '1.0' are the same number, written in two ways");
    cli_write("labels.csv", "x,c\n1,01\n");
    cli_expect(fit, "evaluate ones.h5 labels.csv", 3, "does not know class '01'");
}

TEST("columns are found by name: swapped columns give the same numbers, a missing cell gives no number") {
    static char first[4096], second[4096];
    need_tables();
    cli_run(fit, "train smooth.csv --inputs a,b,c --outputs y --hidden 8 --out s.h5 --test other.csv");
    cli_write("some.csv", "a,b,c\n0.1,3e6,1e-8\n-0.5,2.5e6,-5e-8\n");
    cli_write("swapped.csv", "c;y;more;a;b\n1e-8;9;text;0.1;3e6\n;9;text;0.1;3e6\n-5e-8;9;text;-0.5;2.5e6\n");
    cli_write("lacks.csv", "a,b,c,y\n0.1,3e6,1e-8,1\n0.2,,1e-8,2\n0.3,3e6,2e-8,3\n");
    cli_json(fit, "evaluate s.h5 lacks.csv", "judged_rows 2, rows_left_out 1, scaled_rmse >0");
    cli_json(fit, "predict s.h5 some.csv --out p1.csv", "rows 2, incomplete 0");
    cli_json(fit, "predict s.h5 swapped.csv --out p2.csv", "rows 3, incomplete 1");
    assert_says(result.err, "1 of 3 rows lack an input");
    (void)cli_read("p1.csv", first, sizeof first);
    (void)cli_read("p2.csv", second, sizeof second);
    char *missing = strstr(second, "\n\"\"\n"); /* readers would skip a blank line */
    assert_non_null(missing);
    memmove(missing, missing + 3, strlen(missing + 2));
    assert_string_equal(first, second);
    cli_write("short.csv", "a,c\n1,2\n");
    cli_expect(fit, "predict s.h5 short.csv", 3, "there is no column 'b'; the columns are: a, c");
    cli_write("far.csv", "a,b,c\n50,3e6,1e-8\n");
    cli_expect(fit, "predict s.h5 far.csv", 0, "y\n");
    assert_says(result.err, "1 of 1 rows lie outside of the training range");
    cli_expect(fit, "predict s.h5 some.csv --out some.csv", 2, "some.csv");
}

/* ---- columns that are left out ---- */

TEST("a constant column and one that --without excludes have no effect: the bits are those of a table "
     "without them") {
    static char header[1 << 17];
    need_tables();
    sheet *s = TEST_ARRAY(sheet, 1);
    put(s, "a,\"rate,kg/s\",unit,tag,y\n");
    for (size_t i = 0; i < 60; i++)
        put(s, "%.9g,%.9g,7,P-%02zu,%.9g\n", noise(2 * i), noise(2 * i + 1), i % 7,
            sin(noise(2 * i)) + noise(2 * i + 1));
    cli_write("pump.csv", s->text);
    cli_expect(fit,
               "train pump.csv --inputs a,\"rate,kg/s\" --outputs y --hidden 4 --out two.h5 --validation 0.2",
               0, "train_rows                        48\ninputs                             2\n");
    assert_says(result.out, "judged_rows                       12");
    assert_says(result.out, "part                      validation");
    if (strstr(result.err, "warning") != NULL) fail_msg("%s", result.err);
    cli_expect(fit, "train pump.csv --without tag --hidden 4 --out all.h5 --validation 0.2", 0,
               "train_rows                        48\ninputs                             2\n");
    assert_says(result.err, "column unit is constant: it carries no information and is left out");
    cli_expect(
        fit,
        "train pump.csv --without tag --hidden 4 --out part.h5 --validation 0.2 --stop-after 2 --checkpoint "
        "pump.chk",
        0, "");
    cli_expect(fit, "train pump.csv --without tag --out part.h5 --resume pump.chk", 0, "");
    const lg_table_file *two = model_of("two.h5");
    static const char *const others[] = {"all.h5", "part.h5"};
    for (size_t i = 0; i < LG_COUNT(others); i++) {
        const lg_table_file *other = model_of(others[i]);
        assert_int_equal(two->parameters, other->parameters);
        assert_memory_equal(two->theta, other->theta, two->parameters * sizeof(double));
    }
    cli_write("bare.csv", "\"rate,kg/s\",a,y\n0.1,0.2,0.3\n-0.1,0.4,0.2\n");
    cli_expect(fit, "predict all.h5 bare.csv", 0, "y\n");
    cli_json(fit, "evaluate all.h5 bare.csv", "judged_rows 2");
    /* The header states which rows were learned, and with which options in a form that a shell accepts. */
    cli_expect("lg-export", "two.h5 --out two --name two", 0, "");
    (void)cli_read("two/two.h", header, sizeof header);
    assert_says(header, "rows 48");
    assert_says(header, "'a,\"rate,kg/s\"'");
    cli_write("ranges.yaml", "ranges:\n  hidden: {integer: [2, 4]}\nfixed: {epochs: 3}\n");
    cli_expect(
        fit,
        "search ranges.yaml pump.csv --outputs \"rate,kg/s\" --without tag --trials 1 --out pump-trials.csv",
        0, "train pump.csv --outputs '\"rate,kg/s\"' --without tag --epochs 3");
    assert_says(result.err, "column unit is constant: it carries no information and is left out");
    cli_expect(fit, "train pump.csv --class \"tag\" --inputs a,y --out tag.h5 --epochs 3", 0,
               "classification");
    cli_expect(fit, "evaluate tag.h5 pump.csv", 0, "accuracy");
}

TEST("the help says what --plot draws, where the plot's data are written, and how the width is chosen") {
    static char text[1 << 17];
    size_t used = 0;
    cli_expect(fit, "train --help-all", 0, "");
    /* all in one line, several blanks replaced by one */
    for (const char *c = result.out; *c != '\0' && used + 1 < sizeof text; c++)
        if (strchr(" \n", *c) == NULL || (used > 0 && text[used - 1] != ' '))
            text[used++] = *c == '\n' ? ' ' : *c;
    text[used] = '\0';
    assert_says(text, "Draw a plot; its data and script stay next to it, as FILE.dat and FILE.gp");
    assert_says(text,
                "With --plot: loss (the loss over the epochs), scatter (predicted against true values), "
                "confusion (the table of confusion)");
    assert_says(text, "whose width the evidence of the data decides");
    if (strstr(text, "Draw the loss") != NULL) fail_msg("%s", result.out);
}

static void put_quoted(sheet *s, const char *name) {
    put(s, "\"");
    for (; *name != '\0'; name++) put(s, *name == '"' ? "\"\"" : "%c", *name);
    put(s, "\"");
}

TEST("plots show names of columns and classes as they are, and no name is a command") {
    for (size_t n = 0; n <= CLI_NAMES; n++) { /* each name as the output; then all as classes */
        sheet *s = TEST_ARRAY(sheet, 1);
        put(s, "a,");
        put_quoted(s, n < CLI_NAMES ? cli_strange_name(n) : "class");
        for (size_t i = 0; i < 120; i++) {
            put(s, "\n%.9g,", (double)(i % CLI_NAMES) + 0.1 * noise(i));
            if (n < CLI_NAMES)
                put(s, "%zu", i % CLI_NAMES);
            else
                put_quoted(s, cli_strange_name(i % CLI_NAMES));
        }
        put(s, "\n");
        cli_write("names.csv", s->text);
        cli_run(fit, "train names.csv %s --epochs 3 --out n.h5 --plot n.svg",
                n < CLI_NAMES ? "" : "--class class");
        cli_shows_names("n.svg", "", n < CLI_NAMES ? n : 0, n < CLI_NAMES ? n + 1 : n);
    }
}

TEST("a plot shows all points of each output, also where outputs differ in size") {
    static char plot[1 << 20];
    need_tables();
    sheet *s = TEST_ARRAY(sheet, 1);
    put(s, "a,c,d\n");
    for (size_t i = 0; i < 60; i++) put(s, "%g,%g,%g\n", noise(i), noise(2 * i), 1300 + 300 * noise(3 * i));
    cli_write("sizes.csv", s->text);
    cli_run(fit, "train sizes.csv --outputs c,d --epochs 3 --validation 0 --out sizes.h5 --plot sizes.svg");
    if (strstr(result.err, "gnuplot is not installed") != NULL) return;
    (void)cli_read("sizes.svg", plot, sizeof plot);
    size_t points = 0;
    for (const char *at = plot; (at = strstr(at, "<use xlink:href='#gpPt6'")) != NULL; at++) points++;
    assert_int_equal(points, 2 * 60);
}

TEST("lg-fit reads predictions for classes with long names, and plots show these names completely") {
    static char table[1 << 14], svg[1 << 16];
    char first[64] = "", second[64] = "", *to = table;
    memset(first, 'x', 63);
    memset(second, '%', 40);
    (void)strcpy(second + 40, "END_OF_THE_NAME");
    to += sprintf(to, "a,b,c\n");
    for (int i = 0; i < 60; i++)
        to += sprintf(to, "%g,%g,%s\n", i % 2 * 3 + 0.01 * i, -i % 2 * 2 + 0.003 * i, i % 2 ? first : second);
    cli_write("long.csv", table);
    cli_run(fit, "train long.csv --class c --hidden 4 --epochs 30 --out long.h5 --plot long.svg");
    const bool drawn = strstr(result.err, "gnuplot") == NULL;
    cli_run(fit, "predict long.h5 long.csv --out long_p.csv");
    cli_run(fit, "train long_p.csv --class c --hidden 4 --epochs 3 --out again.h5");
    if (!drawn) return; /* gnuplot is not installed */
    cli_read("long.svg", svg, sizeof svg);
    assert_says(svg, "END_OF_THE_NAME");
    /* long.dat has the data of long.svg, so long.png is no earlier plot and must not be replaced. */
    cli_write("long.png", "\x89PNG\r\n\x1a\nmine");
    cli_expect(fit, "evaluate long.h5 long.csv --plot long.png", 3, "its data do not lie in long.dat");
}

/* ---- HDF5 and numpy ---- */

/* Writes a numpy file with this header and these numbers. */
static void write_npy(const char *name, const char *header, const void *numbers, size_t bytes) {
    const size_t length = strlen(header);
    const unsigned char start[10] = {0x93, 'N', 'U', 'M', 'P', 'Y', 1, 0, (unsigned char)length, 0};
    FILE *file = fopen(cli_at(name), "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(start, 1, sizeof start, file), sizeof start);
    assert_int_equal(fwrite(header, 1, length, file), length);
    if (bytes > 0) assert_int_equal(fwrite(numbers, 1, bytes, file), bytes);
    assert_int_equal(fclose(file), 0);
}

static const lg_table_data *table_of(const char *name, const char *const *names, uint32_t count,
                                     const char *class_column) {
    lg_table_data data;
    assert_ok(lg_table_read(NULL, cli_at(name), names, count, class_column, NULL, &data, NULL));
    return own_lg_table_data(data);
}

TEST("numpy arrays of every type and order are read") {
    static const char *const names[] = {"c2", "c0"};
    static const double wanted[] = {3, 1, 6, -4};
    static const double f8[] = {1, 2, 3, -4, 5, 6}, columns[] = {1, -4, 2, 5, 3, 6};
    static const float f4[] = {1, 2, 3, -4, 5, 6};
    static const int64_t i8[] = {1, 2, 3, -4, 5, 6};
    static const int16_t i2[] = {1, 2, 3, -4, 5, 6};
    static const unsigned char big[] = {0, 1, 0, 2, 0, 3, 0xff, 0xfc, 0, 5, 0, 6};
    static const struct {
        const char *type, *order;
        const void *numbers;
        size_t bytes;
    } rows[] = {{"<f8", "False", f8, sizeof f8}, {"<f8", "True", columns, sizeof columns},
                {"<f4", "False", f4, sizeof f4}, {"<i8", "False", i8, sizeof i8},
                {"<i2", "False", i2, sizeof i2}, {">i2", "False", big, sizeof big}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        write_npy("x.npy",
                  test_text("{'descr': '%s', 'fortran_order': %s, 'shape': (2, 3), }\n", rows[i].type,
                            rows[i].order),
                  rows[i].numbers, rows[i].bytes);
        const lg_table_data *data = table_of("x.npy", names, 2, "c1");
        assert_int_equal(data->rows, 2);
        assert_all_close(data->values, wanted, 4, 0, 0);
        assert_int_equal(data->classes, 2);
        assert_string_equal(data->class_name[1], "5");
    }
    write_npy("line.npy", "{'descr': '<f8', 'fortran_order': False, 'shape': (6,), }\n", f8, sizeof f8);
    assert_int_equal(table_of("line.npy", &names[1], 1, NULL)->rows, 6);
}

static void write_h5(const char *name, bool words) {
    static const double x[] = {1, 2, 3, 4, 5, 6};
    static const int64_t whole[] = {7, 8, 9};
    static const char texts[3][8] = {"cat", "dog", "cat"};
    const uint64_t rows = 3, dims[2] = {3, 2};
    lg_h5 *h5;
    assert_ok(lg_h5_create(NULL, cli_at(name), &h5, NULL));
    assert_ok(lg_h5_put(h5, "matrix", LG_ELEMENT_F64, 2, dims, x, NULL));
    if (words) assert_ok(lg_h5_put_text(h5, "matrix", "columns", "left, right", NULL));
    assert_ok(lg_h5_put(h5, "whole", LG_ELEMENT_I64, 1, &rows, whole, NULL));
    assert_ok(lg_h5_put_texts(h5, "kind", texts[0], sizeof texts[0], 3, NULL));
    assert_ok(lg_h5_put(h5, "short", LG_ELEMENT_F64, 1, &dims[1], x, NULL));
    assert_ok(lg_h5_commit(h5, NULL));
    lg_h5_close(h5);
}

TEST("HDF5 files have a data set per column, or columns in a single data set") {
    static const char *const named[] = {"right", "whole"}, *const numbered[] = {"matrix1", "whole"};
    static const double wanted[] = {2, 7, 4, 8, 6, 9};
    write_h5("named.h5", true);
    write_h5("numbered.h5", false);
    for (int i = 0; i < 2; i++) {
        const lg_table_data *data =
            table_of(i == 0 ? "named.h5" : "numbered.h5", i == 0 ? named : numbered, 2, "kind");
        assert_all_close(data->values, wanted, 6, 0, 0);
        assert_int_equal(data->classes, 2);
        assert_string_equal(data->class_name[data->label[1]], "dog");
        assert_true(data->label[0] == data->label[2]);
    }
    cli_expect(fit, "train named.h5 --inputs left --outputs kind --out k.h5", 3, "does not hold numbers");
    cli_expect(fit, "train named.h5 --inputs left --outputs short --out k.h5", 3, "has 2 rows");
    cli_expect(fit, "train named.h5 --inputs left --outputs gone --out k.h5", 3,
               "the columns are: kind, left, right, short, whole");
}

/* A log in HDF5 of five columns. Data set i has shape (rows), (rows, 1) or (1, rows). */
static void write_layout(const char *name, const int *shape, bool matlab) {
    enum { N = 120 };
    static const char *const columns[] = {"t", "u", "v", "x", "y"};
    double values[5][N];
    lg_h5 *h5;
    assert_ok(lg_h5_create(NULL, cli_at(name), &h5, NULL));
    for (int i = 0; i < N; i++) {
        const double t = 0.02 * i, all[] = {t, -sin(t), cos(t), sin(t), 3 * sin(t) - cos(t)};
        for (int c = 0; c < 5; c++) values[c][i] = all[c];
    }
    for (int c = 0; c < 5; c++) {
        const uint64_t dims[3][2] = {{N, 1}, {N, 1}, {1, N}}, *of = dims[shape[c % 3]];
        assert_ok(lg_h5_put(h5, columns[c], LG_ELEMENT_F64, shape[c % 3] == 0 ? 1 : 2, of, values[c], NULL));
        if (matlab) assert_ok(lg_h5_put_text(h5, columns[c], "MATLAB_class", "double", NULL));
    }
    assert_ok(lg_h5_commit(h5, NULL));
    lg_h5_close(h5);
}

TEST("every program reads columns of an HDF5 file in every layout and writes the same") {
    static const int shapes[][3] = {{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {0, 1, 2}, {2, 1, 1}, {1, 2, 0}};
    static const char *const lines[][2] = {
        {fit, "train w.mat --inputs u,v --outputs y --epochs 3 --hidden 3 --out w.h5 --json"},
        {fit, "evaluate w.h5 w.mat"},
        {fit, "predict w.h5 w.mat"},
        {"lg-identify", "check w.yaml w.mat"},
    };
    char *first[LG_COUNT(lines)] = {NULL};
    cli_write("w.yaml", "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\n"
                        "inputs: {columns: [u]}\n");
    for (size_t k = 0; k < LG_COUNT(shapes); k++) {
        write_layout("w.mat", shapes[k], k % 2 == 1);
        for (size_t i = 0; i < LG_COUNT(lines); i++) {
            cli_expect(lines[i][0], lines[i][1], 0, "");
            char *seconds = strstr(result.out, "\"seconds");
            if (seconds != NULL) *seconds = '\0';
            if (first[i] == NULL) first[i] = test_text("%s", result.out);
            if (strcmp(first[i], result.out) != 0)
                fail_msg("layout %zu: %s\n%s\n%s", k, lines[i][1], first[i], result.out);
        }
    }
}

/* ---- unusual tables ---- */

typedef struct odd {
    const char *text, *arguments; /* --out m.h5 is added */
    int code;
    const char *words;
} odd;

#define LONG   "abcdefghabcdefghabcdefghabcdefghabcdefghabcdefghabcdefghabcdefgh" /* 64 bytes */
#define ELEVEN "1,2,3,4,5,6,7,8,9,10,11"
static const odd odds[] = {
    {"", "", 3, "is empty"},
    {"\n\n\n", "", 3, "is empty"},
    {"# only a remark\n", "", 3, "is empty"},
    {"a,b,y\n", "", 3, "has a header, but no rows"},
    {"a,b,y\n\n\n", "", 3, "has a header, but no rows"},
    {"a,b,y\n1,2,3\n", "", 3, "has 1 complete row; at least two are needed"},
    {"a,b,y\n1,2,3\n,5,6\n", "", 3, "has 1 complete row; at least two are needed"},
    {"a,b,y\n1,2,\n1,,3\n,2,3\n", "", 3, "all 3 rows have missing cells"},
    {"a,b,y\n1,2,3\n4,5\n", "", 3, "line 3: has 2 cells, the header has 3"},
    {"a,b,y\n1,2,3\n4,5,6,7\n", "", 3, "line 3: has 4 cells"},
    {"a,b,y\n1,2,3\n4,many,6\n", "", 3, "line 3: column b: 'many' is not a number"},
    {"a,b,y\n1,2,3\n4,5 m,6\n", "", 3, "line 3: column b: '5 m' is not a number"},
    {"a;b;y\n1;2,5;3\n", "", 3, "line 2: column b: '2,5' is not a number; write decimals with a point"},
    {"a,b,y\n1,2,3\n4,inf,6\n", "", 3, "line 3: column b: 'inf' is not a number"},
    {"a,b,y\n1,2,3\n4,1e999,6\n", "", 3, "line 3: column b: '1e999' is not a finite number"},
    {"a,b,y\n1,0x10,3\n4,5,6\n", "", 3, "'0x10' is not a number"},
    {"1,2,3\n4,5,6\n7,8,9\n", "", 3, "line 1: has numbers where names"},
    {"5.1,3.5,setosa\n4.9,3,setosa\n", "", 3, "there is no header"},
    {"a,a,y\n1,2,3\n4,5,6\n", "", 3, "two columns 'a': rename one of them; --without a leaves out"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--inputs a,q", 3, "there is no column 'q'; the columns are: a, b, y"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--outputs x", 3, "there is no column 'x'"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--class x", 3, "there is no column 'x'"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--inputs a,,b", 2, "names of 1 to 63 bytes"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--inputs a,\"b", 2, "names of 1 to 63 bytes"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--inputs \"a\"b", 2, "names of 1 to 63 bytes"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--inputs \"\",b", 2, "names of 1 to 63 bytes"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--inputs " LONG, 2, "names of 1 to 63 bytes"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--inputs \"" LONG "\"", 2, "names of 1 to 63 bytes"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--inputs \"a\"\"" LONG "\"", 2, "names of 1 to 63 bytes"},
    {"a,b,k\n1,2,3\n4,5,6\n", "--class \"k\",b", 2, "one name of 1 to 63 bytes"},
    {"a,b,k\n1,2,3\n4,5,6\n", "--class \"k", 2, "one name of 1 to 63 bytes"},
    {"a,b,k\n1,2,3\n4,5,6\n", "--class " LONG, 2, "one name of 1 to 63 bytes"},
    {"a,b,c,d,e,f,g,h,i,j,k,l,m,n,o,p,q,r,s,t,u\n", "--without v", 3, "r, s, t, u"},
    {"a,\"b,c\",\"d\"\"\",y\n1,2,3,4\n4,5,6,7\n", "--inputs q", 3,
     "the columns are: a, \"b,c\", \"d\"\"\", y"},
    {"a,\"b,c\",y\n1,x,3\n4,y,6\n", "", 3, "--without '\"b,c\"' leaves out"},
    {"a,b,u,y\n1,x,kg,3\n4,y,kg,6\n", "", 3, "'x' is not a number; --without b,u leaves out"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--without q", 3, "there is no column 'q'; the columns are: a, b, y"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--without a --inputs a,b", 2, "--without: column a is an input"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--without y --outputs y", 2, "--without: column y is an output"},
    {"a,b,k\n1,2,3\n4,5,6\n", "--without k --class k", 2, "--without: column k is an output"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--without a,b", 3, "there is no column to learn from"},
    {"a,b,y\n4,2,3\n4,2,6\n4,2,7\n", "", 3, "all inputs are constant: there is nothing to learn from"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--inputs a,a", 2, "'a' is given twice"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--inputs a,y --outputs y", 2, "column y is an input and an output"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--outputs y --class b", 2, "--outputs and --class cannot be given together"},
    {"y\n1\n2\n3\n", "", 3, "there is no column to learn from"},
    {"a,k\n1,x\n2,x\n3,x\n", "--class k", 3, "one class only"},
    {"a,k\n1,x\n2,\n3,x\n", "--class k", 3, "one class only"},
    {"a,b,y\n1,\"2,3\n4,5,6\n", "", 3, "a quote is not closed"},
    {"a,b,y\n1,\"2\"3,4\n4,5,6\n", "", 3, "text follows a closing quote"},
    {"a\001,b,y\n1,2,3\n4,5,6\n", "", 3, "control characters"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--hidden 4,5", 2, "all must have the same width"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--decay 1,2", 2, "--decay: has 2 numbers, but the model has"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--activation best", 2, "not one of"},
    {",,\n1,2,3\n4,5,6\n", "", 3, "there is no column with a name"},
    /* These succeed. */
    {"a,b,c,d,e,f,g,h,i,j,y\n" ELEVEN "\n2,3,1,5,4,7,6,9,8,9,10\n3,1,2,4,6,5,8,7,9,8,9\n", "", -1,
     "2 to learn from, with 10 inputs; at least 12 are needed"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--size auto --epochs 2", -1, "there are too few rows"},
    {"a,b,y\n1,2,3\n4,5,6\n", "--validation 0.9", -1, "the validation part has one row"},
    {"a,b,y\n1,2,3\n4,5,7\n5,9,7\n", "--validation 0 --hidden 1", -1, ""},
    {"a,b,y\n1,2,3\n4,5,7\n5,9,7\n", "--hidden 2,2,2,2,2,2,2,2,2,2,2,2,2,2,2 --epochs 2", -1, ""},
    {"a,b,y\n1,2,3\n4,5,7\n5,9,7\n", "--hidden 400", -1, ""},
    {"a,b,y\n1,2,3\n4,5,7\n5,9,7\n", "--hidden 2 --seconds 1", -1, ""},
    {"a,b,y\n1,2,3\n4,5,7\n5,9,7\n", "--prior 0.1 --method lbfgs --hidden 2", -1, ""},
    {"a,k\n1,x\n2,y\n,z\n3,x\n4,y\n", "--class k", -1, "class 'z' has only 0 complete rows"},
    {"a,b,y\n1,2,3\n4,5,6\n", "", -1, "there are too few rows: 1 to learn from, with 2 inputs; at least 10"},
    {"a,b,y\n1,2,3\n4,5,6\n7,8,8\n", "", -1, "the validation part has one row"},
    {"a,b,y,z\n1,2,3,x\n4,5,6,y\n7,8,8,x\n", "--without z", -1, "the output is the last column, y;"},
    {"\xef\xbb\xbf"
     "a,b,y\r\n1,2,3\r\n4,5,6\r\n7,8,8\r\n",
     "--inputs a,b --outputs y", -1, ""},
    {"a\tb\ty\n1\t2\t3\n4\t5\t6\n7\t8\t8\n", "", -1, ""},
    {"\"a, long\",b,y\n1,2,3\n4,5,6\n7,8,8\n", "--outputs y", -1, ""},
    {"0,1,2\n1,2,3\n4,5,6\n7,8,8\n", "--outputs 2", -1, ""},
    {"a,\"d\"\"e\",y\n1,2,3\n4,5,6\n7,8,8\n", "--inputs \"d\"\"e\",a", -1,
     "the output is the last column, y;"},
    {",b,y\n0,2,3\n1,5,6\n2,8,8\n", "", -1, "column 1 has no name and is not used"},
    {"a,b,\n0,2,3\n1,5,6\n2,8,8\n", "", -1, "the output is the last column, b;"},
    {"a,b,y\n1,2,3\n4,5,6\n7,nan,9\n7,8,8\n", "", -1, "1 of 4 rows have missing cells"},
    {"a,b,y\n1,2,3\n4,2,6\n7,2,8\n", "", -1,
     "column b is constant: it carries no information and is left out"},
    {"a,b,y\n1,2,3\n4,5,3\n7,8,3\n", "", -1, "column y is constant"},
    {"a,b,y\n1,2,3\n4,5,6\n1,2,3\n4,5,6\n1,2,3\n", "--validation 0.4", -1, "3 rows repeat other rows"},
    {"a,b,y\n1,2,3\n1,2,3\n1,2,3\n1,2,3\n2,3,4\n1,2,3\n1,2,3\n", "--validation 0.5", -1,
     "both in the training and in the validation part"},
    {"a,b,y\n1e300,2,3\n-1e300,5,6\n3,8,8\n", "", -1, ""},
    {"a,b,y\n1e-300,2,1e-300\n2e-300,5,1e-305\n3e-300,8,2e-300\n", "", -1, ""},
    {"a,b,y\n1,2,1e300\n4,5,-1e300\n7,8,1e299\n", "", -1, ""},
    {"a,k\n1,x\n2,y\n3,x\n4,x\n", "--class k", -1, "class 'y' has only 1 row"},
    {"a,b,y\n1,2,3\n4,5,6\n7,8", "", -1, "the last line was cut off and left out"},
};

TEST("an unusual table causes a message and an exit code, never a crash") {
    for (size_t i = 0; i < LG_COUNT(odds); i++) {
        const odd *o = &odds[i];
        cli_write("odd.csv", o->text);
        const char *line = test_text("train odd.csv %s --out m.h5", o->arguments);
        if (o->code >= 0) {
            cli_expect(fit, line, o->code, o->words);
            assert_false(cli_exists("m.h5"));
            continue;
        }
        cli_run_limited(fit, line, 0);
        if ((result.code != 0 && result.code != 4) || strstr(result.err, o->words) == NULL)
            fail_msg("table %zu: %s: %d\n%s%s", i, line, result.code, result.out, result.err);
        if (cli_exists("m.h5")) cli_unlink("m.h5");
    }
}

/* A table of `columns` inputs c0, c1, ... and an output. Odd rows up to 2 far have a far cell in each input;
 * with `words` all inputs are texts. */
static void write_many(const char *name, int columns, int far, bool words) {
    sheet *s = TEST_ARRAY(sheet, 1);
    for (int c = 0; c < columns; c++) put(s, "c%d,", c);
    put(s, "y\n");
    for (int row = 0; row < 60; row++) {
        for (int c = 0; c < columns; c++)
            if (words)
                put(s, "x,");
            else
                put(s, "%.6g,", row % 2 == 1 && row < 2 * far ? 1e9 : noise((size_t)(97 * row + c)));
        put(s, "%.6g\n", noise((size_t)row));
    }
    cli_write(name, s->text);
}

TEST("many columns with far cells, or with texts, are told in few words") {
    write_many("many.csv", 11, 2, false);
    cli_run_limited(fit, "train many.csv --hidden 2 --epochs 2 --out m.h5", 0);
    assert_says(result.err, "column c0: 2 of 60 cells lie far from all others");
    assert_says(result.err, "column c7: 2 of 60 cells");
    assert_null(strstr(result.err, "column c8: 2 of 60 cells"));
    assert_says(result.err, "3 more columns have cells far from all others");
    write_many("many.csv", 80, 0, true);
    cli_expect(fit, "train many.csv --out m2.h5", 3,
               "--without A,B,... leaves out columns that cannot be read");
    write_many("many.csv", 101, 0, true); /* too many to try each */
    cli_expect(fit, "train many.csv --out m2.h5", 3, "column c0: 'x' is not a number");
    assert_null(strstr(result.err, "--without"));
    assert_false(cli_exists("m2.h5"));
}

TEST("if a model has no ranges, no row counts as outside") {
    need_tables();
    cli_expect(fit, "train smooth.csv --inputs a,b,c --outputs y --out ranged.h5 --test other.csv --epochs 2",
               0, "");
    cli_write("away.csv", "a,b,c\n50,3e6,1e-8\n");
    for (int kept = 0; kept < 3; kept++) {
        lg_table_file file = *model_of("ranged.h5");
        if (kept != 1) file.low = NULL;
        if (kept != 2) file.high = NULL;
        assert_told(lg_recipe_save(NULL, cli_at("bare.h5"), &lg_recipe_table, &file, NULL, &told));
        cli_expect(fit, "predict bare.h5 away.csv", 0, "y\n");
        assert_null(strstr(result.err, "outside"));
    }
}

/* Puts `count` elements of a type in place of a data set. */
static void put_instead(const char *file_name, const char *set_name, hid_t type, hsize_t count,
                        const void *data) {
    const hid_t file = H5Fopen(cli_at(file_name), H5F_ACC_RDWR, H5P_DEFAULT);
    assert_true(H5Ldelete(file, set_name, H5P_DEFAULT) >= 0);
    const hid_t space = H5Screate_simple(1, &count, NULL);
    const hid_t set = H5Dcreate2(file, set_name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0);
    assert_true(H5Dclose(set) >= 0 && H5Sclose(space) >= 0 && H5Fclose(file) >= 0);
}

TEST("a model whose names or scales do not fit its network is refused") {
    static const struct {
        const char *names[4];
        hsize_t count;
        const char *words;
    } rows[] = {
        {{"a", "b"}, 2, "names/inputs: 2 names, expected 3"},
        {{"a", "b", "c", "d"}, 4, "names/inputs: 4 names, expected 3"},
        {{"a", "", "c"}, 3, "names/inputs: name number 2 is empty"},
        {{"a", "b", LONG}, 3, "names/inputs: more than 65536 names, or one of more than 63 bytes: " LONG}};
    static const double two[] = {1, 2};
    static const char train[] =
        "train smooth.csv --inputs a,b,c --outputs y --out model.h5 --test other.csv --epochs 2";
    need_tables();
    cli_expect(fit, train, 0, "");
    const hid_t text = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(text, sizeof LONG) >= 0);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        char names[4][sizeof LONG] = {""};
        for (size_t k = 0; k < rows[i].count; k++)
            memcpy(names[k], rows[i].names[k], strlen(rows[i].names[k]));
        put_instead("model.h5", "/names/inputs", text, rows[i].count, names);
        cli_expect(fit, "predict model.h5 smooth.csv", 3, rows[i].words);
    }
    assert_true(H5Tclose(text) >= 0);
    cli_expect(fit, train, 0, "");
    put_instead("model.h5", "/scaler/inputs/mean", H5T_NATIVE_DOUBLE, 2, two);
    cli_expect(fit, "predict model.h5 smooth.csv", 3,
               "/scaler/inputs/mean: has shape (2), expected (3 columns as in /model)");
    lg_recipe_release(&lg_recipe_table, NULL);
}

TEST("files that are not tables cause a message and an exit code too") {
    static const struct {
        const char *header, *words;
    } arrays[] = {
        {"{'descr': '<c16', 'fortran_order': False, 'shape': (2, 2), }\n", "type"},
        {"{'descr': '|O', 'fortran_order': False, 'shape': (2, 2), }\n", "type"},
        {"{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (2,), }\n", "holds records of type"},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (2, 2, 2), }\n",
         "expected (rows) or (rows, columns)"},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (), }\n", "single number"},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (0, 3), }\n", "dimensions is 0"},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (9, 3), }\n", "cut off"},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (4611686018427387905, 4), }\n", "cut off"},
        {"{'fortran_order': False, 'shape': (2, 2), }\n", "descr"},
        {"", "descr"},
    };
    static const double infinite[] = {1, 2, INFINITY, 4};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) {
        write_npy("odd.npy", arrays[i].header, infinite, sizeof infinite);
        cli_expect(fit, "train odd.npy --out m.h5", 3, arrays[i].words);
    }
    write_npy("odd.npy", "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 2), }\n", infinite,
              sizeof infinite);
    cli_expect(fit, "train odd.npy --out m.h5", 3, "row 2: column c0: the value is infinite");
    cli_write("cut.npy", "\x93NUMPY\x01");
    cli_expect(fit, "train cut.npy --out m.h5", 3, "ends within numpy's header");
}

/* Every byte of a good file is changed in turn, and the file is cut at every length. The program must end
 * with one of its exit codes. */
TEST("damaged tables do not crash the program") {
    static char good[512], text[512];
    (void)snprintf(good, sizeof good, "a,\"b\",k\n1,2,x\n2,3,y\n3,1,x\n4,5,y\n");
    const char *path = cli_at("damaged.csv");
    const size_t length = strlen(good);
    for (size_t i = 0; i < 2 * length; i += 3) {
        memcpy(text, good, sizeof text);
        if (i < length) text[i] = (char)(i % 2 == 0 ? 0xff : '"');
        FILE *file = fopen(path, "wb");
        assert_non_null(file);
        const size_t bytes = i < length ? length : i - length;
        assert_int_equal(fwrite(text, 1, bytes, file), bytes);
        assert_int_equal(fclose(file), 0);
        cli_run_limited(fit, "train damaged.csv --class k --out d.h5 --epochs 3", 0);
        if (result.code > 5) fail_msg("byte %zu: exit code %d\n%s", i, result.code, result.err);
    }
}

TEST("a search finds the better width") {
    need_tables();
    cli_write(
        "lists.yaml",
        "ranges:\n  hidden: {choice: [[4, 4], \"3,3\"]}\nfixed: {epochs: 2, decay: [1, 1, 1, 1, 1, 1, 1]}\n");
    cli_json(fit, "search lists.yaml classes.csv --class where --trials 4 --out lists.csv", "done 4");
    cli_write("ranges.yaml", "ranges:\n  hidden: {integer: [1, 12]}\nfixed: {epochs: 20}\n");
    cli_expect(fit, "search ranges.yaml smooth.csv --trials 3 --out trials.csv", 0, "");
    assert_true(cli_exists("trials.csv"));
}

TEST("a search rejects an option that no trial reads, and its best command omits what it ignores") {
    need_tables();
    cli_write("plan.yaml", "ranges:\n  optimizer: {choice: [lm, adam]}\nfixed: {epochs: 2, lr: 1e-9}\n");
    cli_expect(fit, "search plan.yaml smooth.csv --sampler grid --trials 2 --out plan.csv", 0,
               "--epochs 2 --optimizer lm --seed");
    cli_write("plan.yaml", "ranges:\n  batch: {choice: [40, 80]}\n");
    cli_expect(fit, "search plan.yaml smooth.csv --trials 1 --out no.csv", 3,
               "line 2: batch: is for adam; training by lm has no such option");
}

TEST("a search takes columns and classes as train does, and continues only with the same ones") {
    need_tables();
    cli_write("ranges.yaml", "ranges:\n  hidden: {integer: [4, 8]}\nfixed: {epochs: 5}\n");
    cli_expect(fit, "search ranges.yaml classes.csv --class where --trials 2 --out classes-trials.csv", 0,
               "train classes.csv --class where --epochs 5");
    cli_expect(fit, "search ranges.yaml smooth.csv --inputs a,b,c --outputs y --trials 1 --out columns.csv",
               0, "");
    cli_expect(fit,
               "search ranges.yaml smooth.csv --inputs a,b,c --outputs z --trials 2 --out columns.csv "
               "--resume",
               2, "the trials were made with other");
    cli_expect(fit,
               "search ranges.yaml smooth.csv --inputs a,b,c --outputs y --trials 2 --out columns.csv "
               "--resume",
               0, "");
}

TEST_GROUP(setup, cli_end)
