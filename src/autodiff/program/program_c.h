/* Internals of the writer of C: the code written so far, and the plan that is being written. program_c_text.c
 * writes pieces of text, program_c_lines.c writes scalar code as lines, program_c_elements.c,
 * program_c_scalars.c and program_c_body.c write bodies of functions, and program_c.c writes the whole
 * file. */
#ifndef LG_PROGRAM_C_H
#define LG_PROGRAM_C_H

#include "autodiff/ops/op_c.h"
#include "autodiff/program/plan.h"
#include "autodiff/program/scalars.h"
#include "core/text.h"

/* A function that has been written: its text with @ in place of its name. */
typedef struct lg_c_function {
    uint64_t hash; /* hash of the text */
    char *text;
    char name[96];
} lg_c_function;

/* A contiguous piece of an array. */
typedef struct lg_c_piece {
    size_t at, count;
} lg_c_piece;

/* A range of a plan's constants, and its place in the array of weights. */
typedef struct lg_c_range {
    size_t from, count, at;
} lg_c_range;

/* The state of writing one plan. */
typedef struct lg_c_frame {
    const lg_plan *plan;
    lg_text body;      /* statements of the function */
    lg_c_range *range; /* the plan's constants that its steps read; disjoint ranges */
    size_t ranges, range_capacity;
    size_t work; /* numbers of work memory used so far */
} lg_c_frame;

struct lg_c {
    const lg_context *context;
    const lg_program *program;
    const char *name;
    lg_dtype dtype;
    lg_status status;
    lg_error *error;
    lg_text code;          /* fragments and functions written so far */
    const char **fragment; /* texts of the fragments that `code` contains */
    size_t fragments, fragment_capacity;
    lg_c_function *function;
    size_t functions, function_capacity;
    double *weight;
    size_t weights, weight_capacity;
    lg_c_piece *piece; /* pieces of `weight` */
    size_t pieces, piece_capacity;
    uint32_t *index;
    size_t indices, index_capacity;
    lg_c_piece *table; /* pieces of `index` */
    size_t tables, table_capacity;
    /* For the bound on the stack: the current and the largest depth of calls between functions of plans; the
     * largest depth of calls between functions of fragments; and the bytes of the largest frame of an
     * operation's function, which calls fragments only. */
    size_t nesting, most_nesting, most_chain, largest;
    lg_c_frame *frame;
    const lg_tensor_step *step;
    size_t indices_at; /* index of the table that $i stands for */
};

/* ---- failures ---- */

/* Records a failure, unless there is one already. Always returns false. */
bool lg_c_fail(lg_c *c, lg_status status, const char *format, ...) __attribute__((format(printf, 3, 4)));
void lg_c_fail_memory(lg_c *c);
bool lg_c_good(lg_c *c); /* true if nothing has failed so far, including the texts */
/* The same, to be called before `text` is appended to the code: a failure of `text` becomes a failure of the
 * code. */
bool lg_c_takes(lg_c *c, const lg_text *text);
/* Grows an array to `needed` elements of `size` bytes; new elements are zero. */
bool lg_c_room(lg_c *c, void **array, size_t *capacity, size_t needed, size_t size);

/* ---- pieces of text ---- */

/* Appends one line of code at nesting level `depth`. Long lines are broken. */
void lg_c_add_line(lg_text *to, int depth, const char *line, size_t length);
/* Appends `text` with every @ replaced by `name`. */
void lg_c_add_definition(lg_text *to, const char *text, const char *name);
/* Writes a fragment and the fragments that it needs, each once. Does nothing if there is no fragment of this
 * name, with or without _f64 or _f32, the type of the numbers. lg_c_need_called does this for each function
 * that the code calls. */
void lg_c_need(lg_c *c, const char *fragment);
void lg_c_need_called(lg_c *c, const char *code);
/* Defines a static function with this text (@ stands for its name), unless an equal one exists, and returns
 * its name. The name begins with `title`. NULL on failure. */
const char *lg_c_define(lg_c *c, const char *title, const char *text);
/* Takes into account that an operation's function needs this many bytes of stack. */
void lg_c_largest(lg_c *c, size_t bytes);
/* Puts the ranges of the plan's constants that its steps read into the array of weights. */
void lg_c_collect_constants(lg_c *c, const lg_plan *plan);
/* Index in the array of weights of the plan's constant at `offset`. */
size_t lg_c_constant_at(const lg_c *c, size_t offset);
/* Writes the address of a place as C, for example "work + 12". */
void lg_c_add_place(lg_c *c, lg_text *to, lg_place place);
/* Whether the text contains the word as a whole word. */
bool lg_c_uses(const char *text, const char *word);
/* Records that this part of the work memory is used. */
void lg_c_use(lg_c *c, lg_place place, size_t count);

/* ---- bodies of functions ---- */

void lg_c_elementwise(lg_c *c, const lg_op *op, const lg_evaluation *e);
void lg_c_scalars(lg_c *c, const lg_scalar_step *step);
/* Writes a plan as the C function `name`. If `name` is NULL, writes it as a static function, but only once if
 * several functions have the same text. Returns the function's name, NULL on failure. `storage` is "" or
 * "static ". */
const char *lg_c_write_plan(lg_c *c, const lg_plan *plan, const char *storage, const char *name,
                            size_t *work);
/* The same for a function that other functions of the program call, too. The body becomes a separate static
 * function; `name` calls it and then marks results of inputs that are not finite. */
void lg_c_write_shared(lg_c *c, const lg_plan *plan, const char *storage, const char *name, size_t *work);

#endif
