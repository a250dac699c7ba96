/* The fractions of the classes in the leaf that p falls into: node i sends it left when p[feature[i]] <=
 * threshold[i]. A node whose left child is 0 is a leaf, and its right one the row of its fractions. A number
 * in p that is not finite makes them NaN. */
static void decide(const real *p, real *y, real *work) {
    real bad = REAL(0.0);
    int i = 0;
    (void)work;
    for (int k = 0; k < PROJECTIONS; k++) bad += p[k] - p[k];
    while (NAME_left[i] != 0) i = p[NAME_feature[i]] <= NAME_threshold[i] ? NAME_left[i] : NAME_right[i];
    for (int k = 0; k < NAME_CLASSES; k++) y[k] = NAME_fractions[NAME_right[i] * NAME_CLASSES + k] + bad;
}
