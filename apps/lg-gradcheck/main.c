/* lg-gradcheck: checks all derivatives, and checks whether wrong derivatives would be noticed. */
#include <ctype.h>
#include <string.h>

#include "gradcheck/cases.h"
#include "common/app.h"

typedef struct values {
    const char *only;
    bool plant;
} values;
static values given;

static const lg_field options[] = {
    LG_OPTION(values, only, STRING, "TEXT",
              "Check only functions of the operation TEXT, or functions whose name contains TEXT"),
    LG_OPTION(values, plant, SWITCH, NULL,
              "Plant wrong derivatives; succeed only if the check catches each of them",
              .option = "plant-errors"),
    LG_FIELD_END};

/* Ignores the case of letters. */
static bool contains(const char *text, const char *part) {
    for (; *text != '\0'; text++) {
        size_t i = 0;
        while (part[i] != '\0' && tolower((unsigned char)text[i]) == tolower((unsigned char)part[i])) i++;
        if (part[i] == '\0') return true;
    }
    return false;
}

static bool wanted(const lg_gradcheck_case *row) {
    if (given.only == NULL || contains(row->function.name, given.only)) return true;
    for (size_t i = 0; i < LG_GRADCHECK_CASE_OPERATIONS && row->operations[i] != NULL; i++)
        if (strcmp(row->operations[i], given.only) == 0) return true;
    return false;
}

typedef lg_status (*visit_fn)(void *user, const lg_gradcheck_case *row);

static lg_status visit_wanted(visit_fn visit, void *user, const lg_gradcheck_case *row) {
    if (!wanted(row)) return LG_OK;
    return app_interrupted() ? LG_CANCELLED : visit(user, row);
}

/* Calls visit(user, row) for all wanted rows, until one call does not return LG_OK. */
static lg_status each_row(visit_fn visit, void *user) {
    const lg_gradcheck_case *row;
    lg_status status = LG_OK;
    for (size_t i = 0; status == LG_OK && (row = lg_gradcheck_case_at(i)) != NULL; i++)
        status = visit_wanted(visit, user, row);
    return status;
}

/* What is left after --only. */
typedef struct extent {
    /* rows: functions to check. operations: entries in their lists of operations whose derivatives can be
     * changed. */
    size_t rows, operations;
} extent;

static lg_status count_row(void *user, const lg_gradcheck_case *row) {
    extent *found = user;
    found->rows++;
    for (size_t i = 0; i < LG_GRADCHECK_CASE_OPERATIONS && row->operations[i] != NULL; i++)
        found->operations++;
    return LG_OK;
}

typedef struct run {
    app *app;
    lg_gradcheck_options options;
    const char *row; /* Name of the row that is being checked, for messages. */
    size_t failures, checks, programs, refused, caught, excluded, missed;
} run;

/* ---- checking ---- */

static void report_order(app_json *out, const char *name, int order, const lg_gradcheck_order *found) {
    APP_OBJECT(out, NULL, LG_AS_TEXT("name", name), LG_AS_WHOLE("order", (uint64_t)order),
               LG_AS_REAL("slope", found->slope), LG_AS_REAL("error", found->error),
               LG_AS_FLAG("passed", found->passed));
}

static lg_status check_row(void *user, const lg_gradcheck_case *row) {
    run *r = user;
    lg_gradcheck_result result;
    r->row = row->function.name;
    lg_status status = lg_gradcheck_run(r->app->context, row, &r->options, NULL, &result);
    if (status == LG_OUT_OF_MEMORY || status == LG_INVALID_ARGUMENT) return status;
    for (int order = 0; order < LG_GRADCHECK_ORDERS; order++)
        if (result.order[order].checked)
            report_order(r->app->out, row->function.name, order + 1, &result.order[order]);
    r->checks++;
    if (status != LG_OK) {
        r->failures++;
        app_warn(r->app, "%s", result.message);
    }
    return LG_OK;
}

static void report_program(app_json *out, const char *name, const lg_gradcheck_program_result *found) {
    APP_OBJECT(out, NULL, LG_AS_TEXT("name", name), LG_AS_FLAG("refused", found->refused),
               LG_AS_REAL("value", found->value), LG_AS_REAL("forward", found->forward),
               LG_AS_REAL("adjoint", found->adjoint), LG_AS_FLAG("passed", found->passed));
}

