/* Level-2 C MEX S-function. Input ports are the inputs in the order of the tables; output ports are the
 * state (where there is one), then the outputs. Continuous states; no parameters. The names of simstruc.h
 * are those of Simulink's documentation. */
#include "simstruc.h"

static int count_of(int causality) {
    int p, n = 0;
    for (p = 0; p < PORTS; p++) n += ports[p].causality == causality;
    return n;
}

/* Variable number n of a causality. */
static int find_port(int causality, int n) {
    int p = 0;
    while (ports[p].causality != causality || n-- > 0) p++;
    return p;
}

static void mdlInitializeSizes(SimStruct *S) {
    const int inputs = count_of(CAUSALITY_INPUT), outputs = count_of(CAUSALITY_OUTPUT), first = STATES > 0;
    int k;
    ssSetNumSFcnParams(S, 0);
    if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) return;
    ssSetNumContStates(S, STATES);
    ssSetNumDiscStates(S, 0);
    if (!ssSetNumInputPorts(S, inputs)) return;
    for (k = 0; k < inputs; k++) {
        ssSetInputPortWidth(S, k, ports[find_port(CAUSALITY_INPUT, k)].count);
        ssSetInputPortDirectFeedThrough(S, k, 1);
    }
    if (!ssSetNumOutputPorts(S, outputs + first)) return;
    if (first) ssSetOutputPortWidth(S, 0, STATES);
    for (k = 0; k < outputs; k++)
        ssSetOutputPortWidth(S, k + first, ports[find_port(CAUSALITY_OUTPUT, k)].count);
    ssSetNumSampleTimes(S, 1);
    ssSetNumRWork(S, NUMBERS + WORK);
    ssSetOptions(S, SS_OPTION_EXCEPTION_FREE_CODE);
}

static void mdlInitializeSampleTimes(SimStruct *S) {
    ssSetSampleTime(S, 0, STATES > 0 ? CONTINUOUS_SAMPLE_TIME : INHERITED_SAMPLE_TIME);
    ssSetOffsetTime(S, 0, 0.0);
}

#if HAS_STATES
#define MDL_INITIALIZE_CONDITIONS
static void mdlInitializeConditions(SimStruct *S) {
    memcpy(ssGetContStates(S), start_values, STATES * sizeof(real_T));
}
#endif

/* All values, with derivatives and outputs, in the block's memory. */
static real_T *values_of(SimStruct *S) {
    real_T *r = ssGetRWork(S);
    const int inputs = count_of(CAUSALITY_INPUT);
    int k, i;
    if (STATES > 0) memcpy(r, ssGetContStates(S), STATES * sizeof *r);
    for (k = 0; k < inputs; k++) {
        const int p = find_port(CAUSALITY_INPUT, k);
        InputRealPtrsType u = ssGetInputPortRealSignalPtrs(S, k);
        for (i = 0; i < ports[p].count; i++) r[ports[p].at + i] = *u[i];
    }
    evaluate(r, r, r + NUMBERS);
    return r;
}

static void mdlOutputs(SimStruct *S, int_T tid) {
    const real_T *r = values_of(S);
    const int outputs = count_of(CAUSALITY_OUTPUT), first = STATES > 0;
    int k;
    (void)tid;
    if (first) memcpy(ssGetOutputPortRealSignal(S, 0), r, STATES * sizeof *r);
    for (k = 0; k < outputs; k++) {
        const int p = find_port(CAUSALITY_OUTPUT, k);
        memcpy(ssGetOutputPortRealSignal(S, k + first), r + ports[p].at, (size_t)ports[p].count * sizeof *r);
    }
}

#if HAS_STATES
#define MDL_DERIVATIVES
static void mdlDerivatives(SimStruct *S) {
    memcpy(ssGetdX(S), values_of(S) + STATES, STATES * sizeof(real_T));
}
#endif

static void mdlTerminate(SimStruct *S) {
    (void)S;
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
