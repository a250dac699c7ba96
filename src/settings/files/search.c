/* Files of a search: ranges in YAML, trials in CSV. */
#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "files/csv.h"
#include "files/frame.h"
#include "files/h5.h"
#include "files/read_file.h"
#include "settings/files/yaml.h"
#include "settings/settings.h"

/* ---- ranges ---- */

enum { KEY_FIXED, KEY_RANGES, KEY_COUNT };
/* Both values are mappings whose keys are names of options. No table of fields lists these, so they are read
 * as nodes. */
static const lg_field keys[KEY_COUNT] = {
    [KEY_FIXED] = LG_NODE("fixed"),
    [KEY_RANGES] = LG_NODE("ranges", .required = true),
};

static const char *const kind_names[] = {[LG_RANGE_UNIFORM] = "uniform",
                                         [LG_RANGE_LOG_UNIFORM] = "log-uniform",
                                         [LG_RANGE_INTEGER] = "integer",
                                         [LG_RANGE_CHOICE] = "choice"};

typedef struct reading {
    lg_yaml *yaml;
    lg_search_file *out;
    lg_error *error;
} reading;

static size_t pairs_of(const yaml_node_t *map) {
    return (size_t)(map->data.mapping.pairs.top - map->data.mapping.pairs.start);
}

/* Copies a scalar that is shorter than `size` and contains no zero byte. Returns false for other nodes and
 * for an empty scalar. */
static bool copy_text(const yaml_node_t *node, char *out, size_t size) {
    const char *text = lg_node_text(node, size);
    if (text == NULL || text[0] == '\0') return false;
    memcpy(out, text, strlen(text) + 1);
    return true;
}

/* Copies a value: a scalar, or the scalars of a list, separated by commas. */
static bool copy_value(const reading *r, const yaml_node_t *node, char *out, size_t size) {
    const size_t count = node->type == YAML_SEQUENCE_NODE ? lg_node_length(node) : 1;
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        if (i > 0) out[used++] = ',';
        if (!copy_text(lg_node_item(r->yaml, node, i), out + used, size - used)) return false;
        used += strlen(out + used);
    }
    return count > 0;
}

/* Copies the name of an option: letters, digits, - and _, beginning with a letter. */
static bool copy_name(const yaml_node_t *node, char out[LG_RANGE_NAME]) {
    if (!copy_text(node, out, LG_RANGE_NAME)) return false;
    for (const char *c = out; *c != '\0'; c++) {
        const bool letter = (*c >= 'a' && *c <= 'z') || (*c >= 'A' && *c <= 'Z');
        const bool other = (*c >= '0' && *c <= '9') || *c == '-' || *c == '_';
        if (!letter && (c == out || !other)) return false;
    }
    return true;
}

/* Returns the line of an earlier entry with this name, or 0 if the name is new. */
static uint32_t seen(const lg_search_file *file, const char *name) {
    for (size_t i = 0; i < file->fixed_count; i++)
        if (strcmp(file->fixed_name[i], name) == 0) return file->fixed_line[i];
    for (size_t i = 0; i < file->space.count; i++)
        if (strcmp(file->space.ranges[i].name, name) == 0) return file->line[i];
    return 0;
}

/* Reads the name of the next entry. `count` is the number of entries so far. */
static lg_status read_key(const reading *r, const yaml_node_t *node, size_t count, char name[LG_RANGE_NAME]) {
    if (count == LG_RANGE_MAX)
        return LG_FAIL_AT(r->yaml, node, r->error, "there are more than %d entries", LG_RANGE_MAX);
    if (!copy_name(node, name))
        return LG_FAIL_AT(r->yaml, node, r->error,
                          "the name of an option is expected: up to %d letters, digits, - and _",
                          LG_RANGE_NAME - 1);
    const uint32_t line = seen(r->out, name);
    if (line == 0) return LG_OK;
    return LG_FAIL_AT(r->yaml, node, r->error, "'%s' stands twice, first on line %u", name, line);
}

