/* Faces: pieces of exported C that stand around functions of a model's program, such as NAME_field and
 * NAME_step. A model has every face whose functions its program has, whatever the model's kind. Each face is
 * a row of a table. A row of export_kind adds what is known about one kind of model: how golden inputs are
 * drawn, and what the model's numbers mean. */
#ifndef LG_EXPORT_FACES_H
#define LG_EXPORT_FACES_H

#include "lg-export/window.h"
#include "liegrad/model.h"

typedef struct export_kind export_kind;
typedef struct export_face export_face;
enum { EXPORT_MOST_FACES = 9, EXPORT_MOST_FUNCTIONS = 3 };

/* A model while its C is written. */
typedef struct export_model {
    const app *self;
    const lg_model_file *file;
    const export_kind *kind; /* Never NULL. */
    lg_program *program;
    const lg_space *space; /* Space of the states; NULL: the model does not move. */
    export_source *source;
    /* Numbers of a state, of an element of the algebra (the field), of an input, and of the tangent space's
     * coordinates; 0: the model does not move. */
    size_t dim, algebra, forces, tangent;
    size_t positions, velocities;  /* Numbers of positions and velocities in a log; 0: none. */
    export_window window;          /* classes is 0 if the model has no classes. */
    export_evaluation probability; /* Plan of the probabilities of the classes. */
    double *scores;                /* Of golden vectors: probabilities and class, (count, classes + 1). */
    const export_face *faces[EXPORT_MOST_FACES]; /* In the order of the table. */
    size_t face_count;
    export_function functions[EXPORT_MOST_FACES * EXPORT_MOST_FUNCTIONS];
    size_t count;
    lg_rng rng;    /* For golden vectors. */
    double *input; /* The input of all golden steps: `forces` numbers, allocated for at least one. */
    double h;      /* The step size of all golden steps. */
    void *work;    /* lg_model_work_size bytes. */
} export_model;

/* A face: the functions of the program that it needs, with their names in C; what else it requires; and what
 * it adds. All members but `functions` and `fits` may be missing. */
struct export_face {
    struct {
        const char *function, *name;
        bool hidden; /* Static: only fragments call it. */
    } functions[EXPORT_MOST_FUNCTIONS];
    bool (*fits)(const export_model *m);
    void (*code)(export_model *m); /* Adds fragments, constants, sizes, declarations. */
    /* Adds further results to the golden vectors, and the code that computes them to the self-test. */
    lg_status (*golden)(export_model *m);
    /* The fragments' stack frames: their bytes (gcc and clang, -O0 to -O3) and their number. */
    size_t stack, calls;
};

/* What is known about one kind of model; every member but `tell` may be missing. */
struct export_kind {
    const lg_recipe *recipe; /* NULL in the row for all other kinds. */
    uint64_t stream;         /* Stream of the random numbers that golden vectors are drawn from. */
    /* Describes the state, the input and the range of the data in words, and sets the data's dt; used for
     * every target. */
    void (*words)(const void *contents, export_source *source);
    /* Refuses a model that cannot be exported, and adds sizes of its kind. */
    void (*begin)(export_model *m);
    /* Draws input x of golden vector `v`. NULL: a random start on the space, or numbers within the ranges of
     * the program's ports. */
    void (*draw)(export_model *m, double *x, size_t v);
    double (*draw_input)(export_model *m, size_t k); /* Draws number k of the input of golden steps. */
    /* Called when value, gradient and classes of golden vector `v` are computed. Returns false if the vector
     * has to be drawn again because rounding could change these results. */
    bool (*is_smooth)(export_model *m, size_t v);
    /* Whether the gradient of these contents jumps somewhere. NULL: it does not. */
    bool (*kinks)(const void *contents);
    size_t (*depth)(const void *contents); /* NULL: the depth of the written functions. */
    /* Fills in the names of the classes and the shape of the window. NULL: the classes have no names. */
    void (*window)(const void *contents, export_window *out);
    const char *hidden;            /* A function of a face that is static for this kind; NULL: none. */
    void (*tell)(export_model *m); /* Adds lines to source->about. */
};
/* The lists of all faces and kinds. A new one needs its name here and its row in a file of its own. Faces are
 * written in this order; the row `other` serves all kinds that have no row. */
#define EXPORT_FACE_LIST(ROW)                                                                                \
    ROW(value)                                                                                               \
    ROW(motion) ROW(states) ROW(linearise) ROW(features) ROW(classes) ROW(points) ROW(angle) ROW(nodes)
#define EXPORT_KIND_LIST(ROW)                                                                                \
    ROW(hamiltonian) ROW(machine) ROW(surrogate) ROW(table) ROW(detector) ROW(classifier) ROW(other)
#define EXPORT_FACE_ROW(name) extern const export_face export_face_##name;
EXPORT_FACE_LIST(EXPORT_FACE_ROW)
#define EXPORT_KIND_ROW(name) extern const export_kind export_kind_##name;
EXPORT_KIND_LIST(EXPORT_KIND_ROW)
const export_kind *export_kind_of(const lg_recipe *recipe);

/* Writes the C of a model that has at least one face, with golden vectors and a description. Sets *none if
 * the model has no face; nothing is written then. */
void export_faces(const app *self, const lg_model_file *file, export_source *source, bool *none);

/* ---- functions for rows of faces and kinds ---- */

void export_machine_words(const void *contents, export_source *source); /* In machine/machine_words.c. */
bool export_has(const export_model *m, const export_face *face);
/* Returns the reals of work memory of a function that belongs to the model's faces, 0 for any other
 * function. */
size_t export_work_of(const export_model *m, const char *function);
/* Turns `y` (dim numbers, all 0) into the state at rest: places 0, directions down, rotations the identity
 * (load.c). */
void export_rest(const lg_space *space, double *y);
/* Turns `x`, whose flat factors are set, into a random state: a random group element acts on the state at
 * rest (faces.c). */
void export_turn(export_model *m, double *x);
/* Adds a line such as "state (6)     q1 p1" to `about`: what (count), words. */
void export_tell_numbers(text *about, const char *what, size_t count, const char *words);
/* Adds what the file says about the model, its data, its training and its results, and the provenance
 * (facts.c). */
void export_tell_facts(const export_model *m);
/* Adds lines about the scheme, and about the condition if it exceeds 1 (motion.c). */
void export_tell_motion(const export_model *m);
/* Draws noise for a channel of a window x, rounded so that it is exact both in the exported type and in
 * float, the type of recorded windows. */
void export_draw_channel(export_model *m, double mean, double size, size_t channel, double *x);
/* Computes the scores of golden vector v. Returns false if rounding could change its class (window.c). */
bool export_draw_classes(export_model *m, size_t v);

#endif
