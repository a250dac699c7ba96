/* Squared distances between predicted and given points, for the loss; see liegrad/hamiltonian.h. */
#include "autodiff/tape/tape_internal.h"
#include "hamiltonian/internal.h"

/* ---- distances on T*S^2, with q and p (B, k, 3) ---- */

enum { TERMS = 14 };

/* theta^2 for unit vectors a and b, where theta is the angle between them, from x = |a - b|^2:
 *   theta^2 = 4 arcsin(sqrt(x)/2)^2 = 2 sum_n x^n / (n^2 C(2n, n)),
 * to rounding for x <= 1/4. */
static lg_var series(lg_tape *tape, lg_var x) {
    double c[TERMS + 1];
    double binomial = 1.0;
    for (int n = 1; n <= TERMS; n++) {
        binomial *= 2.0 * (2.0 * n - 1.0) / n;
        c[n] = 2.0 / (n * n * binomial);
    }
    lg_var sum = lg_scale(tape, x, c[TERMS]);
    for (int n = TERMS - 1; n > 0; n--) sum = lg_mul(tape, x, lg_add_scalar(tape, sum, c[n]));
    return sum;
}

static const double near = 0.25, tiny = 1e-30;

/* A constant in the shape of x. */
static lg_var constant(lg_tape *tape, lg_var x, double value) {
    return lg_full(tape, lg_var_shape(tape, x), value);
}

/* Returns |m|^2 for m = a + b, at least `tiny`. For nearly opposite a and b m is small, but exact to
 * rounding. */
static lg_var squared_sum(lg_tape *tape, lg_var m) {
    lg_var y = lg_rownorm2(tape, m);
    return lg_max(tape, y, constant(tape, y, tiny));
}

/* theta^2 (B, k, 1): by the series where |a - b|^2 <= 1/4, else (2 atan2(|a - b|, |m|))^2. Its derivative is
 * 0 where a and b are opposite. */
static lg_var squared_angle(lg_tape *tape, lg_var a, lg_var b, lg_var m) {
    lg_var x = lg_rownorm2(tape, lg_sub(tape, a, b)), one = constant(tape, x, 1.0);
    lg_var is_near = lg_ge(tape, constant(tape, x, near), x);
    lg_var apart = lg_sqrt(tape, lg_select(tape, is_near, one, x));
    lg_var together = lg_sqrt(tape, lg_select(tape, is_near, one, squared_sum(tape, m)));
    lg_var half = lg_atan2(tape, apart, together);
    return lg_select(tape, is_near, series(tape, x), lg_scale(tape, lg_square(tape, half), 4.0));
}

/* p at a, parallel transported along the shortest geodesic to b. Since a.p = 0, this is the reflection at the
 * plane orthogonal to m. */
static lg_var carried(lg_tape *tape, lg_var p, lg_var m) {
    lg_var factor = lg_div(tape, lg_rowdot(tape, m, p), squared_sum(tape, m));
    return lg_sub(tape, p, lg_mul(tape, m, lg_scale(tape, factor, 2.0)));
}

static lg_var on_cotangent_spheres(lg_tape *tape, const double *weight, const lg_var *a, const lg_var *b) {
    lg_var m = lg_add(tape, a[0], b[0]), apart = lg_sub(tape, carried(tape, a[1], m), b[1]);
    lg_var angles = lg_sum(tape, squared_angle(tape, a[0], b[0], m));
    return lg_add(tape, lg_hamiltonian_scaled(tape, angles, weight[0]),
                  lg_hamiltonian_scaled(tape, lg_sum(tape, lg_square(tape, apart)), weight[1]));
}

/* ---- all factors ---- */

static lg_var flat(lg_tape *tape, const double *weight, const lg_var *a, const lg_var *b) {
    return lg_hamiltonian_scaled(tape, lg_sum(tape, lg_square(tape, lg_sub(tape, a[0], b[0]))), weight[0]);
}

bool lg_hamiltonian_has_geodesics(const lg_space *space) {
    bool known = true;
    for (size_t i = 0; i < space->factors; i++)
        known = known && (space->factor[i].kind == LG_SPACE_RN || space->factor[i].kind == LG_SPACE_TS2);
    return known;
}

/* With geodesics each factor is R^n, one part, or T*S^2, two parts. */
lg_var lg_hamiltonian_squared_distance(lg_tape *tape, lg_hamiltonian_distance kind, const lg_space *space,
                                       const double *weight, const lg_var *a, const lg_var *b) {
    lg_var total = LG_NONE;
    for (size_t part = 0, factor = 0; part < lg_taped_parts(space); part++, factor++) {
        const bool curved = kind == LG_DISTANCE_GEODESIC && space->factor[factor].kind == LG_SPACE_TS2;
        const lg_var more = (curved ? on_cotangent_spheres : flat)(tape, weight + part, a + part, b + part);
        total = lg_add_or(tape, total, more);
        if (curved) part++;
    }
    return total;
}
