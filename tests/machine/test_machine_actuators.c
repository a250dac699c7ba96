/* Curves and dead zones of inputs, and how `lag` and `curve` are read. */
#include "support/io_test.h"
#include "support/machine_support.h"

#include "machine/internal.h"

RELEASES(release_file, lg_machine_file_destroy)

#define BEFORE                                                                                               \
    "coordinates: [{name: x, kind: line, velocity: v}]\nmass: {kind: known, values: [1]}\n"                  \
    "input_map: {kind: known, values: [[2, 3]]}\ninputs: {columns: [u, w], "

static const lg_machine_file *parse(const char *rest) {
    lg_machine_file *file = TEST_ARRAY(lg_machine_file, 1);
    const char *text = test_text("%s%s}\n", BEFORE, rest);
    assert_told(lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), file, &told));
    lg_test_owns(file, release_file);
    return file;
}

/* ---- reading ---- */

TEST("lags and curves are read for all inputs or one by one, and inputs of one kind share a term") {
    const lg_machine *all = &parse("lag: unknown, curve: {degree: 2}")->machine;
    assert_int_equal(all->term_count, 4);
    assert_int_equal(all->parameters, 4);
    assert_int_equal(all->lags, 2);
    const lg_machine *each =
        &parse("lag: [none, 0.3], curve: [{dead_zone: 0.5, degree: 3, values: [0.1, 0.2]}, none]")->machine;
    assert_int_equal(each->term_count, 5);
    assert_int_equal(each->parameters, 0);
    assert_int_equal(each->lags, 1);
    assert_int_equal(each->lagged[0], 1);
    assert_true(each->terms[2].values[0] == 0.3 && each->terms[3].values[0] == 0.5);
    assert_true(each->terms[4].values[0] == 0.1 && each->terms[4].values[1] == 0.2);
    assert_int_equal(each->terms[4].of[0].index, 0);
    const lg_machine *none = &parse("lag: none, curve: none")->machine;
    assert_int_equal(none->term_count, 2);
    assert_int_equal(none->lags, 0);
}

TEST("a known lag does not fix the common factor of masses and forces") {
    static const char text[] = "coordinates: [{name: x, kind: line, velocity: v}]\n"
                               "inputs: {columns: u, lag: 0.2, curve: {dead_zone: 0.1}}\n";
    lg_machine_file *file = TEST_ARRAY(lg_machine_file, 1);
    assert_told(lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), file, &told));
    lg_test_owns(file, release_file);
    assert_true(file->machine.normalised);
}

TEST("wrong lags and curves are refused with their line") {
    static const char *const wrong[][2] = {
        {"lag: 0", "0 is outside (0"},
        {"lag: -1", "-1 is outside (0"},
        {"lag: soon", "inputs.lag"},
        {"lag: [0.1]", "one for each of the 2 inputs"},
        {"lag: [0.1, 0.2, 0.3]", "one for each of the 2 inputs"},
        {"curve: bent", "expected none, {degree: 2}"},
        {"curve: {degree: 4}", "degree"},
        {"curve: {degree: 1}", "degree"},
        {"curve: {}", "needs key 'degree' or key 'dead_zone'"},
        {"curve: {dead_zone: -1}", "dead_zone"},
        {"curve: {dead_zone: 1, values: 2}", "needs key 'degree'"},
        {"curve: {degree: 3, values: 2}", "values"},
        {"curve: {width: 2}", "width"},
    };
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        lg_error error = {LG_OK, ""};
        lg_machine_file file;
        const char *text = test_text("%s%s}\n", BEFORE, wrong[i][0]);
        const lg_status status =
            lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), &file, &error);
        if (status != LG_FORMAT) fail_msg("%s: %s (%s)", wrong[i][0], lg_status_name(status), error.message);
        assert_says(error.message, "line 4");
        assert_says(error.message, wrong[i][1]);
    }
}

/* ---- forces ---- */

/* The force of the input map on the line for the inputs u, all in the units of the log. */
static double force_of(const lg_machine *machine, const double *theta, double u, double w) {
    lg_tape *tape = test_tape(LG_F64);
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS];
    double f;
    const lg_machine_scales *s = &machine->scales;
    const double zero = 0, inputs[2] = {u / s->input[0], w / s->input[1]};
    const uint32_t n = (uint32_t)machine->parameters;
    assert_ok(
        lg_machine_bind(tape, machine, n > 0 ? lg_parameter(tape, lg_shape1(n), theta) : LG_NONE, &vars));
    const lg_var still = lg_input_f64(tape, lg_shape2(1, 1), &zero);
    assert_ok(lg_machine_record_state(tape, &vars, still, still, parts));
    assert_ok(lg_read(tape,
                      lg_machine_record_force(tape, &vars, LG_MACHINE_INPUT_MAP, parts, still,
                                              lg_input_f64(tape, lg_shape2(1, 2), inputs)),
                      1, &f));
    return f * s->energy / s->velocity[0];
}

TEST("the input map gets u + c2 u^2 + c3 u^3, and what is beyond a dead zone, at any scales") {
    static const double scales[][4] = {{1, 1, 1, 1}, {0.7, 1.9, 2, 3}, {1e9, 1e-9, 1e9, 1e-9}};
    static const double us[] = {-2, -0.5, -0.3, 0.1, 0.49, 0.51, 3};
    for (size_t k = 0; k < LG_COUNT(scales); k++)
        for (size_t i = 0; i < LG_COUNT(us); i++) {
            lg_machine machine =
                parse("curve: [{degree: 3, values: [0.1, -0.2]}, {dead_zone: 0.5, degree: 2, values: 0.3}]")
                    ->machine;
            machine.scales.time = scales[k][0], machine.scales.energy = scales[k][1];
            machine.scales.input[0] = scales[k][2], machine.scales.input[1] = scales[k][3];
            const double u = us[i], w = -u, d = fabs(w) > 0.5 ? w - copysign(0.5, w) : 0;
            const double want = 2 * (u + 0.1 * u * u - 0.2 * u * u * u) + 3 * (d + 0.3 * d * d);
            assert_close(force_of(&machine, NULL, u, w), want, 1e-12, 1e-12);
        }
}
