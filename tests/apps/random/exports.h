/* Random recordings as exports: what the files of tests/apps/random share. main.c describes the program. */
#ifndef LG_EXPORTS_H
#define LG_EXPORTS_H

#include "autodiff/random/random.h"

enum { FOLDER = 96, NAME = 32 };

/* A recording as a program, and the export of one of its functions. */
typedef struct model {
    const recording *r;
    lg_program *program;
    char name[NAME];     /* of the export */
    char folder[FOLDER]; /* holds model.h5, and the export in `out` */
    char function[NAME]; /* the exported function: one as drawn, a loop, or "value", which calls it */
    char warnings[4096]; /* standard error of lg-export */
    void *library;       /* of the targets that build one */
    /* ---- of FMUs ---- */
    bool rate, step; /* the program has functions of these names, with the inputs of the first function */
} model;

/* A target of lg-export. */
typedef struct target {
    const char *name;
    bool blocks;       /* most programs get the functions "rate" and "step" */
    const char *built; /* file that make builds, %s is the export's name; NULL: none */
    /* Compares the export with the program. Returns false with a message about the difference. */
    bool (*check)(model *m, finding *f);
} target;
extern const target target_c, target_casadi, target_fmu2, target_fmu3, target_onnx;

/* What the checks have counted. */
typedef struct export_tally {
    size_t exported, refused, different;
    size_t functions,
        unfit; /* functions compared; functions not compared, because numbers are not finite or very large */
    size_t calls, illegal, states; /* of FMUs: calls, calls that had to be refused, states put back */
    size_t peers;                  /* questions to tools */
} export_tally;
extern export_tally tallied;

/* ---- models (model.c) ---- */

/* Draws a recording and makes its program. Four of five programs have the function "value". With `blocks`,
 * most programs also have the functions "rate" and "step". */
void open_model(uint64_t number, bool blocks, recording *r, model *out);
void close_model(model *m);
/* Runs lg-export, and builds what the target needs. Returns false if lg-export refuses the program, with its
 * sentence in *f and f->refused, or if something fails. */
bool export_model(model *m, const target *t, finding *f);
/* Adds the function "advanced" to the program: the reference for a step of co-simulation. It has the inputs
 * of the rate and takes `count` steps of length h by the program's function "step" or by the classical
 * Runge-Kutta scheme. */
size_t add_advanced(model *m, uint32_t count, double h);
/* Number of the program's function, or SIZE_MAX. */
size_t function_named(const model *m, const char *name);
/* Adds the derivative under its usual name (PREFIX + function). Returns its number, or SIZE_MAX if there
 * is no such derivative. */
size_t derivative_of(model *m, lg_derivative_kind kind, const char *function);
/* Number of the port of this name, or SIZE_MAX. */
size_t port_named(const lg_port *ports, size_t count, const char *name);
const double *input_of(const truth *t, size_t i);
/* Address of a symbol of the model's library, or NULL. */
void *symbol_in(const model *m, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* ---- reasons why lg-export refuses programs, or leaves derivatives out (reasons.c) ---- */

void add_reason(const char *from, const char *sentence);
void print_reasons(void);

/* ---- the tools that read exports (peers.c, peers.py) ---- */

typedef enum peer { PEER_ONNX, PEER_FMU, PEERS } peer;
/* Lets a tool check the export; `answer` gets what the tool says. If the tool is missing, says so once and
 * returns false. */
bool ask_peer(peer which, const model *m, size_t rows, char *answer, size_t size);
/* Makes a file of the export by its Makefile, %s is the export's name. */
bool make_file(const model *m, const char *format, finding *f);

#endif
