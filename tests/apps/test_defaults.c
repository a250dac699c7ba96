/* Compares the defaults that --help prints with the hyperparameters that runs without options record, for
 * every field of every recipe. The record is the checkpoint of a run that stops after one epoch.
 * ctest-labels: apps/common src/settings src/model */
#include "identify_support.h"
#include "model/files/training.h"
#include "settings/training.h"

#include <hdf5.h>

/* Data that the presets and trainers treat differently, and options that choose another kind of model.
 * `adam`: how this program asks for Adam; NULL: the run does. */
static const struct learning {
    const char *recipe, *program, *verb, *data, *words, *adam;
} runs[] = {
    {"hamiltonian", "lg-hamiltonian", "train", "one.h5", "", "--optimizer adam"},
    {"hamiltonian", "lg-hamiltonian", "train", "three.h5", "", "--lr 1e-2"},
    {"hamiltonian", "lg-hamiltonian", "train", "quartic.h5", "", "--batch 10"},
    {"surrogate", "lg-elastica", "train", "beam.h5", "", "--optimizer adam"},
    {"surrogate", "lg-elastica", "train", "beam.h5", "--train-fraction 0.2", "--optimizer adam"},
    {"surrogate", "lg-elastica", "train", "beam.h5", "--train-fraction 0.4", "--optimizer adam"},
    {"surrogate", "lg-elastica", "train", "beam.h5", "--network continuous", "--optimizer adam"},
    {"surrogate", "lg-elastica", "train", "beam.h5", "--network angle", "--optimizer adam"},
    {"surrogate", "lg-elastica", "train", "beam.h5", "--network angle --boundary true", "--optimizer adam"},
    {"surrogate", "lg-elastica", "train", "beams.h5", "", "--optimizer adam"},
    {"surrogate", "lg-elastica", "train", "beam.h5", "--loss energy", NULL},
    {"detector", "lg-anomaly", "train", "well.h5", "", "--optimizer adam"},
    {"detector", "lg-anomaly", "train", "noisy.h5", "", "--optimizer adam"},
    {"detector", "lg-anomaly", "train", "series.h5", "", "--optimizer adam"},
    {"table", "lg-fit", "train", "table.csv", "--outputs y --without c", "--optimizer adam"},
    {"table", "lg-fit", "train", "table.csv", "--outputs y --without c --hidden 90,90", "--optimizer adam"},
    {"table", "lg-fit", "train", "table.csv", "--class c", "--optimizer adam"},
    {"machine_model", "lg-identify", "fit", "springs.yaml log.csv", "", "--optimizer adam"},
    {"machine_model", "lg-identify", "fit", "network.yaml log.csv", "", "--optimizer adam"},
};

/* What help says of an option: the default, and the default of --preset thesis, which holds if Adam is asked
 * for ("": the same). first: the first value of a run without options. */
typedef struct promise {
    char usual[256], adam[256], first[LG_FIELD_TEXT_SIZE];
    bool varies;
} promise;
enum { FIELDS = 64 };
static promise promises[FIELDS];

static int setup(void **state) {
    char table[1 << 16] = "a,b,y,c\n";
    if (cli_begin() != 0) return -1;
    cli_write("scene.yaml", "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\n");
    cli_write("scene3.yaml", "system: pendulum-chain\ngravity: 1\nmasses: [1, 1, 1]\nlengths: [1, 1, 1]\n");
    cli_write("quartic.yaml", "system: quartic\n");
    cli_write("generate.yaml", oscillator_scene);
    cli_write("springs.yaml", oscillator_machine);
    cli_write("network.yaml", OSCILLATOR_COLUMNS
              "mass: diagonal\npotential: {kind: network, of: x, hidden: [9, 9]}\ndamping: diagonal\n"
              "input_map: {kind: known, values: [[1]]}\n");
    for (int i = 0; i < 120; i++)
        (void)snprintf(table + strlen(table), 64, "%d,%d,%g,%s\n", i % 17, i * i % 23,
                       sin(i % 17) + i * i % 23, i % 17 > 8 ? "high" : "low");
    cli_write("table.csv", table);
    cli_run("lg-hamiltonian", "generate scene.yaml --trajectories 30 --out one.h5");
    cli_run("lg-hamiltonian", "generate scene3.yaml --trajectories 20 --out three.h5");
    cli_run("lg-hamiltonian", "generate quartic.yaml --trajectories 30 --out quartic.h5");
    cli_run("lg-elastica", "generate --case both-ends --count 15 --intervals 10 --out beam.h5");
    cli_run("lg-elastica", "generate --case both --count 12 --intervals 10 --out beams.h5");
    cli_run("lg-anomaly", "generate --runs 16 --hours 0.1 --noise 1 --window 30 --out well.h5");
    cli_run("lg-anomaly", "generate --runs 16 --hours 0.1 --noise 50 --window 30 --out noisy.h5");
    cli_run("lg-anomaly", "generate --runs 16 --hours 0.1 --noise 1 --window 30 --out series.h5");
    const hid_t file = H5Fopen(cli_at("series.h5"), H5F_ACC_RDWR, H5P_DEFAULT);
    assert_true(file >= 0 && H5Adelete(file, "noise") >= 0 && H5Fclose(file) >= 0); /* unknown noise */
    cli_run("lg-identify", "generate generate.yaml --runs 2 --t-end 4 --out log.csv");
    return setenv("ARGP_HELP_FMT", "rmargin=8000,opt-doc-col=60", 1);
}

