/* Harnesses of text files and of words of the command line. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/app.h"
#include "control/policy.h"
#include "files/csv.h"
#include "files/frame.h"
#include "fuzz.h"
#include "liegrad/anomaly.h"
#include "liegrad/elastica.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/integrators.h"
#include "liegrad/machine.h"
#include "liegrad/mechanics.h"
#include "liegrad/settings.h"
#include "liegrad/table.h"
#include "settings/settings.h"
#include "table/files/recipe.h"
#include "nn/search.h"

/* ---- YAML ---- */

/* `links: 1000000` is a valid scene but takes a hundred times longer than others. Scenes with more than a
 * thousand links are left to the tests. */
static bool has_many_links(const uint8_t *data, size_t size) {
    static const char word[] = "links";
    for (const uint8_t *at = data, *end = data + size;; at++) {
        at = memmem(at, (size_t)(end - at), word, sizeof word - 1);
        if (at == NULL) return false;
        char text[24] = "";
        size_t used = 0;
        for (const uint8_t *p = at + sizeof word - 1; p < end && used + 1 < sizeof text && *p != '\n'; p++)
            if ((*p >= '0' && *p <= '9') || *p == '.' || *p == 'e' || *p == 'E' || *p == '+')
                text[used++] = (char)*p;
        text[used] = '\0';
        if (strtod(text, NULL) > 1000) return true;
    }
}

void fuzz_scene(const uint8_t *data, size_t size) {
    if (has_many_links(data, size)) return;
    lg_error error = {LG_OK, ""};
    lg_scene scene;
    const lg_status status = lg_scene_read(NULL, fuzz_file(data, size), NULL, &scene, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) lg_scene_destroy(&scene);
}

void fuzz_machine(const uint8_t *data, size_t size) {
    lg_error error = {LG_OK, ""};
    lg_machine_file file;
    const lg_status status =
        lg_machine_file_parse(NULL, "machine.yaml", (const char *)data, size, &file, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) lg_machine_file_destroy(&file);
}

void fuzz_scheme(const uint8_t *data, size_t size) {
    lg_error error = {LG_OK, ""};
    lg_scheme *scheme;
    const lg_status status = lg_scheme_read(NULL, fuzz_file(data, size), &scheme, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) lg_scheme_destroy(scheme);
}

void fuzz_grid(const uint8_t *data, size_t size) {
    if (has_many_links(data, size)) return;
    lg_error error = {LG_OK, ""};
    lg_grid grid;
    const lg_status status = lg_grid_read(NULL, fuzz_file(data, size), &grid, &error);
    fuzz_status(status, &error);
    if (status != LG_OK) return;
    if (grid.integrator_count == 0 || grid.n.count == 0 || grid.m.count == 0 || grid.eps.count == 0 ||
        grid.penalty.count == 0 || grid.substeps.count == 0 || grid.repeats == 0)
        abort();
    lg_grid_destroy(&grid);
}

void fuzz_search(const uint8_t *data, size_t size) {
    lg_error error = {LG_OK, ""};
    lg_search_file file;
    double value[LG_RANGE_MAX];
    const lg_status status = lg_search_file_read(NULL, fuzz_file(data, size), &file, &error);
    fuzz_status(status, &error);
    if (status != LG_OK) return;
    lg_search_draw(&file.space, 1, 0, value);
    for (size_t i = 0; i < file.space.count; i++)
        if (!isfinite(value[i])) abort();
}

/* Machines as lg-control describes them to the reader of a task. */
static const lg_policy_task plants[] = {
    {.coordinate_count = 3,
     .coordinate = {{.name = "x", .velocity = "vx"},
                    {.name = "phi", .velocity = "w", .motion = LG_POLICY_ANGLE},
                    {.name = "F_lag", .follows = 1}},
     .input_count = 2,
     .input = {{.name = "F"}, {.name = "u"}}},
    {.coordinate_count = 3,
     .coordinate = {{.name = "d", .velocity = "wd", .motion = LG_POLICY_DIRECTION},
                    {.name = "R", .velocity = "W", .motion = LG_POLICY_ROTATION},
                    {.name = "s"}},
     .input_count = 1,
     .input = {{.name = "u"}}}};

static void parse_task(const char *text, const lg_policy_task *plant) {
    enum { WIDEST = 32 };
    lg_error error = {LG_OK, ""};
    lg_policy *policy = lg_alloc(NULL, 1, sizeof *policy);
    if (policy == NULL) abort();
    lg_policy_task_init(&policy->task);
    lg_policy_task *task = &policy->task;
    task->coordinate_count = plant->coordinate_count;
    memcpy(task->coordinate, plant->coordinate, sizeof task->coordinate);
    task->input_count = plant->input_count;
    memcpy(task->input, plant->input, sizeof task->input);
    lg_status status = lg_policy_task_parse(NULL, "task.yaml", text, task, &error);
    fuzz_status(status, &error);
    for (uint32_t i = 0; i < task->hidden_layers; i++)
        if (task->hidden[i] > WIDEST) status = LG_UNSUPPORTED; /* is left to the tests */
    if (status == LG_OK) fuzz_status(lg_policy_prepare(policy, &error), &error);
    lg_policy_destroy(policy);
}

