/* The fragments of C that lg-export writes into an FMU, of version FUZZ_FMI (2 or 3), with a small model in
 * place of a program. */
#ifndef LG_FMU_MODEL_H
#define LG_FMU_MODEL_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define TOKEN "{fuzz}"

/* ---- the model: x' = (x2, u - k x1), y = x1 x2 ---- */

enum { STATES = 2, PORTS = 6, NUMBERS = 8, WORK = 1 };
enum { CAUSALITY_STATE, CAUSALITY_DERIVATIVE, CAUSALITY_INPUT, CAUSALITY_OUTPUT, CAUSALITY_PARAMETER };
static const struct {
    int at, count, causality;
} ports[PORTS] = {
    {0, 2, CAUSALITY_STATE},  {2, 2, CAUSALITY_DERIVATIVE}, {4, 1, CAUSALITY_INPUT},
    {5, 1, CAUSALITY_OUTPUT}, {6, 1, CAUSALITY_PARAMETER},  {7, 1, CAUSALITY_PARAMETER},
};
static const double start_values[NUMBERS] = {1, 0, 0, 0, 0, 0, 4, 0.25};

static void evaluate(const double *r, double *out, double *work) {
    out[2] = r[1];
    out[3] = r[4] - r[6] * r[0];
    out[5] = r[0] * r[1];
    work[0] = out[5];
}

static int forward(const double *r, const double *seed, double *out, double *work) {
    memcpy(out, seed, NUMBERS * sizeof *out);
    out[2] = seed[1];
    out[3] = seed[4] - seed[6] * r[0] - r[6] * seed[0];
    out[5] = seed[0] * r[1] + r[0] * seed[1];
    work[0] = 0;
    return 1;
}

#if FUZZ_FMI == 3
static int adjoint(const double *r, const double *seed, double *out, double *room, double *work) {
    memset(out, 0, NUMBERS * sizeof *out);
    out[0] = r[1] * seed[5] - r[6] * seed[3];
    out[1] = r[0] * seed[5] + seed[2];
    out[4] = seed[3];
    out[6] = -r[0] * seed[3];
    room[0] = work[0] = 0;
    return 1;
}
#endif

static void take_step(const double *r, double h, double *next, double *work) {
    next[0] = r[0] + h * r[1];
    next[1] = r[1] + h * (r[4] - r[6] * r[0]);
    work[0] = 0;
}

#define HAS_STATES 1
#include "../../apps/lg-export/code/fmu/fmu_core.c"
#if FUZZ_FMI == 2
#include "../../apps/lg-export/code/fmu/fmi2.c"
#else
#include "../../apps/lg-export/code/fmu/fmi3.c"
#endif
#include "../../apps/lg-export/code/fmu/fmu_calls.c"

#endif
