/* lg-gradcheck: are all derivatives right, and would the check notice if they were not? */
#include <ctype.h>
#include <math.h>
#include <string.h>

#include "autodiff/cases/cases.h"
#include "common/app.h"
#include "lg-gradcheck/tables.h"

/* The tables that are checked beside the library's operations. A new room adds its own here. */
typedef const lg_gradcheck_case *(*table_fn)(size_t *count);
static const table_fn tables[] = {layer_rows,       integrator_rows, system_rows,
                                  hamiltonian_rows, surrogate_rows,  machine_rows};

typedef struct values {
    const char *only;
    bool plant;
    uint64_t order;
} values;
static values given;

static const lg_field options[] = {
    LG_OPTION(values, only, STRING, "TEXT", "Only rows of the operation TEXT, or whose name contains TEXT"),
    LG_OPTION(values, plant, SWITCH, NULL, "Plant wrong derivatives; succeed only if every one is caught"),
    LG_OPTION(values, order, U64, "N", "Highest order of derivatives", .low = 1, .high = LG_GRADCHECK_ORDERS,
              .value = "2"),
    LG_FIELD_END};

/* Whatever the case of the letters. */
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

/* visit(user, row) for all rows wanted, until one does not return LG_OK. */
static lg_status each_row(visit_fn visit, void *user) {
    const lg_gradcheck_case *row;
    lg_status status = LG_OK;
    for (size_t i = 0; status == LG_OK && (row = lg_gradcheck_operation(i)) != NULL; i++)
        status = visit_wanted(visit, user, row);
    for (size_t t = 0; t < LG_COUNT(tables); t++) {
        size_t count;
        const lg_gradcheck_case *table = tables[t](&count);
        for (size_t i = 0; i < count && status == LG_OK; i++) status = visit_wanted(visit, user, &table[i]);
    }
    return status;
}

/* What --only leaves. */
typedef struct extent {
    size_t rows, operations; /* functions, and the derivatives registered for which they stand */
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
    app_table table;
    app_json json;
    const char *row; /* the one at work, for messages */
    size_t failures, checks, programs, refused, caught, excluded, missed;
} run;

/* ---- checking ---- */

static const char *verdict_of(const lg_gradcheck_order *order) {
    return order->passed ? "ok" : "WRONG";
}

static void report_order(run *r, const char *name, int order, const lg_gradcheck_order *found) {
    char slope[32] = "-";
    if (isfinite(found->slope))
        (void)snprintf(slope, sizeof slope, "%.3f", found->slope);
    else if (found->passed)
        (void)snprintf(slope, sizeof slope, "rounding");
    if (r->app->json) {
        app_json_open(&r->json, NULL, '{');
        app_json_text(&r->json, "name", name);
        app_json_size(&r->json, "order", (uint64_t)order);
        app_json_real(&r->json, "slope", found->slope);
        app_json_real(&r->json, "error", found->error);
        app_json_bool(&r->json, "passed", found->passed);
        app_json_close(&r->json, '}');
        return;
    }
    app_table_cell(&r->table, "%s", name);
    app_table_cell(&r->table, "%d", order);
    app_table_cell(&r->table, "%s", slope);
    app_table_cell(&r->table, "%.1e", found->error);
    app_table_cell(&r->table, "%s", verdict_of(found));
}

static lg_status check_row(void *user, const lg_gradcheck_case *row) {
    run *r = user;
    lg_gradcheck_result result;
    r->row = row->function.name;
    lg_status status = lg_gradcheck_run(r->app->context, row, &r->options, &result);
    if (status == LG_OUT_OF_MEMORY || status == LG_INVALID_ARGUMENT) return status;
    for (int order = 0; order < LG_GRADCHECK_ORDERS; order++)
        if (result.order[order].checked) report_order(r, row->function.name, order + 1, &result.order[order]);
    r->checks++;
    if (status != LG_OK) {
        r->failures++;
        app_warn(r->app, "%s", result.message);
    }
    return LG_OK;
}

