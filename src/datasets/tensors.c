/* Named tensors: safetensors files. The header is JSON, which libyaml reads. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <yaml.h>

#include "datasets/h5.h"
#include "datasets/yaml.h"
#include "liegrad/tables.h"

enum { MOST_HEADER = 1 << 20, MOST_TENSORS = 4096 };

/* ---- numbers ---- */

static double of_half(uint16_t h) {
    const int exponent = h >> 10 & 31, fraction = h & 1023, sign = h >> 15;
    double value = exponent == 0    ? ldexp(fraction, -24)
                   : exponent == 31 ? (fraction == 0 ? (double)INFINITY : (double)NAN)
                                    : ldexp(1024 + fraction, exponent - 25);
    return sign ? -value : value;
}

static double read_f64(const unsigned char *raw) {
    double x;
    memcpy(&x, raw, sizeof x);
    return x;
}

static double read_f32(const unsigned char *raw) {
    float x;
    memcpy(&x, raw, sizeof x);
    return (double)x;
}

static double read_f16(const unsigned char *raw) {
    return of_half((uint16_t)(raw[0] | raw[1] << 8));
}

/* The upper half of a single. */
static double read_bf16(const unsigned char *raw) {
    const unsigned char wide[4] = {0, 0, raw[0], raw[1]};
    return read_f32(wide);
}

static const struct {
    const char *name;
    size_t bytes;
    double (*read)(const unsigned char *raw);
} types[] = {{"F64", 8, read_f64}, {"F32", 4, read_f32}, {"F16", 2, read_f16}, {"BF16", 2, read_bf16}};

/* ---- the header ---- */

typedef struct reading {
    const lg_context *context;
    const char *path;
    unsigned char *data;
    size_t size, start; /* of the file; where the numbers begin */
    lg_yaml *header;
    lg_tensors *out;
} reading;

static lg_status bad(const reading *r, lg_error *error, const char *name, const char *what) {
    return lg_fail(error, LG_FORMAT, "%s: tensor '%.64s': %s", lg_shown_path(r->path), name, what);
}

static const char *text_of(const yaml_node_t *node) {
    return node != NULL && node->type == YAML_SCALAR_NODE ? (const char *)node->data.scalar.value : NULL;
}

static yaml_node_t *value_of(yaml_document_t *document, const yaml_node_t *mapping, const char *key) {
    if (mapping->type != YAML_MAPPING_NODE) return NULL;
    for (yaml_node_pair_t *p = mapping->data.mapping.pairs.start; p < mapping->data.mapping.pairs.top; p++) {
        const char *name = text_of(yaml_document_get_node(document, p->key));
        if (name != NULL && strcmp(name, key) == 0) return yaml_document_get_node(document, p->value);
    }
    return NULL;
}

/* A list of at most `most` whole numbers. */
static bool wholes_of(yaml_document_t *document, const yaml_node_t *list, uint64_t *out, uint32_t most,
                      uint32_t *count) {
    *count = 0;
    if (list == NULL || list->type != YAML_SEQUENCE_NODE) return false;
    for (yaml_node_item_t *i = list->data.sequence.items.start; i < list->data.sequence.items.top; i++) {
        const char *text = text_of(yaml_document_get_node(document, *i));
        if (text == NULL || *count == most || strlen(text) > 15 ||
            strspn(text, "0123456789") != strlen(text) || *text == '\0')
            return false;
        out[(*count)++] = strtoull(text, NULL, 10);
    }
    return true;
}

