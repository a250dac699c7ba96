/* Reads schemes from YAML files: tableaus, rows of exponentials, kicks and drifts. */
#include <math.h>
#include <string.h>

#include "liegrad/integrators.h"

#include "settings/files/yaml.h"

#define SYNTAX_SIZE 64

/* A scheme with the memory that it points to. The caller gets the address of `scheme`. As this is the first
 * member, lg_scheme_destroy can convert it back. */
typedef struct scheme_file {
    lg_scheme scheme;
    const lg_context *context;
    char name[64];
    lg_cf_row rows[LG_SCHEME_MAX_STAGES + 2];
    lg_commutator commutators[LG_SCHEME_MAX_STAGES];
} scheme_file;

typedef enum file_kind {
    KIND_RKMK,
    KIND_RUNGE_KUTTA,
    KIND_COMMUTATOR_FREE,
    KIND_SPLITTING,
    KIND_COUNT
} file_kind;

static const struct {
    const char *name;
    lg_scheme_kind kind;
    bool ambient;
} kinds[KIND_COUNT] = {{"rkmk", LG_SCHEME_RKMK, false},
                       {"runge-kutta", LG_SCHEME_RKMK, true},
                       {"commutator-free", LG_SCHEME_COMMUTATOR_FREE, false},
                       {"splitting", LG_SCHEME_SPLITTING, false}};

static const char *kind_name(uint32_t value) {
    return value < KIND_COUNT ? kinds[value].name : NULL;
}

/* `methods`: the kinds of schemes that may have the key. */
#define BIT(kind) (1U << (kind))
enum { TABLEAU = BIT(KIND_RKMK) | BIT(KIND_RUNGE_KUTTA), STAGED = TABLEAU | BIT(KIND_COMMUTATOR_FREE) };
static const lg_field keys[] = {
    {.name = "name", .type = LG_FIELD_TEXT},
    {.name = "kind", .type = LG_FIELD_NAME, .required = true, .value_name = kind_name},
    LG_FIELD(lg_scheme, NULL, "order", U32, order, .required = true, .low = 1, .high = 10),
    LG_NODE("c", .methods = STAGED),
    LG_NODE("a", .methods = TABLEAU),
    LG_NODE("b", .methods = TABLEAU),
    LG_NODE("embedded", .methods = STAGED),
    LG_FIELD(lg_scheme, NULL, "embedded_order", U32, embedded_order, .low = 1, .high = 10, .methods = STAGED),
    {.name = "dexpinv", .type = LG_FIELD_TEXT, .methods = BIT(KIND_RKMK)},
    LG_NODE("commutators", .methods = BIT(KIND_RKMK)),
    LG_NODE("rows", .methods = BIT(KIND_COMMUTATOR_FREE)),
    LG_NODE("kick", .methods = BIT(KIND_SPLITTING)),
    LG_NODE("drift", .methods = BIT(KIND_SPLITTING)),
};
enum { KEYS = LG_COUNT(keys) };
/* Keys that each scheme has whose kind may have them. */
static const char *const needed[] = {"a", "b", "rows", "kick", "drift"};

typedef struct reader {
    lg_yaml *yaml;
    lg_key_value values[KEYS];
    scheme_file *out;
    lg_error *error;
} reader;

/* ---- nodes ---- */

static const lg_key_value *at(const reader *r, const char *key) {
    return lg_yaml_value(keys, r->values, key);
}

static lg_status fail_at(reader *r, const yaml_node_t *node, const char *key, const char *what) {
    return LG_FAIL_AT(r->yaml, node, r->error, "%s: %s", key, what);
}

/* Reads a decimal number or a quotient "a/b" of two decimal numbers. */
static lg_status read_number(reader *r, const yaml_node_t *node, const char *key, double *out) {
    char text[SYNTAX_SIZE] = "";
    double above = NAN, below = 1;
    bool good = node->type == YAML_SCALAR_NODE && node->data.scalar.length < sizeof text &&
                memchr(node->data.scalar.value, '\0', node->data.scalar.length) == NULL;
    if (!good) return fail_at(r, node, key, "a number is expected");
    memcpy(text, node->data.scalar.value, node->data.scalar.length);
    char *slash = strchr(text, '/');
    if (slash != NULL) *slash = '\0';
    good = lg_number_parse(text, &above) == LG_OK &&
           (slash == NULL || lg_number_parse(slash + 1, &below) == LG_OK);
    if (slash != NULL) *slash = '/';
    if (good && isfinite(above / below)) {
        *out = above / below;
        return LG_OK;
    }
    return LG_FAIL_AT(r->yaml, node, r->error, "%s: '%s' is neither a number nor a quotient a/b", key, text);
}

