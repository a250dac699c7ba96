/* Extended Kalman filter in tangent coordinates. It keeps the lower triangular root of the covariance. */
#include <math.h>
#include <string.h>

#include "liegrad/control.h"

#include "core/portions.h"
#include "kernels/matrix.h"
#include "model/internal.h"

struct lg_ekf {
    const lg_model *model;
    lg_stepper *stepper;
    void *work; /* workspace of the model */
    size_t d, r, m, k;
    bool exact; /* all sensors measure numbers of the state, so H is exact */
    lg_sensor *sensors;
    double *state, *root, *noise; /* estimate (d), L (r, r), W^1/2 (r, r) */
    /* Scratch. next .. to: states and velocities (d); c: coordinates (r). */
    double *next, *middle, *from, *to, *c;
    double *J, *basis, *stage, *slope, *X; /* J (d, d), the others (d, r) */
    double *F, *array;                     /* (r, r); array (r, 2 r) or (k + r, k + r) */
    double *H, *nu, *high, *low;           /* H (k, r), the others (k) */
    double *positions, *velocities;
};

static size_t outputs_of(const lg_model *model, lg_model_function function) {
    return model->plan[function] != NULL ? lg_plan_output_count(model->plan[function], 0) : 0;
}

/* Lays out the memory: the filter itself, then the stepper, then the arrays. Returns the bytes needed. */
static size_t plan_memory(const lg_model *model, const lg_scheme *scheme, size_t k, lg_ekf *e, void *memory,
                          void **stepper) {
    lg_portions from = {memory, 0};
    const size_t d = model->inputs, r = lg_model_tangent_dim(model), side = k + r;
    const size_t array = side * side > 2 * r * r ? side * side : 2 * r * r;
    double **const states[] = {&e->state, &e->next, &e->middle, &e->from, &e->to};
    double **const frames[] = {&e->basis, &e->stage, &e->slope, &e->X};
    double **const squares[] = {&e->root, &e->noise, &e->F};
    double **const measured[] = {&e->nu, &e->high, &e->low};
    (void)lg_portion(&from, 1, sizeof *e);
    *stepper = lg_portion(&from, lg_model_stepper_size(model, scheme), 1);
    e->work = lg_portion(&from, lg_model_work_size(model), 1);
    e->sensors = lg_portion(&from, k, sizeof *e->sensors);
    for (size_t i = 0; i < LG_COUNT(states); i++) *states[i] = lg_portion(&from, d, sizeof(double));
    for (size_t i = 0; i < LG_COUNT(frames); i++) *frames[i] = lg_portion(&from, d * r, sizeof(double));
    for (size_t i = 0; i < LG_COUNT(squares); i++) *squares[i] = lg_portion(&from, r * r, sizeof(double));
    for (size_t i = 0; i < LG_COUNT(measured); i++) *measured[i] = lg_portion(&from, k, sizeof(double));
    e->c = lg_portion(&from, r, sizeof(double));
    e->J = lg_portion(&from, d * d, sizeof(double));
    e->H = lg_portion(&from, k * r, sizeof(double));
    e->array = lg_portion(&from, array, sizeof(double));
    e->positions = lg_portion(&from, outputs_of(model, LG_MODEL_POSITIONS), sizeof(double));
    e->velocities = lg_portion(&from, outputs_of(model, LG_MODEL_VELOCITIES), sizeof(double));
    return from.used;
}

size_t lg_ekf_size(const lg_model *model, const lg_scheme *scheme, size_t sensor_count) {
    lg_ekf e;
    void *stepper;
    if (!lg_model_moves(model) || scheme == NULL || sensor_count == 0 || sensor_count > UINT16_MAX ||
        lg_model_stepper_size(model, scheme) == 0)
        return 0;
    return plan_memory(model, scheme, sensor_count, &e, NULL, &stepper);
}

void lg_ekf_options_init(lg_ekf_options *options) {
    *options = (lg_ekf_options){.size = sizeof *options};
}

/* ---- init ---- */

