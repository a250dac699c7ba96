/* Collections of problems for minimisers: sums of squares with exact derivatives.
 *   mgh   the 35 problems of More, Garbow, Hillstrom, ACM Trans. Math. Softw. 7 (1981) 17-41
 *   nist  the 27 nonlinear regressions of golden/nist_table.h
 *
 * Residuals are computed with complex numbers a + b i, where b is a derivative times a step of 1e-100.
 * Products and quotients of complex numbers and the functions below carry the derivative exactly up to
 * rounding. */
#ifndef LG_MINIMISE_PROBLEMS_H
#define LG_MINIMISE_PROBLEMS_H

#include <complex.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "golden/nist_table.h"

typedef double complex num;

static const double PI = 3.14159265358979323846;

enum { MOST_VARIABLES = 20, MOST_RESIDUALS = 260 };

typedef struct minimise_problem {
    const char *name;
    size_t n, m;
    void (*residuals)(const struct minimise_problem *p, const num *x, num *r);
    double least;        /* f: the lowest sum of squares */
    const double *start; /* (starts, n) */
    const nist_case *nist;
} minimise_problem;

/* ---- functions of complex numbers ---- */

static inline num lift(num x, double value, double slope) {
    return value + slope * cimag(x) * I;
}
static inline num num_exp(num x) {
    const double e = exp(creal(x));
    return lift(x, e, e);
}
static inline num num_sin(num x) {
    return lift(x, sin(creal(x)), cos(creal(x)));
}
static inline num num_cos(num x) {
    return lift(x, cos(creal(x)), -sin(creal(x)));
}
static inline num num_log(num x) {
    return lift(x, log(creal(x)), 1 / creal(x));
}
static inline num num_atan(num x) {
    return lift(x, atan(creal(x)), 1 / (1 + creal(x) * creal(x)));
}
static inline num num_sqrt(num x) {
    return lift(x, sqrt(creal(x)), 0.5 / sqrt(creal(x)));
}
static inline num num_abs(num x) {
    return creal(x) < 0 ? -x : x;
}
static inline num square(num x) {
    return x * x;
}
static inline num cube(num x) {
    return x * x * x;
}
/* x^c, where c may be constant or an unknown. */
static inline num num_pow(num x, num c) {
    const double a = creal(x), b = creal(c), value = pow(a, b);
    const double logarithm = cimag(c) != 0 ? log(a) * cimag(c) : 0;
    return value + (b * pow(a, b - 1) * cimag(x) + value * logarithm) * I;
}

/* ---- More, Garbow, Hillstrom: numbers as in the paper, but i starts at 0 ---- */

#define MGH(name) static void name(const minimise_problem *p, const num *x, num *r)

