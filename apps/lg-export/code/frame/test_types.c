/* Every output of every function is computed for every golden vector twice, in two work memories with
 * different contents, and once more where nobody wants the others: all must give the same bits. Its error is
 * |got - want| / max(|want|, root mean square of |want| over the vectors), in Euclidean norms. */

typedef struct result {
    const char *name;
    int number, at, size; /* which of several, or -1; where in a golden result; how many numbers */
} result;

typedef struct function {
    const char *name;
    void (*run)(const real *x, real *y, int only, real *work); /* only: one output, -1: all */
    const real *x, *y;                                         /* golden vectors */
    int inputs, outputs;
    double tolerance;
    const result *output; /* a row with name NULL ends them */
} function;
