/* Certificates as JSON files: one table says how each key is written and read. */
#include "certify/certificate.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/core.h"
#include "core/text.h"
#include "files/h5.h"
#include "liegrad/certify.h"
#include "liegrad/files.h"
#include "settings/files/yaml.h"

enum { MOST = LG_CERTIFICATE_STATES, MOST_BYTES = 1 << 20 };

static const char format[] = "liegrad certificate";

static const struct {
    const char *name;
    uint32_t operands;
    lg_certificate_last last;
} operations[] = {
#define X(name, op, operands, last) {#name, operands, LG_CERTIFICATE_##last},
    LG_CERTIFICATE_OPS(X)
#undef X
};

typedef struct values {
    lg_certificate f;
    char format[32], liegrad[32];
    uint32_t version, stored;
    bool continuous;
} values;

typedef enum kind {
    SCALAR,
    BOUND,
    LIST,
    UNBOUNDED,
    SQUARE,
    CLAIM,
    NAMES,
    CODE,
    OUTPUTS,
    TREE,
    MAP,
    KINDS
} kind;

#define ROW(name_, type_, member_, ...)                                                                      \
    { LG_FIELD(values, NULL, name_, type_, member_, .required = true, __VA_ARGS__), 0, SCALAR }
#define KEY(name_, kind_, member_)                                                                           \
    { {.name = name_, .type = LG_FIELD_NODE, .required = true}, offsetof(lg_certificate, member_), kind_ }
#define BELOW(name_)                                                                                         \
    { {.name = name_, .type = LG_FIELD_MAP, .required = true}, 0, MAP }
#define YES_NO LG_NAMES("false", "true")

/* In the order of the file; keys below a mapping follow it. */
static const struct {
    lg_field key;
    size_t offset; /* of the member of a node */
    kind kind;
} rows[] = {ROW("format", TEXT, format, .meaning = "format"),
            ROW("version", U32, version, .low = 1, .high = 1),
            ROW("liegrad", TEXT, liegrad, .meaning = "version"),
            KEY("claim", CLAIM, claim),
            ROW("loop", NAME, continuous, LG_NAMES("held", "continuous")),
            ROW("states", U32, f.states, .low = 1, .high = MOST),
            ROW("inputs", U32, f.inputs, .high = MOST),
            KEY("names", NAMES, names),
            ROW("period", REAL, f.period, .high = 1e300),
            ROW("stored", U32, stored, .high = 0),
            BELOW("rate"),
            ROW("rate.inputs", U32, f.rate.inputs, .high = 2 * MOST),
            KEY("rate.code", CODE, rate),
            KEY("rate.outputs", OUTPUTS, rate),
            BELOW("control"),
            ROW("control.inputs", U32, f.control.inputs, .high = MOST),
            KEY("control.code", CODE, control),
            KEY("control.outputs", OUTPUTS, control),
            BELOW("plant"),
            ROW("plant.name", TEXT, f.plant, .meaning = "name"),
            ROW("plant.sha256", TEXT, f.plant_sha256, .meaning = "hash"),
            BELOW("controller"),
            ROW("controller.name", TEXT, f.controller, .meaning = "name"),
            ROW("controller.sha256", TEXT, f.controller_sha256, .meaning = "hash"),
            KEY("goal", LIST, goal),
            KEY("low", UNBOUNDED, low),
            KEY("high", UNBOUNDED, high),
            KEY("P", SQUARE, P),
            ROW("level", REAL, f.level, LG_POSITIVE),
            ROW("eps", REAL, f.eps, LG_POSITIVE),
            KEY("error", LIST, error),
            ROW("converges", FLAG, f.converges, YES_NO),
            KEY("between", BOUND, between),
            BELOW("proof"),
            KEY("proof.T", SQUARE, T),
            ROW("proof.order", U32, f.order, .high = 64),
            ROW("proof.steps", U32, f.steps, .high = LG_CERTIFICATE_STEPS),
            KEY("proof.near", LIST, near),
            ROW("proof.even", FLAG, f.even, YES_NO),
            KEY("proof.low", LIST, from),
            KEY("proof.high", LIST, to),
            ROW("proof.boxes", U64, f.boxes, .high = MOST_BYTES),
            KEY("proof.tree", TREE, tree)};