MGH(rosenbrock_pairs) {
    for (size_t i = 0; i < p->n; i += 2) {
        r[i] = 10 * (x[i + 1] - square(x[i]));
        r[i + 1] = 1 - x[i];
    }
}
MGH(freudenstein) {
    (void)p;
    r[0] = -13 + x[0] + ((5 - x[1]) * x[1] - 2) * x[1];
    r[1] = -29 + x[0] + ((x[1] + 1) * x[1] - 14) * x[1];
}
MGH(powell_scaled) {
    (void)p;
    r[0] = 1e4 * x[0] * x[1] - 1;
    r[1] = num_exp(-x[0]) + num_exp(-x[1]) - 1.0001;
}
MGH(brown_scaled) {
    (void)p;
    r[0] = x[0] - 1e6;
    r[1] = x[1] - 2e-6;
    r[2] = x[0] * x[1] - 2;
}
MGH(beale) {
    static const double y[] = {1.5, 2.25, 2.625};
    num power = 1;
    for (size_t i = 0; i < p->m; i++) {
        power *= x[1];
        r[i] = y[i] - x[0] * (1 - power);
    }
}
MGH(jennrich) {
    for (size_t i = 0; i < p->m; i++) {
        const double k = (double)i + 1;
        r[i] = 2 + 2 * k - (num_exp(k * x[0]) + num_exp(k * x[1]));
    }
}
MGH(helical) {
    (void)p;
    num turn;
    if (creal(x[0]) == 0)
        turn = creal(x[1]) < 0 ? -0.25 : 0.25;
    else
        turn = num_atan(x[1] / x[0]) / (2 * PI) + (creal(x[0]) < 0 ? 0.5 : 0);
    r[0] = 10 * (x[2] - 10 * turn);
    r[1] = 10 * (num_sqrt(square(x[0]) + square(x[1])) - 1);
    r[2] = x[2];
}
MGH(bard) {
    static const double y[] = {.14, .18, .22, .25, .29, .32, .35, .39, .37, .58, .73, .96, 1.34, 2.10, 4.39};
    for (size_t i = 0; i < p->m; i++) {
        const double u = (double)i + 1, v = 16 - u, w = fmin(u, v);
        r[i] = y[i] - (x[0] + u / (v * x[1] + w * x[2]));
    }
}
MGH(gaussian) {
    static const double y[] = {.0009, .0044, .0175, .0540, .1295, .2420, .3521, .3989};
    for (size_t i = 0; i < p->m; i++) {
        const double t = (7 - (double)i) / 2;
        r[i] = x[0] * num_exp(-x[1] * square(t - x[2]) / 2) - y[i < 8 ? i : 14 - i];
    }
}
MGH(meyer) {
    static const double y[] = {34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744,
                               8261,  7030,  6005,  5147,  4427,  3820,  3307,  2872};
    for (size_t i = 0; i < p->m; i++) r[i] = x[0] * num_exp(x[1] / (45 + 5 * ((double)i + 1) + x[2])) - y[i];
}
MGH(gulf) {
    for (size_t i = 0; i < p->m; i++) {
        const double t = ((double)i + 1) / 100, y = 25 + pow(-50 * log(t), 2.0 / 3);
        r[i] = num_exp(-num_pow(num_abs(y - x[1]), x[2]) / x[0]) - t;
    }
}
MGH(box) {
    for (size_t i = 0; i < p->m; i++) {
        const double t = 0.1 * ((double)i + 1);
        r[i] = num_exp(-t * x[0]) - num_exp(-t * x[1]) - x[2] * (exp(-t) - exp(-10 * t));
    }
}
MGH(powell_fours) {
    for (size_t i = 0; i < p->n; i += 4) {
        r[i] = x[i] + 10 * x[i + 1];
        r[i + 1] = sqrt(5) * (x[i + 2] - x[i + 3]);
        r[i + 2] = square(x[i + 1] - 2 * x[i + 2]);
        r[i + 3] = sqrt(10) * square(x[i] - x[i + 3]);
    }
}
MGH(wood) {
    (void)p;
    r[0] = 10 * (x[1] - square(x[0]));
    r[1] = 1 - x[0];
    r[2] = sqrt(90) * (x[3] - square(x[2]));
    r[3] = 1 - x[2];
    r[4] = sqrt(10) * (x[1] + x[3] - 2);
    r[5] = (x[1] - x[3]) / sqrt(10);
}
MGH(kowalik) {
    static const double y[] = {.1957, .1947, .1735, .1600, .0844, .0627, .0456, .0342, .0323, .0235, .0246};
    static const double u[] = {4, 2, 1, .5, .25, .167, .125, .1, .0833, .0714, .0625};
    for (size_t i = 0; i < p->m; i++)
        r[i] = y[i] - x[0] * (u[i] * u[i] + u[i] * x[1]) / (u[i] * u[i] + u[i] * x[2] + x[3]);
}
MGH(brown_dennis) {
    for (size_t i = 0; i < p->m; i++) {
        const double t = ((double)i + 1) / 5;
        r[i] = square(x[0] + t * x[1] - exp(t)) + square(x[2] + x[3] * sin(t) - cos(t));
    }
}
MGH(osborne_1) {
    static const double y[] = {.844, .908, .932, .936, .925, .908, .881, .850, .818, .784, .751,
                               .718, .685, .658, .628, .603, .580, .558, .538, .522, .506, .490,
                               .478, .467, .457, .448, .438, .431, .424, .420, .414, .411, .406};
    for (size_t i = 0; i < p->m; i++) {
        const double t = 10 * (double)i;
        r[i] = y[i] - (x[0] + x[1] * num_exp(-t * x[3]) + x[2] * num_exp(-t * x[4]));
    }
}
MGH(biggs) {
    for (size_t i = 0; i < p->m; i++) {
        const double t = 0.1 * ((double)i + 1), y = exp(-t) - 5 * exp(-10 * t) + 3 * exp(-4 * t);
        r[i] = x[2] * num_exp(-t * x[0]) - x[3] * num_exp(-t * x[1]) + x[5] * num_exp(-t * x[4]) - y;
    }
}
MGH(osborne_2) {
    static const double y[] = {1.366, 1.191, 1.112, 1.013, .991, .885, .831, .847, .786, .725, .746,
                               .679,  .608,  .655,  .616,  .606, .602, .626, .651, .724, .649, .649,
                               .694,  .644,  .624,  .661,  .612, .558, .533, .495, .500, .423, .395,
                               .375,  .372,  .391,  .396,  .405, .428, .429, .523, .562, .607, .653,
                               .672,  .708,  .633,  .668,  .645, .632, .591, .559, .597, .625, .739,
                               .710,  .729,  .720,  .636,  .581, .428, .292, .162, .098, .054};
    for (size_t i = 0; i < p->m; i++) {
        const double t = (double)i / 10;
        r[i] = y[i] - x[0] * num_exp(-t * x[4]);
        for (size_t k = 1; k < 4; k++) r[i] -= x[k] * num_exp(-square(t - x[7 + k]) * x[4 + k]);
    }
}
MGH(watson) {
    for (size_t i = 0; i < 29; i++) {
        const double t = ((double)i + 1) / 29;
        double power = 1;
        num slope = 0, sum = 0;
        for (size_t j = 0; j < p->n; j++, power *= t) {
            sum += power * x[j];
            if (j + 1 < p->n) slope += ((double)j + 1) * power * x[j + 1];
        }
        r[i] = slope - square(sum) - 1;
    }
    r[29] = x[0];
    r[30] = x[1] - square(x[0]) - 1;
}
MGH(penalty_1) {
    num sum = -0.25;
    for (size_t i = 0; i < p->n; i++) {
        r[i] = sqrt(1e-5) * (x[i] - 1);
        sum += square(x[i]);
    }
    r[p->n] = sum;
}
MGH(penalty_2) {
    const size_t n = p->n;
    num sum = (double)n * square(x[0]) - 1;
    r[0] = x[0] - 0.2;
    for (size_t i = 1; i < n; i++) {
        const double y = exp(((double)i + 1) / 10) + exp((double)i / 10);
        r[i] = sqrt(1e-5) * (num_exp(x[i] / 10) + num_exp(x[i - 1] / 10) - y);
        r[n + i - 1] = sqrt(1e-5) * (num_exp(x[i] / 10) - exp(-0.1));
        sum += (double)(n - i) * square(x[i]);
    }
    r[2 * n - 1] = sum;
}
MGH(variably) {
    num sum = 0;
    for (size_t i = 0; i < p->n; i++) {
        r[i] = x[i] - 1;
        sum += ((double)i + 1) * (x[i] - 1);
    }
    r[p->n] = sum;
    r[p->n + 1] = square(sum);
}
MGH(trigonometric) {
    num sum = (double)p->n;
    for (size_t i = 0; i < p->n; i++) sum -= num_cos(x[i]);
    for (size_t i = 0; i < p->n; i++) r[i] = sum + ((double)i + 1) * (1 - num_cos(x[i])) - num_sin(x[i]);
}
MGH(brown_linear) {
    num sum = -((double)p->n + 1), product = 1;
    for (size_t i = 0; i < p->n; i++) sum += x[i], product *= x[i];
    for (size_t i = 0; i + 1 < p->n; i++) r[i] = x[i] + sum;
    r[p->n - 1] = product - 1;
}
MGH(boundary) {
    const double h = 1 / ((double)p->n + 1);
    for (size_t i = 0; i < p->n; i++) {
        const double t = ((double)i + 1) * h;
        r[i] = 2 * x[i] + h * h * cube(x[i] + t + 1) / 2;
        if (i > 0) r[i] -= x[i - 1];
        if (i + 1 < p->n) r[i] -= x[i + 1];
    }
}
MGH(integral) {
    const double h = 1 / ((double)p->n + 1);
    for (size_t i = 0; i < p->n; i++) {
        const double t = ((double)i + 1) * h;
        num below = 0, above = 0;
        for (size_t j = 0; j < p->n; j++) {
            const double s = ((double)j + 1) * h;
            const num q = cube(x[j] + s + 1);
            if (j <= i)
                below += s * q;
            else
                above += (1 - s) * q;
        }
        r[i] = x[i] + h * ((1 - t) * below + t * above) / 2;
    }
}
MGH(tridiagonal) {
    for (size_t i = 0; i < p->n; i++) {
        r[i] = (3 - 2 * x[i]) * x[i] + 1;
        if (i > 0) r[i] -= x[i - 1];
        if (i + 1 < p->n) r[i] -= 2 * x[i + 1];
    }
}
MGH(banded) {
    for (size_t i = 0; i < p->n; i++) {
        r[i] = x[i] * (2 + 5 * square(x[i])) + 1;
        for (size_t j = i > 5 ? i - 5 : 0; j < p->n && j <= i + 1; j++)
            if (j != i) r[i] -= x[j] * (1 + x[j]);
    }
}
MGH(linear_full) {
    num sum = 0;
    for (size_t j = 0; j < p->n; j++) sum += x[j];
    for (size_t i = 0; i < p->m; i++) r[i] = (i < p->n ? x[i] : 0) - 2 / (double)p->m * sum - 1;
}
MGH(linear_one) {
    num sum = 0;
    for (size_t j = 0; j < p->n; j++) sum += ((double)j + 1) * x[j];
    for (size_t i = 0; i < p->m; i++) r[i] = ((double)i + 1) * sum - 1;
}
MGH(linear_zeros) {
    num sum = 0;
    for (size_t j = 1; j + 1 < p->n; j++) sum += ((double)j + 1) * x[j];
    for (size_t i = 0; i < p->m; i++) r[i] = (i + 1 < p->m ? (double)i * sum : 0) - 1;
}
MGH(chebyquad) {
    for (size_t i = 1; i <= p->m; i++) r[i - 1] = i % 2 == 0 ? 1 / ((double)(i * i) - 1) : 0;
    for (size_t j = 0; j < p->n; j++) {
        const num t = 2 * x[j] - 1;
        num before = 1, now = t;
        for (size_t i = 0; i < p->m; i++) {
            r[i] += now / (double)p->n;
            const num next = 2 * t * now - before;
            before = now, now = next;
        }
    }
}

