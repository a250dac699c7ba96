/* Stand-in for the file that MATLAB includes at the end of an S-function. Runs the callbacks once for the
 * state x and one input port u; `state` gets the first output port, `rate` the derivatives. */
void stand_in_run(const real_T *x, const real_T *u, real_T *state, real_T *rate);
void stand_in_run(const real_T *x, const real_T *u, real_T *state, real_T *rate) {
    SimStruct *S = (SimStruct *)calloc(1, sizeof *S);
    int k;
    mdlInitializeSizes(S);
    mdlInitializeSampleTimes(S);
    S->rwork = (real_T *)calloc((size_t)S->work, sizeof(real_T));
    mdlInitializeConditions(S);
    memcpy(S->x, x, (size_t)S->states * sizeof *x);
    for (k = 0; k < S->in_width[0]; k++) S->in[0][k] = u + k;
    mdlOutputs(S, 0);
    mdlDerivatives(S);
    memcpy(state, S->out[0], (size_t)S->states * sizeof *x);
    memcpy(rate, S->dx, (size_t)S->states * sizeof *x);
    mdlTerminate(S);
    free(S->rwork);
    free(S);
}
