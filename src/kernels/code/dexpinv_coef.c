/* Derivative of order `order` (at most 8) of g2(w) = (1 - (x/2) cot(x/2))/w, x = sqrt(w), in double for every
 * type.
 *
 * For |w| <= 45 it is the pole 2/(4 pi^2 - w) plus a power series of the rest. Beyond that, q = (x/2)
 * cot(x/2) satisfies 2w q' = q - q^2 - w/4, and g2 = (1 - q)/w; both equations are differentiated.
 */
static const double dexpinv_rest[40] = {
    0.032672741512164448,   0.00010564110705334699, 5.6373702828768453e-7,  3.3571419266574514e-9,
    2.0742872904166046e-11, 1.3000482138698974e-13, 8.1960520556910086e-16, 5.1801181961697243e-18,
    3.2775391747017918e-20, 2.0747401878593605e-22, 1.3136241807166534e-24, 8.3180031951892641e-27,
    5.2672629968342309e-29, 3.3354842988221443e-31, 2.1122063323183885e-33, 1.3375664093215244e-35,
    8.4702273286502466e-38, 5.3638310466556986e-40, 3.3966848266497807e-42, 2.1509755511832567e-44,
    1.3621211117593843e-46, 8.625732514113179e-49,  5.4623088714895593e-51, 3.4590474864883952e-53,
    2.1904674057436383e-55, 1.3871296880408167e-57, 8.784101362706072e-60,  5.5625971696904569e-62,
    3.5225558082215214e-64, 2.2306845245191415e-66, 1.4125974772094366e-68, 8.9453780250049516e-71,
    5.6647268101184646e-73, 3.5872301588182866e-75, 2.2716400355546614e-77, 1.4385328575728765e-79,
    9.1096157398538359e-82, 5.7687315580550838e-84, 3.6530919348564687e-86, 2.3133474924620718e-88};

static double dexpinv_pole(double w, int order) {
    const int terms = fabs(w) <= 1.0 ? 10 + order : fabs(w) <= 10.0 ? 20 + order : 40;
    const double distance = (39.478417604357432 - w) + 2.5061182034958847e-15;
    double rest = 0.0, pole = 2.0 / distance;
    for (int j = terms - 1; j >= order; j--) {
        double factor = 1.0;
        for (int i = 0; i < order; i++) factor *= j - i;
        rest = rest * w + factor * dexpinv_rest[j];
    }
    for (int i = 1; i <= order; i++) pole *= i / distance;
    return pole + rest;
}

static double dexpinv_beyond(double w, int order) {
    double q[9] = {0.0}, g = 0.0;
    const double x = sqrt(fabs(w));
    q[0] = w > 0.0 ? 0.5 * x / tan(0.5 * x) : 0.5 * x / tanh(0.5 * x);
    for (int d = 0; d <= order; d++) {
        double square = 0.0, binomial = 1.0;
        g = ((d == 0 ? 1.0 : 0.0) - q[d] - d * g) / w;
        if (d == order) break;
        for (int i = 0; i <= d; i++) {
            square += binomial * q[i] * q[d - i];
            binomial *= (double)(d - i) / (i + 1);
        }
        q[d + 1] = ((1 - 2 * d) * q[d] - square - (d == 0 ? 0.25 * w : d == 1 ? 0.25 : 0.0)) / (2.0 * w);
    }
    return g;
}

static real dexpinv_coef(real argument, int order) {
    const double w = (double)argument;
    return (real)(fabs(w) <= 45.0 ? dexpinv_pole(w, order) : dexpinv_beyond(w, order));
}
