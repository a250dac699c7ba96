/* Internals of the writer of C: the code that is already written, and the plan that is being written.
 * program_c_text.c writes pieces of text, program_c_lines.c scalar code as lines, program_c_elements.c,
 * program_c_scalars.c and program_c_body.c bodies of functions, program_c.c the whole file. */
#ifndef LG_PROGRAM_C_H
#define LG_PROGRAM_C_H

#include "autodiff/ops/op_c.h"
#include "autodiff/program/plan.h"
#include "autodiff/program/scalars.h"
#include "core/text.h"

/* A function that is already in the code: its text with @ for its name. */
typedef struct lg_c_function {
    uint64_t hash; /* of the text */
    char *text;
    char name[96];
} lg_c_function;

/* A contiguous piece of a table. */
typedef struct lg_c_piece {
    size_t at, count;
} lg_c_piece;

/* A range of a plan's constants, and its place in the table of weights. */
typedef struct lg_c_range {
    size_t from, count, at;
} lg_c_range;

/* A plan that is being written. */
typedef struct lg_c_frame {
    const lg_plan *plan;
    lg_text body;      /* statements */
    lg_c_range *range; /* by `from`, apart */
    size_t ranges, range_capacity;
    size_t work; /* numbers of work memory so far */
} lg_c_frame;

struct lg_c {
    const lg_context *context;
    const lg_program *program;
    const char *name;
    lg_dtype dtype;
    lg_status status;
    lg_error *error;
    lg_text code;                   /* fragments and functions */
    const lg_c_fragment **fragment; /* already in `code` */
    size_t fragments, fragment_capacity;
    lg_c_function *function;
    size_t functions, function_capacity;
    double *weight;
    size_t weights, weight_capacity;
    lg_c_piece *piece; /* of the weights */
    size_t pieces, piece_capacity;
    uint32_t *index;
    size_t indices, index_capacity;
    lg_c_piece *table; /* of the indices */
    size_t tables, table_capacity;
    /* For the bound on the stack: the depth of calls between functions of plans, now and at most; the largest
     * depth of calls between functions of fragments; bytes of the largest function of an operation, which
     * calls fragments only. */
    size_t nesting, most_nesting, most_chain, largest;
    lg_c_frame *frame;
    const lg_tensor_step *step;
    size_t indices_at; /* $i */
};

/* ---- failures ---- */

/* Returns false. */
bool lg_c_fail(lg_c *c, lg_status status, const char *format, ...) __attribute__((format(printf, 3, 4)));
void lg_c_fail_memory(lg_c *c);
bool lg_c_good(lg_c *c); /* no failure so far, texts included */
/* The same, before the words of this text are used: what is wrong with it is wrong with the code. */
bool lg_c_takes(lg_c *c, const lg_text *text);
/* Makes room for `needed` elements of `size` bytes; new elements are zero. */
bool lg_c_room(lg_c *c, void **array, size_t *capacity, size_t needed, size_t size);

/* ---- pieces of text ---- */

/* A line of tokens at this depth, broken where it is long. */
void lg_c_add_line(lg_text *to, int depth, const char *line, size_t length);
/* `text` with `name` for @. */
void lg_c_add_definition(lg_text *to, const char *text, const char *name);
void lg_c_need(lg_c *c, const lg_c_fragment *fragment);
/* A static function with this text (@ for its name), unless it stands there; its name. `title` begins it;
 * NULL on failure. */
const char *lg_c_define(lg_c *c, const char *title, const char *text);
/* An operation's function takes so many bytes of stack. */
void lg_c_largest(lg_c *c, size_t bytes);
/* The ranges of the plan's constants that its steps read, into the table of weights. */
void lg_c_collect_constants(lg_c *c, const lg_plan *plan);
/* Where an element of the constants that steps read stands in the weights. */
size_t lg_c_constant_at(const lg_c *c, size_t offset);
/* The memory of a place as C: "work + 12". */
void lg_c_add_place(lg_c *c, lg_text *to, lg_place place);
/* Whether the word stands in the text. */
bool lg_c_uses(const char *text, const char *word);
/* Memory that is used. */
void lg_c_use(lg_c *c, lg_place place, size_t count);

/* ---- bodies of functions ---- */

void lg_c_elementwise(lg_c *c, const lg_op *op, const lg_evaluation *e);
void lg_c_scalars(lg_c *c, const lg_scalar_step *step);
/* A plan as the function `name` of its own, or as a static one that stands once (NULL); its name, NULL on
 * failure. `storage`: "" or "static ". */
const char *lg_c_write_plan(lg_c *c, const lg_plan *plan, const char *storage, const char *name,
                            size_t *work);
/* The same for a function that others call: `name` calls its body and marks what is not finite. */
void lg_c_write_shared(lg_c *c, const lg_plan *plan, const char *storage, const char *name, size_t *work);

#endif
