/* A model as a block: states, inputs and outputs, as tools for simulation see it. A model with a rate
 * (`velocity`, or `field` or `rate` of a program: x, inputs -> x') has states; outputs are the results of its
 * other functions. A model without one is a function: inputs and outputs. */
#ifndef LG_EXPORT_BLOCK_H
#define LG_EXPORT_BLOCK_H

#include "lg-export/export.h"

enum { MOST_PORTS = 64, MOST_FUNCTIONS = 16 };

/* What a variable is for; the generated C has the same names, CAUSALITY_STATE and so on. */
#define CAUSALITY_LIST(ROW)  ROW(STATE) ROW(DERIVATIVE) ROW(INPUT) ROW(OUTPUT) ROW(PARAMETER)
#define CAUSALITY_NAME(name) name,
typedef enum causality { CAUSALITY_LIST(CAUSALITY_NAME) CAUSALITIES } causality;

/* A variable of the model: numbers one behind the other in the instance's array. */
typedef struct variable {
    char name[160];
    const char *unit;
    size_t at, count;
    causality kind;
} variable;

/* A function of the program in the FMU: where its inputs and outputs are among the variables. */
typedef struct part {
    char *name, *forward, *adjoint;
    size_t in[MOST_PORTS], out[MOST_PORTS], ins, outs;
} part;

typedef struct block {
    const app *self;
    lg_program *program;
    export_source *source;
    bool derivatives; /* forward and adjoint functions are wanted */
    bool rate, step;  /* the first part is the rate; the program has `step` */
    part parts[MOST_FUNCTIONS];
    size_t part_count;
    variable variables[MOST_PORTS];
    size_t count, numbers, states;
    text list; /* the functions that are written */
} block;

/* Finds variables and functions of the program, and adds derivatives where `derivatives`. An exit code; on
 * failure a message has been printed. */
int block_collect(block *b, bool derivatives);
void block_free(block *b);
/* All functions have forward ones, or adjoint ones. */
bool block_has(const block *b, bool forward);
/* The start of number k of a variable. */
double block_start(const block *b, size_t variable, size_t k);

/* C: enumerations and tables; evaluate(r, out, work), derivatives and outputs of the values; forward and
 * adjoint; take_step(r, h, next, work), the program's `step`, which stays on the manifold, or the classical
 * Runge-Kutta scheme where there is none. */
void block_add_tables(const block *b, text *to);
void block_add_evaluate(const block *b, text *to);
void block_add_forward(const block *b, text *to);
void block_add_adjoint(const block *b, text *to);
void block_add_step(const block *b, text *to);

#endif
