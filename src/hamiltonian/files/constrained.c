#include "hamiltonian/files/constrained.h"

#include <math.h>

#include "model/files/program_file.h"

lg_status lg_h5_constraint(lg_h5 *h5, const lg_program *given, lg_constraint **out, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *own = NULL;
    lg_error why = {LG_OK, ""};
    *out = NULL;
    if (given == NULL) {
        if (!lg_h5_has(h5, "functions/constraint")) return LG_OK;
        LG_TRY(lg_program_get(h5, &own, error));
    }
    const lg_status status = lg_constraint_create(h5->context, own != NULL ? own : given, out, &why);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status, "%s: the constraint: %s", lg_shown_path(h5->path), why.message);
}

lg_status lg_h5_put_constraint(lg_h5 *h5, const lg_constraint *constraint, lg_error *error) {
    const lg_program *program = lg_constraint_program(constraint);
    LG_TRY(lg_program_put_parameters(h5, program, NULL, 0, error));
    return lg_program_put_functions(h5, program, error);
}

lg_status lg_hash_function(const lg_context *context, const lg_program *program, size_t function,
                           lg_sha256 *state) {
    LG_CLEAN(lg_function_image_destroy_at) lg_function_image *image = NULL;
    size_t size;
    LG_TRY(lg_function_image_create(program, function, &image));
    LG_TRY(lg_function_pack(image, NULL, &size, NULL));
    LG_TRY_SCRATCH(char, bytes, context, size, LG_OUT_OF_MEMORY);
    LG_TRY(lg_function_pack(image, bytes, &size, NULL));
    lg_sha256_add(state, bytes, size);
    return LG_OK;
}

lg_status lg_constraint_hash(const lg_constraint *constraint, lg_sha256 *state) {
    size_t function;
    LG_TRY(lg_program_find(lg_constraint_program(constraint), "constraint", &function, NULL));
    return lg_hash_function(NULL, lg_constraint_program(constraint), function, state);
}

lg_status lg_constrained_size(const char *path, lg_trajectories *data, lg_error *error) {
    const uint32_t n = lg_constraint_coordinates(data->constraint);
    data->family = lg_hamiltonian_family_find("constrained");
    data->n = n;
    if (data->state_dim == 2 * n) return LG_OK;
    return lg_fail(
        error, LG_FORMAT,
        "%s: /trajectories: d = %u, but function constraint takes q of %u numbers, and a state q p has %u",
        lg_shown_path(path), data->state_dim, n, 2 * n);
}

lg_status lg_constrained_points(const char *path, bool project, lg_trajectories *data, lg_error *error) {
    const size_t d = data->state_dim, count = data->count * data->points;
    double most = 0, sum = 0;
    for (size_t k = 0; k < count; k++)
        for (size_t i = 0; i < data->n; i++) most = fmax(most, fabs(data->data[k * d + i]));
    for (size_t k = 0; k < count && most > 0; k++)
        for (size_t i = 0; i < data->n; i++)
            sum += data->data[k * d + i] / most * (data->data[k * d + i] / most);
    const double size = most * sqrt(sum / (double)count); /* the length L: the root mean square of |q| */
    for (size_t k = 0; k < count; k++) {
        const size_t trajectory = k / data->points, point = k % data->points;
        double *state = data->data + k * data->state_dim;
        lg_constraint_view view;
        lg_error why = {LG_OK, ""};
        const lg_status status = lg_constraint_look(data->constraint, size, state, &view, &why);
        if (status != LG_OK)
            return lg_fail(error, status == LG_OUT_OF_MEMORY ? status : LG_FORMAT,
                           "%s: /trajectories: point %zu of trajectory %zu: %s", lg_shown_path(path),
                           point + 1, trajectory, why.message);
        const double off = fmax(view.off, view.across);
        if (point > 0) continue;
        data->starts_off = fmax(data->starts_off, off);
        if (off <= LG_CONSTRAINT_TOLERANCE) continue;
        if (!project)
            return lg_fail(
                error, LG_FORMAT,
                "%s: /trajectories: the first point of trajectory %zu is off the constraint: g(q) = 0 by "
                "%.3g of the size of q (largest |g_i| = %.3g), and P(q) p = p by %.3g of the size of p; "
                "momenta must be p = P(q) M q'; if the difference is noise, give --initial-states measured",
                lg_shown_path(path), trajectory, view.off, view.residual, view.across);
        if (lg_constraint_project(data->constraint, size, state, &why) != LG_OK)
            return lg_fail(error, LG_FORMAT, "%s: /trajectories: the first point of trajectory %zu: %s",
                           lg_shown_path(path), trajectory, why.message);
    }
    return LG_OK;
}
