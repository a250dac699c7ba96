/* The library's table of schemes, and lg_scheme_check, which checks that a scheme is consistent. */
#include "liegrad/integrators.h"

#include <math.h>
#include <string.h>

#include "core/core.h"

/* Kutta (1901), the classical tableau. */
#define TABLEAU_RK4                                                                                          \
    .stages = 4, .order = 4, .c = {0.0, 0.5, 0.5, 1.0}, .a = {{0.0}, {0.5}, {0.0, 0.5}, {0.0, 0.0, 1.0}},    \
    .b = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0}

/* Dormand and Prince (1980), RK5(4)7M. DP_ROWS are rows 1..6 of a; row 7 equals the weights b. */
#define DP_ROWS                                                                                              \
    {0.0}, {1.0 / 5.0}, {3.0 / 40.0, 9.0 / 40.0}, {44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0},                   \
        {19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0}, {                           \
        9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0                    \
    }
#define DP_WEIGHTS                                                                                           \
    { 35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0 }
#define TABLEAU_DP5                                                                                          \
    .stages = 6, .order = 5, .c = {0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0}, .a = {DP_ROWS},   \
    .b = DP_WEIGHTS
#define TABLEAU_DP54                                                                                         \
    .stages = 7, .order = 5, .embedded_order = 4, .fsal = true,                                              \
    .c = {0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0}, .a = {DP_ROWS, DP_WEIGHTS},           \
    .b = DP_WEIGHTS,                                                                                         \
    .embedded = {5179.0 / 57600.0, 0.0,       7571.0 / 16695.0, 393.0 / 640.0, -92097.0 / 339200.0,          \
                 187.0 / 2100.0,   1.0 / 40.0}

/* Dense output for Dormand-Prince 5(4): the continuous extension of order 4 with the least error (Shampine
 * 1986), b_i(s) = sum_j dense[i][j] s^(j+1). */
#define DENSE_DP54                                                                                           \
    .dense_order = 4,                                                                                        \
    .dense = {                                                                                               \
        {1.0, -8048581381.0 / 2820520608.0, 8663915743.0 / 2820520608.0, -12715105075.0 / 11282082432.0},    \
        {0.0},                                                                                               \
        {0.0, 131558114200.0 / 32700410799.0, -68118460800.0 / 10900136933.0,                                \
         87487479700.0 / 32700410799.0},                                                                     \
        {0.0, -1754552775.0 / 470086768.0, 14199869525.0 / 1410260304.0, -10690763975.0 / 1880347072.0},     \
        {0.0, 127303824393.0 / 49829197408.0, -318862633887.0 / 49829197408.0,                               \
         701980252875.0 / 199316789632.0},                                                                   \
        {0.0, -282668133.0 / 205662961.0, 2019193451.0 / 616988883.0, -1453857185.0 / 822651844.0},          \
        {0.0, 40617522.0 / 29380423.0, -110615467.0 / 29380423.0, 69997945.0 / 29380423.0}}

/* Hairer, Norsett and Wanner, Solving ordinary differential equations I, II.5 and II.10: the method of order
 * 8 in their DOP853 (after Dormand and Prince), with only its error estimate of order 5. */
#define TABLEAU_DP85                                                                                         \
    .stages = 12, .order = 8, .embedded_order = 5,                                                           \
    .c = {0.0,                                                                                               \
          0.05260015195876773,                                                                               \
          0.0789002279381516,                                                                                \
          0.1183503419072274,                                                                                \
          0.2816496580927726,                                                                                \
          0.3333333333333333,                                                                                \
          0.25,                                                                                              \
          0.3076923076923077,                                                                                \
          0.6512820512820513,                                                                                \
          0.6,                                                                                               \
          0.8571428571428571,                                                                                \
          1.0},                                                                                              \
    .a = {{0.0},                                                                                             \
          {0.05260015195876773},                                                                             \
          {0.0197250569845379, 0.0591751709536137},                                                          \
          {0.02958758547680685, 0.0, 0.08876275643042054},                                                   \
          {0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792},                                 \
          {0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242},                        \
          {0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125},                   \
          {0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,   \
           0.008273789163814023},                                                                            \
          {0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726, 27.59209969944671,         \
           20.154067550477894, -43.48988418106996},                                                          \
          {0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843, 21.230051448181193,       \
           15.279233632882423, -33.28821096898486, -0.020331201708508627},                                   \
          {-0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295, -8.149787010746927,         \
           -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196},                 \
          {2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625, -17.9589318631188,          \
           27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303,                    \
           0.6433927460157636}},                                                                             \
    .b = {0.054293734116568765,                                                                              \
          0.0,                                                                                               \
          0.0,                                                                                               \
          0.0,                                                                                               \
          0.0,                                                                                               \
          4.450312892752409,                                                                                 \
          1.8915178993145003,                                                                                \
          -5.801203960010585,                                                                                \
          0.3111643669578199,                                                                                \
          -0.1521609496625161,                                                                               \
          0.20136540080403034,                                                                               \
          0.04471061572777259},                                                                              \
    .embedded = {0.04117368912237389,                                                                        \
                 0.0,                                                                                        \
                 0.0,                                                                                        \
                 0.0,                                                                                        \
                 0.0,                                                                                        \
                 5.675469339128614,                                                                          \
                 2.3872768489717506,                                                                         \
                 -7.465581142465571,                                                                         \
                 0.6614932157077935,                                                                         \
                 -0.48634006837553356,                                                                       \
                 0.11944219431891463,                                                                        \
                 0.06706592359165889}

