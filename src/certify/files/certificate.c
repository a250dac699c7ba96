/* Certificates as JSON files. */
#include "certify/certificate.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <yaml.h>

#include "core/core.h"
#include "core/text.h"
#include "files/h5.h"
#include "liegrad/certify.h"
#include "liegrad/files.h"
#include "settings/files/yaml.h"

enum { MOST = LG_CERTIFICATE_STATES, MOST_BYTES = 1 << 20 };

static const char kind[] = "liegrad certificate";

static const struct {
    const char *name;
    uint32_t operands;
    lg_certificate_last last;
} operations[] = {
#define X(name, op, operands, last) {#name, operands, LG_CERTIFICATE_##last},
    LG_CERTIFICATE_OPS(X)
#undef X
};

/* ---- writing ---- */

static void add_text(lg_text *to, const char *text) {
    lg_text_append(to, "\"", 1);
    for (const char *c = text; *c != '\0'; c++) {
        if (*c == '"' || *c == '\\') lg_text_append(to, "\\", 1);
        lg_text_append(to, c, 1);
    }
    lg_text_append(to, "\"", 1);
}

/* A list; of a matrix `rows` lists. null: no bound */
static void add_reals(lg_text *to, const char *key, const double *x, size_t rows, size_t columns) {
    lg_text_add(to, "\"%s\": %s", key, rows > 1 ? "[" : "");
    for (size_t i = 0; i < rows * columns; i++) {
        lg_text_add(to, "%s", i % columns != 0 ? ", " : i == 0 ? "[" : ",\n  [");
        if (isfinite(x[i]))
            lg_text_add(to, "%.17g", x[i]);
        else
            lg_text_add(to, "null");
        if (i % columns == columns - 1) lg_text_add(to, "]");
    }
    lg_text_add(to, "%s,\n", rows > 1 ? "]" : "");
}

static lg_text code_text(const lg_context *context, const lg_certificate_code *code) {
    lg_text text = {.context = context};
    lg_text_add(&text, "{\"inputs\": %zu, \"code\": [", code->inputs);
    for (size_t i = 0; i < code->lines; i++) {
        const lg_certificate_line *l = &code->line[i];
        lg_text_add(&text, "%s[\"%s\"", i > 0 ? ",\n  " : "", operations[l->op].name);
        for (uint32_t k = 0; k < operations[l->op].operands; k++) lg_text_add(&text, ", %u", l->in[k]);
        if (operations[l->op].last != LG_CERTIFICATE_NO) lg_text_add(&text, ", %.17g", l->number);
        lg_text_add(&text, "]");
    }
    lg_text_add(&text, "],\n  \"outputs\": [");
    for (size_t j = 0; j < code->outputs; j++) lg_text_add(&text, "%s%u", j > 0 ? ", " : "", code->output[j]);
    lg_text_add(&text, "]}");
    return text;
}

static void hash(const void *data, size_t bytes, char out[LG_SHA256_TEXT]) {
    lg_sha256 state;
    lg_sha256_init(&state);
    lg_sha256_add(&state, data, bytes);
    lg_sha256_finish(&state, out);
}

static void add_part(lg_text *to, const char *key, const char *name, const char *sha256) {
    lg_text_add(to, "\"%s\": {\"name\": ", key);
    add_text(to, name);
    lg_text_add(to, ", \"sha256\": \"%s\"},\n", sha256);
}

static void add_proof(lg_text *to, const lg_certificate *f) {
    const size_t n = f->states;
    lg_text_add(to, "\"proof\": {\n");
    add_reals(to, "T", f->T, n, n);
    lg_text_add(to, "\"order\": %u, \"steps\": %u, \"even\": %s,\n", f->order, f->steps,
                f->even ? "true" : "false");
    add_reals(to, "near", f->near, 1, n);
    add_reals(to, "low", f->from, 1, n);
    add_reals(to, "high", f->to, 1, n);
    lg_text_add(to, "\"boxes\": %llu,\n\"tree\": [", (unsigned long long)f->boxes);
    for (const char *line = f->tree; line != NULL && *line != '\0';) {
        const size_t length = strcspn(line, "\n");
        lg_text_add(to, "%s\"", line == f->tree ? "" : ",\n  ");
        lg_text_append(to, line, length);
        lg_text_append(to, "\"", 1);
        line += length + (line[length] == '\n');
    }
    lg_text_add(to, "]}}\n");
}