/* Reads a list of at most `most` numbers into `out`. Entries of `out` beyond the list are unchanged. */
static lg_status read_list(reader *r, const yaml_node_t *node, const char *key, size_t most, double *out,
                           size_t *count) {
    if (node->type != YAML_SEQUENCE_NODE) return fail_at(r, node, key, "a list of numbers is expected");
    *count = lg_node_length(node);
    if (*count > most)
        return LG_FAIL_AT(r->yaml, node, r->error, "%s: %zu numbers, at most %zu are expected", key, *count,
                          most);
    for (size_t i = 0; i < *count; i++) LG_TRY(read_number(r, lg_node_item(r->yaml, node, i), key, &out[i]));
    return LG_OK;
}

/* Reads a list with exactly one number per stage. */
static lg_status read_stages(reader *r, const char *key, size_t stages, double *out) {
    const yaml_node_t *node = at(r, key)->node;
    size_t count = 0;
    LG_TRY(read_list(r, node, key, stages, out, &count));
    if (count == stages) return LG_OK;
    return LG_FAIL_AT(r->yaml, node, r->error,
                      "%s: %zu numbers are given, expected one for each of the %zu stages", key, count,
                      stages);
}

/* Sets the number of stages to the length of the key's list, minus `more`. */
static lg_status count_stages(reader *r, const char *key, size_t more) {
    const yaml_node_t *node = at(r, key)->node;
    const size_t stages = lg_node_length(node) - (lg_node_length(node) > more ? more : lg_node_length(node));
    if (stages < 1 || stages > LG_SCHEME_MAX_STAGES)
        return LG_FAIL_AT(r->yaml, node, r->error, "%s: the scheme has %zu stages, expected 1 to %d", key,
                          stages, LG_SCHEME_MAX_STAGES);
    r->out->scheme.stages = (int)stages;
    return LG_OK;
}

static double sum(const double *x, size_t n) {
    double s = 0;
    for (size_t i = 0; i < n; i++) s += x[i];
    return s;
}

/* ---- tableaus ---- */

static lg_status read_commutators(reader *r) {
    const yaml_node_t *node = at(r, "commutators")->node;
    const int stages = r->out->scheme.stages;
    if (lg_node_length(node) < 1 || lg_node_length(node) > LG_COUNT(r->out->commutators))
        return fail_at(r, node, "commutators", "a list of [row, first, second, weight] is expected");
    for (size_t i = 0; i < lg_node_length(node); i++) {
        const yaml_node_t *item = lg_node_item(r->yaml, node, i);
        double numbers[4];
        size_t count = 0;
        LG_TRY(read_list(r, item, "commutators", 4, numbers, &count));
        for (size_t k = 0; k < 3; k++)
            if (count != 4 || numbers[k] != floor(numbers[k]) || numbers[k] < 1 ||
                numbers[k] > stages + (k == 0))
                return fail_at(r, item, "commutators",
                               "[row, first, second, weight] with stages counted from 1 is expected");
        r->out->commutators[i] =
            (lg_commutator){(int)numbers[0] - 1, (int)numbers[1] - 1, (int)numbers[2] - 1, numbers[3]};
    }
    r->out->scheme.commutators = r->out->commutators;
    r->out->scheme.commutator_count = (int)lg_node_length(node);
    return LG_OK;
}

static lg_status read_dexpinv(reader *r) {
    const lg_key_value *value = at(r, "dexpinv");
    uint64_t terms = 0;
    r->out->scheme.dexpinv = at(r, "commutators")->line > 0 ? 0 : LG_DEXPINV_EXACT;
    if (value->line == 0) return LG_OK;
    const bool exact = strcmp(value->text, "exact") == 0;
    if (!exact && (lg_integer_parse(value->text, &terms) != LG_OK || terms > LG_DEXPINV_MAX))
        return lg_yaml_fail(r->yaml, value->line, LG_FORMAT, r->error,
                            "dexpinv: '%s' is neither `exact` nor a whole number from 0 to %d", value->text,
                            LG_DEXPINV_MAX);
    r->out->scheme.dexpinv = exact ? LG_DEXPINV_EXACT : (int)terms;
    return LG_OK;
}