/* Munthe-Kaas and Owren (1999): the two commutators with which the classical tableau has order 4 without
 * dexpinv; h^2 multiplies their weights. */
static const lg_commutator rkmk4_2c_commutators[] = {{2, 0, 1, -1.0 / 8.0}, {4, 0, 3, -1.0 / 12.0}};

/* Crouch and Grossman (1993) */
static const lg_cf_row cg3_rows[] = {
    {LG_CF_START, 0, {{0.0}}},
    {LG_CF_START, 1, {{3.0 / 4.0}}},
    {LG_CF_START, 2, {{119.0 / 216.0}, {0.0, 17.0 / 108.0}}},
    {LG_CF_START, 3, {{13.0 / 51.0}, {0.0, -2.0 / 3.0}, {0.0, 0.0, 24.0 / 17.0}}},
};

/* Celledoni, Marthinsen and Owren (2003), order 4: the fourth stage starts from the second stage's point. */
static const lg_cf_row cf4_rows[] = {
    {LG_CF_START, 0, {{0.0}}},
    {LG_CF_START, 1, {{0.5}}},
    {LG_CF_START, 1, {{0.0, 0.5}}},
    {1, 1, {{-0.5, 0.0, 1.0}}},
    {LG_CF_START,
     2,
     {{3.0 / 12.0, 2.0 / 12.0, 2.0 / 12.0, -1.0 / 12.0}, {-1.0 / 12.0, 2.0 / 12.0, 2.0 / 12.0, 3.0 / 12.0}}},
};

/* cf4 with one more stage for an embedded solution of order 3 (Curry and Owren 2019). */
static const lg_cf_row cf43_rows[] = {
    {LG_CF_START, 0, {{0.0}}},
    {LG_CF_START, 1, {{1.0 / 2.0}}},
    {LG_CF_START, 1, {{0.0, 1.0 / 2.0}}},
    {1, 1, {{-1.0 / 2.0, 0.0, 1.0}}},
    {LG_CF_START, 1, {{0.0, 3.0 / 4.0}}},
    {LG_CF_START,
     2,
     {{1.0 / 4.0, 1.0 / 6.0, 1.0 / 6.0, -1.0 / 12.0}, {-1.0 / 12.0, 1.0 / 6.0, 1.0 / 6.0, 1.0 / 4.0}}},
    {LG_CF_START, 2, {{1.0 / 3.0}, {-1.0 / 9.0, 1.0 / 3.0, 0.0, 0.0, 4.0 / 9.0}}},
};

/* Curry and Owren (2019), order 3 with embedded order 2. The update starts from the second stage's point
 * (cf32a) or from the third stage's (cf32b). */
static const lg_cf_row cf32a_rows[] = {
    {LG_CF_START, 0, {{0.0}}},
    {LG_CF_START, 1, {{1.0 / 3.0}}},
    {LG_CF_START, 1, {{0.0, 2.0 / 3.0}}},
    {1, 1, {{-1.0 / 12.0, 0.0, 3.0 / 4.0}}},
    {LG_CF_START, 1, {{0.0, 0.5, 0.5}}},
};
static const lg_cf_row cf32b_rows[] = {
    {LG_CF_START, 0, {{0.0}}},
    {LG_CF_START, 1, {{2.0 / 3.0}}},
    {LG_CF_START, 1, {{5.0 / 12.0, 1.0 / 4.0}}},
    {2, 1, {{-1.0 / 6.0, -1.0 / 2.0, 1.0}}},
    {LG_CF_START, 1, {{1.0 / 4.0, 0.0, 3.0 / 4.0}}},
};