/* Reads from --help what it says of the field's default. Returns false if it says nothing. */
static bool read_promise(const lg_field *row, promise *out) {
    char option[64], text[1024];
    lg_field_option(row, option, sizeof option);
    out->usual[0] = out->adam[0] = '\0';
    if (option[0] == '\0') return false;
    const char *line = strstr(result.out, test_text("  --%s=", option)), *end, *at = NULL;
    if (line == NULL) fail_msg("%s: --help does not name --%s", row->name, option);
    end = strchr(line, '\n');
    (void)snprintf(text, sizeof text, "%.*s", (int)(end - line), line);
    for (const char *next = text; (next = strstr(next, "default ")) != NULL; next += 8)
        if (next[-1] == '(' || strncmp(next - 2, "; ", 2) == 0) at = next + 8;
    if (at == NULL) return false;
    const char *adam = strstr(at, "; thesis: "), *close = strrchr(at, ')');
    assert_non_null(close);
    (void)snprintf(out->usual, sizeof out->usual, "%.*s", (int)((adam != NULL ? adam : close) - at), at);
    if (adam != NULL)
        (void)snprintf(out->adam, sizeof out->adam, "%.*s", (int)(close - adam - 10), adam + 10);
    return true;
}

/* A page of docs. */
static const char *page(const char *name) {
    enum { SIZE = 1 << 20 };
    char *text = lg_test_memory(SIZE);
    FILE *file = fopen(test_text("%s/../docs/%s", LG_TEST_DIR, name), "r");
    assert_non_null(file);
    text[fread(text, 1, SIZE - 1, file)] = '\0';
    assert_int_equal(fclose(file), 0);
    return text;
}

static bool is_chosen(const char *text) {
    return strncmp(text, LG_CHOSEN, strlen(LG_CHOSEN)) == 0;
}

/* Trains for an epoch and compares what the checkpoint has with the promises. */
static void compare(const struct learning *l, const lg_recipe *recipe, const char *program, const char *words,
                    bool adam) {
    char value[LG_FIELD_TEXT_SIZE], option[64];
    cli_forget("made.h5 made.h5.checkpoint");
    cli_run(program, "%s %s %s --stop-after 1 --out made.h5", l->verb, l->data, words);
    void *run = lg_test_memory(recipe->run_size);
    lg_file_reader *reader;
    assert_ok(lg_checkpoint_open(NULL, cli_at("made.h5.checkpoint"), NULL, recipe, run, &reader, NULL));
    lg_file_reader_destroy(reader);
    promise *p = promises;
    for (const lg_field *row = recipe->fields; row->name != NULL; row++, p++) {
        const char *said = adam && p->adam[0] != '\0' ? p->adam : p->usual;
        lg_field_option(row, option, sizeof option);
        if (said[0] == '\0' || strstr(words, test_text("--%s ", option)) != NULL) continue;
        lg_field_show(row, run, value, sizeof value);
        if (p->first[0] == '\0') (void)snprintf(p->first, sizeof p->first, "%s", value);
        p->varies = p->varies || strcmp(value, p->first) != 0;
        if (is_chosen(said) || strcmp(said, value) == 0) continue;
        fail_msg("%s %s %s %s: --help says default %s of --%s, the run has %s", program, l->verb, l->data,
                 words, said, option, value);
    }
}

