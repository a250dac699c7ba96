/* 3d pictures: the links of a chain, the axis of a top, the angular momentum or the attitude of a body,
 * quadrotors. */
#include "lg-simulate/pictures.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SNAPSHOTS = 6, WIDTH = 900, HEIGHT = 760 };

/* ---- shared functions ---- */

static void put_point(drawing *to, const double x[3]) {
    (void)fprintf(to->plot.data, "%.9g %.9g %.9g\n", x[0], x[1], x[2]);
}

static size_t snapshot_count(const drawing *from) {
    return from->what->path->kept < SNAPSHOTS ? from->what->path->kept : (size_t)SNAPSHOTS;
}

static size_t snapshot(const drawing *from, size_t k) {
    const size_t count = snapshot_count(from);
    return count > 1 ? k * (from->what->path->kept - 1) / (count - 1) : 0;
}

/* A box around everything that is drawn. */
typedef struct bounds {
    double low[3], high[3];
} bounds;

static void bounds_add(bounds *of, const double x[3]) {
    for (int i = 0; i < 3; i++) {
        of->low[i] = fmin(of->low[i], x[i]);
        of->high[i] = fmax(of->high[i], x[i]);
    }
}

/* Makes each side at least a third of the longest side, and adds a small margin. */
static void bounds_end(bounds *of) {
    double longest = 1e-3;
    for (int i = 0; i < 3; i++) longest = fmax(longest, of->high[i] - of->low[i]);
    for (int i = 0; i < 3; i++) {
        const double middle = 0.5 * (of->low[i] + of->high[i]);
        const double half = 0.53 * fmax(of->high[i] - of->low[i], longest / 3);
        of->low[i] = middle - half;
        of->high[i] = middle + half;
    }
}

/* A moving system: the path of one of its points, and some snapshots of the whole system. */
typedef struct motion {
    const char *kind; /* as in motion.gp */
    /* Computes the point of the path, and extends the box by everything in the picture of a state. */
    void (*point)(const simulation *sim, const double *y, bounds *box, double x[3]);
    /* Writes a snapshot as the rows of a data block. */
    void (*put)(drawing *to, const double *y, bounds *box);
} motion;

static void begin_space(drawing *to, const char *script, const char *text) {
    app_plot_begin(&to->plot, script, to->what->sim->values->plot, WIDTH, HEIGHT);
    app_plot_text(&to->plot, "%s", text);
}

static void draw_motion(drawing *to, const motion *what) {
    const size_t count = snapshot_count(to);
    bounds box = {{HUGE_VAL, HUGE_VAL, HUGE_VAL}, {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}};
    begin_space(to, "motion", what->kind);
    app_plot_text(&to->plot, "%zu", lg_system_links(to->what->sim->system));
    app_plot_text(&to->plot, "%zu", count);
    for (size_t i = 0; i < to->what->path->kept; i++) {
        double x[3];
        what->point(to->what->sim, state_at(to, i), &box, x);
        put_point(to, x);
    }
    app_plot_block(&to->plot);
    for (size_t k = 0; k < count; k++) {
        app_plot_text(&to->plot, "t = %.3g s", time_at(to, snapshot(to, k)));
        what->put(to, state_at(to, snapshot(to, k)), &box);
        app_plot_block(&to->plot);
    }
    bounds_end(&box);
    for (int i = 0; i < 3; i++) {
        app_plot_text(&to->plot, "%g", box.low[i]);
        app_plot_text(&to->plot, "%g", box.high[i]);
    }
}

/* ---- chains ---- */

/* Positions of the masses, (links + 1, 3); mass 0 is the suspension. Freed with free. */
static double *mass_positions(const simulation *sim, const double *y, size_t *count) {
    const double *lengths = parameter_values(sim, "lengths", count);
    double *x = app_alloc(3 * (*count + 1), sizeof *x);
    for (size_t i = 0; i < *count; i++) {
        const double *q = y + find_block(sim, "q", i + 1)->offset;
        for (size_t c = 0; c < 3; c++) x[3 * (i + 1) + c] = x[3 * i + c] + lengths[i] * q[c];
    }
    return x;
}

static void last_mass(const simulation *sim, const double *y, bounds *box, double last[3]) {
    size_t links = 0;
    APP_FREE double *x = mass_positions(sim, y, &links);
    for (size_t j = 0; j <= links; j++) bounds_add(box, x + 3 * j);
    memcpy(last, x + 3 * links, 3 * sizeof *last);
}

static void put_masses(drawing *to, const double *y, bounds *box) {
    size_t links = 0;
    APP_FREE double *x = mass_positions(to->what->sim, y, &links);
    (void)box;
    for (size_t j = 0; j <= links; j++) put_point(to, x + 3 * j);
}

static void draw_chain(drawing *to) {
    draw_motion(to, &(motion){"chain", last_mass, put_masses});
}

/* ---- curves on the unit sphere ---- */

typedef struct sphere_curve {
    const char *title;
    void (*point)(const simulation *sim, const double *y, double x[3]);
} sphere_curve;

static void put_sphere(drawing *to, const char *title, const sphere_curve *curves, size_t count) {
    begin_space(to, "sphere", title);
    app_plot_text(&to->plot, "%zu", count);
    for (size_t c = 0; c < count; c++) {
        double x[3];
        app_plot_text(&to->plot, "%s", curves[c].title);
        for (size_t i = 0; i < to->what->path->kept; i++) {
            curves[c].point(to->what->sim, state_at(to, i), x);
            put_point(to, x);
        }
        app_plot_block(&to->plot);
    }
}