static lg_status check_program(void *user, const lg_gradcheck_case *row) {
    run *r = user;
    lg_gradcheck_program_result result;
    r->row = row->function.name;
    const lg_status status = lg_gradcheck_program(r->app->context, row, &r->options, NULL, &result);
    if (status == LG_OUT_OF_MEMORY || status == LG_INVALID_ARGUMENT) return status;
    report_program(r->app->out, row->function.name, &result);
    r->programs += !result.refused;
    r->refused += result.refused;
    if (status != LG_OK) {
        r->failures++;
        app_warn(r->app, "%s", result.message);
    }
    return LG_OK;
}

static lg_status check_all(run *r) {
    app_json *out = r->app->out;
    app_result_rows(out, "checks");
    lg_status status = each_row(check_row, r);
    app_result_rows_end(out);
    app_result_rows(out, "programs");
    if (status == LG_OK) status = each_row(check_program, r);
    app_result_rows_end(out);
    app_result_line(out, "\n%zu functions, %zu of them programs, %zu refused as programs, %zu wrong.",
                    r->checks, r->programs, r->refused, r->failures);
    APP_PUT(out, LG_AS_WHOLE("functions", r->checks), LG_AS_WHOLE("equal_programs", r->programs),
            LG_AS_WHOLE("refused_programs", r->refused), LG_AS_WHOLE("wrong", r->failures),
            LG_AS_FLAG("passed", r->failures == 0 && status == LG_OK));
    return status;
}

/* ---- planting wrong derivatives ---- */

static void count_plant(void *user, const lg_gradcheck_case *row, const lg_gradcheck_plant *plant,
                        lg_plant_outcome outcome, const char *reason) {
    static const char *const names[] = {"caught", "MISSED", "excluded"};
    run *r = user;
    size_t *const counts[] = {&r->caught, &r->missed, &r->excluded};
    ++*counts[outcome];
    APP_OBJECT(r->app->out, NULL, LG_AS_TEXT("name", row->function.name),
               LG_AS_TEXT("operation", plant->operation),
               LG_AS_TEXT("direction", lg_plant_direction_name(plant->direction)),
               LG_AS_TEXT("mutation", lg_plant_mutation_name(plant->mutation)),
               LG_AS_WHOLE("input", plant->input), LG_AS_TEXT("outcome", names[outcome]),
               LG_AS_TEXT("reason", r->app->out->people && outcome != LG_PLANT_EXCLUDED ? NULL : reason));
}

static lg_status plant_row(void *user, const lg_gradcheck_case *row) {
    run *r = user;
    r->row = row->function.name;
    return lg_gradcheck_plant_all(r->app->context, row, &r->options, count_plant, r);
}

static lg_status plant_all(run *r) {
    app_result_rows(r->app->out, "plants");
    const lg_status status = each_row(plant_row, r);
    app_result_rows_end(r->app->out);
    r->failures = r->missed;
    app_result_line(r->app->out, "\n%zu mutations caught, %zu excluded (cannot be seen), %zu missed.",
                    r->caught, r->excluded, r->missed);
    APP_PUT(r->app->out, LG_AS_WHOLE("caught", r->caught), LG_AS_WHOLE("excluded", r->excluded),
            LG_AS_WHOLE("missed", r->missed), LG_AS_FLAG("passed", r->missed == 0 && status == LG_OK));
    return status;
}

static void gradcheck(struct app *program) {
    run r = {.app = program};
    extent found = {0, 0};
    (void)each_row(count_row, &found);
    if (found.rows == 0)
        app_stop_usage(program, "--only: no operation is called '%s', and no function has it in its name",
                       given.only);
    if (given.plant && found.operations == 0)
        app_stop_usage(program,
                       "--plant: none of the %zu functions that '%s' chooses tests an operation with a "
                       "registered derivative, so there is nothing to plant",
                       found.rows, given.only);
    lg_gradcheck_options_init(&r.options);
    if (program->seed_given) r.options.seed = program->seed;
    const lg_status status = given.plant ? plant_all(&r) : check_all(&r);
    app_result_end(program);
    if (status != LG_OK) app_stop(program, status, "%s: %s", r.row, lg_status_sentence(status));
    if (r.failures > 0) program->code = APP_EXIT_CHECK;
}

int main(int argc, char **argv) {
    const app_command commands[] = {
        {.name = NULL,
         .summary = "Checks the derivatives of every operation, layer, integrator and system",
         .details =
             "A function passes when the remainder of its Taylor expansion falls like h^2 (slope >= "
             "1.9) or is at rounding level, forward and reverse mode agree with each other and with "
             "difference quotients, at first and second order, and when its plans as a program (value, "
             "forward, adjoint) equal the tape.",
         .settings = APP_SETTINGS(APP_GIVEN(options, given)),
         .run = gradcheck},
        {.run = NULL}};
    return app_main(argc, argv, "lg-gradcheck", "Checks derivatives", commands);
}