static void compose(lg_text *to, lg_certificate *f, const lg_text *rate, const lg_text *control) {
    const size_t n = f->states;
    hash(rate->data, rate->length, f->plant_sha256);
    hash(control->data, control->length, f->controller_sha256);
    lg_text_add(to, "{\"format\": \"%s\", \"version\": 1, \"liegrad\": \"%s\",\n\"claim\": ", kind,
                lg_version());
    add_text(to, f->claim);
    lg_text_add(to, ",\n\"loop\": \"%s\", \"states\": %u, \"inputs\": %u, \"names\": [",
                f->period > 0 ? "held" : "continuous", f->states, f->inputs);
    for (size_t i = 0; i < n; i++) {
        if (i > 0) lg_text_add(to, ", ");
        add_text(to, f->names[i]);
    }
    lg_text_add(to, "],\n\"period\": %.17g, \"stored\": 0,\n", f->period);
    add_part(to, "plant", f->plant, f->plant_sha256);
    add_part(to, "controller", f->controller, f->controller_sha256);
    lg_text_add(to, "\"rate\": ");
    lg_text_join(to, rate);
    lg_text_add(to, ",\n\"control\": ");
    lg_text_join(to, control);
    lg_text_add(to, ",\n");
    add_reals(to, "goal", f->goal, 1, n);
    add_reals(to, "low", f->low, 1, n);
    add_reals(to, "high", f->high, 1, n);
    add_reals(to, "P", f->P, n, n);
    add_reals(to, "error", f->error, 1, n);
    lg_text_add(to, "\"level\": %.17g, \"eps\": %.17g, \"converges\": %s, \"between\": %.17g,\n", f->level,
                f->eps, f->converges ? "true" : "false", f->between);
    add_proof(to, f);
}

lg_status lg_certificate_save(const lg_context *context, const char *path, lg_certificate *f,
                              lg_error *error) {
    LG_NEEDS(error, path, f);
    lg_text text = {.context = context}, rate = code_text(context, &f->rate),
            control = code_text(context, &f->control);
    lg_status status = LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < f->states; i++) (void)lg_tame(f->names[i]);
    (void)lg_tame(f->plant);
    (void)lg_tame(f->controller);
    if (!rate.failed && !control.failed) compose(&text, f, &rate, &control);
    if (!rate.failed && !control.failed && !text.failed)
        status = text.length <= MOST_BYTES
                     ? lg_file_write(context, path, text.data, text.length, error)
                     : lg_fail(error, LG_UNSUPPORTED,
                               "%s: the certificate has %zu bytes, more than %d; a lower level needs fewer "
                               "boxes",
                               lg_shown_path(path), text.length, MOST_BYTES);
    lg_text_destroy(&text);
    lg_text_destroy(&rate);
    lg_text_destroy(&control);
    return status == LG_OUT_OF_MEMORY ? lg_no_memory(error) : status;
}

/* ---- reading ---- */

/* What the rows are read into */
typedef struct file_values {
    lg_certificate f;
    char format[64], liegrad[64];
    uint32_t version, stored, rate_inputs, control_inputs;
    bool continuous;
} file_values;

enum { UNBOUNDED = 1, SQUARE = 2 };
#define ROW(name_, type_, member_, ...)                                                                      \
    { LG_FIELD(file_values, NULL, name_, type_, member_, .required = true, __VA_ARGS__) }
#define NODE(name_)                                                                                          \
    {                                                                                                        \
        { .name = name_, .type = LG_FIELD_NODE, .required = true }                                           \
    }
