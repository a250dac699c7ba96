/* Functions as bytes, in the format that docs/files.md describes. The same code writes and reads
 * them. */
#include <stdio.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "core/text.h"

/* Version 2 has paths of loops. Functions without paths are written as version 1. */
enum { VERSION = 1, WITH_PATHS = 2, MOST_NAMES = 256 };

/* The state of writing or reading. Writing leaves the image unchanged; if `bytes` is NULL, the bytes are only
 * counted. Reading fills the image and takes memory from `heap`. After a failure all numbers are 0. */
typedef struct coder {
    bool reading;
    unsigned char *bytes;
    size_t at, size;
    lg_heap *heap;
    const char *function, *where; /* for error messages */
    size_t operation;
    const lg_operation *coded;    /* the operation that is being written or read; NULL: none */
    const char *name[MOST_NAMES]; /* the names so far, each (name, revision) once */
    uint32_t revision[MOST_NAMES], names;
    lg_status status;
    lg_error *error;
} coder;

static void refuse(coder *c, lg_status status, const char *what) {
    char function[LG_SHOWN_NAME], name[LG_SHOWN_NAME], operation[LG_SHOWN_NAME + 40] = "";
    if (c->status != LG_OK) return;
    if (c->coded != NULL)
        (void)snprintf(operation, sizeof operation, ", operation %zu (%s)", c->operation,
                       lg_shown_name(c->coded->name, name));
    c->status = status == LG_FORMAT && !c->reading ? LG_INVALID_ARGUMENT : status;
    (void)lg_fail(c->error, c->status, "function '%s'%s: %s: %s", lg_shown_name(c->function, function),
                  operation, c->where, what);
}

/* When writing, returns `there`, where the numbers are. When reading, returns new memory for them. */
static void *room(coder *c, const void *there, uint64_t count, size_t size) {
    if (!c->reading || c->status != LG_OK) return (void *)there;
    void *memory = lg_heap_take(c->heap, (size_t)count, size);
    const bool limit = count * size + LG_ALIGNMENT > c->heap->most - c->heap->bytes;
    if (memory == NULL)
        refuse(c, limit ? LG_FORMAT : LG_OUT_OF_MEMORY,
               limit ? "it needs more memory than the limit allows" : "no memory");
    return memory;
}

/* ---- numbers and strings ---- */

static void code_byte(coder *c, unsigned char *byte) {
    if (c->status == LG_OK && c->at == c->size)
        refuse(c, LG_FORMAT,
               c->reading ? "the bytes end too early" : "the buffer is too small for the bytes");
    if (c->status != LG_OK)
        *byte = 0;
    else if (c->reading)
        *byte = c->bytes[c->at++];
    else if (c->bytes != NULL)
        c->bytes[c->at++] = *byte;
    else
        c->at++;
}

/* Unsigned numbers: seven bits per byte, lowest bits first; every byte but the last has the eighth bit
 * set. */
static uint64_t coded(coder *c, uint64_t number) {
    uint64_t got = 0;
    unsigned char byte;
    unsigned shift = 0;
    do {
        byte = (unsigned char)((number >> shift & 127) | ((number >> shift) > 127 ? 128 : 0));
        code_byte(c, &byte);
        if (shift == 63 && byte > 1) refuse(c, LG_FORMAT, "a number is too large");
        got |= (uint64_t)(byte & 127) << shift;
        shift += 7;
    } while (byte > 127 && c->status == LG_OK);
    return c->status == LG_OK ? got : 0;
}

static uint64_t coded_below(coder *c, uint64_t number, uint64_t end) {
    const uint64_t got = coded(c, number);
    if (got >= end) refuse(c, LG_FORMAT, "a number is too large");
    return c->status == LG_OK ? got : 0;
}

/* The number of parts that follow. It is refused if fewer bytes than parts are left, because each part takes
 * at least one byte. */
