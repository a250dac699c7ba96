#include "files/h5.h"
#include "files/read_file.h"
#include "settings/files/yaml.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define MAX_BYTES ((size_t)1 << 20)
#define MAX_DEPTH 16 /* most lists and mappings that are open at once */
#define NAME_SIZE 64

struct lg_yaml {
    const lg_context *context;
    const char *path; /* owned by the caller */
    yaml_parser_t parser;
    const unsigned char *data; /* (bytes): what the parser reads; owned by the caller */
    size_t bytes;
    yaml_document_t document;
    yaml_node_t *root; /* NULL: there are no more documents */
};

const char *lg_yaml_path(const lg_yaml *yaml) {
    return yaml->path;
}

yaml_document_t *lg_yaml_document(lg_yaml *yaml) {
    return &yaml->document;
}

lg_status lg_yaml_fail(const lg_yaml *yaml, uint32_t line, lg_status status, lg_error *error,
                       const char *format, ...) {
    char text[400];
    va_list arguments;
    va_start(arguments, format);
    (void)lg_format_list(text, sizeof text, format, arguments);
    va_end(arguments);
    return lg_fail(error, status, "%s: line %u: %s", lg_shown_path(yaml->path), line, text);
}

/* ---- nodes ---- */

uint32_t lg_node_line(const yaml_node_t *node) {
    return (uint32_t)node->start_mark.line + 1;
}

yaml_node_t *lg_node_at(lg_yaml *yaml, int index) {
    return yaml_document_get_node(&yaml->document, index);
}

size_t lg_node_length(const yaml_node_t *node) {
    if (node->type != YAML_SEQUENCE_NODE) return 0;
    return (size_t)(node->data.sequence.items.top - node->data.sequence.items.start);
}

const yaml_node_t *lg_node_item(lg_yaml *yaml, const yaml_node_t *node, size_t i) {
    return node->type == YAML_SEQUENCE_NODE ? lg_node_at(yaml, node->data.sequence.items.start[i]) : node;
}

const char *lg_node_text(const yaml_node_t *node, size_t size) {
    if (node->type != YAML_SCALAR_NODE || node->data.scalar.length >= size) return NULL;
    const char *text = (const char *)node->data.scalar.value;
    return strlen(text) == node->data.scalar.length ? text : NULL;
}

/* ---- opening ---- */

lg_status lg_yaml_bytes(const lg_context *context, const char *path, unsigned char **out, size_t *bytes,
                        lg_error *error) {
    if (path == NULL || *path == '\0') return lg_fail(error, LG_INVALID_ARGUMENT, "a file needs a name");
    const char *shown = lg_shown_path(path);
    FILE *file;
    uint64_t told;
    LG_TRY(lg_read_open(path, &file, &told, error));
    /* One byte more than the file's size, to notice that the file is growing. */
    const size_t room = (told < MAX_BYTES ? (size_t)told : MAX_BYTES) + 1;
    LG_SCRATCH(unsigned char, data, context, room + 1);
    const size_t size = data != NULL ? fread(data, 1, room, file) : 0;
    const bool broken = ferror(file) != 0;
    (void)fclose(file);
    if (data == NULL) return lg_no_memory_for(shown, error);
    if (broken) return lg_fail(error, LG_FILE, "%s: cannot be read", shown);
    if (size > MAX_BYTES) return lg_fail(error, LG_FORMAT, "%s: is larger than %zu bytes", shown, MAX_BYTES);
    if (size == room) return lg_fail(error, LG_FILE, "%s: is being written", shown);
    if (size == 0) return lg_fail(error, LG_FORMAT, "%s: line 1: is empty", shown);
    *out = LG_KEEP(data);
    *bytes = size;
    return LG_OK;
}