void fuzz_task(const uint8_t *data, size_t size) {
    lg_error error = {LG_OK, ""};
    lg_policy_task head;
    char plant[64], *text = NULL;
    const lg_status status =
        lg_policy_task_read(NULL, fuzz_file(data, size), &head, plant, sizeof plant, &text, &error);
    fuzz_status(status, &error);
    if (status != LG_OK) return;
    for (size_t i = 0; i < LG_COUNT(plants); i++) parse_task(text, &plants[i]);
    if (head.coordinate_count > 0) parse_task(text, &head);
    lg_free(NULL, text);
}

/* ---- tables of searches and studies, which commands resume ---- */

enum { TRIALS = 64 };

static void read_trials(const lg_search_file *search, const char *head, const uint8_t *data, size_t size) {
    static lg_trial trials[TRIALS];
    lg_error error = {LG_OK, ""};
    size_t count = 0;
    char text[LG_SEARCH_LABEL + 1024 + 4];
    const size_t before = strlen(head), length = size < 1024 ? size : 1024;
    memcpy(text, head, before);
    memcpy(text + before, data, length);
    const char *path = fuzz_file(text, before + length);
    const lg_status status = lg_trials_read(NULL, path, search, 1, NULL, TRIALS, trials, &count, &error);
    fuzz_status(status, &error);
    if (status == LG_OK && count > TRIALS) abort();
    for (size_t i = 0; status == LG_OK && i < count; i++)
        if (!lg_trial_is_possible(search, &trials[i])) abort();
}

void fuzz_trials(const uint8_t *data, size_t size) {
    static const lg_search_file search = {
        .space = {3,
                  {{.name = "lr", .kind = LG_RANGE_LOG_UNIFORM, .low = 1e-4, .high = 1},
                   {.name = "layers", .kind = LG_RANGE_INTEGER, .low = 0, .high = 4},
                   {.name = "kind", .kind = LG_RANGE_CHOICE, .choices = 2, .choice = {"mlp", "resnet"}}}}};
    char label[LG_SEARCH_LABEL], head[LG_SEARCH_LABEL + 4];
    lg_search_label(&search, 1, NULL, label); /* a fuzzer does not guess its hashes */
    (void)snprintf(head, sizeof head, "# %s\n", label);
    read_trials(&search, head, data, size);
}

static void mark(void *user, const lg_trial *trial, const char *column, char text[LG_RANGE_NAME]) {
    (void)snprintf(text, LG_RANGE_NAME, "%s", strcmp(column, "seed") == 0 ? "1" : "93850b707585");
}

void fuzz_study(const uint8_t *data, size_t size) {
    static const char *const columns[] = {"integrator", "substeps", "N",        "M",  "eps", "penalty",
                                          "repeat",     "seed",     "loss",     "E1", "E2",  "seconds",
                                          "epochs",     "status",   "protocol", NULL};
    static const char *const reports[] = {"loss", "E1", "E2"};
    static const lg_search_file study = {
        .space = {7,
                  {{.name = "repeat", .kind = LG_RANGE_INTEGER, .low = 1, .high = 2},
                   {.name = "eps", .kind = LG_RANGE_CHOICE, .choices = 1, .choice = {"2"}},
                   {.name = "N", .kind = LG_RANGE_CHOICE, .high = 1, .choices = 2, .choice = {"10", "20.5"}},
                   {.name = "M", .kind = LG_RANGE_CHOICE, .choices = 1, .choice = {"1"}},
                   {.name = "penalty", .kind = LG_RANGE_CHOICE, .choices = 1, .choice = {"3"}},
                   {.name = "substeps", .kind = LG_RANGE_CHOICE, .choices = 1, .choice = {"0"}},
                   {.name = "integrator",
                    .kind = LG_RANGE_CHOICE,
                    .high = 1,
                    .choices = 2,
                    .choice = {"cf4", "euler"}}}}};
    lg_trial_layout layout = {.what = "a study",
                              .columns = columns,
                              .report_names = reports,
                              .reports = LG_COUNT(reports),
                              .mark = mark};
    lg_search_file file = study;
    file.layout = &layout;
    read_trials(&file, "", data, size);
    lg_text_destroy(&layout.others);
}

/* ---- tables and logs ---- */