#define MAP(name_)                                                                                           \
    {                                                                                                        \
        { .name = name_, .type = LG_FIELD_MAP, .required = true }                                            \
    }
/* A list of numbers, or n lists */
#define LIST(name_, member_, kind_)                                                                          \
    {                                                                                                        \
        {.name = name_, .type = LG_FIELD_NODE, .required = true, LG_ANY_REAL},                               \
            offsetof(lg_certificate, member_), true, kind_                                                   \
    }
#define YES_NO LG_NAMES("false", "true")

enum { CLAIM, NAMES, RATE_CODE, RATE_OUTPUTS, CONTROL_CODE, CONTROL_OUTPUTS, TREE };
static const struct {
    lg_field key;
    size_t offset;
    bool list;
    int kind;
} rows[] = {[CLAIM] = NODE("claim"),
            [NAMES] = NODE("names"),
            [RATE_CODE] = NODE("rate.code"),
            [RATE_OUTPUTS] = NODE("rate.outputs"),
            [CONTROL_CODE] = NODE("control.code"),
            [CONTROL_OUTPUTS] = NODE("control.outputs"),
            [TREE] = NODE("proof.tree"),
            LIST("goal", goal, 0),
            LIST("low", low, UNBOUNDED),
            LIST("high", high, UNBOUNDED),
            LIST("P", P, SQUARE),
            LIST("error", error, 0),
            LIST("proof.T", T, SQUARE),
            LIST("proof.near", near, 0),
            LIST("proof.low", from, 0),
            LIST("proof.high", to, 0),
            MAP("plant"),
            MAP("controller"),
            MAP("rate"),
            MAP("control"),
            MAP("proof"),
            ROW("format", TEXT, format, .meaning = "format"),
            ROW("version", U32, version, .high = 1e9),
            ROW("liegrad", TEXT, liegrad, .meaning = "version of liegrad"),
            ROW("loop", NAME, continuous, LG_NAMES("held", "continuous")),
            ROW("states", U32, f.states, .low = 1, .high = MOST),
            ROW("inputs", U32, f.inputs, .high = MOST),
            ROW("period", REAL, f.period, .high = 1e300),
            ROW("stored", U32, stored, .high = 0),
            ROW("plant.name", TEXT, f.plant, .meaning = "name"),
            ROW("plant.sha256", TEXT, f.plant_sha256, .meaning = "hash"),
            ROW("controller.name", TEXT, f.controller, .meaning = "name"),
            ROW("controller.sha256", TEXT, f.controller_sha256, .meaning = "hash"),
            ROW("rate.inputs", U32, rate_inputs, .high = 2 * MOST),
            ROW("control.inputs", U32, control_inputs, .high = MOST),
            ROW("level", REAL, f.level, LG_POSITIVE),
            ROW("eps", REAL, f.eps, LG_POSITIVE),
            ROW("converges", FLAG, f.converges, YES_NO),
            ROW("between", REAL, f.between, .high = 1e300),
            ROW("proof.order", U32, f.order, .high = 64),
            ROW("proof.steps", U32, f.steps, .high = LG_CERTIFICATE_STEPS),
            ROW("proof.even", FLAG, f.even, YES_NO),
            ROW("proof.boxes", U64, f.boxes, .high = LG_CERTIFICATE_BOXES)};
enum { ROWS = LG_COUNT(rows) };

typedef struct reading {
    lg_yaml *yaml;
    yaml_document_t *document;
    lg_field keys[ROWS];
    lg_key_value values[ROWS];
    file_values *to;
    lg_error *error;
} reading;

static lg_status bad(const reading *r, size_t row, const yaml_node_t *at, const char *what) {
    const uint32_t line = at != NULL ? (uint32_t)at->start_mark.line + 1 : r->values[row].line;
    return lg_yaml_fail(r->yaml, line, LG_FORMAT, r->error, "%s: %s", r->keys[row].name, what);
}

