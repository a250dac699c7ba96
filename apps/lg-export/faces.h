/* Faces: the C of a model that stands around functions of its program. A model has the faces whose functions
 * its program has, whatever its kind: a face is a row. A row of export_kind says more about a known kind: how
 * golden inputs are drawn, and what its numbers are. */
#ifndef LG_EXPORT_FACES_H
#define LG_EXPORT_FACES_H

#include "lg-export/window.h"
#include "liegrad/random.h"

typedef struct export_kind export_kind;
typedef struct export_face export_face;
enum { EXPORT_MOST_FACES = 8, EXPORT_MOST_FUNCTIONS = 3 };

/* A model while its C is written. */
typedef struct export_model {
    const app *self;
    const lg_model_file *file;
    const export_kind *kind; /* never NULL */
    lg_program *program;
    const lg_space *space; /* of the states; NULL: the model does not move */
    export_source *source;
    size_t dim, algebra, forces,
        tangent;                   /* numbers of state, field, input, coordinates; 0: it does not move */
    size_t positions, velocities;  /* in a log; 0: none */
    export_window window;          /* classes 0: it has none */
    export_evaluation probability; /* of the classes */
    const export_face *faces[EXPORT_MOST_FACES]; /* in the table's order */
    size_t face_count;
    size_t extras; /* numbers of a golden extra */
    export_function functions[EXPORT_MOST_FACES * EXPORT_MOST_FUNCTIONS];
    size_t count;
    lg_rng rng;    /* of golden vectors */
    double *input; /* of all steps (forces), at least one number */
    double h;      /* of all steps */
    void *work;    /* lg_model_work_size bytes */
} export_model;

/* A face: functions of the program that it needs and their names in C, what else it needs, and what it adds.
 * All but `functions` and `fits` may be missing. */
struct export_face {
    struct {
        const char *function, *name;
        bool hidden; /* static: for the fragments */
    } functions[EXPORT_MOST_FUNCTIONS];
    bool (*fits)(const export_model *m);
    void (*code)(export_model *m);           /* fragments, constants, sizes, declarations */
    size_t (*extras)(const export_model *m); /* numbers in a golden extra */
    /* These numbers of golden vector v; false: it is drawn again. */
    bool (*draw)(export_model *m, size_t v, double *extra);
    /* These numbers of all vectors, from number `at` of each on, and the self-test's code. */
    lg_status (*golden)(export_model *m, size_t at);
    const char *extra_name; /* what the self-test calls them; of several faces the last one's */
    size_t stack, calls; /* bytes of the frames of the fragments, gcc and clang, -O0 to -O3, and how many */
};

/* What is known of a kind; every member may be missing. */
struct export_kind {
    const lg_recipe *recipe; /* NULL: any other kind */
    uint64_t stream;         /* of the random numbers of golden vectors */
    bool gradient;           /* an evaluation of the field is told as one of a network's gradient */
    /* What the numbers of state and input are, range and dt of the data, whatever the target. */
    void (*words)(const void *contents, export_source *source);
    /* Refuses a model that cannot be exported, gives sizes of its kind. Returns an exit code. */
    int (*begin)(export_model *m);
    /* Input x of golden vector `v`. NULL: a start on the space, or numbers that the program's ports allow. */
    void (*draw)(export_model *m, double *x, size_t v);
    double (*draw_input)(export_model *m, size_t k); /* number k of the input of steps */
    /* False: golden vector `v`, with value, gradient and classes, is drawn again. */
    bool (*is_smooth)(export_model *m, size_t v);
    size_t (*depth)(const void *contents); /* NULL: the functions' own */
    /* Sets source->condition. NULL: measured at the golden vectors. */
    lg_status (*condition)(export_model *m, lg_error *error);
    void (*window)(const void *contents, export_window *out); /* NULL: classes have no names */
    void (*tell)(export_model *m);                            /* lines for source->about */
};
/* The tables. A new row is a name here; the row stands in the file of the face or kind. Faces are written in
 * this order; `other` is the row of all kinds that have no row. */
#define EXPORT_FACE_LIST(ROW)                                                                                \
    ROW(value) ROW(motion) ROW(states) ROW(linearise) ROW(classes) ROW(points) ROW(angle) ROW(nodes)
#define EXPORT_KIND_LIST(ROW) ROW(hamiltonian) ROW(machine) ROW(surrogate) ROW(table) ROW(detector) ROW(other)
#define EXPORT_FACE_ROW(name) extern const export_face export_face_##name;
EXPORT_FACE_LIST(EXPORT_FACE_ROW)
#define EXPORT_KIND_ROW(name) extern const export_kind export_kind_##name;
EXPORT_KIND_LIST(EXPORT_KIND_ROW)
const export_kind *export_kind_of(const lg_recipe *recipe);

/* The C of a model with one face or more, golden vectors and words included. `none`: it has no face, and
 * nothing is written. Returns an exit code; on failure a message has been printed. */
int export_faces(const app *self, const lg_model_file *file, export_source *source, bool *none);

/* ---- for rows ---- */

void export_machine_words(const void *contents, export_source *source); /* (machine/machine_words.c) */
bool export_has(const export_model *m, const export_face *face);
/* Numbers of golden extra `v` from number `at` on. */
static inline double *export_extra(const export_model *m, size_t at, size_t v) {
    return m->source->golden.extra + v * m->source->golden.extras + at;
}
/* Reals of work of a function that the faces have, 0 of another one. */
size_t export_work_of(const export_model *m, const char *function);
/* A state (dim zeros) becomes the one at rest: places 0, directions down, rotations 1 (load.c). */
void export_rest(const lg_space *space, double *y);
/* For kinds whose condition is 1, or set before the code is written. */
lg_status export_keep_condition(export_model *m, lg_error *error);
/* "state (6)     words" */
void export_tell_numbers(text *about, const char *what, size_t count, const char *words);
/* The scheme, `what` a step evaluates, and what the condition is (motion.c). */
void export_tell_motion(const export_model *m, const char *what, const char *condition);

#endif
