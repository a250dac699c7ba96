/* Trajectories of a scene. */
#include "lg-hamiltonian/learning.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "liegrad/geometry.h"

lg_status make_system(const lg_context *context, const lg_scene *scene, lg_system **out, lg_error *error) {
    lg_system_options options;
    lg_system_options_init(&options);
    options.links = scene->links;
    options.gravity = scene->gravity;
    options.masses = scene->masses;
    options.lengths = scene->lengths;
    return lg_system_create(context, scene->system, &options, out, error);
}

/* One start of `starts: box`. Chains: q normalised N(0, I), p = q x u, u ~ U[low, high]^3; others: U[low,
 * high]^d. */
static void box_start(const lg_scene *scene, lg_rng *rng, double *state) {
    if (scene->family != LG_HAMILTONIAN_CHAIN) {
        for (uint32_t i = 0; i < scene->state_size; i++)
            state[i] = lg_rng_uniform_in(rng, scene->low, scene->high);
        return;
    }
    for (uint32_t link = 0; link < scene->links; link++) {
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
static lg_status sample_box(const lg_context *context, const lg_scene *scene, const lg_system *system,
                            const sampling *how, lg_trajectories *data, lg_error *error) {
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

static lg_status sample_thesis(const lg_context *context, const lg_scene *scene, const lg_system *system,
                               const sampling *how, lg_trajectories *data, lg_error *error) {
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
    return lg_generate_trajectories(context, system, &options, data->t, data->data, data->hamiltonian, error);
}

lg_status sample_scene(const lg_context *context, const lg_scene *scene, const sampling *how,
                       lg_trajectories *out, lg_error *error) {
    lg_system *system = NULL;
    lg_trajectories data;
    lg_status status = make_system(context, scene, &system, error);
    if (status != LG_OK) return status;
    status = lg_trajectories_create(context, scene->system, scene->family, scene->links, how->trajectories,
                                    how->points, how->t_end, true, 0, &data);
    if (status != LG_OK) {
        lg_system_destroy(context, system);
        return app_error(error, status, "%s", lg_status_sentence(status));
    }
    const bool box = scene->has_starts && scene->starts == LG_STARTS_BOX;
    status = (box ? sample_box : sample_thesis)(context, scene, system, how, &data, error);
    lg_system_destroy(context, system);
    if (status == LG_OK)
        *out = data;
    else
        lg_trajectories_free(context, &data);
    return status;
}

/* p_i = m_ii q_i' + P_i sum_{j != i} m_ij q_j', q_j' = omega_j x q_j, from the state q_1, omega_1, ... */
static void momenta(const double *mass, size_t links, const double *velocities, double *state) {
    double *rates = app_alloc(3 * links, sizeof *rates);
    for (size_t i = 0; i < links; i++) lg_cross3(velocities + 6 * i + 3, velocities + 6 * i, rates + 3 * i);
    for (size_t i = 0; i < links; i++) {
        const double *q = velocities + 6 * i;
        double others[3] = {0, 0, 0};
        for (size_t j = 0; j < links; j++)
            for (int c = 0; j != i && c < 3; c++) others[c] += mass[i * links + j] * rates[3 * j + (size_t)c];
        const double along = lg_dot3(q, others);
        for (int c = 0; c < 3; c++) {
            state[6 * i + (size_t)c] = q[c];
            state[6 * i + 3 + (size_t)c] =
                mass[i * links + i] * rates[3 * i + (size_t)c] + others[c] - along * q[c];
        }
    }
    free(rates);
}

lg_status scene_start(const lg_scene *scene, const lg_system *system, double *state, lg_error *error) {
    if (!scene->has_initial) return app_error(error, LG_FORMAT, "the scene has no `initial`");
    if (scene->family != LG_HAMILTONIAN_CHAIN || scene->form != LG_SCENE_LAGRANGIAN) {
        memcpy(state, scene->state, scene->state_size * sizeof *state);
        return LG_OK;
    }
    double *mass = app_alloc((size_t)scene->links * scene->links, sizeof *mass);
    const lg_status status = lg_chain_mass_matrix(system, mass);
    if (status == LG_OK) momenta(mass, scene->links, scene->state, state);
    free(mass);
    return status == LG_OK ? LG_OK : app_error(error, status, "%s", lg_status_sentence(status));
}
