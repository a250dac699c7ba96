/* Changes trees by their structure, as hostile files would differ from valid ones. */
#include <stdbool.h>
#include <string.h>

#include "forms.h"
#include "tree.h"

enum { ROOM = 1 << 16 };

typedef struct mutation {
    tree_record records[TREE_RECORDS];
    size_t count;
    uint64_t random;
    uint8_t room[ROOM]; /* memory for new names and data */
    size_t used;
    fuzz_bytes mutate;
} mutation;

static uint32_t draw(mutation *m, uint32_t below) {
    return fuzz_draw(&m->random, below);
}

static uint8_t *take_room(mutation *m, size_t bytes) {
    if (bytes > ROOM - m->used) return NULL;
    m->used += bytes;
    return m->room + m->used - bytes;
}

static tree_record *any(mutation *m) {
    return &m->records[draw(m, (uint32_t)m->count)];
}

static const tree_type *type_of(const tree_record *r) {
    return &tree_types[r->type % tree_type_count];
}

/* Copies the record's data to new memory with `more` bytes added; NULL if there is no room. */
static uint8_t *own_data(mutation *m, tree_record *r, size_t more) {
    uint8_t *data = r->length + more > UINT16_MAX ? NULL : take_room(m, r->length + more);
    if (data == NULL) return NULL;
    memcpy(data, r->data, r->length);
    r->data = data;
    return data;
}

/* ---- values ---- */

static const uint64_t wholes[] = {0,
                                  1,
                                  2,
                                  3,
                                  4,
                                  5,
                                  7,
                                  8,
                                  9,
                                  16,
                                  17,
                                  32,
                                  64,
                                  100,
                                  127,
                                  128,
                                  255,
                                  256,
                                  1000,
                                  1024,
                                  4096,
                                  65535,
                                  65536,
                                  1 << 20,
                                  0x7fffffff,
                                  0x80000000,
                                  0xffffffff,
                                  UINT64_C(1) << 32,
                                  UINT64_C(1) << 53,
                                  INT64_MAX,
                                  (uint64_t)INT64_MAX + 1,
                                  UINT64_MAX};
static const uint64_t reals[] = {0,                             /* 0 */
                                 UINT64_C(0x8000000000000000),  /* -0 */
                                 UINT64_C(0x3ff0000000000000),  /* 1 */
                                 UINT64_C(0xbff0000000000000),  /* -1 */
                                 UINT64_C(0x4000000000000000),  /* 2 */
                                 UINT64_C(0x3fb999999999999a),  /* 0.1 */
                                 UINT64_C(0x0000000000000001),  /* the smallest */
                                 UINT64_C(0x7fefffffffffffff),  /* the largest */
                                 UINT64_C(0xffefffffffffffff),  /* -the largest */
                                 UINT64_C(0x7ff0000000000000),  /* infinity */
                                 UINT64_C(0xfff0000000000000),  /* -infinity */
                                 UINT64_C(0x7ff8000000000000),  /* NaN */
                                 UINT64_C(0x43f0000000000000),  /* 2^64 */
                                 UINT64_C(0x41f0000000000000),  /* 2^32 */
                                 UINT64_C(0x3cb0000000000000),  /* 2^-52 */
                                 UINT64_C(0x40091eb851eb851f)}; /* 3.14 */

static void put(uint8_t *at, uint64_t value, const tree_type *type) {
    for (unsigned i = 0; i < type->bytes && i < 8; i++)
        at[type->big ? type->bytes - 1u - i : i] = (uint8_t)(value >> 8 * i);
}

static uint64_t get(const uint8_t *at, const tree_type *type) {
    uint64_t value = 0;
    for (unsigned i = 0; i < type->bytes && i < 8; i++)
        value |= (uint64_t)at[type->big ? type->bytes - 1u - i : i] << 8 * i;
    return value;
}

static uint64_t narrowed(uint64_t real) {
    double value;
    float small;
    uint32_t bits;
    memcpy(&value, &real, sizeof value);
    small = value > 3e38 ? 3e38f : value < -3e38 ? -3e38f : (float)value;
    memcpy(&bits, &small, sizeof bits);
    return real == UINT64_C(0x7ff0000000000000) ? 0x7f800000 : bits;
}

/* Replaces a number by a special value, or by its neighbour. */
static void change_number(mutation *m, tree_record *r) {
    const tree_type *type = type_of(r);
    const size_t elements = type->bytes == 0 ? 0 : r->length / type->bytes;
    uint8_t *data = elements > 0 ? own_data(m, r, 0) : NULL;
    if (data == NULL) return;
    uint8_t *at = data + type->bytes * (size_t)draw(m, (uint32_t)elements);
    const uint64_t now = get(at, type);
    switch (draw(m, 4)) {
    case 0:
        put(at, now + 1, type);
        break;
    case 1:
        put(at, now - 1, type);
        break;
    case 2:
        put(at, now ^ (UINT64_C(1) << draw(m, type->bytes < 8 ? 8u * type->bytes : 64)), type);
        break;
    default:
        if (type->nature == NATURE_REAL) {
            const uint64_t real = reals[draw(m, sizeof reals / sizeof reals[0])];
            put(at, type->bytes == 4 ? narrowed(real) : real, type);
        } else {
            put(at, wholes[draw(m, sizeof wholes / sizeof wholes[0])], type);
        }
    }
}

