/* Fields and energies in double that are made of their recordings: straight C, which test_fields writes from
 * them into fields/written.inc, or plans for systems that the file does not have. */
#include <math.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "integrators/taped_internal.h"
#include "mechanics/fields/scalars.h"
#include "mechanics/system.h"

enum { FIELD, ENERGY, FUNCTIONS };

typedef struct lg_written {
    const char *name, *form; /* of the system */
    /* From y, parameters and t; NULL: the row has no taped energy. `work`: doubles that they need. */
    void (*function[FUNCTIONS])(const double *y, const double *parameters, const double *t, double *out,
                                double *work);
    size_t work;
} lg_written;

#define FIELD_NUMBER(x) (x)
#define FIELD_SQRT      sqrt
#define FIELD_SIN       sin
#define FIELD_COS       cos
#include "mechanics/fields/written.inc"

static const lg_written written[] = {LG_WRITTEN_SYSTEMS};

/* ---- recording ---- */

static lg_status record_field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_system *system = user;
    lg_var parts[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS];
    LG_TRY(lg_taped_split(tape, &system->space, in[0], parts));
    LG_TRY(system->row->taped(system, tape, (lg_taped_time){.rows = in[2]}, parts, LG_NONE, in[1], algebra));
    out[0] = lg_taped_join_algebra(tape, &system->space, algebra);
    return lg_tape_status(tape);
}

static lg_status record_energy(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,
                               lg_var *out) {
    const lg_system *system = user;
    lg_var parts[LG_TAPED_MAX_PARTS];
    LG_TRY(lg_taped_split(tape, &system->space, in[0], parts));
    out[0] = system->row->taped_energy(system, tape, parts, in[1]);
    return lg_tape_status(tape);
}

lg_status lg_recorded_program(const lg_system *system, lg_program **out, lg_error *error) {
    void *const user = (void *)(uintptr_t)system; /* never written */
    const lg_shape numbers = lg_shape1((uint32_t)system->parameter_count);
    const lg_port in[] = {{.name = "y", .shape = lg_shape1((uint32_t)system->space.dim), .high = 1},
                          {.name = "parameters", .shape = numbers, .shared = true, .low = 0.5, .high = 1},
                          {.name = "t", .shape = lg_shape1(1)}},
                  result = {.name = "out"};
    const lg_function_spec functions[] = {{"field", in, LG_COUNT(in), &result, 1, record_field, user},
                                          {"energy", in, LG_COUNT(in), &result, 1, record_energy, user}};
    return lg_program_of(system->context, functions, system->row->taped_energy != NULL ? FUNCTIONS : 1, out,
                         error);
}

lg_status lg_recorded_create(lg_system *system) {
    const lg_system_row *row = system->row;
    lg_program *program;
    system->written = NULL;
    memset(system->plan, 0, sizeof system->plan);
    if (row->field[LG_COORDINATES_LIE] != lg_recorded_field) return LG_OK;
    for (size_t i = 0; i < LG_COUNT(written) && system->written == NULL; i++)
        if (strcmp(written[i].name, row->name) == 0 &&
            (row->form == NULL || strcmp(written[i].form, row->form) == 0))
            system->written = &written[i];
    if (system->written != NULL) return LG_OK;
    LG_TRY(lg_recorded_program(system, &program, NULL));
    lg_status status = LG_OK;
    for (size_t i = 0; i < lg_program_functions(program) && status == LG_OK; i++)
        status = lg_plan_create(program, i, NULL, &system->plan[i], NULL);
    lg_program_destroy(program);
    return status;
}

/* ---- evaluation ---- */

/* The work of a plan begins at a multiple of 64 bytes. */
size_t lg_recorded_work(const lg_system *system) {
    size_t most = 0;
    for (int i = 0; i < FUNCTIONS; i++) {
        const size_t bytes = system->plan[i] != NULL ? lg_plan_work_size(system->plan[i]) + 64 : 0;
        most = bytes > most ? bytes : most;
    }
    return system->written != NULL ? system->written->work : most / sizeof(double);
}

static void evaluate(const lg_system *system, int function, double t, const double *y, double *out,
                     double *work) {
    const uintptr_t from = ((uintptr_t)work + 63) & ~(uintptr_t)63;
    if (system->written != NULL)
        system->written->function[function](y, system->parameters, &t, out, work);
    else
        lg_plan_eval(system->plan[function], (const void *[]){y, system->parameters, &t}, (void *[]){out},
                     (void *)from);
}

lg_status lg_recorded_field(void *user, double t, const double *y, const double *input, double *out) {
    const lg_system_user *own = user;
    evaluate(own->system, FIELD, t, y, out, own->work);
    return LG_OK;
}

double lg_recorded_energy(const lg_system *system, size_t index, const double *y, double *work) {
    double out;
    evaluate(system, ENERGY, 0.0, y, &out, work);
    return out;
}