static lg_status read_fixed(const reading *r, const char name[LG_RANGE_NAME], const yaml_node_t *value) {
    lg_search_file *out = r->out;
    const size_t i = out->fixed_count;
    if (!copy_value(r, value, out->fixed_value[i], LG_SEARCH_FIXED_TEXT))
        return LG_FAIL_AT(r->yaml, value, r->error, "%s: a value of 1 to %d bytes is expected", name,
                          LG_SEARCH_FIXED_TEXT - 1);
    memcpy(out->fixed_name[i], name, LG_RANGE_NAME);
    out->fixed_line[i] = lg_node_line(value);
    out->fixed_count++;
    return LG_OK;
}

static lg_status read_choices(const reading *r, const yaml_node_t *list, lg_range *range) {
    if (list->type != YAML_SEQUENCE_NODE)
        return LG_FAIL_AT(r->yaml, list, r->error, "%s: a list is expected", range->name);
    for (size_t i = 0; i < lg_node_length(list); i++) {
        const yaml_node_t *node = lg_node_item(r->yaml, list, i);
        if (range->choices == LG_RANGE_MAX_CHOICES)
            return LG_FAIL_AT(r->yaml, node, r->error, "%s: there are more than %d choices", range->name,
                              LG_RANGE_MAX_CHOICES);
        if (!copy_value(r, node, range->choice[range->choices], LG_RANGE_NAME))
            return LG_FAIL_AT(r->yaml, node, r->error, "%s: a choice of 1 to %d bytes is expected",
                              range->name, LG_RANGE_NAME - 1);
        range->choices++;
    }
    return LG_OK;
}

static lg_status read_bounds(const reading *r, const yaml_node_t *list, lg_range *range) {
    const lg_field key = {.name = range->name, .type = LG_FIELD_NODE, .low = -DBL_MAX, .high = DBL_MAX};
    const lg_key_value value = {.line = lg_node_line(list), .node = list};
    double bounds[2] = {0, 0};
    LG_TRY(lg_yaml_block(r->yaml, &key, &value, (const size_t[3]){2, 1, 1}, bounds, NULL, r->error));
    range->low = bounds[0];
    range->high = bounds[1];
    return LG_OK;
}

/* Reads what a range of the form {KIND: [...]} has. */
static lg_status read_kind(const reading *r, const yaml_node_t *node, lg_range *range) {
    char kind[LG_RANGE_NAME] = "";
    const bool one = node->type == YAML_MAPPING_NODE && pairs_of(node) == 1;
    const yaml_node_pair_t *pair = one ? node->data.mapping.pairs.start : NULL;
    const bool named = one && copy_text(lg_node_at(r->yaml, pair->key), kind, sizeof kind);
    for (size_t i = 0; named && i < LG_COUNT(kind_names); i++) {
        if (strcmp(kind, kind_names[i]) != 0) continue;
        const yaml_node_t *list = lg_node_at(r->yaml, pair->value);
        range->kind = (lg_range_kind)i;
        return range->kind == LG_RANGE_CHOICE ? read_choices(r, list, range) : read_bounds(r, list, range);
    }
    return LG_FAIL_AT(r->yaml, node, r->error,
                      "%s: one of {uniform: [low, high]}, {log-uniform: [low, high]}, {integer: [low, "
                      "high]}, {choice: [...]} is expected",
                      range->name);
}

static lg_status read_range(const reading *r, const char name[LG_RANGE_NAME], const yaml_node_t *value) {
    lg_search_space *space = &r->out->space;
    lg_range *range = &space->ranges[space->count];
    lg_error inner = {LG_OK, ""};
    memcpy(range->name, name, LG_RANGE_NAME);
    LG_TRY(read_kind(r, value, range));
    r->out->line[space->count++] = lg_node_line(value);
    if (lg_search_space_check(space, &inner) == LG_OK) return LG_OK;
    return LG_FAIL_AT(r->yaml, value, r->error, "%s", inner.message);
}