static lg_status parser_error(const char *path, const yaml_parser_t *parser, const unsigned char *data,
                              size_t bytes, lg_error *error) {
    if (parser->error == YAML_MEMORY_ERROR) return lg_no_memory_for(path, error);
    size_t line = parser->problem_mark.line + 1;
    if (parser->error == YAML_READER_ERROR) { /* this kind of error has only an offset, no line */
        line = 1;
        for (size_t i = 0; i < parser->problem_offset && i < bytes; i++) line += data[i] == '\n';
    }
    return lg_fail(error, LG_FORMAT, "%s: line %zu: is not YAML: %s", lg_shown_path(path), line,
                   parser->problem != NULL ? parser->problem : "unknown problem");
}

/* Returns 1 for a token that begins a list or mapping, -1 for one that ends it, else 0. */
static int steps_in(yaml_token_type_t type) {
    const bool begins = type == YAML_BLOCK_SEQUENCE_START_TOKEN || type == YAML_BLOCK_MAPPING_START_TOKEN ||
                        type == YAML_FLOW_SEQUENCE_START_TOKEN || type == YAML_FLOW_MAPPING_START_TOKEN;
    const bool ends = type == YAML_BLOCK_END_TOKEN || type == YAML_FLOW_SEQUENCE_END_TOKEN ||
                      type == YAML_FLOW_MAPPING_END_TOKEN;
    return begins - ends;
}

/* libyaml takes quadratic time for many anchors, for many %TAG lines and for deep nesting. An alias could
 * also make a value part of itself, or a small file a huge document. */
static lg_status check_tokens(const char *path, const unsigned char *data, size_t bytes, lg_error *error) {
    LG_CLEAN(yaml_parser_delete) yaml_parser_t parser = {0};
    int depth = 0;
    if (!yaml_parser_initialize(&parser)) return lg_no_memory_for(path, error);
    yaml_parser_set_input_string(&parser, data, bytes);
    for (bool more = true; more;) {
        LG_CLEAN(yaml_token_delete) yaml_token_t token = {0};
        if (!yaml_parser_scan(&parser, &token)) return parser_error(path, &parser, data, bytes, error);
        depth += steps_in(token.type);
        if (depth < 0) depth = 0;
        const bool alias = token.type == YAML_ANCHOR_TOKEN || token.type == YAML_ALIAS_TOKEN;
        const char *why =
            alias ? "anchors (&) and aliases (*) are not read: write out the value, or put the text in quotes"
            : token.type == YAML_TAG_DIRECTIVE_TOKEN ? "%TAG is not read"
            : depth > MAX_DEPTH                      ? "lists and mappings are nested too deep"
                                                     : NULL;
        if (why != NULL)
            return lg_fail(error, LG_FORMAT, "%s: line %zu: %s", lg_shown_path(path),
                           token.start_mark.line + 1, why);
        more = token.type != YAML_STREAM_END_TOKEN;
    }
    return LG_OK;
}

static lg_status load(lg_yaml *yaml, yaml_document_t *out, lg_error *error) {
    return yaml_parser_load(&yaml->parser, out)
               ? LG_OK
               : parser_error(yaml->path, &yaml->parser, yaml->data, yaml->bytes, error);
}

lg_status lg_yaml_next(lg_yaml *yaml, bool *more, lg_error *error) {
    yaml_document_delete(&yaml->document);
    LG_TRY(load(yaml, &yaml->document, error));
    yaml->root = yaml_document_get_root_node(&yaml->document);
    *more = yaml->root != NULL;
    if (!*more || yaml->root->type == YAML_MAPPING_NODE) return LG_OK;
    return LG_FAIL_AT(yaml, yaml->root, error, "keys and values are expected");
}