static void change_bytes(mutation *m, tree_record *r) {
    const size_t more = draw(m, 4) == 0 ? 16 : 0, length = r->length;
    uint8_t *data = own_data(m, r, more);
    if (data == NULL || length + more == 0) return;
    r->length = (uint16_t)m->mutate(data, length, length + more);
    if (type_of(r)->nature == NATURE_TEXT && r->length > r->size) r->size = r->length;
}

static void change_value(mutation *m, tree_record *r) {
    const tree_nature nature = type_of(r)->nature;
    if ((nature == NATURE_WHOLE || nature == NATURE_REAL) && draw(m, 5) > 0)
        change_number(m, r);
    else
        change_bytes(m, r);
}

static void change_type(mutation *m, tree_record *r) {
    r->type = (uint8_t)draw(m, (uint32_t)tree_type_count);
    if (draw(m, 2) == 0) r->size = (uint16_t)draw(m, 1u << draw(m, 17));
}

static uint32_t other_extent(mutation *m, uint32_t now) {
    switch (draw(m, 6)) {
    case 0:
        return now + 1;
    case 1:
        return now - 1;
    case 2:
        return 2 * now;
    case 3:
        return 0;
    case 4:
        return (uint32_t)wholes[draw(m, sizeof wholes / sizeof wholes[0])];
    default:
        return draw(m, 12);
    }
}

static void change_shape(mutation *m, tree_record *r) {
    if (r->rank == TREE_NO_SPACE) r->rank = 0;
    switch (draw(m, 8)) {
    case 0:
        r->rank = TREE_NO_SPACE;
        break;
    case 1:
        if (r->rank < TREE_RANK) r->dims[r->rank++] = 1 + draw(m, 3);
        break;
    case 2:
        if (r->rank > 0) r->rank--;
        break;
    case 3:
        if (r->rank > 1) {
            const uint32_t first = r->dims[0];
            r->dims[0] = r->dims[1];
            r->dims[1] = first;
        }
        break;
    default:
        if (r->rank > 0) {
            uint32_t *extent = &r->dims[draw(m, r->rank)];
            *extent = other_extent(m, *extent);
        }
    }
}

/* ---- names and links ---- */

static void set_name(tree_record *r, const uint8_t *name, size_t length) {
    r->name = name;
    r->name_length = (uint8_t)length;
}

static void change_name(mutation *m, tree_record *r) {
    uint8_t *name = take_room(m, 255);
    if (name == NULL) return;
    memcpy(name, r->name, r->name_length);
    const size_t most = r->name_length + 8u < 255 ? r->name_length + 8u : 255;
    set_name(r, name, m->mutate(name, r->name_length, most));
}

static void take_name(mutation *m, tree_record *r) {
    const tree_record *other = any(m);
    set_name(r, other->name, other->name_length);
}

static void swap_names(mutation *m, tree_record *r) {
    tree_record *other = any(m);
    const tree_record was = *r;
    set_name(r, other->name, other->name_length);
    set_name(other, was.name, was.name_length);
}

/* Copies everything but the name from another record. */
static void take_value(mutation *m, tree_record *r) {
    const tree_record name = *r;
    *r = *any(m);
    set_name(r, name.name, name.name_length);
}

static void drop(mutation *m, tree_record *r) {
    const size_t at = (size_t)(r - m->records);
    memmove(r, r + 1, (m->count - at - 1) * sizeof *r);
    m->count--;
}

static void drop_some(mutation *m, tree_record *r) {
    size_t n = 1 + draw(m, 8);
    for (const size_t at = (size_t)(r - m->records); n > 0 && at < m->count; n--) drop(m, &m->records[at]);
}

static void copy(mutation *m, tree_record *r) {
    if (m->count == TREE_RECORDS) return;
    m->records[m->count] = *r;
    change_name(m, &m->records[m->count++]);
}

static void move(mutation *m, tree_record *r) {
    const tree_record was = *r;
    tree_record *other = any(m);
    *r = *other;
    *other = was;
}

static void change_layout(mutation *m, tree_record *r) {
    if ((r->kind & TREE_KIND) == TREE_DATA)
        r->kind ^= (uint8_t)(TREE_CHUNKED << draw(m, 4));
    else
        r->kind ^= (uint8_t)(draw(m, 8));
}