static lg_status read_file(lg_yaml *yaml, lg_search_file *out, lg_error *error) {
    lg_key_value values[KEY_COUNT] = {{.line = 0}};
    const lg_key_set set = {keys, KEY_COUNT, values};
    const reading r = {yaml, out, error};
    LG_TRY(lg_yaml_read(yaml, &set, 1, NULL, "", error));
    for (int i = 0; i < KEY_COUNT; i++) {
        const yaml_node_t *node = values[i].node;
        if (values[i].line == 0) continue;
        if (node->type != YAML_MAPPING_NODE || (i == KEY_RANGES && pairs_of(node) == 0))
            return lg_yaml_fail(yaml, values[i].line, LG_FORMAT, error,
                                "%s: names of options with their %s are expected", keys[i].name,
                                i == KEY_FIXED ? "values" : "ranges");
        for (const yaml_node_pair_t *pair = node->data.mapping.pairs.start;
             pair < node->data.mapping.pairs.top; pair++) {
            char name[LG_RANGE_NAME] = "";
            const size_t count = i == KEY_FIXED ? out->fixed_count : out->space.count;
            LG_TRY(read_key(&r, lg_node_at(yaml, pair->key), count, name));
            LG_TRY((i == KEY_FIXED ? read_fixed : read_range)(&r, name, lg_node_at(yaml, pair->value)));
        }
    }
    return LG_OK;
}

lg_status lg_search_file_read(const lg_context *context, const char *path, lg_search_file *out,
                              lg_error *error) {
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    if (out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "`out` is NULL");
    LG_TRY(lg_yaml_open(context, path, &yaml, error));
    LG_SCRATCH(lg_search_file, made, context, 1);
    if (made == NULL) return lg_no_memory_for(path, error);
    LG_TRY(read_file(yaml, made, error));
    *out = *made;
    return LG_OK;
}

/* ---- hashes that tie a table of trials to its search ---- */

#define HASH_DIGITS 16

static void hash_line(lg_sha256 *sha, const char *format, ...) {
    char line[256];
    va_list arguments;
    va_start(arguments, format);
    (void)lg_format_list(line, sizeof line, format, arguments);
    va_end(arguments);
    lg_sha256_add(sha, line, strlen(line) + 1);
}

/* The hash of the ranges, and the hash of the fixed options and of `setting`. */
static void hash_search(const lg_search_file *search, const char *setting, char out[2][HASH_DIGITS + 1]) {
    lg_sha256 sha[2];
    char text[LG_SHA256_TEXT];
    for (int i = 0; i < 2; i++) lg_sha256_init(&sha[i]);
    for (size_t i = 0; i < search->space.count; i++) {
        const lg_range *range = &search->space.ranges[i];
        const bool choice = range->kind == LG_RANGE_CHOICE;
        hash_line(&sha[0], "%s %s", range->name, kind_names[range->kind]);
        if (!choice) hash_line(&sha[0], "%.17g %.17g", range->low + 0.0, range->high + 0.0); /* -0 is 0 */
        for (uint32_t k = 0; choice && k < range->choices; k++) hash_line(&sha[0], "%s", range->choice[k]);
    }
    for (size_t i = 0; i < search->fixed_count; i++)
        hash_line(&sha[1], "%s %s", search->fixed_name[i], search->fixed_value[i]);
    if (setting != NULL) lg_sha256_add(&sha[1], setting, strlen(setting));
    for (int i = 0; i < 2; i++) {
        lg_sha256_finish(&sha[i], text);
        (void)snprintf(out[i], HASH_DIGITS + 1, "%.*s", HASH_DIGITS, text);
    }
}

static lg_status check_search(const lg_search_file *search, lg_error *error) {
    if (search == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "the search is NULL");
    if (search->fixed_count > LG_RANGE_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "more than %d fixed options", LG_RANGE_MAX);
    for (size_t i = 0; i < search->fixed_count; i++)
        if (memchr(search->fixed_name[i], '\0', LG_RANGE_NAME) == NULL ||
            memchr(search->fixed_value[i], '\0', LG_SEARCH_FIXED_TEXT) == NULL)
            return lg_fail(error, LG_INVALID_ARGUMENT, "fixed option %zu is too long", i + 1);
    return lg_search_space_check(&search->space, error);
}

/* ---- a trial's value in its range ---- */

static bool in_range(const lg_range *range, double x) {
    if (range->kind >= LG_RANGE_INTEGER && floor(x) != x) return false;
    if (range->kind == LG_RANGE_CHOICE) return x >= 0 && x < range->choices;
    return x >= range->low && x <= range->high; /* false for NaN */
}

