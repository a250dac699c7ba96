/* Programs as C, pieces: lines, fragments and functions that are written once, arrays of numbers, and
 * statements. */
#include "autodiff/program/program_c.h"
#include "core/widen.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* ---- failures ---- */

bool lg_c_fail(lg_c *c, lg_status status, const char *format, ...) {
    char message[256];
    va_list arguments;
    if (c->status != LG_OK) return false;
    va_start(arguments, format);
    (void)lg_format_list(message, sizeof message, format, arguments);
    va_end(arguments);
    c->status = lg_fail(c->error, status, "%s", message);
    return false;
}

void lg_c_fail_memory(lg_c *c) {
    (void)lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
}

bool lg_c_good(lg_c *c) {
    if (c->code.failed || (c->frame != NULL && c->frame->body.failed)) lg_c_fail_memory(c);
    return c->status == LG_OK;
}

bool lg_c_takes(lg_c *c, const lg_text *text) {
    c->code.failed = c->code.failed || text->failed;
    c->code.unfit = c->code.unfit || text->unfit;
    c->code.lost += text->lost;
    return lg_c_good(c);
}

bool lg_c_room(lg_c *c, void **array, size_t *capacity, size_t needed, size_t size) {
    if (needed <= *capacity) return true;
    const size_t grown = 2 * *capacity + needed + 16;
    void *memory = lg_widen(c->context, *array, *capacity, grown, size);
    if (memory == NULL) return lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
    *array = memory;
    *capacity = grown;
    return true;
}
#define ROOM(c, array, capacity, needed)                                                                     \
    lg_c_room(c, (void **)&(c)->array, &(c)->capacity, needed, sizeof *(c)->array)

/* ---- lines of C ---- */

static bool starts(const char *s, const char *word) {
    return strncmp(s, word, strlen(word)) == 0;
}

/* Where to break a line: behind the last comma, otherwise at the last blank, before column `most`. */
static size_t line_break(const char *line, size_t length, size_t most) {
    for (size_t i = most; i > most / 2; i--)
        if (line[i] == ' ' && line[i - 1] == ',') return i;
    for (size_t i = most; i > most / 2; i--)
        if (line[i] == ' ' && line[i - 1] != '(' && line[i - 1] != '*') return i;
    return length;
}

void lg_c_add_line(lg_text *to, int depth, const char *line, size_t length) {
    enum { COLUMNS = 110 };
    int extra = 0;
    while (length > 0 && line[0] == ' ') line++, length--;
    while (length > 0 && line[length - 1] == ' ') length--;
    while (length > 0) {
        const size_t room = (size_t)(COLUMNS - 4 * depth - extra);
        const size_t end = length > room ? line_break(line, length, room) : length;
        lg_text_add(to, "%*s%.*s\n", 4 * depth + extra, "", (int)end, line);
        line += end;
        length -= end;
        while (length > 0 && line[0] == ' ') line++, length--;
        extra = 8;
    }
}

/* ---- fragments and functions ---- */

bool lg_c_uses(const char *text, const char *word) {
    const size_t length = strlen(word);
    for (const char *s = text; (s = strstr(s, word)) != NULL; s += length)
        if ((s == text || !lg_in_word(s[-1])) && !lg_in_word(s[length])) return true;
    return false;
}

/* Number of functions that a text defines: places where `static` is followed by a parenthesis before any {, ;
 * or =. */
static size_t functions_in(const char *text) {
    size_t count = 0;
    for (const char *s = text; (s = strstr(s, "static ")) != NULL; s++) {
        const size_t to_brace = strcspn(s, "{;="), to_call = strcspn(s, "(");
        count += to_call < to_brace;
    }
    return count;
}

static void check_name(lg_c *c, const char *text) {
    const size_t length = strlen(c->name);
    for (const char *s = text; (s = strstr(s, c->name)) != NULL; s++)
        if (s[length] == '_' && (s == text || !lg_in_word(s[-1])))
            (void)lg_c_fail(c, LG_INVALID_ARGUMENT,
                            "'%s' cannot be the name in C: the generated code has words that begin with it",
                            c->name);
}

