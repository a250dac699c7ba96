/* lg-hamiltonian generate: samples trajectories of a scene and writes a data file. */
#include "lg-hamiltonian/training.h"

#include "common/trials.h"

typedef struct generate_values {
    const char *out;
    uint64_t trajectories, points, segments;
    double t_end, noise, speed;
    int noise_kind, noise_on;
    trials_values shared;
} generate_values;

static const lg_field generate_options[] = {
    LG_OPTION(generate_values, trajectories, U64, "N", "Number of trajectories", .low = 1, .high = 1e9,
              .value = "500"),
    APP_POINTS(generate_values, "Points of each trajectory, the start included (default 5); dt = T/(M-1)"),
    LG_OPTION(generate_values, segments, U64, "s",
              "Consecutive trajectories from one start (default: the scene's, or 1)", .low = 1, .high = 1e6),
    APP_T_END(generate_values, "Time of the last point (default: the scene's t_end, or 0.1)"),
    LG_OPTION(
        generate_values, speed, REAL, "V",
        "CONSTRAINT.h5: the numbers of the start's velocity are drawn from -V..V and made tangent (default "
        "1)",
        LG_POSITIVE),
    LG_OPTION(generate_values, noise, REAL, "EPS", "Size of the noise (default 0)", .high = 1e300),
    LG_OPTION(generate_values, noise_kind, NAME, NULL, "normal: EPS N(0,1); uniform: EPS U(-1,1)",
              LG_NAMES("normal", "uniform")),
    LG_OPTION(generate_values, noise_on, NAME, NULL,
              "later: all points but the first; all: the first point too, which is then projected onto its "
              "manifold",
              LG_NAMES("later", "all")),
    APP_OUT(generate_values, "FILE", "The HDF5 file to write", .required = true),
    TRIALS_ROWS(generate_values),
    LG_FIELD_END};

static generate_values values = {.points = 5};

/* ---- trajectories of a scene ---- */

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

/* Allocates all trajectories and sets their times. */
static lg_status sample_create(const lg_context *context, const lg_scene *scene,
                               const lg_trajectory_options *how, lg_trajectories *out, lg_error *error) {
    const lg_hamiltonian_family *family = NULL;
    uint32_t n = 0;
    LG_TRY(scene_family(scene, &family, &n, error));
    const lg_status status = lg_trajectories_create(context, lg_system_name(scene->system), family, n,
                                                    how->trajectories, how->points, how->t_end, true, 0, out);
    if (status != LG_OK) return lg_fail(error, status, "%s", lg_status_sentence(status));
    for (size_t j = 0; j < out->points; j++) out->t[j] = how->t_end * (double)j / (double)(out->points - 1);
    return LG_OK;
}

/* Computes `count` trajectories from number `first` on; may be called from any thread. A scene NULL: the
 * motion of data->constraint. */
