/* Tables of hyperparameters: checks for every field of every kind. */
#include "support/io_test.h"

#include "liegrad/anomaly.h"
#include "liegrad/elastica.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/machine.h"
#include "liegrad/settings.h"
#include "liegrad/table.h"
#include "model/files/training.h"

static union run {
    lg_hamiltonian_run hamiltonian;
    lg_surrogate_run surrogate;
    lg_detector_run detector;
    lg_table_run table;
    lg_machine_model_run machine;
} run, other;

static const lg_field *const tables[] = {lg_hamiltonian_fields, lg_surrogate_fields, lg_detector_fields,
                                         lg_table_fields, lg_machine_model_fields};
/* Whether the field is the plan of a training. */
static bool is_plan(const lg_field *row) {
    return row->type == LG_FIELD_PHRASE && strncmp(row->form, "phases", 6) == 0;
}

#define EACH_ROW(row)                                                                                        \
    for (size_t table = 0; table < LG_COUNT(tables); table++)                                                \
        for (const lg_field *row = tables[table]; row->name != NULL; row++)

TEST("names and options are unique") {
    EACH_ROW(row) {
        char option[64], again[64];
        lg_field_option(row, option, sizeof option);
        if (option[0] != '\0') assert_ptr_equal(lg_field_find(tables[table], row->name), row);
        if (option[0] != '\0') assert_ptr_equal(lg_field_find(tables[table], option), row);
        assert_null(strchr(option, '_'));
        for (const lg_field *next = row + 1; next->name != NULL; next++) {
            lg_field_option(next, again, sizeof again);
            assert_string_not_equal(row->name, next->name);
            if (option[0] != '\0') assert_string_not_equal(option, again);
        }
    }
    assert_null(lg_field_find(tables[0], "colour"));
    assert_string_equal(lg_field_find(tables[0], "weight-decay")->name, "weight_decay");
    /* The detector defines its own validation part, so this option differs from lg-fit's option of the same
     * name. */
    assert_string_equal(lg_field_find(tables[2], "validation-fraction")->name, "validation_fraction");
}

static void assert_sets(const lg_field *row, const char *text, bool good) {
    lg_error error = {LG_OK, ""};
    memset(&run, 0, sizeof run);
    other = run;
    const lg_status status = lg_field_set(row, text, &run, &error);
    if ((status == LG_OK) != good) fail_msg("%s: '%s' was %s", row->name, text, good ? "refused" : "taken");
    if (good) {
        assert_true(lg_field_fits(row, &run));
    } else {
        assert_int_equal(status, LG_INVALID_ARGUMENT);
        assert_memory_equal(&run, &other, sizeof run);
        assert_non_null(strstr(error.message, "is"));
    }
}

TEST("each option with two truth values takes no and false, and yes and true") {
    static const char *const words[] = {"no", "false", "yes", "true"};
    size_t found = 0;
    EACH_ROW(row) {
        const bool truth = row->type == LG_FIELD_FLAG && (strcmp(lg_field_name(row, 0), "no") == 0 ||
                                                          strcmp(lg_field_name(row, 0), "false") == 0);
        for (size_t i = 0; truth && i < LG_COUNT(words); i++, found++) {
            assert_sets(row, words[i], true);
            assert_int_equal(lg_field_whole(row, &run), i / 2);
        }
    }
    assert_true(found > 30);
}