static void report_program(run *r, const char *name, const lg_gradcheck_program_result *found) {
    if (r->app->json) {
        app_json_open(&r->json, NULL, '{');
        app_json_text(&r->json, "name", name);
        app_json_bool(&r->json, "refused", found->refused);
        app_json_real(&r->json, "value", found->value);
        app_json_real(&r->json, "forward", found->forward);
        app_json_real(&r->json, "adjoint", found->adjoint);
        app_json_bool(&r->json, "passed", found->passed);
        app_json_close(&r->json, '}');
        return;
    }
    app_table_cell(&r->table, "%s", name);
    const double errors[] = {found->value, found->forward, found->adjoint};
    for (size_t i = 0; i < LG_COUNT(errors); i++) {
        if (found->refused)
            app_table_cell(&r->table, "-");
        else
            app_table_cell(&r->table, "%.1e", errors[i]);
    }
    app_table_cell(&r->table, "%s", !found->passed ? "WRONG" : found->refused ? "refused" : "ok");
}

static lg_status check_program(void *user, const lg_gradcheck_case *row) {
    run *r = user;
    lg_gradcheck_program_result result;
    r->row = row->function.name;
    const lg_status status = lg_gradcheck_program(r->app->context, row, &r->options, &result);
    if (status == LG_OUT_OF_MEMORY || status == LG_INVALID_ARGUMENT) return status;
    report_program(r, row->function.name, &result);
    r->programs += !result.refused;
    r->refused += result.refused;
    if (status != LG_OK) {
        r->failures++;
        app_warn(r->app, "%s", result.message);
    }
    return LG_OK;
}

/* The same functions as programs. */
static lg_status check_programs(run *r) {
    static const char *const head[] = {"program", "value", "forward", "adjoint", "verdict"};
    if (r->app->json) app_json_open(&r->json, "programs", '[');
    if (!r->app->json) app_table_begin(&r->table, LG_COUNT(head));
    for (size_t i = 0; i < LG_COUNT(head) && !r->app->json; i++) app_table_cell(&r->table, "%s", head[i]);
    const lg_status status = each_row(check_program, r);
    if (r->app->json) app_json_close(&r->json, ']');
    if (!r->app->json) app_table_end(&r->table, stdout);
    return status;
}

static lg_status check_all(run *r) {
    static const char *const head[] = {"function", "order", "slope", "error", "verdict"};
    if (r->app->json) app_json_open(&r->json, "checks", '[');
    if (!r->app->json) app_table_begin(&r->table, LG_COUNT(head));
    for (size_t i = 0; i < LG_COUNT(head) && !r->app->json; i++) app_table_cell(&r->table, "%s", head[i]);
    lg_status status = each_row(check_row, r);
    if (r->app->json) app_json_close(&r->json, ']');
    if (!r->app->json) app_table_end(&r->table, stdout);
    if (!r->app->json) printf("\n");
    if (status == LG_OK) status = check_programs(r);
    if (r->app->json) {
        app_json_size(&r->json, "functions", r->checks);
        app_json_size(&r->json, "equal_programs", r->programs);
        app_json_size(&r->json, "refused_programs", r->refused);
        app_json_size(&r->json, "wrong", r->failures);
        app_json_bool(&r->json, "passed", r->failures == 0 && status == LG_OK);
    } else {
        printf("\n%zu functions, %zu of them programs, %zu refused as programs, %zu wrong.\n", r->checks,
               r->programs, r->refused, r->failures);
    }
    return status;
}

/* ---- planting ---- */

