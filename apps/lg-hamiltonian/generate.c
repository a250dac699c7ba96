/* lg-hamiltonian generate: trajectories of a scene into a data file. */
#include "lg-hamiltonian/learning.h"

#include <stdlib.h>

#include "common/pieces.h"

typedef struct generate_values {
    const char *out;
    uint64_t trajectories, points, segments;
    double t_end, noise;
    int noise_kind, noise_on;
    board_values board;
} generate_values;

static const char *const noise_names[] = {"normal", "uniform", NULL};
static const char *const noise_on_names[] = {"later", "all", NULL};

static const lg_field generate_options[] = {
    LG_OPTION(generate_values, trajectories, U64, "N", "Number of trajectories", .low = 1, .high = 1e9,
              .value = "500"),
    LG_OPTION(generate_values, points, U64, "M",
              "Points of each, the start included (default 5); dt = T/(M-1)", .low = 2, .high = 1e9),
    LG_OPTION(generate_values, segments, U64, "s",
              "Consecutive trajectories from one start (default: the scene's, or 1)", .low = 1, .high = 1e6),
    LG_OPTION(generate_values, t_end, REAL, "T",
              "Time of the last point (default: the scene's t_end, or 0.1)", LG_POSITIVE),
    LG_OPTION(generate_values, noise, REAL, "EPS", "Size of the noise (default 0)", .high = 1e300),
    LG_OPTION(generate_values, noise_kind, NAME, NULL, "normal: EPS N(0,1); uniform: EPS U(-1,1)",
              .names = noise_names),
    LG_OPTION(generate_values, noise_on, NAME, NULL,
              "later: all points but the first; all: the first, too, which then goes back to its manifold",
              .names = noise_on_names),
    LG_OPTION(generate_values, out, STRING, "FILE", "The HDF5 file to write"),
    BOARD_ROWS(generate_values),
    LG_FIELD_END};

static generate_values values = {.points = 5};

static void report(const app *self, const lg_trajectories *data, double seconds) {
    if (self->json) {
        app_json json;
        app_json_begin(&json);
        app_json_text(&json, "system", data->system);
        app_json_size(&json, "links", data->n);
        app_json_size(&json, "trajectories", data->count);
        app_json_size(&json, "points", data->points);
        app_json_size(&json, "state_size", data->state_dim);
        app_json_real(&json, "dt", data->dt);
        app_json_real(&json, "noise", values.noise);
        app_json_text(&json, "noise_kind", noise_names[values.noise_kind]);
        app_json_text(&json, "noise_on", noise_on_names[values.noise_on]);
        app_json_size(&json, "seed", self->seed);
        app_json_text(&json, "sha256", data->sha256);
        app_json_text(&json, "out", values.out);
        app_json_real(&json, "seconds", seconds);
        app_json_end(&json);
        return;
    }
    (void)printf("%s: %zu trajectories of %s, %zu points each %g apart, %u numbers a point (%.2f s)\n",
                 values.out, data->count, data->system, data->points, data->dt, data->state_dim, seconds);
}

/* ---- pieces: trajectories of some starts ---- */

enum { STARTS_OF_PIECE = 16 };

typedef struct generating {
    const app *app;
    const lg_scene *scene;
    const sampling *how;
    lg_trajectories *data;
    size_t each; /* trajectories of a piece */
} generating;

static lg_status make_piece(void *user, size_t piece, lg_error *error) {
    const generating *self = user;
    const size_t first = piece * self->each, rest = self->data->count - first;
    return sample_part(self->app->context, self->scene, self->how, first,
                       rest < self->each ? rest : self->each, self->data, error);
}

