/* The curve of x at the places above: q, then v. */
static void extra(const NAME_real *x, NAME_real *out, NAME_real *work) {
    NAME_curve(x + BOUNDARY_AT, curve_places, CURVE_PLACES, out, out + 2 * CURVE_PLACES, work);
    for (int i = 2 * CURVE_PLACES; i < 4 * CURVE_PLACES; i++) out[i] *= tangent_scale;
}
