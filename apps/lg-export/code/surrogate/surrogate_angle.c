static const real PI = REAL(3.14159265358979324);
/* Gauss's rule of 3 points on [0, 1]: abscissae (1 -+ sqrt(3/5))/2, weights. */
static const real GAUSS_AT[3] = {REAL(0.11270166537925831), REAL(0.5), REAL(0.88729833462074169)};
static const real GAUSS_WEIGHT[3] = {REAL(0.27777777777777778), REAL(0.44444444444444444),
                                     REAL(0.27777777777777778)};

/* Of work: the network's input (theta_0/pi, theta_N/pi, s), a gradient there, its output and the cotangent
 * of that. */
enum { AT_GRADIENT = 3, AT_VALUE = 6, AT_COTANGENT = 7, AT_NET = 8 };

/* The first two numbers of the network's input, for good; angles in (-pi, pi], hence no -0. */
static void fill_angles(const real *x, real sign, real *angles, real *row) {
    for (int i = 0; i < 2; i++) {
        angles[i] = ATAN2(sign * x[4 * i + 3] + REAL(0.0), x[4 * i + 2]);
        row[i] = angles[i] / PI;
    }
}

/* pi f(s) */
static real ask(real s, real *work) {
    work[2] = s;
    net_value(work, work + AT_VALUE, work + AT_NET);
    return PI * work[AT_VALUE];
}

/* s - L, where L is more than one number of this type holds. */
static real beyond(real s) {
    return (s - LENGTH) - LENGTH_REST;
}

/* Weights at s of what the angles lack at the ends: (1, 0) at s = 0, (0, 1) at s = L. */
static void end_weights(real s, real *weights) {
    const real rest = beyond(s);
    const real a = EXP(REAL(-100.0) * s * s), b = EXP(REAL(-100.0) * rest * rest);
    weights[0] = (a - END_CROSS * b) * END_SCALE;
    weights[1] = (b - END_CROSS * a) * END_SCALE;
}

/* Input of the network for boundary conditions x, and what its angles lack at the ends. */
static void begin(const real *x, real sign, real *missing, real *work) {
    fill_angles(x, sign, missing, work);
    if (!BOUNDARY) return;
    missing[0] -= ask(REAL(0.0), work);
    missing[1] -= ask(LENGTH, work);
}

/* theta(s) on the network's side of the mirror */
static real angle_at(real s, const real *missing, real *work) {
    real weights[2];
    const real angle = ask(s, work);
    if (!BOUNDARY) return angle;
    end_weights(s, weights);
    return angle + (missing[0] * weights[0] + missing[1] * weights[1]);
}

void NAME_eval(const NAME_real *x, NAME_real *y, NAME_real *work) {
    real missing[2];
    const real sign = mirror_sign(x + 1);
    begin(x + 1, sign, missing, work);
    y[0] = sign * angle_at(x[0], missing, work);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, y);
}

/* pi f(s), and its derivatives by theta_0, theta_N and s. */
static real ask_slopes(real s, real *slopes, real *work) {
    work[2] = s;
    work[AT_COTANGENT] = REAL(1.0);
    net_vjp(work, work + AT_COTANGENT, work + AT_VALUE, work + AT_GRADIENT, work + AT_NET);
    slopes[0] = work[AT_GRADIENT];
    slopes[1] = work[AT_GRADIENT + 1];
    slopes[2] = PI * work[AT_GRADIENT + 2];
    return PI * work[AT_VALUE];
}

/* theta(s) with its derivatives where the ends are held; angles: theta_0, theta_N. */
static real held_slopes(real s, const real *angles, real *slopes, real *work) {
    const real rest = beyond(s), end[2] = {REAL(0.0), LENGTH};
    real weights[2], of_end[3], angle = ask_slopes(s, slopes, work), turn[2], a, b;
    end_weights(s, weights);
    a = REAL(-200.0) * s * EXP(REAL(-100.0) * s * s);
    b = REAL(-200.0) * rest * EXP(REAL(-100.0) * rest * rest);
    turn[0] = (a - END_CROSS * b) * END_SCALE;
    turn[1] = (b - END_CROSS * a) * END_SCALE;
    for (int i = 0; i < 2; i++) {
        const real missing = angles[i] - ask_slopes(end[i], of_end, work);
        angle += missing * weights[i];
        slopes[2] += missing * turn[i];
        for (int j = 0; j < 2; j++) slopes[j] += weights[i] * ((i == j ? REAL(1.0) : REAL(0.0)) - of_end[j]);
    }
    return angle;
}

void NAME_grad(const NAME_real *x, NAME_real *y, NAME_real *jacobian, NAME_real *work) {
    const real sign = mirror_sign(x + 1);
    real angles[2], slopes[3], angle;
    fill_angles(x + 1, sign, angles, work);
    angle = BOUNDARY ? held_slopes(x[0], angles, slopes, work) : ask_slopes(x[0], slopes, work);
    jacobian[0] = sign * slopes[2];
    for (int i = 0; i < 2; i++) { /* angle = atan2(vy, vx); both reflections cancel */
        const real *v = x + 3 + 4 * i;
        const real square = v[0] * v[0] + v[1] * v[1];
        real *to = jacobian + 1 + 4 * i;
        to[0] = to[1] = REAL(0.0);
        to[2] = -slopes[i] * v[1] / square;
        to[3] = slopes[i] * v[0] / square;
    }
    angle *= sign;
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS * NAME_INPUTS, jacobian);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, &angle);
    if (y != NULL) y[0] = angle;
}

/* The integral of (cos theta, sin theta) over whole panels so far, with what rounding took from the sums. */
typedef struct walk {
    real missing[2], sum[2], lost[2];
    int panels;
} walk;

/* Gauss's rule of 3 points from panel number `panel` on over `part` of it. */
static void gauss(const walk *w, real panel, real part, real *integral, real *work) {
    integral[0] = integral[1] = REAL(0.0);
    for (int g = 0; g < 3; g++) {
        const real angle = angle_at(PANEL * (panel + GAUSS_AT[g] * part), w->missing, work);
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
        gauss(w, (real)w->panels, REAL(1.0), part, work);
        for (int c = 0; c < 2; c++) {
            const real term = part[c] - w->lost[c], sum = w->sum[c] + term;
            w->lost[c] = (sum - w->sum[c]) - term;
            w->sum[c] = sum;
        }
        w->panels++;
    }
    part[0] = part[1] = REAL(0.0);
    if (place > (real)w->panels + PANEL_SLACK) gauss(w, (real)w->panels, place - (real)w->panels, part, work);
    for (int c = 0; c < 2; c++) integral[c] = w->sum[c] + (part[c] - w->lost[c]);
}

void NAME_curve(const NAME_real *x, const NAME_real *s, int points, NAME_real *q, NAME_real *v,
                NAME_real *work) {
    const real sign = mirror_sign(x);
    real integral[2];
    walk w;
    w.panels = 0;
    w.sum[0] = w.sum[1] = w.lost[0] = w.lost[1] = REAL(0.0);
    begin(x, sign, w.missing, work);
    for (int i = 0; i < points; i++) {
        if (q != NULL) {
            integrate_to(s[i], &w, integral, work);
            q[2 * i] = x[0] + integral[0];
            q[2 * i + 1] = x[1] + sign * integral[1];
        }
        if (v != NULL) {
            const real angle = angle_at(s[i], w.missing, work);
            v[2 * i] = COS(angle);
            v[2 * i + 1] = sign * SIN(angle);
        }
    }
    mark_curve(x, s, points, q);
    mark_curve(x, s, points, v);
}