bool lg_trial_is_possible(const lg_search_file *search, const lg_trial *trial) {
    const lg_search_space *space = &search->space;
    bool good = (uint32_t)trial->state < LG_TRIAL_STATE_COUNT && trial->reports <= LG_TRIAL_REPORTS &&
                (trial->state != LG_TRIAL_DONE || search->layout == NULL ||
                 trial->reports >= search->layout->reports);
    for (size_t k = 0; good && k < space->count; k++) good = in_range(&space->ranges[k], trial->value[k]);
    return good;
}

/* ---- columns ---- */

static const char *state_name(uint32_t state) {
    return lg_trial_state_name((lg_trial_state)state);
}

/* The fields of a trial that can be columns; tables of searches have the first FIELDS. Real numbers may be
 * nan or infinite. */
#define COLUMN(name, type, ...) LG_FIELD(lg_trial, NULL, name, type, __VA_ARGS__)
static const lg_field fields[] = {COLUMN("trial", U64, number, .high = 0x1p64),
                                  COLUMN("state", NAME, state, LG_NAMED(state_name, LG_TRIAL_STATE_COUNT)),
                                  COLUMN("objective", REAL, objective),
                                  COLUMN("parameters", U64, parameters, .high = 0x1p64),
                                  COLUMN("epochs", U64, epochs, .high = 0x1p64),
                                  COLUMN("seconds", REAL, seconds),
                                  COLUMN("status", NAME, state, LG_NAMES("ok", "pruned", "failed")),
                                  LG_FIELD_END};
#undef COLUMN

enum { FIELDS = 6, NAME = LG_RANGE_NAME + 8, MOST = FIELDS + LG_RANGE_MAX + LG_TRIAL_REPORTS };

typedef struct column {
    char name[NAME];
    const lg_field *field; /* of a trial; NULL: the column is not a field */
    size_t range, report;  /* index of the range or report plus 1; 0: the column is not one */
} column;

/* Finds the column with this name. A field comes before a range, whose column is then option-NAME. */
static column find_column(const lg_search_file *search, const char *name) {
    column out = {.field = lg_field_find(fields, name)};
    (void)snprintf(out.name, NAME, "%s", name);
    if (out.field != NULL) return out;
    for (size_t i = 0; i < search->space.count; i++)
        if (strcmp(search->space.ranges[i].name, name) == 0) out.range = i + 1;
    for (size_t i = 0; i < search->layout->reports; i++)
        if (strcmp(search->layout->report_names[i], name) == 0) out.report = i + 1;
    return out;
}

/* Lists the columns. The table of a search has a column for each of `rungs` rungs. */
static size_t list_columns(const lg_search_file *search, uint32_t rungs, column out[MOST]) {
    const lg_trial_layout *layout = search->layout;
    size_t n = 0;
    for (; layout != NULL && layout->columns[n] != NULL; n++)
        out[n] = find_column(search, layout->columns[n]);
    if (layout != NULL) return n;
    for (; n < FIELDS; n++) out[n] = find_column(search, fields[n].name);
    for (size_t i = 0; i < search->space.count; i++, n++) {
        const char *name = search->space.ranges[i].name;
        out[n] = (column){.range = i + 1};
        (void)snprintf(out[n].name, NAME, "%s%s", lg_field_find(fields, name) != NULL ? "option-" : "", name);
    }
    for (uint32_t i = 1; i <= rungs; i++, n++) {
        out[n] = (column){.report = i};
        (void)snprintf(out[n].name, NAME, "rung%u", i);
    }
    return n;
}

/* ---- writing ---- */

void lg_search_label(const lg_search_file *search, uint64_t seed, const char *setting,
                     char label[LG_SEARCH_LABEL]) {
    char hash[2][HASH_DIGITS + 1];
    hash_search(search, setting, hash);
    (void)snprintf(label, LG_SEARCH_LABEL, LG_SEARCH_SEED "%" PRIu64 " space %s setting %s", seed, hash[0],
                   hash[1]);
}