static size_t coded_count(coder *c, size_t count, size_t most) {
    const uint64_t got = coded(c, count);
    if (got > most) refuse(c, LG_FORMAT, "there are too many entries");
    if (c->reading && got > c->size - c->at)
        refuse(c, LG_FORMAT, "there are more entries than the bytes can hold");
    return c->status == LG_OK ? (size_t)got : 0;
}

static void code_whole(coder *c, void *number) {
    const uint64_t got = coded_below(c, *(uint32_t *)number, (uint64_t)1 << 32);
    if (c->reading) *(uint32_t *)number = (uint32_t)got;
}

/* An input is stored as its distance back from the current operation. */
static void code_input(coder *c, void *number) {
    const uint64_t got = coded_below(c, (uint32_t)c->operation - *(uint32_t *)number, (uint64_t)1 << 32);
    if (c->reading) *(uint32_t *)number = (uint32_t)c->operation - (uint32_t)got;
}

/* Signed numbers: 0, -1, 1, -2, ... are stored as 0, 1, 2, 3, ... */
static uint64_t folded(int64_t x) {
    return x < 0 ? ~((uint64_t)x << 1) : (uint64_t)x << 1;
}
static int64_t unfolded(uint64_t z) {
    return (int64_t)((z & 1) != 0 ? ~(z >> 1) : z >> 1);
}

/* The base, doubled, plus 1 if the rows follow; the rows are left out if they are 0. */
static void code_affine(coder *c, void *number) {
    lg_affine *a = number;
    if (folded(a->base) >> 63 != 0) refuse(c, LG_FORMAT, "a number is too large");
    const uint64_t base = coded(c, folded(a->base) << 1 | (a->rows != 0));
    const uint64_t rows = (base & 1) != 0 ? coded(c, folded(a->rows)) : 0;
    if (c->reading) *a = (lg_affine){unfolded(base >> 1), unfolded(rows)};
}

/* A real number: the count of bytes that follow, then the 8 bytes of the double, lowest first, without zero
 * bytes at the low end. */
static void code_real(coder *c, void *number) {
    uint64_t bits, got = 0;
    memcpy(&bits, number, sizeof bits);
    uint64_t zeros = 0;
    while (zeros < 8 && (bits >> 8 * zeros & 255) == 0) zeros++;
    zeros = 8 - coded_below(c, 8 - zeros, 9);
    for (uint64_t i = zeros; i < 8; i++) {
        unsigned char byte = (unsigned char)(bits >> 8 * i);
        code_byte(c, &byte);
        got |= (uint64_t)byte << 8 * i;
    }
    if (c->reading) memcpy(number, &got, sizeof got);
}

/* An empty string is read as NULL. */
static void code_text(coder *c, const char **text) {
    const size_t length = coded_count(c, *text != NULL ? strlen(*text) : 0, LG_PROGRAM_MAX_NAME);
    char *to = length > 0 ? room(c, *text, length + 1, 1) : NULL;
    for (size_t i = 0; to != NULL && i < length; i++) {
        unsigned char byte = (unsigned char)to[i];
        code_byte(c, &byte);
        if (byte < ' ' || byte == '\x7f') refuse(c, LG_FORMAT, "it has control characters");
        if (c->reading) to[i] = (char)byte;
    }
    if (c->reading) *text = to;
}

static void code_name(coder *c, const char **name) {
    code_text(c, name);
    if (c->status == LG_OK && (*name == NULL || !lg_is_word(*name)))
        refuse(c, LG_FORMAT, "it is not made of letters, digits and underscores");
}

/* ---- operations ---- */

/* A member of lg_operation: one number, or a list of numbers with its count. Members that are 0 or empty are
 * left out of the bytes. */
typedef struct field {
    const char *name;
    void (*code)(coder *c, void *number);
    size_t size, at; /* size of one number; offset of the number or list */
    size_t count;    /* offset of the count; 0: it is one number */
    size_t most;     /* length of an array inside lg_operation; 0: a pointer to a list */
} field;