static lg_status read_tableau(reader *r) {
    lg_scheme *s = &r->out->scheme;
    const yaml_node_t *a = at(r, "a")->node;
    LG_TRY(count_stages(r, "b", 0));
    const size_t stages = (size_t)s->stages;
    LG_TRY(read_stages(r, "b", stages, s->b));
    if (lg_node_length(a) != stages)
        return fail_at(r, a, "a", "a list for each stage is expected, the first one empty");
    for (size_t i = 0; i < stages; i++) {
        size_t count = 0;
        LG_TRY(read_list(r, lg_node_item(r->yaml, a, i), "a", stages, s->a[i], &count));
        s->c[i] = sum(s->a[i], stages);
    }
    if (at(r, "embedded")->line > 0) LG_TRY(read_stages(r, "embedded", stages, s->embedded));
    if (at(r, "commutators")->line > 0) LG_TRY(read_commutators(r));
    s->fsal = stages > 1 && memcmp(s->a[stages - 1], s->b, sizeof s->b) == 0;
    return read_dexpinv(r);
}

/* ---- rows of exponentials ---- */

/* Reads a list of exponentials, each a list of coefficients. A plain list of numbers is one exponential. */
static lg_status read_exponentials(reader *r, const yaml_node_t *node, const char *key, lg_cf_row *row) {
    size_t count = 0;
    const size_t stages = (size_t)r->out->scheme.stages, items = lg_node_length(node);
    if (node->type != YAML_SEQUENCE_NODE || items > LG_SCHEME_MAX_EXPONENTIALS * (size_t)LG_SCHEME_MAX_STAGES)
        return fail_at(r, node, key, "a list of exponentials is expected, each a list of coefficients");
    if (items > 0 && lg_node_item(r->yaml, node, 0)->type == YAML_SCALAR_NODE) {
        row->exponentials = 1;
        return read_list(r, node, key, stages, row->coefficient[0], &count);
    }
    if (items > LG_SCHEME_MAX_EXPONENTIALS) return fail_at(r, node, key, "too many exponentials");
    row->exponentials = (int)items;
    for (size_t e = 0; e < items; e++)
        LG_TRY(read_list(r, lg_node_item(r->yaml, node, e), key, stages, row->coefficient[e], &count));
    return LG_OK;
}

/* Reads {base: i, exponentials: [...]}; i is the number of a stage, counted from 1. */
static lg_status read_mapped_row(reader *r, const yaml_node_t *node, const char *key, lg_cf_row *row) {
    yaml_document_t *document = lg_yaml_document(r->yaml);
    const yaml_node_pair_t *pair = node->data.mapping.pairs.start;
    unsigned seen = 0;
    for (; pair < node->data.mapping.pairs.top; pair++) {
        const yaml_node_t *name = yaml_document_get_node(document, pair->key);
        const yaml_node_t *value = yaml_document_get_node(document, pair->value);
        const char *text = name->type == YAML_SCALAR_NODE ? (const char *)name->data.scalar.value : "";
        const unsigned bit = strcmp(text, "base") == 0 ? 1U : strcmp(text, "exponentials") == 0 ? 2U : 0U;
        if (bit == 0 || (seen & bit) != 0)
            return fail_at(r, name, key,
                           "the keys `base` and `exponentials` are expected, each at most once");
        seen |= bit;
        if (bit == 2U) {
            LG_TRY(read_exponentials(r, value, key, row));
            continue;
        }
        double base = 0;
        LG_TRY(read_number(r, value, key, &base));
        if (base != floor(base) || base < 1 || base > r->out->scheme.stages)
            return fail_at(r, value, key, "base: the number of a stage is expected, from 1");
        row->base = (int)base - 1;
    }
    return LG_OK;
}

static lg_status read_row(reader *r, const yaml_node_t *node, const char *key, lg_cf_row *row) {
    row->base = LG_CF_START;
    return node->type == YAML_MAPPING_NODE ? read_mapped_row(r, node, key, row)
                                           : read_exponentials(r, node, key, row);
}

static lg_status read_rows(reader *r) {
    lg_scheme *s = &r->out->scheme;
    const yaml_node_t *node = at(r, "rows")->node;
    LG_TRY(count_stages(r, "rows", 1));
    for (int i = 0; i <= s->stages; i++) {
        lg_cf_row *row = &r->out->rows[i];
        LG_TRY(read_row(r, lg_node_item(r->yaml, node, (size_t)i), "rows", row));
        if (i == s->stages) break;
        if (row->base >= i)
            return fail_at(r, lg_node_item(r->yaml, node, (size_t)i), "rows",
                           "base must be the number of an earlier stage");
        s->c[i] = row->base >= 0 ? s->c[row->base] : 0;
        for (int e = 0; e < row->exponentials; e++) s->c[i] += sum(row->coefficient[e], LG_SCHEME_MAX_STAGES);
    }
    if (at(r, "embedded")->line > 0)
        LG_TRY(read_row(r, at(r, "embedded")->node, "embedded", &r->out->rows[s->stages + 1]));
    s->rows = r->out->rows;
    return LG_OK;
}

