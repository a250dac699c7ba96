/* Changes packed functions by the structure of the format: images are unpacked, changed and packed again. New
 * programs come from the recordings of tests/autodiff/random, which are valid: any operations of the table,
 * calls, loops, derivatives. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "autodiff/random/random.h"
#include "forms.h"
#include "liegrad/program.h"

enum { ROOM = 1 << 14, MOST_LISTED = 8, MOST_OPERATIONS = 512, MOST_LIST = 64, MEMORY = 1 << 20 };

/* What recording.c and pieces.c need of their program. */
tally counted;
void stop(const char *format, ...) {
    (void)fprintf(stderr, "%s\n", format);
    abort();
}
void *room(size_t count, size_t size) {
    void *memory = calloc(count + 1, size);
    if (memory == NULL) abort();
    return memory;
}

/* ---- lists of functions ---- */

typedef struct bytes_list {
    size_t count;
    const uint8_t *at[MOST_LISTED];
    size_t length[MOST_LISTED];
} bytes_list;

static void list_functions(const uint8_t *data, size_t size, bytes_list *out) {
    out->count = 0;
    while (size >= 2 && out->count < MOST_LISTED) {
        size_t length = data[0] + 256u * data[1];
        if (length > size - 2) length = size - 2;
        out->at[out->count] = data + 2;
        out->length[out->count++] = length;
        data += 2 + length;
        size -= 2 + length;
    }
}

/* Functions that do not fit any more are left out. */
static size_t write_functions(const bytes_list *list, uint8_t *out, size_t most) {
    size_t at = 0;
    for (size_t i = 0; i < list->count; i++) {
        if (list->length[i] > UINT16_MAX || list->length[i] + 2 > most - at) break;
        out[at] = (uint8_t)list->length[i];
        out[at + 1] = (uint8_t)(list->length[i] >> 8);
        memcpy(out + at + 2, list->at[i], list->length[i]);
        at += 2 + list->length[i];
    }
    return at;
}

/* ---- new programs ---- */

static size_t draw_program(uint64_t *random, uint8_t *out, size_t most) {
    static bool ready;
    static recording drawn;
    static uint8_t packed[ROOM];
    size_t number[MOST_ALL], count = 0, used = 0;
    bytes_list list = {.count = 0};
    lg_error error = {LG_OK, ""};
    if (!ready) find_pieces();
    ready = true;
    draw_recording(fuzz_draw(random, UINT32_MAX), &drawn);
    lg_program *program = empty_program();
    (void)add_recording(program, &drawn, number, &count, &error);
    for (size_t i = 0; i < lg_program_functions(program) && i < MOST_LISTED; i++) {
        lg_function_image *image;
        size_t size = sizeof packed - used;
        if (lg_function_image_create(program, i, &image) != LG_OK) break;
        const bool fits = lg_function_pack(image, packed + used, &size, NULL) == LG_OK;
        lg_function_image_destroy(image);
        if (!fits) break;
        list.at[list.count] = packed + used;
        list.length[list.count++] = size;
        used += size;
    }
    lg_program_destroy(program);
    return write_functions(&list, out, most);
}

/* ---- changes of one function ---- */

/* The lists that changes replace lie here; everything else in the unpacked image. */
typedef struct changing {
    lg_function_image image;
    uint64_t *random;
    lg_operation operations[MOST_OPERATIONS];
    uint32_t lists[8][MOST_LIST];
    lg_port ports[2][MOST_LIST];
    size_t lists_used;
} changing;

static uint32_t draw(changing *c, uint32_t below) {
    return fuzz_draw(c->random, below);
}

static uint32_t any_place(changing *c) {
    return draw(c, (uint32_t)c->image.operation_count);
}

static uint32_t *own_list(changing *c, const uint32_t *from, size_t count) {
    if (c->lists_used == sizeof c->lists / sizeof c->lists[0] || count >= MOST_LIST) return NULL;
    uint32_t *to = c->lists[c->lists_used++];
    if (count > 0) memcpy(to, from, count * sizeof *to);
    return to;
}

static int64_t other_whole(changing *c, int64_t now) {
    static const int64_t special[] = {0,
                                      1,
                                      2,
                                      3,
                                      7,
                                      255,
                                      256,
                                      65536,
                                      INT32_MAX,
                                      (int64_t)INT32_MAX + 1,
                                      UINT32_MAX,
                                      (int64_t)1 << 40,
                                      ((int64_t)1 << 61) - 1,
                                      -1,
                                      -2,
                                      -65536};
    switch (draw(c, 4)) {
    case 0:
        return special[draw(c, sizeof special / sizeof special[0])];
    case 1:
        return now == INT64_MAX ? now : now + 1;
    case 2:
        return now == INT64_MIN ? now : now - 1;
    default:
        return draw(c, 8);
    }
}