enum { ROWS = LG_COUNT(rows) };

static void hash(const void *data, size_t bytes, char out[LG_SHA256_TEXT]) {
    lg_sha256 state;
    lg_sha256_init(&state);
    lg_sha256_add(&state, data, bytes);
    lg_sha256_finish(&state, out);
}

/* ---- writing: `member` of f ---- */

static void add_text(lg_text *to, const char *text) {
    char own[LG_FIELD_TEXT_SIZE]; /* a name may end inside of a character */
    (void)snprintf(own, sizeof own, "%s", text);
    lg_text_append(to, "\"", 1);
    for (const char *c = lg_tamed(own); *c != '\0'; c++) {
        if (*c == '"' || *c == '\\') lg_text_append(to, "\\", 1);
        lg_text_append(to, c, 1);
    }
    lg_text_append(to, "\"", 1);
}

/* null: no bound */
static void write_bound(lg_text *to, const lg_certificate *f, const void *member) {
    const double *x = member;
    lg_text_add(to, isfinite(*x) ? "%.17g" : "null", *x);
}

static void write_list(lg_text *to, const lg_certificate *f, const void *member) {
    const double *x = member;
    for (size_t i = 0; i < f->states; i++)
        lg_text_add(to, isfinite(x[i]) ? "%s%.17g" : "%snull", i == 0 ? "[" : ", ", x[i]);
    lg_text_append(to, "]", 1);
}

static void write_square(lg_text *to, const lg_certificate *f, const void *member) {
    for (size_t i = 0; i < f->states; i++) {
        lg_text_add(to, "%s", i == 0 ? "[" : ",\n  ");
        write_list(to, f, (const double *)member + i * f->states);
    }
    lg_text_append(to, "]", 1);
}

static void write_claim(lg_text *to, const lg_certificate *f, const void *member) {
    add_text(to, member);
}

static void write_names(lg_text *to, const lg_certificate *f, const void *member) {
    for (size_t i = 0; i < f->states; i++) {
        lg_text_add(to, "%s", i == 0 ? "[" : ", ");
        add_text(to, f->names[i]);
    }
    lg_text_append(to, "]", 1);
}

static void write_code(lg_text *to, const lg_certificate *f, const void *member) {
    const lg_certificate_code *code = member;
    lg_text_append(to, "[", 1);
    for (size_t i = 0; i < code->lines; i++) {
        const lg_certificate_line *l = &code->line[i];
        lg_text_add(to, "%s[\"%s\"", i > 0 ? ",\n  " : "", operations[l->op].name);
        for (uint32_t k = 0; k < operations[l->op].operands; k++) lg_text_add(to, ", %u", l->in[k]);
        if (operations[l->op].last != LG_CERTIFICATE_NO) lg_text_add(to, ", %.17g", l->number);
        lg_text_append(to, "]", 1);
    }
    lg_text_append(to, "]", 1);
}

static void write_outputs(lg_text *to, const lg_certificate *f, const void *member) {
    const lg_certificate_code *code = member;
    lg_text_append(to, "[", 1);
    for (size_t j = 0; j < code->outputs; j++) lg_text_add(to, "%s%u", j > 0 ? ", " : "", code->output[j]);
    lg_text_append(to, "]", 1);
}

static void write_tree(lg_text *to, const lg_certificate *f, const void *member) {
    for (const char *line = f->tree; *line != '\0';) {
        const size_t length = strcspn(line, "\n");
        lg_text_add(to, "%s\"", line == f->tree ? "[" : ",\n  ");
        lg_text_append(to, line, length);
        lg_text_append(to, "\"", 1);
        line += length + (line[length] == '\n');
    }
    lg_text_append(to, "]", 1);
}

/* ---- reading: `member` of f ---- */

typedef struct reading {
    lg_yaml *yaml;
    lg_field keys[ROWS];
    lg_key_value values[ROWS];
    values *to;
    lg_error *error;
} reading;

static lg_status bad(const reading *r, size_t row, const yaml_node_t *at, const char *what) {
    return LG_FAIL_AT(r->yaml, at, r->error, "%s: %s", rows[row].key.name, what);
}

static bool number_of(const yaml_node_t *node, double *out) {
    const char *text = lg_node_text(node, 64);
    return text != NULL && node->data.scalar.style == YAML_PLAIN_SCALAR_STYLE &&
           lg_number_parse(text, out) == LG_OK;
}