/* Reads rows in blocks: the first column as numbers, the second one as texts. */
static void read_frame(const char *path, const lg_table_names *names) {
    enum { WANTS = 3, BLOCK = 3 };
    const uint32_t second = names->count > 1;
    lg_frame_want want[WANTS] = {{.name = names->name[0], .as = LG_FRAME_TIME},
                                 {.name = names->name[second], .as = LG_FRAME_TEXT},
                                 {.name = "x", .optional = true}};
    lg_frame f = {.path = path, .what = "table", .want = want, .wants = WANTS};
    lg_error error = {LG_OK, ""};
    size_t before = 0;
    lg_status status = lg_frame_open(&f, &error);
    do {
        if (status == LG_OK) status = lg_frame_next(&f, BLOCK, &error);
        if (status == LG_OK && (f.rows > BLOCK || f.before != before)) abort();
        before += f.rows;
        for (size_t i = 0; i < f.rows && status == LG_OK; i++)
            if (memchr(lg_frame_text_of(&f, i, &want[1]), '\0', LG_FRAME_NAME) == NULL) abort();
    } while (status == LG_OK && f.rows > 0);
    fuzz_status(status, &error);
    lg_frame_close(&f);
}

/* The first columns are inputs, the last one is the class. */
void fuzz_read_table(const char *path) {
    lg_error error = {LG_OK, ""};
    lg_table_names names;
    lg_status status = lg_table_names_read(NULL, path, NULL, &names, &error);
    fuzz_status(status, &error);
    if (status != LG_OK) return;
    if (names.count > 0) {
        const char *columns[3];
        const uint32_t count = names.count < 3 ? names.count : 3;
        for (uint32_t i = 0; i < count; i++) columns[i] = names.name[i];
        lg_table_data table;
        status = lg_table_read(NULL, path, columns, count, count == 3 ? names.name[names.count - 1] : NULL,
                               NULL, &table, &error);
        fuzz_status(status, &error);
        if (status == LG_OK) {
            lg_table_data *const all = &table;
            (void)lg_table_keep_complete(&all, 1, NULL, &error);
            lg_table_data_destroy(&table);
        }
        read_frame(path, &names);
    }
    lg_table_names_destroy(&names);
}

void fuzz_table(const uint8_t *data, size_t size) {
    fuzz_read_table(fuzz_file(data, size));
}

/* The bytes follow the magic string of numpy. */
void fuzz_npy(const uint8_t *data, size_t size) {
    static const char magic[] = "\x93NUMPY";
    char bytes[4096];
    const size_t head = sizeof magic - 1;
    if (size > sizeof bytes - head) size = sizeof bytes - head;
    memcpy(bytes, magic, head);
    if (size > 0) memcpy(bytes + head, data, size);
    fuzz_read_table(fuzz_file(bytes, head + size));
}

void fuzz_tensors(const uint8_t *data, size_t size) {
    lg_error error = {LG_OK, ""};
    lg_tensors tensors;
    const lg_status status = lg_tensors_read(NULL, fuzz_file(data, size), &tensors, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) lg_tensors_destroy(&tensors);
}

/* Machines with one-letter column names, so that a few bytes can be a log. */
static const char *const machines[] = {
    "columns: {time: t, run: r}\ncoordinates:\n  - {name: x, kind: line, velocity: v}\n"
    "  - {name: a, kind: angle, velocity: w}\ninputs: {columns: [u], hold: cubic, delay: 2}\n"
    "measured: velocities\n",
    "columns: {time: t, max_step: 2}\ncoordinates:\n  - {name: a, kind: angle}\n  - {name: x, kind: line}\n"
    "inputs: {columns: [u]}\nmeasured: positions\nmass: {kind: constant}\n",
    "columns: {time: t}\ncoordinates:\n  - {name: d, kind: direction, columns: [a, b, c], velocity: [e, f, "
    "g]}\n"
    "measured: velocities\n",
    "columns: {time: t, run: r}\ncoordinates:\n"
    "  - {name: R, kind: rotation, columns: [a, b, c, d], velocity: [e, f, g]}\nmeasured: velocities\n"};

void fuzz_log(const uint8_t *data, size_t size) {
    static lg_machine_file machine[LG_COUNT(machines)];
    if (size == 0) return;
    lg_error error = {LG_OK, ""};
    lg_machine_file *of = &machine[data[0] % LG_COUNT(machines)];
    const char *text = machines[data[0] % LG_COUNT(machines)];
    if (of->column_count == 0 &&
        lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), of, &error) != LG_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        abort();
    }
    const char *paths[2] = {fuzz_file(data + 1, size - 1), NULL};
    paths[1] = paths[0];
    lg_logs logs;
    const lg_status status = lg_logs_read(NULL, of, paths, 1 + (data[0] >> 7), NULL, &logs, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) lg_logs_destroy(&logs);
}

