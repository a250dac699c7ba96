/* Of work: what the angles of a curve need, and the memory of the network. */
enum { AT_NET = 8 };

/* The integral of (cos theta, sin theta) over whole panels so far, with what rounding took from the sums. */
typedef struct walk {
    real sum[2], lost[2];
    int panels;
} walk;

/* The integral from the end of the whole panels on over `part` of a panel. */
static void integrate(const walk *w, real part, real *integral, real *work) {
    const real at = PANEL * (real)w->panels, length = PANEL * part;
    NAME_span(&at, work, &length, integral, work + AT_NET);
}

/* Adds whole panels up to s (Kahan's sum); `integral`: up to s itself. */
static void integrate_to(real s, walk *w, real *integral, real *work) {
    const real place = s / PANEL;
    real part[2];
    while (w->panels < PANELS && (real)(w->panels + 1) <= place + PANEL_SLACK) {
        integrate(w, REAL(1.0), part, work);
        for (int c = 0; c < 2; c++) {
            const real term = part[c] - w->lost[c], sum = w->sum[c] + term;
            w->lost[c] = (sum - w->sum[c]) - term;
            w->sum[c] = sum;
        }
        w->panels++;
    }
    part[0] = part[1] = REAL(0.0);
    if (place > (real)w->panels + PANEL_SLACK) integrate(w, place - (real)w->panels, part, work);
    for (int c = 0; c < 2; c++) integral[c] = w->sum[c] + (part[c] - w->lost[c]);
}

void NAME_curve(const NAME_real *x, const NAME_real *s, int points, NAME_real *q, NAME_real *v,
                NAME_real *work) {
    real reached[2], angle;
    walk w = {{0, 0}, {0, 0}, 0};
    NAME_ends(x, work, work + AT_NET);
    for (int i = 0; i < points; i++) {
        if (q != NULL) {
            integrate_to(s[i], &w, reached, work);
            for (int c = 0; c < 2; c++) q[2 * i + c] = x[c] + reached[c];
        }
        if (v != NULL) {
            NAME_point(s + i, work, &angle, work + AT_NET);
            v[2 * i] = COS(angle);
            v[2 * i + 1] = SIN(angle);
        }
    }
    if (q != NULL && SYMMETRIC) { /* what is missing to qN is spread along the beam */
        integrate_to(LENGTH, &w, reached, work);
        for (int i = 0; i < 2 * points; i++)
            q[i] += s[i / 2] / LENGTH * (x[4 + i % 2] - x[i % 2] - reached[i % 2]);
    }
    mark_curve(x, s, points, q);
    mark_curve(x, s, points, v);
}
