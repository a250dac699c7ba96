/* Reads named tensors from safetensors files. The header is JSON, which libyaml can read. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/bytes.h"
#include "core/lookup.h"
#include "files/h5.h"
#include "files/read_file.h"
#include "settings/files/yaml.h"
#include "liegrad/table.h"

enum { MOST_HEADER = 1 << 20, MOST_TENSORS = 4096, CHUNK = 1 << 16 };

/* ---- numbers ---- */

static double of_half(uint16_t h) {
    const int exponent = h >> 10 & 31, fraction = h & 1023, sign = h >> 15;
    double value = exponent == 0    ? ldexp(fraction, -24)
                   : exponent == 31 ? (fraction == 0 ? (double)INFINITY : (double)NAN)
                                    : ldexp(1024 + fraction, exponent - 25);
    return sign ? -value : value;
}

static const struct {
    const char *name;
    size_t bytes;
} types[] = {{"F64", 8}, {"F32", 4}, {"F16", 2}, {"BF16", 2}};

static double read_number(const unsigned char *raw, size_t type) {
    const uint64_t bits = lg_bytes_get(raw, types[type].bytes);
    return type == 0   ? lg_f64_of_bits(bits)
           : type == 1 ? (double)lg_f32_of_bits((uint32_t)bits)
           : type == 2 ? of_half((uint16_t)bits)
                       : (double)lg_f32_of_bits((uint32_t)bits << 16); /* the upper half of a float */
}

/* ---- the header ---- */

/* Where the numbers of a tensor are, in bytes after the header. */
typedef struct place {
    uint64_t begin, end;
    size_t type;
    lg_tensor *tensor;
} place;

typedef struct reading {
    const lg_context *context;
    const char *path;
    FILE *from;
    unsigned char *text; /* the header */
    uint64_t bytes;      /* number of bytes after the header */
    lg_yaml *header;
    place *places; /* one per tensor */
    lg_tensors *out;
} reading;

static lg_status bad(const reading *r, lg_error *error, const char *name, const char *what) {
    return lg_fail(error, LG_FORMAT, "%s: tensor '%.64s': %s", lg_shown_path(r->path), name, what);
}

/* The text of a key's value; NULL: there is none. */
static const char *text_of(const reading *r, const yaml_node_t *mapping, const char *key) {
    const yaml_node_t *node = lg_node_below(r->header, mapping, key);
    return node != NULL ? lg_node_text(node, SIZE_MAX) : NULL;
}

/* Checks that all keys are texts and that no key occurs twice. `what` is the mapping's name in error
 * messages. */
static lg_status check_keys(const reading *r, const yaml_node_t *mapping, const char *what, lg_error *error) {
    if (mapping->type != YAML_MAPPING_NODE) return LG_OK;
    const yaml_node_pair_t *first = mapping->data.mapping.pairs.start;
    const size_t pairs = (size_t)(mapping->data.mapping.pairs.top - first);
    LG_TRY_SCRATCH(lg_lookup, sorted, r->context, pairs, lg_no_memory_for(r->path, error));
    for (size_t i = 0; i < pairs; i++) {
        sorted[i] = (lg_lookup){lg_node_text(lg_node_at(r->header, first[i].key), SIZE_MAX), i};
        if (sorted[i].name == NULL)
            return lg_fail(error, LG_FORMAT, "%s: %s: a key is not a text", lg_shown_path(r->path), what);
    }
    lg_lookup_sort(sorted, pairs);
    for (size_t i = 1; i < pairs; i++)
        if (strcmp(sorted[i].name, sorted[i - 1].name) == 0)
            return lg_fail(error, LG_FORMAT, "%s: %s: key '%.64s' is there twice", lg_shown_path(r->path),
                           what, sorted[i].name);
    return LG_OK;
}

/* Reads a list of at most `most` nonnegative integers. */
static bool wholes_of(const reading *r, const yaml_node_t *list, uint64_t *out, uint32_t most,
                      uint32_t *count) {
    if (list == NULL || list->type != YAML_SEQUENCE_NODE || lg_node_length(list) > most) return false;
    *count = (uint32_t)lg_node_length(list);
    for (uint32_t i = 0; i < *count; i++)
        if (lg_integer_parse(lg_node_text(lg_node_item(r->header, list, i), 16), &out[i]) != LG_OK)
            return false;
    return true;
}