static void add_cell(lg_columns *to, const lg_search_file *search, const column *c, const lg_trial *trial) {
    const size_t i = c->range > 0 ? c->range - 1 : 0;
    const lg_range *range = &search->space.ranges[i];
    char text[LG_RANGE_NAME];
    if (c->report > trial->reports)
        lg_columns_empty(to);
    else if (c->report > 0)
        lg_columns_number(to, trial->report[c->report - 1]);
    else if (c->range > 0 && range->kind == LG_RANGE_CHOICE)
        lg_columns_text(to, range->choice[(size_t)trial->value[i]]);
    else if (c->range > 0)
        lg_columns_number(to, trial->value[i]);
    else if (c->field != NULL && c->field->type == LG_FIELD_REAL)
        lg_columns_number(to, lg_field_number(c->field, trial));
    else {
        c->field == NULL ? search->layout->mark(search->layout->user, trial, c->name, text)
                         : lg_field_show(c->field, trial, text, sizeof text);
        lg_columns_text(to, text);
    }
}

lg_status lg_trials_write(const lg_context *context, const char *path, const lg_search_file *search,
                          uint64_t seed, const char *setting, const lg_trial *trials, size_t count,
                          lg_error *error) {
    column columns[MOST];
    char label[LG_SEARCH_LABEL];
    if (path == NULL || (trials == NULL && count > 0))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the file's name or the trials are NULL");
    LG_TRY(check_search(search, error));
    uint32_t reports = 0;
    for (size_t i = 0; i < count; i++) {
        if (!lg_trial_is_possible(search, &trials[i]) || (i > 0 && trials[i].number <= trials[i - 1].number))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "trial %" PRIu64 " does not come after the trial before it, or its state, a value "
                           "or its number of reports is not possible",
                           trials[i].number);
        if (trials[i].reports > reports) reports = trials[i].reports;
    }
    lg_columns t = {.text = {.context = context}, .words = true};
    const size_t n = list_columns(search, reports, columns);
    lg_search_label(search, seed, setting, label);
    if (search->layout == NULL) lg_text_add(&t.text, "# %s\n", label);
    for (size_t i = 0; i < n; i++) lg_columns_name(&t, columns[i].name);
    lg_columns_end(&t);
    for (size_t k = 0; k < count; k++) {
        for (size_t i = 0; i < n; i++) add_cell(&t, search, &columns[i], &trials[k]);
        lg_columns_end(&t);
    }
    if (search->layout != NULL) lg_text_join(&t.text, &search->layout->others);
    return lg_columns_write(&t, context, path, error);
}

/* ---- reading ---- */

/* Reads a number as lg_columns_number writes it. */
static bool parse_number(const char *cell, double *out) {
    static const char *const words[] = {"nan", "inf", "-inf"};
    static const double values[] = {NAN, INFINITY, -INFINITY, 0};
    size_t i = 0;
    while (i < LG_COUNT(words) && strcmp(cell, words[i]) != 0) i++;
    *out = values[i];
    return i < LG_COUNT(words) || lg_number_parse(cell, out) == LG_OK;
}

static bool parse_value(const lg_range *range, const char *cell, double *out) {
    uint32_t i = 0;
    if (range->kind != LG_RANGE_CHOICE) return lg_number_parse(cell, out) == LG_OK && in_range(range, *out);
    while (i < range->choices && strcmp(cell, range->choice[i]) != 0) i++;
    *out = i;
    return i < range->choices;
}

/* Checks the first line, `# seed S space HASH setting HASH`, and that the search is the same. */
static lg_status check_head(const char *head, const char *shown, const lg_search_file *search, uint64_t seed,
                            const char *setting, lg_error *error) {
    char want[2][HASH_DIGITS + 1], seen[2][HASH_DIGITS + 1], seen_seed[24];
    uint64_t number = 0;
    int end = 0;
    hash_search(search, setting, want);
    if (strncmp(head, "\xef\xbb\xbf", 3) == 0) head += 3; /* a byte order mark, which spreadsheets add */
    if (sscanf(head, "# seed %20[0-9] space %16[0-9a-f] setting %16[0-9a-f]%n", seen_seed, seen[0], seen[1],
               &end) != 3 ||
        head[end + strspn(head + end, "\r")] != '\n' || lg_integer_parse(seen_seed, &number) != LG_OK)
        return lg_fail(error, LG_FORMAT, "%s: line 1: '# seed S space HASH setting HASH' is expected", shown);
    if (number != seed)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%s: the trials were made with seed %" PRIu64 ", not %" PRIu64, shown, number, seed);
    for (int i = 0; i < 2; i++)
        if (strcmp(seen[i], want[i]) != 0)
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: the trials were made with other %s", shown,
                           i == 0 ? "ranges" : "fixed options or settings, or from other data");
    return LG_OK;
}

