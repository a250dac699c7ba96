/* Symplectic Lie group integrators on the right-trivialised T*(SO(3) x R^m). The state is (R, r) in SE(3),
 * where r is the spatial momentum, optionally followed by (q, p) in R^2m. After Celledoni, Marthinsen and
 * Owren, An introduction to Lie group integrators, and Bogfjellmo and Marthinsen, High-order symplectic
 * partitioned Lie group methods (2016).
 *
 * On so(3), dexp_u^* = dexp_{-u} and Ad_{exp(u)}^* = exp(-u), so that with z = (xi, n) = h f(stage):
 *   stage = (exp(theta xi) R0, dexp_xi(r0 + b) - theta dexp_{theta xi} b), b = exp(-theta xi) n
 *   end   = (exp(xi) R0, exp(xi) r0 + exp((1 - theta) xi) n)
 * and on R^m, with (x, n) = h f: stage = (q0 + theta x, p0 + (1 - theta) n), end = (q0 + x, p0 + n).
 */
#include <math.h>

#include "integrators/stepper.h"
#include "liegrad/geometry.h"

bool lg_slgi_fits(const lg_space *space) {
    const lg_space_factor *f = space->factor;
    if (space->factors < 1 || f[0].kind != LG_SPACE_SE3 || f[0].count != 1) return false;
    return space->factors == 1 || (space->factors == 2 && f[1].kind == LG_SPACE_RN && f[1].count % 2 == 0);
}

/* out = exp(u) R by the action of the space SO(3), which keeps R orthogonal over any number of steps. */
static void rotate(const double u[3], const double R[9], double out[9]) {
    lg_space_kind_entry(LG_SPACE_SO3)->act(1, u, R, out);
}

/* Writes the R^2m part of `out`: (q + a x, p + b n), where x and n are the last 2 m numbers of z. */
static void translate(const lg_stepper *s, double a, double b, const double *y, const double *z,
                      double *out) {
    const size_t m = (s->ode.space.dim - 12) / 2;
    for (size_t i = 0; i < m; i++) out[12 + i] = y[12 + i] + a * z[6 + i];
    for (size_t i = 0; i < m; i++) out[12 + m + i] = y[12 + m + i] + b * z[6 + m + i];
}

static void stage(const lg_stepper *s, const double *y, const double *z, double *point) {
    const double theta = s->scheme->theta;
    const double turn[3] = {theta * z[0], theta * z[1], theta * z[2]},
                 back[3] = {-turn[0], -turn[1], -turn[2]};
    double b[3], sum[3], db[3];
    rotate(turn, y, point);
    lg_so3_exp_act(back, z + 3, b);
    for (int i = 0; i < 3; i++) sum[i] = y[9 + i] + b[i];
    lg_so3_dexp(z, sum, sum);
    lg_so3_dexp(turn, b, db);
    for (int i = 0; i < 3; i++) point[9 + i] = sum[i] - theta * db[i];
    translate(s, theta, 1.0 - theta, y, z, point);
}

static void end(const lg_stepper *s, const double *y, const double *z, double *out) {
    const double rest = 1.0 - s->scheme->theta, u[3] = {rest * z[0], rest * z[1], rest * z[2]};
    double momentum[3], impulse[3];
    rotate(z, y, out);
    lg_so3_exp_act(z, y + 9, momentum);
    lg_so3_exp_act(u, z + 3, impulse);
    for (int i = 0; i < 3; i++) out[9 + i] = momentum[i] + impulse[i];
    translate(s, 1.0, 1.0, y, z, out);
}

/* Sets newton.scale: 1 for xi, which is an angle; |r| for n (1 if r is 0); for each component in R^2m its
 * |y_i|, but at least 1e-3 of the largest of them. */
static void set_scale(lg_stepper *s, const double *y) {
    double *scale = s->newton.scale;
    const double momentum = sqrt(lg_dot3(y + 9, y + 9));
    double largest = 0.0;
    for (size_t i = 12; i < s->ode.space.dim; i++) largest = fmax(largest, fabs(y[i]));
    for (int i = 0; i < 3; i++) scale[i] = 1.0, scale[3 + i] = momentum > 0.0 ? momentum : 1.0;
    for (size_t i = 12; i < s->ode.space.dim; i++)
        scale[i - 6] = largest > 0.0 ? fmax(fabs(y[i]), 1e-3 * largest) : 1.0;
}

lg_status lg_step_slgi(lg_stepper *s, double t, double h, const double *y, const double *input) {
    set_scale(s, y);
    LG_TRY(lg_newton_solve(s, t, h, y, input, stage));
    end(s, y, s->newton.z, s->y_next);
    lg_stepper_turn(s, s->newton.z);
    return LG_OK;
}
