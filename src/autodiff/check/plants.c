/* Plants every possible error in a case and reports whether the gradient check catches it. */
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
    lg_gradcheck_options planted = *options;
    lg_gradcheck_result result;
    planted.plant = plant;
    lg_status status = lg_gradcheck_run(context, test, &planted, &result);
    if (status != LG_OK && status != LG_CHECK_FAILED) return status;
    if (plant->mutation == LG_PLANT_TRANSPOSE && result.plant_changed == 0)
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

/* ---- programs ---- */

static lg_status plant_in_program(const lg_context *context, const lg_gradcheck_case *test,
                                  const lg_gradcheck_options *options, const lg_gradcheck_plant *plant,
                                  lg_plant_report_fn report, void *user) {
    lg_gradcheck_options planted = *options;
    lg_gradcheck_program_result result;
    planted.plant = plant;
    const lg_status status = lg_gradcheck_program(context, test, &planted, &result);
    if (status != LG_OK && status != LG_CHECK_FAILED) return status;
    if (result.plant_changed == 0)
        report(user, test, plant, LG_PLANT_EXCLUDED,
               result.plant_applied > 0 ? "the planted error changes no number"
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