lg_status lg_yaml_open_several(const lg_context *context, const char *path, const void *data, size_t bytes,
                               lg_yaml **out, lg_error *error) {
    if (bytes > MAX_BYTES)
        return lg_fail(error, LG_FORMAT, "%s: is larger than %zu bytes", lg_shown_path(path), MAX_BYTES);
    LG_TRY(check_tokens(path, data, bytes, error));
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = lg_alloc(context, 1, sizeof *yaml);
    if (yaml != NULL) *yaml = (lg_yaml){.context = context, .path = path, .data = data, .bytes = bytes};
    if (yaml == NULL || !yaml_parser_initialize(&yaml->parser)) return lg_no_memory_for(path, error);
    yaml_parser_set_input_string(&yaml->parser, data, bytes);
    bool any;
    LG_TRY(lg_yaml_next(yaml, &any, error));
    if (!any) return lg_fail(error, LG_FORMAT, "%s: line 1: holds no keys and values", lg_shown_path(path));
    return LG_MOVE(out, yaml);
}

lg_status lg_yaml_open_text(const lg_context *context, const char *path, const void *data, size_t bytes,
                            lg_yaml **out, lg_error *error) {
    LG_CLEAN(yaml_document_delete) yaml_document_t next = {0};
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    LG_TRY(lg_yaml_open_several(context, path, data, bytes, &yaml, error));
    LG_TRY(load(yaml, &next, error));
    const yaml_node_t *second = yaml_document_get_root_node(&next);
    if (second == NULL) return LG_MOVE(out, yaml);
    return LG_FAIL_AT(yaml, second, error, "a second document begins here, but a file can have only one");
}

lg_status lg_yaml_open(const lg_context *context, const char *path, lg_yaml **out, lg_error *error) {
    unsigned char *data = NULL;
    size_t bytes = 0;
    LG_TRY(lg_yaml_bytes(context, path, &data, &bytes, error));
    const lg_status status = lg_yaml_open_text(context, path, data, bytes, out, error);
    lg_free(context, data);
    return status;
}

void lg_yaml_close(lg_yaml *yaml) {
    if (yaml == NULL) return;
    yaml_document_delete(&yaml->document);
    yaml_parser_delete(&yaml->parser);
    lg_free(yaml->context, yaml);
}

/* ---- scalars ---- */

/* Copies a scalar's text for an error message: cut to NAME_SIZE - 1 bytes, control characters replaced. */
static const char *shown(const yaml_node_t *node, char out[NAME_SIZE]) {
    size_t length = node->data.scalar.length, used = 0;
    for (; used < length && used < NAME_SIZE - 1; used++) {
        const char c = (char)node->data.scalar.value[used];
        out[used] = c == '\0' ? '?' : c;
    }
    out[used] = '\0';
    (void)lg_tame(out);
    return out;
}

static lg_status read_number(const lg_yaml *yaml, const lg_field *key, const yaml_node_t *node, double *out,
                             lg_error *error) {
    char show[NAME_SIZE];
    const char *text = lg_node_text(node, 512);
    bool whole = key->type == LG_FIELD_U32 || key->type == LG_FIELD_U64 || key->type == LG_FIELD_WHOLES;
    if (node->type != YAML_SCALAR_NODE)
        return LG_FAIL_AT(yaml, node, error, "%s: a number is expected", key->name);
    lg_status status = LG_FORMAT;
    if (text != NULL && node->data.scalar.style == YAML_PLAIN_SCALAR_STYLE)
        status = lg_number_parse(text, out);
    if (status == LG_OUT_OF_MEMORY)
        return lg_yaml_fail(yaml, lg_node_line(node), status, error, "%s: out of memory", key->name);
    if (status != LG_OK)
        return LG_FAIL_AT(yaml, node, error, "%s: '%s' is not %s number", key->name, shown(node, show),
                          status == LG_NOT_FINITE    ? "a finite"
                          : status == LG_UNSUPPORTED ? "below 2^53 and would be rounded, so it is no"
                                                     : "a");
    if (whole && !(*out >= 0 && *out <= 0x1p53 && *out == (double)(uint64_t)*out))
        return LG_FAIL_AT(yaml, node, error, "%s: '%s' is not a whole number", key->name, shown(node, show));
    if (*out < key->low || *out > key->high || (key->above && *out == key->low))
        return LG_FAIL_AT(yaml, node, error, "%s: %s is outside %s%g, %g]", key->name, shown(node, show),
                          key->above ? "(" : "[", key->low, key->high);
    return LG_OK;
}