/* Forest and Ruth (1990): Stormer-Verlet steps of sizes w h, (1 - 2 w) h, w h with w = 1/(2 - 2^(1/3)). */
#define FR_W 1.351207191959657634

/* Blanes and Moan (2002), table 3, SRKN_6^b. The coefficients are symmetric; the middle ones follow from the
 * condition that the kicks and the drifts each sum to 1. */
#define BM_KICK1  0.0829844064174052
#define BM_KICK2  0.396309801498368
#define BM_KICK3  (-0.0390563049223486)
#define BM_KICK4  (1.0 - 2.0 * (BM_KICK1 + BM_KICK2 + BM_KICK3))
#define BM_DRIFT1 0.245298957184271
#define BM_DRIFT2 0.604872665711080
#define BM_DRIFT3 (0.5 - (BM_DRIFT1 + BM_DRIFT2))

#define CLASSICAL           .kind = LG_SCHEME_RKMK, .ambient = true
#define IMPLICIT            .kind = LG_SCHEME_IMPLICIT, .ambient = true, .stages = 1
#define RKMK(bracket_depth) .kind = LG_SCHEME_RKMK, .dexpinv = (bracket_depth)
#define CF                  .kind = LG_SCHEME_COMMUTATOR_FREE
#define SPLITTING           .kind = LG_SCHEME_SPLITTING

static const lg_scheme schemes[] = {
    {.name = "euler", CLASSICAL, .stages = 1, .order = 1, .b = {1.0}},
    {.name = "implicit-euler", IMPLICIT, .order = 1, .theta = 1.0},
    {.name = "midpoint", IMPLICIT, .order = 2, .theta = 0.5},
    {.name = "rk4", CLASSICAL, TABLEAU_RK4},
    {.name = "rk4-projected", CLASSICAL, TABLEAU_RK4, .project = true},
    {.name = "dp54", CLASSICAL, TABLEAU_DP54, DENSE_DP54},
    {.name = "dp85", CLASSICAL, TABLEAU_DP85},
    {.name = "symplectic-euler", SPLITTING, .stages = 1, .order = 1, .kick = {1.0}, .drift = {1.0}},
    {.name = "stormer-verlet", SPLITTING, .stages = 2, .order = 2, .kick = {0.5, 0.5}, .drift = {1.0, 0.0}},
    {.name = "forest-ruth",
     SPLITTING,
     .stages = 4,
     .order = 4,
     .kick = {0.5 * FR_W, 0.5 - 0.5 * FR_W, 0.5 - 0.5 * FR_W, 0.5 * FR_W},
     .drift = {FR_W, 1.0 - 2.0 * FR_W, FR_W, 0.0}},
    {.name = "blanes-moan",
     SPLITTING,
     .stages = 7,
     .order = 4,
     .kick = {BM_KICK1, BM_KICK2, BM_KICK3, BM_KICK4, BM_KICK3, BM_KICK2, BM_KICK1},
     .drift = {BM_DRIFT1, BM_DRIFT2, BM_DRIFT3, BM_DRIFT3, BM_DRIFT2, BM_DRIFT1, 0.0}},
    {.name = "variational", .kind = LG_SCHEME_VARIATIONAL, .stages = 1, .order = 2},
    {.name = "lie-euler", RKMK(LG_DEXPINV_EXACT), .stages = 1, .order = 1, .b = {1.0}},
    {.name = "lie-heun",
     RKMK(0),
     .stages = 2,
     .order = 2,
     .c = {0.0, 1.0},
     .a = {{0.0}, {1.0}},
     .b = {0.5, 0.5}},
    {.name = "rkmk3",
     RKMK(LG_DEXPINV_EXACT),
     .stages = 3,
     .order = 3,
     .c = {0.0, 0.5, 1.0},
     .a = {{0.0}, {0.5}, {-1.0, 2.0}},
     .b = {1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0}},
    {.name = "rkmk4", RKMK(LG_DEXPINV_EXACT), TABLEAU_RK4},
    {.name = "rkmk4-2c",
     RKMK(0),
     TABLEAU_RK4,
     .commutators = rkmk4_2c_commutators,
     .commutator_count = LG_COUNT(rkmk4_2c_commutators)},
    {.name = "rkmk5", RKMK(LG_DEXPINV_EXACT), TABLEAU_DP5},
    {.name = "rkmk54", RKMK(LG_DEXPINV_EXACT), TABLEAU_DP54, DENSE_DP54},
    {.name = "cg3", CF, .stages = 3, .order = 3, .c = {0.0, 3.0 / 4.0, 17.0 / 24.0}, .rows = cg3_rows},
    {.name = "cf4", CF, .stages = 4, .order = 4, .c = {0.0, 0.5, 0.5, 1.0}, .rows = cf4_rows},
    {.name = "cf32a",
     CF,
     .stages = 3,
     .order = 3,
     .embedded_order = 2,
     .c = {0.0, 1.0 / 3.0, 2.0 / 3.0},
     .rows = cf32a_rows},
    {.name = "cf32b",
     CF,
     .stages = 3,
     .order = 3,
     .embedded_order = 2,
     .c = {0.0, 2.0 / 3.0, 2.0 / 3.0},
     .rows = cf32b_rows},
    {.name = "cf43",
     CF,
     .stages = 5,
     .order = 4,
     .embedded_order = 3,
     .c = {0.0, 0.5, 0.5, 1.0, 0.75},
     .rows = cf43_rows},
    {.name = "slgi", .kind = LG_SCHEME_SLGI, .stages = 1, .order = 2, .theta = 0.5},
};