static lg_status check_sensors(const lg_model *model, const lg_ekf_options *options, bool *exact,
                               lg_error *error) {
    const size_t numbers[LG_SENSOR_KIND_COUNT] = {model->inputs, outputs_of(model, LG_MODEL_POSITIONS),
                                                  outputs_of(model, LG_MODEL_VELOCITIES)};
    *exact = true;
    for (size_t i = 0; i < options->sensor_count; i++) {
        const lg_sensor *s = &options->sensors[i];
        if ((unsigned)s->kind >= LG_SENSOR_KIND_COUNT)
            return lg_fail(error, LG_INVALID_ARGUMENT, "sensor %zu: the kind %d is unknown", i, (int)s->kind);
        if (numbers[s->kind] == 0)
            return lg_fail(error, LG_UNSUPPORTED,
                           "sensor %zu: the model has no such quantities; positions and velocities need a "
                           "model of a machine",
                           i);
        if (s->index >= numbers[s->kind])
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "sensor %zu: its index is %zu, but there are only %zu numbers of its kind", i,
                           s->index, numbers[s->kind]);
        if (!(s->noise > 0.0) || !isfinite(s->noise) || !(s->period >= 0.0) || !isfinite(s->period))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "sensor %zu: the noise must be above 0 and the period 0 or more", i);
        *exact = *exact && s->kind == LG_SENSOR_STATE;
    }
    return LG_OK;
}

static lg_status take_root(size_t n, const double *a, const char *name, double *L, lg_error *error) {
    double most = 0.0;
    if (!lg_kernels_for(LG_F64)->all_finite(n * n, a))
        return lg_fail(error, LG_NOT_FINITE, "%s is not finite", name);
    for (size_t i = 0; i < n * n; i++) most = fmax(most, fabs(a[i]));
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < i; j++)
            if (fabs(a[i * n + j] - a[j * n + i]) > 1e-8 * most)
                return lg_fail(error, LG_INVALID_ARGUMENT, "%s is not symmetric", name);
    if (!lg_matrix_root(n, a, L))
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s is not positive semidefinite", name);
    return LG_OK;
}