static lg_status read_name(const lg_yaml *yaml, const lg_field *key, const yaml_node_t *node, double *out,
                           lg_error *error) {
    char show[NAME_SIZE];
    lg_name_list known = {.used = 0};
    const char *text = lg_node_text(node, NAME_SIZE);
    if (node->type != YAML_SCALAR_NODE)
        return LG_FAIL_AT(yaml, node, error, "%s: a name is expected", key->name);
    uint32_t value;
    if (text != NULL && lg_field_find_name(key, text, &value)) {
        *out = value;
        return LG_OK;
    }
    const char *name;
    for (value = 0; (name = lg_field_name(key, value)) != NULL; value++) lg_name_list_add(&known, name);
    return LG_FAIL_AT(yaml, node, error, "%s: '%s' is none of %s%s", key->name, shown(node, show), known.text,
                      key->hint != NULL ? key->hint : "");
}

/* ---- values ---- */

static lg_status add_scalar(const lg_yaml *yaml, const lg_field *key, const yaml_node_t *node,
                            lg_key_value *value, lg_error *error) {
    if (value->count >= LG_VALUES)
        return LG_FAIL_AT(yaml, node, error, "%s: there are too many values", key->name);
    double number = 0;
    const bool name = key->type == LG_FIELD_NAME || key->type == LG_FIELD_NAMES || key->type == LG_FIELD_FLAG;
    LG_TRY(name ? read_name(yaml, key, node, &number, error) : read_number(yaml, key, node, &number, error));
    value->real[value->count++] = number;
    return LG_OK;
}

static lg_status read_list(lg_yaml *yaml, const lg_field *key, const yaml_node_t *node, lg_key_value *value,
                           lg_error *error) {
    if (node->type == YAML_SCALAR_NODE) return add_scalar(yaml, key, node, value, error);
    if (node->type != YAML_SEQUENCE_NODE)
        return LG_FAIL_AT(yaml, node, error, "%s: a list is expected", key->name);
    const size_t count = lg_node_length(node);
    if (count == 0 || count > key->most)
        return LG_FAIL_AT(yaml, node, error, "%s: has %zu values, 1 to %u are expected", key->name, count,
                          key->most);
    for (size_t i = 0; i < count; i++)
        LG_TRY(add_scalar(yaml, key, lg_node_item(yaml, node, i), value, error));
    return LG_OK;
}

/* True if the field is an integer up to 2^64 - 1, which may be too large for a double to hold exactly. */
static bool is_exact(const lg_field *key) {
    return key->type == LG_FIELD_U64 && key->high == 0x1p64;
}

static lg_status read_whole(const lg_yaml *yaml, const lg_field *key, const yaml_node_t *node,
                            lg_key_value *value, lg_error *error) {
    char show[NAME_SIZE];
    const char *text = lg_node_text(node, 64);
    if (node->type != YAML_SCALAR_NODE)
        return LG_FAIL_AT(yaml, node, error, "%s: a whole number is expected", key->name);
    if (text == NULL || node->data.scalar.style != YAML_PLAIN_SCALAR_STYLE ||
        lg_integer_parse(text, &value->whole) != LG_OK)
        return LG_FAIL_AT(yaml, node, error, "%s: '%s' is not a whole number", key->name, shown(node, show));
    return LG_OK;
}

static lg_status read_text(const lg_yaml *yaml, const lg_field *key, const yaml_node_t *node,
                           lg_key_value *value, lg_error *error) {
    const char *text = lg_node_text(node, sizeof value->text);
    if (text == NULL || *text == '\0')
        return LG_FAIL_AT(yaml, node, error, "%s: a text of 1 to %zu bytes is expected", key->name,
                          sizeof value->text - 1);
    memcpy(value->text, text, strlen(text) + 1);
    return LG_OK;
}