size_t lg_scheme_count(void) {
    return LG_COUNT(schemes);
}

const lg_scheme *lg_scheme_at(size_t index) {
    return index < LG_COUNT(schemes) ? &schemes[index] : NULL;
}

const lg_scheme *lg_scheme_find(const char *name) {
    for (size_t i = 0; name && i < LG_COUNT(schemes); i++)
        if (strcmp(schemes[i].name, name) == 0) return &schemes[i];
    return NULL;
}

/* ---- consistency ---- */

/* |a - b| <= 1e-12; false if one of them is NaN. */
static bool near(double a, double b) {
    return fabs(a - b) <= 1e-12;
}

static double sum(const double *x, int n) {
    double s = 0.0;
    for (int i = 0; i < n; i++) s += x[i];
    return s;
}

static const char *tableau_fault(const lg_scheme *s) {
    for (int i = 0; i < s->stages; i++) {
        if (!near(sum(s->a[i], s->stages), s->c[i])) return "a number of c is not the sum of its row of a";
        for (int j = i; j < s->stages; j++)
            if (s->a[i][j] != 0.0) return "the scheme is not explicit";
    }
    if (!near(sum(s->b, s->stages), 1.0)) return "the weights do not sum to 1";
    if (s->embedded_order > 0 && !near(sum(s->embedded, s->stages), 1.0))
        return "the embedded weights do not sum to 1";
    bool differs = s->embedded_order == 0;
    for (int j = 0; j < s->stages; j++) differs = differs || s->embedded[j] != s->b[j];
    if (!differs) return "the embedded weights are equal to the weights, so they cannot estimate the error";
    for (int j = 0; s->fsal && j < s->stages; j++)
        if (!near(s->a[s->stages - 1][j], s->b[j])) return "fsal: the last row of a must be equal to b";
    if (s->fsal && s->stages < 2) return "fsal needs at least two stages";
    return NULL;
}

static const char *commutator_fault(const lg_scheme *s) {
    if (s->commutator_count < 0 || (s->commutator_count > 0 && !s->commutators))
        return "commutator_count is negative, or commutators is NULL";
    for (int i = 0; i < s->commutator_count; i++) {
        const lg_commutator *c = &s->commutators[i];
        if (c->row < 1 || c->row > s->stages) return "a commutator's row is out of range";
        if (c->first < 0 || c->first >= c->row || c->second < 0 || c->second >= c->row)
            return "a commutator uses a stage that its row does not know yet";
        if (!isfinite(c->weight)) return "a commutator's weight is not finite";
        if (s->fsal && c->row == s->stages)
            return "fsal: the row of the step cannot have commutators; give them to the row of the last "
                   "stage";
    }
    return s->commutator_count > 0 && s->dense_order > 0
               ? "a scheme with commutators cannot have dense output"
               : NULL;
}

/* Checks b_i(1) = b_i for each i, and sum_i b_i(s) = s. */
static const char *dense_fault(const lg_scheme *s) {
    double powers[LG_DENSE_POWERS] = {0.0};
    if (s->dense_order < 1) return s->dense_order < 0 ? "the order of dense output is negative" : NULL;
    for (int i = 0; i < s->stages; i++) {
        if (!near(sum(s->dense[i], LG_DENSE_POWERS), s->b[i]))
            return "the weights of dense output at the end of the step are not b";
        for (int j = 0; j < LG_DENSE_POWERS; j++) powers[j] += s->dense[i][j];
    }
    for (int j = 0; j < LG_DENSE_POWERS; j++)
        if (!near(powers[j], j == 0 ? 1.0 : 0.0))
            return "the weights of dense output do not sum to s, the fraction of the step";
    return NULL;
}

