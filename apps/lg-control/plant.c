/* Plants: the machines that a controller is for, from files of three kinds. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "control/policy.h"
#include "lg-control/control_app.h"
#include "liegrad/taped.h"

/* ---- kinds of files ---- */

typedef enum plant_kind { MACHINE, MODEL, PROGRAM } plant_kind; /* MODEL: of lg-identify */

static plant_kind kind_of(const app *self, const char *path) {
    char kind[64];
    bool is_hdf5;
    APP_MUST_FILE(self, path, lg_file_is_h5(path, &is_hdf5, &error));
    if (!is_hdf5) return MACHINE;
    APP_FILE(self, path, lg_model_file_kind, NULL, kind, sizeof kind);
    return strcmp(kind, "machine_model") == 0 ? MODEL : PROGRAM;
}

/* ---- machines ---- */

/* The lagged inputs become lines behind the machine's coordinates: lagged.u, or lagged.u.1 and lagged.u.2
 * of a lag of second order. */
static void name_lagged(const app *self, const char *path, const lg_machine *machine, lg_policy_task *task) {
    if (machine->coordinate_count + machine->lags > LG_POLICY_COORDINATES)
        app_stop(self, LG_UNSUPPORTED, "%s: %u coordinates and %u lagged inputs are more than %d", path,
                 machine->coordinate_count, machine->lags, LG_POLICY_COORDINATES);
    for (uint32_t k = 0; k < machine->lags; k++) {
        const uint32_t input = machine->lagged[k];
        const bool second = k > 0 && machine->lagged[k - 1] == input,
                   first = k + 1 < machine->lags && machine->lagged[k + 1] == input;
        lg_policy_coordinate *to = &task->coordinate[task->coordinate_count++];
        char name[LG_POLICY_NAME];
        memcpy(name, task->input[input].name, sizeof name);
        (void)snprintf(to->name, sizeof to->name, "lagged.%.22s%s", name, second ? ".2" : first ? ".1" : "");
        to->follows = input + 1;
        for (uint32_t i = 0; i + 1 < task->coordinate_count; i++)
            if (strcmp(task->coordinate[i].name, to->name) == 0)
                app_stop(self, LG_UNSUPPORTED, "%s: two states are called %s: give the inputs shorter names",
                         path, to->name);
    }
}

static void name_coordinates(const app *self, const char *path, const lg_machine_file *file,
                             lg_policy_task *task) {
    static const int motions[LG_COORDINATE_KIND_COUNT] = {[LG_COORDINATE_LINE] = LG_POLICY_LINE,
                                                          [LG_COORDINATE_ANGLE] = LG_POLICY_ANGLE,
                                                          [LG_COORDINATE_DIRECTION] = LG_POLICY_DIRECTION,
                                                          [LG_COORDINATE_ROTATION] = LG_POLICY_ROTATION,
                                                          [LG_COORDINATE_POSE] = -1};
    const lg_machine *machine = &file->machine;
    if (task->coordinate_count > 0)
        app_stop(self, LG_FORMAT, "states: the plant %s is a machine and has its own coordinates", path);
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_machine_coordinate *from = &machine->coordinates[i];
        lg_policy_coordinate *to = &task->coordinate[task->coordinate_count++];
        if (motions[from->kind] < 0)
            app_stop(self, LG_UNSUPPORTED,
                     "%s: coordinate %s is a pose; a controller needs lines and a rotation", path,
                     from->name);
        to->motion = (lg_policy_motion)motions[from->kind];
        (void)snprintf(to->name, sizeof to->name, "%s", from->name);
        (void)snprintf(to->velocity, sizeof to->velocity, "v%.30s", from->name);
    }
    for (uint32_t c = 0; c < file->column_count; c++) { /* a single column of velocity gives its name */
        const lg_log_column *column = &file->columns[c];
        const bool velocity = column->role == LG_LOG_VELOCITY && !machine->accelerations;
        for (uint32_t i = 0; i < machine->coordinate_count && velocity; i++) {
            const lg_policy_motion motion = task->coordinate[i].motion;
            if (column->index == i && (motion == LG_POLICY_LINE || motion == LG_POLICY_ANGLE) &&
                strlen(column->name) < LG_POLICY_NAME)
                (void)snprintf(task->coordinate[i].velocity, LG_POLICY_NAME, "%s", column->name);
        }
        if (column->role == LG_LOG_INPUT && column->index < LG_POLICY_INPUTS &&
            strlen(column->name) < LG_POLICY_NAME)
            (void)snprintf(task->input[column->index].name, LG_POLICY_NAME, "%s", column->name);
    }
    task->input_count = machine->input_count;
    if (machine->input_count == 0) app_stop(self, LG_FORMAT, "%s: the machine has no inputs", path);
}

