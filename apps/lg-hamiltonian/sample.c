/* Samples trajectories of a scene. */
#include "core/clean.h"
#include "lg-hamiltonian/training.h"

lg_status scene_family(const lg_scene *scene, const lg_hamiltonian_family **family, uint32_t *n,
                       lg_error *error) {
    size_t copies = 0;
    const lg_hamiltonian_family *found = lg_hamiltonian_family_for(scene->system, &copies);
    if (found == NULL)
        return lg_fail(error, LG_UNSUPPORTED,
                       "lg-hamiltonian cannot learn system %s; lg-simulate can integrate it",
                       lg_system_name(scene->system));
    if (copies > LG_HAMILTONIAN_MAX_COPIES)
        return lg_fail(error, LG_UNSUPPORTED, "%zu %ss are more than the %d that can be learned", copies,
                       found->copy, LG_HAMILTONIAN_MAX_COPIES);
    *family = found;
    *n = (uint32_t)copies;
    return LG_OK;
}

lg_trajectory_options sample_options(const lg_scene *scene) {
    lg_trajectory_options out;
    lg_trajectory_options_init(&out);
    if (scene == NULL) return out;
    if (scene->has_t_end) out.t_end = scene->t_end;
    out.starts = scene->starts;
    out.low = scene->low;
    out.high = scene->high;
    out.ahead = scene->ahead;
    out.segments = scene->segments > 0 ? scene->segments : 1;
    return out;
}

lg_status sample_create(const lg_context *context, const lg_scene *scene, const lg_trajectory_options *how,
                        lg_trajectories *out, lg_error *error) {
    const lg_hamiltonian_family *family = NULL;
    uint32_t n = 0;
    LG_TRY(scene_family(scene, &family, &n, error));
    const lg_status status = lg_trajectories_create(context, lg_system_name(scene->system), family, n,
                                                    how->trajectories, how->points, how->t_end, true, 0, out);
    if (status != LG_OK) return lg_fail(error, status, "%s", lg_status_sentence(status));
    for (size_t j = 0; j < out->points; j++) out->t[j] = how->t_end * (double)j / (double)(out->points - 1);
    return LG_OK;
}

lg_status sample_part(const lg_context *context, const lg_scene *scene, const lg_trajectory_options *how,
                      size_t first, size_t count, lg_trajectories *data, lg_error *error) {
    lg_trajectory_options part = *how;
    double *states = data->data + first * data->points * data->state_dim;
    part.trajectories = count;
    part.first = first;
    APP_FREE double *t = app_alloc(data->points, sizeof *t);
    return scene != NULL
               ? lg_system_generate(context, scene->system, &part, t, states, data->hamiltonian + first,
                                    error)
               : lg_constraint_generate(data->constraint, &part, t, states, data->hamiltonian + first, error);
}

lg_status sample_scene(const lg_context *context, const lg_scene *scene, const lg_trajectory_options *how,
                       lg_trajectories *out, lg_error *error) {
    APP_CLEAN(lg_trajectories_destroy) lg_trajectories data = {0};
    LG_TRY(sample_create(context, scene, how, &data, error));
    LG_TRY(sample_part(context, scene, how, 0, data.count, &data, error));
    LG_TRY(lg_trajectories_set_truth(&data, scene->system));
    return LG_GIVE(out, data);
}
