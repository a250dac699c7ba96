/* Programs as C: a plan of one row, made in double precision, step by step. */
#include "autodiff/op_rows.h"
#include "autodiff/program_c.h"

#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "autodiff/tape_internal.h"

/* Bytes of the frame of a function of a fragment, and of one that calls, gcc and clang, -O0 to -O3: clang
 * spills much of what it unrolls. */
enum { FRAGMENT_FRAME = 1024, CALLING_FRAME = 512 };

/* ---- failures ---- */

bool lg_c_fail(lg_c *c, lg_status status, const char *format, ...) {
    char message[256];
    va_list arguments;
    if (c->status != LG_OK) return false;
    va_start(arguments, format);
    (void)vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    c->status = lg_fail(c->error, status, "%s", message);
    return false;
}

static void fail_memory(lg_c *c) {
    (void)lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
}

bool lg_c_good(lg_c *c) {
    if (c->code.failed || (c->frame != NULL && c->frame->body.failed)) fail_memory(c);
    return c->status == LG_OK;
}

bool lg_c_room(lg_c *c, void **array, size_t *capacity, size_t needed, size_t size) {
    if (needed <= *capacity) return true;
    const size_t grown = 2 * *capacity + needed + 16;
    void *memory = lg_alloc(c->context, grown, size);
    if (memory == NULL) return lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
    if (*capacity > 0) memcpy(memory, *array, *capacity * size);
    lg_free(c->context, *array);
    *array = memory;
    *capacity = grown;
    return true;
}
#define ROOM(c, array, capacity, needed)                                                                     \
    lg_c_room(c, (void **)&(c)->array, &(c)->capacity, needed, sizeof *(c)->array)

/* ---- text of tokens ---- */

static bool starts(const char *s, const char *word) {
    return strncmp(s, word, strlen(word)) == 0;
}

/* Where a line may end: behind the last comma, else at the last blank, before column `most`. */
static size_t line_break(const char *line, size_t length, size_t most) {
    for (size_t i = most; i > most / 2; i--)
        if (line[i] == ' ' && line[i - 1] == ',') return i;
    for (size_t i = most; i > most / 2; i--)
        if (line[i] == ' ' && line[i - 1] != '(' && line[i - 1] != '*') return i;
    return length;
}

