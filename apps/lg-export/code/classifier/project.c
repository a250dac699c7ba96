/* Principal components of z, in work; where they lie. */
static const real *project(const real *z, real *work) {
    dense(&components, z, work + PROJECTED);
    return work + PROJECTED;
}