static size_t length_of(const yaml_node_t *list) {
    return list->type != YAML_SEQUENCE_NODE
               ? 0
               : (size_t)(list->data.sequence.items.top - list->data.sequence.items.start);
}

static const yaml_node_t *item(const reading *r, const yaml_node_t *list, size_t i) {
    return yaml_document_get_node(r->document, list->data.sequence.items.start[i]);
}

static const char *text_of(const yaml_node_t *node) {
    const char *text = node->type == YAML_SCALAR_NODE ? (const char *)node->data.scalar.value : NULL;
    return text != NULL && strlen(text) == node->data.scalar.length ? text : NULL;
}

/* A whole number with `below` false below 2^32, or any number */
static bool number_of(const yaml_node_t *node, bool whole, double *out) {
    const char *text = text_of(node);
    return text != NULL && node->data.scalar.style == YAML_PLAIN_SCALAR_STYLE &&
           lg_number_parse(text, out) == LG_OK &&
           (!whole || (*out >= 0 && *out <= UINT32_MAX && *out == floor(*out)));
}

static lg_status read_list(const reading *r, size_t row, const yaml_node_t *list, size_t n, double *out) {
    const double none =
        row > 0 && strcmp(r->keys[row].name, "low") == 0 ? -(double)INFINITY : (double)INFINITY;
    if (length_of(list) != n) return bad(r, row, list, "a list with a number for each state is expected");
    for (size_t i = 0; i < n; i++) {
        const yaml_node_t *at = item(r, list, i);
        const char *text = text_of(at);
        if (rows[row].kind == UNBOUNDED && text != NULL && strcmp(text, "null") == 0)
            out[i] = none;
        else if (!number_of(at, false, &out[i]))
            return bad(r, row, at, "a finite number is expected");
    }
    return LG_OK;
}

static lg_status read_lists(const reading *r) {
    const size_t n = r->to->f.states;
    for (size_t k = 0; k < ROWS; k++) {
        double *out = (double *)(void *)((char *)&r->to->f + rows[k].offset);
        const yaml_node_t *list = r->values[k].node;
        if (!rows[k].list) continue;
        if (rows[k].kind != SQUARE) {
            LG_TRY(read_list(r, k, list, n, out));
            continue;
        }
        /* a matrix of one number may be written as a list */
        const bool flat = n == 1 && length_of(list) == 1 && item(r, list, 0)->type == YAML_SCALAR_NODE;
        if (length_of(list) != n) return bad(r, k, list, "a list with a row for each state is expected");
        for (size_t i = 0; i < n; i++)
            LG_TRY(read_list(r, k, flat ? list : item(r, list, i), n, out + i * n));
    }
    return LG_OK;
}

static lg_status read_line(const reading *r, size_t row, const yaml_node_t *at, size_t lines,
                           lg_certificate_line *out) {
    const char *name = length_of(at) > 0 ? text_of(item(r, at, 0)) : NULL;
    double x;
    for (uint32_t op = 0; name != NULL && op < LG_COUNT(operations); op++) {
        const bool last = operations[op].last != LG_CERTIFICATE_NO;
        if (strcmp(name, operations[op].name) != 0) continue;
        *out = (lg_certificate_line){.op = op};
        if (length_of(at) != 1 + operations[op].operands + last)
            return bad(r, row, at, "an operation has the wrong number of operands");
        for (uint32_t k = 0; k < operations[op].operands; k++) {
            if (!number_of(item(r, at, 1 + k), true, &x) || x >= (double)lines)
                return bad(r, row, at, "an operand is no earlier line");
            out->in[k] = (uint32_t)x;
        }
        if (last && !number_of(item(r, at, length_of(at) - 1), operations[op].last == LG_CERTIFICATE_WHOLE,
                               &out->number))
            return bad(r, row, at, "the last operand is not the number that the operation needs");
        return LG_OK;
    }
    return bad(r, row, at, "an unknown operation");
}