static lg_status read_value(lg_yaml *yaml, const lg_field *key, const yaml_node_t *node, lg_key_value *value,
                            lg_error *error) {
    *value = (lg_key_value){.line = lg_node_line(node)};
    if (is_exact(key)) return read_whole(yaml, key, node, value, error);
    switch (key->type) {
    case LG_FIELD_TEXT:
    case LG_FIELD_PHRASE:
        return read_text(yaml, key, node, value, error);
    case LG_FIELD_REALS:
    case LG_FIELD_WHOLES:
    case LG_FIELD_NAMES:
        return read_list(yaml, key, node, value, error);
    case LG_FIELD_NODE:
        value->node = node;
        return LG_OK;
    case LG_FIELD_MAP:
        break;
    default:
        return add_scalar(yaml, key, node, value, error);
    }
    if (node->type == YAML_MAPPING_NODE) return LG_OK;
    return LG_FAIL_AT(yaml, node, error, "%s: keys and values are expected", key->name);
}

/* ---- blocks ---- */

lg_status lg_yaml_entries(lg_yaml *yaml, const lg_field *key, const lg_key_value *value, size_t inner,
                          size_t *out, lg_error *error) {
    const yaml_node_t *node = value->node;
    const size_t length = lg_node_length(node);
    bool alone = node->type == YAML_SCALAR_NODE && inner == 1;
    if (!alone && node->type != YAML_SEQUENCE_NODE)
        return LG_FAIL_AT(yaml, node, error, "%s: a list is expected", key->name);
    if (!alone && length == 0) return LG_FAIL_AT(yaml, node, error, "%s: is an empty list", key->name);
    if (!alone && inner > 1) alone = lg_node_item(yaml, node, 0)->type == YAML_SCALAR_NODE;
    *out = alone ? 1 : length;
    return LG_OK;
}

typedef struct block {
    lg_yaml *yaml;
    const lg_field *key;
    const size_t *shape; /* length of each of the 3 levels */
    double *out;         /* where the next number goes */
    uint32_t *line;      /* where the next number's line goes, or NULL */
    lg_error *error;
} block;

static lg_status read_level(block *b, const yaml_node_t *node, size_t level) {
    if (level == 3) {
        LG_TRY(read_number(b->yaml, b->key, node, b->out, b->error));
        b->out++;
        if (b->line != NULL) *b->line++ = lg_node_line(node);
        return LG_OK;
    }
    const size_t expected = b->shape[level], length = lg_node_length(node);
    if (expected == 1 && length != 1) return read_level(b, node, level + 1);
    size_t inner = 1;
    for (size_t l = level + 1; l < 3; l++) inner *= b->shape[l];
    const char *what = inner == 1 ? "number" : "row", *plural = expected == 1 ? "" : "s";
    if (node->type != YAML_SEQUENCE_NODE)
        return LG_FAIL_AT(b->yaml, node, b->error, "%s: a list of %zu %s%s is expected", b->key->name,
                          expected, what, plural);
    if (length != expected)
        return LG_FAIL_AT(b->yaml, node, b->error, "%s: has %zu %s%s, %zu are expected", b->key->name, length,
                          what, length == 1 ? "" : "s", expected);
    for (size_t i = 0; i < length; i++) LG_TRY(read_level(b, lg_node_item(b->yaml, node, i), level + 1));
    return LG_OK;
}

lg_status lg_yaml_block(lg_yaml *yaml, const lg_field *key, const lg_key_value *value, const size_t shape[3],
                        double *out, uint32_t *lines, lg_error *error) {
    block b = {yaml, key, shape, out, lines, error};
    return read_level(&b, value->node, 0);
}

/* ---- mappings ---- */