#define START(...) ((const double[]){__VA_ARGS__})
#define TEN(a)     START(a, a, a, a, a, a, a, a, a, a)

/* Starts x10 and x100 are the start times 10 and 100. The start of Watson is 0, so its x10 and x100 are all
 * tens and all hundreds. */
static const minimise_problem mgh_table[] = {
    {"Rosenbrock", 2, 2, rosenbrock_pairs, 0, START(-1.2, 1), NULL},
    {"Freudenstein and Roth", 2, 2, freudenstein, 0, START(0.5, -2), NULL},
    {"Powell badly scaled", 2, 2, powell_scaled, 0, START(0, 1), NULL},
    {"Brown badly scaled", 2, 3, brown_scaled, 0, START(1, 1), NULL},
    {"Beale", 2, 3, beale, 0, START(1, 1), NULL},
    {"Jennrich and Sampson", 2, 10, jennrich, 124.362182355615, START(0.3, 0.4), NULL},
    {"Helical valley", 3, 3, helical, 0, START(-1, 0, 0), NULL},
    {"Bard", 3, 15, bard, 8.21487730657898e-3, START(1, 1, 1), NULL},
    {"Gaussian", 3, 15, gaussian, 1.12793276961871e-8, START(0.4, 1, 0), NULL},
    {"Meyer", 3, 16, meyer, 87.9458551710, START(0.02, 4000, 250), NULL},
    {"Gulf", 3, 99, gulf, 0, START(5, 2.5, 0.15), NULL},
    {"Box", 3, 10, box, 0, START(0, 10, 20), NULL},
    {"Powell singular", 4, 4, powell_fours, 0, START(3, -1, 0, 1), NULL},
    {"Wood", 4, 6, wood, 0, START(-3, -1, -3, -1), NULL},
    {"Kowalik and Osborne", 4, 11, kowalik, 3.07505603849238e-4, START(0.25, 0.39, 0.415, 0.39), NULL},
    {"Brown and Dennis", 4, 20, brown_dennis, 85822.2016263563, START(25, 5, -5, -1), NULL},
    {"Osborne 1", 5, 33, osborne_1, 5.46489469748e-5, START(0.5, 1.5, -1, 0.01, 0.02), NULL},
    {"Biggs", 6, 13, biggs, 0, START(1, 2, 1, 1, 1, 1), NULL},
    {"Osborne 2", 11, 65, osborne_2, 4.01377362935478e-2,
     START(1.3, 0.65, 0.65, 0.7, 0.6, 3, 5, 7, 2, 4.5, 5.5), NULL},
    {"Watson", 9, 31, watson, 1.39976013e-6, START(0, 0, 0, 0, 0, 0, 0, 0, 0), NULL},
    {"Extended Rosenbrock", 10, 10, rosenbrock_pairs, 0, START(-1.2, 1, -1.2, 1, -1.2, 1, -1.2, 1, -1.2, 1),
     NULL},
    {"Extended Powell singular", 12, 12, powell_fours, 0, START(3, -1, 0, 1, 3, -1, 0, 1, 3, -1, 0, 1), NULL},
    {"Penalty 1", 10, 11, penalty_1, 7.08765146709e-5, START(1, 2, 3, 4, 5, 6, 7, 8, 9, 10), NULL},
    {"Penalty 2", 10, 20, penalty_2, 2.93660538e-4, TEN(0.5), NULL},
    {"Variably dimensioned", 10, 12, variably, 0, START(.9, .8, .7, .6, .5, .4, .3, .2, .1, 0), NULL},
    {"Trigonometric", 10, 10, trigonometric, 0, TEN(0.1), NULL},
    {"Brown almost linear", 10, 10, brown_linear, 0, TEN(0.5), NULL},
#define AT(i) ((i) / 11.0 * ((i) / 11.0 - 1))
    {"Discrete boundary value", 10, 10, boundary, 0,
     START(AT(1), AT(2), AT(3), AT(4), AT(5), AT(6), AT(7), AT(8), AT(9), AT(10)), NULL},
    {"Discrete integral equation", 10, 10, integral, 0,
     START(AT(1), AT(2), AT(3), AT(4), AT(5), AT(6), AT(7), AT(8), AT(9), AT(10)), NULL},
#undef AT
    {"Broyden tridiagonal", 10, 10, tridiagonal, 0, TEN(-1), NULL},
    {"Broyden banded", 10, 10, banded, 0, TEN(-1), NULL},
    {"Linear, full rank", 10, 20, linear_full, 10, TEN(1), NULL},
    {"Linear, rank 1", 10, 20, linear_one, 20 * 19 / (2.0 * 41), TEN(1), NULL},
    {"Linear, rank 1, zeros", 10, 20, linear_zeros, (20 * 20 + 60 - 6) / (2.0 * 37), TEN(1), NULL},
    {"Chebyquad", 8, 8, chebyquad, 3.51687372567770e-3,
     START(1 / 9.0, 2 / 9.0, 3 / 9.0, 4 / 9.0, 5 / 9.0, 6 / 9.0, 7 / 9.0, 8 / 9.0), NULL},
};

