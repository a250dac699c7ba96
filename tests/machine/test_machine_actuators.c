/* Curves and dead zones of inputs, and how `lag` and `curve` are read. */
#include "support/io_test.h"
#include "support/machine_support.h"

#include "machine/files/choice.h"
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

TEST("a lag of second order is a candidate in place of a lag that is learned, and not of one that is known") {
    static const struct {
        const char *lag;
        bool open;
    } rows[] = {{"lag: none", true},
                {"lag: unknown", true},
                {"lag: [none, {start: 0.3}]", true},
                {"lag: [none, 0.3]", false},
                {"lag: [unknown, 0.3]", false}};
    const lg_candidate *second = lg_candidates;
    while (strcmp(second->name, "second-order lag") != 0) second++;
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        assert_int_equal(second->applies(parse(rows[i].lag), second), rows[i].open);
}

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
    const lg_machine *second =
        &parse("lag: [{order: 2}, {order: 2, start: 0.3, within: [0.1, 2], sigma: 1}]")->machine;
    assert_int_equal(second->parameters, 2);
    assert_int_equal(second->lags, 4);
    assert_true(second->lagged[1] == 0 && second->lagged[2] == 1);
    assert_string_equal(lg_term_kind_name(second->terms[2].kind), "second_order_lag");
    assert_true(second->terms[2].value_count == 0 && second->terms[3].values[0] == 0.3);
    const lg_machine *mixed = &parse("lag: [{order: 1, value: 0.2}, {order: 2, value: 0.4}]")->machine;
    assert_int_equal(mixed->parameters, 0);
    assert_int_equal(mixed->lags, 3);
    assert_true(mixed->terms[2].values[0] == 0.2 && mixed->terms[3].values[0] == 0.4);
    const lg_machine *none = &parse("lag: none, curve: none")->machine;
    assert_int_equal(none->term_count, 2);
    assert_int_equal(none->lags, 0);
}

static double number_of(const lg_machine *machine, const double *theta, const char *name) {
    lg_identified numbers[8];
    const size_t count = lg_machine_numbers(machine, theta, 8, numbers);
    for (size_t i = 0; i < count; i++)
        if (strcmp(numbers[i].name, name) == 0) return numbers[i].value;
    fail_msg("%s is not among the numbers", name);
    return 0;
}

TEST("numbers of actuators have starts, bounds and priors, and stay in their bounds") {
    lg_machine machine =
        parse(
            "lag: [{start: 0.1, within: [0.02, 0.5], sigma: 0.05}, 0.3], curve: [{dead_zone: {start: 0.4}}, "
            "{degree: 3, values: [{start: 0.2, within: [-1, 1]}, {start: 0.7}]}]")
            ->machine;
    machine.scales.input[0] = 7, machine.scales.input[1] = 1e3, machine.scales.time = 0.3;
    machine.scales.lag[0] = 0.25; /* the bounds of the file count, and not those of the log */
    double theta[4] = {0};
    lg_prior priors[LG_MACHINE_PRIORS];
    assert_int_equal(machine.parameters, 4);
    assert_int_equal(machine.lags, 2);
    assert_close(number_of(&machine, theta, "lag.u"), 0.1, 1e-12, 0);
    assert_close(number_of(&machine, theta, "dead_zone.u"), 0.4, 1e-12, 0);
    assert_close(number_of(&machine, theta, "curve.w.2"), 0.2, 1e-12, 0);
    assert_int_equal(lg_machine_set_lags(&machine, 0.3, theta), 0); /* a start is kept */
    assert_int_equal(lg_machine_list_priors(&machine, priors), 1);
    assert_close(priors[0].centre, 0.1, 1e-12, 0);
    assert_close(priors[0].sigma, 0.05, 0, 0);
    static const double extremes[] = {-50, 50};
    for (int i = 0; i < 2; i++) {
        const double at[4] = {extremes[i], extremes[i], extremes[i], 1};
        assert_close(number_of(&machine, at, "lag.u"), i == 0 ? 0.02 : 0.5, 1e-9, 0);
        assert_close(number_of(&machine, at, "curve.w.2"), i == 0 ? -1 : 1, 1e-9, 0);
        assert_true(number_of(&machine, at, "dead_zone.u") > 0);
        assert_close(number_of(&machine, at, "curve.w.3"), 0.7 + 0.7 + 1e-6, 1e-12, 0); /* unit 1/U^2 */
    }
}

/* log(tau/T) of both lags. */
static void lags_of(const lg_machine *machine, const double *theta, double *out) {
    lg_tape *tape = test_tape(LG_F64);
    lg_machine_vars vars;
    assert_ok(lg_machine_bind(tape, machine, lg_machine_parameter(tape, machine, theta), &vars));
    assert_ok(lg_read(tape, vars.lag, 2, out));
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
        {"lag: {start: -1}", "a start above 0"},
        {"lag: {start: 1, within: [2, 3]}", "start 1 is not between 2 and 3"},
        {"lag: {sigma: 1}", "sigma needs a start"},
        {"lag: {order: 3}", "order"},
        {"lag: {order: 2, value: 0}", "0 is outside (0"},
        {"lag: {order: 2, value: 1, start: 2}", "a lag with a value has no start"},
        {"lag: {order: 2, speed: 1}", "speed"},
        {"curve: {dead_zone: {start: 1, order: 2}}", "order"},
        {"curve: {dead_zone: {start: 1, within: [-1, 3]}}", "bounds not below 0"},
        {"curve: {degree: 3, values: {start: 2}}", "has 1 numbers, expected 2"},
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

TEST("actuators whose unknown numbers are at their starts act as those in which they are known") {
    lg_machine known = parse("lag: [0.1, 0.3], curve: [{dead_zone: 0.5}, {degree: 3, values: [0.2, 0.7]}]")
                           ->machine,
               open = parse("lag: [{start: 0.1}, 0.3], curve: [{dead_zone: {start: 0.5}}, "
                            "{degree: 3, values: [0.2, {start: 0.7}]}]")
                          ->machine;
    lg_machine *both[] = {&known, &open};
    const double zeros[3] = {0};
    double lags[2][2];
    for (int i = 0; i < 2; i++) {
        both[i]->scales.time = 0.7, both[i]->scales.input[0] = 2, both[i]->scales.input[1] = 3;
        lags_of(both[i], zeros, lags[i]);
    }
    assert_int_equal(open.parameters, 3);
    assert_close(lags[0][0], log(0.1 / 0.7), 1e-12, 0);
    assert_close(lags[0][1], log(0.3 / 0.7), 1e-12, 0);
    assert_all_close(lags[1], lags[0], 2, 1e-14, 0);
    assert_close(force_of(&open, zeros, 0.9, -1.3), force_of(&known, NULL, 0.9, -1.3), 1e-13, 0);
}