/* The fragments that a fragment needs, in the order in which they are written. */
enum { MOST_NEEDS = 4 };
static const struct {
    const char *name, *needs[MOST_NEEDS + 1];
} needs[] = {{"argmax_mask", {"first_maximum"}},
             {"conv1d", {"window_rows", "whole_windows", "conv_tiles", "dense_add"}},
             {"conv1d_input", {"window_rows", "whole_windows", "conv_back", "dot"}},
             {"conv1d_weight", {"window_rows"}},
             {"conv_back", {"conv_panel_add"}},
             {"conv_panel", {"conv_tile"}},
             {"conv_panel_add", {"conv_panel"}},
             {"conv_tiles", {"conv_tile"}},
             {"dense_add", {"dot"}},
             {"dense_rows", {"dense_add"}},
             {"centre", {"mean_of"}},
             {"covariance", {"mean_of"}},
             {"covariance_root", {"factor_rows", "mean_of", "rotate_rows"}},
             {"factor_rows", {"dot"}},
             {"lyapunov", {"rotate_rows"}},
             {"matmul_nn", {"dense_add"}},
             {"matmul_nt", {"dot"}},
             {"matmul_tn", {"dense_add"}},
             {"max_axis", {"first_maximum"}},
             {"pool_mean", {"windows"}},
             {"pool_mean_adjoint", {"windows"}},
             {"pool_pick", {"windows", "first_maximum"}},
             {"pool_place", {"windows", "first_maximum"}},
             {"rotate_rows", {"dot"}},
             {"rowdot", {"dot"}},
             {"se3_act", {"so3", "so3_coefficients"}},
             {"se3_dexpinv", {"vectors", "dexpinv_coef"}},
             {"sigmoid_of", {"exp", "exp_power"}},
             {"so3", {"vectors"}},
             {"so3_dexp", {"so3", "so3_coefficients"}},
             {"so3_dexpinv", {"so3", "dexpinv_coef"}},
             {"so3_exp", {"so3", "so3_coefficients"}},
             {"stumpff", {"stumpff_series"}},
             {"stumpff_row", {"stumpff"}},
             {"stumpff_rows", {"stumpff_row"}},
             {"stumpff_series", {"inverse_factorial"}},
             {"tanh_of", {"exp", "exp_power"}},
             {"whole_windows", {"windows"}},
             {"window_rows", {"windows"}}};

/* Returns the fragments that `fragment` needs; NULL ends the list. */
static const char *const *needs_of(const char *fragment) {
    static const char *const none[] = {NULL};
    for (size_t i = 0; i < LG_COUNT(needs); i++)
        if (strcmp(needs[i].name, fragment) == 0) return needs[i].needs;
    return none;
}

static const char *text_of(const lg_c *c, const char *fragment) {
    char own[64];
    const char *text = lg_named_text_of(lg_c_texts, fragment);
    if (text != NULL) return text;
    (void)snprintf(own, sizeof own, "%s_%s", fragment, c->dtype == LG_F32 ? "f32" : "f64");
    return lg_named_text_of(lg_c_texts, own);
}

/* Largest number of nested calls from this fragment down to fragments that need no others. */
static size_t chain_of(const lg_c *c, const char *fragment) {
    size_t below = 0;
    for (const char *const *need = needs_of(fragment); *need != NULL; need++) {
        const size_t chain = chain_of(c, *need);
        if (chain > below) below = chain;
    }
    return functions_in(text_of(c, fragment)) + below;
}

void lg_c_need(lg_c *c, const char *fragment) {
    const char *text = text_of(c, fragment);
    if (text == NULL || c->status != LG_OK) return;
    for (size_t i = 0; i < c->fragments; i++)
        if (c->fragment[i] == text) return;
    for (const char *const *need = needs_of(fragment); *need != NULL; need++) lg_c_need(c, *need);
    if (!ROOM(c, fragment, fragment_capacity, c->fragments + 1)) return;
    c->fragment[c->fragments++] = text;
    const size_t chain = chain_of(c, fragment);
    if (chain > c->most_chain) c->most_chain = chain;
    check_name(c, text);
    lg_text_add(&c->code, "\n");
    lg_text_add_named(&c->code, c->name, text);
}

void lg_c_need_called(lg_c *c, const char *code) {
    for (const char *end = code; (end = strchr(end, '(')) != NULL; end++) {
        char name[64];
        const char *begin = end;
        while (begin > code && lg_in_word(begin[-1])) begin--;
        (void)snprintf(name, sizeof name, "%.*s", (int)(end - begin), begin);
        lg_c_need(c, name);
    }
}

void lg_c_add_definition(lg_text *to, const char *text, const char *name) {
    for (const char *s = text; *s != '\0';) {
        const size_t n = strcspn(s, "@");
        lg_text_append(to, s, n);
        s += n;
        if (*s == '@') lg_text_append(to, name, strlen(name)), s++;
    }
}

