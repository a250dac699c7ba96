/* Plots of a run: components, drift of the invariants, distance from the manifold, step sizes; and in
 * space the links of a chain, the axis of a top, the angular momentum or the attitude of a body,
 * quadrotors. */
#include <string.h>

#include "lg-simulate/simulate.h"

enum { MAX_CURVES = 9, MAX_BLOCKS = 3, SNAPSHOTS = 6 };

/* The state at point i of the trajectory, and the times of all points. */
static const double *state_at(const report *what, size_t i) {
    return what->path->y + (what->path->first + i) * what->sim->dim;
}

static const double *time_at(const report *what) {
    return what->path->t + what->path->first;
}

/* ---- components ---- */

/* Draws up to three blocks with this key: the first, a middle one and the last. */
static void put_components(app_plot *plot, const report *what, const char *key) {
    const simulation *sim = what->sim;
    const block *first = find_block(sim, key, 1);
    const size_t each = first->count < MAX_CURVES ? first->count : MAX_CURVES, fit = MAX_CURVES / each;
    app_plot_column columns[1 + MAX_BLOCKS] = {{time_at(what), 1, 1}};
    size_t all = 0, shown = fit < MAX_BLOCKS ? fit : MAX_BLOCKS;
    for (size_t i = 0; i < sim->block_count; i++) all += strcmp(sim->blocks[i].key, key) == 0;
    if (all < shown) shown = all;
    app_plot_text(plot, "components\t%s\t%d\t%zu\t%zu\t%zu", key, lg_system_links(sim->system) > 0, all,
                  shown, each);
    for (size_t k = 0; k < shown; k++) {
        const block *at = find_block(sim, key, shown > 1 ? 1 + k * (all - 1) / (shown - 1) : 1);
        app_plot_text(plot, "%zu", at->index);
        columns[1 + k] = (app_plot_column){state_at(what, 0) + at->offset, sim->dim, each};
    }
    for (size_t c = 0; c < each; c++) {
        char part[48];
        block_part(first, c, part, sizeof part);
        app_plot_text(plot, "%s", part);
    }
    app_plot_columns(plot, 9, what->path->kept, columns, 1 + shown);
    app_plot_block(plot);
}

/* ---- panels ---- */

/* Draws over time the drift of the invariants, the distance from the manifold, the sizes of the steps, or the
 * components of the blocks with this key. */
static void put_panel(app_plot *plot, const report *what, const char *kind) {
    const bool named = strcmp(kind, "invariants") == 0;
    const size_t count = named ? lg_system_invariants(what->sim->system) : 0;
    if (find_block(what->sim, kind, 1) != NULL) {
        put_components(plot, what, kind);
        return;
    }
    app_plot_text(plot, named ? "%s\t%zu" : "%s", kind, count);
    for (size_t i = 0; i < count; i++)
        app_plot_text(plot, "%s", lg_system_invariant_name(what->sim->system, i));
}

static void put_overview(app_plot *plot, const report *what) {
    const simulation *sim = what->sim;
    const block *q = find_block(sim, "q", 1), *p = find_block(sim, "p", 1);
    const bool constrained = lg_system_constrained(sim->system);
    const char *first = sim->blocks[0].key, *second = first;
    for (size_t i = sim->block_count; i-- > 1;)
        if (strcmp(sim->blocks[i].key, first) != 0) second = sim->blocks[i].key;
    put_panel(plot, what, first);
    put_panel(plot, what, what->seen->invariants > 0 ? "invariants" : second);
    if (!constrained && q != NULL && p != NULL) { /* their first components, on R^2n */
        const double *y = state_at(what, 0);
        app_plot_text(plot, q->count > 1 ? "phase\tq_1\tp_1" : "phase\tq\tp");
        APP_PLOT_COLUMNS(plot, 9, what->path->kept, {y + q->offset, sim->dim, 1},
                         {y + p->offset, sim->dim, 1});
        app_plot_block(plot);
    } else {
        put_panel(plot, what, constrained ? "manifold" : second);
    }
    put_panel(plot, what, what->how->control.steps == 0 ? "steps" : second);
}

/* ---- space ---- */

/* Writes the point that leaves a path; with `whole` a snapshot of all. */
typedef void put_motion(app_plot *plot, const report *what, const double *y, bool whole);

static void put_chain(app_plot *plot, const report *what, const double *y, bool whole) {
    size_t links = 0;
    const double *lengths = parameter_values(what->sim, "lengths", &links);
    double x[3] = {0, 0, 0};
    if (whole) APP_PLOT_COLUMNS(plot, 9, 1, {x, 0, 3});
    for (size_t i = 0; i < links; i++) {
        const double *q = y + find_block(what->sim, "q", i + 1)->offset;
        for (size_t c = 0; c < 3; c++) x[c] += lengths[i] * q[c];
        if (whole || i + 1 == links) APP_PLOT_COLUMNS(plot, 9, 1, {x, 0, 3});
    }
}

/* The link and with attitudes the two arms of each quadrotor: the beginning of a line and its vector. */
static void put_quadrotors(app_plot *plot, const report *what, const double *y, bool whole) {
    size_t count = 0;
    const double *lengths = parameter_values(what->sim, "lengths", &count);
    const double *payload = y + find_block(what->sim, "y", 1)->offset;
    if (!whole) APP_PLOT_COLUMNS(plot, 9, 1, {payload, 0, 3});
    for (size_t i = 0; i < count && whole; i++) {
        const double *q = y + find_block(what->sim, "q", i + 1)->offset;
        const block *attitude = find_block(what->sim, "R", i + 1);
        double line[3][6];
        for (int c = 0; c < 3; c++) {
            line[0][c] = payload[c];
            line[0][3 + c] = -lengths[i] * q[c];
            for (int arm = 0; arm < 2 && attitude != NULL; arm++) {
                line[1 + arm][3 + c] = 0.4 * y[attitude->offset + 3 * c + arm];
                line[1 + arm][c] = payload[c] + line[0][3 + c] - 0.5 * line[1 + arm][3 + c];
            }
        }
        APP_PLOT_COLUMNS(plot, 9, attitude != NULL ? 3 : 1, {line[0], 6, 6});
    }
}

