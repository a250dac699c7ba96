/* Calls: an operation that runs another function of the same program. It occurs only in programs, never on a
 * tape: on a tape, lg_program_call records the operations of the called function and marks them, and the
 * program gets a single call for them. attr.i[0] is the number of the called function, which must already
 * exist; attr.i[1] is the number of the output that is the result. The inputs are the inputs of the called
 * function. In a plan, attr.pointer is the plan of the called function. */
#ifndef LG_PROGRAM_CALL_H
#define LG_PROGRAM_CALL_H

#include "autodiff/program/program.h"

extern const lg_op lg_op_call;

static inline bool lg_is_call(const lg_op *op) {
    return op != NULL && op->calls;
}

static inline uint32_t lg_called(const lg_program_node *call) {
    return (uint32_t)call->i[0].base;
}

static inline uint32_t lg_called_output(const lg_program_node *call) {
    return (uint32_t)call->i[1].base;
}

/* Node `result` is output number `output` of function number `function`, applied to the nodes `input`. */
typedef struct lg_call_mark {
    uint32_t result, function, output;
    uint32_t input[LG_MAX_INPUTS];
} lg_call_mark;

/* The calls of one recording; during the recording, lg_tape.calls points to it. */
typedef struct lg_calls {
    const lg_program *program;
    const lg_var *parameters;
    lg_call_mark *mark;
    size_t count, capacity;
} lg_calls;

void lg_calls_destroy(lg_calls *calls);
/* The call that has this node as its result, or NULL. */
const lg_call_mark *lg_calls_find(const lg_calls *calls, uint32_t node);

#endif
