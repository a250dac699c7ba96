/* Trajectories of a scene. */
#include "lg-hamiltonian/learning.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "liegrad/geometry.h"

lg_status scene_family(const lg_scene *scene, const lg_hamiltonian_family **family, uint32_t *n,
                       lg_error *error) {
    size_t copies = 0;
    const lg_hamiltonian_family *found = lg_hamiltonian_family_for(scene->system, &copies);
    if (found == NULL)
        return app_error(error, LG_UNSUPPORTED, "no Hamiltonian is learned for system %s",
                         lg_system_name(scene->system));
    if (copies > LG_HAMILTONIAN_MAX_COPIES)
        return app_error(error, LG_UNSUPPORTED, "%zu %ss are more than the %d that can be learned", copies,
                         found->copy, LG_HAMILTONIAN_MAX_COPIES);
    *family = found;
    *n = (uint32_t)copies;
    return LG_OK;
}

/* One start of `starts: box`. Chains: q normalised N(0, I), p = q x u, u ~ U[low, high]^3; others: U[low,
 * high]^d. */
static void box_start(const lg_scene *scene, lg_rng *rng, double *state) {
    const size_t links = lg_system_links(scene->system), dim = lg_system_dim(scene->system);
    for (size_t i = 0; links == 0 && i < dim; i++) state[i] = lg_rng_uniform_in(rng, scene->low, scene->high);
    for (size_t link = 0; link < links; link++) {
        double *q = state + 6 * link, u[3], length;
        do {
            for (int i = 0; i < 3; i++) q[i] = lg_rng_normal(rng);
            length = sqrt(lg_dot3(q, q));
        } while (length < 1e-3);
        for (int i = 0; i < 3; i++) {
            q[i] /= length;
            u[i] = lg_rng_uniform_in(rng, scene->low, scene->high);
        }
        lg_cross3(q, u, q + 3);
    }
}

static void add_noise(const sampling *how, size_t index, size_t points, uint32_t dim, double *trajectory) {
    lg_rng rng;
    lg_rng_seed(&rng, how->seed, (UINT64_C(1) << 40) + index);
    for (size_t i = dim; i < points * dim; i++)
        trajectory[i] += how->noise * (how->noise_kind == LG_NOISE_NORMAL ? lg_rng_normal(&rng)
                                                                          : lg_rng_uniform_in(&rng, -1, 1));
}

/* Starts drawn here, each followed for `segments` trajectories that join: the last point of one is the first
 * of the next. */
static lg_status sample_box(const lg_context *context, const lg_scene *scene, const sampling *how,
                            lg_trajectories *data, lg_error *error) {
    const lg_system *system = scene->system;
    const size_t segments = scene->segments > 0 ? scene->segments : 1, dim = data->state_size;
    const size_t groups = (how->trajectories + segments - 1) / segments, intervals = how->points - 1;
    const size_t joined = segments * intervals + 1;
    double *starts = app_alloc(groups * dim, sizeof *starts);
    double *times = app_alloc(joined, sizeof *times);
    double *points = app_alloc(groups * joined * dim, sizeof *points);
    double *work = app_alloc(lg_system_workspace(system), sizeof *work);
    for (size_t i = 0; i < groups; i++) {
        lg_rng rng;
        lg_rng_seed(&rng, how->seed, i);
        box_start(scene, &rng, starts + i * dim);
    }
    for (size_t j = 0; j < joined; j++) times[j] = (double)j * how->t_end / (double)intervals;
    const lg_status status =
        lg_reference_trajectories(context, system, starts, groups, times, joined, 0, 0, points, error);
    for (size_t i = 0; status == LG_OK && i < how->trajectories; i++) {
        double *trajectory = data->data + i * how->points * dim;
        memcpy(trajectory, points + ((i / segments) * joined + (i % segments) * intervals) * dim,
               how->points * dim * sizeof *trajectory);
        data->hamiltonian[i] = lg_system_hamiltonian(system, trajectory, work);
        if (how->noise > 0) add_noise(how, i, how->points, data->state_size, trajectory);
    }
    free(work);
    free(points);
    free(times);
    free(starts);
    return status;
}

static lg_status sample_thesis(const lg_context *context, const lg_scene *scene, const sampling *how,
                               lg_trajectories *data, lg_error *error) {
    lg_trajectory_options options;
    lg_trajectory_options_init(&options);
    options.trajectories = how->trajectories;
    options.points = how->points;
    options.t_end = how->t_end;
    options.noise = how->noise;
    options.noise_kind = how->noise_kind;
    options.starts = LG_STARTS_THESIS;
    options.segments = scene->segments > 0 ? scene->segments : 1;
    options.seed = how->seed;
    return lg_generate_trajectories(context, scene->system, &options, data->t, data->data, data->hamiltonian,
                                    error);
}

lg_status sample_scene(const lg_context *context, const lg_scene *scene, const sampling *how,
                       lg_trajectories *out, lg_error *error) {
    const lg_hamiltonian_family *family = NULL;
    uint32_t n = 0;
    lg_trajectories data;
    lg_status status = scene_family(scene, &family, &n, error);
    if (status != LG_OK) return status;
    status = lg_trajectories_create(context, lg_system_name(scene->system), family, n, how->trajectories,
                                    how->points, how->t_end, true, 0, &data);
    if (status != LG_OK) return app_error(error, status, "%s", lg_status_sentence(status));
    const bool box = scene->has_starts && scene->starts == LG_STARTS_BOX;
    status = (box ? sample_box : sample_thesis)(context, scene, how, &data, error);
    if (status == LG_OK)
        *out = data;
    else
        lg_trajectories_destroy(context, &data);
    return status;
}
