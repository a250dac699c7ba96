/* The result of a run: one JSON object, or one screen. */
#include "lg-simulate/simulate.h"

#include <math.h>
#include <string.h>

enum { SHOWN_BLOCKS = 14 };

static const double *final_state(const report *what) {
    return what->path->y + (what->path->count - 1) * what->sim->dim;
}

/* ---- JSON ---- */

static void json_invariants(app_json *json, const watch *seen) {
    app_json_open(json, "invariants", '{');
    for (size_t i = 0; i < seen->invariants; i++) {
        app_json_open(json, lg_system_invariant_name(seen->sim->system, i), '{');
        app_json_real(json, "start", seen->start[i]);
        app_json_real(json, "end", seen->end[i]);
        app_json_real(json, "max_drift", seen->drift[i]);
        app_json_close(json, '}');
    }
    app_json_close(json, '}');
}

static void json_gradient(app_json *json, const report *what) {
    const simulation *sim = what->sim;
    const gradient *slope = what->slope;
    char label[64];
    app_json_real(json, "J", slope->j);
    app_json_reals(json, "dJ_dy0", slope->dy0, sim->reported);
    app_json_open(json, "dJ_dparameters", '{');
    for (size_t i = 0; i < lg_system_parameter_count(sim->system); i++) {
        lg_system_parameter_label(sim->system, i, label);
        app_json_real(json, label, slope->dparameters[i]);
    }
    app_json_close(json, '}');
    app_json_size(json, "checkpoints", slope->stats.checkpoints);
    app_json_size(json, "state_bytes", slope->stats.states_size);
    app_json_size(json, "tape_bytes", slope->stats.tape_size);
    app_json_real(json, "gradient_seconds", slope->stats.seconds);
}

void report_json(const report *what) {
    const simulation *sim = what->sim;
    const plan *how = what->how;
    const lg_scheme *scheme = how->scheme;
    app_json json;
    app_json_begin(&json);
    app_json_text(&json, "system", lg_system_name(sim->system));
    app_json_text(&json, "form", lg_system_form(sim->system));
    app_json_text(&json, "layout", lg_system_layout(sim->system));
    app_json_text(&json, "method", scheme->name);
    if (scheme->kind == LG_SCHEME_SLGI || scheme->kind == LG_SCHEME_IMPLICIT)
        app_json_real(&json, "theta", scheme->theta);
    if (how->steps > 0) {
        app_json_real(&json, "h", how->t_end / (double)how->steps);
    } else {
        app_json_real(&json, "rtol", how->rtol);
        app_json_real(&json, how->atol < 0 ? "atol_of_size" : "atol", fabs(how->atol));
    }
    app_json_size(&json, "steps", what->run->stats.steps);
    app_json_size(&json, "rejected", what->run->stats.rejected);
    app_json_size(&json, "evaluations", what->run->stats.evaluations);
    app_json_real(&json, "seconds", what->run->seconds);
    app_json_real(&json, "t", how->t_end);
    app_json_reals(&json, "y", final_state(what), sim->reported);
    json_invariants(&json, what->seen);
    app_json_real(&json, "manifold_error", what->seen->manifold);
    app_json_real(&json, "max_angle", what->run->stats.max_angle);
    if (sim->scene.projected) app_json_real(&json, "projection", sim->scene.projection);
    if (what->slope != NULL) json_gradient(&json, what);
    if (sim->values->out != NULL) {
        app_json_text(&json, "out", sim->values->out);
        app_json_size(&json, "points", what->path->kept);
    }
    app_json_warnings(&json, sim->self);
    app_json_end(&json);
}

/* ---- one screen ---- */

