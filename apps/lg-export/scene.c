/* Scenes of lg-simulate as programs with the functions velocity (x, parameters) -> x' and step (x,
 * parameters, h) -> next. Either each parameter is an input that all rows share, named as in gradients (m1,
 * L2, g), or all parameters are constants of the program. */
#include <string.h>

#include "lg-export/export.h"
#include "liegrad/mechanics.h"
#include "liegrad/ops.h"
#include "liegrad/taped.h"

enum { MOST_TUNABLE = 40, LABEL = 64 }; /* If a scene has more parameters, all of them stay constants. */

typedef struct recording {
    const lg_system *system;
    const lg_scheme *scheme;
    size_t tunable; /* Number of parameters that are inputs: all or none. */
} recording;

static lg_var parameters_of(const recording *r, lg_tape *tape, const lg_var *x) {
    const size_t count = lg_system_parameter_count(r->system);
    if (r->tunable > 0) return lg_concat(tape, x + 1, (uint32_t)count, 0);
    return lg_input_f64(tape, lg_shape1((uint32_t)count), lg_system_parameter_values(r->system));
}

static lg_status velocity(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    lg_taped_ode ode;
    lg_system_taped_user of;
    lg_var parts[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS];
    LG_TRY(lg_system_taped_ode(r->system, LG_COORDINATES_LIE, parameters_of(r, tape, x), &ode, &of));
    LG_TRY(lg_taped_split(tape, &ode.space, x[0], parts));
    LG_TRY(ode.field(ode.user, tape, (lg_taped_time){.value = 0}, parts, LG_NONE, algebra));
    LG_TRY(lg_taped_generator(tape, &ode.space, algebra, parts, parts));
    y[0] = lg_taped_join(tape, &ode.space, parts);
    return lg_tape_status(tape);
}

static lg_status step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    lg_taped_ode ode;
    lg_system_taped_user of;
    lg_var parts[LG_TAPED_MAX_PARTS];
    const lg_taped_interval over = {.h_rows = x[1 + r->tunable]};
    LG_TRY(lg_system_taped_ode(r->system, LG_COORDINATES_LIE, parameters_of(r, tape, x), &ode, &of));
    LG_TRY(lg_taped_split(tape, &ode.space, x[0], parts));
    LG_TRY(lg_taped_step(tape, r->scheme, &ode, &over, parts, parts));
    y[0] = lg_taped_join(tape, &ode.space, parts);
    return lg_tape_status(tape);
}

/* Builds the program with ports x, parameters, h. Recordings draw each parameter near its value. */
static lg_status build(const app *self, recording *r, lg_program **out, lg_error *error) {
    const size_t n = r->tunable;
    const double *values = lg_system_parameter_values(r->system);
    APP_FREE lg_port *in = app_alloc(n + 2, sizeof *in);
    char(*names)[LABEL] = app_keep(n, sizeof *names);
    const lg_port rate = {.name = "f"}, next = {.name = "next"};
    in[0] = (lg_port){.name = "x", .shape = lg_shape1((uint32_t)lg_system_dim(r->system))};
    for (size_t i = 0; i < n; i++) {
        lg_system_parameter_label(r->system, i, names[i]);
        in[1 + i] = (lg_port){.name = names[i], .shape = lg_shape1(1), .shared = true};
        in[1 + i].low = values[i];
        in[1 + i].high =
            values[i] + (values[i] != 0 ? 0.01 * (values[i] > 0 ? values[i] : -values[i]) : 0.01);
    }
    in[1 + n] = (lg_port){.name = "h", .shape = lg_shape1(1), .low = 0.001, .high = 0.01};
    const lg_function_spec functions[] = {{"velocity", in, n + 1, &rate, 1, velocity, r},
                                          {"step", in, n + 2, &next, 1, step, r}};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.functions = functions;
    spec.function_count = LG_COUNT(functions);
    spec.description = "a system of lg-simulate";
    return lg_program_build(self->context, &spec, out, error);
}

/* Takes the initial state, the parameters' values and the end time from the scene. */
static void take_values(const recording *r, const lg_scene *scene, export_source *source) {
    const size_t d = lg_system_dim(r->system);
    source->start = app_keep(d + r->tunable, sizeof *source->start);
    source->starts = d;
    source->tunable = r->tunable;
    source->stop = scene->has_t_end ? scene->t_end : 0;
    memcpy(source->start, scene->state, d * sizeof *scene->state);
    memcpy(source->start + d, lg_system_parameter_values(r->system), r->tunable * sizeof *source->start);
}

void export_load_scene(const app *self, const char *path, bool tunable, export_source *source,
                       lg_program **out) {
    lg_scene scene;
    APP_FILE(self, path, lg_scene_read, "hamiltonian", &scene);
    recording r = {.system = scene.system, .scheme = source->options->scheme};
    const size_t count = lg_system_parameter_count(scene.system);
    if (r.scheme == NULL) r.scheme = lg_scheme_find("cf4");
    if (tunable && count <= MOST_TUNABLE) r.tunable = count;
    if (strcmp(lg_system_name(scene.system), "quadrotors") == 0)
        app_stop(self, LG_FORMAT, "%s: %s depends on time, but exported functions have no time as input",
                 path, lg_system_name(scene.system));
    app_scene_start(self, &scene, path);
    export_check_scheme(self, lg_system_space(scene.system), false, r.scheme);
    APP_MUST_FILE(self, path, build(self, &r, out, &error));
    take_values(&r, &scene, source);
    lg_scene_destroy(&scene);
}