/* A curve on the unit sphere: a vector of the state, or a matrix of the state times a vector. */
typedef struct sphere_curve {
    const char *title, *key, *parameter; /* parameter: the key of the vector, or NULL for a unit vector */
    size_t axis;
} sphere_curve;

/* Plots by system: curves on the sphere or a motion. Of several rows for a system the first one whose
 * curve is part of the state. */
static const struct space_plot {
    const char *system, *title;
    sphere_curve curves[3 + 1]; /* and a last one without a key */
    put_motion *motion;
} plots[] = {
    {"pendulum-chain", "chain", .motion = put_chain},
    {"quadrotors", "quadrotors", .motion = put_quadrotors},
    {"heavy-top", "axis of the top", .curves = {{"Qχ", "Q", "chi", 0}}},
    {"heavy-top", "direction of gravity seen from the body", .curves = {{"Γ/|Γ|", "Gamma", NULL, 0}}},
    {"rigid-body", "angular momentum in the body", .curves = {{"μ/|μ|", "mu", NULL, 0}}},
    {"rigid-body-attitude", "axes of the body in space",
     .curves = {{"R e_1", "R", NULL, 0}, {"R e_2", "R", NULL, 1}, {"R e_3", "R", NULL, 2}}},
    {"satellite", "axis of the body and direction of the pendulum",
     .curves = {{"R e_3", "R", NULL, 2}, {"pendulum q", "q", NULL, 0}}}};

/* Returns the row of the system's plot, or NULL. */
static const struct space_plot *find_space(const simulation *sim) {
    for (const struct space_plot *at = plots; at < plots + LG_COUNT(plots); at++)
        if (strcmp(at->system, lg_system_name(sim->system)) == 0 &&
            (at->motion != NULL || find_block(sim, at->curves[0].key, 1) != NULL))
            return at;
    return NULL;
}

/* Curves on the sphere, or the path of one point of a moving system and some snapshots of the whole. */
static void put_space(app_plot *plot, const void *user) {
    const report *what = user;
    const struct space_plot *row = find_space(what->sim);
    const size_t kept = what->path->kept;
    app_plot_text(plot, "%s", row->title);
    if (row->motion == NULL) plot->script = "sphere";
    for (const sphere_curve *curve = row->curves; curve->key != NULL; curve++) {
        double vector[3] = {0, 0, 0};
        size_t numbers = 0;
        vector[curve->axis] = 1;
        const block *at = find_block(what->sim, curve->key, 1);
        const double *by =
            curve->parameter != NULL ? parameter_values(what->sim, curve->parameter, &numbers) : vector;
        app_plot_text(plot, "%s\t%d\t%.17g\t%.17g\t%.17g", curve->title, at->count == 9, by[0], by[1], by[2]);
        APP_PLOT_COLUMNS(plot, 9, kept, {state_at(what, 0) + at->offset, what->sim->dim, at->count});
        app_plot_block(plot);
    }
    if (row->motion == NULL) return;
    const size_t count = kept < SNAPSHOTS ? kept : (size_t)SNAPSHOTS;
    app_plot_text(plot, "%zu", lg_system_links(what->sim->system));
    for (size_t i = 0; i < kept; i++) row->motion(plot, what, state_at(what, i), false);
    for (size_t k = 0; k < count; k++) {
        const size_t at = count > 1 ? k * (kept - 1) / (count - 1) : 0;
        app_plot_block(plot);
        app_plot_text(plot, "t = %.3g s", time_at(what)[at]);
        row->motion(plot, what, state_at(what, at), true);
    }
}

/* ---- the plots ---- */

/* The numbers of the steps, and the panels of the kind. */
static void put_run(app_plot *plot, const void *user) {
    const report *what = user;
    const trace *at = &what->seen->trace;
    APP_PLOT_COLUMNS(plot, 9, at->count, {at->rows, at->width, at->width});
    app_plot_block(plot);
    if (strcmp(plot->kind, "overview") == 0)
        put_overview(plot, what);
    else if (strcmp(plot->kind, "components") != 0)
        put_panel(plot, what, plot->kind);
    else
        for (const block *b = what->sim->blocks; b < what->sim->blocks + what->sim->block_count; b++)
            if (find_block(what->sim, b->key, 1) == b) put_components(plot, what, b->key);
}

enum { SPACE = 2 };
static char no_space[96];
const app_plot_kind simulate_plots[] = {
    APP_PLOT("overview", "four panels", "simulation", put_run),
    APP_PLOT("components", "of the state", "simulation", put_run),
    APP_PLOT("invariants", "their drift", "simulation", put_run),
    APP_PLOT("manifold", "the distance from it", "simulation", put_run),
    APP_PLOT("steps", "their sizes", "simulation", put_run),
    APP_PLOT("3d", "the motion in space", "motion", put_space, SPACE, no_space),
    {.name = NULL}};

unsigned simulate_has(const simulation *sim) {
    (void)snprintf(no_space, sizeof no_space, "there is no spatial plot of %s", lg_system_name(sim->system));
    return find_space(sim) != NULL ? SPACE : 0;
}