/* Replaces the record by a link to an existing object. */
static void make_link(mutation *m, tree_record *r) {
    const tree_record *other = any(m);
    const uint8_t *at = memchr(other->name, '@', other->name_length);
    r->kind = (uint8_t)(TREE_GROUP + draw(m, TREE_KINDS - TREE_GROUP));
    r->data = other->name;
    r->length = at != NULL ? (uint16_t)(at - other->name) : other->name_length;
}

/* ---- changes of several records that stay consistent ---- */

/* Replaces the numbers of a short list that equal one number by another. */
static void replace_numbers(mutation *m, tree_record *r, uint64_t from, uint64_t to) {
    enum { SHORT = 32 };
    const tree_type *type = type_of(r);
    if (type->nature != NATURE_WHOLE || r->length > SHORT * type->bytes) return;
    for (size_t at = 0; at + type->bytes <= r->length; at += type->bytes) {
        if (get(r->data + at, type) != from) continue;
        uint8_t *data = own_data(m, r, 0);
        if (data != NULL) put(data + at, to, type);
    }
}

/* Replaces all extents of one length, and all integers equal to it, by another length. */
static void change_length(mutation *m, tree_record *r) {
    if (r->rank == 0 || r->rank == TREE_NO_SPACE) return;
    const uint32_t from = r->dims[draw(m, r->rank)], to = other_extent(m, from);
    const bool numbers = draw(m, 2) == 0;
    for (tree_record *at = m->records; at < m->records + m->count; at++) {
        for (size_t i = 0; at->rank != TREE_NO_SPACE && i < at->rank; i++)
            if (at->dims[i] == from) at->dims[i] = to;
        if (numbers) replace_numbers(m, at, from, to);
    }
}

/* Changes a number in a text, such as a list of widths, and all extents equal to it. */
static void change_digit(mutation *m, tree_record *r) {
    if (type_of(r)->nature != NATURE_TEXT || r->length == 0) return;
    uint8_t *data = own_data(m, r, 0);
    if (data == NULL) return;
    const size_t start = draw(m, r->length);
    for (size_t i = 0; i < r->length; i++) {
        uint8_t *at = &data[(start + i) % r->length];
        if (*at < '0' || *at > '9') continue;
        const uint32_t from = *at - '0', to = draw(m, 10);
        *at = (uint8_t)('0' + to);
        if (draw(m, 2) == 0) return;
        for (tree_record *other = m->records; other < m->records + m->count; other++)
            for (size_t j = 0; other->rank != TREE_NO_SPACE && j < other->rank; j++)
                if (other->dims[j] == from) other->dims[j] = to;
        return;
    }
}

typedef void (*change)(mutation *m, tree_record *r);
/* Changes that are listed several times are more likely. */
static const change changes[] = {
    change_value,  change_value, change_value,  change_value,  change_value,  change_value, change_type,
    change_type,   change_shape, change_shape,  change_shape,  change_name,   take_name,    swap_names,
    take_value,    take_value,   drop,          drop,          drop_some,     copy,         move,
    change_layout, make_link,    change_length, change_length, change_length, change_digit, change_digit};

size_t tree_mutate(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes_mutate) {
    static mutation m;
    static uint8_t out[ROOM];
    m.random = seed;
    m.mutate = bytes_mutate;
    m.used = 0;
    m.count = tree_read(data, size, m.records);
    if (m.count == 0 || draw(&m, 50) == 0) return bytes_mutate(data, size, most);
    const uint32_t many = 1 + (draw(&m, 3) == 0 ? draw(&m, 4) : 0);
    for (uint32_t i = 0; i < many && m.count > 0; i++)
        changes[draw(&m, sizeof changes / sizeof changes[0])](&m, any(&m));
    const size_t length = tree_write(m.records, m.count, out, most < sizeof out ? most : sizeof out);
    memcpy(data, out, length);
    return length;
}

size_t tree_cross(const uint8_t *a, size_t size_a, const uint8_t *b, size_t size_b, uint8_t *out, size_t most,
                  unsigned seed) {
    static mutation m;
    static tree_record others[TREE_RECORDS];
    m.random = seed;
    m.count = tree_read(a, size_a, m.records);
    const size_t count = tree_read(b, size_b, others);
    if (m.count == 0 || count == 0) return 0;
    const size_t first = draw(&m, (uint32_t)count), many = 1 + draw(&m, 16);
    for (size_t i = first; i < count && i < first + many; i++) {
        tree_record *at = m.records, *end = m.records + m.count;
        while (at < end && (at->name_length != others[i].name_length ||
                            memcmp(at->name, others[i].name, at->name_length) != 0))
            at++;
        if (at == end && m.count == TREE_RECORDS) break;
        m.count += at == end;
        *at = others[i];
    }
    return tree_write(m.records, m.count, out, most);
}
