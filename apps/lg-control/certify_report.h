/* What lg-control certify reports about a proof (certify_report.c). */
#ifndef LG_APPS_CERTIFY_REPORT_H
#define LG_APPS_CERTIFY_REPORT_H

#include "lg-control/control_app.h"

enum { CONTROL_STATES = 2 * LG_POLICY_COORDINATES };

typedef struct control_naming {
    const lg_policy_task *task;
    const char *plant;   /* path of the task's plant; NULL: there is a trained policy, no task */
    size_t n, positions; /* numbers of z: positions that are not free, then velocities */
    const lg_policy_coordinate *of[CONTROL_STATES]; /* of each number */
} control_naming;

/* The name of state i. */
const char *control_name_of(control_naming names, size_t i);
control_naming control_name_states(const lg_policy_task *task);
/* Reads "NAME=number,...", numbers above 0, into out[i] of the states i that it names. Wrong texts end the
 * command. */
void control_read_states(const app *self, control_naming names, const char *option, const char *given,
                         double *out);

/* The result of a proof of any kind. */
typedef struct control_proof {
    lg_certify_result r; /* input_error: of held inputs; 0: not covered. The box is from the goal. */
    bool global, turns;  /* turns: by the energy of rotations */
    double margin;       /* of the energy; for rotations the angle */
    size_t sides;
    const double *P, *gains; /* (sides, sides); (inputs, sides); NULL: none, or gains that were not chosen */
} control_proof;

/* x rounded to 6 digits; a number of at most 6 digits that is not above x. */
double control_six_digits(double x);
double control_rounded_down(double x);
/* Prints and writes the results. Ends the command with exit code 1 if the proof failed. */
void control_tell_proof(app *self, control_naming names, const control_proof *v);
/* Returns the sentence of a proof: its subject, the sentence `proof` of the library, what it covers, and
 * `more`. continuous: the inputs follow the state at all times. chosen: the gains were chosen. rounded: the
 * proof covers the rounding of the controller. The caller frees the sentence with free. */
char *control_claim(const app *self, control_naming names, bool continuous, bool chosen, bool rounded,
                    const char *proof, const char *more);
/* The sentence that names the states of the box. Freed with free. */
char *control_box_of(control_naming names);

#endif
