/* Pictures of a run: components, drift of the invariants, distance from the manifold, step sizes. */
#include "lg-simulate/pictures.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_CURVES = 9, MAX_BLOCKS = 3, WIDTH = 900, HEIGHT = 520, SPACE_HEIGHT = 760 };

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

const char *colour(size_t i) {
    static const char *const colours[] = {"#1f5fa8", "#d1641f", "#2f8f4e", "#8e3fa8", "#b8242f",
                                          "#7a5c2e", "#12909a", "#555555", "#c49a00", "#e377c2"};
    return colours[i % LG_COUNT(colours)];
}

size_t end_block(drawing *to) {
    app_plot_block(&to->plot);
    return to->blocks++;
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

/* Writes a title such as "components of q" or "components of q_1, q_10, q_20 (of 20)". */
static void put_title(FILE *script, const char *key, const selection *chosen) {
    const char *separator = "";
    (void)fputs("set title 'components of ", script);
    if (chosen->shown == chosen->all) (void)fputs(symbol_of(key), script);
    for (size_t k = 0; k < chosen->count && chosen->shown < chosen->all; k++) {
        if (chosen->component[k] > 0) continue;
        (void)fprintf(script, "%s%s_{%zu}", separator, symbol_of(key), chosen->of[k]->index);
        separator = ", ";
    }
    if (chosen->shown < chosen->all) (void)fprintf(script, " (of %zu)", chosen->all);
    (void)fputs("'\n", script);
}

static void panel_components(drawing *to, const char *key) {
    FILE *script = to->plot.script.stream;
    const simulation *sim = to->what->sim;
    const selection chosen = select_components(sim, key);
    char name[96];
    for (size_t i = 0; i < to->what->path->kept; i++) {
        (void)fprintf(to->plot.data.stream, "%.9g", time_at(to, i));
        for (size_t k = 0; k < chosen.count; k++)
            (void)fprintf(to->plot.data.stream, " %.9g",
                          state_at(to, i)[chosen.of[k]->offset + chosen.component[k]]);
        (void)fputc('\n', to->plot.data.stream);
    }
    const size_t index = end_block(to);
    (void)fprintf(
        script,
        "unset logscale y\nset format y '%%g'\nset key outside right top samplen 1.5 nobox\nset xlabel 't "
        "[s]'\nset ylabel '%s%s'\n",
        symbol_of(key), unit_of(sim, key));
    put_title(script, key, &chosen);
    for (size_t k = 0; k < chosen.count; k++) {
        symbol_name(chosen.of[k], chosen.component[k], name, sizeof name);
        (void)fprintf(script, "%sdatafile index %zu using 1:%zu with lines lw 1.6 lc rgb '%s' title '%s'",
                      k == 0 ? "plot " : ", \\\n  ", index, 2 + k, colour(k), name);
    }
    (void)fputc('\n', script);
}

/* The first component of q against the first component of p, on R^2n. */
static void panel_phase(drawing *to) {
    FILE *script = to->plot.script.stream;
    const simulation *sim = to->what->sim;
    const block *q = find_block(sim, "q", 1), *p = find_block(sim, "p", 1);
    for (size_t i = 0; i < to->what->path->kept; i++)
        (void)fprintf(to->plot.data.stream, "%.9g %.9g\n", state_at(to, i)[q->offset],
                      state_at(to, i)[p->offset]);
    const char *below = q->count > 1 ? "_1" : "";
    (void)fprintf(script,
                  "unset logscale y\nset format y '%%g'\nunset key\nset xlabel 'q%s'\nset ylabel 'p%s'\n"
                  "set title 'phase portrait'\nset size ratio -1\n"
                  "set offsets graph 0.04, graph 0.04, graph 0.04, graph 0.04\n"
                  "plot datafile index %zu using 1:2 with lines lw 1.2 lc rgb '%s'\n"
                  "set size noratio\nunset offsets\n",
                  below, below, end_block(to), colour(0));
}

/* ---- values over the steps ---- */

/* Writes the trace as a data block: t, h, manifold error, drifts. Zeros become gaps, because the axis is
 * logarithmic. */
static size_t put_trace(drawing *to) {
    const trace *at = &to->what->seen->trace;
    for (size_t i = 0; i < at->count; i++) {
        for (size_t k = 0; k < at->width; k++) {
            const double value = at->rows[i * at->width + k];
            (void)fprintf(to->plot.data.stream, k > 0 ? " %.9g" : "%.9g",
                          value > 0 || k == 0 ? value : (double)NAN);
        }
        (void)fputc('\n', to->plot.data.stream);
    }
    return end_block(to);
}

/* Returns whether column k of the trace has a value that a logarithmic axis can show. */
static bool column_shows(const drawing *from, size_t k) {
    const trace *at = &from->what->seen->trace;
    for (size_t i = 0; i < at->count; i++)
        if (at->rows[i * at->width + k] > 0 && isfinite(at->rows[i * at->width + k])) return true;
    return false;
}

static void begin_logarithmic(FILE *script, const char *title, const char *label) {
    (void)fprintf(script,
                  "set logscale y\nset format y '10^{%%L}'\nset key inside bottom right samplen 1.5 nobox\n"
                  "set xlabel 't [s]'\nset title '%s'\nset ylabel '%s'\n",
                  title, label);
}

/* A panel without a curve shows the reason. */
static void put_empty(FILE *script, const char *why) {
    (void)fprintf(script,
                  "unset logscale y\nset format y '%%g'\nset yrange [-1:1]\nset xrange [0:1]\nunset "
                  "xtics\nunset ytics\n"
                  "plot NaN title '%s'\nset autoscale\nset xtics\nset ytics\n",
                  why);
}

static void panel_invariants(drawing *to) {
    FILE *script = to->plot.script.stream;
    const size_t index = put_trace(to);
    size_t shown = 0;
    begin_logarithmic(script, "drift of the invariants", "|I(t) - I(0)|");
    for (size_t k = 3; k < to->what->seen->trace.width; k++) {
        if (!column_shows(to, k)) continue;
        (void)fprintf(script, "%sdatafile index %zu using 1:%zu with lines lw 1.4 lc rgb '%s' title \"%s\"",
                      shown == 0 ? "plot " : ", \\\n  ", index, k + 1, colour(shown),
                      lg_system_invariant_name(to->what->sim->system, k - 3));
        shown++;
    }
    if (shown > 0)
        (void)fputc('\n', script);
    else
        put_empty(script,
                  lg_system_invariants(to->what->sim->system) > 0 ? "zero all along" : "the system has none");
}

static void panel_manifold(drawing *to) {
    FILE *script = to->plot.script.stream;
    const size_t index = put_trace(to);
    begin_logarithmic(script, "distance from the manifold", "largest violation of a constraint");
    if (column_shows(to, 2))
        (void)fprintf(
            script,
            "set yrange [1e-17:%s]\nplot datafile index %zu using 1:3 with points pt 7 ps 0.25 lc rgb '%s' "
            "notitle\nset autoscale y\n",
            to->what->seen->manifold < 1e-14 ? "1e-13" : "*", index, colour(3));
    else
        put_empty(script, "zero all along");
}

static void panel_steps(drawing *to) {
    FILE *script = to->plot.script.stream;
    const size_t index = put_trace(to);
    begin_logarithmic(script, "accepted steps", "h [s]");
    (void)fprintf(script, "plot datafile index %zu using 1:2 with %s lw 1.4 lc rgb '%s' notitle\n", index,
                  to->what->seen->trace.count < 400 ? "linespoints pt 7 ps 0.3" : "lines", colour(2));
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

static void begin(drawing *to, const char *picture, size_t columns, size_t rows) {
    const bool space = to->what->sim->values->plot_kind == PICTURE_SPACE;
    const int width = columns > 1 ? 560 * (int)columns : WIDTH;
    const int height = rows > 1 ? 380 * (int)rows : space ? SPACE_HEIGHT : HEIGHT;
    app_plot_begin(&to->plot, picture, width, height);
    FILE *script = to->plot.script.stream;
    (void)fputs("set encoding utf8\nset tics nomirror\n", script);
    if (columns * rows > 1) (void)fprintf(script, "set multiplot layout %zu,%zu\n", rows, columns);
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

static void draw_space(drawing *to) {
    const space_picture *picture = find_space_picture(to->what->sim);
    if (picture != NULL) picture->draw(to);
}

static const struct {
    void (*draw)(drawing *to);
    size_t columns, rows; /* 0: one panel per key */
} kinds[] = {[PICTURE_OVERVIEW] = {draw_overview, 2, 2},      [PICTURE_COMPONENTS] = {draw_components, 0, 0},
             [PICTURE_INVARIANTS] = {panel_invariants, 1, 1}, [PICTURE_MANIFOLD] = {panel_manifold, 1, 1},
             [PICTURE_STEPS] = {panel_steps, 1, 1},           [PICTURE_SPACE] = {draw_space, 1, 1}};

lg_status draw_run(const report *what, lg_error *error) {
    drawing to = {.what = what};
    const int kind = what->sim->values->plot_kind;
    const size_t panels = distinct_keys(what->sim);
    const size_t columns = kinds[kind].columns > 0 ? kinds[kind].columns : panels > 1 ? 2 : 1;
    const size_t rows = kinds[kind].rows > 0 ? kinds[kind].rows : (panels + columns - 1) / columns;
    begin(&to, what->sim->values->plot, columns, rows);
    kinds[kind].draw(&to);
    if (columns * rows > 1) (void)fputs("unset multiplot\n", to.plot.script.stream);
    return app_plot_end(what->sim->self, &to.plot, error);
}

bool has_space_picture(const simulation *sim) {
    return find_space_picture(sim) != NULL;
}