static bool line_of(const yaml_node_t *node, uint32_t *out) {
    double x;
    if (!number_of(node, &x) || !(x >= 0 && x < LG_CERTIFICATE_LINES) || x != floor(x)) return false;
    *out = (uint32_t)x;
    return true;
}

static bool is_null(const yaml_node_t *node) {
    const char *text = lg_node_text(node, 64);
    return text != NULL && strcmp(text, "null") == 0;
}

static lg_status read_bound(const reading *r, size_t row, const yaml_node_t *node, void *member) {
    double *out = member;
    *out = INFINITY;
    if (is_null(node) || (number_of(node, out) && *out >= 0)) return LG_OK;
    return bad(r, row, node, "a number of 0 or more, or null, is expected");
}

static lg_status read_list(const reading *r, size_t row, const yaml_node_t *list, void *member) {
    double *out = member;
    if (lg_node_length(list) != r->to->f.states)
        return bad(r, row, list, "a list with a number for each state is expected");
    for (size_t i = 0; i < lg_node_length(list); i++) {
        const yaml_node_t *at = lg_node_item(r->yaml, list, i);
        if (rows[row].kind == UNBOUNDED && is_null(at))
            out[i] = out == r->to->f.low ? -(double)INFINITY : (double)INFINITY;
        else if (!number_of(at, &out[i]))
            return bad(r, row, at, "a finite number is expected");
    }
    return LG_OK;
}

static lg_status read_square(const reading *r, size_t row, const yaml_node_t *list, void *member) {
    const size_t n = r->to->f.states;
    if (lg_node_length(list) != n) return bad(r, row, list, "a list with a row for each state is expected");
    for (size_t i = 0; i < n; i++)
        LG_TRY(read_list(r, row, lg_node_item(r->yaml, list, i), (double *)member + i * n));
    return LG_OK;
}

static lg_status read_claim(const reading *r, size_t row, const yaml_node_t *node, void *member) {
    const char *text = lg_node_text(node, LG_CERTIFICATE_CLAIM);
    if (text == NULL) return bad(r, row, node, "a text of at most 1023 bytes is expected");
    (void)snprintf(member, LG_CERTIFICATE_CLAIM, "%s", text);
    return LG_OK;
}

static lg_status read_names(const reading *r, size_t row, const yaml_node_t *list, void *member) {
    if (lg_node_length(list) != r->to->f.states)
        return bad(r, row, list, "a list with a name for each state is expected");
    for (size_t i = 0; i < lg_node_length(list); i++) {
        const char *name = lg_node_text(lg_node_item(r->yaml, list, i), LG_CERTIFICATE_NAME);
        if (name == NULL)
            return bad(r, row, lg_node_item(r->yaml, list, i), "a name of at most 63 bytes is expected");
        (void)snprintf(r->to->f.names[i], LG_CERTIFICATE_NAME, "%s", name);
    }
    return LG_OK;
}

static lg_status read_line(const reading *r, size_t row, const yaml_node_t *at, lg_certificate_line *out) {
    const char *name = lg_node_length(at) > 0 ? lg_node_text(lg_node_item(r->yaml, at, 0), 64) : NULL;
    uint32_t op = 0;
    while (op < LG_COUNT(operations) && (name == NULL || strcmp(name, operations[op].name) != 0)) op++;
    if (op == LG_COUNT(operations)) return bad(r, row, at, "the operation is unknown");
    const size_t last = operations[op].last != LG_CERTIFICATE_NO, operands = operations[op].operands;
    bool fits = lg_node_length(at) == 1 + operands + last;
    *out = (lg_certificate_line){.op = op};
    for (size_t k = 0; k < operands && fits; k++)
        fits = line_of(lg_node_item(r->yaml, at, 1 + k), &out->in[k]);
    if (fits && last) fits = number_of(lg_node_item(r->yaml, at, 1 + operands), &out->number);
    return fits ? LG_OK : bad(r, row, at, "the operation has other operands");
}

