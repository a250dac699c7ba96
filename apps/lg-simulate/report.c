/* Prints the result of a run. */
#include "lg-simulate/simulate.h"

#include <math.h>

enum { SHOWN_BLOCKS = 14 };

static void show_block(FILE *to, const block *at, const double *y) {
    char name[48];
    block_name(at, name, sizeof name);
    for (size_t i = 0; i < at->count; i++) {
        if (i % at->columns == 0 && (i == 0 || at->columns > 1))
            (void)fprintf(to, "%s%-8s", i > 0 ? "\n" : "", i > 0 ? "" : name);
        (void)fprintf(to, " %23.16g", y[at->offset + i]);
    }
    (void)fputc('\n', to);
}

/* Writes a state. For people each block is printed on its own lines; of many blocks only the first ones and
 * the last. */
static void put_state(app_json *out, const char *key, const simulation *sim, const double *y) {
    const size_t n = sim->block_count, shown = n <= SHOWN_BLOCKS ? n : SHOWN_BLOCKS - 2;
    app_json_reals(out, key, y, sim->reported);
    app_result_line(out, "%s:", key);
    for (size_t i = 0; i < shown && out->people; i++) show_block(out->stream, &sim->blocks[i], y);
    if (shown == n || !out->people) return;
    app_result_line(out, "... (--json prints all, --out writes them)");
    show_block(out->stream, &sim->blocks[n - 1], y);
}

static void put_invariants(app_json *out, const watch *seen) {
    app_result_named(out, "invariants", "invariant");
    for (size_t i = 0; i < seen->invariants; i++)
        APP_OBJECT(out, lg_system_invariant_name(seen->sim->system, i), LG_AS_REAL("start", seen->start[i]),
                   LG_AS_REAL("end", seen->end[i]), LG_AS_REAL("max_drift", seen->drift[i]));
    app_result_rows_end(out);
}

static void put_gradient(app_json *out, const report *what) {
    const simulation *sim = what->sim;
    const gradient *slope = what->slope;
    char label[64];
    app_result_real(out, "J", slope->j, "its gradient by the start, projected onto the tangent space,");
    put_state(out, "dJ_dy0", sim, slope->dy0);
    app_result_line(out, "and in the parameters:");
    app_json_open(out, "dJ_dparameters", '{');
    for (size_t i = 0; i < lg_system_parameter_count(sim->system); i++) {
        lg_system_parameter_label(sim->system, i, label);
        app_result_real(out, label, slope->dparameters[i], NULL);
    }
    app_json_close(out, '}');
    APP_PUT(out, APP_WHOLE("checkpoints", slope->stats.checkpoints, NULL),
            APP_WHOLE("state_bytes", slope->stats.states_size, NULL),
            APP_WHOLE("tape_bytes", slope->stats.tape_size, NULL),
            APP_REAL("gradient_seconds", slope->stats.seconds, NULL));
}

void report_run(const report *what) {
    const simulation *sim = what->sim;
    const plan *how = what->how;
    const lg_scheme *scheme = how->scheme;
    app_json *out = sim->self->out;
    APP_PUT(out, APP_TEXT("system", lg_system_name(sim->system), NULL),
            APP_TEXT("form", lg_system_form(sim->system), NULL),
            LG_AS_TEXT("layout", lg_system_layout(sim->system)), APP_TEXT("method", scheme->name, NULL));
    if (scheme->kind == LG_SCHEME_SLGI || scheme->kind == LG_SCHEME_IMPLICIT)
        app_result_real(out, "theta", scheme->theta, NULL);
    if (how->control.steps > 0) {
        app_result_real(out, "h", how->t_end / (double)how->control.steps, NULL);
    } else {
        APP_PUT(out, APP_REAL("rtol", how->control.rtol, NULL),
                APP_REAL(how->control.atol < 0 ? "atol_of_size" : "atol", fabs(how->control.atol), NULL));
    }
    APP_PUT(out, APP_WHOLE("steps", what->run->stats.steps, NULL),
            APP_WHOLE("rejected", what->run->stats.rejected, NULL),
            APP_WHOLE("evaluations", what->run->stats.evaluations, "of the field"),
            APP_REAL("seconds", what->run->seconds, NULL), APP_REAL("t", how->t_end, NULL));
    put_state(out, "y", sim, what->path->y + (what->path->count - 1) * sim->dim);
    put_invariants(out, what->seen);
    APP_PUT(out, APP_REAL("manifold_error", what->seen->manifold, "largest violation of a constraint"),
            LG_AS_REAL("max_angle", what->run->stats.max_angle));
    if (sim->scene.projected) app_json_real(out, "projection", sim->scene.projection);
    if (what->slope != NULL) put_gradient(out, what);
    if (sim->values->out != NULL)
        APP_PUT(out, APP_TEXT("out", sim->values->out, NULL), APP_WHOLE("points", what->path->kept, NULL));
}