const yaml_node_t *lg_node_below(const lg_yaml *yaml, const yaml_node_t *map, const char *key) {
    yaml_document_t *document = (yaml_document_t *)&yaml->document; /* only read here */
    const size_t length = strcspn(key, ".");
    if (map->type != YAML_MAPPING_NODE) return NULL;
    const yaml_node_pair_t *pair = map->data.mapping.pairs.start;
    for (; pair < map->data.mapping.pairs.top; pair++) {
        const char *text = lg_node_text(yaml_document_get_node(document, pair->key), NAME_SIZE);
        if (text != NULL && strlen(text) == length && memcmp(text, key, length) == 0)
            return yaml_document_get_node(document, pair->value);
    }
    return NULL;
}

bool lg_yaml_has(const lg_yaml *yaml, const char *key) {
    const char *dot = strchr(key, '.');
    const yaml_node_t *node = lg_node_below(yaml, yaml->root, key);
    return node != NULL && (dot == NULL || lg_node_below(yaml, node, dot + 1) != NULL);
}

lg_status lg_yaml_name(lg_yaml *yaml, const lg_field *key, lg_key_value *value, lg_error *error) {
    const yaml_node_t *node = lg_node_below(yaml, yaml->root, key->name);
    if (node == NULL) return LG_FAIL_AT(yaml, yaml->root, error, "key '%s' is missing", key->name);
    return read_value(yaml, key, node, value, error);
}

typedef struct reading {
    lg_yaml *yaml;
    const lg_key_set *sets;
    size_t set_count;
    bool (*elsewhere)(const char *name);
    const char *system;
    lg_error *error;
} reading;

static const lg_field *find_key(const reading *r, const char *name, lg_key_value **value) {
    for (size_t s = 0; s < r->set_count; s++) {
        for (size_t i = 0; i < r->sets[s].count; i++) {
            const lg_field *key = &r->sets[s].keys[i];
            if (strcmp(key->name, name) != 0 && (key->option == NULL || strcmp(key->option, name) != 0))
                continue;
            *value = &r->sets[s].values[i];
            return key;
        }
    }
    return NULL;
}

/* If the key is directly below `prefix`, returns its name without the prefix, else NULL. */
static const char *name_below(const lg_field *key, const char *prefix) {
    const size_t length = strlen(prefix);
    const bool here = strncmp(key->name, prefix, length) == 0 && strchr(key->name + length, '.') == NULL;
    return here ? key->name + length : NULL;
}

/* Reports a key that is not in the tables. `elsewhere` says that other systems have this key. */
static lg_status unknown_key(const reading *r, const yaml_node_t *node, const char *prefix, bool elsewhere) {
    char show[NAME_SIZE];
    lg_name_list known = {.used = 0};
    for (size_t s = 0; s < r->set_count; s++)
        for (size_t i = 0; i < r->sets[s].count; i++) {
            const char *name = name_below(&r->sets[s].keys[i], prefix);
            if (name != NULL) lg_name_list_add(&known, name);
        }
    const char *key = shown(node, show);
    if (elsewhere)
        return LG_FAIL_AT(r->yaml, node, r->error, "key '%s%s' does not belong to system %s; known: %s",
                          prefix, key, r->system, known.text);
    return LG_FAIL_AT(r->yaml, node, r->error, "unknown key '%s%s'; known: %s", prefix, key, known.text);
}

static lg_status read_map(const reading *r, const yaml_node_t *map, const char *prefix);

static lg_status read_pair(const reading *r, const yaml_node_t *key_node, const yaml_node_t *node,
                           const char *prefix) {
    char name[2 * NAME_SIZE];
    lg_key_value *value = NULL;
    uint32_t line = lg_node_line(key_node);
    const char *text = lg_node_text(key_node, NAME_SIZE);
    if (key_node->type != YAML_SCALAR_NODE)
        return lg_yaml_fail(r->yaml, line, LG_FORMAT, r->error, "a key must be a plain name");
    /* A name with a dot would be mistaken for a key of an inner mapping. */
    if (text == NULL || strchr(text, '.') != NULL) return unknown_key(r, key_node, prefix, false);
    (void)snprintf(name, sizeof name, "%s%s", prefix, text);
    const lg_field *key = find_key(r, name, &value);
    if (key == NULL) return unknown_key(r, key_node, prefix, r->elsewhere != NULL && r->elsewhere(name));
    if (value->line != 0)
        return lg_yaml_fail(r->yaml, line, LG_FORMAT, r->error, "key '%s' stands twice, first on line %u",
                            name, value->line);
    LG_TRY(read_value(r->yaml, key, node, value, r->error));
    if (key->type != LG_FIELD_MAP) return LG_OK;
    char inner[2 * NAME_SIZE];
    (void)snprintf(inner, sizeof inner, "%s.", key->name);
    return read_map(r, node, inner);
}