static lg_status take_tensor(const reading *r, const char *name, const yaml_node_t *about, lg_error *error) {
    uint64_t range[2];
    uint32_t ends;
    size_t type = 0;
    lg_tensor *t = &r->out->tensor[r->out->count];
    if (strlen(name) >= sizeof t->name) return bad(r, error, name, "the name is too long");
    memcpy(t->name, name, strlen(name) + 1);
    LG_TRY(check_keys(r, about, name, error));
    const char *type_name = text_of(r, about, "dtype");
    while (type < LG_COUNT(types) && (type_name == NULL || strcmp(types[type].name, type_name) != 0)) type++;
    if (type == LG_COUNT(types))
        return bad(r, error, name, "the type is not F64, F32, F16 or BF16; convert it");
    if (!wholes_of(r, lg_node_below(r->header, about, "shape"), t->dims, 4, &t->rank))
        return bad(r, error, name, "the shape is not a list of at most 4 whole numbers");
    if (!wholes_of(r, lg_node_below(r->header, about, "data_offsets"), range, 2, &ends) || ends != 2)
        return bad(r, error, name, "data_offsets is not a list of 2 whole numbers");
    uint64_t count = 1;
    for (uint32_t k = 0; k < t->rank; k++) {
        if (t->dims[k] > 0 && count > r->bytes / t->dims[k])
            return bad(r, error, name, "data_offsets do not fit the shape or the file");
        count *= t->dims[k];
    }
    if (range[1] > r->bytes || range[0] > range[1] || range[1] - range[0] != count * types[type].bytes)
        return bad(r, error, name, "data_offsets do not fit the shape or the file");
    t->count = (size_t)count; /* check_places refuses more than memory can hold */
    r->places[r->out->count++] = (place){range[0], range[1], type, t};
    return LG_OK;
}

static lg_status take_all(reading *r, lg_error *error) {
    /* lg_yaml_open_text has checked that the root is a mapping. */
    const yaml_node_t *root = yaml_document_get_root_node(lg_yaml_document(r->header));
    const size_t pairs = (size_t)(root->data.mapping.pairs.top - root->data.mapping.pairs.start);
    if (pairs > MOST_TENSORS)
        return lg_fail(error, LG_FORMAT, "%s: has more than %d tensors; save fewer", lg_shown_path(r->path),
                       MOST_TENSORS);
    LG_TRY(check_keys(r, root, "the header", error));
    if (LG_ALLOC_ALL(r->context, LG_ARRAY(r->out->tensor, pairs + 1), LG_ARRAY(r->places, pairs + 1)) !=
        LG_OK)
        return lg_no_memory_for(r->path, error);
    for (yaml_node_pair_t *p = root->data.mapping.pairs.start; p < root->data.mapping.pairs.top; p++) {
        const char *name = lg_node_text(lg_node_at(r->header, p->key), SIZE_MAX);
        const yaml_node_t *about = lg_node_at(r->header, p->value);
        if (strcmp(name, "__metadata__") == 0) {
            const char *layout = text_of(r, about, "layout");
            r->out->inputs_first = layout != NULL && strstr(layout, "(in, out)") != NULL;
            continue;
        }
        LG_TRY(take_tensor(r, name, about, error));
    }
    return LG_OK;
}

/* ---- the numbers ---- */

static int by_place(const void *a, const void *b) {
    const place *x = a, *y = b;
    if (x->begin != y->begin) return x->begin < y->begin ? -1 : 1;
    return x->end < y->end ? -1 : x->end > y->end;
}

/* Checks that each byte after the header belongs to exactly one tensor, as the format demands. Sorts the
 * places. */
static lg_status check_places(const reading *r, lg_error *error) {
    const size_t count = r->out->count;
    uint64_t end = 0, numbers = 0;
    lg_read_options options;
    LG_TRY(lg_read_options_resolve(NULL, &options, error));
    qsort(r->places, count, sizeof *r->places, by_place);
    for (size_t i = 0; i < count; end = r->places[i++].end) {
        const place *p = &r->places[i];
        if (p->begin < end) return bad(r, error, p->tensor->name, "shares bytes with another tensor");
        if (p->begin > end)
            return bad(r, error, p->tensor->name, "begins after bytes that belong to no tensor");
        numbers += (p->end - p->begin) / types[p->type].bytes;
    }
    if (end < r->bytes)
        return lg_fail(error, LG_FORMAT,
                       "%s: %llu bytes after the last tensor belong to no tensor; save it again",
                       lg_shown_path(r->path), (unsigned long long)(r->bytes - end));
    if (numbers > options.max_size / sizeof(double))
        return lg_fail(error, LG_FORMAT, "%s: has %llu numbers; at most %llu are read: save fewer",
                       lg_shown_path(r->path), (unsigned long long)numbers,
                       (unsigned long long)(options.max_size / sizeof(double)));
    return LG_OK;
}