static lg_status read_splitting(reader *r) {
    lg_scheme *s = &r->out->scheme;
    LG_TRY(count_stages(r, "kick", 0));
    LG_TRY(read_stages(r, "kick", (size_t)s->stages, s->kick));
    return read_stages(r, "drift", (size_t)s->stages, s->drift);
}

/* ---- the whole file ---- */

static lg_status check_keys(reader *r, file_kind kind) {
    for (int i = 0; i < KEYS; i++) {
        const uint32_t line = r->values[i].line;
        const bool allowed = keys[i].methods == 0 || (keys[i].methods & BIT(kind)) != 0;
        if (line > 0 && !allowed)
            return lg_yaml_fail(r->yaml, line, LG_FORMAT, r->error, "%s: a scheme of kind %s has no such key",
                                keys[i].name, kinds[kind].name);
        bool wanted = false;
        for (size_t k = 0; k < LG_COUNT(needed); k++) wanted = wanted || strcmp(keys[i].name, needed[k]) == 0;
        if (line == 0 && allowed && wanted)
            return lg_yaml_fail(r->yaml, at(r, "kind")->line, LG_FORMAT, r->error,
                                "a scheme of kind %s needs the key '%s'", kinds[kind].name, keys[i].name);
    }
    const uint32_t weights = at(r, "embedded")->line, order = at(r, "embedded_order")->line;
    if ((weights > 0) != (order > 0))
        return lg_yaml_fail(r->yaml, weights > 0 ? weights : order, LG_FORMAT, r->error,
                            "embedded and embedded_order must be given together");
    return LG_OK;
}

static void set_name(reader *r) {
    const char *path = lg_yaml_path(r->yaml), *slash = strrchr(path, '/');
    const char *name = at(r, "name")->line > 0 ? at(r, "name")->text : slash != NULL ? slash + 1 : path;
    const size_t length = strnlen(name, sizeof r->out->name - 1);
    memcpy(r->out->name, name, length);
    r->out->name[length] = '\0';
    r->out->scheme.name = r->out->name;
}

static lg_status read_scheme(reader *r) {
    static lg_status (*const read_kind[KIND_COUNT])(reader *) = {
        [KIND_RKMK] = read_tableau,
        [KIND_RUNGE_KUTTA] = read_tableau,
        [KIND_COMMUTATOR_FREE] = read_rows,
        [KIND_SPLITTING] = read_splitting,
    };
    const lg_key_set set = {keys, KEYS, r->values};
    lg_scheme *s = &r->out->scheme;
    lg_error fault = {LG_OK, ""};
    LG_TRY(lg_yaml_read(r->yaml, &set, 1, NULL, "scheme", r->error));
    const file_kind kind = (file_kind)(int)at(r, "kind")->real[0];
    LG_TRY(check_keys(r, kind));
    set_name(r);
    s->kind = kinds[kind].kind;
    s->ambient = kinds[kind].ambient;
    LG_TRY(lg_yaml_store(r->yaml, keys, r->values, KEYS, s, r->error));
    LG_TRY(read_kind[kind](r));
    if (at(r, "c")->line > 0) LG_TRY(read_stages(r, "c", (size_t)s->stages, s->c));
    if (lg_scheme_check(s, &fault) == LG_OK) return LG_OK;
    return lg_yaml_fail(r->yaml, at(r, "kind")->line, LG_FORMAT, r->error, "%s", fault.message);
}

lg_status lg_scheme_read(const lg_context *context, const char *path, lg_scheme **out, lg_error *error) {
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    if (out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "`out` is NULL");
    LG_TRY(lg_yaml_open(context, path, &yaml, error));
    LG_SCRATCH(reader, r, context, 1);
    LG_SCRATCH(scheme_file, file, context, 1);
    if (r == NULL || file == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", path);
    r->yaml = yaml;
    r->out = file;
    r->error = error;
    file->context = context;
    LG_TRY(read_scheme(r));
    *out = &LG_KEEP(file)->scheme;
    return LG_OK;
}

void lg_scheme_destroy(lg_scheme *scheme) {
    scheme_file *file = (scheme_file *)scheme;
    if (file != NULL) lg_free(file->context, file);
}