static void print_heading(const report *what) {
    const simulation *sim = what->sim;
    const plan *how = what->how;
    const lg_run_stats *stats = &what->run->stats;
    const char *form = lg_system_form(sim->system);
    const size_t links = lg_system_links(sim->system);
    (void)printf("%s%s%s", lg_system_name(sim->system), form != NULL ? ", " : "", form != NULL ? form : "");
    if (links > 0) (void)printf(", %zu link%s", links, links > 1 ? "s" : "");
    (void)printf(": %zu numbers\n%s, ", sim->reported, how->scheme->name);
    if (how->steps > 0)
        (void)printf("h = %g: t = %g after %zu steps, ", how->t_end / (double)how->steps, how->t_end,
                     stats->steps);
    else
        (void)printf("tolerance %g |y| + %g%s: t = %g after %zu steps (%zu more rejected), ", how->rtol,
                     fabs(how->atol), how->atol < 0 ? " of the largest" : "", how->t_end, stats->steps,
                     stats->rejected);
    (void)printf("%zu evaluations, %.3g s\n\n", stats->evaluations, what->run->seconds);
}

static void print_block(const block *at, const double *y) {
    char name[48];
    block_name(at, name, sizeof name);
    for (size_t i = 0; i < at->count; i++) {
        if (i == 0)
            (void)printf("%-8s", name);
        else if (at->columns > 1 && i % at->columns == 0)
            (void)printf("\n%-8s", "");
        (void)printf(" %23.16g", y[at->offset + i]);
    }
    (void)printf("\n");
}

/* The first ones and the last. */
static void print_blocks(const simulation *sim, const double *y) {
    const size_t n = sim->block_count, shown = n <= SHOWN_BLOCKS ? n : SHOWN_BLOCKS - 2;
    for (size_t i = 0; i < shown; i++) print_block(&sim->blocks[i], y);
    if (shown == n) return;
    (void)printf("... (--json prints all, --out writes them)\n");
    print_block(&sim->blocks[n - 1], y);
}

static void print_invariants(const watch *seen) {
    app_table table;
    const char *const heads[] = {"", "start", "end", "largest drift"};
    app_table_begin(&table, LG_COUNT(heads));
    for (size_t i = 0; i < LG_COUNT(heads); i++) app_table_cell(&table, "%s", heads[i]);
    for (size_t i = 0; i < seen->invariants; i++) {
        app_table_cell(&table, "%s", lg_system_invariant_name(seen->sim->system, i));
        app_table_cell(&table, "%.12g", seen->start[i]);
        app_table_cell(&table, "%.12g", seen->end[i]);
        app_table_cell(&table, "%.2e", seen->drift[i]);
    }
    if (lg_system_constrained(seen->sim->system)) {
        app_table_cell(&table, "manifold error");
        app_table_cell(&table, "%s", "");
        app_table_cell(&table, "%s", "");
        app_table_cell(&table, "%.2e", seen->manifold);
    }
    (void)printf("\n");
    app_table_end(&table, stdout);
}

static void print_gradient(const report *what) {
    const simulation *sim = what->sim;
    const gradient *slope = what->slope;
    char label[64];
    const size_t count = lg_system_parameter_count(sim->system);
    (void)printf("\nJ = %.17g; its gradient by the start, projected onto the tangent space:\n", slope->j);
    print_blocks(sim, slope->dy0);
    (void)printf("and in the parameters:\n");
    for (size_t i = 0; i < count; i++) {
        lg_system_parameter_label(sim->system, i, label);
        (void)printf("%s%s = %.10g", i % 4 > 0 ? ", " : i > 0 ? ",\n" : "", label, slope->dparameters[i]);
    }
    (void)printf("\n(%zu checkpoints, %zu bytes of states, a tape of %zu bytes, %.3g s)\n",
                 slope->stats.checkpoints, slope->stats.states_size, slope->stats.tape_size,
                 slope->stats.seconds);
}

void report_text(const report *what) {
    const simulate_values *values = what->sim->values;
    print_heading(what);
    print_blocks(what->sim, final_state(what));
    print_invariants(what->seen);
    if (what->slope != NULL) print_gradient(what);
    if (values->out != NULL) (void)printf("\n%s: %zu points\n", values->out, what->path->kept);
}
