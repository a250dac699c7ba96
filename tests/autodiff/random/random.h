/* Random recordings: what tests/autodiff/random shares. main.c says what is done with them. */
#ifndef LG_RANDOM_H
#define LG_RANDOM_H

#include "autodiff/ops/op_table.h"
#include "autodiff/program/program.h"
#include "liegrad/random.h"

enum {
    MOST_OPERANDS = 6,
    MOST_INPUTS = 3,
    MOST_OUTPUTS = 6,
    MOST_STEPS = 14,
    MOST_FUNCTIONS = 2, /* of a recording as it is drawn */
    MOST_ALL = 8,       /* with its loops and derivatives */
    PARAMETERS = 2
};

static inline bool chance(lg_rng *rng, double p) {
    return lg_rng_uniform(rng) < p;
}

/* Ends the program: this is not a finding. */
void stop(const char *format, ...) __attribute__((format(printf, 1, 2), noreturn));
void *room(size_t count, size_t size); /* zeroed */

/* ---- pieces: operations as the registry of gradient checks records them, and their derivatives ---- */

typedef struct piece {
    const lg_op *op;
    lg_attr attr; /* owns its payload */
    uint32_t inputs;
    lg_shape in[MOST_OPERANDS], out;
    double *point[MOST_OPERANDS]; /* numbers of the inputs that the operation can take */
    bool any_shape; /* elementwise, and the inputs have the output's shape: which one does not matter */
    bool batches;   /* the first axis of the output and of the inputs `batched` may be the rows */
    bool batched[MOST_OPERANDS];
} piece;

/* For each row of the table of operations that can be in a program at least one. */
void find_pieces(void);
size_t rows_with_pieces(void);
const piece *draw_piece(lg_rng *rng);
const piece *draw_layer_end(lg_rng *rng); /* an operation that a plan may fuse with a product before it */
const piece *piece_named(const char *operation);

/* ---- recordings ---- */

/* A variable of a recording: (B, shape...) if it is batched, else `shape`. */
typedef struct slot {
    bool batched;
    lg_shape shape;
} slot;

/* An operation of the recording, or a call: output `output` of function `callee`, or of the loop over it.
 * Operands are slots before the step, brought to the shape that the operation takes. */
typedef struct step {
    const piece *piece; /* NULL: a call */
    uint32_t callee, output;
    bool loop;
    uint32_t inputs, operand[MOST_OPERANDS], how[MOST_OPERANDS]; /* slots; how they come to the shape */
    uint32_t variant;                                            /* the first number of the piece's payload */
    bool anchored; /* operands are the piece's point, and the slots move it a little */
    bool left_out; /* by shrinking: who takes it takes its first operand */
    slot made;
} step;

/* Slots are the parameters, the inputs, then the steps. */
typedef struct body {
    uint32_t inputs, steps, outputs;
    slot input[MOST_INPUTS];
    step step[MOST_STEPS];
    uint32_t output[MOST_OUTPUTS]; /* slots */
    bool apart;                    /* nothing is taken from one row to another */
    /* A loop over the function: input i becomes output carry[i] - 1, 0: it stays. times 0: there is none. */
    uint32_t times, carry[MOST_INPUTS];
} body;

/* A derivative of function `of` of the program, counted within the recording. */
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

/* Recording `number` is the same whenever it is drawn. */
void draw_recording(uint64_t number, recording *out);
void print_recording(const recording *r);
/* A program with the parameters of all recordings. */
lg_program *empty_program(void);
/* Adds the functions of the recording; their numbers. What a program refuses is left out. False: a
 * sentence in `error`. */
bool add_recording(lg_program *program, const recording *r, size_t *number, size_t *count, lg_error *error);
/* How many numbers the tape has of a function. */
size_t numbers_of(const lg_program *program, size_t at, size_t rows);
/* Leaves out whatever does not change that `fails` says true. */
void shrink(recording *r, bool (*fails)(void *user, const recording *r), void *user);
/* How often each row of the table was recorded for a program, by its place. */
extern size_t operations_recorded[LG_OPS_MOST];

/* ---- what the tape says, and how far rounding may lead from it ---- */

typedef struct truth {
    lg_tape *tape;
    size_t inputs, outputs, rows;
    lg_var in[LG_PROGRAM_MAX_PORTS], out[LG_PROGRAM_MAX_PORTS];
    size_t in_count[LG_PROGRAM_MAX_PORTS], out_count[LG_PROGRAM_MAX_PORTS];
    bool finite; /* all numbers on the tape are, and none is very large */
    uint64_t seed;
} truth;

/* Evaluates the function at random numbers, which are single numbers. */
void find_truth(lg_tape *tape, const lg_program *program, size_t function, size_t rows, lg_rng *rng,
                truth *out);
/* Whether `got`, of type `dtype`, is output j to what rounding explains; else a sentence. */
bool explained(const truth *t, size_t j, lg_dtype dtype, const void *got, char *sentence, size_t room);

/* ---- checks; false: the sentence says what differs ---- */

typedef struct finding {
    bool refused; /* the program, a plan or the C compiler refuses the recording; else numbers differ */
    char sentence[512];
} finding;
bool found(finding *out, bool refused, const char *format, ...)
    __attribute__((format(printf, 3, 4))); /* false */

typedef struct tally {
    size_t recordings, functions, derivatives, loops, plans, unfit, sources;
    size_t bytes, operations; /* of packed functions */
    size_t steps[8];          /* of plans, by kind */
} tally;
extern tally counted;

bool check_plans(const recording *r, finding *out);
/* Compiles *taken recordings as one file, or as many of them as a program has room for. *failed: the
 * recording that differs. */
bool check_compiled(const recording *r, size_t *taken, finding *out, size_t *failed);

#endif
