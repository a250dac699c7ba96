/* Gauss's rule of 3 points on [0, 1]: abscissae (1 -+ sqrt(3/5))/2, weights. */
static const real GAUSS_AT[3] = {REAL(0.11270166537925831), REAL(0.5), REAL(0.88729833462074169)};
static const real GAUSS_WEIGHT[3] = {REAL(0.27777777777777778), REAL(0.44444444444444444),
                                     REAL(0.27777777777777778)};

/* Of work: what the angles of a curve need, and the memory of the network. */
enum { AT_NET = 8 };

static real angle_at(real s, real *work) {
    real angle;
    NAME_point(&s, work, &angle, work + AT_NET);
    return angle;
}

/* The integral of (cos theta, sin theta) over whole panels so far, with what rounding took from the sums. */
typedef struct walk {
    real sum[2], lost[2];
    int panels;
} walk;

/* Gauss's rule of 3 points from panel number `panel` on over `part` of it. */
static void gauss(real panel, real part, real *integral, real *work) {
    integral[0] = integral[1] = REAL(0.0);
    for (int g = 0; g < 3; g++) {
        const real angle = angle_at(PANEL * (panel + GAUSS_AT[g] * part), work);
        integral[0] += GAUSS_WEIGHT[g] * COS(angle);
        integral[1] += GAUSS_WEIGHT[g] * SIN(angle);
    }
    integral[0] *= PANEL * part;
    integral[1] *= PANEL * part;
}

/* Adds whole panels up to s (Kahan's sum); `integral`: up to s itself. */
static void integrate_to(real s, walk *w, real *integral, real *work) {
    const real place = s / PANEL;
    real part[2];
    while (w->panels < PANELS && (real)(w->panels + 1) <= place + PANEL_SLACK) {
        gauss((real)w->panels, REAL(1.0), part, work);
        for (int c = 0; c < 2; c++) {
            const real term = part[c] - w->lost[c], sum = w->sum[c] + term;
            w->lost[c] = (sum - w->sum[c]) - term;
            w->sum[c] = sum;
        }
        w->panels++;
    }
    part[0] = part[1] = REAL(0.0);
    if (place > (real)w->panels + PANEL_SLACK) gauss((real)w->panels, place - (real)w->panels, part, work);
    for (int c = 0; c < 2; c++) integral[c] = w->sum[c] + (part[c] - w->lost[c]);
}

void NAME_curve(const NAME_real *x, const NAME_real *s, int points, NAME_real *q, NAME_real *v,
                NAME_real *work) {
    real integral[2];
    walk w;
    w.panels = 0;
    w.sum[0] = w.sum[1] = w.lost[0] = w.lost[1] = REAL(0.0);
    NAME_ends(x, work, work + AT_NET);
    for (int i = 0; i < points; i++) {
        if (q != NULL) {
            integrate_to(s[i], &w, integral, work);
            q[2 * i] = x[0] + integral[0];
            q[2 * i + 1] = x[1] + integral[1];
        }
        if (v != NULL) {
            const real angle = angle_at(s[i], work);
            v[2 * i] = COS(angle);
            v[2 * i + 1] = SIN(angle);
        }
    }
    mark_curve(x, s, points, q);
    mark_curve(x, s, points, v);
}