/* Schemes whose steps iterate cannot be part of a program. */
static const lg_scheme *scheme_of(const lg_scheme *scheme) {
    const bool fits = scheme != NULL && scheme->kind != LG_SCHEME_VARIATIONAL &&
                      scheme->kind != LG_SCHEME_IMPLICIT && scheme->kind != LG_SCHEME_SLGI;
    return fits ? scheme : lg_scheme_find("rkmk4");
}

void control_machine_destroy(control_machine *m) {
    lg_recipe_release(&lg_recipe_machine_model, &m->model);
    lg_machine_file_destroy(&m->file);
    *m = (control_machine){.model = {.theta = NULL}};
}

static void check_known(const app *self, const char *path, const lg_machine *machine) {
    for (uint32_t i = 0; i < machine->term_count; i++)
        if (machine->terms[i].parameters > 0)
            app_stop(self, LG_FORMAT,
                     "%s: %s: a term of kind '%s' is unknown; give its values, or learn the machine with "
                     "lg-identify and name the model",
                     path, lg_machine_part_name(machine->terms[i].part),
                     lg_term_kind_name(machine->terms[i].kind));
    if (machine->parameters > 0)
        app_stop(self, LG_FORMAT,
                 "%s: numbers of the machine are unknown; learn it with lg-identify and name the model",
                 path);
}

static bool has_width(const lg_machine_term *term) {
    return (lg_term_kind_options(term->kind) & LG_TERM_WIDTH) != 0;
}

/* Dry friction sticks, whatever its width in the file, where steps can do that (lines and angles). */
static void stick(const app *self, control_machine *m) {
    APP_FREE lg_machine *kept = app_alloc(1, sizeof *kept);
    *kept = m->machine;
    for (uint32_t i = 0; i < m->machine.term_count; i++) {
        m->width[i] = m->machine.terms[i].width;
        if (has_width(&m->machine.terms[i])) m->machine.terms[i].width = 0;
    }
    APP_MUST(self, lg_machine_init(&m->machine, &error));
    if (m->machine.sticks == 0) m->machine = *kept;
}

/* false: the file is a program. */
static bool open_machine(const app *self, const char *path, control_machine *out) {
    const plant_kind kind = kind_of(self, path);
    *out = (control_machine){.model = {.theta = NULL}};
    if (kind == PROGRAM) return false;
    if (kind == MODEL) {
        APP_FILE(self, path, lg_recipe_load, NULL, &lg_recipe_machine_model, &out->model);
        const lg_machine_model_run *run = &out->model.run;
        APP_FILE(self, path, lg_machine_file_parse, run->text, strlen(run->text), &out->file);
        out->machine = run->machine, out->scheme = scheme_of(run->scheme), out->row = run->dt;
        memcpy(out->delay, run->delay, sizeof out->delay);
        stick(self, out);
        return true;
    }
    APP_FILE(self, path, lg_machine_file_read, &out->file);
    check_known(self, path, &out->file.machine);
    out->machine = out->file.machine, out->scheme = lg_scheme_find("rkmk4");
    for (uint32_t l = 0; l < out->machine.input_count; l++) {
        out->delay[l] = out->file.inputs[l].delay;
        if (out->file.inputs[l].choose_delay || out->file.inputs[l].estimate_delay)
            app_stop(self, LG_FORMAT,
                     "%s: the delay of the input %s is unknown; give its rows, or learn the machine with "
                     "lg-identify and name the model",
                     path, out->machine.inputs[l]);
    }
    stick(self, out);
    return true;
}

/* Widths of friction are at least `speed`, or so large that none is left. */
static lg_status soften(void *user, const double *speed, lg_program **out, lg_error *error) {
    const control_machine *m = user;
    APP_FREE lg_machine *soft = app_alloc(1, sizeof *soft);
    bool any = false;
    *soft = m->machine;
    *out = NULL;
    for (uint32_t i = 0; i < soft->term_count; i++) {
        if (!has_width(&soft->terms[i])) continue;
        double own = m->width[i], least = INFINITY;
        for (uint32_t k = 0; k < soft->velocities; k++) {
            own = fmax(own, lg_machine_width(soft, &soft->terms[i], k));
            least = fmin(least, speed != NULL ? speed[k] : INFINITY);
        }
        soft->terms[i].width = speed != NULL ? fmax(own, least) : 1e9 * own;
        any = true;
    }
    if (!any) return LG_OK;
    LG_TRY(lg_machine_init(soft, error));
    return lg_machine_program(m->self->context, soft, m->model.theta, m->scheme, true, out, error);
}

static lg_program *load_machine(const app *self, const char *path, const control_machine *m, bool lagged,
                                lg_policy_task *task) {
    lg_program *program = NULL;
    name_coordinates(self, path, &m->file, task);
    if (lagged) name_lagged(self, path, &m->machine, task);
    for (uint32_t l = 0; l < m->machine.input_count && l < LG_POLICY_INPUTS; l++)
        task->dead_time[l] = m->delay[l] * (m->row > 0 ? m->row : task->period);
    APP_DO(self, lg_machine_program, &m->machine, m->model.theta, m->scheme, lagged, &program);
    return program;
}