static void unit(const double *from, double x[3]) {
    const double length = sqrt(from[0] * from[0] + from[1] * from[1] + from[2] * from[2]);
    for (int i = 0; i < 3; i++) x[i] = length > 0 ? from[i] / length : 0;
}

static void unit_momentum(const simulation *sim, const double *y, double x[3]) {
    unit(y + find_block(sim, "mu", 1)->offset, x);
}

static void unit_gamma(const simulation *sim, const double *y, double x[3]) {
    unit(y + find_block(sim, "Gamma", 1)->offset, x);
}

/* The top's axis Q chi. */
static void top_axis(const simulation *sim, const double *y, double x[3]) {
    size_t count = 0;
    const double *chi = parameter_values(sim, "chi", &count), *Q = y + find_block(sim, "Q", 1)->offset;
    for (int i = 0; i < 3; i++) x[i] = Q[3 * i] * chi[0] + Q[3 * i + 1] * chi[1] + Q[3 * i + 2] * chi[2];
}

static void body_axis(const simulation *sim, const double *y, int axis, double x[3]) {
    const double *R = y + find_block(sim, "R", 1)->offset;
    for (int i = 0; i < 3; i++) x[i] = R[3 * i + axis];
}

static void body_axis_1(const simulation *sim, const double *y, double x[3]) {
    body_axis(sim, y, 0, x);
}

static void body_axis_2(const simulation *sim, const double *y, double x[3]) {
    body_axis(sim, y, 1, x);
}

static void body_axis_3(const simulation *sim, const double *y, double x[3]) {
    body_axis(sim, y, 2, x);
}

static void draw_top(drawing *to) {
    static const sphere_curve axis = {"Qχ", top_axis}, gamma = {"Γ/|Γ|", unit_gamma};
    if (find_block(to->what->sim, "Q", 1) != NULL)
        put_sphere(to, "axis of the top", &axis, 1);
    else
        put_sphere(to, "direction of gravity seen from the body", &gamma, 1);
}

static void draw_body(drawing *to) {
    static const sphere_curve momentum = {"μ/|μ|", unit_momentum};
    put_sphere(to, "angular momentum in the body", &momentum, 1);
}

static void draw_attitude(drawing *to) {
    static const sphere_curve axes[] = {
        {"R e_1", body_axis_1}, {"R e_2", body_axis_2}, {"R e_3", body_axis_3}};
    put_sphere(to, "axes of the body in space", axes, LG_COUNT(axes));
}

/* The numbers of the pendulum's direction start at 12. */
static void pendulum_direction(const simulation *sim, const double *y, double x[3]) {
    (void)sim;
    memcpy(x, y + 12, 3 * sizeof *x);
}

static void draw_satellite(drawing *to) {
    static const sphere_curve curves[] = {{"R e_3", body_axis_3}, {"pendulum q", pendulum_direction}};
    put_sphere(to, "axis of the body and direction of the pendulum", curves, LG_COUNT(curves));
}

/* ---- quadrotors: e3 points down, so the picture has the axes e1, -e2 and -e3 ---- */

static void turned(const double from[3], double x[3]) {
    x[0] = from[0];
    x[1] = -from[1];
    x[2] = -from[2];
}

/* Writes a row with the beginning of the segment and its vector, both in the axes of the picture. */
static void put_segment(drawing *to, const double from[3], const double end[3], bounds *box) {
    double a[3], b[3];
    turned(from, a);
    turned(end, b);
    bounds_add(box, a);
    bounds_add(box, b);
    (void)fprintf(to->plot.data, "%.9g %.9g %.9g %.9g %.9g %.9g\n", a[0], a[1], a[2], b[0] - a[0],
                  b[1] - a[1], b[2] - a[2]);
}

/* Writes the link and the two arms of each quadrotor. */
static void put_quadrotors(drawing *to, const double *y, bounds *box) {
    const simulation *sim = to->what->sim;
    size_t count = 0;
    const double *lengths = parameter_values(sim, "lengths", &count);
    const double *payload = y + find_block(sim, "y", 1)->offset;
    for (size_t i = 0; i < count; i++) {
        const double *q = y + find_block(sim, "q", i + 1)->offset,
                     *R = y + find_block(sim, "R", i + 1)->offset;
        double at[3], ends[2][3];
        for (int c = 0; c < 3; c++) at[c] = payload[c] - lengths[i] * q[c];
        put_segment(to, payload, at, box);
        for (int arm = 0; arm < 2; arm++) {
            for (int c = 0; c < 3; c++) {
                ends[0][c] = at[c] - 0.2 * R[3 * c + arm];
                ends[1][c] = at[c] + 0.2 * R[3 * c + arm];
            }
            put_segment(to, ends[0], ends[1], box);
        }
    }
}

static void payload(const simulation *sim, const double *y, bounds *box, double x[3]) {
    turned(y + find_block(sim, "y", 1)->offset, x);
    bounds_add(box, x);
}

static void draw_quadrotors(drawing *to) {
    draw_motion(to, &(motion){"quadrotors", payload, put_quadrotors});
}

/* ---- pictures by system ---- */

static const space_picture pictures[] = {
    {"pendulum-chain", draw_chain},         {"heavy-top", draw_top},       {"rigid-body", draw_body},
    {"rigid-body-attitude", draw_attitude}, {"satellite", draw_satellite}, {"quadrotors", draw_quadrotors}};

const space_picture *find_space_picture(const simulation *sim) {
    for (size_t i = 0; i < LG_COUNT(pictures); i++)
        if (strcmp(pictures[i].system, lg_system_name(sim->system)) == 0) return &pictures[i];
    return NULL;
}