/* ---- words of the command line ---- */

static void numbers(const char *text) {
    double real = 0.0, again = 0.0;
    uint64_t whole = 0, size = 0;
    if (lg_number_parse(text, &real) == LG_OK) {
        char shown[32];
        (void)snprintf(shown, sizeof shown, "%.17g", real);
        if (!isfinite(real) || lg_number_parse(shown, &again) != LG_OK || again != real) abort();
    }
    const bool is_whole = lg_integer_parse(text, &whole) == LG_OK;
    if (lg_integer_parse(text, &size) == LG_OK && (!is_whole || size != whole)) abort();
    (void)lg_number_parse(text, &real);
}

/* A list of names that is read must be written as a list of the same names. */
static void names(const char *text) {
    lg_table_names read, again;
    lg_table_text label;
    lg_text list = {.context = NULL};
    if (lg_table_names_parse(NULL, "inputs", text, &read, NULL) == LG_OK) {
        for (uint32_t i = 0; i < read.count; i++)
            lg_text_add(&list, "%s%s", i > 0 ? "," : "", lg_csv_quote(read.name[i]).text);
        if (lg_table_names_parse(NULL, "inputs", list.data, &again, NULL) != LG_OK ||
            again.count != read.count)
            abort();
        for (uint32_t i = 0; i < read.count; i++)
            if (strcmp(read.name[i], again.name[i]) != 0) abort();
        lg_table_names_destroy(&again);
        lg_text_destroy(&list);
    }
    lg_table_names_destroy(&read);
    (void)lg_table_class_parse(text, label, NULL);
}

/* A hyperparameter that is set must be shown as a text that sets the same value. */
static void hyperparameter(const lg_field *table, size_t at, void *run, const char *text) {
    static char shown[LG_FIELD_TEXT_SIZE], again[LG_FIELD_TEXT_SIZE];
    lg_error error = {LG_OK, ""};
    size_t rows = 0;
    while (table[rows].name != NULL) rows++;
    const lg_field *row = &table[at % rows];
    lg_fields_default(table, run);
    const lg_status status = lg_field_set(row, text, run, &error);
    fuzz_status(status, &error);
    if (status != LG_OK) return;
    lg_field_show(row, run, shown, sizeof shown);
    if (lg_field_set(row, shown, run, &error) != LG_OK) abort();
    lg_field_show(row, run, again, sizeof again);
    if (strcmp(shown, again) != 0) abort();
}

static void option(size_t at, const char *text) {
    typedef struct values {
        uint64_t size;
        double real;
        const char *text;
        int choice;
        lg_wholes sizes;
        lg_reals reals;
    } values;
    static const char *const choices[] = {"one", "two", NULL};
    static const lg_field options[] = {LG_OPTION(values, size, U64, "N", "", .high = 1e15),
                                       LG_OPTION(values, real, REAL, "X", "", .low = -1, .high = 1e9),
                                       LG_OPTION(values, text, STRING, "TEXT", ""),
                                       LG_OPTION(values, choice, NAME, NULL, "", .names = choices),
                                       LG_OPTION(values, sizes, WHOLES, "N,..", "", .low = 1, .high = 1e6),
                                       LG_OPTION(values, reals, REALS, "X,..", "", LG_ANY_REAL)};
    values to = {.size = 0};
    lg_error error = {LG_OK, ""};
    app_slot slot = {.row = &options[at % LG_COUNT(options)], .values = &to};
    fuzz_status(app_store(&slot, text, &error), &error);
}

/* The first two bytes choose the reader for the rest. */
void fuzz_options(const uint8_t *data, size_t size) {
    static lg_hamiltonian_run hamiltonian;
    static lg_surrogate_run surrogate;
    static lg_detector_run detector;
    static lg_table_run table;
    lg_fit_plan plan;
    lg_error error = {LG_OK, ""};
    if (size < 2) return;
    char *text = malloc(size - 1); /* exactly this size, so that sanitizers see accesses beyond it */
    if (text == NULL) abort();
    memcpy(text, data + 2, size - 2);
    text[size - 2] = '\0';
    switch (data[0] % 8) {
    case 0:
        numbers(text);
        break;
    case 1:
        names(text);
        break;
    case 2:
        option(data[1], text);
        break;
    case 3:
        fuzz_status(lg_fit_plan_parse(text, true, &plan, &error), &error);
        break;
    case 4:
        hyperparameter(lg_hamiltonian_fields, data[1], &hamiltonian, text);
        break;
    case 5:
        hyperparameter(lg_surrogate_fields, data[1], &surrogate, text);
        break;
    case 6:
        hyperparameter(lg_detector_fields, data[1], &detector, text);
        break;
    default:
        hyperparameter(lg_table_fields, data[1], &table, text);
    }
    free(text);
}