lg_status lg_ekf_init(const lg_model *model, const lg_ekf_options *options, lg_ekf **out, void *memory,
                      size_t bytes, lg_error *error) {
    LG_NEEDS(error, model, options, out, memory);
    if (options->size != sizeof *options || options->scheme == NULL || options->state == NULL ||
        options->P == NULL || options->W == NULL || options->sensors == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the options' size is wrong, or their scheme, state, P, W or sensors are NULL");
    const size_t k = options->sensor_count, needed = lg_ekf_size(model, options->scheme, k);
    if (needed == 0)
        return lg_fail(error, LG_UNSUPPORTED,
                       "the model has no field, the scheme does not fit the model, or there is no sensor");
    bool exact;
    LG_TRY(lg_portions_check(memory, bytes, needed, error));
    LG_TRY(check_sensors(model, options, &exact, error));
    lg_ekf *e = memory;
    void *stepper;
    *e = (lg_ekf){.model = model, .d = model->inputs, .k = k, .exact = exact};
    e->r = lg_model_tangent_dim(model), e->m = lg_model_input_dim(model);
    (void)plan_memory(model, options->scheme, k, e, memory, &stepper);
    LG_TRY(take_root(e->r, options->P, "P", e->root, error));
    LG_TRY(take_root(e->r, options->W, "W", e->noise, error));
    if (!lg_kernels_for(LG_F64)->all_finite(e->d, options->state))
        return lg_fail(error, LG_NOT_FINITE, "the state is not finite");
    memcpy(e->state, options->state, e->d * sizeof *e->state);
    memcpy(e->sensors, options->sensors, k * sizeof *e->sensors);
    const size_t room = lg_model_stepper_size(model, options->scheme);
    LG_TRY(lg_model_stepper_init(model, options->scheme, &e->stepper, stepper, room));
    *out = e;
    return LG_OK;
}

const double *lg_ekf_state(const lg_ekf *ekf) {
    return ekf->state;
}

void lg_ekf_covariance(const lg_ekf *ekf, double *P) {
    const size_t r = ekf->r;
    for (size_t i = 0; i < r; i++)
        for (size_t j = 0; j <= i; j++)
            P[i * r + j] = P[j * r + i] =
                lg_kernels_for(LG_F64)->dot(j + 1, ekf->root + i * r, ekf->root + j * r);
}

/* ---- predict ---- */

/* One stage of the Runge-Kutta method for X' = J X: with k = J (basis + ahead slope), X += weight k and then
 * slope = k. */
static void stage(const lg_ekf *e, double ahead, double weight) {
    const size_t d = e->d, r = e->r;
    for (size_t i = 0; i < d * r; i++) e->stage[i] = e->basis[i] + ahead * e->slope[i];
    lg_matrix_multiply(d, r, d, e->J, e->stage, e->slope);
    lg_matrix_add(d * r, weight, e->slope, e->X);
}

/* X = (d next/d state) basis(state) by the classical Runge-Kutta method, where `next` is the state reached
 * from `state` in the time h. */
static void flow_derivative(const lg_ekf *e, double h, const double *input) {
    const size_t d = e->d, bytes = d * e->r * sizeof *e->X;
    lg_space_basis(&e->model->space, e->state, e->basis);
    memcpy(e->X, e->basis, bytes);
    memset(e->slope, 0, bytes);
    lg_model_velocity(e->model, e->state, input, e->from, e->J, e->work);
    stage(e, 0.0, h / 6.0);
    lg_model_velocity(e->model, e->next, input, e->to, NULL, e->work);
    for (size_t i = 0; i < d; i++)
        e->middle[i] = 0.5 * (e->state[i] + e->next[i]) + h / 8.0 * (e->from[i] - e->to[i]);
    lg_space_project(&e->model->space, e->middle);
    lg_model_velocity(e->model, e->middle, input, NULL, e->J, e->work);
    stage(e, 0.5 * h, h / 3.0);
    stage(e, 0.5 * h, h / 3.0);
    lg_model_velocity(e->model, e->next, input, NULL, e->J, e->work);
    stage(e, h, h / 6.0);
}

/* root = the first r columns of `array` (r, columns), and state = next. If either is not finite, both stay as
 * they are and LG_NOT_FINITE is returned. */
static lg_status commit(lg_ekf *e, const double *array, size_t columns) {
    for (size_t i = 0; i < e->r; i++)
        if (!lg_kernels_for(LG_F64)->all_finite(e->r, array + i * columns)) return LG_NOT_FINITE;
    if (!lg_kernels_for(LG_F64)->all_finite(e->d, e->next)) return LG_NOT_FINITE;
    for (size_t i = 0; i < e->r; i++) memcpy(e->root + i * e->r, array + i * columns, e->r * sizeof *e->root);
    memcpy(e->state, e->next, e->d * sizeof *e->state);
    return LG_OK;
}

lg_status lg_ekf_predict(lg_ekf *ekf, double h, const double *input) {
    LG_NEEDS(NULL, ekf);
    lg_ekf *e = ekf;
    const size_t r = e->r;
    if (!(h > 0.0) || !isfinite(h)) return LG_INVALID_ARGUMENT;
    LG_TRY(lg_stepper_step(e->stepper, 0.0, h, e->state, input, e->next));
    flow_derivative(e, h, input);
    lg_model_coordinates(e->model, e->next, e->X, r, e->array, e->F); /* d + r <= (1 + r)^2 numbers */
    lg_kernels_for(LG_F64)->gemm(r, r, r, e->F, r, 1, e->root, r, e->array, 2 * r, false);
    for (size_t i = 0; i < r; i++)
        for (size_t j = 0; j < r; j++) e->array[i * 2 * r + r + j] = sqrt(h) * e->noise[i * r + j];
    lg_matrix_lower(r, 2 * r, e->array);
    return commit(e, e->array, 2 * r);
}

/* ---- update ---- */

static void measure(const lg_ekf *e, const double *state, double *z) {
    if (!e->exact) {
        (void)lg_model_machine_positions(e->model, state, e->positions, e->work);
        (void)lg_model_machine_velocities(e->model, state, e->velocities, e->work);
    }
    const double *const numbers[LG_SENSOR_KIND_COUNT] = {state, e->positions, e->velocities};
    for (size_t i = 0; i < e->k; i++) z[i] = numbers[e->sensors[i].kind][e->sensors[i].index];
}

/* Computes H: exact rows of the basis if e->exact, else central differences in each coordinate with a step of
 * 1/100 of its standard deviation. */
static void measure_derivative(const lg_ekf *e) {
    const size_t r = e->r;
    for (size_t i = 0; i < e->k && e->exact; i++)
        memcpy(e->H + i * r, e->basis + e->sensors[i].index * r, r * sizeof *e->H);
    for (size_t j = 0; j < r && !e->exact; j++) {
        const double step = fmax(1e-2 * lg_matrix_norm(j + 1, e->root + j * r), 1e-8);
        double *const sides[] = {e->high, e->low};
        for (int side = 0; side < 2; side++) {
            memset(e->c, 0, r * sizeof *e->c);
            e->c[j] = side == 0 ? step : -step;
            (void)lg_model_retract(e->model, e->state, e->c, e->middle, e->work);
            measure(e, e->middle, sides[side]);
        }
        for (size_t i = 0; i < e->k; i++) e->H[i * r + j] = (e->high[i] - e->low[i]) / (2.0 * step);
    }
}

/* Fills the array (R^1/2, H L; 0, L) and makes it lower triangular: (S^1/2, 0; P H^T S^-T/2, L+). */
static void fill_array(const lg_ekf *e) {
    const size_t k = e->k, r = e->r, side = k + r;
    memset(e->array, 0, side * side * sizeof *e->array);
    for (size_t i = 0; i < k; i++) e->array[i * (side + 1)] = e->sensors[i].noise;
    lg_kernels_for(LG_F64)->gemm(k, r, r, e->H, r, 1, e->root, r, e->array + k, side, false);
    for (size_t i = 0; i < r; i++)
        memcpy(e->array + (k + i) * side + k, e->root + i * r, r * sizeof *e->array);
    lg_matrix_lower(side, side, e->array);
}

/* nu <- S^-1/2 nu, then c = P H^T S^-T/2 nu, which is the gain times the old nu. Returns |nu|^2 (new nu). */
static double correction(const lg_ekf *e) {
    const size_t k = e->k, side = k + e->r;
    const lg_kernels *kernels = lg_kernels_for(LG_F64);
    for (size_t i = 0; i < k; i++) {
        const double *row = e->array + i * side;
        e->nu[i] = (e->nu[i] - kernels->dot(i, row, e->nu)) / row[i];
    }
    for (size_t i = 0; i < e->r; i++) e->c[i] = kernels->dot(k, e->array + (k + i) * side, e->nu);
    return kernels->dot(k, e->nu, e->nu);
}

/* Commits the update: the state is moved by c, and L+ is transported to the new state. */
static lg_status move(lg_ekf *e) {
    const size_t d = e->d, r = e->r, side = e->k + r;
    const lg_space *space = &e->model->space;
    lg_matrix_multiply(d, 1, r, e->basis, e->c, e->from);
    const bool flat = lg_space_is_abelian(space);
    lg_space_retract(space, e->state, e->from, e->next, flat ? NULL : e->F);
    const double *lower = e->array + e->k * side + e->k;
    if (flat) return commit(e, lower, side);
    /* X and stage serve as scratch (r, r) for L+ and F L+; they have room for d r >= r r numbers. */
    for (size_t i = 0; i < r; i++) memcpy(e->X + i * r, lower + i * side, r * sizeof *e->X);
    lg_matrix_multiply(r, r, r, e->F, e->X, e->stage);
    lg_matrix_lower(r, r, e->stage);
    return commit(e, e->stage, r);
}

lg_status lg_ekf_update(lg_ekf *ekf, const double *z, double *nis) {
    LG_NEEDS(NULL, ekf, z);
    lg_ekf *e = ekf;
    if (!lg_kernels_for(LG_F64)->all_finite(e->k, z)) return LG_NOT_FINITE;
    lg_space_basis(&e->model->space, e->state, e->basis);
    measure_derivative(e);
    measure(e, e->state, e->nu);
    for (size_t i = 0; i < e->k; i++) {
        e->nu[i] = z[i] - e->nu[i];
        if (e->sensors[i].period > 0.0) e->nu[i] = remainder(e->nu[i], e->sensors[i].period);
    }
    fill_array(e);
    const double square = correction(e);
    if (!isfinite(square)) return LG_NOT_FINITE;
    LG_TRY(move(e));
    if (nis != NULL) *nis = square;
    return LG_OK;
}