#define ONE(member)         sizeof(((lg_operation *)0)->member), offsetof(lg_operation, member), 0, 1
#define LIST(member, count) sizeof(*((lg_operation *)0)->member), offsetof(lg_operation, member), count
#define COUNT(member)       offsetof(lg_operation, member)

static const field fields[] = {
    {"inputs", code_input, LIST(inputs, COUNT(input_count)), 0},
    {"shape", code_affine, LIST(shape, COUNT(rank)), LG_MAX_RANK},
    {"i0", code_affine, ONE(whole[0])},
    {"i1", code_affine, ONE(whole[1])},
    {"i2", code_affine, ONE(whole[2])},
    {"i3", code_affine, ONE(whole[3])},
    {"c", code_real, ONE(real)},
    {"reals", code_real, LIST(reals, COUNT(real_count)), 0},
    {"indices", code_whole, LIST(indices, COUNT(index_count)), 0},
    {"reciprocal", code_affine, ONE(reciprocal)},
};

static bool is_there(const lg_operation *o, const field *f) {
    static const unsigned char zeros[sizeof(lg_affine)];
    return f->count != 0 ? memcmp((const char *)o + f->count, zeros, sizeof(uint32_t)) != 0
                         : memcmp((const char *)o + f->at, zeros, f->size) != 0;
}

static void code_field(coder *c, const field *f, lg_operation *o) {
    unsigned char *at = (unsigned char *)o + f->at;
    size_t count = 1;
    c->where = f->name;
    if (f->count != 0) {
        uint32_t *counted = (uint32_t *)(void *)((char *)o + f->count);
        count = coded_count(c, *counted, f->most != 0 ? f->most : UINT32_MAX);
        if (c->reading) *counted = (uint32_t)count;
    }
    if (f->most == 0) {
        void *list;
        memcpy(&list, at, sizeof list);
        list = room(c, list, count, f->size);
        if (c->reading) memcpy(at, &list, sizeof list);
        at = list;
    }
    for (size_t i = 0; c->status == LG_OK && i < count; i++) f->code(c, at + i * f->size);
}

static void code_operation_name(coder *c, lg_operation *o) {
    uint32_t k = 0;
    c->where = "name";
    if (!c->reading && o->name != NULL)
        while (k < c->names && (strcmp(c->name[k], o->name) != 0 || c->revision[k] != o->revision)) k++;
    k = (uint32_t)coded_below(c, k, c->names + (c->names < MOST_NAMES));
    if (k == c->names && c->status == LG_OK) {
        code_name(c, &o->name);
        code_whole(c, &o->revision);
        c->name[k] = o->name;
        c->revision[k] = o->revision;
        c->names++;
    }
    if (!c->reading || c->status != LG_OK) return;
    o->name = c->name[k];
    o->revision = c->revision[k];
}

static void code_operation(coder *c, lg_operation *o) {
    uint64_t there = 0;
    code_operation_name(c, o);
    for (size_t k = 0; !c->reading && k < LG_COUNT(fields); k++)
        there |= (uint64_t)is_there(o, &fields[k]) << k;
    there = coded_below(c, there, (uint64_t)1 << LG_COUNT(fields));
    for (size_t k = 0; k < LG_COUNT(fields); k++)
        if ((there >> k & 1) != 0) code_field(c, &fields[k], o);
}

/* ---- functions ---- */

static void code_port(coder *c, lg_port *port) {
    uint32_t *rank = &port->shape.rank;
    code_name(c, &port->name);
    code_text(c, &port->unit);
    const uint64_t shape = coded_below(c, 2 * (uint64_t)*rank + port->shared, 2 * LG_MAX_RANK + 2);
    if (c->reading) *rank = (uint32_t)(shape / 2);
    if (c->reading) port->shared = shape % 2 != 0;
    for (uint32_t d = 0; c->status == LG_OK && d < *rank; d++) code_whole(c, &port->shape.dims[d]);
    code_real(c, &port->low);
    code_real(c, &port->high);
}

