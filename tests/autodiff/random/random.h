/* Random recordings: what the files of tests/autodiff/random share. main.c describes the program. */
#ifndef LG_RANDOM_H
#define LG_RANDOM_H

#include "autodiff/ops/op_table.h"
#include "autodiff/program/program.h"
#include "liegrad/core.h"

enum {
    MOST_OPERANDS = 6,
    MOST_INPUTS = 3,
    MOST_OUTPUTS = 6,
    MOST_STEPS = 14,
    MOST_FUNCTIONS = 2, /* functions of a recording as drawn */
    MOST_ALL = 8,       /* functions including loops and derivatives */
    PARAMETERS = 2
};

static inline bool chance(lg_rng *rng, double p) {
    return lg_rng_uniform(rng) < p;
}

/* Prints a message and ends the program, for errors that are not findings. */
void stop(const char *format, ...) __attribute__((format(printf, 1, 2), noreturn));
void *room(size_t count, size_t size); /* zeroed */
/* From here on, a crash prints the number of the recording. `argv` (may be NULL): so does undefined
 * behaviour of checked C, for which the program is started again in another environment. */
void tell_crashes(char **argv);
extern volatile uint64_t looked_at; /* number of the current recording */

/* ---- pieces: operations from the cases of the gradient check and from their derivatives ---- */

typedef struct piece {
    const lg_op *op;
    lg_attr attr; /* owns its payload */
    uint32_t inputs;
    lg_shape in[MOST_OPERANDS], out;
    double *point[MOST_OPERANDS]; /* valid values of the inputs */
    bool any_shape; /* the operation is elementwise: its inputs can have any shape that equals the output's */
    bool batches;   /* the first axis of the output and of the inputs `batched` can be the rows */
    bool batched[MOST_OPERANDS];
} piece;

/* Finds at least one piece for each operation that a program can have. */
void find_pieces(void);
size_t rows_with_pieces(void);
const piece *draw_piece(lg_rng *rng);
const piece *draw_layer_end(lg_rng *rng); /* an operation that a plan can fuse with the product before it */
const piece *piece_named(const char *operation);

/* ---- recordings ---- */

/* A variable of a recording: of shape (B, shape...) if batched, else of shape `shape`. */
typedef struct slot {
    bool batched;
    lg_shape shape;
} slot;

/* An operation of the recording, or a call: output `output` of function `callee`, or of the loop over it. The
 * operands are earlier slots, converted to the shapes that the operation takes. */
typedef struct step {
    const piece *piece; /* NULL: a call */
    uint32_t callee, output;
    bool loop;
    /* slots; how each is converted to the shape */
    uint32_t inputs, operand[MOST_OPERANDS], how[MOST_OPERANDS];
    uint32_t variant; /* first index into the piece's payload */
    bool anchored;    /* the operands are the piece's valid values, and the slots change them only a little */
    bool left_out;    /* left out by shrinking: its users take its first operand instead */
    slot made;
} step;

/* One function. Its slots are the parameters, the inputs and the steps, in this order. */
typedef struct body {
    uint32_t inputs, steps, outputs;
    slot input[MOST_INPUTS];
    step step[MOST_STEPS];
    uint32_t output[MOST_OUTPUTS]; /* slots */
    bool apart;                    /* rows do not affect each other */
    /* A loop over the function: after each round input i becomes output carry[i] - 1; carry[i] 0: it keeps
     * its value. times 0: there is no loop. */
    uint32_t times, carry[MOST_INPUTS];
} body;

/* A derivative of function `of`, which is a number within the recording. */
typedef struct derivation {
    uint32_t of;
    lg_derivative_kind kind;
} derivation;

typedef struct recording {
    uint64_t number;
    uint32_t functions, derivations, rows;
    body function[MOST_FUNCTIONS];
    derivation derivation[MOST_ALL];
} recording;

/* Recording `number` is the same each time it is drawn. */
void draw_recording(uint64_t number, recording *out);
void print_recording(const recording *r);
/* A program with the parameters that all recordings use. */
lg_program *empty_program(void);
/* Adds the functions of the recording. `number` gets their function numbers, `count` how many there are.
 * Functions that a program refuses are left out. Returns false with a message in `error`. */
bool add_recording(lg_program *program, const recording *r, size_t *number, size_t *count, lg_error *error);
/* Number of elements that the tape holds for a function. */
size_t numbers_of(const lg_program *program, size_t at, size_t rows);
/* Leaves out every part without which fails() still returns true. */
void shrink(recording *r, bool (*fails)(void *user, const recording *r), void *user);
/* How often each operation of the table was recorded, by its place in the table. */
extern size_t operations_recorded[LG_OPS_MOST];

/* ---- the tape's results, and how much rounding may change them ---- */

typedef struct truth {
    lg_tape *tape;
    size_t inputs, outputs, rows;
    lg_var in[LG_PROGRAM_MAX_PORTS], out[LG_PROGRAM_MAX_PORTS];
    size_t in_count[LG_PROGRAM_MAX_PORTS], out_count[LG_PROGRAM_MAX_PORTS];
    bool finite; /* all numbers on the tape are finite and not very large */
    uint64_t seed;
} truth;

/* Evaluates the function on the tape at random numbers that a float represents exactly. */
void find_truth(lg_tape *tape, const lg_program *program, size_t function, size_t rows, lg_rng *rng,
                truth *out);
/* Whether `got`, of type `dtype`, differs from output j no more than rounding explains; otherwise false with
 * a message. */
bool explained(const truth *t, size_t j, lg_dtype dtype, const void *got, char *sentence, size_t room);

/* ---- checks; they return false with a message about the difference ---- */

typedef struct finding {
    /* true: the program, a plan or the C compiler refuses the recording; false: numbers differ */
    bool refused;
    char sentence[512];
} finding;
bool found(finding *out, bool refused, const char *format, ...)
    __attribute__((format(printf, 3, 4))); /* always returns false */

typedef struct tally {
    size_t recordings, functions, derivatives, loops, plans, repeated, unfit, sources, refused;
    size_t bytes, operations; /* of stored functions */
    size_t steps[8];          /* steps of plans, by kind */
} tally;
extern tally counted;

bool check_plans(const recording *r, finding *out);
/* Compiles *taken recordings as one file, or as many of them as fit into a program; *taken becomes their
 * number. *failed gets the recording that differs. */
extern bool compiled_checked; /* the C is compiled with gcc's checks of undefined behaviour */
bool check_compiled(const recording *r, size_t *taken, finding *out, size_t *failed);

#endif
