/* A model as a block of a simulation tool, with states, inputs and outputs. If the program has a rate x' of x
 * and inputs (`velocity`, `field` or `rate`), x is the block's state, and the results of the other functions
 * are outputs. A model without a rate is a plain function from inputs to outputs. */
#ifndef LG_EXPORT_BLOCK_H
#define LG_EXPORT_BLOCK_H

#include "lg-export/export.h"

enum { MOST_PORTS = 64, MOST_FUNCTIONS = 16 };

/* What a variable is for. The generated C has the same names with a prefix: CAUSALITY_STATE and so on. */
#define CAUSALITY_LIST(ROW)  ROW(STATE) ROW(DERIVATIVE) ROW(INPUT) ROW(OUTPUT) ROW(PARAMETER)
#define CAUSALITY_NAME(name) name,
typedef enum causality { CAUSALITY_LIST(CAUSALITY_NAME) CAUSALITIES } causality;

/* A variable of the model: `count` numbers from place `at` on in the instance's array. */
typedef struct variable {
    char name[160];
    const char *unit;
    size_t at, count;
    causality kind;
} variable;

/* A function of the program in the block: `in` and `out` are the indices of the variables that it reads and
 * writes; `forward` and `adjoint` are the names of its derivatives. */
typedef struct part {
    const char *name, *forward, *adjoint;
    size_t in[MOST_PORTS], out[MOST_PORTS], ins, outs;
} part;

typedef struct block {
    const app *self;
    lg_program *program;
    export_source *source;
    bool derivatives; /* Forward and adjoint derivatives are wanted. */
    bool rate, step;  /* rate: the first part is the rate. step: the program's `step` fits the rate. */
    part parts[MOST_FUNCTIONS];
    size_t part_count;
    variable variables[MOST_PORTS];
    size_t count, numbers, states;
    export_names list; /* The functions to be written. */
} block;

/* Finds the variables and functions of the program, and adds derivatives if `derivatives`. Returns an exit
 * code; on failure a message has been printed. */
void block_collect(block *b, bool derivatives);
/* Returns whether all functions have a forward derivative (or an adjoint one if `forward` is false). */
bool block_has(const block *b, bool forward);
/* Initial value of number k of a variable. */
double block_start(const block *b, size_t variable, size_t k);

/* Add C. block_add_tables: enumerations and tables. block_add_evaluate: evaluate(r, out, work), which
 * computes derivatives and outputs from the values r. block_add_forward, block_add_adjoint: forward and
 * adjoint derivatives. block_add_step: take_step(r, h, next, work), which is the program's `step` (it stays
 * on the manifold) or, without one, the classical Runge-Kutta scheme. */
void block_add_tables(const block *b, text *to);
void block_add_evaluate(const block *b, text *to);
void block_add_forward(const block *b, text *to);
void block_add_adjoint(const block *b, text *to);
void block_add_step(const block *b, text *to);

#endif