/* FNV-1a */
static uint64_t hash_of(const char *text) {
    uint64_t h = 14695981039346656037u;
    for (; *text != '\0'; text++) h = (h ^ (unsigned char)*text) * 1099511628211u;
    return h;
}

void lg_c_largest(lg_c *c, size_t bytes) {
    if (bytes > c->largest) c->largest = bytes;
}

const char *lg_c_define(lg_c *c, const char *title, const char *text) {
    if (!lg_c_good(c)) return NULL;
    const uint64_t hash = hash_of(text);
    for (size_t i = 0; i < c->functions; i++)
        if (c->function[i].hash == hash && strcmp(c->function[i].text, text) == 0) return c->function[i].name;
    if (!ROOM(c, function, function_capacity, c->functions + 1)) return NULL;
    lg_c_function *made = &c->function[c->functions];
    made->hash = hash;
    made->text = lg_strdup(c->context, text);
    if (made->text == NULL) {
        lg_c_fail_memory(c);
        return NULL;
    }
    (void)snprintf(made->name, sizeof made->name, "%s_%zu", title, ++c->functions);
    lg_text_add(&c->code, "\n");
    lg_c_add_definition(&c->code, text, made->name);
    return made->name;
}

/* ---- arrays of weights and indices ---- */

/* Index of these numbers in the array of weights. They are appended unless they are part of a piece that is
 * already there. */
static size_t weights_at(lg_c *c, const double *values, size_t count) {
    for (size_t i = 0; i < c->pieces; i++)
        for (size_t k = 0; count > 0 && k + count <= c->piece[i].count; k++) {
            const double *there = c->weight + c->piece[i].at + k;
            if (memcmp(there, values, sizeof *there) == 0 &&
                memcmp(there, values, count * sizeof *there) == 0)
                return c->piece[i].at + k;
        }
    if (!ROOM(c, weight, weight_capacity, c->weights + count) ||
        !ROOM(c, piece, piece_capacity, c->pieces + 1))
        return 0;
    memcpy(c->weight + c->weights, values, count * sizeof *values);
    c->piece[c->pieces++] = (lg_c_piece){c->weights, count};
    c->weights += count;
    return c->weights - count;
}

void lg_c_indices(lg_c *c, const uint32_t *values, size_t count) {
    if (c->status != LG_OK) return;
    for (size_t i = 0; i < c->tables; i++)
        if (c->table[i].count == count &&
            memcmp(c->index + c->table[i].at, values, count * sizeof *values) == 0) {
            c->indices_at = c->table[i].at;
            return;
        }
    if (!ROOM(c, index, index_capacity, c->indices + count) || !ROOM(c, table, table_capacity, c->tables + 1))
        return;
    if (count > 0) memcpy(c->index + c->indices, values, count * sizeof *values);
    c->table[c->tables++] = (lg_c_piece){c->indices, count};
    c->indices_at = c->indices;
    c->indices += count;
}

/* Adds a range of the plan's constants that a step reads; overlapping ranges are merged. */
static void read_constants(lg_c *c, lg_place place, size_t count) {
    lg_c_frame *f = c->frame;
    if (place.area != LG_AREA_CONSTANTS || count == 0 || c->status != LG_OK) return;
    size_t from = place.offset, to = place.offset + count, kept = 0;
    for (size_t i = 0; i < f->ranges; i++) {
        const lg_c_range *r = &f->range[i];
        if (r->from < to && from < r->from + r->count) {
            if (r->from < from) from = r->from;
            if (r->from + r->count > to) to = r->from + r->count;
        } else {
            f->range[kept++] = *r;
        }
    }
    f->ranges = kept;
    if (lg_c_room(c, (void **)&f->range, &f->range_capacity, f->ranges + 1, sizeof *f->range))
        f->range[f->ranges++] = (lg_c_range){from, to - from, 0};
}

size_t lg_c_constant_at(const lg_c *c, size_t offset) {
    const lg_c_frame *f = c->frame;
    for (size_t i = 0; i < f->ranges; i++)
        if (f->range[i].from <= offset && offset < f->range[i].from + f->range[i].count)
            return f->range[i].at + offset - f->range[i].from;
    return 0;
}

