/* Learned machines as C: energy, gradient, field, one step of a scheme with a held input, states from what a
 * log has, and the linearisation. These are functions of the machine's program; the code around them is that
 * of Hamiltonians. */
#include "lg-export/export.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "liegrad/machine_model.h"

typedef struct job {
    const app *self;
    const lg_machine_model_run *run;
    const lg_machine_model_file *trained;
    const lg_model *model;
    export_source *source;
    lg_space space;
    lg_program *program;
    bool linearise;
    size_t tangent;
} job;

static const char linearise_declaration[] =
    "\n/* The linearisation c' = A c + B du at (state, input), or NULL for no input: A (TANGENT, TANGENT), B "
    "(TANGENT,\n"
    " * INPUT_SIZE); each may be NULL. Coordinates c: places; of each direction with e_1, e_2 orthogonal to "
    "q those of\n"
    " * dq and of dp (e_1: the axis of the smallest |q_i| made orthogonal, e_2 = q x e_1); of each rotation "
    "a with\n"
    " * dR = R hat(a); momenta. The frames are held fixed. */\n"
    "void NAME_linearise(const NAME_real *state, const NAME_real *input, NAME_real *A, NAME_real *B,\n"
    "                    NAME_real *work);\n";

/* ---- what NAME.h says ---- */

static void tell_state_and_inputs(const job *j) {
    export_source *source = j->source;
    const uint32_t inputs = j->run->machine.input_count;
    export_tell_machine(source, j->run);
    export_tell_numbers(&source->about, "state", j->space.dim, source->state.data);
    char *words = inputs > 0 ? app_format("%s as in the log; NULL for zeros", source->input.data)
                             : app_format("none: NULL");
    export_tell_numbers(&source->about, "input", inputs, words);
    free(words);
    if (source->delay.length > 0) lg_text_add(&source->about, "delay         %s\n", source->delay.data);
}

static void tell_training(const job *j) {
    const lg_machine_model_run *run = j->run;
    const double *loss = j->trained->history[LG_FIT_LOSS];
    const size_t done = j->trained->epochs_done;
    text *about = &j->source->about;
    lg_text_add(
        about,
        "\ntrained on    %llu windows of %u rows %g apart, through %s with %u step%s between two rows\n",
        (unsigned long long)run->windows, run->window, run->dt, run->scheme->name, run->substeps,
        run->substeps == 1 ? "" : "s");
    if (done > 0 && loss != NULL && isfinite(loss[done - 1]))
        lg_text_add(about, "last loss     %.4e (in the units of the noise or of the motion, squared)\n",
                    loss[done - 1]);
    export_provenance(j->source, &j->trained->provenance, run->data_sha256);
}

static const char words_of_field[] = "an element of the algebra: rates of places, omega and moment of each "
                                     "direction, R Omega of each rotation, "
                                     "rates of momenta";

static void tell(const job *j, size_t evaluations) {
    const lg_machine *machine = &j->run->machine;
    text *about = &j->source->about;
    lg_text_add(about, "Learned machine with inputs and damping; liegrad/machine.h has the equations.\n\n");
    tell_state_and_inputs(j);
    export_tell_numbers(about, "field", j->space.algebra_dim, words_of_field);
    export_tell_numbers(about, "positions", machine->positions, "in the order of the log, R by rows");
    export_tell_numbers(about, "velocities", machine->velocities, "in the order of the log");
    export_units(j->source, "those of the log; momenta are mass times velocity");
    lg_text_add(about,
                "manifold      A state off it is not projected; steps keep the distance but for rounding.\n");
    export_tell_scheme(about, j->source->options->scheme, evaluations, "field");
    if (j->source->condition > 1.0)
        lg_text_add(about,
                    "condition     %.1f: by how much the machine multiplies rounding, and the tolerance\n",
                    j->source->condition);
    export_tell_range(about, j->run);
    tell_training(j);
    export_size(j->source, "STATE_SIZE", j->space.dim, "numbers in state and next");
    export_size(j->source, "FIELD_SIZE", j->space.algebra_dim, "numbers in field");
    export_size(j->source, "INPUT_SIZE", machine->input_count, "numbers in an input");
    export_size(j->source, "POSITIONS", machine->positions, "in the order of the log");
    export_size(j->source, "VELOCITIES", machine->velocities, "likewise");
    export_size(j->source, "STEP_EVALUATIONS", evaluations, "of the field in a step");
    lg_text_add_named(&j->source->declarations, j->source->options->name, export_motion_declarations);
    if (!j->linearise) return;
    export_size(j->source, "TANGENT", j->tangent, "coordinates of the linearisation");
    lg_text_add_named(&j->source->declarations, j->source->options->name, linearise_declaration);
}