static lg_status read_numbers(const reading *r, const place *p, lg_error *error) {
    unsigned char raw[CHUNK];
    lg_tensor *t = p->tensor;
    const size_t bytes = types[p->type].bytes;
    t->values = lg_alloc(r->context, t->count > 0 ? t->count : 1, sizeof *t->values);
    if (t->values == NULL) return lg_no_memory_for(r->path, error);
    for (size_t at = 0, n; at < t->count; at += n) {
        n = t->count - at < CHUNK / bytes ? t->count - at : CHUNK / bytes;
        if (lg_cancelled(r->context)) return LG_CANCELLED;
        if (fread(raw, bytes, n, r->from) != n)
            return lg_fail(error, LG_FILE, "%s: cannot be read to its end", lg_shown_path(r->path));
        for (size_t i = 0; i < n; i++) {
            t->values[at + i] = read_number(raw + i * bytes, p->type);
            if (!isfinite(t->values[at + i]))
                return bad(r, error, t->name, "has numbers that are not finite; replace them");
        }
    }
    return LG_OK;
}

/* ---- the file ---- */

/* Reads the length of the header (8 bytes, little-endian) and the header. */
static lg_status read_header(reading *r, lg_error *error) {
    unsigned char first[8] = {0};
    const bool begun = fread(first, 1, sizeof first, r->from) == sizeof first;
    uint64_t length = lg_bytes_get(first, sizeof first);
    bool fits = begun && length >= 2 && length <= MOST_HEADER && length <= r->bytes - sizeof first;
    if (fits) {
        r->text = lg_alloc(r->context, (size_t)length, 1);
        if (r->text == NULL) return lg_no_memory_for(r->path, error);
        fits = fread(r->text, 1, (size_t)length, r->from) == length && r->text[0] == '{';
    }
    if (ferror(r->from)) return lg_fail(error, LG_FILE, "%s: cannot be read", lg_shown_path(r->path));
    if (!fits)
        return lg_fail(error, LG_FORMAT, "%s: is not a safetensors file; save it as one",
                       lg_shown_path(r->path));
    r->bytes -= sizeof first + length;
    while (r->text[length - 1] == '\0') length--; /* writers fill the header with blanks or zero bytes */
    return lg_yaml_open_text(r->context, r->path, r->text, (size_t)length, &r->header, error);
}

static lg_status read_all(reading *r, lg_error *error) {
    LG_TRY(lg_read_open(r->path, &r->from, &r->bytes, error));
    LG_TRY(read_header(r, error));
    LG_TRY(take_all(r, error));
    LG_TRY(check_places(r, error));
    for (size_t i = 0; i < r->out->count; i++) LG_TRY(read_numbers(r, &r->places[i], error));
    return LG_OK;
}

lg_status lg_tensors_read(const lg_context *context, const char *path, lg_tensors *out, lg_error *error) {
    LG_NEEDS(error, path, out);
    LG_CLEAN(lg_tensors_destroy) lg_tensors made = {.context = context};
    reading r = {.context = context, .path = path, .out = &made};
    const lg_status status = read_all(&r, error);
    lg_yaml_close(r.header);
    if (r.from != NULL) (void)fclose(r.from);
    LG_FREE_ALL(context, r.text, r.places);
    LG_TRY(status);
    return LG_GIVE(out, made);
}

void lg_tensors_destroy(lg_tensors *tensors) {
    if (tensors == NULL) return;
    for (size_t i = 0; tensors->tensor != NULL && i < tensors->count; i++)
        lg_free(tensors->context, tensors->tensor[i].values);
    lg_free(tensors->context, tensors->tensor);
    *tensors = (lg_tensors){.context = tensors->context};
}