/* All trajectories, of all processes. *complete: they are there. An exit code. */
static int make_all(const app *self, const lg_scene *scene, const sampling *how, lg_trajectories *data,
                    pieces *made, bool *complete) {
    const size_t segments = scene->segments > 0 ? scene->segments : 1;
    const size_t each = STARTS_OF_PIECE * segments, point = data->points * data->state_dim * sizeof(double);
    generating what = {self, scene, how, data, each};
    char label[LG_SHA256_TEXT],
        *text = app_format("%zu %zu %.17g %.17g %d %d %llu %zu", how->trajectories, how->points, how->t_end,
                           how->noise, how->noise_first, (int)how->noise_kind, (unsigned long long)how->seed,
                           segments);
    board_label(text, self->arguments[0], label);
    free(text);
    *made = (pieces){.app = self,
                     .board = &values.board,
                     .together = self->shares,
                     .out = values.out,
                     .sweep = label,
                     .count = (data->count + each - 1) / each,
                     .array_count = 2,
                     .arrays = {{data->data, each * point, data->count * point},
                                {data->hamiltonian, each * sizeof(double), data->count * sizeof(double)}},
                     .make = make_piece,
                     .user = &what};
    return pieces_make(made, complete);
}

static int generate(app *self, const lg_scene *scene) {
    lg_error error = {LG_OK, ""};
    lg_trajectories data;
    const double begin = app_seconds(), t_end = values.t_end > 0   ? values.t_end
                                                : scene->has_t_end ? scene->t_end
                                                                   : 0.1;
    const sampling how = {.trajectories = (size_t)values.trajectories,
                          .points = (size_t)values.points,
                          .t_end = t_end,
                          .noise = values.noise,
                          .noise_first = values.noise_on == 1,
                          .noise_kind = values.noise_kind == 0 ? LG_NOISE_NORMAL : LG_NOISE_UNIFORM,
                          .seed = self->seed};
    bool complete = false;
    pieces made;
    lg_status status = sample_create(self->context, scene, &how, &data, &error);
    if (status == LG_UNSUPPORTED)
        return app_fail(self, LG_FORMAT, "%s: line %u: %s", self->arguments[0], scene->line_system,
                        error.message);
    if (status != LG_OK) return app_fail(self, status, "%s: %s", self->arguments[0], error.message);
    int code = make_all(self, scene, &how, &data, &made, &complete);
    if (complete) {
        data.provenance = app_provenance(self, self->seed);
        status = lg_trajectories_set_truth(&data, scene->system);
        if (status == LG_OK) status = lg_trajectories_write(self->context, values.out, &data, &error);
        if (status != LG_OK) code = app_fail_file(self, status, &error, values.out);
        pieces_end(&made, status == LG_OK);
    }
    if (code == APP_EXIT_OK && complete) report(self, &data, app_seconds() - begin);
    lg_trajectories_destroy(&data);
    return code;
}

static int run(app *self) {
    lg_error error = {LG_OK, ""};
    lg_scene scene;
    if (values.out == NULL) return app_usage(self, "--out FILE is missing");
    const app_path out = {"out", values.out, LG_FILE_WRITTEN};
    bool together;
    int code = board_wanted(self, &values.board, values.out, &together);
    if (code == APP_EXIT_OK) code = app_check_outputs(self, &out, 1);
    if (code != APP_EXIT_OK) return code;
    const lg_status status = lg_scene_read(self->context, self->arguments[0], FORM, &scene, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    if (values.segments > 0) scene.segments = (uint32_t)values.segments;
    code = generate(self, &scene);
    if (code == APP_EXIT_OK && scene.has_initial)
        app_warn(self,
                 "%s: line %u: `initial` is a single start and was not used; the starts were drawn (key "
                 "`starts`)",
                 self->arguments[0], scene.line_initial);
    lg_scene_destroy(&scene);
    return code;
}

const app_command generate_command = {.name = "generate",
                                      .arguments = "SCENE.yaml",
                                      .summary = "Sample trajectories of a scene from random starts",
                                      .details = "The file holds /t (M), /trajectories (N, M, d) and "
                                                 "/hamiltonian (N), the energies at the starts. The scene "
                                                 "gives the system, its parameters and the distribution of "
                                                 "starts. Each start depends on the seed and its number "
                                                 "only, not on N, M, T or the noise.",
                                      .settings = APP_SETTINGS(APP_GIVEN(generate_options, values)),
                                      .run = run,
                                      .together = APP_WORKERS};