static lg_status read_code(const reading *r, size_t row, size_t inputs, size_t outputs,
                           lg_certificate_code *out) {
    const yaml_node_t *code = r->values[row].node, *list = r->values[row + 1].node;
    *out = (lg_certificate_code){.inputs = inputs, .lines = length_of(code), .outputs = outputs};
    if (code->type != YAML_SEQUENCE_NODE || out->lines > LG_CERTIFICATE_LINES)
        return bad(r, row, NULL, "a list of at most 65536 operations is expected");
    if (list->type != YAML_SEQUENCE_NODE || length_of(list) != outputs)
        return bad(r, row + 1, NULL, "a list with a line for each output is expected");
    out->line = lg_alloc(r->to->f.context, out->lines, sizeof *out->line);
    out->output = lg_alloc(r->to->f.context, outputs, sizeof *out->output);
    if (out->line == NULL || out->output == NULL) return lg_no_memory(r->error);
    for (size_t i = 0; i < out->lines; i++) LG_TRY(read_line(r, row, item(r, code, i), i, &out->line[i]));
    for (size_t j = 0; j < outputs; j++) {
        double x;
        if (!number_of(item(r, list, j), true, &x) || x >= (double)out->lines)
            return bad(r, row + 1, NULL, "an output is no line of the code");
        out->output[j] = (uint32_t)x;
    }
    return LG_OK;
}

static lg_status read_tree(const reading *r) {
    const yaml_node_t *list = r->values[TREE].node;
    lg_certificate *f = &r->to->f;
    lg_text text = {.context = f->context};
    size_t boxes = 0;
    lg_status status = LG_OK;
    for (size_t i = 0; i < length_of(list) && status == LG_OK; i++) {
        const char *line = text_of(item(r, list, i));
        if (line == NULL || *line == '\0' || strchr(line, '\n') != NULL)
            status = bad(r, TREE, item(r, list, i), "a text for each depth is expected");
        else
            lg_text_add(&text, "%s\n", line);
        boxes += line == NULL ? 0 : strlen(line);
    }
    if (status == LG_OK && (text.failed || text.data == NULL))
        status = text.failed ? lg_no_memory(r->error) : bad(r, TREE, NULL, "a list of texts is expected");
    if (status == LG_OK && boxes != f->boxes)
        status = bad(r, TREE, NULL, "the tree does not have as many boxes as \"boxes\" says");
    f->tree = text.data;
    return status;
}

static lg_status read_names(const reading *r) {
    const yaml_node_t *list = r->values[NAMES].node;
    const char *claim = text_of(r->values[CLAIM].node);
    lg_certificate *f = &r->to->f;
    if (claim == NULL || strlen(claim) >= sizeof f->claim)
        return bad(r, CLAIM, NULL, "a text of at most 1023 bytes is expected");
    (void)snprintf(f->claim, sizeof f->claim, "%s", claim);
    if (length_of(list) != f->states)
        return bad(r, NAMES, NULL, "a list with a name for each state is expected");
    for (size_t i = 0; i < f->states; i++) {
        const char *name = text_of(item(r, list, i));
        if (name == NULL || strlen(name) >= LG_CERTIFICATE_NAME)
            return bad(r, NAMES, item(r, list, i), "a name of at most 63 bytes is expected");
        (void)snprintf(f->names[i], sizeof f->names[i], "%s", name);
    }
    return LG_OK;
}

/* Marks of libyaml count characters. */
static size_t byte_of(const unsigned char *data, size_t bytes, size_t character) {
    size_t at = 0;
    for (; at < bytes; at++)
        if ((data[at] & 0xc0u) != 0x80u && character-- == 0) break;
    return at;
}

