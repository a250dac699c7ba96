/* Pictures of a run: components, drift of the invariants, distance from the manifold, step sizes. */
#include "lg-simulate/pictures.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_CURVES = 9, MAX_BLOCKS = 3, WIDTH = 900, HEIGHT = 520 };

/* Symbols and units for the keys of a state. The units are those of chains, where q is a direction. */
static const struct {
    const char *key, *symbol, *unit;
} symbols[] = {{"omega", "ω", " [rad/s]"}, {"Omega", "Ω", " [rad/s]"}, {"mu", "μ", " [kg m^2/s]"},
               {"pi", "π", " [kg m^2/s]"}, {"Pi", "Π", " [kg m^2/s]"}, {"Gamma", "Γ", ""},
               {"y", "y", " [m]"},         {"v", "v", " [m/s]"}};

static const char *symbol_of(const char *key) {
    for (size_t i = 0; i < LG_COUNT(symbols); i++)
        if (strcmp(symbols[i].key, key) == 0) return symbols[i].symbol;
    return key;
}

static const char *unit_of(const simulation *sim, const char *key) {
    for (size_t i = 0; i < LG_COUNT(symbols); i++)
        if (strcmp(symbols[i].key, key) == 0) return symbols[i].unit;
    return strcmp(key, "p") == 0 && lg_system_links(sim->system) > 0 ? " [kg m^2/s]" : "";
}

const double *state_at(const drawing *from, size_t i) {
    const samples *path = from->what->path;
    return path->y + (path->first + i) * from->what->sim->dim;
}

double time_at(const drawing *from, size_t i) {
    const samples *path = from->what->path;
    return path->t[path->first + i];
}

/* ---- components ---- */

typedef struct selection {
    size_t count;
    const block *of[MAX_CURVES];
    size_t component[MAX_CURVES];
    size_t shown, all; /* how many blocks with the key are drawn, and how many there are */
} selection;

/* Chooses up to three blocks with this key: the first, a middle one and the last. */
static selection select_components(const simulation *sim, const char *key) {
    selection out = {.count = 0};
    for (size_t i = 0; i < sim->block_count; i++) out.all += strcmp(sim->blocks[i].key, key) == 0;
    const size_t per_block = find_block(sim, key, 1)->count;
    size_t most = per_block < MAX_CURVES ? MAX_CURVES / per_block : 1;
    if (most > MAX_BLOCKS) most = MAX_BLOCKS;
    out.shown = out.all < most ? out.all : most;
    for (size_t k = 0; k < out.shown; k++) {
        const size_t index = out.shown > 1 ? 1 + k * (out.all - 1) / (out.shown - 1) : 1;
        const block *at = find_block(sim, key, index);
        for (size_t c = 0; c < at->count && out.count < MAX_CURVES; c++) {
            out.of[out.count] = at;
            out.component[out.count++] = c;
        }
    }
    return out;
}

/* Writes a symbol such as q_{2,x}. */
static void symbol_name(const block *at, size_t component, char *text, size_t size) {
    char below[48] = "";
    if (at->count == 9)
        (void)snprintf(below, sizeof below, "%zu%zu", component / 3 + 1, component % 3 + 1);
    else if (at->count == 3)
        (void)snprintf(below, sizeof below, "%c", "xyz"[component]);
    else if (at->count > 1)
        (void)snprintf(below, sizeof below, "%zu", component + 1);
    if (at->index > 0)
        (void)snprintf(text, size, "%s_{%zu%s%s}", symbol_of(at->key), at->index, below[0] != '\0' ? "," : "",
                       below);
    else if (below[0] != '\0')
        (void)snprintf(text, size, "%s_{%s}", symbol_of(at->key), below);
    else
        (void)snprintf(text, size, "%s", symbol_of(at->key));
}

/* Begins panel `kind` of simulation.gp; the names of its curves follow. */
static void begin_panel(drawing *to, const char *kind, const char *title, const char *x, const char *y,
                        size_t curves) {
    const char *const texts[] = {kind, title, x, y};
    for (size_t i = 0; i < LG_COUNT(texts); i++) app_plot_text(&to->plot, "%s", texts[i]);
    app_plot_text(&to->plot, "%zu", curves);
}