static void add_line(lg_text *to, int depth, const char *line, size_t length) {
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

static bool is_head(const char *line) {
    line += strspn(line, " ");
    if (starts(line, "else ")) line += 5;
    return starts(line, "for (") || starts(line, "if (") || starts(line, "while (");
}

/* Stringized tokens as lines: a new one after { } and ; that stand outside of parentheses and of the braces
 * of a list, and after the head of a loop or branch. */
static void add_tokens(lg_text *to, const char *text) {
    int depth = 0, inside = 0, list = 0, hanging = 0, branch = 0; /* branch: where the last `if` hangs */
    const char *line = text;
    for (const char *s = text; *s != '\0'; s++) {
        const char *next = s + 1 + strspn(s + 1, " ");
        if (*s == '(' || *s == '[') inside++;
        if (*s == ')' || *s == ']') inside--;
        if (*s == '{' && s > text + 1 && (s[-1] == '=' || s[-2] == '=')) list++;
        if (inside > 0) continue;
        const bool head = *s == ')' && *next != '{' && is_head(line);
        const bool otherwise = starts(line + strspn(line, " "), "else ") && s[1] == ' ' &&
                               starts(s - 3, "else") && !starts(next, "if") && *next != '{';
        if (!head && !otherwise && *s != '{' && *s != '}' && *s != ';') continue;
        if (list > 0) {
            list -= *s == '}';
            continue;
        }
        if (*s == '}' && depth > 0) depth--;
        if (*s == '}' && (starts(next, "else") || (depth == 0 && *next != '\0' && !starts(next, "static"))))
            continue; /* } else {, } name; */
        add_line(to, depth + hanging, line, (size_t)(s + 1 - line));
        if (head && strstr(line, "if (") != NULL && strstr(line, "if (") < s) branch = hanging;
        hanging = head || otherwise ? hanging + 1 : starts(next, "else") && *s == ';' ? branch : 0;
        if (*s == '{') depth++;
        if (depth == 0 && *s == '}' && *next != '\0') lg_text_add(to, "\n");
        line = s + 1;
    }
    add_line(to, depth, line, strlen(line));
}

/* ---- fragments and functions ---- */

static bool in_word(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

bool lg_c_uses(const char *text, const char *word) {
    const size_t length = strlen(word);
    for (const char *s = text; (s = strstr(s, word)) != NULL; s += length)
        if ((s == text || !in_word(s[-1])) && !in_word(s[length])) return true;
    return false;
}

/* Functions that a text defines: lines that begin with `static` and hold a parenthesis. */
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
        if (s[length] == '_' && (s == text || !in_word(s[-1])))
            (void)lg_c_fail(c, LG_INVALID_ARGUMENT,
                            "'%s' cannot be the name: the code uses words that begin so", c->name);
}

void lg_c_need(lg_c *c, const lg_c_fragment *fragment) {
    if (c->status != LG_OK) return;
    for (size_t i = 0; i < c->fragments; i++)
        if (c->fragment[i] == fragment) return;
    for (size_t i = 0; i < LG_C_NEEDS && fragment->needs[i] != NULL; i++) lg_c_need(c, fragment->needs[i]);
    if (!ROOM(c, fragment, fragment_capacity, c->fragments + 1)) return;
    c->fragment[c->fragments++] = fragment;
    const char *text = fragment->text;
    if (text == NULL) text = lg_c_text_of(fragment->file[c->dtype == LG_F32 ? 1 : 0]);
    check_name(c, text);
    c->stack += FRAGMENT_FRAME * functions_in(text);
    lg_text_add(&c->code, "\n");
    if (fragment->comment != NULL) lg_text_add(&c->code, "/* %s */\n", fragment->comment);
    if (fragment->text != NULL)
        add_tokens(&c->code, text);
    else
        lg_text_add_named(&c->code, c->name, text);
}

/* `text` with `name` for @. */
static void add_definition(lg_text *to, const char *text, const char *name) {
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

const char *lg_c_define(lg_c *c, const char *title, const char *text, size_t stack, bool block) {
    if (!lg_c_good(c)) return NULL;
    const uint64_t hash = hash_of(text);
    for (size_t i = 0; i < c->functions; i++)
        if (c->function[i].hash == hash && strcmp(c->function[i].text, text) == 0) return c->function[i].name;
    if (!ROOM(c, function, function_capacity, c->functions + 1)) return NULL;
    lg_c_function *made = &c->function[c->functions];
    made->hash = hash;
    made->text = lg_strdup(c->context, text);
    if (made->text == NULL) {
        fail_memory(c);
        return NULL;
    }
    (void)snprintf(made->name, sizeof made->name, "%s_%zu", title, ++c->functions);
    if (!block) c->stack += stack;
    if (block && stack > c->deepest) c->deepest = stack;
    lg_text_add(&c->code, "\n");
    add_definition(&c->code, text, made->name);
    return made->name;
}

/* ---- tables ---- */

/* Where these numbers lie in the table of weights; a part of a piece that is there serves. */
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

/* Ranges of the plan's constants that steps read; those that meet become one. */
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

static size_t elements_of(const lg_tensor_step *s, uint32_t k) {
    return s->x[k].area == LG_AREA_NONE ? 0 : lg_shape_count(*s->shapes[k]);
}

static void collect_constants(lg_c *c, const lg_plan *plan) {
    for (size_t i = 0; i < plan->steps; i++) {
        const lg_plan_step *s = &plan->step[i];
        if (s->kind == LG_STEP_TENSOR)
            for (uint32_t k = 0; k < s->tensor.inputs; k++)
                read_constants(c, s->tensor.x[k], elements_of(&s->tensor, k));
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

void lg_c_use(lg_c *c, lg_place place, size_t count) {
    if (place.area == LG_AREA_WORK && place.offset + count > c->frame->work)
        c->frame->work = place.offset + count;
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

/* A sign of the format: $0 $y $s $i; how many characters it has. */
static size_t add_memory(lg_c *c, lg_text *to, const char *sign) {
    const lg_tensor_step *s = c->step;
    uint32_t k = 0;
    size_t n = 1;
    if (*sign == 'i') {
        lg_text_add(to, "%s_indices + %zu", c->name, c->indices_at);
    } else if (*sign == 'y') {
        lg_c_add_place(c, to, s->y);
    } else if (*sign == 's') {
        lg_c_use(c, s->scratch, s->scratch_count);
        lg_c_add_place(c, to, s->scratch);
    } else {
        for (n = 0; sign[n] >= '0' && sign[n] <= '9'; n++) k = 10 * k + (uint32_t)(sign[n] - '0');
        lg_c_add_place(c, to, s->x[k]);
    }
    return n;
}

/* " + 0" at the end of an address goes. */
static const char *skip_zero(const char *s) {
    return starts(s, " + 0") && (s[4] == ',' || s[4] == ')') ? s + 4 : s;
}

void lg_c_call(lg_c *c, const lg_c_fragment *fragment, const char *format, ...) {
    char call[1024], *long_call = NULL;
    va_list arguments, again;
    if (fragment != NULL) lg_c_need(c, fragment);
    if (!lg_c_good(c)) return;
    va_start(arguments, format);
    va_copy(again, arguments);
    const int length = vsnprintf(call, sizeof call, format, arguments);
    va_end(arguments);
    if (length >= (int)sizeof call) {
        long_call = lg_alloc(c->context, (size_t)length + 1, 1);
        if (long_call == NULL)
            fail_memory(c);
        else
            (void)vsnprintf(long_call, (size_t)length + 1, format, again);
    }
    va_end(again);
    lg_text *body = &c->frame->body;
    lg_text line = {.context = c->context};
    for (const char *s = long_call != NULL ? long_call : call; *s != '\0';) {
        if (*s == '$') {
            s += 1 + add_memory(c, &line, s + 1);
            s = skip_zero(s);
        } else {
            lg_text_append(&line, s++, 1);
        }
    }
    lg_text_add(&line, ";");
    if (!line.failed) add_line(body, 1, line.data, line.length);
    if (line.failed) fail_memory(c);
    lg_text_destroy(&line);
    lg_free(c->context, long_call);
}

/* ---- steps ---- */

static bool fits_int(lg_c *c, size_t count, const char *what) {
    if (count <= INT_MAX) return true;
    return lg_c_fail(c, LG_UNSUPPORTED, "function '%s': %s is too large for C", c->frame->plan->name, what);
}

static void write_tensor(lg_c *c, const lg_tensor_step *s) {
    const lg_op *op = s->op;
    const lg_evaluation e = {.k = c->frame->plan->k,
                             .attr = &s->attr,
                             .inputs = s->inputs,
                             .in = s->shapes,
                             .shape = &s->shape,
                             .count = s->count};
    c->step = s;
    lg_c_use(c, s->y, s->count);
    if (!fits_int(c, s->count, op->name)) return;
    if (s->count == 0) return;
    if (op->write_c != NULL)
        op->write_c(c, &e);
    else if (op->element != NULL)
        lg_c_elementwise(c, op, &e);
    else
        (void)lg_c_fail(c, LG_UNSUPPORTED, "function '%s': %s has no C", c->frame->plan->name, op->name);
}

static const lg_c_fragment c_dense_rows = {
    .comment = "y (m, n) = x (m, k) w (k, n) + b (n; or NULL)",
    .text = LG_C(
        static void dense_rows(int m, int n, int k, const real *x, const real *w, const real *b, real *y) {
            for (int i = 0; i < m; i++, x += k, y += n) {
                for (int j = 0; j < n; j++) y[j] = b == NULL ? REAL(0.0) : b[j];
                dense_add(k, n, w, x, y);
            }
        }),
    .needs = {&lg_c_dense_add}};

static void write_dense(lg_c *c, const lg_dense_step *s) {
    const lg_attr kind = {.i = {(uint32_t)s->kind}};
    const lg_place places[3] = {s->x, s->w, s->b};
    const lg_tensor_step step = {.inputs = 3, .x = (lg_place *)places, .y = s->y};
    c->step = &step;
    lg_c_use(c, s->y, s->m * s->n);
    if (!fits_int(c, s->m * s->n, "a layer") || !fits_int(c, s->k * s->n, "a layer")) return;
    lg_c_call(c, &c_dense_rows, "dense_rows(%zu, %zu, %zu, $0, $1, %s, $y)", s->m, s->n, s->k,
              s->b.area == LG_AREA_NONE ? "NULL" : "$2");
    if (s->kind != LG_IDENTITY)
        lg_c_call(c, NULL, "%s(%zu, $y)", lg_c_map(c, &lg_op_act, &kind, 1, 1), s->m * s->n);
    c->step = NULL;
}

static const lg_c_fragment c_copy = {.text = LG_C(static void copy(int n, const real *x, real *y) {
                                         for (int i = 0; i < n; i++) y[i] = x[i];
                                     })};

static void write_copy(lg_c *c, const lg_copy_step *s) {
    lg_place places[1] = {s->x};
    const lg_tensor_step step = {.inputs = 1, .x = places, .y = s->y};
    c->step = &step;
    lg_c_use(c, s->y, s->count);
    if (fits_int(c, s->count, "an output")) lg_c_call(c, &c_copy, "copy(%zu, $0, $y)", s->count);
    c->step = NULL;
}

static const char *write_plan(lg_c *c, const lg_plan *plan, const char *public, size_t *work);

static size_t half_of(const lg_plan *callee, size_t i) {
    return callee->input_count[i];
}

/* By input that is carried: from where it comes and, for its output, where it goes. */
static void write_call(lg_c *c, const lg_call_step *s) {
    const lg_plan *callee = s->callee;
    size_t work = 0;
    lg_c_frame *own = c->frame;
    const char *name = write_plan(c, callee, NULL, &work);
    c->frame = own;
    if (name == NULL) return;
    lg_text *body = &own->body;
    lg_place inner = s->work;
    lg_text_add(body, "    for (int i = 0; i < %u; i++) {\n        %s(", s->times, name);
    for (size_t i = 0; i < callee->inputs; i++) {
        if (s->carry[i] == UINT32_MAX) {
            lg_text_add(body, "x%zu, ", i);
            continue;
        }
        const size_t at = s->next[i].offset;
        /* an output that is carried into two inputs lies where the first of them has it */
        size_t first = i;
        for (size_t k = 0; k < i; k++)
            if (s->carry[k] == s->carry[i] && k < first) first = k;
        lg_text_add(body, "i == 0 ? x%zu : work + (%zu + i %% 2 * %zu), ", i,
                    first == i ? at : s->next[first].offset, half_of(callee, first));
        lg_c_use(c, s->next[first], 2 * half_of(callee, first));
    }
    for (size_t j = 0; j < callee->outputs; j++) {
        size_t from = callee->inputs;
        for (size_t i = callee->inputs; i-- > 0;)
            if (s->carry[i] == j) from = i;
        if (from == callee->inputs)
            lg_text_add(body, "i == %u ? y%zu : NULL, ", s->times - 1, j);
        else
            lg_text_add(body, "i == %u ? y%zu : work + (%zu + (i + 1) %% 2 * %zu), ", s->times - 1, j,
                        s->next[from].offset, half_of(callee, from));
    }
    lg_text_add(body, "work + %zu);\n    }\n", inner.offset);
    lg_c_use(c, inner, work);
}

static void write_steps(lg_c *c, const lg_plan *plan) {
    for (size_t i = 0; i < plan->steps && lg_c_good(c); i++) {
        const lg_plan_step *s = &plan->step[i];
        switch (s->kind) {
        case LG_STEP_TENSOR:
            write_tensor(c, &s->tensor);
            break;
        case LG_STEP_DENSE:
            write_dense(c, &s->dense);
            break;
        case LG_STEP_SCALARS:
            lg_c_scalars(c, &s->scalars);
            break;
        case LG_STEP_COPY:
            write_copy(c, &s->copy);
            break;
        case LG_STEP_CALL:
            write_call(c, &s->call);
            break;
        }
    }
}

/* ---- functions ---- */

static const lg_c_fragment c_unfit = {.file = {"unfit", "unfit"}};

/* Places of outputs that nobody wants; the results last of all. Where the plan is a loop, its callee has
 * places of its own. */
static void add_head(const lg_plan *plan, const char *body, lg_text *to, lg_c *c) {
    char word[32];
    for (size_t i = 0; i < plan->inputs; i++) {
        (void)snprintf(word, sizeof word, "x%zu", i);
        if (!lg_c_uses(body, word)) lg_text_add(to, "    (void)%s;\n", word);
    }
    for (size_t j = 0; j < plan->outputs; j++) {
        const lg_place spill = {LG_AREA_WORK, 0, plan->spill[j]};
        if (plan->output_count[j] == 0) continue;
        lg_text_add(to, "    if (y%zu == NULL) y%zu = ", j, j);
        lg_c_add_place(c, to, spill);
        lg_text_add(to, ";\n");
        lg_c_use(c, spill, plan->output_count[j]);
    }
}

static void add_marks(lg_c *c, const lg_plan *plan) {
    if (!plan->mark_unfit) return;
    lg_c_need(c, &c_unfit);
    for (size_t i = 0; i < plan->inputs; i++)
        for (size_t j = 0; j < plan->outputs; j++)
            lg_text_add(&c->frame->body, "    mark_unfit(%zu, x%zu, %zu, y%zu);\n", plan->input_count[i], i,
                        plan->output_count[j], j);
}

/* A plan as the function `public`, or as a static one; its name, NULL on failure. */
static const char *write_plan(lg_c *c, const lg_plan *plan, const char *public, size_t *work) {
    lg_c_frame frame = {.plan = plan, .body = {.context = c->context}};
    lg_text text = {.context = c->context}, head = {.context = c->context};
    const char *name = public;
    c->frame = &frame;
    collect_constants(c, plan);
    write_steps(c, plan);
    add_marks(c, plan);
    const char *body = frame.body.data != NULL ? frame.body.data : "";
    add_head(plan, body, &head, c);
    lg_text_add(&text, "%svoid @(", public == NULL ? "static " : "");
    for (size_t i = 0; i < plan->inputs; i++) lg_text_add(&text, "const real *x%zu, ", i);
    for (size_t j = 0; j < plan->outputs; j++) lg_text_add(&text, "real *y%zu, ", j);
    lg_text_add(&text, "real *work) {\n%s%s%s}\n", frame.work == 0 ? "    (void)work;\n" : "",
                head.data != NULL ? head.data : "", body);
    if (text.failed || head.failed || frame.body.failed) fail_memory(c);
    if (!lg_c_good(c)) {
        name = NULL;
    } else if (public == NULL) {
        name = lg_c_define(c, plan->name, text.data, CALLING_FRAME, false);
    } else {
        lg_text_add(&c->code, "\n");
        add_definition(&c->code, text.data, public);
        c->stack += CALLING_FRAME;
    }
    *work = frame.work;
    c->frame = NULL;
    lg_text_destroy(&text);
    lg_text_destroy(&head);
    lg_text_destroy(&frame.body);
    lg_free(c->context, frame.range);
    return name;
}

/* ---- what is told ---- */

static void add_shape(lg_text *to, const lg_port *port) {
    lg_text_add(to, " %s (", port->name);
    for (uint32_t d = 0; d < port->shape.rank; d++)
        lg_text_add(to, "%s%u", d > 0 ? ", " : "", port->shape.dims[d]);
    if (port->shape.rank == 0) lg_text_add(to, "1");
    lg_text_add(to, ")");
    if (port->unit != NULL && port->unit[0] != '\0') {
        lg_text_add(to, " in ");
        lg_text_add_comment(to, port->unit);
    }
}

static void add_ports(lg_text *to, const lg_port *ports, size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (i > 0) lg_text_add(to, ",");
        add_shape(to, &ports[i]);
    }
}

/* Names that a macro or a type could take, and that of the work memory, get a _. */
static void add_parameter(lg_c *c, lg_text *to, const char *name, bool in) {
    bool lower = false;
    for (const char *s = name; *s != '\0'; s++) lower = lower || (*s >= 'a' && *s <= 'z');
    const size_t length = strlen(c->name);
    const bool is_ours = strncmp(name, c->name, length) == 0 && name[length] == '_';
    lg_text_add(to, "%s%s_real *%s%s, ", in ? "const " : "", c->name, name,
                !lower || strcmp(name, "work") == 0 || is_ours ? "_" : "");
}

static void add_declaration(lg_c *c, lg_text *to, const lg_function *f, const lg_plan *plan, size_t work) {
    lg_text line = {.context = c->context};
    lg_text_add(&line, "/*");
    add_ports(&line, f->input, f->inputs);
    lg_text_add(&line, " ->");
    add_ports(&line, f->output, f->outputs);
    lg_text_add(&line, "; depth %zu, %zu numbers of work memory */", plan->depth, work);
    lg_text_add(to, "\n");
    if (!line.failed) add_line(to, 0, line.data, line.length);
    lg_text_destroy(&line);
    lg_text_add(&line, "void %s_%s(", c->name, f->name);
    for (size_t i = 0; i < f->inputs; i++) add_parameter(c, &line, f->input[i].name, true);
    for (size_t j = 0; j < f->outputs; j++) add_parameter(c, &line, f->output[j].name, false);
    lg_text_add(&line, "%s_real *work);", c->name);
    if (line.failed)
        fail_memory(c);
    else
        add_line(to, 0, line.data, line.length);
    lg_text_destroy(&line);
}

/* Names of functions that would be names of something else. */
static bool check_function(lg_c *c, const lg_function *f) {
    static const char *const taken[] = {"real", "weights", "indices", "H"};
    const size_t length = strlen(f->name), ending = strlen("WORK_SIZE");
    bool bad = length >= ending && strcmp(f->name + length - ending, "WORK_SIZE") == 0;
    bool lower = false; /* names in capitals are macros */
    for (const char *s = f->name; *s != '\0'; s++) lower = lower || (*s >= 'a' && *s <= 'z');
    bad = bad || !lower;
    for (size_t i = 0; i < LG_COUNT(taken); i++) bad = bad || strcmp(f->name, taken[i]) == 0;
    return !bad || lg_c_fail(c, LG_INVALID_ARGUMENT, "the function '%s' cannot have this name in C", f->name);
}

/* ---- arrays ---- */

/* The parameter of which the numbers are a part, and from which one on; NULL: made of parameters. */
static const lg_program_parameter_own *origin_of(const lg_c *c, const lg_c_piece *piece, size_t *from) {
    const double *values = c->weight + piece->at;
    for (size_t p = 0; p < c->program->parameters; p++) {
        const lg_program_parameter_own *parameter = &c->program->parameter[p];
        for (size_t k = 0; k + piece->count <= parameter->count; k++)
            if (parameter->values[k] == values[0] &&
                memcmp(parameter->values + k, values, piece->count * sizeof *values) == 0) {
                *from = k;
                return parameter;
            }
    }
    return NULL;
}

static void add_origin(lg_c *c, lg_text *to, const lg_c_piece *piece) {
    size_t from = 0;
    const lg_program_parameter_own *parameter = origin_of(c, piece, &from);
    if (parameter == NULL)
        lg_text_add(to, "    /* constants */\n");
    else if (piece->count == parameter->count)
        lg_text_add(to, "    /* %s */\n", parameter->name);
    else
        lg_text_add(to, "    /* %s from %zu on */\n", parameter->name, from);
}

static void add_arrays(lg_c *c, lg_text *arrays, lg_text *weights) {
    if (c->weights == 0 && c->indices == 0) return;
    lg_text_add(arrays, "\n#ifdef __cplusplus\nextern \"C\" {\n#endif\n");
    if (c->weights > 0) {
        lg_text_add(arrays, "extern const %s_real %s_weights[%zu];\n", c->name, c->name, c->weights);
        lg_text_add(weights, "\nconst %s_real %s_weights[%zu] = {\n", c->name, c->name, c->weights);
        for (size_t i = 0; i < c->pieces; i++) {
            const lg_c_piece *piece = &c->piece[i];
            add_origin(c, weights, piece);
            for (size_t k = 0; k < piece->count; k += 4)
                lg_text_add_hex_line(weights, c->dtype, c->weight + piece->at + k,
                                     piece->count - k < 4 ? piece->count - k : 4);
        }
        lg_text_add(weights, "};\n");
    }
    if (c->indices > 0) {
        lg_text_add(arrays, "extern const int %s_indices[%zu];\n", c->name, c->indices);
        lg_text_add(weights, "\nconst int %s_indices[%zu] = {\n", c->name, c->indices);
        for (size_t i = 0; i < c->indices; i++)
            lg_text_add(weights, "%s%u,%s", i % 10 == 0 ? "    " : " ", c->index[i],
                        i % 10 == 9 || i + 1 == c->indices ? "\n" : "");
        lg_text_add(weights, "};\n");
    }
    lg_text_add(arrays, "#ifdef __cplusplus\n}\n#endif\n");
}

/* ---- the whole ---- */

void lg_c_options_init(lg_c_options *options) {
    *options = (lg_c_options){.size = sizeof *options, .dtype = LG_F64, .mark_unfit = true};
}

typedef struct writing {
    lg_c c;
    const lg_c_options *options;
    lg_c_source *out;
    lg_text sizes, declarations, arrays, weights;
} writing;

static bool write_function(writing *w, size_t index) {
    lg_c *c = &w->c;
    const lg_function *f = &c->program->function[index];
    lg_plan_options options;
    lg_plan *plan = NULL;
    char name[2 * LG_PROGRAM_MAX_NAME + 8];
    size_t work = 0;
    lg_plan_options_init(&options);
    options.mark_unfit = w->options->mark_unfit;
    options.compact = w->options->compact;
    if (!check_function(c, f)) return false;
    c->status = lg_plan_create(c->program, index, &options, &plan, c->error);
    if (c->status != LG_OK) return false;
    (void)snprintf(name, sizeof name, "%s_%s", c->name, f->name);
    (void)write_plan(c, plan, name, &work);
    if (work > INT_MAX) (void)lg_c_fail(c, LG_UNSUPPORTED, "function '%s' is too large for C", f->name);
    add_declaration(c, &w->declarations, f, plan, work);
    lg_text_add(&w->sizes, "#define %s_WORK_SIZE %zu\n", name, work > 0 ? work : 1);
    lg_c_source *out = w->out;
    out->function[out->functions] = index;
    out->work[out->functions] = work > 0 ? work : 1;
    out->depth[out->functions++] = plan->depth;
    if (work > out->work_size) out->work_size = work;
    if (plan->depth > out->most_depth) out->most_depth = plan->depth;
    lg_plan_destroy(plan);
    return lg_c_good(c);
}

static bool unfit_or_failed(writing *w) {
    lg_text *const texts[] = {&w->sizes, &w->declarations, &w->arrays, &w->weights, &w->c.code};
    for (size_t i = 0; i < LG_COUNT(texts); i++) {
        if (texts[i]->failed) fail_memory(&w->c);
        if (texts[i]->unfit)
            (void)lg_c_fail(&w->c, LG_NOT_FINITE, "the program holds numbers that are not finite%s",
                            w->c.dtype == LG_F32 ? " in single precision" : "");
    }
    return w->c.status != LG_OK;
}

/* The text, which belongs to the caller from now on. */
static char *give(writing *w, lg_text *text) {
    char *data = text->data != NULL ? text->data : lg_strdup(w->c.context, "");
    if (data == NULL) fail_memory(&w->c);
    *text = (lg_text){.context = w->c.context};
    return data;
}

static void write_all(writing *w) {
    lg_c *c = &w->c;
    const lg_c_options *o = w->options;
    const size_t count = o->function_count > 0 ? o->function_count : c->program->functions;
    lg_c_source *out = w->out;
    out->function = lg_alloc(c->context, count + 1, sizeof *out->function);
    out->work = lg_alloc(c->context, count + 1, sizeof *out->work);
    out->depth = lg_alloc(c->context, count + 1, sizeof *out->depth);
    if (out->function == NULL || out->work == NULL || out->depth == NULL) {
        fail_memory(c);
        return;
    }
    lg_text_add(&w->sizes, "typedef %s %s_real;\n\n", c->dtype == LG_F32 ? "float" : "double", c->name);
    lg_text_add_named(&c->code, c->name, lg_c_text_of("prelude"));
    lg_text_add(&c->code, "%s", lg_c_text_of(c->dtype == LG_F32 ? "prelude_f32" : "prelude_f64"));
    for (size_t i = 0; i < count && lg_c_good(c); i++) {
        const size_t index = o->function_count > 0 ? o->functions[i] : i;
        if (index >= c->program->functions)
            (void)lg_c_fail(c, LG_NOT_FOUND, "there is no such function");
        else
            (void)write_function(w, index);
    }
    out->work_size = out->work_size > 0 ? out->work_size : 1;
    lg_text_add(&w->sizes, "#define %s_WORK_SIZE %zu /* the largest of them */\n", c->name, out->work_size);
    add_arrays(c, &w->arrays, &w->weights);
    out->stack_size = c->stack + c->deepest;
    out->numbers = c->weights;
    out->integers = c->indices;
    if (!lg_c_good(c) || unfit_or_failed(w)) return;
    out->sizes = give(w, &w->sizes);
    out->declarations = give(w, &w->declarations);
    out->arrays = give(w, &w->arrays);
    out->weights = give(w, &w->weights);
    out->code = give(w, &c->code);
}

static void release(writing *w) {
    lg_c *c = &w->c;
    lg_text *const texts[] = {&w->sizes, &w->declarations, &w->arrays, &w->weights, &c->code};
    for (size_t i = 0; i < LG_COUNT(texts); i++) lg_text_destroy(texts[i]);
    for (size_t i = 0; i < c->functions; i++) lg_free(c->context, c->function[i].text);
    void *const arrays[] = {(void *)c->fragment, c->function, c->weight, c->piece, c->index, c->table};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) lg_free(c->context, arrays[i]);
}

lg_status lg_program_write_c(const lg_program *program, const lg_c_options *options, lg_c_source **out,
                             lg_error *error) {
    const lg_context *context = program->context;
    if (options == NULL || options->size != sizeof *options ||
        (options->dtype != LG_F64 && options->dtype != LG_F32))
        return lg_fail(error, LG_INVALID_ARGUMENT, "options are missing or of another version");
    const char *problem = options->name != NULL ? lg_program_name_problem(options->name) : "there is none";
    if (problem != NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "the name in C: %s", problem);
    lg_c_source *made = lg_alloc(context, 1, sizeof *made);
    if (made == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "out of memory");
    made->context = context;
    const lg_text empty = {.context = context};
    writing w = {.c = {.context = context,
                       .program = program,
                       .name = options->name,
                       .dtype = options->dtype,
                       .error = error,
                       .code = empty},
                 .options = options,
                 .out = made,
                 .sizes = empty,
                 .declarations = empty,
                 .arrays = empty,
                 .weights = empty};
    write_all(&w);
    release(&w);
    if (w.c.status == LG_OK)
        *out = made;
    else
        lg_c_source_destroy(made);
    return w.c.status;
}

void lg_c_source_destroy(lg_c_source *source) {
    if (source == NULL) return;
    char *const texts[] = {source->sizes, source->declarations, source->arrays, source->weights,
                           source->code};
    size_t *const arrays[] = {source->function, source->work, source->depth};
    for (size_t i = 0; i < LG_COUNT(texts); i++) lg_free(source->context, texts[i]);
    for (size_t i = 0; i < LG_COUNT(arrays); i++) lg_free(source->context, arrays[i]);
    lg_free(source->context, source);
}