/* ---- models of NIST ---- */

#define NIST(name) static num name(const num *b, const double *x)

NIST(misra1a) {
    return b[0] * (1 - num_exp(-b[1] * x[0]));
}
NIST(misra1b) {
    return b[0] * (1 - 1 / square(1 + b[1] * x[0] / 2));
}
NIST(misra1c) {
    return b[0] * (1 - 1 / num_sqrt(1 + 2 * b[1] * x[0]));
}
NIST(misra1d) {
    return b[0] * b[1] * x[0] / (1 + b[1] * x[0]);
}
NIST(chwirut) {
    return num_exp(-b[0] * x[0]) / (b[1] + b[2] * x[0]);
}
NIST(lanczos) {
    return b[0] * num_exp(-b[1] * x[0]) + b[2] * num_exp(-b[3] * x[0]) + b[4] * num_exp(-b[5] * x[0]);
}
NIST(gauss) {
    return b[0] * num_exp(-b[1] * x[0]) + b[2] * num_exp(-square((x[0] - b[3]) / b[4])) +
           b[5] * num_exp(-square((x[0] - b[6]) / b[7]));
}
NIST(danwood) {
    return b[0] * num_pow(x[0], b[1]);
}
NIST(kirby2) {
    return (b[0] + x[0] * (b[1] + x[0] * b[2])) / (1 + x[0] * (b[3] + x[0] * b[4]));
}
NIST(cubics) {
    return (b[0] + x[0] * (b[1] + x[0] * (b[2] + x[0] * b[3]))) /
           (1 + x[0] * (b[4] + x[0] * (b[5] + x[0] * b[6])));
}
NIST(nelson) {
    return b[0] - b[1] * x[0] * num_exp(-b[2] * x[1]);
}
NIST(mgh17) {
    return b[0] + b[1] * num_exp(-x[0] * b[3]) + b[2] * num_exp(-x[0] * b[4]);
}
NIST(roszman) {
    return b[0] - b[1] * x[0] - num_atan(b[2] / (x[0] - b[3])) / PI;
}
NIST(enso) {
    const double year = 2 * PI * x[0];
    return b[0] + b[1] * cos(year / 12) + b[2] * sin(year / 12) + b[4] * num_cos(year / b[3]) +
           b[5] * num_sin(year / b[3]) + b[7] * num_cos(year / b[6]) + b[8] * num_sin(year / b[6]);
}
NIST(mgh09) {
    return b[0] * (x[0] * x[0] + x[0] * b[1]) / (x[0] * x[0] + x[0] * b[2] + b[3]);
}
NIST(rat42) {
    return b[0] / (1 + num_exp(b[1] - b[2] * x[0]));
}
NIST(mgh10) {
    return b[0] * num_exp(b[1] / (x[0] + b[2]));
}
NIST(eckerle) {
    return b[0] / b[1] * num_exp(-0.5 * square((x[0] - b[2]) / b[1]));
}
NIST(rat43) {
    return b[0] / num_pow(1 + num_exp(b[1] - b[2] * x[0]), 1 / b[3]);
}
NIST(bennett) {
    return b[0] * num_pow(b[1] + x[0], -1 / b[2]);
}