TEST("a run without options has the defaults that help prints") {
    for (const lg_recipe *const *recipe = lg_recipes; *recipe != NULL; recipe++) {
        size_t found = 0, fixed = 0;
        for (int learn = 0; learn < 2; learn++)
            for (const struct learning *l = runs; l < runs + LG_COUNT(runs); l++) {
                const bool first = l == runs || strcmp(l->recipe, l[-1].recipe) != 0;
                if (strcmp(l->recipe, (*recipe)->name) != 0 || (learn && !first)) continue;
                const char *program = learn ? "lg-learn" : l->program;
                struct learning own = *l;
                own.verb = learn ? test_text("train --recipe %s", l->recipe) : l->verb;
                promise *p = promises;
                if (first) cli_run(program, "%s --help-all", own.verb);
                if (found == 0) memset(promises, 0, sizeof promises);
                for (const lg_field *row = (*recipe)->fields; first && row->name != NULL; row++, p++) {
                    assert_true(p < promises + FIELDS);
                    fixed += read_promise(row, p) && !is_chosen(p->usual);
                }
                compare(&own, *recipe, program, l->words, false);
                if (l->adam != NULL)
                    compare(&own, *recipe, program, test_text("%s %s", l->words, l->adam), true);
                if (l->adam != NULL && (*recipe)->trainer->presets)
                    compare(&own, *recipe, program, test_text("%s --preset best --optimizer adam", l->words),
                            false);
                found++;
            }
        if (found == 0) fail_msg("no run tests the recipe %s", (*recipe)->name);
        assert_true(fixed > 0);
        /* What help says to be chosen does differ between runs, where no sentence says how it is chosen. */
        const promise *p = promises;
        for (const lg_field *row = (*recipe)->fields; row->name != NULL; row++, p++)
            if (strcmp(p->usual, LG_CHOSEN) == 0 && !p->varies)
                fail_msg("%s: help says that data and model choose %s, all runs have %s", (*recipe)->name,
                         row->name, p->first);
    }
}

/* Compares the options in the first span of code of a line such as "| `best` | `--hidden 20,20`; ..." with a
 * run of this preset. Returns how many options the span has. */
static size_t compare_line(const char *line, const char *preset, const lg_recipe *recipe, const void *run) {
    static char wanted[LG_FIELD_TEXT_SIZE], value[LG_FIELD_TEXT_SIZE];
    size_t count = 0;
    char *span = test_text("%.*s", (int)strcspn(line, "`"), line), *save = NULL;
    for (char *word = strtok_r(span, " ", &save); word != NULL; word = strtok_r(NULL, " ", &save), count++) {
        const lg_field *row = strncmp(word, "--", 2) == 0 ? lg_field_find(recipe->fields, word + 2) : NULL;
        const char *text = strtok_r(NULL, " ", &save);
        void *said = lg_test_memory(recipe->run_size);
        if (row == NULL || text == NULL) fail_msg("preset %s: there is no option '%s'", preset, word);
        assert_ok(lg_field_set(row, text, said, NULL));
        lg_field_show(row, said, wanted, sizeof wanted);
        lg_field_show(row, run, value, sizeof value);
        if (strcmp(wanted, value) != 0)
            fail_msg("docs: preset %s: %s %s; the run has %s", preset, word, text, value);
    }
    return count;
}

/* The defaults of the fields, which grids of studies take, are those of a run by --preset thesis. */
static void compare_fields(const lg_recipe *recipe, const void *run) {
    char wanted[LG_FIELD_TEXT_SIZE], value[LG_FIELD_TEXT_SIZE];
    void *fields = lg_test_memory(recipe->run_size);
    lg_fields_default(recipe->fields, fields);
    for (const lg_field *row = recipe->fields; row->name != NULL; row++) {
        if (row->value == NULL) continue;
        lg_field_show(row, fields, wanted, sizeof wanted);
        lg_field_show(row, run, value, sizeof value);
        if (strcmp(wanted, value) != 0)
            fail_msg("%s: --preset thesis has %s, the field %s", row->name, value, wanted);
    }
}

TEST("the tables of presets in docs have the values of runs, and grids those of thesis") {
    static const char *const pages[] = {"hamiltonians.md", "reports/accuracy.md"};
    const lg_recipe *recipe = lg_recipe_find("hamiltonian");
    size_t found = 0;
    for (uint32_t i = 0; lg_preset_name(i) != NULL; i++) {
        const char *preset = lg_preset_name(i), *begin = test_text("\n| `%s` | `--", preset);
        lg_file_reader *reader;
        void *run = lg_test_memory(recipe->run_size);
        cli_forget("made.h5 made.h5.checkpoint");
        cli_run("lg-hamiltonian", "train one.h5 --preset %s --stop-after 1 --out made.h5", preset);
        assert_ok(lg_checkpoint_open(NULL, cli_at("made.h5.checkpoint"), NULL, recipe, run, &reader, NULL));
        lg_file_reader_destroy(reader);
        if (strcmp(preset, "thesis") == 0) compare_fields(recipe, run);
        for (size_t k = 0; k < LG_COUNT(pages); k++) {
            const char *text = page(pages[k]), *line = strstr(text, begin);
            if (line == NULL) fail_msg("%s has no table of presets", pages[k]);
            found += compare_line(line + strlen(begin) - 2, preset, recipe, run);
        }
    }
    assert_true(found > 10);
}

TEST_GROUP(setup, cli_end)
