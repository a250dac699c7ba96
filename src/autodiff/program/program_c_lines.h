/* Scalar code as lines of C: each instruction becomes a local variable, in the order in which results need
 * them. */
#ifndef LG_PROGRAM_C_LINES_H
#define LG_PROGRAM_C_LINES_H

#include "autodiff/program/program_c.h"

/* Callbacks that write the C expressions of inputs and outputs. */
typedef struct lg_c_ends {
    const void *user;
    void (*input)(lg_c *c, lg_text *to, const void *user, uint32_t number);
    void (*output)(lg_c *c, lg_text *to, const void *user, uint32_t number); /* writes an lvalue */
} lg_c_ends;

/* Scalar instructions, and the order in which they are written. */
typedef struct lg_c_graph {
    lg_c *c;
    const lg_scalar_code *code;
    uint32_t count;
    const uint32_t *root;
    uint32_t roots;
    /* The following arrays have one entry per instruction. */
    /* The instructions in writing order, `ordered` of them; without inputs and constants. */
    uint32_t *order;
    uint32_t *place;   /* 1 + position in `order`; 0: not in `order` */
    uint32_t *sibling; /* 1 + the next STUMPFF, SIN or COS instruction with the same operand */
    uint32_t *first;   /* indexed by operand: 1 + the first such instruction */
    uint32_t *stack;
    uint32_t *shown; /* 1 + the block in which a load of this value was last written */
    uint32_t *slot;  /* 1 + slot of a value that a later block reads, too; 0: none */
    uint32_t ordered, slots;
} lg_c_graph;

/* lg_c_graph_close must be called even if lg_c_graph_open fails. */
bool lg_c_graph_open(lg_c_graph *g, lg_c *c, const lg_scalar_code *code, uint32_t count, const uint32_t *root,
                     uint32_t roots);
void lg_c_graph_close(lg_c_graph *g);

/* Number of blocks. Each block becomes one C function. Values that one block computes and another one reads
 * are kept in `slots` numbers of work memory. */
uint32_t lg_c_graph_blocks(const lg_c_graph *g);
/* Writes the lines of a block. slots_at: offset of the slots in the work memory. */
void lg_c_graph_lines(lg_c_graph *g, lg_text *to, const char *indent, const lg_c_ends *ends, uint32_t block,
                      size_t slots_at);
/* Upper bound in bytes on the stack frame of a function with these lines. */
size_t lg_c_frame_of(const lg_text *lines);

#endif
