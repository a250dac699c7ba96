/* Fields and energies in double that are made of their recordings: straight C, which test_fields writes from
 * them into fields/written.inc, or plans for systems that the file does not have. */
#include <math.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "integrators/taped_internal.h"
#include "mechanics/fields/scalars.h"
#include "mechanics/system.h"

enum { FIELD, ENERGY, FUNCTIONS };
enum { VELOCITY, FORCE }; /* of separable systems, with the indices of FIELD and ENERGY */

typedef struct lg_written {
    const char *name, *form; /* of the system */
    /* From y (separable systems: p for the velocity, q for the force), parameters and t. NULL: the row has no
     * taped energy. `work`: doubles that they need. */
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

#define HALF(name)                                                                                           \
    static lg_status record_##name(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,         \
                                   lg_var *out) {                                                            \
        out[0] = ((const lg_system *)user)->row->taped_##name(tape, in[0], in[1]);                           \
        return lg_tape_status(tape);                                                                         \
    }
HALF(velocity)
HALF(force)

lg_status lg_recorded_program(const lg_system *system, lg_program **out, lg_error *error) {
    void *const user = (void *)(uintptr_t)system; /* never written */
    const bool halves = system->row->force != NULL;
    const lg_shape numbers = lg_shape1((uint32_t)system->parameter_count),
                   state = lg_shape1((uint32_t)system->space.dim / (halves ? 2 : 1));
    const lg_port in[] = {{.name = "y", .shape = state, .high = 1},
                          {.name = "parameters", .shape = numbers, .shared = true, .low = 0.5, .high = 1},
                          {.name = "t", .shape = lg_shape1(1)}},
                  result = {.name = "out"};
    const lg_function_spec functions[] = {{"field", in, LG_COUNT(in), &result, 1, record_field, user},
                                          {"energy", in, LG_COUNT(in), &result, 1, record_energy, user},
                                          {"velocity", in, LG_COUNT(in), &result, 1, record_velocity, user},
                                          {"force", in, LG_COUNT(in), &result, 1, record_force, user}};
    return lg_program_of(system->context, functions + (halves ? FUNCTIONS : 0),
                         halves || system->row->taped_energy != NULL ? FUNCTIONS : 1, out, error);
}

lg_status lg_recorded_create(lg_system *system) {
    const lg_system_row *row = system->row;
    lg_program *program;
    system->written = NULL;
    system->recorded_work = 0;
    memset(system->plan, 0, sizeof system->plan);
    if (row->field[LG_COORDINATES_LIE] != lg_recorded_field && row->force != lg_recorded_force) return LG_OK;
    for (size_t i = 0; system->links == 0 && i < LG_COUNT(written) && system->written == NULL; i++)
        if (strcmp(written[i].name, row->name) == 0 &&
            (row->form == NULL || strcmp(written[i].form, row->form) == 0))
            system->written = &written[i];
    if (system->written != NULL) {
        system->recorded_work = system->written->work;
        return LG_OK;
    }
    LG_TRY(lg_recorded_program(system, &program, NULL));
    lg_status status = LG_OK;
    for (size_t i = 0; i < lg_program_functions(program) && status == LG_OK; i++) {
        status = lg_plan_create(program, i, NULL, &system->plan[i], NULL);
        if (status != LG_OK) break;
        const size_t bytes = lg_plan_work_size(system->plan[i]) + 64; /* the plan's work is aligned */
        if (bytes / sizeof(double) > system->recorded_work) system->recorded_work = bytes / sizeof(double);
    }
    lg_program_destroy(program);
    return status;
}

/* ---- evaluation ---- */

static void evaluate(const lg_system *system, int function, double t, const double *y, double *out,
                     double *work) {
    const uintptr_t from = ((uintptr_t)work + 63) & ~(uintptr_t)63;
    if (system->written != NULL)
        system->written->function[function](y, system->parameters, &t, out, work);
    else
        lg_plan_eval(system->plan[function], (const void *[]){y, system->parameters, &t}, (void *[]){out},
                     (void *)from);
}

#define RECORDED(name, function)                                                                             \
    lg_status name(void *user, double t, const double *y, const double *input, double *out) {                \
        const lg_system_user *own = user;                                                                    \
        evaluate(own->system, function, t, y, out, own->work);                                               \
        return LG_OK;                                                                                        \
    }
RECORDED(lg_recorded_field, FIELD)
RECORDED(lg_recorded_velocity, VELOCITY)
RECORDED(lg_recorded_force, FORCE)

double lg_recorded_energy(const lg_system *system, size_t index, const double *y, double *work) {
    double out;
    evaluate(system, ENERGY, 0.0, y, &out, work);
    return out;
}