static lg_status read_code(const reading *r, size_t row, const yaml_node_t *list, void *member) {
    lg_certificate_code *out = member;
    const size_t lines = lg_node_length(list);
    if (list->type != YAML_SEQUENCE_NODE || lines > LG_CERTIFICATE_LINES)
        return bad(r, row, list, "a list of at most 65536 operations is expected");
    if ((out->line = lg_alloc(r->to->f.context, lines, sizeof *out->line)) == NULL)
        return lg_no_memory(r->error);
    out->lines = (uint32_t)lines;
    for (size_t i = 0; i < lines; i++)
        LG_TRY(read_line(r, row, lg_node_item(r->yaml, list, i), &out->line[i]));
    return LG_OK;
}

static lg_status read_outputs(const reading *r, size_t row, const yaml_node_t *list, void *member) {
    lg_certificate_code *out = member;
    const size_t count = lg_node_length(list);
    if (list->type != YAML_SEQUENCE_NODE || count > MOST)
        return bad(r, row, list, "a list of lines is expected");
    if ((out->output = lg_alloc(r->to->f.context, count, sizeof *out->output)) == NULL)
        return lg_no_memory(r->error);
    out->outputs = (uint32_t)count;
    for (size_t j = 0; j < count; j++)
        if (!line_of(lg_node_item(r->yaml, list, j), &out->output[j]))
            return bad(r, row, list, "an output is no line");
    return LG_OK;
}

static lg_status read_tree(const reading *r, size_t row, const yaml_node_t *list, void *member) {
    lg_text text = {.context = r->to->f.context};
    size_t boxes = 0;
    for (size_t i = 0; i < lg_node_length(list); i++) {
        const char *line = lg_node_text(lg_node_item(r->yaml, list, i), MOST_BYTES);
        boxes += line != NULL ? strlen(line) : 0;
        lg_text_add(&text, "%s\n", line != NULL ? line : "");
    }
    *(char **)member = text.data;
    if (text.failed) return lg_no_memory(r->error);
    if (text.data == NULL || boxes != r->to->f.boxes)
        return bad(r, row, list, "the tree has not as many boxes as \"boxes\" says");
    return LG_OK;
}

/* ---- both ---- */

static const struct {
    void (*write)(lg_text *to, const lg_certificate *f, const void *member);
    lg_status (*read)(const reading *r, size_t row, const yaml_node_t *node, void *member);
} kinds[KINDS] = {[BOUND] = {write_bound, read_bound},   [LIST] = {write_list, read_list},
                  [UNBOUNDED] = {write_list, read_list}, [SQUARE] = {write_square, read_square},
                  [CLAIM] = {write_claim, read_claim},   [NAMES] = {write_names, read_names},
                  [CODE] = {write_code, read_code},      [OUTPUTS] = {write_outputs, read_outputs},
                  [TREE] = {write_tree, read_tree}};

static void compose(lg_text *to, values *v) {
    char shown[LG_FIELD_TEXT_SIZE];
    size_t map = ROWS, start = 0;
    for (size_t k = 0; k <= ROWS && !to->failed; k++) {
        const char *dot = k < ROWS ? strchr(rows[k].key.name, '.') : NULL;
        if (map < ROWS && dot == NULL) {
            lg_text_append(to, "}", 1);
            for (int p = 0; p < 2; p++)
                if (strcmp(rows[map].key.name, p == 0 ? "rate" : "control") == 0)
                    hash(to->data + start, to->length - start,
                         p == 0 ? v->f.plant_sha256 : v->f.controller_sha256);
            map = ROWS;
        }
        if (k == ROWS) break;
        lg_text_add(to, "%s\"%s\": ",
                    k == 0         ? "{"
                    : map + 1 == k ? ""
                                   : ",\n",
                    dot != NULL ? dot + 1 : rows[k].key.name);
        if (rows[k].kind == MAP) {
            map = k;
            start = to->length;
            lg_text_append(to, "{", 1);
        } else if (rows[k].kind != SCALAR) {
            kinds[rows[k].kind].write(to, &v->f, (const char *)&v->f + rows[k].offset);
        } else {
            lg_field_show(&rows[k].key, v, shown, sizeof shown);
            if (rows[k].key.type == LG_FIELD_TEXT || rows[k].key.type == LG_FIELD_NAME)
                add_text(to, shown);
            else
                lg_text_add(to, "%s", shown);
        }
    }
    lg_text_add(to, "}\n");
}