static lg_status check_hash(const reading *r, const char *key, const char *part, const char *expected,
                            const unsigned char *data, size_t bytes) {
    const yaml_node_t *root = yaml_document_get_root_node(r->document);
    char found[LG_SHA256_TEXT];
    for (const yaml_node_pair_t *p = root->data.mapping.pairs.start; p < root->data.mapping.pairs.top; p++) {
        const char *name = text_of(yaml_document_get_node(r->document, p->key));
        const yaml_node_t *node = yaml_document_get_node(r->document, p->value);
        if (name == NULL || strcmp(name, key) != 0) continue;
        const size_t from = byte_of(data, bytes, node->start_mark.index),
                     to = byte_of(data, bytes, node->end_mark.index);
        hash(data + from, to - from, found);
        if (strcmp(found, expected) == 0) return LG_OK;
    }
    return lg_fail(r->error, LG_CHECK_FAILED,
                   "%s: the code \"%s\" does not have the SHA-256 of \"%s\": the file was changed",
                   lg_shown_path(lg_yaml_path(r->yaml)), key, part);
}

static lg_status read_values(reading *r, const unsigned char *data, size_t bytes) {
    lg_certificate *f = &r->to->f;
    lg_key_set set = {r->keys, ROWS, r->values};
    const lg_field version = {.name = "version", .type = LG_FIELD_TEXT, .size = 32};
    lg_key_value value = {.line = 0};
    if (lg_yaml_has(r->yaml, "version")) LG_TRY(lg_yaml_name(r->yaml, &version, &value, r->error));
    if (value.line > 0 && strcmp(value.text, "1") != 0)
        return lg_yaml_fail(r->yaml, value.line, LG_FORMAT, r->error,
                            "version %s of certificates is unknown; this program reads version 1",
                            value.text);
    for (size_t k = 0; k < ROWS; k++) r->keys[k] = rows[k].key;
    LG_TRY(lg_yaml_read(r->yaml, &set, 1, NULL, "a certificate", r->error));
    LG_TRY(lg_yaml_store(r->yaml, r->keys, r->values, ROWS, r->to, r->error));
    if (strcmp(r->to->format, kind) != 0)
        return lg_fail(r->error, LG_FORMAT, "%s: is no certificate: \"format\" is not \"%s\"",
                       lg_shown_path(lg_yaml_path(r->yaml)), kind);
    if (r->to->continuous != (f->period == 0))
        return lg_fail(r->error, LG_FORMAT, "%s: a loop that is held has a period above 0, another one 0",
                       lg_shown_path(lg_yaml_path(r->yaml)));
    LG_TRY(read_names(r));
    LG_TRY(read_lists(r));
    LG_TRY(read_code(r, RATE_CODE, r->to->rate_inputs, f->states, &f->rate));
    LG_TRY(read_code(r, CONTROL_CODE, r->to->control_inputs, f->inputs, &f->control));
    LG_TRY(read_tree(r));
    LG_TRY(check_hash(r, "rate", "plant", f->plant_sha256, data, bytes));
    return check_hash(r, "control", "controller", f->controller_sha256, data, bytes);
}

lg_status lg_certificate_load(const lg_context *context, const char *path, lg_certificate *out,
                              lg_error *error) {
    LG_NEEDS(error, path, out);
    unsigned char *data = NULL;
    size_t bytes = 0;
    file_values *to = lg_alloc(context, 1, sizeof *to);
    reading *r = lg_alloc(context, 1, sizeof *r);
    lg_status status =
        to == NULL || r == NULL ? lg_no_memory(error) : lg_yaml_bytes(context, path, &data, &bytes, error);
    memset(out, 0, sizeof *out);
    if (status == LG_OK) {
        *r = (reading){.to = to, .error = error};
        to->f.context = context;
        status = lg_yaml_open_text(context, path, data, bytes, &r->yaml, error);
    }
    if (status == LG_OK) {
        r->document = lg_yaml_document(r->yaml);
        status = read_values(r, data, bytes);
        lg_yaml_close(r->yaml);
    }
    if (status == LG_OK)
        *out = to->f;
    else if (to != NULL)
        lg_certificate_destroy(&to->f);
    lg_free(context, data);
    lg_free(context, to);
    lg_free(context, r);
    return status;
}
