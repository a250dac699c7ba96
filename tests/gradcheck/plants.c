/* Plants every possible error in a case and reports whether the gradient check catches it. */
#include "gradcheck/cases.h"
#include "autodiff/check/internal.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/ops/op_table.h"

/* The reason why the check cannot notice this mutation, or NULL. In a jvp, LG_PLANT_DROP concerns one input,
 * while the other mutations change the whole output. */
static const char *never_asked(const lg_gradcheck_case *test, const lg_gradcheck_plant *plant) {
    const lg_op *op = lg_op_named(plant->operation);
    const uint32_t input = plant->input;
    const bool of_input = plant->direction == LG_PLANT_VJP || plant->mutation == LG_PLANT_DROP;
    if (op == &lg_op_leaf) return "a leaf has no inputs";
    if (op == &lg_op_custom_derivative) return "the derivative of a numeric derivative is an error";
    if (op->frozen == ~0u || (of_input && input < 32 && (op->frozen >> input & 1u)))
        return "the operation counts as constant in this input, so there is no derivative to change";
    return test->zero ? "the derivative is identically zero" : NULL;
}

static lg_status plant_one(const lg_context *context, const lg_gradcheck_case *test,
                           const lg_gradcheck_options *options, const lg_gradcheck_plant *plant,
                           lg_plant_report_fn report, void *user) {
    const char *why = never_asked(test, plant);
    if (why != NULL) {
        report(user, test, plant, LG_PLANT_EXCLUDED, why);
        return LG_OK;
    }
    lg_plant planted;
    lg_gradcheck_result result;
    LG_TRY(lg_plant_open(&planted, plant));
    lg_status status = lg_gradcheck_run(context, test, options, &planted, &result);
    if (status != LG_OK && status != LG_CHECK_FAILED) return status;
    if (plant->mutation == LG_PLANT_TRANSPOSE && planted.changed == 0)
        report(user, test, plant, LG_PLANT_EXCLUDED, "the transposed derivative has the same numbers");
    else
        report(user, test, plant, status == LG_OK ? LG_PLANT_MISSED : LG_PLANT_CAUGHT, result.message);
    return LG_OK;
}

static lg_status plant_operation(const lg_context *context, const lg_gradcheck_case *test,
                                 const char *operation, uint32_t inputs, const lg_gradcheck_options *options,
                                 lg_plant_report_fn report, void *user) {
    for (int direction = LG_PLANT_VJP; direction <= LG_PLANT_JVP; direction++)
        for (int mutation = 0; mutation < LG_PLANT_MUTATIONS; mutation++) {
            /* A jvp returns a single tangent, so only LG_PLANT_DROP depends on the input. */
            bool whole = direction == LG_PLANT_JVP && mutation != LG_PLANT_DROP;
            for (uint32_t input = 0; input < (whole ? 1 : inputs); input++) {
                lg_gradcheck_plant plant = {operation, (lg_plant_direction)direction,
                                            (lg_plant_mutation)mutation, input};
                LG_TRY(plant_one(context, test, options, &plant, report, user));
            }
        }
    return LG_OK;
}

/* ---- checks of cases ---- */

lg_status lg_gradcheck_run(const lg_context *context, const lg_gradcheck_case *test,
                           const lg_gradcheck_options *options, lg_plant *plant,
                           lg_gradcheck_result *result) {
    const lg_exchange none = {NULL, NULL};
    if (test == NULL || result == NULL) return LG_INVALID_ARGUMENT;
    LG_TRY(lg_gradcheck_exchanged(context, &test->function, options, plant != NULL ? plant->exchange : none,
                                  result));
    if (!test->zero || result->order[0].derivative == 0.0) return LG_OK;
    result->passed = result->order[0].passed = false;
    (void)lg_format(result->message, sizeof result->message,
                    "%s, order 1: the derivative should be identically zero but is %.3g", test->function.name,
                    result->order[0].derivative);
    return LG_CHECK_FAILED;
}

static lg_var drawn(lg_tape *tape, lg_rng *rng, const lg_gradcheck_argument *a) {
    const bool plain = a->low == 0.0 && a->high == 0.0;
    void *numbers = NULL;
    if (a->values != NULL) return lg_input_f64(tape, a->shape, a->values);
    const lg_var x = lg_input_buffer(tape, a->shape, &numbers);
    for (size_t i = 0; numbers != NULL && i < lg_shape_count(a->shape); i++)
        ((double *)numbers)[i] = lg_rng_uniform_in(rng, plain ? -1.0 : a->low, plain ? 1.0 : a->high);
    return x;
}