TEST("the limits of a field are accepted, and nothing beyond them") {
    EACH_ROW(row) {
        char text[64];
        const bool whole = row->type != LG_FIELD_REAL && row->type != LG_FIELD_REALS;
        if (row->type == LG_FIELD_TEXT) {
            memset(text, 'x', sizeof text);
            assert_sets(row, test_text("%.*s", (int)row->size, text), false);
            assert_sets(row, test_text("%.*s", (int)row->size - 1, text), true);
            assert_sets(row, "", false);
            continue;
        }
        static const char *const never[] = {"", " 1", "1 ", "one", "nan", "inf", "1e999", "0x1", ",1", "1,"};
        for (size_t i = 0; i < LG_COUNT(never); i++) assert_sets(row, never[i], false);
        if (lg_field_name(row, 0) != NULL) {
            for (uint32_t i = 0; lg_field_name(row, i) != NULL; i++)
                assert_sets(row, lg_field_name(row, i), true);
            continue;
        }
        if (row->type == LG_FIELD_PHRASE) continue; /* tested where its text is read */
        assert_true(row->low < row->high);
        (void)lg_format(text, sizeof text, "%.17g", row->low);
        assert_sets(row, text, !row->above);
        (void)lg_format(text, sizeof text, "%.17g", whole ? row->low - 1 : nextafter(row->low, -1));
        assert_sets(row, text, false);
        if (row->high == 0x1p64) continue; /* beyond any number */
        (void)lg_format(text, sizeof text, whole ? "%.0f" : "%.17g", row->high);
        assert_sets(row, text, true);
        (void)lg_format(text, sizeof text, whole ? "%.0f" : "%.17g",
                        whole ? row->high + 1 : nextafter(row->high, INFINITY));
        assert_sets(row, text, false);
        if (whole) assert_sets(row, "1.5", false);
    }
}

TEST("a value is shown as a text that sets the same bits, and setting one value changes no other") {
    EACH_ROW(row) {
        char text[LG_FIELD_TEXT_SIZE], again[LG_FIELD_TEXT_SIZE];
        const char *value = is_plan(row)                    ? "adam:3,lbfgs"
                            : lg_field_name(row, 0) != NULL ? lg_field_name(row, 1)
                            : row->type == LG_FIELD_WHOLES  ? "3,1,2"
                            : row->type == LG_FIELD_REAL    ? "0.10000000000000002"
                                                            : "3";
        memset(&run, 0, sizeof run);
        other = run;
        assert_ok(lg_field_set(row, value, &run, NULL));
        lg_field_show(row, &run, text, sizeof text);
        assert_string_equal(text, value);
        lg_field_copy(row, &run, &other);
        assert_memory_equal(&run, &other, sizeof run);
        for (const lg_field *next = tables[table]; next->name != NULL; next++) {
            memset(&other, 0, sizeof other);
            lg_field_show(next, &other, again, sizeof again);
            lg_field_show(next, &run, text, sizeof text);
            if (next != row) assert_string_equal(text, again);
        }
    }
}

/* The names of the methods, with `last` before the last one. */
static const char *method_names(bool squares, const char *last) {
    const char *names[16], *out = "";
    size_t count = 0;
    for (uint32_t i = 0; lg_fit_method_name((lg_fit_method)i) != NULL; i++)
        if (squares || !lg_fit_method_squares((lg_fit_method)i))
            names[count++] = lg_fit_method_name((lg_fit_method)i);
    for (size_t i = 0; i < count; i++)
        out = test_text("%s%s%s", out, i == 0 ? "" : i + 1 < count ? ", " : last, names[i]);
    return out;
}

TEST("lm is a method, and --prior an option, if the loss is a sum of squares, and only then") {
    char text[1024], prior[64];
    lg_error error;
    EACH_ROW(row) {
        if (!is_plan(row)) continue;
        const bool squares = tables[table] == lg_hamiltonian_fields || tables[table] == lg_table_fields ||
                             tables[table] == lg_machine_model_fields;
        memset(&run, 0, sizeof run);
        assert_int_equal(lg_field_set(row, "adam:3,lm", &run, NULL), squares ? LG_OK : LG_INVALID_ARGUMENT);
        lg_field_option(lg_field_find(tables[table], "prior"), prior, sizeof prior);
        assert_string_equal(prior, squares ? "prior" : "");
        (void)lg_field_describe(row, text, sizeof text);
        assert_non_null(strstr(text, test_text("%s, or phases", method_names(squares, " or "))));
        assert_status(lg_field_set(row, "descent", &run, &error), LG_INVALID_ARGUMENT);
        assert_string_equal(strstr(error.message, "the methods are"),
                            test_text("the methods are %s", method_names(squares, ", ")));
    }
}

