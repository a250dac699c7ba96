/* The models of examples/programs/, trained and differentiated, for tests of their C. */
#ifndef LG_TEST_OUTSIDE_MODELS_H
#define LG_TEST_OUTSIDE_MODELS_H

#include "../../examples/programs/programs.h"
#include "apps/export_outside.h"

typedef struct model {
    const char *name, *function;
    lg_status (*make)(lg_program **out, training *how, lg_error *error);
    double condition; /* by how much the function and its derivatives multiply rounding: none of these do */
    bool kinks;
} model;
static const model models[] = {{"throw", "value", make_throw, 1, false},
                               {"driven", "step", make_driven, 1, false},
                               {"attitude", "step", make_attitude, 1, false},
                               {"waveforms", "value", make_waveforms, 1, true}};

static inline lg_program *model_program(const model *m) {
    lg_program *program = NULL;
    training how;
    lg_error error = {.status = LG_OK};
    if (m->make(&program, &how, &error) != LG_OK) fail_msg("%s: %s", m->name, error.message);
    assert_true(use(program, m->function));
    return program;
}

/* What single precision has: the reference computes in double precision from the same weights. */
static inline void model_round(lg_program *program) {
    for (size_t k = 0; k < lg_program_parameters(program); k++) {
        const lg_parameter_spec p = lg_program_parameter(program, k);
        const size_t count = lg_shape_count(p.shape);
        double *rounded = malloc(count * sizeof *rounded);
        assert_non_null(rounded);
        for (size_t i = 0; i < count; i++) rounded[i] = (double)(float)p.values[i];
        assert_ok(lg_program_set_parameter(program, k, rounded));
        free(rounded);
    }
}

static inline void model_compare(const model *m, lg_program *program, const char *compiler, const char *flags,
                                 lg_dtype dtype, size_t points) {
    char command[64];
    (void)snprintf(command, sizeof command, "command -v %s >/dev/null", compiler);
    if (system(command) != 0) return;
    outside o = outside_compile(program, compiler, flags, dtype);
    print_message("%s, %s, %s %s:\n", m->name, dtype == LG_F32 ? "f32" : "f64", compiler, flags);
    assert_int_equal(o.source->functions, lg_program_functions(program));
    for (size_t i = 0; i < o.source->functions; i++)
        outside_compare(&o, program, i, points, m->condition, m->kinks);
    outside_discard(&o);
}

/* All models: what `check` says, in double precision, then with weights rounded to single precision. */
static inline void model_for_each(void (*check)(const model *m, lg_program *program, lg_dtype dtype)) {
    for (size_t k = 0; k < LG_COUNT(models); k++) {
        lg_program *program = model_program(&models[k]);
        check(&models[k], program, LG_F64);
        model_round(program);
        check(&models[k], program, LG_F32);
        lg_program_destroy(program);
    }
}

#endif
