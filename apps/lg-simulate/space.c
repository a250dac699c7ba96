/* 3d pictures: the links of a chain, the axis of a top, the angular momentum or the attitude of a body,
 * quadrotors. */
#include "lg-simulate/pictures.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SNAPSHOTS = 6 };

/* ---- shared functions ---- */

/* Colour from light to dark with time, s in [0, 1]. */
static void shade(double s, char text[8]) {
    static const double light[3] = {190, 210, 235}, dark[3] = {16, 54, 104};
    int part[3];
    for (int i = 0; i < 3; i++) part[i] = (int)(light[i] + s * (dark[i] - light[i]) + 0.5);
    (void)snprintf(text, 8, "#%02x%02x%02x", part[0] & 255, part[1] & 255, part[2] & 255);
}

static void put_point(drawing *to, const double x[3]) {
    (void)fprintf(to->plot.data.stream, "%.9g %.9g %.9g\n", x[0], x[1], x[2]);
}

static size_t snapshot_count(const drawing *from) {
    return from->what->path->kept < SNAPSHOTS ? from->what->path->kept : (size_t)SNAPSHOTS;
}

static size_t snapshot(const drawing *from, size_t k) {
    const size_t count = snapshot_count(from);
    return count > 1 ? k * (from->what->path->kept - 1) / (count - 1) : 0;
}

/* Distance between tics that gives about five tics on the longest axis. */
static double tic_distance(const double low[3], const double high[3]) {
    double longest = 0;
    for (int i = 0; i < 3; i++) longest = fmax(longest, high[i] - low[i]);
    const double rough = longest / 5, power = pow(10, floor(log10(rough)));
    return rough > 5 * power ? 10 * power : rough > 2 * power ? 5 * power : rough > power ? 2 * power : power;
}

static void put_axes(FILE *script, const char *title, const double low[3], const double high[3]) {
    const double tics = tic_distance(low, high);
    (void)fprintf(
        script,
        "set title \"%s\"\nset view 68,30,1.15\nset view equal xyz\nset xyplane relative 0\n"
        "set xrange [%g:%g]\nset yrange [%g:%g]\nset zrange [%g:%g]\nset xtics %g\nset ytics %g\nset ztics "
        "%g\nset border 31 lc rgb '#bbbbbb'\nset tics textcolor rgb '#555555'\nset key at screen 0.98,0.93 "
        "right "
        "top vertical samplen 2 nobox\n",
        title, low[0], high[0], low[1], high[1], low[2], high[2], tics, tics, tics);
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

/* A moving system: the path of one of its points, and some snapshots of the whole system, darker with
 * time. */
typedef struct motion {
    const char *title, *axes; /* axes: gnuplot commands for the labels of the axes */
    const char *path, *path_width;
    /* Computes the point of the path, and extends the box by everything in the picture of a state. */
    void (*point)(const simulation *sim, const double *y, bounds *box, double x[3]);
    /* Writes a snapshot as the rows of a data block. */
    void (*put)(drawing *to, const double *y, bounds *box);
    char style[64]; /* gnuplot style of the snapshots */
} motion;

static void draw_motion(drawing *to, const motion *what) {
    const size_t count = snapshot_count(to);
    FILE *script = to->plot.script.stream;
    bounds box = {{HUGE_VAL, HUGE_VAL, HUGE_VAL}, {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}};
    for (size_t i = 0; i < to->what->path->kept; i++) {
        double x[3];
        what->point(to->what->sim, state_at(to, i), &box, x);
        put_point(to, x);
    }
    const size_t path = end_block(to);
    for (size_t k = 0; k < count; k++) {
        what->put(to, state_at(to, snapshot(to, k)), &box);
        (void)end_block(to);
    }
    bounds_end(&box);
    put_axes(script, what->title, box.low, box.high);
    (void)fprintf(script, "%ssplot datafile index %zu using 1:2:3 with lines lw %s lc rgb '%s' title '%s'",
                  what->axes, path, what->path_width, colour(1), what->path);
    for (size_t k = 0; k < count; k++) {
        char dark[8];
        shade(count > 1 ? (double)k / (double)(count - 1) : 1, dark);
        (void)fprintf(script, ", \\\n  datafile index %zu using %s lc rgb '%s' title 't = %.3g s'",
                      path + 1 + k, what->style, dark, time_at(to, snapshot(to, k)));
    }
    (void)fputc('\n', script);
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
    const size_t links = lg_system_links(to->what->sim->system);
    motion chain = {.title =
                        links > 1 ? "the chain, and the path of its last mass" : "the pendulum and its path",
                    .axes = "set xlabel 'x [m]'\nset ylabel 'y [m]'\nset zlabel 'z [m]' rotate\n",
                    .path = "path",
                    .path_width = "0.8",
                    .point = last_mass,
                    .put = put_masses};
    (void)snprintf(chain.style, sizeof chain.style, "1:2:3 with linespoints lw 2 pt 7 ps %g",
                   links > 10 ? 0.4 : 0.8);
    draw_motion(to, &chain);
}

/* ---- curves on the unit sphere ---- */

typedef struct sphere_curve {
    const char *title;
    void (*point)(const simulation *sim, const double *y, double x[3]);
} sphere_curve;

static void put_sphere(drawing *to, const char *title, const sphere_curve *curves, size_t count) {
    static const double low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    FILE *script = to->plot.script.stream;
    const size_t first = to->blocks, last = to->what->path->kept - 1;
    for (size_t c = 0; c < count; c++) {
        double x[3];
        for (size_t i = 0; i <= last; i++) {
            curves[c].point(to->what->sim, state_at(to, i), x);
            put_point(to, x);
        }
        (void)end_block(to);
    }
    put_axes(script, title, low, high);
    (void)fputs("set xtics -1,1,1\nset ytics -1,1,1\nset ztics -1,1,1\nset xlabel 'x'\nset ylabel 'y'\nset "
                "zlabel 'z'\n"
                "set parametric\nset urange [0:pi]\nset vrange [0:2*pi]\nset isosamples 25,13\n"
                "splot sin(u)*cos(v), sin(u)*sin(v), cos(u) with lines lc rgb '#e2e2e2' lw 0.5 notitle",
                script);
    for (size_t c = 0; c < count; c++)
        (void)fprintf(
            script,
            ", \\\n  datafile index %zu using 1:2:3 with lines lw 1.6 lc rgb '%s' title '%s', \\\n  datafile "
            "index %zu every ::0::0 using 1:2:3 with points pt 7 ps 0.9 lc rgb '%s' title '%s'",
            first + c, colour(c), curves[c].title, first + c, colour(c), count > 1 ? "" : "start");
    (void)fputc('\n', script);
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
    (void)fprintf(to->plot.data.stream, "%.9g %.9g %.9g %.9g %.9g %.9g\n", a[0], a[1], a[2], b[0] - a[0],
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
    draw_motion(to,
                &(motion){"payload, links and quadrotors; up is -e_{3}",
                          "set xlabel 'e_{1}  [m]'\nset ylabel '-e_{2}  [m]'\nset zlabel '-e_{3}  [m]' "
                          "rotate\nset view 75,20,1.15\n",
                          "payload", "1.2", payload, put_quadrotors, "1:2:3:4:5:6 with vectors nohead lw 2"});
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
