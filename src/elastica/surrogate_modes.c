/* Modes of the discrete network: a fixed last layer, made of the leading singular vectors of the training
 * curves. */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "kernels/lapack.h"
#include "liegrad/ops.h"
#include "elastica/surrogate_internal.h"

size_t lg_surrogate_modes_size(const lg_surrogate *model) {
    const size_t modes = model->options.modes;
    return modes > 0 ? (modes + 1) * lg_surrogate_outputs(model) : 0;
}

lg_status lg_surrogate_check_modes(const lg_surrogate *model, lg_error *error) {
    if (model->options.modes == 0 || model->modes != NULL) return LG_OK;
    return lg_fail(error, LG_INVALID_ARGUMENT,
                   "a network of %u modes needs the numbers of the modes: call lg_surrogate_find_modes first",
                   model->options.modes);
}

/* ---- on a tape ---- */

lg_var lg_surrogate_sum_modes(lg_tape *tape, const lg_surrogate *model, lg_var c) {
    const uint32_t modes = model->options.modes, outputs = lg_surrogate_outputs(model);
    const lg_var mean = lg_input_f64(tape, lg_shape1(outputs), model->modes);
    const lg_var vectors = lg_input_f64(tape, lg_shape2(modes, outputs), model->modes + outputs);
    return lg_dense(tape, c, vectors, mean, LG_IDENTITY);
}

/* ---- curves as vectors ---- */

static lg_status check(const lg_surrogate *model, const lg_elastica_curves *curves, const uint32_t *training,
                       size_t count, lg_error *error) {
    if (model->options.modes == 0) return lg_fail(error, LG_INVALID_ARGUMENT, "the network has no modes");
    LG_TRY(lg_surrogate_check_curves(model, curves, error));
    for (size_t i = 0; i < count; i++)
        if (training[i] >= curves->count)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "there is no curve %u (counted from 0): there are %zu curves", training[i],
                           curves->count);
    return LG_OK;
}

/* Writes curve number `at` as a vector y (4(N - 1)): the inner nodes relative to q0, then the inner tangents,
 * on the network's side of the mirror. */
static void numbers_of(const lg_surrogate *model, const lg_elastica_curves *curves, size_t at, double *y) {
    const size_t inner = 2 * ((size_t)model->intervals - 1), stride = inner + 4;
    const double *x = curves->boundary + 8 * at, *q = curves->q + stride * at, *v = curves->v + stride * at;
    const double sign = lg_surrogate_sign(model, x);
    for (size_t i = 0; i < inner; i++) {
        const double side = i % 2 == 1 ? sign : 1.0;
        y[i] = side * (q[2 + i] - x[LG_AT_Q0 + i % 2]);
        y[inner + i] = side * v[2 + i];
    }
}

/* Subtracts from y (n) its component along `vector` = s u. Returns the coefficient of the vector, 0 if s =
 * 0. */
static double take_out(const double *vector, size_t n, double *y) {
    double dot = 0.0, square = 0.0;
    for (size_t i = 0; i < n; i++) {
        dot += vector[i] * y[i];
        square += vector[i] * vector[i];
    }
    const double c = square > 0.0 ? dot / square : 0.0;
    for (size_t i = 0; i < n; i++) y[i] -= c * vector[i];
    return c;
}

lg_status lg_surrogate_coefficients(const lg_context *context, const lg_surrogate *model,
                                    const lg_elastica_curves *curves, const uint32_t *training, size_t count,
                                    double *coefficients, double *truncation, lg_error *error) {
    LG_NEEDS(error, model, curves, training, coefficients);
    const size_t n = lg_surrogate_outputs(model), modes = model->options.modes;
    double rest = 0.0;
    LG_TRY(check(model, curves, training, count, error));
    LG_TRY(lg_surrogate_check_modes(model, error));
    LG_TRY_SCRATCH(double, y, context, n,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the %zu numbers of a curve", n));
    for (size_t i = 0; i < count; i++) {
        numbers_of(model, curves, training[i], y);
        for (size_t j = 0; j < n; j++) y[j] -= model->modes[j];
        for (size_t k = 0; k < modes; k++)
            coefficients[modes * i + k] = take_out(model->modes + n * (k + 1), n, y);
        for (size_t j = 0; j < n; j++) rest += y[j] * y[j];
    }
    if (truncation != NULL) *truncation = count > 0 ? rest / ((double)n * (double)count) : 0.0;
    return LG_OK;
}

/* ---- singular vectors ---- */

/* Arrays of a singular value decomposition: centred curves a (count, n), singular values s, left vectors u
 * (count, least), right vectors vt (least, n); a, u and vt are column-major. iwork (8 least) and work are the
 * work memory of dgesdd. */
typedef struct decomposition {
    size_t count, n, least;
    double *mean, *y, *a, *s, *u, *vt, *work;
    int *iwork;
} decomposition;

static void release(const lg_context *context, decomposition *d) {
    double *const arrays[] = {d->mean, d->y, d->a, d->s, d->u, d->vt, d->work};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) lg_free(context, arrays[i]);
    lg_free(context, d->iwork);
}

/* Calls dgesdd with `lwork` numbers of work memory. With lwork = -1, work[0] becomes the size that it
 * needs. */