/* Records the function at a random point, its vjp and its jvp. */
static lg_status record_all(lg_tape *tape, const lg_gradcheck_function *f, uint64_t seed) {
    lg_var x[LG_GRADCHECK_MAX_INPUTS], found[LG_GRADCHECK_MAX_INPUTS], y, c;
    lg_rng rng;
    lg_rng_seed(&rng, seed, 1);
    for (uint32_t i = 0; i < f->inputs; i++) x[i] = drawn(tape, &rng, &f->arguments[i]);
    y = f->build(f->user, tape, x);
    LG_TRY(lg_tape_status(tape));
    c = drawn(tape, &rng, &(const lg_gradcheck_argument){.shape = lg_var_shape(tape, y)});
    LG_TRY(lg_vjp(tape, &y, &c, 1, x, f->inputs, found));
    return lg_jvp(tape, &y, 1, x, x, f->inputs, found);
}

lg_status lg_gradcheck_inputs_of(const lg_context *context, const lg_gradcheck_function *function,
                                 const lg_gradcheck_options *options, const lg_op *op, uint32_t *inputs) {
    lg_tape *tape;
    if (!lg_gradcheck_valid(function, options)) return LG_INVALID_ARGUMENT;
    LG_TRY(lg_tape_create(context, NULL, &tape));
    const lg_status status = record_all(tape, function, options->seed);
    *inputs = 0;
    for (uint32_t i = 0; status == LG_OK && i < tape->count; i++)
        if (tape->nodes[i].op == op && tape->nodes[i].inputs > *inputs) *inputs = tape->nodes[i].inputs;
    lg_tape_destroy(tape);
    return status;
}

/* ---- programs ---- */

static lg_status plant_in_program(const lg_context *context, const lg_gradcheck_case *test,
                                  const lg_gradcheck_options *options, const lg_gradcheck_plant *plant,
                                  lg_plant_report_fn report, void *user) {
    lg_plant planted;
    lg_gradcheck_program_result result;
    LG_TRY(lg_plant_open(&planted, plant));
    const lg_status status = lg_gradcheck_program(context, test, options, &planted, &result);
    if (status != LG_OK && status != LG_CHECK_FAILED) return status;
    if (planted.changed == 0)
        report(user, test, plant, LG_PLANT_EXCLUDED,
               planted.applied > 0 ? "the planted error changes no number"
                                   : "no plan contains this operation");
    else
        report(user, test, plant, status == LG_OK ? LG_PLANT_MISSED : LG_PLANT_CAUGHT, result.message);
    return LG_OK;
}

static lg_status plant_program(const lg_context *context, const lg_gradcheck_case *test,
                               const lg_gradcheck_options *options, lg_plant_report_fn report, void *user) {
    static const char *const functions[] = {"value", "forward", "adjoint"};
    if (test->no_program != NULL) return LG_OK;
    for (size_t i = 0; i < LG_GRADCHECK_CASE_OPERATIONS && test->operations[i] != NULL; i++) {
        const lg_op *op = lg_op_named(test->operations[i]);
        for (int m = 0; m < LG_PLANT_MUTATIONS && (op->element != NULL || op->expand != NULL); m++) {
            const lg_gradcheck_plant plant = {op->name, LG_PLANT_SCALARS, (lg_plant_mutation)m, 0};
            LG_TRY(plant_in_program(context, test, options, &plant, report, user));
        }
    }
    for (size_t f = 0; f < LG_COUNT(functions); f++)
        for (int m = 0; m < LG_PLANT_PLAN_MUTATIONS; m++) {
            const lg_gradcheck_plant plant = {functions[f], LG_PLANT_PLAN,
                                              (lg_plant_mutation)(LG_PLANT_MUTATIONS + m), 0};
            LG_TRY(plant_in_program(context, test, options, &plant, report, user));
        }
    return LG_OK;
}

lg_status lg_gradcheck_plant_all(const lg_context *context, const lg_gradcheck_case *test,
                                 const lg_gradcheck_options *options, lg_plant_report_fn report, void *user) {
    lg_gradcheck_options chosen;
    lg_gradcheck_options_init(&chosen);
    if (test == NULL || report == NULL) return LG_INVALID_ARGUMENT;
    if (options != NULL) chosen = *options;
    for (size_t i = 0; i < LG_GRADCHECK_CASE_OPERATIONS && test->operations[i] != NULL; i++) {
        const lg_op *op = lg_op_named(test->operations[i]);
        uint32_t inputs = 0;
        if (op == NULL) return LG_INVALID_ARGUMENT;
        LG_TRY(lg_gradcheck_inputs_of(context, &test->function, &chosen, op, &inputs));
        LG_TRY(plant_operation(context, test, test->operations[i], inputs == 0 ? 1 : inputs, &chosen, report,
                               user));
    }
    return plant_program(context, test, &chosen, report, user);
}