void lg_c_collect_constants(lg_c *c, const lg_plan *plan) {
    for (size_t i = 0; i < plan->steps; i++) {
        const lg_plan_step *s = &plan->step[i];
        if (s->kind == LG_STEP_TENSOR)
            for (uint32_t k = 0; k < s->tensor.inputs; k++)
                read_constants(c, s->tensor.x[k],
                               s->tensor.x[k].area == LG_AREA_NONE ? 0
                                                                   : lg_shape_count(*s->tensor.shapes[k]));
        if (s->kind == LG_STEP_DENSE) {
            read_constants(c, s->dense.w, s->dense.k * s->dense.n);
            read_constants(c, s->dense.b, s->dense.n);
            read_constants(c, s->dense.x, s->dense.m * s->dense.k);
        }
        if (s->kind == LG_STEP_COPY) read_constants(c, s->copy.x, s->copy.count);
        if (s->kind == LG_STEP_SCALARS)
            for (uint32_t k = 0; k < s->scalars.ins; k++)
                read_constants(c, s->scalars.in[k].place, s->scalars.in[k].count);
    }
    for (size_t i = 0; i < c->frame->ranges && c->status == LG_OK; i++) {
        lg_c_range *r = &c->frame->range[i];
        r->at = weights_at(c, (const double *)plan->constants + r->from, r->count);
    }
}

/* ---- statements ---- */

void lg_c_scratch(lg_c *c, size_t count) {
    lg_c_use(c, c->step->scratch, count);
}

void lg_c_use(lg_c *c, lg_place place, size_t count) {
    if (place.area == LG_AREA_WORK && place.offset + count > c->frame->work)
        c->frame->work = place.offset + count;
}

bool lg_c_lies_over(const lg_c *c, uint32_t input) {
    return input < c->step->inputs && lg_same_place(&c->step->x[input], &c->step->y);
}

void lg_c_add_place(lg_c *c, lg_text *to, lg_place place) {
    size_t offset = place.offset;
    if (place.area == LG_AREA_NONE) {
        lg_text_add(to, "NULL");
        return;
    }
    if (place.area == LG_AREA_CONSTANTS) {
        offset = lg_c_constant_at(c, place.offset);
        lg_text_add(to, "%s_weights", c->name);
    } else if (place.area == LG_AREA_WORK) {
        lg_text_add(to, "work");
    } else {
        lg_text_add(to, "%c%u", place.area == LG_AREA_INPUT ? 'x' : 'y', place.number);
    }
    if (offset > 0) lg_text_add(to, " + %zu", offset);
}

/* Writes the memory that $0, $y, $s or $i stands for. `sign` points behind the $; returns the number of its
 * characters. */
static size_t add_memory(lg_c *c, lg_text *to, const char *sign) {
    const lg_tensor_step *s = c->step;
    uint32_t k = 0;
    size_t n = 1;
    if (*sign == 'i') {
        lg_text_add(to, "%s_indices + %zu", c->name, c->indices_at);
    } else if (*sign == 'y') {
        lg_c_add_place(c, to, s->y);
    } else if (*sign == 's') {
        lg_c_add_place(c, to, s->scratch);
    } else {
        for (n = 0; sign[n] >= '0' && sign[n] <= '9'; n++) k = 10 * k + (uint32_t)(sign[n] - '0');
        lg_c_add_place(c, to, s->x[k]);
    }
    return n;
}

/* Skips " + 0" at the end of an address. */
static const char *skip_zero(const char *s) {
    return starts(s, " + 0") && (s[4] == ',' || s[4] == ')') ? s + 4 : s;
}

void lg_c_call(lg_c *c, const char *format, ...) {
    char call[1024], *long_call = NULL;
    va_list arguments, again;
    if (!lg_c_good(c)) return;
    va_start(arguments, format);
    va_copy(again, arguments);
    const int length = lg_format_list(call, sizeof call, format, arguments);
    va_end(arguments);
    if (length >= (int)sizeof call) {
        long_call = lg_alloc(c->context, (size_t)length + 1, 1);
        if (long_call == NULL)
            lg_c_fail_memory(c);
        else
            (void)lg_format_list(long_call, (size_t)length + 1, format, again);
    }
    va_end(again);
    lg_text *body = &c->frame->body;
    lg_text line = {.context = c->context};
    lg_c_need_called(c, long_call != NULL ? long_call : call);
    for (const char *s = long_call != NULL ? long_call : call; *s != '\0';) {
        if (*s == '$') {
            s += 1 + add_memory(c, &line, s + 1);
            s = skip_zero(s);
        } else {
            lg_text_append(&line, s++, 1);
        }
    }
    lg_text_add(&line, ";");
    if (lg_c_takes(c, &line)) lg_c_add_line(body, 1, line.data, line.length);
    lg_text_destroy(&line);
    lg_free(c->context, long_call);
}