/* Reads the value of a range in the table of a study, which may have values of other grids. *inside becomes
 * false if the value is not in the range. Returns false if the cell must be a number and is none. */
static bool read_value(const lg_range *range, const char *cell, double *out, bool *inside) {
    char text[LG_SHORTEST];
    const bool number = lg_number_parse(cell, out) == LG_OK;
    if (number) lg_format_shortest(text, *out + 0.0, false); /* -0 is 0 */
    *inside = parse_value(range, number ? text : cell, out) && *inside;
    return number || (range->kind == LG_RANGE_CHOICE && !lg_is_decimal(range->choice[0]));
}

static bool parse_cell(const lg_search_file *search, const column *c, const char *cell, lg_trial *trial,
                       bool *inside) {
    if (c->range > 0) {
        const lg_range *range = &search->space.ranges[c->range - 1];
        double *value = &trial->value[c->range - 1];
        return search->layout != NULL ? read_value(range, cell, value, inside)
                                      : parse_value(range, cell, value);
    }
    if (c->field != NULL && c->field->type == LG_FIELD_REAL)
        return parse_number(cell, (double *)((char *)trial + c->field->offset));
    if (c->field != NULL) return lg_field_set(c->field, cell, trial, NULL) == LG_OK;
    /* the trial did not get this far */
    if (*cell == '\0' || (search->layout != NULL && trial->reports < c->report - 1)) return true;
    return trial->reports++ == c->report - 1 && parse_number(cell, &trial->report[c->report - 1]);
}

static lg_status read_cell(const lg_frame *f, size_t row, const lg_search_file *search, const column *c,
                           char *cell, lg_trial *trial, bool *inside, lg_error *error) {
    const lg_trial_layout *layout = search->layout;
    char text[LG_RANGE_NAME];
    double seen = 0, own = NAN;
    if (layout != NULL && *cell == '\0' && c->report == 0)
        return lg_frame_fail(f, row, c->name, error, "is empty");
    if (c->field == NULL && c->range == 0 && c->report == 0) {
        layout->mark(layout->user, trial, c->name, text);
        (void)lg_number_parse(cell, &seen);
        (void)lg_number_parse(text, &own);
        /* spreadsheets keep 15 digits of a seed */
        if (strcmp(cell, text) == 0 || fabs(seen - own) < 1e-14 * own) return LG_OK;
        return lg_frame_fail(f, row, c->name, error, "the row belongs to %s with other settings (%s, not %s)",
                             layout->what, lg_tamed(cell), text);
    }
    if (parse_cell(search, c, cell, trial, inside)) return LG_OK;
    if (layout != NULL && c->range > 0)
        return lg_frame_fail(f, row, c->name, error, "'%s' is not a number: remove the row", lg_tamed(cell));
    return lg_frame_fail(f, row, c->name, error, "'%s' is not what %s writes here: remove the row",
                         lg_tamed(cell), layout != NULL ? layout->what : "a search");
}

/* Keeps the text of a row that belongs to no trial. */
static void keep_row(lg_trial_layout *layout, const lg_frame *f, size_t row) {
    lg_columns to = {.text = layout->others};
    for (size_t i = 0; i < f->texts; i++) {
        const char *cell = f->text[row * f->texts + i];
        *cell == '\0' ? lg_columns_empty(&to) : lg_columns_text(&to, cell);
    }
    lg_columns_end(&to);
    layout->others = to.text;
    layout->other_rows++;
}