lg_status lg_certificate_save(const lg_context *context, const char *path, const lg_certificate *certificate,
                              lg_error *error) {
    LG_NEEDS(error, path, certificate);
    if (certificate->tree == NULL || certificate->plant[0] == '\0' || certificate->controller[0] == '\0')
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a certificate needs names of the plant and of the controller, and a tree");
    lg_text text = {.context = context};
    values v = {.f = *certificate, .version = 1, .continuous = certificate->period == 0};
    (void)snprintf(v.format, sizeof v.format, "%s", format);
    (void)snprintf(v.liegrad, sizeof v.liegrad, "%s", lg_version());
    compose(&text, &v);
    const lg_status status = text.failed ? lg_no_memory(error)
                             : text.length <= MOST_BYTES
                                 ? lg_file_write(context, path, text.data, text.length, error)
                                 : lg_fail(error, LG_UNSUPPORTED,
                                           "%s: the certificate has %zu bytes, more than %d; a lower level "
                                           "needs fewer boxes",
                                           lg_shown_path(path), text.length, MOST_BYTES);
    lg_text_destroy(&text);
    return status;
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
    const yaml_node_t *root = yaml_document_get_root_node(lg_yaml_document(r->yaml)),
                      *node = lg_node_below(r->yaml, root, key); /* not NULL: the key was read */
    const size_t from = byte_of(data, bytes, node->start_mark.index),
                 to = byte_of(data, bytes, node->end_mark.index);
    char found[LG_SHA256_TEXT];
    hash(data + from, to - from, found);
    if (strcmp(found, expected) == 0) return LG_OK;
    return lg_fail(r->error, LG_CHECK_FAILED,
                   "%s: the code \"%s\" does not have the SHA-256 of \"%s\": the file was changed",
                   lg_shown_path(lg_yaml_path(r->yaml)), key, part);
}

static lg_status read_values(reading *r, const unsigned char *data, size_t bytes) {
    lg_certificate *f = &r->to->f;
    const lg_key_set set = {r->keys, ROWS, r->values};
    const lg_field version = {.name = "version", .type = LG_FIELD_TEXT};
    lg_key_value value;
    LG_TRY(lg_yaml_name(r->yaml, &version, &value, r->error));
    if (strcmp(value.text, "1") != 0)
        return lg_yaml_fail(r->yaml, value.line, LG_FORMAT, r->error,
                            "version %s of certificates is unknown; this program reads version 1",
                            value.text);
    for (size_t k = 0; k < ROWS; k++) r->keys[k] = rows[k].key;
    LG_TRY(lg_yaml_read(r->yaml, &set, 1, NULL, "a certificate", r->error));
    LG_TRY(lg_yaml_store(r->yaml, r->keys, r->values, ROWS, r->to, r->error));
    if (strcmp(r->to->format, format) != 0 || r->to->continuous != (f->period == 0))
        return lg_fail(
            r->error, LG_FORMAT,
            "%s: \"format\" must be \"%s\", and \"period\" above 0 if the \"loop\" is held, else 0",
            lg_shown_path(lg_yaml_path(r->yaml)), format);
    for (size_t k = 0; k < ROWS; k++)
        if (kinds[rows[k].kind].read != NULL)
            LG_TRY(kinds[rows[k].kind].read(r, k, r->values[k].node, (char *)f + rows[k].offset));
    LG_TRY(check_hash(r, "rate", "plant", f->plant_sha256, data, bytes));
    return check_hash(r, "control", "controller", f->controller_sha256, data, bytes);
}

lg_status lg_certificate_load(const lg_context *context, const char *path, lg_certificate *out,
                              lg_error *error) {
    LG_NEEDS(error, path, out);
    LG_CLEAN(lg_owned_free) lg_owned data = {context, NULL};
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    unsigned char *text;
    size_t bytes = 0;
    values to = {.f = {.context = context}};
    LG_TRY(lg_yaml_bytes(context, path, &text, &bytes, error));
    data.memory = text;
    LG_TRY(lg_yaml_open_text(context, path, text, bytes, &yaml, error));
    reading r = {.to = &to, .error = error, .yaml = yaml};
    const lg_status status = read_values(&r, text, bytes);
    if (status == LG_OK)
        *out = to.f;
    else
        lg_certificate_destroy(&to.f);
    return status;
}