/* ---- golden vectors ---- */

/* Numbers of `extra`: field, step, positions, velocities, state; A and B. */
static size_t motion_of(const job *j) {
    return j->space.algebra_dim + 2 * j->space.dim + j->run->machine.positions + j->run->machine.velocities;
}

static size_t extras_of(const job *j) {
    return motion_of(j) + (j->linearise ? j->tangent * (j->tangent + j->run->machine.input_count) : 0);
}

static double draw_in(const lg_machine_range *range, size_t at, lg_rng *rng) {
    const double low = range->low[at], high = range->high[at];
    const bool known = low < high && isfinite(low) && isfinite(high);
    return known ? lg_rng_uniform_in(rng, low, high) : lg_rng_uniform_in(rng, -1.0, 1.0);
}

/* Directions and rotations anywhere: a random element acts on upright ones. */
static void draw_attitudes(const job *j, lg_rng *rng, double *x) {
    const lg_machine *machine = &j->run->machine;
    double *element = app_alloc(j->space.algebra_dim, sizeof *element), *at = x + machine->places;
    for (size_t k = 0; k < j->space.dim; k++) x[k] = 0.0;
    for (uint32_t i = 0; i < machine->directions; i++, at += 6) at[2] = 1.0;
    for (uint32_t i = 0; i < machine->rotations; i++, at += 9) at[0] = at[4] = at[8] = 1.0;
    for (size_t k = 0; k < j->space.algebra_dim; k++) element[k] = lg_rng_normal(rng);
    lg_space_act(&j->space, element, x, x);
    free(element);
}

/* A state of positions and velocities within the data, directions and rotations anywhere; numbers of the
 * exported type. */
static void draw_state(const job *j, lg_rng *rng, double *x, void *work) {
    const lg_machine *machine = &j->run->machine;
    double q[LG_MACHINE_POSITIONS], v[LG_MACHINE_VELOCITIES];
    uint32_t at = 0;
    draw_attitudes(j, rng, x);
    (void)lg_model_machine_positions(j->model, x, q, work);
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        for (uint32_t k = 0; k < lg_coordinate_row_of(kind)->places; k++)
            q[at + k] = draw_in(&j->run->range, at + k, rng);
        at += lg_coordinate_positions(kind);
    }
    for (uint32_t k = 0; k < machine->velocities; k++) v[k] = draw_in(&j->run->range, at + k, rng);
    (void)lg_model_machine_state(j->model, q, v, x, work);
    for (size_t k = 0; k < j->space.dim; k++) x[k] = export_round(j->source->options, x[k]);
}

static void draw_golden(const job *j, double *input, void *work) {
    const lg_machine *machine = &j->run->machine;
    lg_rng rng;
    lg_rng_seed(&rng, j->source->options->seed, 0);
    for (size_t i = 0; i < j->source->golden.count; i++)
        draw_state(j, &rng, j->source->golden.x + i * j->space.dim, work);
    for (uint32_t k = 0; k < machine->input_count; k++)
        input[k] = export_round(j->source->options,
                                draw_in(&j->run->range, machine->positions + machine->velocities + k, &rng));
}

