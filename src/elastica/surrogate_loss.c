/* What the losses of all surrogates need: curves of the data, and their energies and residuals. */
#include "liegrad/ops.h"
#include "elastica/surrogate_loss.h"

typedef lg_loss_part part;
typedef lg_loss_curve curve;

curve lg_loss_curve_at(const part *b, size_t i) {
    const lg_elastica_curves *set = b->problem->curves;
    const size_t at = b->problem->training[i], stride = 2 * ((size_t)set->intervals + 1);
    const double *x = set->boundary + 8 * at;
    return (curve){x, set->q + stride * at, set->v + stride * at, lg_surrogate_sign(b->problem->model, x)};
}

const double lg_loss_origin[2] = {0.0, 0.0};

lg_var lg_loss_mean_square(lg_tape *tape, lg_var d) {
    return lg_mean(tape, lg_square(tape, d));
}

lg_var lg_loss_add(const part *b, lg_var sum, double weight, lg_var term) {
    return lg_add(b->tape, sum, lg_scale(b->tape, term, weight));
}

/* L/EI times the mean energy of the curves of the data; 0 where the data have none. */
static double known_energy(const part *b) {
    const lg_elastica_curves *set = b->problem->curves;
    double sum = 0.0;
    for (size_t i = 0; i < b->count && set->energy != NULL; i++)
        sum += set->energy[b->problem->training[b->samples[i]]];
    return sum * set->length / (set->stiffness * (double)b->count);
}

lg_var lg_loss_add_residual(const part *b, lg_var sum, lg_var turning, lg_var x, lg_var y) {
    const lg_surrogate *model = b->problem->model;
    const lg_var errors = lg_surrogate_moments(b->tape, model, turning, x, y);
    return lg_loss_add(b, sum, model->options.residual, lg_loss_mean_square(b->tape, errors));
}

lg_var lg_loss_add_energy(const part *b, lg_var sum, lg_var energies) {
    const lg_var above = lg_add_scalar(b->tape, lg_mean(b->tape, energies), -known_energy(b));
    return lg_loss_add(b, sum, b->problem->model->options.energy, above);
}

void lg_loss_put_points(const part *b, void *values, size_t at, const double *points, size_t n,
                        const double *start, double sign) {
    for (size_t k = 0; k < n; k++) {
        const double point[2] = {points[2 * k] - start[0], sign * (points[2 * k + 1] - start[1])};
        lg_put_numbers(lg_tape_dtype(b->tape), values, at + 2 * k, point, 2);
    }
}

void lg_loss_put_row(const part *b, void *values, size_t row, const curve *c, double s) {
    double numbers[9];
    const lg_surrogate *model = b->problem->model;
    const size_t n = model->net.inputs;
    lg_surrogate_row(model, c->x, c->sign, s, numbers);
    lg_put_numbers(lg_tape_dtype(b->tape), values, row * n, numbers, n);
}

double lg_loss_node_of_data(const part *b, uint32_t k) {
    const uint32_t n = b->problem->curves->intervals;
    return k == n ? b->problem->model->length : b->problem->model->length * k / n;
}

lg_var lg_loss_chords(const part *b) {
    void *values;
    const lg_var chord = lg_input_buffer(b->tape, lg_shape2((uint32_t)b->count, 2), &values);
    if (lg_is_none(chord)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = lg_loss_curve_at(b, b->samples[i]);
        lg_loss_put_points(b, values, 2 * i, c.x + LG_AT_QN, 1, c.x + LG_AT_Q0, c.sign);
    }
    return chord;
}

lg_var lg_loss_forces(const part *b) {
    const lg_elastica_curves *set = b->problem->curves;
    void *values;
    const lg_var force = lg_input_buffer(b->tape, lg_shape2((uint32_t)b->count, 2), &values);
    if (lg_is_none(force)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = lg_loss_curve_at(b, b->samples[i]);
        double f[2];
        lg_surrogate_force(set->length, set->intervals, c.q, c.v, f);
        lg_loss_put_points(b, values, 2 * i, f, 1, lg_loss_origin, c.sign);
    }
    return force;
}