static void count_plant(void *user, const lg_gradcheck_case *row, const lg_gradcheck_plant *plant,
                        lg_plant_outcome outcome, const char *reason) {
    static const char *const names[] = {"caught", "MISSED", "excluded"};
    run *r = user;
    size_t *const counts[] = {&r->caught, &r->missed, &r->excluded};
    ++*counts[outcome];
    if (r->app->json) {
        app_json_open(&r->json, NULL, '{');
        app_json_text(&r->json, "name", row->function.name);
        app_json_text(&r->json, "operation", plant->operation);
        app_json_text(&r->json, "direction", lg_plant_direction_name(plant->direction));
        app_json_text(&r->json, "mutation", lg_plant_mutation_name(plant->mutation));
        app_json_size(&r->json, "input", plant->input);
        app_json_text(&r->json, "outcome", names[outcome]);
        app_json_text(&r->json, "reason", reason);
        app_json_close(&r->json, '}');
        return;
    }
    app_table_cell(&r->table, "%s", row->function.name);
    app_table_cell(&r->table, "%s %s of %s, input %u", plant->operation,
                   lg_plant_direction_name(plant->direction), lg_plant_mutation_name(plant->mutation),
                   plant->input);
    app_table_cell(&r->table, "%s", names[outcome]);
    app_table_cell(&r->table, "%s", outcome == LG_PLANT_EXCLUDED ? reason : "");
}

static lg_status plant_row(void *user, const lg_gradcheck_case *row) {
    run *r = user;
    r->row = row->function.name;
    return lg_gradcheck_plant_all(r->app->context, row, &r->options, count_plant, r);
}

static lg_status plant_all(run *r) {
    static const char *const head[] = {"function", "mutation", "outcome", "why excluded"};
    if (r->app->json) app_json_open(&r->json, "plants", '[');
    if (!r->app->json) app_table_begin(&r->table, LG_COUNT(head));
    for (size_t i = 0; i < LG_COUNT(head) && !r->app->json; i++) app_table_cell(&r->table, "%s", head[i]);
    lg_status status = each_row(plant_row, r);
    r->failures = r->missed;
    if (r->app->json) {
        app_json_close(&r->json, ']');
        app_json_size(&r->json, "caught", r->caught);
        app_json_size(&r->json, "excluded", r->excluded);
        app_json_size(&r->json, "missed", r->missed);
        app_json_bool(&r->json, "passed", r->missed == 0 && status == LG_OK);
    } else {
        app_table_end(&r->table, stdout);
        printf("\n%zu mutations caught, %zu excluded (cannot be seen), %zu missed.\n", r->caught, r->excluded,
               r->missed);
    }
    return status;
}

static int gradcheck(struct app *program) {
    run r = {.app = program};
    extent found = {0, 0};
    (void)each_row(count_row, &found);
    if (found.rows == 0) return app_usage(program, "--only: nothing is called '%s'", given.only);
    if (given.plant && found.operations == 0)
        return app_usage(
            program,
            "--plant: none of the %zu functions that '%s' chooses has a registered derivative of "
            "its own: there is nothing to plant",
            found.rows, given.only);
    lg_gradcheck_options_init(&r.options);
    if (program->seed_given) r.options.seed = program->seed;
    r.options.order = (int)given.order;
    if (program->json) app_json_begin(&r.json);
    lg_status status = given.plant ? plant_all(&r) : check_all(&r);
    if (program->json) app_json_end(&r.json);
    if (status != LG_OK) return app_fail(program, status, "%s: %s", r.row, lg_status_sentence(status));
    return r.failures == 0 ? APP_EXIT_OK : APP_EXIT_CHECK;
}

int main(int argc, char **argv) {
    const app_command commands[] = {
        {.name = NULL,
         .summary = "Checks the derivatives of every operation, layer, integrator and system",
         .details = "A function passes when the remainder of its Taylor expansion falls like h^2 (slope >= "
                    "1.9) or is "
                    "at rounding level, forward and reverse mode agree with each other and with difference "
                    "quotients, at first and second order, and when its plans as a program (value, forward, "
                    "adjoint) "
                    "equal the tape.",
         .settings = APP_SETTINGS(APP_GIVEN(options, given)),
         .run = gradcheck},
        {.run = NULL}};
    return app_main(argc, argv, "lg-gradcheck", "Checks derivatives", commands);
}