static const char *rkmk_fault(const lg_scheme *s) {
    const char *fault = tableau_fault(s);
    if (!fault && (s->dexpinv < LG_DEXPINV_EXACT || s->dexpinv > LG_DEXPINV_MAX))
        fault = "dexpinv is out of range";
    if (!fault) fault = commutator_fault(s);
    return fault ? fault : dense_fault(s);
}

/* Checks row `index`: it may use the first `known` stages only, and its coefficients, added to the time of
 * its base, must give `c`, the time of its point in units of h. */
static const char *cf_row_fault(const lg_scheme *s, int index, int known, double c) {
    const lg_cf_row *row = &s->rows[index];
    if (row->base < LG_CF_START || row->base >= known) return "the base of a row must be an earlier stage";
    if (row->exponentials < 0 || row->exponentials > LG_SCHEME_MAX_EXPONENTIALS)
        return "a row has a negative or too large number of exponentials";
    double total = row->base == LG_CF_START ? 0.0 : s->c[row->base];
    for (int e = 0; e < row->exponentials; e++) {
        total += sum(row->coefficient[e], s->stages);
        for (int j = known; j < s->stages; j++)
            if (row->coefficient[e][j] != 0.0) return "the scheme is not explicit";
    }
    return near(total, c) ? NULL : "the coefficients of a row do not sum to the time of its stage";
}

static const char *cf_fault(const lg_scheme *s) {
    if (!s->rows) return "rows is NULL";
    for (int i = 0; i < s->stages + 1 + (s->embedded_order > 0); i++) {
        const bool stage = i < s->stages;
        const char *fault = cf_row_fault(s, i, stage ? i : s->stages, stage ? s->c[i] : 1.0);
        if (fault) return fault;
    }
    return NULL;
}

static const char *splitting_fault(const lg_scheme *s) {
    if (!near(sum(s->kick, s->stages), 1.0)) return "the kicks do not sum to 1";
    if (!near(sum(s->drift, s->stages), 1.0)) return "the drifts do not sum to 1";
    return NULL;
}

static const char *theta_fault(const lg_scheme *s) {
    if (s->stages != 1) return "a scheme of this kind must have one stage";
    return s->theta >= 0.0 && s->theta <= 1.0 ? NULL : "theta is outside 0..1";
}

/* Refuses parts that schemes of this kind cannot have. */
static const char *kind_fault(const lg_scheme *s) {
    const bool rkmk = s->kind == LG_SCHEME_RKMK;
    if (s->embedded_order > 0 && !rkmk && s->kind != LG_SCHEME_COMMUTATOR_FREE)
        return "a scheme of this kind cannot have an embedded solution";
    if (s->dense_order != 0 && !rkmk) return "a scheme of this kind cannot have dense output";
    if (s->commutator_count != 0 && !rkmk) return "a scheme of this kind cannot have commutators";
    return s->project && !s->ambient ? "project is for ambient schemes only" : NULL;
}

lg_status lg_scheme_check(const lg_scheme *scheme, lg_error *error) {
    static const char *(*const fault_of[LG_SCHEME_KINDS])(const lg_scheme *) = {
        [LG_SCHEME_RKMK] = rkmk_fault,           [LG_SCHEME_COMMUTATOR_FREE] = cf_fault,
        [LG_SCHEME_SPLITTING] = splitting_fault, [LG_SCHEME_IMPLICIT] = theta_fault,
        [LG_SCHEME_SLGI] = theta_fault,
    };
    if (!scheme) return lg_fail(error, LG_INVALID_ARGUMENT, "scheme is NULL");
    const char *name = scheme->name ? scheme->name : "(no name)";
    const char *fault = NULL;
    if ((unsigned)scheme->kind >= LG_SCHEME_KINDS)
        fault = "unknown kind";
    else if (scheme->stages < 1 || scheme->stages > LG_SCHEME_MAX_STAGES)
        fault = "the number of stages is out of range";
    else if (scheme->order < 1 || scheme->embedded_order < 0)
        fault = "the order is out of range";
    else
        fault = kind_fault(scheme);
    if (!fault && fault_of[scheme->kind]) fault = fault_of[scheme->kind](scheme);
    if (fault) return lg_fail(error, LG_INVALID_ARGUMENT, "scheme %s: %s", name, fault);
    return lg_fail(error, LG_OK, "%s", "");
}