/* Returns a title such as "components of q" or "components of q_1, q_10, q_20 (of 20)". */
static char *components_title(const char *key, const selection *chosen) {
    lg_text title = app_text();
    lg_text_add(&title, "components of %s", chosen->shown == chosen->all ? symbol_of(key) : "");
    for (size_t k = 0; k < chosen->count && chosen->shown < chosen->all; k++)
        if (chosen->component[k] == 0)
            lg_text_add(&title, "%s%s_{%zu}", k > 0 ? ", " : "", symbol_of(key), chosen->of[k]->index);
    if (chosen->shown < chosen->all) lg_text_add(&title, " (of %zu)", chosen->all);
    return title.data;
}

static void panel_components(drawing *to, const char *key) {
    const simulation *sim = to->what->sim;
    const selection chosen = select_components(sim, key);
    APP_FREE char *title = components_title(key, &chosen);
    APP_FREE char *label = app_format("%s%s", symbol_of(key), unit_of(sim, key));
    char name[96];
    begin_panel(to, "components", title, "t [s]", label, chosen.count);
    for (size_t k = 0; k < chosen.count; k++) {
        symbol_name(chosen.of[k], chosen.component[k], name, sizeof name);
        app_plot_text(&to->plot, "%s", name);
    }
    for (size_t i = 0; i < to->what->path->kept; i++) {
        (void)fprintf(to->plot.data, "%.9g", time_at(to, i));
        for (size_t k = 0; k < chosen.count; k++)
            (void)fprintf(to->plot.data, " %.9g",
                          state_at(to, i)[chosen.of[k]->offset + chosen.component[k]]);
        (void)fputc('\n', to->plot.data);
    }
    app_plot_block(&to->plot);
}

/* The first component of q against the first component of p, on R^2n. */
static void panel_phase(drawing *to) {
    const simulation *sim = to->what->sim;
    const block *q = find_block(sim, "q", 1), *p = find_block(sim, "p", 1);
    begin_panel(to, "phase", "phase portrait", q->count > 1 ? "q_1" : "q", q->count > 1 ? "p_1" : "p", 1);
    app_plot_text(&to->plot, "%s", "");
    for (size_t i = 0; i < to->what->path->kept; i++)
        (void)fprintf(to->plot.data, "%.9g %.9g\n", state_at(to, i)[q->offset], state_at(to, i)[p->offset]);
    app_plot_block(&to->plot);
}

/* ---- values over the steps ---- */

/* Returns whether column k of the trace has a value that a logarithmic axis can show. */
static bool column_shows(const drawing *from, size_t k) {
    const trace *at = &from->what->seen->trace;
    for (size_t i = 0; i < at->count; i++)
        if (at->rows[i * at->width + k] > 0 && isfinite(at->rows[i * at->width + k])) return true;
    return false;
}

/* Draws the columns first, first + 1, ..., first + count - 1 of the trace that a logarithmic axis can show,
 * against t. Their zeros become gaps. A panel without a curve shows the reason `empty`. */
static void panel_trace(drawing *to, const char *kind, const char *title, const char *label, size_t first,
                        size_t count, const char *empty) {
    const trace *at = &to->what->seen->trace;
    APP_FREE size_t *columns = app_alloc(at->width, sizeof *columns);
    size_t shown = 0;
    for (size_t k = first; k < first + count; k++)
        if (column_shows(to, k)) columns[shown++] = k;
    begin_panel(to, kind, title, "t [s]", label, shown);
    if (shown == 0) app_plot_text(&to->plot, "%s", empty);
    for (size_t c = 0; c < shown; c++) {
        const bool named = columns[c] >= 3;
        app_plot_text(&to->plot, "%s",
                      named ? lg_system_invariant_name(to->what->sim->system, columns[c] - 3) : "");
    }
    for (size_t i = 0; i < at->count; i++) {
        const double *row = at->rows + i * at->width;
        (void)fprintf(to->plot.data, "%.9g", row[0]);
        for (size_t c = 0; c < shown; c++)
            (void)fprintf(to->plot.data, " %.9g", row[columns[c]] > 0 ? row[columns[c]] : (double)NAN);
        (void)fputc('\n', to->plot.data);
    }
    app_plot_block(&to->plot);
}

