/* One interface to FMUs of both versions. */
#ifndef LG_EXPORTS_FMU_H
#define LG_EXPORTS_FMU_H

#include "apps/random/exports.h"

enum { VARIABLES = 48, REFERENCES = 4096 };

/* A variable of the program has `count` numbers, from place `at` on in the arrays below. `reference` is the
 * value reference of the variable; in version 2, of its first number. */
typedef struct variable {
    char name[80];
    unsigned reference;
    size_t count, at;
    bool known; /* state, input or parameter */
} variable;

/* Functions of the same type in both versions: member, name in version 2, name in version 3, parameters. */
#define SAME_FUNCTIONS(ROW)                                                                                  \
    ROW(leave, "ExitInitializationMode", "ExitInitializationMode", (void *))                                 \
    ROW(terminate, "Terminate", "Terminate", (void *))                                                       \
    ROW(reset, "Reset", "Reset", (void *))                                                                   \
    ROW(enter_event, "EnterEventMode", "EnterEventMode", (void *))                                           \
    ROW(enter_continuous, "EnterContinuousTimeMode", "EnterContinuousTimeMode", (void *))                    \
    ROW(set_time, "SetTime", "SetTime", (void *, double))                                                    \
    ROW(set_states, "SetContinuousStates", "SetContinuousStates", (void *, const double *, size_t))          \
    ROW(get_states, "GetContinuousStates", "GetContinuousStates", (void *, double *, size_t))                \
    ROW(get_rates, "GetDerivatives", "GetContinuousStateDerivatives", (void *, double *, size_t))            \
    ROW(get_nominals, "GetNominalsOfContinuousStates", "GetNominalsOfContinuousStates",                      \
        (void *, double *, size_t))                                                                          \
    ROW(keep, "GetFMUstate", "GetFMUState", (void *, void **))                                               \
    ROW(put_back, "SetFMUstate", "SetFMUState", (void *, void *))                                            \
    ROW(drop, "FreeFMUstate", "FreeFMUState", (void *, void **))                                             \
    ROW(size_of, "SerializedFMUstateSize", "SerializedFMUStateSize", (void *, void *, size_t *))             \
    ROW(write, "SerializeFMUstate", "SerializeFMUState", (void *, void *, char *, size_t))                   \
    ROW(read, "DeSerializeFMUstate", "DeserializeFMUState", (void *, const char *, size_t, void **))

typedef struct fmu {
    const model *m;
    int version;
    char token[64], *description; /* modelDescription.xml */
    variable variables[VARIABLES];
    size_t count;          /* variables */
    size_t numbers;        /* of all variables */
    size_t states;         /* numbers of the first variable if it is a state, otherwise 0 */
    bool forward, adjoint; /* what the description says that there is */
#define MEMBER(member, two, three, parameters) int(*member) parameters;
    SAME_FUNCTIONS(MEMBER)
#undef MEMBER
} fmu;

/* Functions with other types in each version. Their results are the FMU's statuses, 0: OK, 3: error.
 * `set` chooses variables, as bits of their numbers; numbers lie at their places in arrays of f->numbers. */
void *fmu_instantiate(const fmu *f, bool exchange);
void fmu_free(const fmu *f, void *c);
int fmu_begin(const fmu *f, void *c, double time); /* enters the initialization */
int fmu_get(const fmu *f, void *c, uint64_t set, double *numbers);
int fmu_set(const fmu *f, void *c, uint64_t set, const double *numbers);
int fmu_forward(const fmu *f, void *c, uint64_t unknown, uint64_t known, const double *seed, double *out);
int fmu_adjoint(const fmu *f, void *c, uint64_t unknown, uint64_t known, const double *seed, double *out);
int fmu_step(const fmu *f, void *c, double now, double length);
int fmu_discrete(const fmu *f, void *c);  /* finds the discrete states of an event */
int fmu_completed(const fmu *f, void *c); /* an integrator's step is completed */
/* Calls the function that reads or writes numbers, with wrong arguments, and returns its status. The
 * reference is that of variable `reference`, or belongs to no variable if `reference` is SIZE_MAX. With
 * `none` the array is NULL. */
int fmu_raw(const fmu *f, void *c, bool writes, size_t reference, bool none);
uint64_t fmu_all(const fmu *f, bool known); /* all known variables, or all results */

/* Calls an instance in random order, right and wrong, in several threads and alone (calls.c). */
bool check_calls(const fmu *f, finding *out);

#endif