TEST("fields describe themselves") {
    char text[1024];
    EACH_ROW(row) {
        const int length = lg_field_describe(row, text, sizeof text);
        assert_true(length > 0 && (size_t)length < sizeof text && length == (int)strlen(text));
        if (row->value != NULL && row->otherwise != NULL)
            assert_non_null(strstr(row->otherwise, row->value)); /* the text tells both */
        assert_true(lg_field_name(row, 0) != NULL || row->unit != NULL);
        assert_non_null(strstr(text, row->value != NULL ? row->value : row->otherwise));
        assert_int_equal(strncmp(text, row->meaning, strlen(row->meaning)), 0);
        assert_true(row->meaning[strlen(row->meaning) - 1] != '.');
    }
    const lg_field *hidden = lg_field_find(lg_surrogate_fields, "hidden");
    (void)lg_field_describe(hidden, text, sizeof text);
    assert_string_equal(text, "Width of the hidden layers (1 to 1048576; default the preset's)");
}

TEST("defaults are those of the fields") {
    memset(&run, 0, sizeof run);
    lg_fields_default(lg_hamiltonian_fields, &run);
    const lg_hamiltonian_run *r = &run.hamiltonian;
    const lg_fit_settings *how = &r->training;
    assert_true(how->dtype == LG_F64 && how->epochs == 100 && how->batch == 80 && how->lr == 1e-2);
    assert_true(how->schedule == LG_SCHEDULE_STEP && how->lr_step == 50 && how->lr_gamma == 0.1);
    assert_true(how->adam_eps == LG_HAMILTONIAN_ADAM_EPS && how->clip == LG_HAMILTONIAN_CLIP);
    assert_true(how->weight_decay == 0 && how->validation == 0 && how->shards == 0 && how->seed == 1);
    assert_true(r->substeps == 1 && r->penalty == 0 && r->penalty_form == LG_PENALTY_MEAN_SQUARE);
    assert_true(r->model.net.layers == 4 && r->model.net.width[3] == 100 && r->model.net.width[4] == 0);
    memset(&run, 0, sizeof run);
    lg_fields_default(lg_detector_fields, &run);
    assert_true(run.detector.validation_fraction == 0.1 && run.detector.training.validation == 0);
    assert_true(run.detector.test_fraction == 0.2 && run.detector.model.net.plane == 2);
    assert_true(run.detector.training.epochs == 0); /* 0: the preset's number */
    memset(&run, 0, sizeof run);
    lg_fields_default(lg_surrogate_fields, &run);
    assert_true(run.surrogate.train_fraction == 0.9 && run.surrogate.test_fraction == 0.1);
}

/* ---- docs/data/hyperparameters.md ---- */

static const char page_begin[] =
    "# Hyperparameters\n\n"
    "One table for each kind of run (`liegrad/settings.h`, `fields.c` of each subject in `src`) says "
    "name, "
    "range, default\nand meaning; command lines, ranges of searches, grids of studies, attributes of files, "
    "the "
    "comparison of a resumed run\nand JSON come from it. The name stands in files and grids, the option on "
    "command lines and in searches. What is stored in\na file must be the same in a resumed run. The options "
    "of the classical methods of `lg-anomaly` and of the blocks of its\nnetwork are rows of the same form in "
    "`apps/lg-anomaly/train_options.c` and `src/anomaly/files/recipe.c`.\n\n"
    "This page is written by `test_hyperparameters`, which fails when it is old: run it with "
    "LG_WRITE_PAGES=1 "
    "then.\n";

static void put_page(FILE *page) {
    static const char *const titles[] = {"`lg-hamiltonian train`, `study` (`lg_hamiltonian_run`)",
                                         "`lg-elastica train`, `search` (`lg_surrogate_run`)",
                                         "`lg-anomaly train --classifier cnn`, `search` (`lg_detector_run`)",
                                         "`lg-fit train`, `search` (`lg_table_run`)",
                                         "`lg-identify fit` (`lg_machine_model_run`)"};
    (void)fputs(page_begin, page);
    for (size_t table = 0; table < LG_COUNT(tables); table++) {
        (void)fprintf(page, "\n## %s\n\n| name | option | stored in | |\n|---|---|---|---|\n", titles[table]);
        for (const lg_field *row = tables[table]; row->name != NULL; row++) {
            char option[64], text[1024];
            lg_field_option(row, option, sizeof option);
            (void)lg_training_describe_field(row, text, sizeof text);
            (void)fprintf(page, "| `%s` | %s%s%s | `/%s` | ", row->name, option[0] != '\0' ? "`--" : "",
                          option, option[0] != '\0' ? "`" : "", row->group);
            for (const char *c = text; *c != '\0'; c++) (void)fprintf(page, *c == '|' ? "\\%c" : "%c", *c);
            (void)fputs(" |\n", page);
        }
    }
}

