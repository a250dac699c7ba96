/* Calls from CasADi. Columns of a matrix stand one behind the other there; here rows do. */

#ifndef casadi_real
#define casadi_real double
#endif
#ifndef casadi_int
#define casadi_int long long int
#endif

/* An argument or result as CasADi sees it. */
typedef struct slot {
    const char *name;
    const casadi_int *sparsity; /* {rows, columns, 1}: dense; otherwise compressed columns */
    int port;                   /* of the function below, -1: none, for which nothing is read or written */
    const int *nonzeros;        /* their places in the port; NULL: all, column by column */
    int count;                  /* nonzeros */
} slot;

typedef struct function {
    void (*call)(const casadi_real *const *x, casadi_real *const *y, casadi_real *work);
    const slot *in, *out;
    int ins, outs;
    int work; /* of the call, and room for the results that are not vectors */
} function;

static int is_vector(const slot *s) {
    return s->nonzeros == NULL && (s->sparsity[0] == 1 || s->sparsity[1] == 1);
}

static int length_of(const slot *s) {
    return (int)(s->sparsity[0] * s->sparsity[1]);
}

/* From rows to the nonzeros in the order of columns. */
static void put(const slot *s, const casadi_real *from, casadi_real *to) {
    const int rows = (int)s->sparsity[0], columns = (int)s->sparsity[1];
    int i, r, c;
    if (s->nonzeros != NULL) {
        for (i = 0; i < s->count; i++) to[i] = from[s->nonzeros[i]];
        return;
    }
    for (c = 0, i = 0; c < columns; c++)
        for (r = 0; r < rows; r++) to[i++] = from[r * columns + c];
}

static int run(const function *f, const casadi_real **arg, casadi_real **res, casadi_real *work) {
    const casadi_real *x[MOST_INPUTS];
    casadi_real *y[MOST_OUTPUTS], *room = work + f->work;
    int i;
    for (i = 0; i < f->ins; i++)
        if (f->in[i].port >= 0) x[f->in[i].port] = arg[i] != NULL ? arg[i] : zeros;
    for (i = 0; i < f->outs; i++) {
        const slot *s = &f->out[i];
        if (s->port < 0) continue;
        y[s->port] = res[i];
        if (res[i] == NULL || is_vector(s)) continue;
        room -= length_of(s);
        y[s->port] = room;
    }
    f->call(x, y, work);
    for (i = 0; i < f->outs; i++) {
        const slot *s = &f->out[i];
        if (s->port >= 0 && res[i] != NULL && !is_vector(s)) put(s, y[s->port], res[i]);
    }
    return 0;
}

static int sizes_of(const function *f, casadi_int *arg, casadi_int *res, casadi_int *iw, casadi_int *w) {
    if (arg != NULL) *arg = f->ins;
    if (res != NULL) *res = f->outs;
    if (iw != NULL) *iw = 0;
    if (w != NULL) *w = f->work;
    return 0;
}

static const slot *slot_at(const slot *slots, int count, casadi_int i) {
    static const slot none = {NULL, NULL, 0, NULL, 0};
    return i >= 0 && i < count ? &slots[i] : &none;
}

/* The prototype of a function, then the beginning of its definition. */
#define DEFINED(...)                                                                                         \
    __VA_ARGS__;                                                                                             \
    __VA_ARGS__

/* The symbols of a function. It keeps no state, so every thread may use memory 0. */
#define EXTERNAL(symbol, f)                                                                                  \
    DEFINED(int symbol(const casadi_real **arg, casadi_real **res, casadi_int *iw, casadi_real *w, int m)) { \
        (void)iw;                                                                                            \
        (void)m;                                                                                             \
        return run(&(f), arg, res, w);                                                                       \
    }                                                                                                        \
    DEFINED(casadi_int symbol##_n_in(void)) {                                                                \
        return (f).ins;                                                                                      \
    }                                                                                                        \
    DEFINED(casadi_int symbol##_n_out(void)) {                                                               \
        return (f).outs;                                                                                     \
    }                                                                                                        \
    DEFINED(const char *symbol##_name_in(casadi_int i)) {                                                    \
        return slot_at((f).in, (f).ins, i)->name;                                                            \
    }                                                                                                        \
    DEFINED(const char *symbol##_name_out(casadi_int i)) {                                                   \
        return slot_at((f).out, (f).outs, i)->name;                                                          \
    }                                                                                                        \
    DEFINED(const casadi_int *symbol##_sparsity_in(casadi_int i)) {                                          \
        return slot_at((f).in, (f).ins, i)->sparsity;                                                        \
    }                                                                                                        \
    DEFINED(const casadi_int *symbol##_sparsity_out(casadi_int i)) {                                         \
        return slot_at((f).out, (f).outs, i)->sparsity;                                                      \
    }                                                                                                        \
    DEFINED(int symbol##_work(casadi_int *arg, casadi_int *res, casadi_int *iw, casadi_int *w)) {            \
        return sizes_of(&(f), arg, res, iw, w);                                                              \
    }                                                                                                        \
    DEFINED(int symbol##_checkout(void)) {                                                                   \
        return 0;                                                                                            \
    }                                                                                                        \
    DEFINED(void symbol##_release(int m)) {                                                                  \
        (void)m;                                                                                             \
    }                                                                                                        \
    DEFINED(void symbol##_incref(void)) {                                                                    \
    }                                                                                                        \
    DEFINED(void symbol##_decref(void)) {                                                                    \
    }