/* ---- draws ---- */

/* The largest relative change of an identified number per change of theta_i. */
static double slope_of(const lg_machine *machine, double *theta, size_t i, size_t count,
                       lg_identified *numbers) {
    static const double h = 1e-4;
    const double kept = theta[i];
    double most = 0;
    theta[i] = kept - h;
    (void)lg_machine_numbers(machine, theta, count, numbers);
    theta[i] = kept + h;
    (void)lg_machine_numbers(machine, theta, count, numbers + count);
    theta[i] = kept;
    for (size_t k = 0; k < count; k++) {
        const double low = numbers[k].value, high = numbers[count + k].value,
                     size = 0.5 * (fabs(low) + fabs(high));
        if (size > 0 && isfinite(size)) most = fmax(most, fabs(high - low) / (2 * h * size));
    }
    return most;
}

/* Adds W x to theta, x from N(0, 1), and besides changes each learned number by `spread` of its size. */
static void draw_theta(const lg_machine_model_file *model, double spread, const double *slope, lg_rng *rng,
                       double *theta) {
    const size_t n = model->parameters;
    memcpy(theta, model->theta, n * sizeof *theta);
    for (size_t j = 0; j < n; j++) {
        const double x = lg_rng_normal(rng);
        for (size_t i = 0; i < n && model->spread != NULL; i++) theta[i] += model->spread[i * n + j] * x;
    }
    for (size_t i = model->run.machine.weights; i < n; i++) {
        const double x = lg_rng_normal(rng);
        if (slope[i] > 0) theta[i] += spread * x / slope[i];
    }
}

/* Plants that the log of a fit allows as well: machines with parameters from the covariance in the model of
 * lg-identify at `path`, and with each learned number changed by `spread` of its size besides (a standard
 * deviation). The caller destroys them. Ends the command if that is no model of lg-identify, which `why`
 * needs, or has no covariance. */
static void draw_plants(const app *self, const char *path, double spread, size_t draws, const char *why,
                        lg_program **out) {
    APP_CLEAN(control_machine_destroy) control_machine m;
    lg_rng rng;
    if (kind_of(self, path) != MODEL)
        app_stop(self, LG_FORMAT,
                 "%s: %s needs a model of lg-identify, whose covariance tells what else the machine may be",
                 path, why);
    (void)open_machine(self, path, &m);
    const lg_machine_model_file *const model = &m.model;
    if (model->spread == NULL && !(spread > 0))
        app_stop(self, LG_FORMAT, "%s: the model has no covariance of its numbers; give %s", path,
                 "robust.spread, or a number for --model-error");
    const lg_machine *machine = &m.machine;
    const size_t count = lg_machine_numbers(machine, model->theta, 0, NULL);
    APP_FREE lg_identified *numbers = app_alloc(2 * count + 1, sizeof *numbers);
    APP_FREE double *theta = app_alloc(2 * model->parameters, sizeof *theta);
    double *slope = theta + model->parameters;
    for (size_t i = machine->weights; i < model->parameters; i++)
        slope[i] = slope_of(machine, model->theta, i, count, numbers);
    lg_rng_seed(&rng, self->seed, 1);
    for (size_t k = 0; k < draws; k++) {
        draw_theta(model, spread, slope, &rng, theta);
        APP_DO(self, lg_machine_program, machine, theta, m.scheme, true, &out[k]);
    }
}

void control_add_draws(const app *self, lg_policy *policy, const char *path) {
    const lg_policy_task *task = lg_policy_task_of(policy);
    if (task->draws == 0) return;
    APP_FREE lg_program **plants = app_alloc(task->draws, sizeof *plants);
    draw_plants(self, path, task->spread, task->draws, "robust.draws", plants);
    for (uint32_t k = 0; k < task->draws; k++) APP_MUST(self, lg_policy_add_draw(policy, plants[k], &error));
}

/* What the draws say about the error of the rates. */
enum { DRAWS = 40, PLACES = 1024 };

/* Rates (`held`: next states) at PLACES states z and inputs u. */
static void find_rates(const app *self, lg_policy *policy, bool held, const double *z, const double *u,
                       double *out) {
    lg_program *program = NULL;
    APP_MUST(self, lg_policy_add_rate(policy, &program, &error));
    APP_DO(self, lg_program_eval, program, held ? "advance_by_input" : "rate_by_input", PLACES,
           (const double *const[]){z, u}, (double *const[]){out});
}

