/* Stand-in for MATLAB's header. It has the names that Simulink's documentation gives for level-2 C MEX
 * S-functions, enough to compile an S-function and run its callbacks once. */
#ifndef SIMSTRUC_H
#define SIMSTRUC_H

#include <stdlib.h>
#include <string.h>

typedef double real_T;
typedef int int_T;
typedef const real_T *const *InputRealPtrsType;

enum { STAND_IN_PORTS = 16, STAND_IN_NUMBERS = 4096 };
typedef struct SimStruct {
    int states, inputs, outputs, in_width[STAND_IN_PORTS], out_width[STAND_IN_PORTS], work;
    real_T x[STAND_IN_NUMBERS], dx[STAND_IN_NUMBERS], out[STAND_IN_PORTS][STAND_IN_NUMBERS], *rwork;
    const real_T *in[STAND_IN_PORTS][STAND_IN_NUMBERS];
} SimStruct;

#define CONTINUOUS_SAMPLE_TIME        0.0
#define INHERITED_SAMPLE_TIME         (-1.0)
#define SS_OPTION_EXCEPTION_FREE_CODE 1

#define ssSetNumSFcnParams(S, n)                  ((void)(S), (void)(n))
#define ssGetNumSFcnParams(S)                     0
#define ssGetSFcnParamsCount(S)                   0
#define ssSetNumContStates(S, n)                  ((S)->states = (n))
#define ssSetNumDiscStates(S, n)                  ((void)(S), (void)(n))
#define ssSetNumInputPorts(S, n)                  (((S)->inputs = (n)), 1)
#define ssSetInputPortWidth(S, k, n)              ((S)->in_width[k] = (n))
#define ssSetInputPortDirectFeedThrough(S, k, on) ((void)(S), (void)(k), (void)(on))
#define ssSetNumOutputPorts(S, n)                 (((S)->outputs = (n)), 1)
#define ssSetOutputPortWidth(S, k, n)             ((S)->out_width[k] = (n))
#define ssSetNumSampleTimes(S, n)                 ((void)(S), (void)(n))
#define ssSetNumRWork(S, n)                       ((S)->work = (n))
#define ssSetOptions(S, o)                        ((void)(S), (void)(o))
#define ssSetSampleTime(S, k, t)                  ((void)(S), (void)(k), (void)(t))
#define ssSetOffsetTime(S, k, t)                  ((void)(S), (void)(k), (void)(t))
#define ssGetContStates(S)                        ((S)->x)
#define ssGetdX(S)                                ((S)->dx)
#define ssGetRWork(S)                             ((S)->rwork)
#define ssGetInputPortRealSignalPtrs(S, k)        ((InputRealPtrsType)(S)->in[k])
#define ssGetOutputPortRealSignal(S, k)           ((S)->out[k])

#endif