static bool same_shape(const lg_operation *a, const lg_operation *b) {
    return a->rank == b->rank && memcmp(a->shape, b->shape, sizeof a->shape) == 0;
}

/* An operation before `place`, of the same shape as `like` where one is found. */
static uint32_t place_before(changing *c, uint32_t place, const lg_operation *like) {
    uint32_t at = draw(c, place);
    for (int tries = 0; tries < 12 && !same_shape(&c->operations[at], like); tries++) at = draw(c, place);
    return at;
}

/* Another operation that takes as many inputs. */
static void change_name(changing *c) {
    lg_operation *o = &c->operations[any_place(c)];
    uint32_t rows = 0;
    while (lg_ops[rows] != NULL) rows++;
    for (int tries = 0; tries < 40; tries++) {
        const lg_op *op = lg_ops[draw(c, rows)];
        if (draw(c, 20) > 0 && (o->input_count < op->least || o->input_count > op->most)) continue;
        o->name = op->name;
        return;
    }
}

static void change_input(changing *c) {
    const uint32_t place = any_place(c);
    lg_operation *o = &c->operations[place];
    uint32_t *inputs = o->input_count > 0 ? own_list(c, o->inputs, o->input_count) : NULL;
    if (inputs == NULL || place == 0) return;
    uint32_t *input = &inputs[draw(c, o->input_count)];
    const lg_operation *like = *input < place ? &c->operations[*input] : o; /* the format allows any place */
    *input =
        draw(c, 20) == 0 ? draw(c, (uint32_t)c->image.operation_count + 2) : place_before(c, place, like);
    o->inputs = inputs;
}

static void change_input_count(changing *c) {
    const uint32_t place = any_place(c);
    lg_operation *o = &c->operations[place];
    uint32_t *inputs = own_list(c, o->inputs, o->input_count);
    if (inputs == NULL || place == 0) return;
    if (draw(c, 2) == 0 && o->input_count > 0)
        o->input_count--;
    else
        inputs[o->input_count++] = draw(c, place);
    o->inputs = inputs;
}

static void change_shape(changing *c) {
    lg_operation *o = &c->operations[any_place(c)];
    if (draw(c, 4) == 0) o->rank = draw(c, LG_MAX_RANK + 1);
    lg_affine *extent = &o->shape[draw(c, o->rank > 0 ? o->rank : 1)];
    if (draw(c, 4) == 0)
        extent->rows = other_whole(c, extent->rows);
    else
        extent->base = other_whole(c, extent->base);
}

static void change_attribute(changing *c) {
    static const double special[] = {0, -0.0, 1, -1, 0.5, 1e-300, 1e300, 1e-5, 3};
    lg_operation *o = &c->operations[any_place(c)];
    switch (draw(c, 8)) {
    case 0:
        o->real = special[draw(c, sizeof special / sizeof special[0])];
        break;
    case 1:
        o->reciprocal.base = other_whole(c, o->reciprocal.base);
        break;
    case 2:
        o->revision = (uint32_t)other_whole(c, o->revision);
        break;
    case 3:
        o->whole[draw(c, LG_WHOLE_COUNT)].rows = other_whole(c, 0);
        break;
    default: {
        lg_affine *whole = &o->whole[draw(c, LG_WHOLE_COUNT)];
        whole->base = other_whole(c, whole->base);
    }
    }
}

static void change_indices(changing *c) {
    lg_operation *o = &c->operations[any_place(c)];
    for (int tries = 0; tries < 20 && o->index_count == 0 && o->real_count == 0; tries++)
        o = &c->operations[any_place(c)];
    if (draw(c, 3) == 0 && o->real_count > 0) {
        o->real_count -= draw(c, 2);
        return;
    }
    uint32_t *indices = o->index_count > 0 ? own_list(c, o->indices, o->index_count) : NULL;
    if (indices == NULL) return;
    if (draw(c, 4) == 0)
        o->index_count += draw(c, 2) == 0 || o->index_count == 1 ? 1 : UINT32_MAX;
    else
        indices[draw(c, o->index_count)] = (uint32_t)other_whole(c, 0);
    o->indices = indices;
}