/* All but the step; then the step of *h, which is chosen between. */
static lg_status compute_golden(const job *j, const double *input, void *work, lg_stepper *stepper,
                                double *h) {
    const export_golden *golden = &j->source->golden;
    const size_t d = j->space.dim, all = extras_of(j), a = j->space.algebra_dim;
    lg_status status = LG_OK;
    for (size_t i = 0; i < golden->count && status == LG_OK; i++) {
        const double *x = golden->x + i * d;
        double *field = golden->extra + i * all, *q = field + a + d, *v = q + j->run->machine.positions;
        lg_model_jacobian(j->model, x, golden->y + i, golden->jacobian + i * d, work);
        status = lg_model_field(j->model, x, input, field, work);
        (void)lg_model_machine_positions(j->model, x, q, work);
        (void)lg_model_machine_velocities(j->model, x, v, work);
        (void)lg_model_machine_state(j->model, q, v, v + j->run->machine.velocities, work);
        double *A = field + motion_of(j);
        if (j->linearise)
            (void)lg_model_linearise(j->model, x, input, A, A + j->tangent * j->tangent, NULL, work);
    }
    *h = export_golden_step(j->source, j->run->dt, a);
    for (size_t i = 0; i < golden->count && status == LG_OK; i++)
        status = lg_step(stepper, 0.0, *h, golden->x + i * d, input, golden->extra + i * all + a);
    return status;
}

static lg_status golden_vectors(const job *j, double *input, double *h) {
    const lg_scheme *scheme = j->source->options->scheme;
    const size_t bytes = lg_model_stepper_size(j->model, scheme);
    void *memory = app_alloc(bytes > 0 ? bytes : 1, 1), *work = app_alloc(lg_model_work_size(j->model), 1);
    lg_stepper *stepper;
    export_golden_make(j->source, true, extras_of(j), "field, step, states");
    draw_golden(j, input, work);
    lg_status status = lg_model_stepper_init(j->model, scheme, &stepper, memory, bytes);
    if (status == LG_OK) status = compute_golden(j, input, work, stepper, h);
    if (status == LG_OK)
        export_write_motion(j->source, input, j->run->machine.input_count, *h, "test_machine");
    if (status == LG_OK) export_test_code(j->source, j->linearise ? "test_linearise" : "test_plain");
    free(work);
    free(memory);
    return status;
}

/* ---- condition ---- */

/* By how much gradient, field and step multiply rounding at the golden states. */
static lg_status find_condition(const job *j, const double *input, double h, lg_error *error) {
    static const char *const names[] = {"grad", "field", "step"};
    const export_golden *golden = &j->source->golden;
    const size_t d = j->space.dim, m = j->run->machine.input_count, most = d + m + 1;
    double *x = app_alloc(golden->count * most, sizeof *x);
    lg_status status = LG_OK;
    for (size_t f = 0; f < LG_COUNT(names) && status == LG_OK; f++) {
        size_t function, at = 0;
        double found = 1.0;
        for (size_t i = 0; i < golden->count; i++) {
            for (size_t k = 0; k < d; k++) x[at++] = (double)(float)golden->x[i * d + k];
            for (size_t k = 0; k < m && f > 0; k++) x[at++] = (double)(float)input[k];
            if (f == 2) x[at++] = (double)(float)h;
        }
        status = lg_program_find(j->program, names[f], &function);
        if (status == LG_OK)
            status =
                export_amplification(j->program, function, x, golden->count, j->source->depth, &found, error);
        if (status == LG_OK && isfinite(found)) j->source->condition = fmax(j->source->condition, found);
    }
    free(x);
    return status;
}

/* ---- code ---- */

/* Bytes of the frames of code/hamiltonian and code/machine, gcc and clang, -O0 to -O3, and how many there
 * are. */
enum { STACK = 1024, CALLS = 4 };

/* In the table below; a step's depth is not that of its rounding, since h is small. */
enum { STEP = 3 };

/* The linearisation in coordinates; `work`: of the Jacobian. */
static void add_linearise(const job *j, size_t work) {
    const size_t d = j->space.dim, m = j->run->machine.input_count;
    export_source *source = j->source;
    if (m == 0) export_constant(source, "INPUT", 0);
    export_constant(source, "TANGENT", j->tangent);
    export_code(source, m > 0 ? "linear_forced" : "linear_unforced");
    lg_text_add(&source->code, "\n");
    export_code(source, "linearise");
    work += d * (d + m + 1) + j->tangent;
    if (work > source->work) source->work = work;
    source->stack += STACK;
}