static int decompose(decomposition *d, double *work, int lwork) {
    const int rows = (int)d->count, columns = (int)d->n, least = (int)d->least;
    int info = 0;
    dgesdd_("S", &rows, &columns, d->a, &rows, d->s, d->u, &rows, d->vt, &least, work, &lwork, d->iwork,
            &info);
    return info;
}

static lg_status reserve(const lg_context *context, decomposition *d) {
    double wanted = 0.0;
    LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(d->mean, d->n), LG_ARRAY(d->y, d->n),
                        LG_ARRAY(d->a, d->count * d->n), LG_ARRAY(d->s, d->least),
                        LG_ARRAY(d->u, d->count * d->least), LG_ARRAY(d->vt, d->least * d->n),
                        LG_ARRAY(d->iwork, 8 * d->least)));
    if (decompose(d, &wanted, -1) != 0 || !(wanted < INT_MAX)) return LG_OUT_OF_MEMORY;
    LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(d->work, (size_t)wanted)));
    d->work[0] = wanted;
    return LG_OK;
}

/* Fills d->mean and d->a from the curves. Returns false if a number is not finite. */
static bool lay_out(decomposition *d, const lg_surrogate *model, const lg_elastica_curves *curves,
                    const uint32_t *training) {
    double all = 0.0;
    for (size_t i = 0; i < d->count; i++) {
        numbers_of(model, curves, training[i], d->y);
        for (size_t j = 0; j < d->n; j++) {
            d->a[d->count * j + i] = d->y[j];
            d->mean[j] += d->y[j] / (double)d->count;
        }
    }
    for (size_t j = 0; j < d->n; j++)
        for (size_t i = 0; i < d->count; i++) {
            d->a[d->count * j + i] -= d->mean[j];
            all += 0.0 * d->a[d->count * j + i];
        }
    return isfinite(all);
}

/* Writes the mean and the first `count` modes s_k u_k, with s_k = sigma_k/sqrt(number of curves), where
 * sigma_k are the singular values. */
static void hand_over(const decomposition *d, uint32_t count, double *modes) {
    memcpy(modes, d->mean, d->n * sizeof *modes);
    for (size_t k = 0; k < count; k++)
        for (size_t j = 0; j < d->n; j++)
            modes[d->n * (k + 1) + j] = d->s[k] / sqrt((double)d->count) * d->vt[d->least * j + k];
}

/* Computes the decomposition of these curves. The caller releases *d, also after a failure. */
static lg_status take_apart(const lg_context *context, const lg_surrogate *model,
                            const lg_elastica_curves *curves, const uint32_t *training, decomposition *d,
                            lg_error *error) {
    LG_TRY(check(model, curves, training, d->count, error));
    if (d->count == 0 || d->count > INT_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "modes cannot be computed from %zu curves; 1 to 2^31 - 1 are possible", d->count);
    d->n = lg_surrogate_outputs(model);
    d->least = d->count < d->n ? d->count : d->n;
    if (reserve(context, d) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the modes of %zu curves", d->count);
    if (!lay_out(d, model, curves, training) || decompose(d, d->work, (int)d->work[0]) != 0)
        return lg_fail(error, LG_NOT_FINITE,
                       "the modes cannot be computed: numbers of the curves are not finite");
    return LG_OK;
}

/* Returns the least K for which the rest, the sum of s_k^2 over k >= K, is negligible or noise; at most
 * `most`. The rest is negligible if it is at most NEGLIGIBLE times the sum over all k. It is noise if its
 * largest term s_K^2 is less than NOISE times the rest. */
static const double NEGLIGIBLE = 1e-12, NOISE = 0.1;
static uint32_t needed(const double *s, size_t count, uint32_t most) {
    double whole = 0.0, rest = 0.0;
    uint32_t enough = most;
    for (size_t k = 0; k < count; k++) whole += s[k] * s[k];
    for (size_t k = count; k-- > 0;) {
        rest += s[k] * s[k];
        if (k < most && (rest <= NEGLIGIBLE * whole || s[k] * s[k] < NOISE * rest)) enough = (uint32_t)k;
    }
    return enough;
}

lg_status lg_surrogate_count_modes(const lg_context *context, const lg_surrogate *model,
                                   const lg_elastica_curves *curves, const uint32_t *training, size_t count,
                                   uint32_t *modes, lg_error *error) {
    LG_NEEDS(error, model, curves, training, modes);
    decomposition d = {.count = count};
    const lg_status status = take_apart(context, model, curves, training, &d, error);
    if (status == LG_OK) *modes = needed(d.s, d.least, model->options.modes);
    release(context, &d);
    return status;
}

lg_status lg_surrogate_find_modes(const lg_context *context, const lg_surrogate *model,
                                  const lg_elastica_curves *curves, const uint32_t *training, size_t count,
                                  double *modes, lg_error *error) {
    LG_NEEDS(error, model, curves, training, modes);
    const uint32_t wanted = model->options.modes;
    if (count <= wanted)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%u modes need at least %u curves to learn from, not %zu",
                       wanted, wanted + 1, count);
    decomposition d = {.count = count};
    const lg_status status = take_apart(context, model, curves, training, &d, error);
    if (status == LG_OK) hand_over(&d, wanted, modes);
    release(context, &d);
    return status;
}