static lg_status sample_part(const lg_context *context, const lg_scene *scene,
                             const lg_trajectory_options *how, size_t first, size_t count,
                             lg_trajectories *data, lg_error *error) {
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

/* ---- pieces of work: the trajectories of some starts ---- */

enum { STARTS_OF_PIECE = 16 };

typedef struct generating {
    const app *app;
    const lg_scene *scene; /* NULL: the motion of data->constraint */
    const lg_trajectory_options *how;
    lg_trajectories *data;
    size_t each; /* trajectories per piece */
} generating;

static lg_status make_piece(void *user, size_t piece, void *record, lg_error *error) {
    const generating *self = user;
    const size_t first = piece * self->each, rest = self->data->count - first;
    const size_t count = rest < self->each ? rest : self->each;
    return sample_part(self->app->context, self->scene, self->how, first, count, self->data, error);
}

/* Computes all trajectories, together with other processes if there are any. False: another process writes
 * the file. */
static bool make_all(const app *self, const lg_scene *scene, const lg_trajectory_options *how,
                     lg_trajectories *data, trials_work *made) {
    const size_t each = STARTS_OF_PIECE * how->segments,
                 point = data->points * data->state_dim * sizeof(double);
    generating what = {self, scene, how, data, each};
    APP_FREE char *text = app_format(
        "%zu %zu %.17g %.17g %d %d %llu %zu %.17g", how->trajectories, how->points, how->t_end, how->noise,
        how->noise_first, (int)how->noise_kind, (unsigned long long)how->seed, how->segments, values.speed);
    made->count = (data->count + each - 1) / each;
    made->array_count = 2;
    made->arrays[0] = (trials_array){data->data, each * point, data->count * point};
    made->arrays[1] = (trials_array){data->hamiltonian, each * sizeof(double), data->count * sizeof(double)};
    made->run = make_piece;
    made->user = &what;
    trials_begin(made, text, self->arguments[0]);
    return trials_run(made);
}

static lg_trajectory_options options_of(const app *self, const lg_scene *scene) {
    lg_trajectory_options out = sample_options(scene);
    out.trajectories = (size_t)values.trajectories;
    out.points = (size_t)values.points;
    if (values.t_end > 0) out.t_end = values.t_end;
    if (values.speed > 0) out.low = -values.speed, out.high = values.speed;
    out.noise = values.noise;
    out.noise_first = values.noise_on == 1;
    out.noise_kind = values.noise_kind == 0 ? LG_NOISE_NORMAL : LG_NOISE_UNIFORM;
    out.seed = self->seed;
    return out;
}

/* Trajectories of a scene, not computed yet. */
static lg_trajectory_options create(const app *self, const char *path, lg_scene *scene,
                                    lg_trajectories *data) {
    lg_error why = {LG_OK, ""};
    if (values.speed > 0)
        app_stop_usage(self, "--speed is for constraints; a scene says how starts are drawn");
    APP_FILE(self, path, lg_scene_read, FORM, scene);
    if (values.segments > 0) scene->segments = (uint32_t)values.segments;
    const lg_trajectory_options how = options_of(self, scene);
    const lg_status status = sample_create(self->context, scene, &how, data, &why);
    if (status == LG_UNSUPPORTED)
        app_stop(self, LG_FORMAT, "%s: line %u: %s", path, scene->line_system, why.message);
    if (status != LG_OK) app_stop(self, status, "%s: %s", path, why.message);
    return how;
}

/* The same of the motion of a program with the functions constraint, potential and mass. */
static lg_trajectory_options create_constrained(const app *self, const char *path, lg_trajectories *data) {
    lg_program *program;
    lg_constraint *constraint = NULL;
    lg_error why = {LG_OK, ""};
    if (values.segments > 0) app_stop_usage(self, "--segments is for scenes");
    APP_FILE(self, path, lg_program_load, NULL, &program);
    lg_status status = lg_constraint_create(self->context, program, &constraint, &why);
    if (status == LG_OK && !lg_constraint_moves(constraint))
        status = lg_fail(&why, LG_FORMAT, "there is no function potential (q) -> V");
    if (status != LG_OK) app_stop(self, status, "%s: %s", path, why.message);
    const lg_trajectory_options how = options_of(self, NULL);
    status = lg_trajectories_create(self->context, "", lg_hamiltonian_family_find("constrained"),
                                    lg_constraint_coordinates(constraint), how.trajectories, how.points,
                                    how.t_end, true, 0, data);
    app_must_file(self, status, NULL, path);
    APP_MUST_FILE(self, path, lg_trajectories_set_constraint(data, program, &error));
    lg_constraint_destroy(constraint);
    lg_program_destroy(program);
    return how;
}

static void run(app *self) {
    const char *path = self->arguments[0];
    const double begin = app_seconds();
    APP_CLEAN(lg_scene_destroy) lg_scene scene = {0};
    APP_CLEAN(lg_trajectories_destroy) lg_trajectories data = {0};
    APP_CLEAN(trials_close)
    trials_work made = {
        .app = self, .values = &values.shared, .out = values.out, .noun = "pieces", .threads = self->threads};
    bool h5;
    const app_path path_out = trials_choose(&made, "trajectories");
    app_check_outputs(self, &path_out, 1);
    APP_MUST_FILE(self, path, lg_file_is_h5(path, &h5, &error));
    const lg_trajectory_options how =
        h5 ? create_constrained(self, path, &data) : create(self, path, &scene, &data);
    if (make_all(self, h5 ? NULL : &scene, &how, &data, &made)) {
        if (!h5) app_must_file(self, lg_trajectories_set_truth(&data, scene.system), NULL, values.out);
        data.provenance = app_provenance(self, self->seed);
        APP_FILE(self, values.out, lg_trajectories_write, &data);
        trials_end(&made);
        app_json *out = self->out;
        APP_PUT(out, LG_TEXT("system", data.system, NULL), LG_AS_WHOLE("links", data.n),
                LG_WHOLE("trajectories", data.count, NULL), LG_WHOLE("points", data.points, "of each"),
                LG_WHOLE("state_size", data.state_dim, "numbers of a point"), LG_REAL("dt", data.dt, NULL));
        const lg_field *noise = lg_field_find(generate_options, "noise"); /* noise_kind, noise_on follow */
        for (const lg_field *row = noise; row < noise + 3; row++) app_json_field(out, row, &values);
        APP_PUT(out, LG_AS_WHOLE("seed", self->seed), LG_AS_TEXT("sha256", data.sha256),
                LG_TEXT("out", values.out, NULL), LG_REAL("seconds", app_seconds() - begin, NULL));
    }
    if (scene.has_initial)
        app_warn(self,
                 "%s: line %u: `initial` is a single start and was not used; the starts were drawn at random "
                 "(see key `starts`)",
                 path, scene.line_initial);
}

const app_command hamiltonian_generate_command = {
    .name = "generate",
    .arguments = "SCENE.yaml | CONSTRAINT.h5",
    .summary = "Sample trajectories of a scene from random starts",
    .details = "The file holds /t (M), /trajectories (N, M, d) and /hamiltonian (N), the energies at the "
               "starts. The scene gives the system, its parameters and the distribution of starts. Each "
               "start depends on the seed and its number only, not on N, M, T or the noise. CONSTRAINT.h5 is "
               "a program with the functions constraint (q) -> g, potential (q) -> V and mass (q) -> M of "
               "liegrad/constraint.h: the motion on g(q) = 0. Starts are drawn from the range of q and "
               "projected. The data file carries the functions, so train, evaluate and predict need no "
               "further file.",
    .settings = APP_SETTINGS(APP_GIVEN(generate_options, values)),
    .run = run,
    .together = APP_RANKS};