static void code_ports(coder *c, const char *where, const lg_port **ports, size_t *count) {
    c->where = where;
    const size_t n = coded_count(c, *count, LG_PROGRAM_MAX_PORTS);
    lg_port *list = room(c, *ports, n, sizeof *list);
    for (size_t i = 0; c->status == LG_OK && i < n; i++) code_port(c, &list[i]);
    if (!c->reading) return;
    *ports = list;
    *count = n;
}

static void code_wholes(coder *c, const char *where, const uint32_t **numbers, size_t count) {
    c->where = where;
    uint32_t *list = room(c, *numbers, count, sizeof *list);
    for (size_t i = 0; c->status == LG_OK && i < count; i++) code_whole(c, &list[i]);
    if (c->reading) *numbers = list;
}

static void code_operations(coder *c, lg_function_image *f) {
    c->where = "operations";
    const size_t n = coded_count(c, f->operation_count, LG_PROGRAM_MAX_NODES);
    lg_operation *list = room(c, f->operations, n, sizeof *list);
    for (c->operation = 0; c->status == LG_OK && c->operation < n; c->operation++) {
        c->coded = &list[c->operation];
        code_operation(c, &list[c->operation]);
    }
    c->coded = NULL;
    if (!c->reading) return;
    f->operations = list;
    f->operation_count = n;
}

static void code_function(coder *c, lg_function_image *f) {
    c->where = "version";
    const uint64_t version = coded(c, f->path_count > 0 ? WITH_PATHS : VERSION);
    if (version != VERSION && version != WITH_PATHS && c->status == LG_OK)
        refuse(c, LG_VERSION, "these bytes were written by a later version of liegrad");
    code_ports(c, "inputs", &f->inputs, &f->input_count);
    code_ports(c, "outputs", &f->outputs, &f->output_count);
    c->where = "times";
    code_whole(c, &f->times);
    if (f->times > 0) {
        c->where = "callee";
        code_whole(c, &f->callee);
        code_wholes(c, "carry", &f->carry, f->input_count);
        if (version == WITH_PATHS) {
            c->where = "path";
            f->path_count = coded_count(c, f->path_count, LG_PROGRAM_MAX_PORTS);
            code_wholes(c, "path", &f->path, f->path_count);
        }
    } else {
        code_operations(c, f);
        code_wholes(c, "results", &f->results, f->output_count);
    }
    if (version == WITH_PATHS && f->path_count == 0)
        refuse(c, LG_FORMAT,
               "the version of the bytes is the one for loops with paths, but there are no paths");
}

lg_status lg_function_pack(const lg_function_image *image, void *bytes, size_t *size, lg_error *error) {
    LG_NEEDS(error, image, size);
    coder c = {.bytes = bytes,
               .size = bytes != NULL ? *size : SIZE_MAX,
               .function = image->name,
               .status = LG_OK,
               .error = error};
    lg_function_image copy = *image;
    code_function(&c, &copy);
    if (c.status == LG_OK) *size = c.at;
    return c.status;
}

lg_status lg_function_unpack(const lg_context *context, const char *name, const void *bytes, size_t size,
                             size_t *memory, lg_function_image **out, lg_error *error) {
    LG_NEEDS(error, name, bytes, memory, out);
    lg_owned_image *made = lg_owned_image_create(context, *memory > 0 ? *memory : 1);
    coder c = {
        .reading = true, .bytes = (unsigned char *)bytes, .size = size, .function = name, .error = error};
    if (made == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a function");
    c.heap = &made->heap;
    c.where = "name";
    char *own = room(&c, NULL, strlen(name) + 1, 1);
    if (own != NULL) made->image.name = memcpy(own, name, strlen(name) + 1);
    code_function(&c, &made->image);
    c.where = "end";
    if (c.at < size) refuse(&c, LG_FORMAT, "there are bytes after the end of the function");
    if (c.status == LG_OK) {
        *memory -= made->heap.bytes;
        *out = &made->image;
    } else {
        lg_function_image_destroy(&made->image);
    }
    return c.status;
}