static lg_status read_map(const reading *r, const yaml_node_t *map, const char *prefix) {
    const yaml_node_pair_t *pair = map->data.mapping.pairs.start;
    for (; pair < map->data.mapping.pairs.top; pair++)
        LG_TRY(read_pair(r, yaml_document_get_node(&r->yaml->document, pair->key),
                         yaml_document_get_node(&r->yaml->document, pair->value), prefix));
    for (size_t s = 0; s < r->set_count; s++) /* required keys directly below `prefix` */
        for (size_t i = 0; i < r->sets[s].count; i++) {
            const lg_field *key = &r->sets[s].keys[i];
            if (key->required && r->sets[s].values[i].line == 0 && name_below(key, prefix) != NULL)
                return LG_FAIL_AT(r->yaml, map, r->error, "key '%s' is missing", key->name);
        }
    return LG_OK;
}

static lg_status read_keys(const reading *r, const yaml_node_t *map) {
    for (size_t s = 0; s < r->set_count; s++)
        for (size_t i = 0; i < r->sets[s].count; i++) r->sets[s].values[i].line = 0;
    return read_map(r, map, "");
}

lg_status lg_yaml_read(lg_yaml *yaml, const lg_key_set *sets, size_t set_count,
                       bool (*elsewhere)(const char *name), const char *system, lg_error *error) {
    const reading r = {yaml, sets, set_count, elsewhere, system, error};
    return read_keys(&r, yaml->root);
}

static lg_status store(const lg_yaml *yaml, const lg_field *key, const lg_key_value *value, void *into,
                       lg_error *error) {
    lg_error reason = {LG_OK, ""};
    if (key->type == LG_FIELD_TEXT)
        (void)snprintf((char *)into + key->offset, key->size, "%s", value->text);
    else if (is_exact(key))
        memcpy((char *)into + key->offset, &value->whole, sizeof value->whole);
    else if (key->type != LG_FIELD_PHRASE)
        lg_field_fill(key, value->real, value->count, into);
    else if (lg_field_set(key, value->text, into, &reason) != LG_OK)
        return lg_yaml_fail(yaml, value->line, LG_FORMAT, error, "%s: %.300s", key->name, reason.message);
    return LG_OK;
}

const lg_key_value *lg_yaml_value(const lg_field *keys, const lg_key_value *values, const char *name) {
    size_t i = 0;
    while (strcmp(keys[i].name, name) != 0) i++;
    return &values[i];
}

lg_status lg_yaml_store(const lg_yaml *yaml, const lg_field *keys, const lg_key_value *values, size_t count,
                        void *into, lg_error *error) {
    for (size_t i = 0; i < count; i++)
        if (values[i].line != 0 && keys[i].size > 0) LG_TRY(store(yaml, &keys[i], &values[i], into, error));
    return LG_OK;
}

lg_status lg_yaml_read_below(lg_yaml *yaml, const void *node, const lg_key_set *set, const char *what,
                             lg_error *error) {
    const reading r = {yaml, set, 1, NULL, "", error};
    const yaml_node_t *map = node;
    if (map->type != YAML_MAPPING_NODE)
        return LG_FAIL_AT(yaml, map, error, "%s: keys and values are expected", what);
    return read_keys(&r, map);
}