static void panel_invariants(drawing *to) {
    const size_t count = lg_system_invariants(to->what->sim->system);
    panel_trace(to, "invariants", "drift of the invariants", "|I(t) - I(0)|", 3, count,
                count > 0 ? "zero all along" : "the system has none");
}

static void panel_manifold(drawing *to) {
    panel_trace(to, to->what->seen->manifold < 1e-14 ? "rounding" : "manifold", "distance from the manifold",
                "largest violation of a constraint", 2, 1, "zero all along");
}

static void panel_steps(drawing *to) {
    panel_trace(to, to->what->seen->trace.count < 400 ? "steps" : "many steps", "accepted steps", "h [s]", 1,
                1, "no steps");
}

/* ---- pictures ---- */

static const char *key_after(const simulation *sim, const char *key) {
    for (size_t i = 0; i < sim->block_count; i++)
        if (strcmp(sim->blocks[i].key, key) != 0) return sim->blocks[i].key;
    return NULL;
}

/* Returns whether block i is the first block with its key. */
static bool begins_key(const simulation *sim, size_t i) {
    size_t first = 0;
    while (strcmp(sim->blocks[first].key, sim->blocks[i].key) != 0) first++;
    return first == i;
}

static size_t distinct_keys(const simulation *sim) {
    size_t count = 0;
    for (size_t i = 0; i < sim->block_count; i++) count += begins_key(sim, i);
    return count;
}

static void draw_overview(drawing *to) {
    const simulation *sim = to->what->sim;
    const bool adaptive = to->what->how->steps == 0, flat = !lg_system_constrained(sim->system);
    const char *first = sim->blocks[0].key, *second = key_after(sim, first);
    panel_components(to, first);
    if (to->what->seen->invariants > 0)
        panel_invariants(to);
    else
        panel_components(to, second != NULL ? second : first);
    if (!flat)
        panel_manifold(to);
    else if (find_block(sim, "q", 1) != NULL && find_block(sim, "p", 1) != NULL)
        panel_phase(to);
    else
        panel_components(to, second != NULL ? second : first);
    if (adaptive)
        panel_steps(to);
    else
        panel_components(to, second != NULL ? second : first);
}

static void draw_components(drawing *to) {
    const simulation *sim = to->what->sim;
    for (size_t i = 0; i < sim->block_count; i++)
        if (begins_key(sim, i)) panel_components(to, sim->blocks[i].key);
}

static const struct {
    void (*draw)(drawing *to);
    size_t panels; /* 0: one panel per key */
} kinds[] = {[PICTURE_OVERVIEW] = {draw_overview, 4},
             [PICTURE_COMPONENTS] = {draw_components, 0},
             [PICTURE_INVARIANTS] = {panel_invariants, 1},
             [PICTURE_MANIFOLD] = {panel_manifold, 1},
             [PICTURE_STEPS] = {panel_steps, 1}};

static void draw_panels(drawing *to) {
    const simulate_values *values = to->what->sim->values;
    const size_t fixed = kinds[values->plot_kind].panels,
                 panels = fixed > 0 ? fixed : distinct_keys(to->what->sim);
    const int rows = (int)(panels + 1) / 2;
    app_plot_begin(&to->plot, "simulation", values->plot, panels > 1 ? 1120 : WIDTH,
                   rows > 1 ? 380 * rows : HEIGHT);
    app_plot_text(&to->plot, "%zu", panels);
    kinds[values->plot_kind].draw(to);
}

/* For PICTURE_SPACE there must be a 3d picture of the system. */
lg_status draw_run(const report *what, lg_error *error) {
    drawing to = {.what = what};
    if (what->sim->values->plot_kind == PICTURE_SPACE)
        find_space_picture(what->sim)->draw(&to);
    else
        draw_panels(&to);
    return app_plot_end(what->sim->self, &to.plot, error);
}

bool has_space_picture(const simulation *sim) {
    return find_space_picture(sim) != NULL;
}
