/* Scalar code as lines of C: local variables, in the order in which results need them. */
#ifndef LG_PROGRAM_C_LINES_H
#define LG_PROGRAM_C_LINES_H

#include "autodiff/program/program_c.h"

/* How inputs and outputs are written. */
typedef struct lg_c_ends {
    const void *user;
    void (*input)(lg_c *c, lg_text *to, const void *user, uint32_t number);
    void (*output)(lg_c *c, lg_text *to, const void *user, uint32_t number); /* an lvalue */
} lg_c_ends;

/* Instructions, and the order in which their lines are written. */
typedef struct lg_c_graph {
    lg_c *c;
    const lg_scalar_code *code;
    uint32_t count;
    const uint32_t *root;
    uint32_t roots;
    /* by instruction */
    uint32_t *order;   /* in this order they are written: `ordered` of them, neither inputs nor constants */
    uint32_t *place;   /* 1 + where it stands in `order`; 0: not there */
    uint32_t *sibling; /* 1 + the next STUMPFF, SIN or COS of the same operand */
    uint32_t *first;   /* by operand: 1 + the first of these */
    uint32_t *stack;
    uint32_t *shown; /* 1 + the block in which the input's load, or its own line, stands */
    uint32_t *slot;  /* 1 + place among what crosses from block to block */
    uint32_t ordered, slots;
} lg_c_graph;

/* The graph is to be closed whether it could be opened or not. */
bool lg_c_graph_open(lg_c_graph *g, lg_c *c, const lg_scalar_code *code, uint32_t count, const uint32_t *root,
                     uint32_t roots);
void lg_c_graph_close(lg_c_graph *g);

/* The number of blocks, each of which becomes a function. What one block makes and another one reads is kept
 * in work memory, `slots` numbers. */
uint32_t lg_c_graph_blocks(const lg_c_graph *g);
/* Writes the lines of a block; slots_at: where its slots begin in the work memory. */
void lg_c_graph_lines(lg_c_graph *g, lg_text *to, const char *indent, const lg_c_ends *ends, uint32_t block,
                      size_t slots_at);
/* Bytes of the frame of a function with these lines. */
size_t lg_c_frame_of(const lg_text *lines);

#endif