/* Returns the index of a trial in the grid of all values of the ranges. The last range varies fastest. */
static uint64_t point_of(const lg_search_space *space, const double *value) {
    uint64_t number = 0;
    for (const lg_range *range = space->ranges; range < space->ranges + space->count; range++)
        number = number * (uint64_t)(range->high - range->low + 1) + (uint64_t)(*value++ - range->low);
    return number;
}

static lg_status read_trial(const lg_frame *f, size_t row, const lg_search_file *search,
                            const column *columns, lg_trial *trials, size_t *count, lg_error *error) {
    lg_trial *trial = &trials[*count];
    bool fresh = true; /* a trial that is not in the table yet */
    *trial = (lg_trial){.number = 0};
    for (size_t i = 0; i < f->texts; i++)
        LG_TRY(read_cell(f, row, search, &columns[i], f->text[row * f->texts + i], trial, &fresh, error));
    if (fresh && search->layout != NULL) trial->number = point_of(&search->space, trial->value);
    if (fresh && !lg_trial_is_possible(search, trial)) return LG_OK;
    for (size_t i = 0; fresh && i < *count; i++) fresh = trials[i].number != trial->number;
    *count += fresh;
    if (!fresh && search->layout == NULL)
        return lg_frame_fail(f, row, "trial", error, "%s is in the table already", f->text[row * f->texts]);
    if (!fresh) keep_row(search->layout, f, row);
    return LG_OK;
}

static lg_status read_table(lg_frame *f, const lg_search_file *search, lg_trial *trials, size_t room,
                            size_t *count, lg_error *error) {
    enum { BLOCK = 256 };
    column columns[MOST];
    lg_frame_want want[MOST];
    f->want = want;
    f->wants = list_columns(search, LG_TRIAL_REPORTS, columns);
    for (size_t i = 0; i < f->wants; i++)
        want[i] = (lg_frame_want){.name = columns[i].name,
                                  .as = LG_FRAME_CELL,
                                  .optional = search->layout == NULL && columns[i].report > 0};
    LG_TRY(lg_frame_open(f, error));
    if (search->layout != NULL && f->header > 1)
        return lg_frame_fail(f, 0, NULL, error, "comes after other lines: remove them");
    do {
        LG_TRY(lg_frame_next(f, BLOCK, error));
        if (search->layout == NULL && f->rows > room - *count)
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: holds more than the %zu trials that fit",
                           f->shown, room);
        for (size_t row = 0; row < f->rows; row++)
            LG_TRY(read_trial(f, row, search, columns, trials, count, error));
    } while (f->rows > 0);
    return LG_OK;
}

lg_status lg_trials_read(const lg_context *context, const char *path, const lg_search_file *search,
                         uint64_t seed, const char *setting, size_t room, lg_trial *trials, size_t *count,
                         lg_error *error) {
    char first[4096] = "", what[LG_RANGE_NAME];
    size_t found = 0, got = 0;
    if (path == NULL || *path == '\0' || count == NULL || (trials == NULL && room > 0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the file's name is missing, or the memory for its trials is NULL");
    LG_TRY(check_search(search, error));
    (void)snprintf(what, sizeof what, "table of %s",
                   search->layout != NULL ? search->layout->what : "trials");
    LG_CLEAN(lg_frame_close)
    lg_frame f = {.context = context, .path = path, .what = what, .ours = true};
    LG_SCRATCH(lg_trial, made, context, room + 1);
    if (made == NULL) return lg_no_memory_for(path, error);
    LG_TRY(lg_read_first(path, first, sizeof first - 1, &got, error));
    if (search->layout == NULL) LG_TRY(check_head(first, lg_shown_path(path), search, seed, setting, error));
    const char *names = search->layout == NULL ? strchr(first, '\n') + 1 : first, *end = first + got;
    /* a table of a search that was cut off within the names of its columns has no trials */
    if (got > 0 && (search->layout != NULL || end == first + sizeof first - 1 ||
                    memchr(names, '\n', (size_t)(end - names)) != NULL))
        LG_TRY(read_table(&f, search, made, room, &found, error));
    if (found > 0) memcpy(trials, made, found * sizeof *made);
    *count = found;
    return LG_OK;
}