/* Moves the places from `from` on by `by`, in all lists. If `by` is negative, the place `from` itself becomes
 * `instead`. */
static void renumber(changing *c, uint32_t from, int by, uint32_t instead) {
    for (size_t i = 0; i < c->image.operation_count; i++) {
        uint32_t *inputs = (uint32_t *)(uintptr_t)c->operations[i].inputs;
        for (uint32_t k = 0; k < c->operations[i].input_count; k++)
            if (inputs[k] >= from)
                inputs[k] = by < 0 && inputs[k] == from ? instead : inputs[k] + (uint32_t)by;
    }
    uint32_t *results = (uint32_t *)(uintptr_t)c->image.results;
    for (size_t k = 0; k < c->image.output_count; k++)
        if (results[k] >= from)
            results[k] = by < 0 && results[k] == from ? instead : results[k] + (uint32_t)by;
}

static void remove_operation(changing *c) {
    const uint32_t place = any_place(c);
    if (c->image.operation_count < 2) return;
    const lg_operation gone = c->operations[place];
    memmove(&c->operations[place], &c->operations[place + 1],
            (c->image.operation_count - place - 1) * sizeof *c->operations);
    c->image.operation_count--;
    renumber(c, place, -1, gone.input_count > 0 ? gone.inputs[0] : 0);
}

/* Adds a new operation with the shape and the inputs of old operations. A later operation uses the new
 * one. */
static void add_operation(changing *c) {
    uint32_t rows = 0;
    const uint32_t place = any_place(c);
    if (c->image.operation_count == MOST_OPERATIONS) return;
    while (lg_ops[rows] != NULL) rows++;
    const lg_operation like = c->operations[place];
    lg_operation made = like;
    if (draw(c, 3) > 0) { /* elementwise */
        const lg_op *op = lg_ops[draw(c, rows)];
        uint32_t *inputs = own_list(c, NULL, 0);
        if (inputs == NULL) return;
        made = (lg_operation){
            .name = op->name, .revision = 1, .inputs = inputs, .input_count = op->least, .rank = like.rank};
        memcpy(made.shape, like.shape, sizeof made.shape);
        for (uint32_t k = 0; k < made.input_count && k < MOST_LIST; k++)
            inputs[k] = draw(c, 2) == 0 ? place : place_before(c, place + 1, &like);
    } else { /* the inputs are copied, because their places are changed later */
        made.inputs = own_list(c, like.inputs, like.input_count);
        if (made.inputs == NULL) return;
    }
    renumber(c, place + 1, 1, 0);
    memmove(&c->operations[place + 2], &c->operations[place + 1],
            (c->image.operation_count - place - 1) * sizeof *c->operations);
    c->operations[place + 1] = made;
    c->image.operation_count++;
    if (c->image.output_count > 0 && draw(c, 2) == 0)
        ((uint32_t *)(uintptr_t)c->image.results)[draw(c, (uint32_t)c->image.output_count)] = place + 1;
}

static void change_port(changing *c) {
    const bool out = draw(c, 2) == 0;
    const lg_port **list = out ? &c->image.outputs : &c->image.inputs;
    size_t *count = out ? &c->image.output_count : &c->image.input_count;
    if (*count == 0 || *count >= MOST_LIST) return;
    if (*list != c->ports[out]) memcpy(c->ports[out], *list, *count * sizeof **list);
    *list = c->ports[out];
    lg_port *port = &c->ports[out][draw(c, (uint32_t)*count)];
    switch (draw(c, 6)) {
    case 0:
        port->shared = !port->shared;
        break;
    case 1:
        port->name = c->ports[out][draw(c, (uint32_t)*count)].name;
        break;
    case 2:
        port->low = draw(c, 2) == 0 ? -1 : 1;
        break;
    case 3:
        port->shape.rank = draw(c, LG_MAX_RANK + 1);
        break;
    default:
        port->shape.dims[draw(c, port->shape.rank > 0 ? port->shape.rank : 1)] = (uint32_t)other_whole(c, 1);
    }
}

static void change_results(changing *c) {
    uint32_t *results = (uint32_t *)(uintptr_t)c->image.results;
    if (c->image.times > 0 || c->image.output_count == 0) return;
    uint32_t *result = &results[draw(c, (uint32_t)c->image.output_count)];
    *result = *result < c->image.operation_count
                  ? place_before(c, (uint32_t)c->image.operation_count, &c->operations[*result])
                  : any_place(c);
}

