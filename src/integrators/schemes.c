/* The schemes of the library, as data, and the check of a scheme's consistency. */
#include "liegrad/integrators.h"

#include <math.h>
#include <string.h>

#include "core/core.h"

/* Kutta (1901), the classical tableau. */
#define TABLEAU_RK4                                                                                          \
    .stages = 4, .order = 4, .c = {0.0, 0.5, 0.5, 1.0}, .a = {{0.0}, {0.5}, {0.0, 0.5}, {0.0, 0.0, 1.0}},    \
    .b = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0}

/* Dormand and Prince (1980), RK5(4)7M. Rows 1..6; row 7 equals the weights. */
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

/* Celledoni, Marthinsen and Owren (2003), order 4 with the second stage's point reused by the fourth. */
static const lg_cf_row cf4_rows[] = {
    {LG_CF_START, 0, {{0.0}}},
    {LG_CF_START, 1, {{0.5}}},
    {LG_CF_START, 1, {{0.0, 0.5}}},
    {1, 1, {{-0.5, 0.0, 1.0}}},
    {LG_CF_START,
     2,
     {{3.0 / 12.0, 2.0 / 12.0, 2.0 / 12.0, -1.0 / 12.0}, {-1.0 / 12.0, 2.0 / 12.0, 2.0 / 12.0, 3.0 / 12.0}}},
};

static const lg_scheme schemes[] = {
    {.name = "euler", .kind = LG_SCHEME_RKMK, .ambient = true, .stages = 1, .order = 1, .b = {1.0}},
    {.name = "rk4", .kind = LG_SCHEME_RKMK, .ambient = true, TABLEAU_RK4},
    {.name = "dp54", .kind = LG_SCHEME_RKMK, .ambient = true, TABLEAU_DP54},
    {.name = "lie-euler",
     .kind = LG_SCHEME_RKMK,
     .dexpinv = LG_DEXPINV_EXACT,
     .stages = 1,
     .order = 1,
     .b = {1.0}},
    {.name = "rkmk4", .kind = LG_SCHEME_RKMK, .dexpinv = LG_DEXPINV_EXACT, TABLEAU_RK4},
    {.name = "rkmk5", .kind = LG_SCHEME_RKMK, .dexpinv = LG_DEXPINV_EXACT, TABLEAU_DP5},
    {.name = "rkmk54", .kind = LG_SCHEME_RKMK, .dexpinv = LG_DEXPINV_EXACT, TABLEAU_DP54},
    {.name = "cf4",
     .kind = LG_SCHEME_COMMUTATOR_FREE,
     .stages = 4,
     .order = 4,
     .c = {0.0, 0.5, 0.5, 1.0},
     .rows = cf4_rows},
    {.name = "stormer-verlet",
     .kind = LG_SCHEME_SPLITTING,
     .stages = 2,
     .order = 2,
     .kick = {0.5, 0.5},
     .drift = {1.0, 0.0}},
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

/* false for NaN */
static bool near(double a, double b) {
    return fabs(a - b) <= 1e-12;
}

static double sum(const double *x, int n) {
    double s = 0.0;
    for (int i = 0; i < n; i++) s += x[i];
    return s;
}

static const char *rkmk_fault(const lg_scheme *s) {
    for (int i = 0; i < s->stages; i++) {
        if (!near(sum(s->a[i], s->stages), s->c[i])) return "c_i is not the sum of row i of a";
        for (int j = i; j < s->stages; j++)
            if (s->a[i][j] != 0.0) return "the scheme is not explicit";
    }
    if (!near(sum(s->b, s->stages), 1.0)) return "the weights do not sum to 1";
    if (s->embedded_order > 0 && !near(sum(s->embedded, s->stages), 1.0))
        return "the embedded weights do not sum to 1";
    for (int j = 0; s->fsal && j < s->stages; j++)
        if (!near(s->a[s->stages - 1][j], s->b[j])) return "fsal: the last row of a is not b";
    if (s->fsal && s->stages < 2) return "fsal needs two stages";
    if (s->dexpinv < LG_DEXPINV_EXACT || s->dexpinv > LG_DEXPINV_MAX) return "dexpinv is out of range";
    return NULL;
}

/* Row `index`, whose point lies at time `c`, may use the first `known` stages. */
static const char *cf_row_fault(const lg_scheme *s, int index, int known, double c) {
    const lg_cf_row *row = &s->rows[index];
    if (row->base < LG_CF_START || row->base >= known) return "a base is not an earlier stage";
    if (row->exponentials < 0 || row->exponentials > LG_SCHEME_MAX_EXPONENTIALS)
        return "the number of exponentials is out of range";
    double total = row->base == LG_CF_START ? 0.0 : s->c[row->base];
    for (int e = 0; e < row->exponentials; e++) {
        total += sum(row->coefficient[e], s->stages);
        for (int j = known; j < s->stages; j++)
            if (row->coefficient[e][j] != 0.0) return "the scheme is not explicit";
    }
    return near(total, c) ? NULL : "the coefficients of a row do not sum to its time";
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
    return s->embedded_order > 0 ? "splitting schemes have no embedded solution" : NULL;
}

lg_status lg_scheme_check(const lg_scheme *scheme, lg_error *error) {
    static const char *(*const fault_of[LG_SCHEME_KINDS])(const lg_scheme *) = {
        [LG_SCHEME_RKMK] = rkmk_fault,
        [LG_SCHEME_COMMUTATOR_FREE] = cf_fault,
        [LG_SCHEME_SPLITTING] = splitting_fault,
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
        fault = fault_of[scheme->kind](scheme);
    if (fault) return lg_fail(error, LG_INVALID_ARGUMENT, "scheme %s: %s", name, fault);
    return lg_fail(error, LG_OK, "%s", "");
}