TEST("docs/data/hyperparameters.md is generated from these tables") {
    static const char path[] = LG_TEST_DIR "/../docs/data/hyperparameters.md";
    char *wanted = NULL, *found = NULL;
    size_t size = 0, room = 0;
    FILE *page = open_memstream(&wanted, &size);
    assert_non_null(page);
    put_page(page);
    (void)fclose(page);
    if (getenv("LG_WRITE_PAGES") != NULL) {
        FILE *file = fopen(path, "w");
        assert_non_null(file);
        (void)fputs(wanted, file);
        (void)fclose(file);
    }
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    if (getdelim(&found, &room, '\0', file) < 0) fail_msg("%s cannot be read", path);
    (void)fclose(file);
    if (strcmp(found, wanted) != 0) fail_msg("%s is old: run this test with LG_WRITE_PAGES=1", path);
    free(wanted);
    free(found);
}

/* Types and bounds that no recipe has. */
TEST("fields of every type are shown and described; what cannot be set is refused") {
    static const char name[] = "a name of forty bytes that fills a text.";
    static const char *const few[] = {"a", NULL}, *const many[] = {name, name, name, name, name, name, name,
                                                                   name, name, name, name, name, name, NULL};
    static const struct {
        lg_field row;
        union {
            uint64_t whole;
            bool on;
        } member;
        const char *shown, *described;
    } rows[] = {
        {{.type = LG_FIELD_SWITCH, .size = 1}, {.on = true}, "true", NULL},
        {{.type = LG_FIELD_SWITCH, .size = 1}, {.on = false}, "false", NULL},
        {{.type = LG_FIELD_NAME, .size = 8, .names = few, .group = ""}, {.whole = 7}, "?", "it is good: a"},
        {{.type = LG_FIELD_NAME, .size = 8, .names = many, .group = ""}, {.whole = 0}, name, name},
        {{.type = LG_FIELD_MAP, .group = "", .form = "keys"}, {.whole = 0}, "?", "it is good (keys)"},
        {{.type = LG_FIELD_PHRASE, .names = many, .group = "", .form = "words"}, {.whole = 0}, NULL, name},
        {{.type = LG_FIELD_PHRASE, .names = few, .group = "", .form = "words"},
         {.whole = 0},
         NULL,
         "(a, or words)"}};
    const lg_field plain = {.name = "plain", .type = LG_FIELD_NODE, .low = -1e308, .high = 1};
    const lg_field real = {.name = "real", .type = LG_FIELD_REAL, .size = 8, .low = -INFINITY, .high = 1};
    const lg_field list = {.name = "list", .type = LG_FIELD_REALS, .size = sizeof(lg_reals), .high = 1};
    double values[LG_FIELD_LIST_MAX], number = 0.5;
    lg_reals reals = {.count = 0};
    lg_error error;
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_field row = rows[i].row;
        char text[512];
        row.name = "field";
        row.meaning = "it is good";
        if (rows[i].shown != NULL) {
            lg_field_show(&row, &rows[i].member, text, sizeof text);
            assert_string_equal(text, rows[i].shown);
        }
        if (rows[i].described == NULL) {
            assert_int_equal(lg_field_whole(&row, &rows[i].member), rows[i].member.on);
            continue;
        }
        (void)lg_field_describe(&row, text, sizeof text);
        assert_says(text, rows[i].described);
    }
    assert_int_equal(lg_field_list(&plain, &number, values), 0);
    assert_int_equal(lg_field_whole(&real, &number), 0);
    assert_int_equal(lg_field_set(&plain, "1", &number, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "plain cannot be set");
    assert_int_equal(lg_field_set(&real, "2", &number, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "'2' is not a number of at most 1");
    assert_int_equal(lg_field_set(&list,
                                  "0.00000000000000000000000000000000000000000000000000000000000000000001",
                                  &reals, &error),
                     LG_INVALID_ARGUMENT);
    assert_true(number == 0.5 && reals.count == 0);
}