static const struct nist_model {
    const char *name; /* the first letters of the data sets' names */
    num (*value)(const num *b, const double *x);
} nist_models[] = {
    {"Misra1a", misra1a}, {"Misra1b", misra1b}, {"Misra1c", misra1c}, {"Misra1d", misra1d},
    {"Chwirut", chwirut}, {"Lanczos", lanczos}, {"Gauss", gauss},     {"DanWood", danwood},
    {"Kirby2", kirby2},   {"Hahn1", cubics},    {"Nelson", nelson},   {"MGH17", mgh17},
    {"Roszman", roszman}, {"ENSO", enso},       {"MGH09", mgh09},     {"Thurber", cubics},
    {"BoxBOD", misra1a},  {"Rat42", rat42},     {"MGH10", mgh10},     {"Eckerle", eckerle},
    {"Rat43", rat43},     {"Bennett", bennett},
};

static void nist_residuals(const minimise_problem *p, const num *x, num *r) {
    const nist_case *set = p->nist;
    const double *row = set->numbers + 3 * set->parameters;
    num (*value)(const num *, const double *) = NULL;
    for (size_t i = 0; i < sizeof nist_models / sizeof *nist_models; i++)
        if (strncmp(set->name, nist_models[i].name, strlen(nist_models[i].name)) == 0)
            value = nist_models[i].value;
    for (size_t i = 0; i < set->rows; i++, row += set->columns)
        r[i] = value(x, row + 1) - (value == nelson ? log(row[0]) : row[0]);
}

