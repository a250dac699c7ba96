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

/* Returns the first wanted row from row *at on, or NULL. *at becomes the number of the row that follows. */
static const lg_gradcheck_case *next_row(size_t *at) {
    const lg_gradcheck_case *row = lg_gradcheck_case_at((*at)++);
    while (row != NULL && !wanted(row)) row = lg_gradcheck_case_at((*at)++);
    return row;
}

typedef struct run {
    app *app;
    lg_gradcheck_options options;
    const char *row; /* Name of the row that is being checked, for messages. */
    size_t failures, checks, programs, refused, caught, excluded, missed;
} run;

/* ---- checking ---- */

/* A row that is wrong is a failure, after which the others are checked. */
static lg_status count_failure(run *r, lg_status status, const char *message) {
    if (status == LG_OK) return LG_OK;
    r->failures++;
    app_warn(r->app, "%s", message);
    return LG_OK;
}

static lg_status check_row(run *r, const lg_gradcheck_case *row) {
    lg_gradcheck_result result;
    const lg_status status = lg_gradcheck_run(r->app->context, row, &r->options, NULL, &result);
    if (status == LG_OUT_OF_MEMORY || status == LG_INVALID_ARGUMENT) return status;
    for (uint64_t order = 0; order < LG_GRADCHECK_ORDERS; order++) {
        const lg_gradcheck_order *found = &result.order[order];
        if (!found->checked) continue;
        APP_OBJECT(r->app->out, NULL, LG_AS_TEXT("name", row->function.name), LG_AS_WHOLE("order", order + 1),
                   LG_AS_REAL("slope", found->slope), LG_AS_REAL("error", found->error),
                   LG_AS_FLAG("passed", found->passed));
    }
    r->checks++;
    return count_failure(r, status, result.message);
}

static lg_status check_program(run *r, const lg_gradcheck_case *row) {
    lg_gradcheck_program_result found;
    const lg_status status = lg_gradcheck_program(r->app->context, row, &r->options, NULL, &found);
    if (status == LG_OUT_OF_MEMORY || status == LG_INVALID_ARGUMENT) return status;
    APP_OBJECT(r->app->out, NULL, LG_AS_TEXT("name", row->function.name),
               LG_AS_FLAG("refused", found.refused), LG_AS_REAL("value", found.value),
               LG_AS_REAL("forward", found.forward), LG_AS_REAL("adjoint", found.adjoint),
               LG_AS_FLAG("passed", found.passed));
    r->programs += !found.refused;
    r->refused += found.refused;
    return count_failure(r, status, found.message);
}

/* Prints a table with what `check` finds of each wanted row, until one cannot be checked; without rows if
 * `status` is a failure. */
static lg_status check_rows(run *r, const char *name, lg_status status,
                            lg_status (*check)(run *r, const lg_gradcheck_case *row)) {
    const lg_gradcheck_case *row;
    app_result_rows(r->app->out, name);
    for (size_t at = 0; status == LG_OK && (row = next_row(&at)) != NULL;) {
        if (!app_interrupted()) r->row = row->function.name;
        status = app_interrupted() ? LG_CANCELLED : check(r, row);
    }
    app_result_rows_end(r->app->out);
    return status;
}

static lg_status check_all(run *r) {
    app_json *out = r->app->out;
    lg_status status = check_rows(r, "checks", LG_OK, check_row);
    status = check_rows(r, "programs", status, check_program);
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

static lg_status plant_row(run *r, const lg_gradcheck_case *row) {
    return lg_gradcheck_plant_all(r->app->context, row, &r->options, count_plant, r);
}

static lg_status plant_all(run *r) {
    const lg_status status = check_rows(r, "plants", LG_OK, plant_row);
    r->failures = r->missed;
    app_result_line(r->app->out, "\n%zu mutations caught, %zu excluded (cannot be seen), %zu missed.",
                    r->caught, r->excluded, r->missed);
    APP_PUT(r->app->out, LG_AS_WHOLE("caught", r->caught), LG_AS_WHOLE("excluded", r->excluded),
            LG_AS_WHOLE("missed", r->missed), LG_AS_FLAG("passed", r->missed == 0 && status == LG_OK));
    return status;
}

static void gradcheck(struct app *program) {
    run r = {.app = program};
    size_t rows = 0, operations = 0; /* rows: to check; operations: of these, whose derivatives can change */
    const lg_gradcheck_case *row;
    for (size_t at = 0; (row = next_row(&at)) != NULL; rows++)
        for (size_t i = 0; i < LG_GRADCHECK_CASE_OPERATIONS && row->operations[i] != NULL; i++) operations++;
    if (rows == 0)
        app_stop_usage(program, "--only: no operation is called '%s', and no function has it in its name",
                       given.only);
    if (given.plant && operations == 0)
        app_stop_usage(program,
                       "--plant: none of the %zu functions that '%s' chooses tests an operation with a "
                       "registered derivative, so there is nothing to plant",
                       rows, given.only);
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