static int add_code(const job *j) {
    export_source *source = j->source;
    const lg_machine *machine = &j->run->machine;
    export_function functions[] = {{.function = "value", .name = "eval"},
                                   {.function = "grad", .name = "grad"},
                                   {.function = "field", .name = "flow", .hidden = true},
                                   {.function = "step", .name = "advance", .hidden = true},
                                   {.function = "momenta", .name = "state"},
                                   {.function = "velocities", .name = "velocities"},
                                   {.function = "positions", .name = "positions"},
                                   {.function = "jac_velocity", .name = "linear", .hidden = true}};
    const size_t count = LG_COUNT(functions) - !j->linearise, d = j->space.dim;
    const int code = export_bundle(j->self, source, j->program, true, functions, count);
    if (code != APP_EXIT_OK) return code;
    source->depth = 1;
    for (size_t i = 0; i < count; i++)
        if (i != STEP && functions[i].depth > source->depth) source->depth = functions[i].depth;
    lg_text_add(&source->code, "\n");
    export_constant(source, "STATE", j->space.dim);
    if (machine->input_count > 0) export_constant(source, "INPUT", machine->input_count);
    export_arrive(source, &j->space, j->linearise);
    export_code(source, machine->input_count > 0 ? "forced" : "unforced");
    lg_text_add(&source->code, "\n");
    export_code(source, "hamiltonian");
    source->work += d;
    if (j->linearise) add_linearise(j, functions[count - 1].work);
    source->stack += STACK;
    source->calls += CALLS;
    return APP_EXIT_OK;
}

static size_t evaluations_of(const lg_program *program) {
    size_t step, field;
    const bool has = lg_program_find(program, "step", &step) == LG_OK &&
                     lg_program_find(program, "field", &field) == LG_OK;
    return has ? lg_program_calls(program, step, field) : 0;
}

static int export_parts(const job *j) {
    const char *path = j->self->arguments[0];
    double input[LG_MACHINE_INPUTS], h = 0.0;
    lg_error error = {LG_OK, ""};
    const int code = add_code(j);
    if (code != APP_EXIT_OK) return code;
    lg_status status = golden_vectors(j, input, &h);
    if (status != LG_OK)
        return app_fail(j->self, status, "%s: golden vectors of its field and step: %s", path,
                        lg_status_sentence(status));
    status = find_condition(j, input, h, &error);
    if (status != LG_OK) return app_fail_file(j->self, status, &error, path);
    tell(j, evaluations_of(j->program));
    export_warn_delay(j->self, j->source);
    return APP_EXIT_OK;
}

/* --functions: what there is beside the functions that every machine has. */
static int choose_functions(const app *self, const char *functions, bool *linearise) {
    *linearise = functions != NULL;
    if (functions == NULL || strcmp(functions, "linearise") == 0) return APP_EXIT_OK;
    return app_usage(self,
                     "--functions: '%s'; of a machine only linearise can be had beside what it always has",
                     functions);
}

int export_machine(const app *self, const lg_model_file *file, export_source *source) {
    const lg_machine_model_file *trained = lg_model_file_of(file, &lg_recipe_machine_model);
    job j = {.self = self, .run = &trained->run, .trained = trained, .model = file->model, .source = source};
    const lg_machine *machine = &j.run->machine;
    const lg_scheme *scheme = source->options->scheme;
    lg_error error = {LG_OK, ""};
    (void)lg_machine_space(machine, &j.space);
    j.tangent = lg_model_tangent_dim(file->model);
    int code = choose_functions(self, source->options->functions, &j.linearise);
    if (code == APP_EXIT_OK) code = export_check_scheme(self, &j.space, false, scheme);
    if (code != APP_EXIT_OK) return code;
    const lg_status status = lg_model_file_program(file, scheme, &j.program, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    source->inputs = j.space.dim;
    source->outputs = 1;
    source->parameters = machine->parameters;
    code = export_parts(&j);
    lg_program_destroy(j.program);
    return code;
}