/* ---- both collections, by number ---- */

enum {
    MGH_COUNT = sizeof mgh_table / sizeof *mgh_table,
    NIST_COUNT = sizeof nist_table / sizeof *nist_table,
    MINIMISE_PROBLEMS = MGH_COUNT + NIST_COUNT
};

static minimise_problem minimise_problem_at(size_t number) {
    if (number < MGH_COUNT) return mgh_table[number];
    const nist_case *set = &nist_table[number - MGH_COUNT];
    return (minimise_problem){set->name,  set->parameters, set->rows, nist_residuals,
                              set->least, set->numbers,    set};
}

static size_t minimise_problem_starts(const minimise_problem *p) {
    return p->nist != NULL ? 2 : 3;
}

static void minimise_problem_start(const minimise_problem *p, size_t start, double *x) {
    const double factor = p->nist != NULL ? 1 : start == 0 ? 1 : start == 1 ? 10 : 100;
    const double *from = p->nist != NULL ? p->start + start * p->n : p->start;
    for (size_t i = 0; i < p->n; i++) x[i] = p->residuals == watson && start > 0 ? factor : factor * from[i];
}

/* The residuals r (m) and their Jacobian (m, n) at x. */
static void minimise_problem_jacobian(const minimise_problem *p, const double *x, double *r,
                                      double *jacobian) {
    static const double step = 1e-100;
    num at[MOST_VARIABLES], value[MOST_RESIDUALS];
    for (size_t i = 0; i < p->n; i++) at[i] = x[i];
    for (size_t j = 0; j < p->n; j++) {
        at[j] = x[j] + step * I;
        p->residuals(p, at, value);
        at[j] = x[j];
        for (size_t i = 0; i < p->m; i++) jacobian[i * p->n + j] = cimag(value[i]) / step;
    }
    for (size_t i = 0; i < p->m; i++) r[i] = creal(value[i]);
}

/* f = |r|^2 and its gradient (n). */
static void minimise_problem_value(const minimise_problem *p, const double *x, double *value,
                                   double *gradient) {
    double r[MOST_RESIDUALS], jacobian[MOST_RESIDUALS * MOST_VARIABLES];
    minimise_problem_jacobian(p, x, r, jacobian);
    *value = 0;
    for (size_t j = 0; j < p->n; j++) gradient[j] = 0;
    for (size_t i = 0; i < p->m; i++) {
        *value += r[i] * r[i];
        for (size_t j = 0; j < p->n; j++) gradient[j] += 2 * r[i] * jacobian[i * p->n + j];
    }
}

#endif
