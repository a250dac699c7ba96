/* Stand-in for the file that MATLAB includes at the end of an S-function. Runs the callbacks once for the
 * state x and the input ports u, one behind the other; `first` gets the first output port, `rate` the
 * derivatives. */
void stand_in_run(const real_T *x, const real_T *u, real_T *first, real_T *rate);
void stand_in_run(const real_T *x, const real_T *u, real_T *first, real_T *rate) {
    SimStruct *S = (SimStruct *)calloc(1, sizeof *S);
    int p, k;
    mdlInitializeSizes(S);
    mdlInitializeSampleTimes(S);
    S->rwork = (real_T *)calloc((size_t)S->work, sizeof(real_T));
#if HAS_STATES
    mdlInitializeConditions(S);
#endif
    memcpy(S->x, x, (size_t)S->states * sizeof *x);
    for (p = 0; p < S->inputs; p++)
        for (k = 0; k < S->in_width[p]; k++) S->in[p][k] = u++;
    mdlOutputs(S, 0);
#if HAS_STATES
    mdlDerivatives(S);
#endif
    memcpy(first, S->out[0], (size_t)S->out_width[0] * sizeof *x);
    memcpy(rate, S->dx, (size_t)S->states * sizeof *x);
    mdlTerminate(S);
    free(S->rwork);
    free(S);
}