static lg_status take_numbers(const reading *r, lg_tensor *t, size_t type, const unsigned char *from,
                              lg_error *error) {
    t->values = lg_alloc(r->context, t->count > 0 ? t->count : 1, sizeof *t->values);
    if (t->values == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for tensors");
    for (size_t i = 0; i < t->count; i++) {
        t->values[i] = types[type].read(from + i * types[type].bytes);
        if (!isfinite(t->values[i])) return bad(r, error, t->name, "has numbers that are not finite");
    }
    return LG_OK;
}

static lg_status take_tensor(const reading *r, const char *name, const yaml_node_t *about, lg_error *error) {
    yaml_document_t *document = lg_yaml_document(r->header);
    const char *type_name = text_of(value_of(document, about, "dtype"));
    uint64_t range[2];
    uint32_t ends;
    size_t type = 0;
    lg_tensor *t = &r->out->tensor[r->out->count];
    if (strlen(name) >= sizeof t->name) return bad(r, error, name, "the name is too long");
    memcpy(t->name, name, strlen(name) + 1);
    while (type < LG_COUNT(types) && (type_name == NULL || strcmp(types[type].name, type_name) != 0)) type++;
    if (type == LG_COUNT(types)) return bad(r, error, name, "the type is not F64, F32, F16 or BF16");
    if (!wholes_of(document, value_of(document, about, "shape"), t->dims, 4, &t->rank))
        return bad(r, error, name, "the shape is not a list of at most 4 whole numbers");
    if (!wholes_of(document, value_of(document, about, "data_offsets"), range, 2, &ends) || ends != 2)
        return bad(r, error, name, "data_offsets is not a list of 2 whole numbers");
    t->count = 1;
    for (uint32_t k = 0; k < t->rank; k++) {
        if (t->dims[k] > 0 && t->count > r->size / t->dims[k])
            return bad(r, error, name, "is larger than the file");
        t->count *= (size_t)t->dims[k];
    }
    if (range[1] > r->size - r->start || range[0] > range[1] ||
        range[1] - range[0] != t->count * types[type].bytes)
        return bad(r, error, name, "data_offsets do not fit the shape or the file");
    r->out->count++;
    return take_numbers(r, t, type, r->data + r->start + range[0], error);
}

static lg_status take_all(const reading *r, lg_error *error) {
    yaml_document_t *document = lg_yaml_document(r->header);
    const yaml_node_t *root = yaml_document_get_root_node(document);
    if (root == NULL || root->type != YAML_MAPPING_NODE)
        return lg_fail(error, LG_FORMAT, "%s: the header is not a JSON object", lg_shown_path(r->path));
    const size_t pairs = (size_t)(root->data.mapping.pairs.top - root->data.mapping.pairs.start);
    if (pairs > MOST_TENSORS)
        return lg_fail(error, LG_FORMAT, "%s: more than %d tensors", lg_shown_path(r->path), MOST_TENSORS);
    r->out->tensor = lg_alloc(r->context, pairs > 0 ? pairs : 1, sizeof *r->out->tensor);
    if (r->out->tensor == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for tensors");
    for (yaml_node_pair_t *p = root->data.mapping.pairs.start; p < root->data.mapping.pairs.top; p++) {
        const char *name = text_of(yaml_document_get_node(document, p->key));
        yaml_node_t *about = yaml_document_get_node(document, p->value);
        if (name != NULL && strcmp(name, "__metadata__") == 0) {
            const char *layout = about != NULL ? text_of(value_of(document, about, "layout")) : NULL;
            r->out->inputs_first = layout != NULL && strstr(layout, "(in, out)") != NULL;
            continue;
        }
        if (name == NULL || about == NULL)
            return lg_fail(error, LG_FORMAT, "%s: the header is not a JSON object", lg_shown_path(r->path));
        LG_TRY(take_tensor(r, name, about, error));
    }
    return LG_OK;
}

/* ---- the file ---- */

static lg_status read_bytes(reading *r, lg_error *error) {
    struct stat about;
    if (stat(r->path, &about) != 0)
        return lg_fail(error, errno == ENOENT ? LG_NOT_FOUND : LG_FILE, "%s: %s", lg_shown_path(r->path),
                       strerror(errno));
    if (!S_ISREG(about.st_mode))
        return lg_fail(error, LG_FILE, "%s: is not a regular file", lg_shown_path(r->path));
    FILE *file = fopen(r->path, "rb");
    if (file == NULL)
        return lg_fail(error, LG_FILE, "%s: cannot be read: %s", lg_shown_path(r->path), strerror(errno));
    r->size = (size_t)about.st_size;
    r->data = lg_alloc(r->context, r->size + 1, 1);
    const bool whole = r->data != NULL && fread(r->data, 1, r->size, file) == r->size;
    (void)fclose(file);
    if (r->data == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %s", lg_shown_path(r->path));
    return whole ? LG_OK : lg_fail(error, LG_FILE, "%s: cannot be read", lg_shown_path(r->path));
}

static lg_status read_all(reading *r, lg_error *error) {
    uint64_t length = 0;
    LG_TRY(read_bytes(r, error));
    for (size_t i = 0; r->size >= 8 && i < 8; i++) length |= (uint64_t)r->data[i] << 8 * i;
    if (r->size < 8 || length > r->size - 8 || length > MOST_HEADER || length < 2 || r->data[8] != '{')
        return lg_fail(error, LG_FORMAT, "%s: is not a safetensors file", lg_shown_path(r->path));
    r->start = 8 + (size_t)length;
    LG_TRY(lg_yaml_open_text(r->context, r->path, r->data + 8, (size_t)length, &r->header, error));
    return take_all(r, error);
}

lg_status lg_tensors_read(const lg_context *context, const char *path, lg_tensors *out, lg_error *error) {
    lg_tensors made = {.context = context};
    reading r = {.context = context, .path = path, .out = &made};
    const lg_status status = read_all(&r, error);
    lg_yaml_close(r.header);
    lg_free(context, r.data);
    if (status == LG_OK)
        *out = made;
    else
        lg_tensors_destroy(&made);
    return status;
}

void lg_tensors_destroy(lg_tensors *tensors) {
    if (tensors == NULL) return;
    for (size_t i = 0; tensors->tensor != NULL && i < tensors->count; i++)
        lg_free(tensors->context, tensors->tensor[i].values);
    lg_free(tensors->context, tensors->tensor);
    *tensors = (lg_tensors){.context = tensors->context};
}