void control_draw_error(const app *self, lg_policy *policy, const char *plant, bool held, const double *high,
                        double *out) {
    const lg_policy_task *task = &policy->task;
    /* Behind the inputs, the rates of what the controller remembers: 0. */
    const size_t n = policy->layout.errors, numbers = PLACES * n, m = policy->inputs + policy->memory.count;
    APP_FREE double *z = app_alloc(4 * numbers + PLACES * m, sizeof *z);
    double *first = z + numbers, *other = first + numbers, *square = other + numbers, *u = square + numbers;
    lg_program *plants[DRAWS];
    lg_rng rng;
    lg_rng_seed(&rng, self->seed, 16);
    for (size_t i = 0; i < numbers; i++) z[i] = lg_rng_uniform_in(&rng, -high[i % n], high[i % n]);
    for (size_t i = 0; i < PLACES * m; i++)
        u[i] = i % m >= task->input_count
                   ? 0
                   : lg_rng_uniform_in(&rng, task->input[i % m].low, task->input[i % m].high);
    find_rates(self, policy, held, z, u, first);
    draw_plants(self, plant, 0, DRAWS, "--model-error auto", plants);
    for (size_t k = 0; k < DRAWS; k++) {
        lg_policy *drawn = NULL;
        APP_MUST(self, lg_policy_transplant(policy, plants[k], NULL, &drawn, &error));
        find_rates(self, drawn, held, z, u, other);
        for (size_t i = 0; i < numbers; i++)
            square[i] += (other[i] - first[i]) * (other[i] - first[i]) / DRAWS;
        lg_policy_destroy(drawn);
    }
    for (size_t i = 0; i < n; i++) out[i] = 0;
    for (size_t i = 0; i < numbers; i++) out[i % n] = fmax(out[i % n], 3 * sqrt(square[i]));
}

/* ---- programs ---- */

static void name_states(const app *self, const char *path, const lg_program *program, lg_policy_task *task,
                        size_t *states) {
    size_t field, count;
    APP_MUST_FILE(self, path, lg_program_find(program, "field", &field, &error));
    const lg_port *in = lg_program_inputs(program, field, &count);
    if (count != 2) app_stop(self, LG_FORMAT, "%s: field has %zu inputs; expected field(x, u)", path, count);
    *states = lg_shape_count(in[0].shape);
    const size_t inputs = lg_shape_count(in[1].shape);
    if (*states > LG_POLICY_COORDINATES || inputs > LG_POLICY_INPUTS)
        app_stop(self, LG_UNSUPPORTED, "%s: field has %zu states and %zu inputs, more than %d and %d", path,
                 *states, inputs, LG_POLICY_COORDINATES, LG_POLICY_INPUTS);
    if (task->coordinate_count == 0)
        for (; task->coordinate_count < *states; task->coordinate_count++)
            (void)snprintf(task->coordinate[task->coordinate_count].name, LG_POLICY_NAME, "x%u",
                           task->coordinate_count + 1);
    if (task->coordinate_count != *states)
        app_stop(self, LG_FORMAT, "states: %u names, but field of %s has %zu states", task->coordinate_count,
                 path, *states);
    for (size_t l = 0; l < inputs; l++)
        (void)snprintf(task->input[l].name, LG_POLICY_NAME, inputs == 1 ? "u" : "u%zu", l + 1);
    task->input_count = (uint32_t)inputs;
}

static lg_program *load_program(const app *self, const char *path, lg_policy_task *task) {
    lg_program *program = NULL;
    lg_space space;
    size_t states, step;
    APP_FILE(self, path, lg_program_load, NULL, &program);
    name_states(self, path, program, task, &states);
    APP_MUST(self, lg_space_init_rn(&space, states));
    if (lg_program_find(program, "step", &step, NULL) != LG_OK)
        APP_MUST(self, lg_program_add_step(program, &space, lg_scheme_find("rk4"), 1e-3 * task->period,
                                           1.0 + task->period, &error));
    return program;
}

/* ---- */

lg_program *control_load_plant(const app *self, const char *path, bool lagged, lg_policy_task *task,
                               control_machine *machine) {
    app_reads(self, path);
    return open_machine(self, path, machine) ? load_machine(self, path, machine, lagged, task)
                                             : load_program(self, path, task);
}

lg_program *control_read_task(const app *self, const char *path, lg_policy_task *task, char **text,
                              char **source, control_machine *keep) {
    char plant[512];
    APP_FILE(self, path, lg_policy_task_read, task, plant, sizeof plant, text);
    *source = app_format("%.*s%s", plant[0] == '/' ? 0 : (int)(app_name_of(path) - path), path, plant);
    lg_program *program = control_load_plant(self, *source, true, task, keep);
    APP_FILE(self, path, lg_policy_task_parse, *text, task);
    keep->self = self;
    if (keep->scheme != NULL) task->soften = soften, task->soften_user = keep;
    return program;
}