/* A loop stays a loop, because other functions have no carry. */
static void change_loop(changing *c) {
    uint32_t *carry = (uint32_t *)(uintptr_t)c->image.carry;
    const uint32_t other = (uint32_t)other_whole(c, c->image.times);
    if (c->image.times == 0) return;
    switch (draw(c, 4)) {
    case 0:
        c->image.times = other > 0 ? other : 1;
        break;
    case 1:
        c->image.callee = (uint32_t)other_whole(c, c->image.callee);
        break;
    default:
        if (c->image.input_count > 0)
            carry[draw(c, (uint32_t)c->image.input_count)] =
                draw(c, 4) == 0 ? LG_CARRY_NONE : (uint32_t)other_whole(c, 0);
    }
}

typedef void (*change)(changing *c);
static const change of_operations[] = {
    change_name,      change_name,   change_input,     change_input,   change_input_count,
    change_shape,     change_shape,  change_attribute, change_indices, change_attribute,
    remove_operation, add_operation, add_operation,    change_port,    change_results};
static const change of_loops[] = {change_loop, change_loop, change_port};

/* Returns the new length; 0 if the bytes are no function or the new ones do not fit. */
static size_t change_function(uint64_t *random, const uint8_t *bytes, size_t length, uint8_t *out,
                              size_t most) {
    static changing c;
    lg_function_image *image;
    size_t memory = MEMORY, size = most;
    if (lg_function_unpack(NULL, "f", bytes, length, &memory, &image, NULL) != LG_OK) return 0;
    c.image = *image;
    c.random = random;
    c.lists_used = 0;
    const bool fits = image->operation_count <= MOST_OPERATIONS;
    if (fits && image->operation_count > 0)
        memcpy(c.operations, image->operations, image->operation_count * sizeof *c.operations);
    c.image.operations = c.operations;
    for (uint32_t i = 0, many = 1 + draw(&c, 3); fits && i < many; i++) {
        if (c.image.operation_count > 0)
            of_operations[draw(&c, sizeof of_operations / sizeof of_operations[0])](&c);
        else
            of_loops[draw(&c, sizeof of_loops / sizeof of_loops[0])](&c);
    }
    const bool packed = fits && lg_function_pack(&c.image, out, &size, NULL) == LG_OK;
    lg_function_image_destroy(image);
    return packed ? size : 0;
}

/* ---- inputs ---- */

size_t functions_mutate(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes) {
    static uint8_t out[ROOM], changed[ROOM];
    bytes_list list;
    uint64_t random = seed;
    if (most > sizeof out) most = sizeof out;
    list_functions(data, size, &list);
    if (fuzz_draw(&random, 40) == 0 || (list.count == 0 && fuzz_draw(&random, 2) == 0)) {
        const size_t length = draw_program(&random, out, most);
        memcpy(data, out, length);
        if (length > 0) return length;
    }
    if (list.count == 0 || fuzz_draw(&random, 8) == 0) return bytes(data, size, most);
    const uint32_t at = fuzz_draw(&random, (uint32_t)list.count),
                   other = fuzz_draw(&random, (uint32_t)list.count);
    switch (fuzz_draw(&random, 12)) {
    case 0: /* leaves functions out at the end */
        list.count = at + 1;
        break;
    case 1: /* another order, or one of them twice */
        list.at[at] = list.at[other];
        list.length[at] = list.length[other];
        break;
    default:
        list.length[at] = change_function(&random, list.at[at], list.length[at], changed, sizeof changed);
        if (list.length[at] == 0) return bytes(data, size, most);
        list.at[at] = changed;
    }
    const size_t length = write_functions(&list, out, most);
    memcpy(data, out, length);
    return length;
}

/* The first functions of a, then functions of b. */
size_t functions_cross(const uint8_t *a, size_t size_a, const uint8_t *b, size_t size_b, uint8_t *out,
                       size_t most, unsigned seed) {
    bytes_list first, second;
    uint64_t random = seed;
    list_functions(a, size_a, &first);
    list_functions(b, size_b, &second);
    if (first.count == 0 || second.count == 0) return 0;
    first.count = 1 + fuzz_draw(&random, (uint32_t)first.count);
    for (size_t i = fuzz_draw(&random, (uint32_t)second.count); i < second.count && first.count < MOST_LISTED;
         i++) {
        first.at[first.count] = second.at[i];
        first.length[first.count++] = second.length[i];
    }
    return write_functions(&first, out, most);
}
